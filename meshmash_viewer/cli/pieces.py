"""Features of a mesh in pieces, from the command line: for meshes too large to be solved whole."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import Target, Translation

if TYPE_CHECKING:
    from meshmash_viewer.fields.family import Family
    from meshmash_viewer.progress import CancelCallback, ProgressCallback

__all__ = ["write_in_pieces"]

#: Fewest vertices that a piece is worth having.
_LEAST = 500


@dataclass(frozen=True)
class _Task:
    """What is done to a piece; it goes to other processes."""

    operator: OperatorOptions
    max_eigenvalue: float
    bank: FilterBank

    def __call__(self, piece: tuple[Any, Any]) -> npt.NDArray[np.float64]:
        from meshmash_viewer.features.sums import accumulate_features
        from meshmash_viewer.laplacian import cotangent_laplacian
        from meshmash_viewer.spectral.eigensolver import solve

        stiffness, mass = cotangent_laplacian(
            piece, self.operator.robust, self.operator.mollify_factor
        )
        pairs = solve(stiffness, mass, max_eigenvalue=self.max_eigenvalue)
        if not pairs.complete:
            raise ArithmeticError(pairs.proof())
        return accumulate_features(pairs.rows, self.bank(pairs.eigenvalues))


def write_in_pieces(
    mesh: Mesh,
    path: Path,
    family: Family,
    count: int,
    target: Target,
    operator: OperatorOptions,
    *,
    n_jobs: int | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> dict[str, Any]:
    """Compute features on overlapping pieces, and write them as of the whole.

    Parameters
    ----------
    mesh : Mesh
    path : Path
        Its ending says the format.
    family : Family
        With all that would otherwise be taken from the spectrum of the whole.
    count : int
        About how many pieces.
    target : Target
        How far up its spectrum the whole is asked for; the pieces go as far.
    operator : OperatorOptions
    n_jobs : int, optional
        Processes; None for one a core.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`; called between pieces.

    Returns
    -------
    dict
        JSON-able report, with the differences at the seams relative to the values there.

    Raises
    ------
    InputError
        If the columns depend on the spectrum of the whole, or there are too many pieces.
    """
    from meshmash_viewer.features.sums import Features
    from meshmash_viewer.io.provenance import export_options
    from meshmash_viewer.io.write import write_features
    from meshmash_viewer.split.stitcher import MeshStitcher
    from meshmash_viewer.units import power_unit

    began = time.perf_counter()
    n = mesh.n_vertices - len(mesh.unreferenced)
    if count > 1 and n / count < _LEAST:
        raise InputError(
            f"{count} pieces of {n:,} vertices would have fewer than {_LEAST} each: give at most"
            f" {max(n // _LEAST, 1)}."
        )
    top = Translation(mesh.area, n_vertices=n).eigenvalue(target)[0]
    bank = _common_bank(family, top)
    stitcher = MeshStitcher(mesh, n_jobs=-1 if n_jobs is None else n_jobs)
    # a piece holds its overlap, too
    stitcher.split_mesh(max_vertex_threshold=math.ceil(1.35 * n / count))
    results = stitcher.apply(
        _Task(operator, top, bank), stitch=False, progress=progress, cancel=cancel
    )
    seams = stitcher.seams(results)
    options = export_options(family.export, operator, target, "each piece complete")
    told = {
        "pieces": len(stitcher.pieces),
        "largest_piece": max(len(piece) for piece in stitcher.pieces),
        "seam_vertices": len(seams),
        "seam_largest": _columns(np.max(seams, axis=0, initial=0.0)),
        "seam_median": _columns(np.median(seams, axis=0) if len(seams) else seams.sum(axis=0)),
    }
    features = Features(
        stitcher.stitched(results), bank.columns, power_unit(mesh.unit, -2), family.export
    )
    write_features(path, features, mesh, meta={**options, **told})
    return {
        "mesh": mesh.name,
        "output": str(path),
        "kind": family.export,
        "n_vertices": mesh.n_vertices,
        "max_eigenvalue": top,
        **told,
        "columns": list(bank.columns),
        "n_features": len(bank.columns),
        "remarks": [],
        "seconds": round(time.perf_counter() - began, 3),
    }


def _columns(values: npt.NDArray[np.float64]) -> list[float]:
    return [float(value) for value in values]


def _common_bank(family: Family, top: float) -> FilterBank:
    """The filters that are the same for all pieces, whatever the spectrum of each."""
    one, other = (family.bank(top * np.array([0.0, share, 1.0]), bound=top) for share in (0.2, 0.5))
    if one.normalised or not np.array_equal(one.parameters, other.parameters):
        raise InputError(
            f"Columns of {family.export} depend on the spectrum of the whole mesh, which pieces do"
            " not have: give what they are taken from, as --t-min and --t-max of --kind hks, or"
            " choose --kind geometry-vectors."
        )
    return one
