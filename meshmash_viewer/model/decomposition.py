"""Decomposition of a mesh: its preview, and eigenpairs sent to the window as they converge."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import discard, make_room
from meshmash_viewer.io.spectrum import measure_errors, obtain_eigenpairs, with_stored_errors
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.alignment import Alignment, align
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.work import Channel, JobResult

#: Temporary folder for eigenpairs that cannot be written to the user's cache.
SPARE = "eigenpairs"

#: Minimum seconds between two messages with pairs; the first message is sent at once.
_GROWTH_SECONDS = 0.3


def decompose(mesh: Mesh, operator: OperatorOptions, target: Target, channel: Channel) -> JobResult:
    """Compute and store the missing eigenpairs of a mesh; the content is all of the target.

    Converging pairs are sent through the channel as `Eigenpairs`. The content includes their
    certificate.

    `InputError` is raised if the pairs do not fit into memory or on the disk, and `Cancelled` if
    the user cancelled; converged pairs stay in the store.
    """
    growth = _Growth(mesh, operator, channel)
    request = Request(
        target.n_components,
        target.max_eigenvalue,
        early=True,
        on_pairs=growth.take,
        progress=channel.report,
        cancel=channel.cancelled,
    )
    try:
        pairs, remark = obtain_eigenpairs(mesh, operator, request, spare=channel.folder / SPARE)
    except Cancelled:
        growth.send()
        raise
    pairs = with_stored_errors(mesh, pairs, channel.folder / SPARE)
    return JobResult(growth.aligned(pairs), remark)


def preview(mesh: Mesh, operator: OperatorOptions, channel: Channel) -> JobResult:
    """Approximate the first eigenfunctions; the content is a result of `open_preview`."""
    return JobResult(open_preview(mesh, operator, channel))


def measure_resolution(mesh: Mesh, pairs: Eigenpairs, channel: Channel) -> JobResult:
    """Measure `Eigenpairs.mesh_errors` on a finer mesh; the content has shape (m,)."""
    spare = channel.folder / SPARE
    found = measure_errors(
        mesh, pairs, spare=spare, progress=channel.report, cancel=channel.cancelled
    )
    return JobResult(found.mesh_errors[: found.n_measured])


class _Growth:
    """Sender of converged pairs to the window, at most every `_GROWTH_SECONDS`."""

    def __init__(self, mesh: Mesh, operator: OperatorOptions, channel: Channel) -> None:
        self._mesh = mesh
        self._operator = operator
        self._channel = channel
        self._preview: Eigenpairs | None = None
        self._alignment: Alignment | None = None
        self._time = -_GROWTH_SECONDS
        self._n_sent = 0
        self._mass: npt.NDArray[np.float64] = np.zeros(0)
        self._pairs: Eigenpairs | None = None

    def take(self, pairs: Eigenpairs) -> None:
        """Accept the stored pairs, and later each longer list of converged pairs."""
        first, self._pairs = self._pairs is None, pairs
        if first:
            self._mass = pairs.mass
        if first and not len(pairs):
            self._preview = open_preview(self._mesh, self._operator, self._channel)
            if self._preview is not None:
                self._channel.send(self._preview)
        elif first or time.monotonic() - self._time >= _GROWTH_SECONDS:
            self.send()

    def send(self) -> None:
        """Send the pairs if there are more than in the last message."""
        pairs = self._pairs
        if pairs is None or len(pairs) <= self._n_sent or not pairs.eigenvalues.any():
            return  # constant eigenfunctions show nothing
        if self._n_sent > 0:
            pairs = replace(pairs, mass=np.zeros(0))  # sent in the first message only
        self._n_sent, self._time = len(pairs), time.monotonic()
        self._channel.send(self.aligned(pairs))

    def aligned(self, pairs: Eigenpairs) -> Eigenpairs:
        """Return the pairs, aligned with the displayed preview if there is one."""
        if self._preview is not None:
            self._alignment = align(
                self._preview.rows, pairs.rows, pairs.eigenvalues, self._mass, self._alignment
            )
        return replace(pairs, alignment=self._alignment)


#: Number of vertices from which a preview is computed; smaller meshes are solved quickly.
FROM_VERTICES = 60_000
#: Pairs of a preview above the null space; fewer from `_HUGE` vertices on, to save time.
_PAIRS, _PAIRS_OF_HUGE, _HUGE = 50, 30, 500_000
#: Largest number of components for a preview; each adds an eigenfunction that is constant on it.
_MOST_COMPONENTS = 150


def is_worthwhile(ready: MeshReady) -> bool:
    """Return whether a preview of a mesh would have more pairs than are stored."""
    mesh = ready.mesh
    if mesh.n_vertices < FROM_VERTICES:
        return False
    known = 0 if ready.known is None else len(ready.known)
    return known < ready.health.n_components + _pairs(mesh)


def _pairs(mesh: Mesh) -> int:
    return _PAIRS if mesh.n_vertices < _HUGE else _PAIRS_OF_HUGE


def open_preview(mesh: Mesh, operator: OperatorOptions, channel: Channel) -> Eigenpairs | None:
    """Compute the preview of a mesh, or read it from the temporary folder.

    Return None for a small mesh, or a mesh of more than `_MOST_COMPONENTS` components.
    """
    if mesh.n_vertices < FROM_VERTICES:
        return None
    path = channel.folder / f"preview-{mesh.content_hash[:32]}.f32"
    notes = path.with_suffix(".npz")
    if not (path.exists() and notes.exists()) and not _write_preview(mesh, path, notes, channel):
        return None
    with np.load(notes) as known:
        values, error = known["eigenvalues"], float(known["error"])
    rows = np.memmap(path, np.float32, "r", shape=(len(values), mesh.n_vertices))
    residuals = np.full(len(values), np.nan)
    return Eigenpairs(values, rows, residuals, n_exact=0, error=error, operator=operator)


def _write_preview(mesh: Mesh, path: Path, notes: Path, channel: Channel) -> bool:
    """Compute a preview, and write its rows and eigenvalues; return False without a preview."""
    if mesh.n_components > _MOST_COMPONENTS:
        return False
    from meshmash_viewer.spectral.preview import preview_eigenpairs  # imports numba

    # previews of other meshes are no longer displayed
    discard(*channel.folder.glob("preview-*"))
    channel.report(Progress("preview", message="Approximating the first eigenfunctions"))

    def allocate(k: int, n: int) -> npt.NDArray[np.float32]:
        # directly in the file that the window memory-maps
        make_room(path, 4 * k * n)
        return np.memmap(path, np.float32, "r+", shape=(k, n))

    n_pairs = mesh.n_components + _pairs(mesh)
    found = preview_eigenpairs(mesh, n_pairs, allocate=allocate, cancel=channel.cancelled)
    if len(found) <= mesh.n_components:
        del found  # Windows cannot delete a mapped file
        discard(path)
        return False
    np.savez(notes, eigenvalues=found.eigenvalues, error=found.error)
    return True
