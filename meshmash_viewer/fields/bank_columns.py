"""Base class of families whose fields are the columns of the exported feature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from meshmash_viewer.features.sums import sum_squares
from meshmash_viewer.fields.family import Answer, Family, Profile, Samples, Table
from meshmash_viewer.fields.parameter import Whole, parameter
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero

__all__ = ["MOST_COLUMNS", "BankColumns"]

#: Maximum number of columns.
MOST_COLUMNS = 512


@dataclass(frozen=True)
class BankColumns(Family):
    """One column of a filter bank; the table contains all columns.

    Parameters
    ----------
    index : int
        Index of the column, from 0.
    count : int
        Number of columns.
    """

    counted: ClassVar[str] = "count"
    interval: ClassVar[int] = 250

    index: int = parameter(0, Whole(0, MOST_COLUMNS - 1))
    count: int = parameter(32, Whole(1, MOST_COLUMNS))

    @property
    def column(self) -> int:
        """`index`, limited to the last column."""
        return min(max(self.index, 0), self.count - 1)

    @property
    def table_columns(self) -> int:
        return self.count

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        return self.within(spectrum)

    def within(self, spectrum: Eigenpairs) -> Self:
        return replace(self, index=self.column)

    def step(self, spectrum: Eigenpairs, steps: int) -> Self:
        return replace(self, index=min(max(self.index + steps, 0), self.count - 1))

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer:
        if self.prepared(spectrum, table):
            assert table is not None
            table.spectrum = spectrum  # faster comparison next time
            return Answer(table.content[self.column])
        weights = self.bank(spectrum.eigenvalues)(spectrum.eigenvalues)
        one = weights[self.column : self.column + 1]
        return Answer(np.asarray(sum_squares(spectrum.rows, one)[0]))

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        return table is not None and table.holds(self.at_rest(), spectrum)

    def prepare(self, spectrum: Eigenpairs, cancel: CancelCallback | None) -> Table:
        weights = self.bank(spectrum.eigenvalues)(spectrum.eigenvalues)
        columns = sum_squares(spectrum.rows, weights, cancel=cancel)
        return Table(spectrum, self.at_rest(), np.asarray(columns))

    def profile(self, spectrum: Eigenpairs) -> Profile | None:
        if first_nonzero(spectrum) >= len(spectrum):
            return None
        bank = self.bank(spectrum.eigenvalues)
        both = Samples(self.places(spectrum), bank(spectrum.eigenvalues))
        return Profile(both, both)

    def places(self, spectrum: Eigenpairs) -> np.ndarray:
        """Return positions of the columns on the bottom axis of a profile, shape (count,)."""
        return np.arange(self.count, dtype=np.float64)

    def place(self, spectrum: Eigenpairs) -> float:
        return float(self.places(spectrum)[self.column])

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        return replace(self, index=int(np.argmin(np.abs(self.places(spectrum) - place))))

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [
            f"features = mv.compute_features(decomposition, {self.bank_script()}, unit=mesh.unit)",
            f"values = features.values[:, {self.column}]",
        ]
