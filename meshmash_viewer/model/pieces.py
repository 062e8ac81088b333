"""Features of a mesh in overlapping pieces: for meshes too large to be solved whole."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.results import MapGrew, Written
from meshmash_viewer.model.transport import Channel
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback
from meshmash_viewer.spectral.weyl import Target, Translation, weyl_eigenvalue
from meshmash_viewer.units import counted

__all__ = ["LEAST", "PiecesJob", "described_seams", "in_pieces", "usual_pieces", "write_in_pieces"]

#: Fewest vertices that a piece is worth having, and how many are solved in seconds.
LEAST, _USUAL = 500, 20_000


def usual_pieces(n_vertices: int) -> int:
    """Number of pieces that are solved in seconds each; two at least, if that is worth it."""
    return max(math.ceil(n_vertices / _USUAL), min(2, n_vertices // LEAST), 1)


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
    repairs: Sequence[str] = (),
    file_mesh: Mesh | None = None,
    n_jobs: int | None = None,
    done: Callable[[npt.NDArray[np.int64], npt.NDArray[np.float64]], None] | None = None,
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
    repairs : sequence of str
        What has been done to the mesh.
    file_mesh : Mesh, optional
        The mesh before that, to write the results at all its vertices.
    n_jobs : int, optional
        Processes; None for one a core.
    done : callable, optional
        See `MeshStitcher.apply`.
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
    if count > 1 and n / count < LEAST:
        raise InputError(
            f"{count} pieces of {n:,} vertices would have fewer than {LEAST} each: give at most"
            f" {max(n // LEAST, 1)}."
        )
    top = Translation(mesh.area, n_vertices=n).eigenvalue(target)[0]
    bank = _common_bank(family, top)
    stitcher = MeshStitcher(mesh, n_jobs=-1 if n_jobs is None else n_jobs)
    # a piece holds its overlap, too
    stitcher.split_mesh(max_vertex_threshold=math.ceil(1.35 * n / count))
    task = _Task(operator, top, bank)
    results = stitcher.apply(task, stitch=False, done=done, progress=progress, cancel=cancel)
    seams = stitcher.seams(results)
    options = export_options(
        family.export,
        operator,
        target,
        "each piece complete",
        repairs,
        whole_mesh=file_mesh is not None,
    )
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
    features = features if file_mesh is None else features.on_file(mesh)
    write_features(path, features, file_mesh or mesh, meta={**options, **told})
    return {
        "mesh": mesh.name,
        "output": str(path),
        "kind": family.export,
        "n_vertices": len(features.values),
        "max_eigenvalue": top,
        **told,
        "columns": list(bank.columns),
        "n_features": len(bank.columns),
        "remarks": [],
        "seconds": round(time.perf_counter() - began, 3),
    }


def in_pieces(family: Family, mesh: Mesh, target: Target) -> Family:
    """The same with what it would take from the spectrum of the whole taken from Weyl's law.

    `InputError` is raised if its columns need that spectrum itself.
    """
    n = mesh.n_vertices - len(mesh.unreferenced)
    top = Translation(mesh.area, n_vertices=n).eigenvalue(target)[0]
    values = np.array([0.0, min(weyl_eigenvalue(mesh.area, 1), 0.5 * top), top])
    expected = Spectrum(values, np.empty((3, mesh.n_vertices)), np.zeros(3), mesh=mesh)
    known = family.filled_in(expected, {})
    _common_bank(known, top)
    return known


@dataclass(frozen=True, eq=False)
class PiecesJob:
    """Compute features in pieces and write them; sends a `MapGrew` for each, returns `Written`."""

    mesh: Mesh
    path: Path
    family: Family
    count: int
    target: Target
    operator: OperatorOptions
    repairs: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        return f"Computing {self.mesh.name or 'the mesh'} in pieces"

    def run(self, channel: Channel) -> Written:
        from joblib.externals.loky import reusable_executor

        middle = None

        def done(vertices: npt.NDArray[np.int64], values: npt.NDArray[np.float64]) -> None:
            nonlocal middle
            middle = values.shape[1] // 2 if middle is None else middle
            channel.send(MapGrew(self.name(middle), vertices, values[:, middle]))

        channel.report(Progress("splitting", message="Cutting the mesh into pieces"))
        try:
            report = write_in_pieces(
                self.mesh, self.path, self.family, self.count, self.target, self.operator,
                repairs=self.repairs, done=done, progress=channel.report, cancel=channel.cancelled,
            )  # fmt: skip
        finally:
            # those that worked on pieces would wait for more for minutes, with their memory
            if (executor := reusable_executor._executor) is not None:
                executor.shutdown(wait=True, kill_workers=True)
        return Written(self.path, self.family.label, described_seams(report), warns=False)

    def name(self, column: int) -> str:
        """What the map of a column is called."""
        return f"{self.family.short} {column}, in pieces"


def described_seams(report: dict[str, Any]) -> str:
    """What `write_in_pieces` found where pieces meet, as a sentence without its stop."""
    worst, typical = (max(report[name], default=0.0) for name in ("seam_largest", "seam_median"))
    return (
        f"{counted(report['pieces'], 'piece')} of at most"
        f" {counted(report['largest_piece'], 'vertex')}; at {report['seam_vertices']:,} vertices"
        f" beside seams they differ by {100 * worst:.2g} % at most, by {100 * typical:.2g} % in"
        " the median of the worst column"
    )


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
