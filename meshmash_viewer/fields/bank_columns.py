"""Base classes of families that export columns: `BankFamily`, `Columns` and `BankColumns`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from msgspec import Meta

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.features.sums import Features, sum_squares, truncated_features
from meshmash_viewer.fields.family import (
    Answer,
    Cancel,
    ColumnArray,
    Description,
    Family,
    Profile,
    Reading,
    Samples,
    Table,
)
from meshmash_viewer.fields.parameter import parameter
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.spectral.weyl import Target, Translation
from meshmash_viewer.units import counted

if TYPE_CHECKING:
    from meshmash_viewer.mesh import Mesh

#: Maximum number of columns.
MOST_COLUMNS = 512
ColumnCount = Annotated[int, Meta(ge=1, le=MOST_COLUMNS)]


def estimated_pairs(spectrum: Eigenpairs, eigenvalue: float) -> str:
    """Return the number of eigenpairs up to an eigenvalue as text; "about" marks an estimate."""
    if spectrum.mesh is None:
        return "more pairs"
    translation = Translation(
        spectrum.mesh.area, spectrum.eigenvalues, spectrum.n_vertices, known_to=spectrum.known_to
    )
    count, exact = translation.count(Target("max_eigenvalue", eigenvalue))
    if count >= translation.n_vertices:
        return f"all {counted(count, 'pair')} that the mesh has"
    return f"{'' if exact else 'about '}{counted(count, 'pair')} in all"


@dataclass(frozen=True)
class BankFamily(Family):
    """Family whose exported columns are computed from eigenpairs by a filter bank."""

    @property
    def definition(self) -> str:
        return "Σ h(λ) φ²"

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        """Return the filters of the exported columns, for eigenvalues of shape (k,).

        If all eigenvalues are zero, `area` determines the range. `bound` is the requested maximum
        eigenvalue, if any. `InputError` is raised if the range cannot be determined.
        """
        raise NotImplementedError

    def bank_script(self) -> str:
        """Return the Python expression of the bank."""
        raise NotImplementedError

    def contents(self, spectrum: Eigenpairs, unit: str) -> str:
        """Return a sentence on the parameter range of the columns."""
        return ""

    def compute_features(
        self, pairs: Eigenpairs | None, mesh: Mesh, bound: float | None = None, **summed: Any
    ) -> Features:
        assert pairs is not None
        bank = self.bank(pairs.eigenvalues, mesh.area, bound)
        return truncated_features(pairs, bank, unit=mesh.unit, **summed)

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        return self.bank(spectrum.eigenvalues).columns, self.contents(spectrum, unit)

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [
            f"features = mv.compute_features(decomposition, {self.bank_script()}, unit=mesh.unit)"
        ]


#: Subclasses of `BankFamily` by name, filled in by `meshmash_viewer.fields.table`.
FEATURES: dict[str, type[BankFamily]] = {}


@dataclass(frozen=True)
class Columns(Family):
    """One column of an exported feature; its table contains all columns, computed together."""

    counted = "count"
    position = ("index",)
    interval = 250

    #: Index of the column, from 0.
    index: int = parameter(0, Annotated[int, Meta(ge=0, lt=MOST_COLUMNS)])
    #: Number of columns.
    count: int = parameter(32, ColumnCount)

    @property
    def column(self) -> int:
        """`index`, limited to existing columns."""
        return min(max(self.index, 0), self.count - 1)

    def columns(self, spectrum: Eigenpairs, cancel: Cancel = None) -> ColumnArray:
        """Compute all columns, shape (count, n)."""
        raise NotImplementedError

    def quantity(self, spectrum: Eigenpairs, unit: str) -> str:
        """Describe the column, with units."""
        return f"{self.nouns[0].lower()} {self.column}"

    def title(self) -> str:
        """Return the title of the column on the render."""
        return self.label

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        return self.within(spectrum)

    def within(self, spectrum: Eigenpairs) -> Self:
        return replace(self, index=self.column)

    def step(self, spectrum: Eigenpairs, steps: int) -> Self:
        return replace(self, index=min(max(self.index + steps, 0), self.count - 1))

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        """Return positions of the columns on the bottom axis of a profile, shape (count,)."""
        return np.arange(self.count, dtype=np.float64)

    def place(self, spectrum: Eigenpairs) -> float:
        return float(self.places(spectrum)[self.column])

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        return replace(self, index=int(np.argmin(np.abs(self.places(spectrum) - place))))

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        return Description(self.quantity(spectrum, unit), self.title())

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        facts = (self.describe(spectrum, unit).quantity,)
        return Reading(f"{self.nouns[0]} {self.column}", facts)

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        if not self.prepared(spectrum, table):
            return Answer(self.columns(spectrum)[self.column])
        assert table is not None
        return Answer(table.content[self.column])

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        return table is not None and table.holds(self.at_rest(), spectrum)

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        return Table(spectrum, self.at_rest(), self.columns(spectrum, cancel))


@dataclass(frozen=True)
class BankColumns(Columns, BankFamily):
    """One column computed by a filter bank."""

    def axes(self, unit: str) -> tuple[str, str]:
        """Return the labels of the axes of the profile, bottom and left."""
        raise NotImplementedError

    def columns(self, spectrum: Eigenpairs, cancel: Cancel = None) -> ColumnArray:
        weights = self.bank(spectrum.eigenvalues)(spectrum.eigenvalues)
        return np.asarray(sum_squares(spectrum.rows, weights, cancel=cancel))

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        if self.prepared(spectrum, table):
            return super().compute(spectrum, table)
        weights = self.bank(spectrum.eigenvalues)(spectrum.eigenvalues)
        one = weights[self.column : self.column + 1]
        return Answer(np.asarray(sum_squares(spectrum.rows, one)[0]))

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        if first_nonzero(spectrum) >= len(spectrum):
            return None
        bank = self.bank(spectrum.eigenvalues)
        both = Samples(self.places(spectrum), bank(spectrum.eigenvalues))
        return Profile(both, both, self.axes(unit))

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [*super().script(spectrum), f"values = features.values[:, {self.column}]"]
