"""Family of distances from a vertex in feature space."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.sums import fill_in_parts, sum_squares
from meshmash_viewer.fields.bank_columns import FEATURES, BankFamily
from meshmash_viewer.fields.family import Answer, Cancel, Description, Family, Table
from meshmash_viewer.fields.parameter import Index, parameter
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, grew

#: Neglected share of the variance: the relative error of 2e-3 is half a step of colour.
_VARIANCE = 4e-6
#: Maximum deviation from the medians, root mean square over columns, in spreads.
_FAR = 3.0


@dataclass(frozen=True)
class Similarity(Family):
    """Distance in feature space."""

    name = "similarity"
    label = "Similar to a vertex"
    page = "similarity"
    short = "Similar"
    tip = "Distance in feature space from a pinned vertex"
    icon = (
        '<circle cx="12" cy="12" r="8.5"/><circle cx="12" cy="12" r="4.5"/><path d="M12 11.8v.4"/>'
    )
    required = "vertex"
    bright_low = True

    #: Vertex from which distances are measured.
    vertex: int | None = parameter(None, Index, vertex=True)
    #: Name of the family whose exported columns are the features.
    basis: str = parameter("hks", str, labels=FEATURES)
    #: Family of the features, set by `resolved`.
    features: BankFamily | None = None

    @property
    def definition(self) -> str:
        return "‖(F − F(pin)) / spread‖"

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        features = chosen[self.basis]
        assert isinstance(features, BankFamily)
        return replace(self, features=features.resolved(spectrum, chosen).at_rest())

    def for_other_mesh(self, n_components: int) -> Self:
        return replace(self, vertex=None)

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        """Describe the distance, which has no unit, since each column is divided by its spread."""
        quantity = (
            ""
            if self.vertex is None
            else f"from {spectrum.named_vertex(self.vertex)} · bright is alike"
        )
        return Description(quantity, f"Distance in {self._features().label.lower()}", power=0)

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        """Compute distances from the table; None without a table."""
        if table is None or self.vertex is None or not self.serves(spectrum, table):
            return None
        draft = not self.prepared(spectrum, table)
        return Answer(table.content.from_vertex(self.vertex), draft)

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        return table is not None and table.holds(self._features(), spectrum)

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        features = self._features()
        bank = features.bank(spectrum.eigenvalues)
        return Table(spectrum, features, build_similarity_table(spectrum, bank, cancel))

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        if table.family.name != self.basis:
            return False
        return self.prepared(spectrum, table) or grew(table.spectrum, spectrum)

    def script(self, spectrum: Eigenpairs) -> list[str]:
        assert self.vertex is not None, "only for a shown field"
        bank = self._features().bank_script()
        return [
            f"features = mv.compute_features(decomposition, {bank}, unit=mesh.unit)",
            f"values = mv.feature_distance(features, {spectrum.vertex_script(self.vertex)})",
        ]

    def _features(self) -> BankFamily:
        assert self.features is not None, "only for resolved families"
        return self.features


@dataclass(frozen=True, eq=False)
class SimilarityTable:
    """Features whose Euclidean distances are those of `shape.feature_distance`.

    `coordinates`, shape (r, n), are components along principal directions. `error` is the relative
    error of a typical distance: the root of the neglected share of the variance.
    """

    coordinates: npt.NDArray[np.float32]
    error: float

    def from_vertex(self, vertex: int) -> npt.NDArray[np.float32]:
        """Compute the distance of every vertex from one vertex, shape (n,), dimensionless."""
        here = self.coordinates[:, vertex]
        distances: npt.NDArray[np.float32] = self.squares[vertex] + self.squares

        def fill(part: slice) -> None:
            there = distances[part]
            there -= 2.0 * here @ self.coordinates[:, part]
            np.sqrt(np.maximum(there, 0.0, out=there), out=there)

        fill_in_parts(len(distances), fill)
        distances[vertex] *= 0.0  # removes rounding errors, keeps NaN
        return distances

    @cached_property
    def squares(self) -> npt.NDArray[np.float32]:
        """Squared length of the coordinates of every vertex, shape (n,)."""
        return np.asarray(np.einsum("ij,ij->j", self.coordinates, self.coordinates))


def build_similarity_table(
    spectrum: Eigenpairs,
    response: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]],
    cancel: Cancel = None,
) -> SimilarityTable:
    """Compute features, standardise them, and rotate them to their principal directions.

    `response` evaluates a filter bank, ``(k,) -> (f, k)``.
    """
    from meshmash_viewer.features.shape import column_spread  # loads SciPy

    sums = sum_squares(spectrum.rows, response(spectrum.eigenvalues), np.float64, cancel)
    features = np.asarray(sums, dtype=np.float64)
    used = np.isfinite(features[0])
    features -= np.median(features[:, used], axis=1, keepdims=True)
    features /= column_spread(features[:, used].T)[:, None]
    standard = features[:, used]
    # Small components of a neuron are thousands of times farther from the medians than the rest.
    # Their distance is limited, since they would determine the principal directions.
    far = _FAR * np.sqrt(len(standard))
    standard /= np.maximum(np.linalg.norm(standard, axis=0) / far, 1.0)
    variances, directions = np.linalg.eigh(standard @ standard.T)
    variances, directions = np.maximum(variances[::-1], 0.0), directions[:, ::-1]
    left_out = 1.0 - np.cumsum(variances) / max(float(variances.sum()), 1e-300)
    n_kept = min(int(np.count_nonzero(left_out > _VARIANCE)) + 1, len(variances))
    coordinates = np.asarray(directions[:, :n_kept].T @ features, dtype=np.float32)
    return SimilarityTable(coordinates, float(np.sqrt(max(left_out[n_kept - 1], 0.0))))
