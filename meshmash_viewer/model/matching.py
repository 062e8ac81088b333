"""Two meshes whose vertices and eigenfunctions are matched."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from psygnal import Signal

from meshmash_viewer.errors import InputError
from meshmash_viewer.features import MATCHED_COLUMNS, MATCHED_KIND
from meshmash_viewer.features.comparison import (
    Comparison,
    Correspondence,
    check_comparable,
    compare_shapes,
    corresponding_vertices,
    matched_top,
    unit_area_spectrum,
)
from meshmash_viewer.fields import EXPORTS, FEATURES
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.io.provenance import export_options
from meshmash_viewer.io.write import write_features
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target

#: Features by which vertices can be matched: several columns and no required parameter.
MATCHED_IN: dict[str, type[BankFamily]] = {
    name: family
    for name, family in FEATURES.items()
    if family.export in EXPORTS and getattr(family(), family.counted) > 1
}


def _as_shown(pairs: Eigenpairs) -> Eigenpairs:
    """Return the eigenpairs with the displayed signs."""
    rows = pairs.rows if pairs.alignment is None else pairs.shown_rows[: len(pairs)]
    return replace(pairs, rows=rows, alignment=None, mass=pairs.vertex_areas)


@dataclass(frozen=True)
class ComparisonRequest:
    """Eigenpairs of two meshes up to the same eigenvalue times area, and options of the match.

    `matched_in` is a key of `MATCHED_IN`; for `refined` and `landmarks` see `compare_shapes`.
    """

    first: Eigenpairs
    second: Eigenpairs
    matched_in: str
    refined: bool = False
    landmarks: tuple[tuple[int, int], ...] = ()

    def equals(self, other: ComparisonRequest) -> bool:
        """Return whether two requests have the same result."""
        same = replace(self, first=other.first, second=other.second)
        return same == other and self.same_pairs(other)

    def same_pairs(self, other: ComparisonRequest) -> bool:
        """Return whether two requests compare the same eigenpairs."""
        return self.first.rows is other.first.rows and self.second.rows is other.second.rows

    @property
    def meshes(self) -> tuple[Mesh, Mesh]:
        """The meshes of the eigenpairs."""
        assert self.first.mesh is not None
        assert self.second.mesh is not None
        return self.first.mesh, self.second.mesh

    def answered(self, cancel: CancelCallback | None = None) -> Comparison:
        """Compute the comparison; raise `InputError` if a mesh has too few eigenpairs."""
        first, second = self.meshes
        for mesh, spectrum in ((first, self.first), (second, self.second)):
            check_comparable(mesh.name, spectrum.n_vertices, spectrum.eigenvalues)
        mine, other = _as_shown(self.first), _as_shown(self.second)
        vertices = corresponding_vertices(first, second)
        if vertices is not None:
            other = replace(other, rows=self.second.rows)  # `compare_shapes` aligns the rows
        family = MATCHED_IN[self.matched_in].exported(MATCHED_COLUMNS)
        bank = family.bank(unit_area_spectrum(mine))
        return compare_shapes(
            mine, other, bank, cancel, vertices,
            refine=self.refined, landmarks=self.landmarks, meshes=(first, second),
            warn=False,
        )  # fmt: skip


class MatchedDocuments:
    """Two documents with a match of their vertices, whose landmarks are pins of both.

    Views connect to `changed`. `comparison_requested` is emitted with a `ComparisonRequest`; the
    receiver calls `accept` or `give_up`.
    """

    changed = Signal()
    comparison_requested = Signal(object)

    def __init__(self, first: Document, second: Document) -> None:
        self.first, self.second = first, second
        #: The last comparison; None until both meshes are decomposed and compared.
        self.comparison: Comparison | None = None
        #: Whether the second mesh shows the field of the first, transferred by the match.
        self.carries = False
        #: The feature by which vertices are matched, a key of `MATCHED_IN`, and whether they are
        #: matched by a functional map, refined by ZoomOut. To change them, use `match_by`.
        self.matched_in, self.refined = MATCHED_KIND, False
        self._request: ComparisonRequest | None = None
        #: The request whose result is `comparison`.
        self._answered: ComparisonRequest | None = None
        #: At the last solve of the second: eigenvectors of the first mesh, faces of the second.
        self._asked: tuple[Any, Any] = None, None

    def _apply_display(self, *, everything: bool = False) -> None:
        """Copy the display of the first mesh to the second."""
        raise NotImplementedError

    def match_by(self, feature: str | None = None, *, refined: bool | None = None) -> None:
        """Change the given options of the match, and request another comparison."""
        self.second.history.record("match", "match")
        self.matched_in = self.matched_in if feature is None else feature
        self.refined = self.refined if refined is None else refined
        self._follow_spectra()

    @property
    def match(self) -> dict[str, Any]:
        """Options of the match, as a session stores them."""
        return {
            "feature": self.matched_in,
            "refined": self.refined,
            "carried": self.carries,
        }

    @match.setter
    def match(self, stored: dict[str, Any]) -> None:
        if stored.get("feature") in MATCHED_IN:
            self.matched_in = stored["feature"]
        self.refined = stored.get("refined", False)
        self.carries = stored.get("carried", False)
        self._follow_spectra()

    @property
    def correspondence(self) -> Correspondence:
        """Correspondence of lengths; after a comparison also of vertices and eigenfunctions."""
        mine, other, known = self.first.solved, self.second.solved, self.comparison
        if mine is None or other is None or not mine.mesh.area > 0.0:
            return Correspondence()
        length = math.sqrt(other.mesh.area / mine.mesh.area)
        if known is None:
            return Correspondence(length)
        vertices = None if known.doubt else known.forth.indices
        return Correspondence(length, vertices, known.functions)

    @property
    def carried_from(self) -> Comparison | None:
        """The comparison if its match can be carried (`Comparison.doubt`), else None."""
        return None if self.comparison is None or self.comparison.doubt else self.comparison

    @property
    def comparing(self) -> bool:
        """Whether a comparison is being computed."""
        return self._request is not None and self._request is not self._answered

    def accept(self, request: ComparisonRequest, comparison: Comparison) -> None:
        """Store a comparison, if it is the result of the last request."""
        if request is self._request:
            self.comparison, self._answered = comparison, request
            spectrum = self.second.spectrum
            if comparison.given and spectrum is not None and spectrum.rows is request.second.rows:
                rotations = comparison.functions.rotations
                self.second.spectrum = replace(spectrum, alignment=rotations)
                self.second.spectrum_changed.emit()
            self._apply_display(everything=True)
            self.changed.emit()

    def give_up(self, request: ComparisonRequest) -> None:
        """Record that a comparison has failed."""
        if request is self._request:
            self._request = self.comparison = None
            self.changed.emit()

    def write_match(self, path: Path) -> None:
        """Write the match of each vertex of the first on the second (`Comparison.match_table`).

        May be called from any thread. `InputError` is raised if the meshes are not compared yet,
        or the file cannot be written.
        """
        found, request = self.comparison, self._answered
        if found is None or request is None:
            remedy = "wait until the meshes are compared"
            raise InputError("no-match", "There is no match to write", remedy)
        pairs, (first, second) = (request.first, request.second), request.meshes
        proofs = (
            each.proof(mesh.unit)
            for each, mesh in zip(pairs, (first, second), strict=True)
            if each.certificate.method != "none"
        )
        solve, repairs = self.first.solve, self.first.repairs
        options = export_options(
            "match",
            pairs[0].operator or solve.operator,
            solve.stated(pairs[0]),
            "; ".join(proofs),
            repairs,
        )
        if self.second.repairs:
            options["second_repairs"] = list(self.second.repairs)
        options["matched_in"] = MATCHED_IN[request.matched_in].export
        if request.refined:
            options["refined"] = {"landmarks": len(request.landmarks)}
        write_features(path, found.match_table(second.name, second), first, meta=options)

    def best_matches(self, vertex: int, count: int = 4) -> tuple[tuple[int, float], ...]:
        """Return the best matches of a vertex of the first mesh on the second, with their scores.

        The best match is first. Matches are at least 2 % of the mesh's diagonal apart.
        """
        mesh = self.second.mesh
        if self.comparison is None or mesh is None:
            return ()
        apart = 0.02 * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        return self.comparison.best_matches(vertex, mesh.vertices, apart, count)

    def _follow_job(self) -> None:
        if self.second.work.job is None:
            self._follow_spectra()

    def _follow_spectra(self) -> None:
        """Solve the second mesh as far as the first, then request a comparison of both."""
        self._decompose_second()
        first, second = self.first.spectrum, self.second.spectrum
        before, request = self._request, None
        if (
            first is not None
            and second is not None
            and first.complete
            and second.complete
            and self.second.work.job is None
        ):
            landmarks = self.landmarks if self.refined else ()
            request = ComparisonRequest(first, second, self.matched_in, self.refined, landmarks)
        if before is None or request is None or not before.equals(request):
            self._request = request
            known = self._answered
            if request is None or known is None or not known.same_pairs(request):
                self.comparison = None  # kept for the same pairs until the next result
            if request is not None:
                self.comparison_requested.emit(request)
        self._apply_display(everything=True)
        self.changed.emit()

    def _decompose_second(self) -> None:
        first, solved = self.first.spectrum, self.second.solved
        mesh = None if solved is None else solved.mesh
        busy = self.second.work.job is not None
        if first is None or not first.complete or mesh is None or busy:
            return
        if first.rows is self._asked[0] and mesh.faces is self._asked[1]:
            return  # requested before, and maybe cancelled by the user
        self._asked = first.rows, mesh.faces
        mine, solve = self.first.solve, self.second.solve
        top = matched_top(_as_shown(first), mesh.area)
        with self.second.history.paused():
            solve.operator = mine.operator
            solve.target = Target("max_eigenvalue", top) if top > 0.0 else mine.target
        if not solve.is_computed:
            solve.compute()

    # -- pins ---------------------------------------------------------------------------------

    @property
    def landmarks(self) -> tuple[tuple[int, int], ...]:
        """Vertex of the first and of the second mesh for each pin of the same number on both."""
        there = {pin.number: pin.vertex for pin in self.second.pins.placed}
        return tuple(
            (pin.vertex, there[pin.number]) for pin in self.first.pins.placed if pin.number in there
        )

    def _follow_pins(self) -> None:
        """Repeat a refined match with other landmarks, once a pin is no longer dragged."""
        if self.refined and not (self.first.pins.dragging or self.second.pins.dragging):
            self._follow_spectra()
        self.changed.emit()
