"""Features computed on overlapping pieces of a mesh too large to be decomposed whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.features.sums import Features
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.fields.family import Family
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.export import written
from meshmash_viewer.model.open_mesh import MapGrew
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import TOLERANCE, Target, Translation, weyl_eigenvalue
from meshmash_viewer.split.piece_features import PieceFeatures
from meshmash_viewer.split.stitcher import MeshStitcher
from meshmash_viewer.split.stitching import seam_sentence
from meshmash_viewer.units import counted, format_quantity, format_share, power_unit
from meshmash_viewer.work import Channel, JobResult

#: Minimum number of vertices of a piece, and a number that is decomposed in seconds.
LEAST, _USUAL = 500, 20_000
#: Maximum ratio of overlap vertices to core vertices of a piece.
_WIDEST = 11
#: Largest median difference at seams that is accepted unless the user accepts any.
_ACCEPTED = 0.1


def usual_pieces(n_vertices: int) -> int:
    """Return a number of pieces, each decomposed in seconds; 2 or more if possible."""
    return max(math.ceil(n_vertices / _USUAL), min(2, n_vertices // LEAST), 1)


def in_pieces(family: Family, mesh: Mesh, target: Target) -> Family:
    """Return the family with parameters from Weyl's law instead of the spectrum of the mesh.

    `InputError` is raised if its columns depend on the spectrum itself.
    """
    expected = _expected(mesh, target)
    known = family.filled_in(expected, {})
    _common_bank(known, float(expected.eigenvalues[-1]))
    return known


def _expected(mesh: Mesh, target: Target) -> Eigenpairs:
    """Return three eigenvalues as `Eigenpairs`: 0, the first and the last, by Weyl's law."""
    top = _top(mesh, target)
    values = np.array([0.0, min(weyl_eigenvalue(mesh.area, 1), 0.5 * top), top])
    return Eigenpairs(values, np.empty((3, mesh.n_vertices)), np.zeros(3), mesh=mesh)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Work of a job that computes features in pieces and writes them.

    The job sends a `MapGrew` for each piece, with the column nearest to the displayed position (a
    time, for example).
    """

    mesh: Mesh
    path: Path
    #: A result of `in_pieces`.
    family: Family
    #: Approximate number of pieces, which are solved up to the `target` for the whole mesh.
    count: int
    target: Target
    operator: OperatorOptions
    repairs: Sequence[str] = ()
    #: The mesh before the repairs, to write the results at all its vertices.
    file_mesh: Mesh | None = None
    #: Whether to leave out the first eigenpair of the whole mesh.
    drop_first: bool = False
    n_jobs: int = -1
    #: Client of a Dask scheduler, see `MeshStitcher`.
    client: Any = None
    #: Whether features are written that differ at seams by more than a tenth in the median.
    accept_seams: bool = False

    def __call__(self, channel: Channel) -> JobResult:
        from joblib.externals.loky import reusable_executor

        shown, name = self._shown()

        def done(vertices: IntArray, values: FloatArray) -> None:
            channel.send(MapGrew(name, vertices, values[:, shown]))

        channel.report(Progress("splitting", message="Cutting the mesh into pieces"))
        try:
            report = self.write(channel.report, channel.cancelled, done=done)
        finally:
            # idle worker processes would keep their memory for minutes
            if (executor := reusable_executor._executor) is not None:
                executor.shutdown(wait=True, kill_workers=True)
        remarks = report["remarks"]
        text = ". ".join([described_seams(report), *(each.removesuffix(".") for each in remarks)])
        differs = max(report["seam_largest"], default=0.0) > TOLERANCE
        return written(self.path, self.family.label, text, warns=bool(remarks) or differs)

    def _shown(self) -> tuple[int, str]:
        """Return the index of the column to show as a map, and the name of the map."""
        expected = _expected(self.mesh, self.target)
        bank = _common_bank(self.family, float(expected.eigenvalues[-1]))
        places = self.family.places(expected)[: len(bank.columns)]
        column = int(np.argmin(np.abs(places - self.family.place(expected))))
        if bank.parameter_power != 2:
            return column, f"{self.family.short} {column}, in pieces"
        time = format_quantity(float(bank.parameters[column]), self.mesh.unit, 2)
        return column, f"{self.family.short}, t = {time}, in pieces"

    def write(
        self,
        progress: ProgressCallback | None,
        cancel: CancelCallback | None,
        done: Callable[[IntArray, FloatArray], None] = lambda vertices, values: None,
    ) -> dict[str, Any]:
        """Compute features on overlapping pieces, write them stitched, and return a report.

        `done` is called with the vertices and values of each piece. The report for JSON contains
        the relative differences at seams, and the columns whose median difference exceeds 1 %.
        `InputError` is raised if the columns depend on the spectrum of the whole mesh, there are
        too many pieces, or a difference is not accepted.
        """
        from meshmash_viewer.io.provenance import export_options
        from meshmash_viewer.io.write import write_features

        mesh, count = self.mesh, self.count
        n = mesh.n_vertices - len(mesh.unreferenced)
        if count > 1 and n / count < LEAST:
            fault = f"{count} pieces of {n:,} vertices would have fewer than {LEAST} each"
            raise InputError("too-many", fault, f"give at most {max(n // LEAST, 1)}")
        top = _top(mesh, self.target)
        bank = _common_bank(self.family, top)
        stitcher = MeshStitcher(mesh, n_jobs=self.n_jobs, client=self.client)
        _split(stitcher, bank, n, count)
        task = PieceFeatures(self.operator, top, bank, self.drop_first)
        whole = task.on(stitcher, done, progress=progress, cancel=cancel)
        values, truncation, seams, median = whole
        if not self.accept_seams and median.max(initial=0.0) > _ACCEPTED:
            remedy = "take fewer pieces, solve the whole, or accept the seams"
            raise InputError("seams-differ", seam_sentence(bank.columns, median, remedy))
        found = {
            "pieces": len(stitcher.pieces),
            "largest_piece": max(len(piece) for piece in stitcher.pieces),
            "seam_vertices": len(seams),
            "seam_largest": np.max(seams, axis=0, initial=0.0).tolist(),
            "seam_median": median.tolist(),
            "seam_flagged": [bank.columns[at] for at in np.flatnonzero(median > TOLERANCE)],
            "truncation": None if truncation is None else truncation.as_dict(),
            "drop_first": self.drop_first,
        }
        kind, file_mesh = self.family.export, self.file_mesh
        unit = power_unit(mesh.unit, -2)
        features = Features(values, bank.columns, unit, kind, found, truncation)
        features = features if file_mesh is None else features.on_file(mesh)
        proof, is_whole = "each piece complete", file_mesh is not None
        options = export_options(
            kind, self.operator, self.target, proof, self.repairs, whole_mesh=is_whole
        )
        write_features(self.path, features, file_mesh or mesh, meta={**options, **found})
        remedy = "take fewer pieces, or solve the whole"
        said = (seam_sentence(bank.columns, median, remedy), features.missing)
        return {
            "mesh": mesh.name,
            "output": str(self.path),
            "kind": kind,
            "n_vertices": len(features.values),
            "max_eigenvalue": top,
            **found,
            "columns": list(bank.columns),
            "n_features": len(bank.columns),
            "remarks": [f"{sentence}." for sentence in said if sentence],
        }


def _top(mesh: Mesh, target: Target) -> float:
    """Return the largest eigenvalue of a target, by Weyl's law."""
    n = mesh.n_vertices - len(mesh.unreferenced)
    return Translation(mesh.area, n_vertices=n).eigenvalue(target)[0]


