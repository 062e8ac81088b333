"""Requests to match the vertices and eigenfunctions of two meshes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from meshmash_viewer.features.comparison import (
    Comparison,
    check_comparable,
    compare_shapes,
    corresponding_vertices,
    unit_area_spectrum,
)
from meshmash_viewer.fields import EXPORTS, FEATURES
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Features by which vertices can be matched: several columns and no required parameter.
MATCHED_IN: dict[str, type[BankFamily]] = {
    name: family
    for name, family in FEATURES.items()
    if family.export in EXPORTS and getattr(family(), family.counted) > 1
}


def as_shown(pairs: Eigenpairs) -> Eigenpairs:
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
        mine, other = as_shown(self.first), as_shown(self.second)
        vertices = corresponding_vertices(first, second)
        if vertices is not None:
            other = replace(other, rows=self.second.rows)  # `compare_shapes` aligns the rows
        bank = MATCHED_IN[self.matched_in].exported().bank(unit_area_spectrum(mine))
        return compare_shapes(
            mine, other, bank, cancel, vertices,
            refine=self.refined, landmarks=self.landmarks, meshes=(first, second),
        )  # fmt: skip
