"""Fields of the displayed spectrum at a cost that does not grow with the number of pairs.

A request is answered from a table where there is one, and by the direct sum where there is not;
`LiveFeatures.prepare` builds the table that makes the next requests of its family cheap. Both may
be called from different threads.
"""

from __future__ import annotations

from typing import Protocol

from meshmash_viewer.fields.family import Answer, Family, Table
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

__all__ = ["LiveFeatures", "expected_bytes"]

#: Columns of a usual heat table, and fields in use at one time: the one drawn, the one before
#: it, the one being computed, the one that may be asked for next.
_HEAT_COLUMNS, _FIELDS = 40, 4


def expected_bytes(n_vertices: int, n_columns: int = 32) -> int:
    """Bytes that a window holds for fields and live features of a mesh.

    ``4 n (40 + columns + 32 / 2 + 4)``: heat table, a table of all columns of one feature,
    similarity table (a direction for every other column), fields. Eigenpairs are mapped from the
    store and are not counted.
    """
    columns = _HEAT_COLUMNS + n_columns + (max(n_columns, 32) + 1) // 2 + _FIELDS
    return 4 * n_vertices * columns


class Asked(Protocol):
    """A field of a spectrum, as a `FieldRequest` is; the family is resolved."""

    @property
    def spectrum(self) -> Spectrum: ...
    @property
    def family(self) -> Family: ...


class LiveFeatures:
    """Answers requests; holds one table of each family that has been shown."""

    def __init__(self) -> None:
        # Each is replaced as a whole, so that no lock is needed to read it.
        self._tables: dict[str, Table] = {}

    @property
    def nbytes(self) -> int:
        """Bytes that the tables hold."""
        return sum(table.nbytes for table in self._tables.values())

    def table(self, name: str) -> Table | None:
        """The table of a family."""
        return self._tables.get(name)

    def forget(self) -> None:
        """Drop all tables, as when another mesh is opened."""
        self._tables = {}

    def compute(self, asked: Asked) -> Answer | None:
        """Values of a field; None until `prepare` has been called, where there is no other way."""
        return asked.family.compute(asked.spectrum, self._tables.get(asked.family.name))

    def prepared(self, asked: Asked) -> bool:
        """Whether `prepare` has nothing to do."""
        return asked.family.prepared(asked.spectrum, self._tables.get(asked.family.name))

    def prepare(self, asked: Asked, cancel: CancelCallback | None = None) -> None:
        """Build the table for fields like this one, unless it is there.

        Raises
        ------
        Cancelled
            If `cancel` said so; the table before it is kept or dropped, never half new.
        """
        family, spectrum = asked.family, asked.spectrum
        tables = self._tables  # of this mesh: forgotten ones get nothing new
        table = tables.get(family.name)
        if family.prepared(spectrum, table):
            return
        if table is not None and not family.serves(spectrum, table):
            del tables[family.name]  # before the new one takes room
        tables[family.name] = family.prepare(spectrum, cancel)
