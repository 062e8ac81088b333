"""Preview of the spectrum of a large mesh, kept in the temporary folder of the window."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import discard
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.results import NO_ROWS, MeshReady, SpectrumGrew
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.work.job import Channel

#: Smallest mesh that gets a preview: smaller ones are solved quickly.
FROM_VERTICES = 60_000
#: Pairs above the null space; fewer for a huge mesh, whose rows take long to write.
_PAIRS, _PAIRS_OF_HUGE, _HUGE = 50, 30, 500_000
#: With more components, most of the first eigenfunctions are constants on one of them.
_MOST_COMPONENTS = 150


def is_worthwhile(ready: MeshReady) -> bool:
    """Whether a preview of a mesh would have more pairs than the store."""
    mesh = ready.mesh
    if mesh.n_vertices < FROM_VERTICES:
        return False
    known = 0 if ready.known is None else len(ready.known.summary)
    return known < ready.health.n_components + _pairs(mesh)


def _pairs(mesh: Mesh) -> int:
    return _PAIRS if mesh.n_vertices < _HUGE else _PAIRS_OF_HUGE


def open_preview(mesh: Mesh, operator: OperatorOptions, channel: Channel) -> SpectrumGrew | None:
    """Compute the preview of a mesh, or find it in the temporary folder.

    None for a small mesh, or one with more than `_MOST_COMPONENTS` components.
    """
    if mesh.n_vertices < FROM_VERTICES:
        return None
    path = channel.folder / f"preview-{mesh.content_hash[:32]}.npy"
    notes = path.with_suffix(".npz")
    if path.exists() and notes.exists():
        with np.load(notes) as known:
            return _previewed(path, known["eigenvalues"], float(known["error"]), operator)
    if mesh.n_components > _MOST_COMPONENTS:
        return None
    from meshmash_viewer.spectral.preview import preview_eigenpairs  # which loads the compiler

    # the window no longer uses previews of other meshes
    discard(*channel.folder.glob("preview-*"))
    channel.report(Progress("preview", message="Approximating the first eigenfunctions"))
    n_pairs = mesh.n_components + _pairs(mesh)

    def allocate(k: int, n: int) -> npt.NDArray[np.float32]:
        # straight into the file that the window maps
        rows = np.lib.format.open_memmap(path, "w+", np.float32, (k, n))
        if hasattr(os, "posix_fallocate"):
            # a full disk raises here; at the write into the mapping it would crash the process
            with path.open("rb+") as file:
                os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
        return rows

    found = preview_eigenpairs(mesh, n_pairs, allocate=allocate, cancel=channel.cancelled)
    if len(found.eigenvalues) <= mesh.n_components:
        del found  # some systems delete no file that is mapped
        discard(path)
        return None
    np.savez(notes, eigenvalues=found.eigenvalues, error=found.error)
    return _previewed(path, found.eigenvalues, found.error, operator)


def _previewed(
    path: Path, eigenvalues: npt.NDArray[np.float64], error: float, operator: OperatorOptions
) -> SpectrumGrew:
    unknown = np.full(len(eigenvalues), np.nan)
    summary = Eigenpairs(
        eigenvalues, NO_ROWS, unknown, preview=True, operator=operator, error=error
    )
    return SpectrumGrew(summary, preview_path=path)