def _split(stitcher: MeshStitcher, bank: FilterBank, n_vertices: int, count: int) -> None:
    """Split the mesh into about `count` pieces, with an overlap for the longest time."""
    if bank.parameter_power == 2:
        core = math.ceil(n_vertices / count)
        stitcher.split_mesh(
            core, t_max=float(np.max(bank.parameters)), max_overlap_neighbors=_WIDEST * core
        )
    else:
        # the maximum size of a piece includes its overlap
        stitcher.split_mesh(math.ceil(1.35 * n_vertices / count))


def described_seams(report: dict[str, Any]) -> str:
    """Describe the seams in a report of `Pieces.write`, as a sentence without a full stop."""
    worst, typical = (max(report[name], default=0.0) for name in ("seam_largest", "seam_median"))
    return (
        f"{counted(report['pieces'], 'piece')} of at most"
        f" {counted(report['largest_piece'], 'vertex')}; at {report['seam_vertices']:,} vertices"
        f" next to seams they differ by {format_share(worst, 2)} at most, by"
        f" {format_share(typical, 2)} in the median of the worst column"
    )


def _common_bank(family: Family, top: float) -> FilterBank:
    """Return the filters of a family; raise `InputError` if they depend on the spectrum."""
    assert isinstance(family, BankFamily), "checked before"
    one, other = (family.bank(top * np.array([0.0, share, 1.0]), bound=top) for share in (0.2, 0.5))
    if one.normalised or not np.array_equal(one.parameters, other.parameters):
        raise InputError(
            "depends-on-whole-mesh",
            f"Columns of {family.export} depend on the spectrum of the whole mesh",
            "give what they are taken from, as --t-min and --t-max of --kind hks, or choose --kind"
            " geometry-vectors",
        )
    return one
