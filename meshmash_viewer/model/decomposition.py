"""Decomposition of a mesh into its store, with a check of memory and growing results."""

from __future__ import annotations

import time
from bisect import bisect_right
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.spectrum import (
    Obtained,
    damage_remark,
    find_eigenpairs,
    obtain_eigenpairs,
)
from meshmash_viewer.io.stored_spectrum import StoredRows
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.previews import open_preview
from meshmash_viewer.model.results import NO_ROWS, SpectrumGrew
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.alignment import Alignment, align
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import estimate_memory
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import counted
from meshmash_viewer.work.job import Channel

#: Temporary folder for eigenpairs that cannot be written to the user's cache.
SPARE = "eigenpairs"

#: Seconds between two messages that the spectrum has grown; the first comes at once.
_GROWTH_SECONDS = 0.3
#: Share of the free memory that a run may take.
_SHARE = 0.9


def find_known(mesh: Mesh, operator: OperatorOptions) -> tuple[SpectrumGrew | None, str]:
    """Look for eigenpairs in the store, without computing or checking any.

    The second value is a sentence for the message bar if a part of the store is damaged, or "".
    """
    stored = find_eigenpairs(mesh, operator)
    if stored is None:
        return None, ""
    known = None
    count = stored.n_converged
    if count:
        found = Obtained(stored.decomposition(count), stored.stored_rows)
        known_to = (stored.proof.max_eigenvalue or 0.0) if stored.proof is not None else 0.0
        known = _grown(found, operator, known_to=known_to)
    return known, damage_remark(stored.faults)


def decompose(
    mesh: Mesh, operator: OperatorOptions, target: Target, channel: Channel
) -> SpectrumGrew:
    """Compute the eigenpairs of a mesh that its store lacks, and write them there.

    A `SpectrumGrew` is sent through the channel whenever pairs have become final; the one that is
    returned has all requested pairs, with their certificate.

    Raises
    ------
    InputError
        If they cannot fit into memory or on the disk.
    Cancelled
        If the user cancelled; the pairs that had converged stay in the store.
    """
    free = free_memory()
    growth = _Growth(mesh, operator, channel)
    try:
        found = obtain_eigenpairs(
            mesh,
            operator,
            target,
            spare=channel.folder / SPARE,
            progress=channel.report,
            cancel=channel.cancelled,
            follower=growth,
            check=lambda n, nnz, k: refuse_what_cannot_fit(n, nnz, k, free, mesh.n_components),
        )
    except Cancelled:
        growth.send()
        raise
    alignment = growth.align(found.decomposition.rows, found.decomposition.eigenvalues)
    known_to = target.max_eigenvalue or 0.0
    return _grown(found, operator, alignment=alignment, known_to=known_to)


def free_memory() -> int:
    """Return the bytes of memory that are available."""
    import psutil

    return int(psutil.virtual_memory().available)


def refuse_what_cannot_fit(n: int, nnz: int, k: int, free: int, n_null: int = 1) -> None:
    """Raise an `InputError` if k pairs take more than the `free` bytes.

    The mesh has n vertices and `n_null` components, and its Laplacian nnz entries.
    """

    def need(count: int) -> int:
        # where memory is short, one slice of the spectrum is computed at a time
        return estimate_memory(n, nnz, count, 1, n_null=n_null)

    k = min(k, n)
    needed = need(k)
    if needed <= _SHARE * free:
        return
    fitting = bisect_right(range(1, k + 1), _SHARE * free, key=need)
    way_out = f"ask for at most {fitting:,}" if fitting else "simplify the mesh"
    raise InputError(
        f"{counted(k, 'eigenpair')} of {counted(n, 'vertex')} take about "
        f"{written_bytes(needed)} of memory, and "
        f"{written_bytes(free)} are free: {way_out}, or close other programs."
    )


class _Growth:
    """Sends pairs that have become final to the window, at most every `_GROWTH_SECONDS`."""

    def __init__(self, mesh: Mesh, operator: OperatorOptions, channel: Channel) -> None:
        self._mesh = mesh
        self._operator = operator
        self._channel = channel
        self._preview: Path | None = None
        self._alignment: Alignment | None = None
        self._mass = np.zeros(0)
        self._time = -_GROWTH_SECONDS
        self._n_sent = 0
        self._stored: StoredRows | None = None
        self._rows: npt.NDArray[Any] = np.zeros((0, 0))
        self._eigenvalues = np.zeros(0)
        self._residuals = np.zeros(0)

    def begin(self, known: Obtained | None, mass: npt.NDArray[np.float64]) -> None:
        self._mass = mass
        if known is not None:
            # a solve that resumes from known pairs reports these again
            self._n_sent = known.decomposition.n_components
            self._channel.send(_grown(known, self._operator, ended=False))
        else:
            preview = open_preview(self._mesh, self._operator, self._channel)
            if preview is not None:
                self._preview = preview.preview_path
                self._channel.send(preview)

    def grow(
        self,
        stored: StoredRows | None,
        rows: npt.NDArray[np.float64],
        values: npt.NDArray[np.float64],
        residuals: npt.NDArray[np.float64],
    ) -> None:
        self._stored, self._rows = stored, rows
        self._eigenvalues, self._residuals = values, residuals
        if time.monotonic() - self._time >= _GROWTH_SECONDS:
            self.send()

    def send(self) -> None:
        """Send the pairs that the window does not have yet."""
        converged = len(self._eigenvalues)
        if converged <= self._n_sent or not self._eigenvalues.any():
            return  # nothing to display in a null space alone
        first = self._n_sent == 0
        self._n_sent, self._time = converged, time.monotonic()
        self._channel.send(
            SpectrumGrew(
                Eigenpairs(
                    self._eigenvalues.copy(),
                    NO_ROWS,
                    self._residuals.copy(),
                    total=len(self._rows),
                    operator=self._operator,
                    mass=self._mass if first else None,
                    stored=self._stored,
                ),
                alignment=self.align(self._rows, self._eigenvalues),
            )
        )

    def align(
        self, rows: npt.NDArray[np.floating[Any]], eigenvalues: npt.NDArray[np.float64]
    ) -> Alignment | None:
        """Align exact rows with the displayed preview, if there is one."""
        if self._preview is not None:
            shown = np.load(self._preview, mmap_mode="r")
            self._alignment = align(shown, rows, eigenvalues, self._mass, self._alignment)
        return self._alignment


def _grown(
    found: Obtained,
    operator: OperatorOptions,
    *,
    ended: bool = True,
    alignment: Alignment | None = None,
    known_to: float = 0.0,
) -> SpectrumGrew:
    decomposition = found.decomposition
    summary = Eigenpairs(
        np.array(decomposition.eigenvalues),
        NO_ROWS,
        np.array(decomposition.residuals),
        total=decomposition.n_components if ended else 0,
        certificate=decomposition.certificate if ended else None,
        operator=operator,
        known_to=known_to if ended and decomposition.complete else 0.0,
        mass=decomposition.mass if len(decomposition.mass) else None,
        stored=found.stored,
    )
    return SpectrumGrew(summary, alignment=alignment, remark=found.remark)
