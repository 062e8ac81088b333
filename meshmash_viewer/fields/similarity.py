"""How far every vertex is from one of them in the space of a feature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from meshmash_viewer.fields.family import Answer, Family, Table, parameter
from meshmash_viewer.fields.similarity_table import build_similarity_table
from meshmash_viewer.fields.spectrum import Spectrum, grew, same_pairs
from meshmash_viewer.progress import CancelCallback

__all__ = ["Similarity"]


@dataclass(frozen=True)
class Similarity(Family):
    """Distance in feature space.

    Parameters
    ----------
    vertex : int or None
        From which it is measured.
    basis : str
        Name of the family whose exported columns it is measured in.
    features : Family or None
        That family with its parameters, once resolved.
    """

    name: ClassVar[str] = "similarity"
    label: ClassVar[str] = "Similar to a vertex"
    short: ClassVar[str] = "Similar"
    tip: ClassVar[str] = "Distance in feature space from a pinned vertex"
    earlier: ClassVar[Mapping[str, str]] = {
        "similarity_vertex": "vertex",
        "similarity_basis": "basis",
    }

    vertex: int | None = parameter(type="vertex", least=0, most=2**31 - 1)
    basis: str = parameter("hks", type="family", earlier={"bands": "band"})
    features: Family | None = None

    @property
    def usable(self) -> bool:
        """See `Family.usable`."""
        return self.vertex is not None

    def resolved(self, spectrum: Spectrum, chosen: Mapping[str, Family]) -> Self:
        """See `Family.resolved`."""
        features = chosen[self.basis].resolved(spectrum, chosen).at_rest()
        return replace(self, features=features)

    def for_other_mesh(self, n_components: int) -> Self:
        """See `Family.for_other_mesh`."""
        return replace(self, vertex=None)

    def behind(self, chosen: Mapping[str, Family]) -> Family:
        """See `Family.behind`."""
        return chosen[self.basis]

    def title(self) -> str:
        """See `Family.title`."""
        return f"Distance in {self._features().label.lower()}"

    def quantity(self, spectrum: Spectrum, unit: str) -> str:
        """See `Family.quantity`."""
        return f"from vertex {self.vertex}"

    def unit(self, length: str) -> str:
        """A pure number: each column is in units of its spread."""
        return ""

    def compute(self, spectrum: Spectrum, table: Table | None) -> Answer | None:
        """None without a table: there is no quick way."""
        if table is None or self.vertex is None or not self.serves(spectrum, table):
            return None
        draft = not self.prepared(spectrum, table)
        if not draft:
            table.spectrum = spectrum  # next time it is the very same
        return Answer(table.content.from_vertex(self.vertex), draft)

    def prepared(self, spectrum: Spectrum, table: Table | None) -> bool:
        """See `Family.prepared`."""
        return (
            table is not None
            and table.family == self._features()
            and same_pairs(table.spectrum, spectrum)
        )

    def prepare(self, spectrum: Spectrum, cancel: CancelCallback | None) -> Table:
        """See `Family.prepare`."""
        features = self._features()
        bank = features.bank(spectrum.eigenvalues)
        return Table(spectrum, features, build_similarity_table(spectrum, bank, cancel))

    def serves(self, spectrum: Spectrum, table: Table) -> bool:
        """See `Family.serves`."""
        if table.family.name != self.basis:
            return False
        return self.prepared(spectrum, table) or grew(table.spectrum, spectrum)

    def script(self, spectrum: Spectrum) -> list[str]:
        """See `Family.script`."""
        bank = self._features().bank_script()
        return [
            f"features = mv.compute_features(decomposition, {bank}, unit=mesh.unit)",
            f"values = mv.feature_distance(features, {self.vertex})",
        ]

    def _features(self) -> Family:
        assert self.features is not None, "resolved ones have them"
        return self.features
