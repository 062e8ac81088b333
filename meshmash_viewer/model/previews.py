"""Preview of the spectrum of a large mesh, kept in the temporary folder of the window."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import discard, make_room
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.results import MeshReady
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
    known = 0 if ready.known is None else len(ready.known)
    return known < ready.health.n_components + _pairs(mesh)


def _pairs(mesh: Mesh) -> int:
    return _PAIRS if mesh.n_vertices < _HUGE else _PAIRS_OF_HUGE


def open_preview(mesh: Mesh, operator: OperatorOptions, channel: Channel) -> Eigenpairs | None:
    """Compute the preview of a mesh, or find it in the temporary folder.

    None for a small mesh, or one with more than `_MOST_COMPONENTS` components.
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
    """Write the rows of a preview, and its eigenvalues; return whether there is one."""
    if mesh.n_components > _MOST_COMPONENTS:
        return False
    from meshmash_viewer.spectral.preview import preview_eigenpairs  # which loads the compiler

    # the window no longer uses previews of other meshes
    discard(*channel.folder.glob("preview-*"))
    channel.report(Progress("preview", message="Approximating the first eigenfunctions"))

    def allocate(k: int, n: int) -> npt.NDArray[np.float32]:
        # straight into the file that the window maps
        make_room(path, 4 * k * n)
        return np.memmap(path, np.float32, "r+", shape=(k, n))

    n_pairs = mesh.n_components + _pairs(mesh)
    found = preview_eigenpairs(mesh, n_pairs, allocate=allocate, cancel=channel.cancelled)
    if len(found) <= mesh.n_components:
        del found  # some systems delete no file that is mapped
        discard(path)
        return False
    np.savez(notes, eigenvalues=found.eigenvalues, error=found.error)
    return True
