"""The field on the render: what was asked for, and its values at every vertex."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Answer, Family, Table
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.model.limits import LimitPolicy, LockedLimits, automatic_limits
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.units import format_number, power_unit, round_length
from meshmash_viewer.vertex_map import Label

if TYPE_CHECKING:
    from meshmash_viewer.model.display import Display
    from meshmash_viewer.model.document import Document

__all__ = [
    "Field",
    "FieldRequest",
    "LiveFeatures",
    "compute_field",
    "expected_bytes",
    "request_of",
    "shown_family",
]


#: Columns of a usual heat table, and fields in use at one time: the one drawn, the one before
#: it, the one being computed, the one that may be asked for next.
_HEAT_COLUMNS, _FIELDS = 40, 4
#: Fewest lines at round values, but for rounding.
_LINES = 8


@dataclass(frozen=True)
class FieldRequest:
    """One field of one spectrum; equal requests give equal fields.

    Parameters
    ----------
    spectrum : Spectrum
        Compared by identity.
    unit : str
        Length unit of the mesh.
    family : Family
        Resolved, so that what does not matter makes no difference.
    sample : ndarray of int64, optional
        Vertices that limits are taken over; makes no difference to the values.
    places : ndarray of float64, shape (n, 3), optional
        Coordinates of the mesh, which tell one mesh from another with as many vertices.
    """

    spectrum: Spectrum
    unit: str
    family: Family
    sample: npt.NDArray[np.int64] | None = field(default=None, compare=False, repr=False)
    places: npt.NDArray[np.float64] | None = field(default=None, compare=False, repr=False)

    @property
    def quantity(self) -> str:
        """Which field of the family it is, with its unit."""
        return self.family.quantity(self.spectrum, self.unit)

    @property
    def caption(self) -> str:
        """What tells it from others of the family on a gallery."""
        return self.family.caption(self.spectrum, self.unit)

    def same_mesh(self, other: FieldRequest) -> bool:
        """Whether two requests are about one surface, be it in another unit."""
        return self.places is other.places


@dataclass(frozen=True, eq=False)
class Field:
    """Values at every vertex, with all that is said about them.

    Parameters
    ----------
    values : ndarray of float32, shape (n,)
        In `unit`; NaN where a vertex is on no face.
    request : FieldRequest
        What they answer.
    draft : bool
        Whether a better answer to the same request is on its way.
    beside : str or None
        Length unit of the first mesh, where these are values at its area (`at_size`).
    """

    values: npt.NDArray[np.float32] = field(repr=False)
    request: FieldRequest = field(repr=False)
    draft: bool = False
    beside: str | None = None
    _limits: dict[LimitPolicy, tuple[float, float]] = field(default_factory=dict, repr=False)

    def limits(self, policy: LimitPolicy | None) -> tuple[float, float]:
        """Limits of the colours under a policy, or that which suits the field; computed once."""
        if self.labels:  # each has a colour, with its value in the middle
            return -0.5, len(self.labels) - 0.5
        policy = policy or automatic_limits(signed=self.signed, tailed=self.family.tailed)
        known = self._limits.get(policy)
        if known is None:
            known = self._limits[policy] = policy.limits(self.values, self.request.sample)
        return known

    def colors(self, display: Display) -> tuple[tuple[float, float], str | tuple[str, ...]]:
        """Limits of its colours, and their map: a name, or the colours of its labels."""
        limits = self.limits(display.policies.get(self.family.name))
        if self.labels:
            return limits, tuple(label.color for label in self.labels)
        return limits, display.diverging_colormap if self.signed else display.sequential_colormap

    def carried(self, vertices: npt.NDArray[np.int64]) -> Field:
        """The same on another mesh, which has the values of these vertices; NaN for -1."""
        values = np.where(vertices >= 0, self.values[vertices], np.float32(np.nan))
        return replace(self, values=values)

    def at_size(self, length: float, unit: str) -> Field:
        """The same on this mesh shrunk by a factor, in the length unit of a first mesh beside it.

        Eigenfunctions are of unit norm, so that their values, and all that is summed of them, are
        larger on a smaller shape: at one size they can be compared. What is measured without
        eigenpairs, such as curvature, a map or a geodesic distance, stays as it is.
        """
        if not self.family.needs_pairs or (unit == self.request.unit and np.isclose(length, 1.0)):
            return self
        probe = self.family.unit("m")
        power = next((each for each in range(-9, 10) if power_unit("m", each) == probe), 0)
        scale = length**-power
        return replace(
            self,
            values=self.values * np.float32(scale),
            beside=unit,
            _limits={
                policy: (low * scale, high * scale)
                for policy, (low, high) in self._limits.items()
                if not isinstance(policy, LockedLimits)
            },
        )

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        """What values 0, 1, 2 … stand for, where they name parts of the surface."""
        return self.family.labels(self.request.spectrum, self.request.unit)

    @property
    def family(self) -> Family:
        """The family it belongs to, with its parameters."""
        return self.request.family

    @property
    def title(self) -> str:
        """What it is called: "Eigenfunction 5", "Heat kernel signature"."""
        return self.family.title()

    @property
    def quantity(self) -> str:
        """Which one, with its unit: "λ₅ = 1.2e-08 nm⁻²", "t = 3.1e+05 nm² (√t = 557 nm)"."""
        return self.request.quantity

    @property
    def unit(self) -> str:
        """Of the values; empty for pure numbers and for meshes without a unit."""
        return self.family.unit(self.request.unit if self.beside is None else self.beside)

    @cached_property
    def spacing(self) -> float:
        """A round number of `unit` by which lines are apart; 0 where none are at round values."""
        largest = float(np.max(self.values, initial=0.0, where=np.isfinite(self.values)))
        contoured = self.family.contoured and largest > 0.0
        return round_length(largest / _LINES) if contoured else 0.0

    @property
    def line_spacing(self) -> float | None:
        """Where lines can be drawn: at multiples of this, at zero alone (0), or nowhere (None)."""
        return self.spacing or (0.0 if self.signed else None)

    @property
    def spacing_told(self) -> str:
        """How far its lines are apart, "lines every 500 nm"; empty where that is not said."""
        if not self.spacing:
            return ""
        return f"lines every {format_number(self.spacing)} {self.unit}".rstrip()

    def told(self, lines: bool) -> str:
        """Its quantity, and how far lines are apart if they are drawn."""
        at = "" if self.beside is None else "values at the area of the first mesh"
        return " · ".join(filter(None, [self.quantity, self.spacing_told if lines else "", at]))

    @property
    def signed(self) -> bool:
        """Whether zero is in the middle of the values rather than at their end."""
        return self.family.signed


class LiveFeatures:
    """Answers requests; holds one table of each family that has been shown.

    A request is answered from a table where there is one, and by the direct sum where there is not;
    `prepare` builds the table that makes the next requests of its family cheap. Both may be called
    from different threads.
    """

    def __init__(self) -> None:
        # Each is replaced as a whole, so that no lock is needed to read it.
        self._tables: dict[str, Table] = {}

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that the tables hold, for whoever measures them."""
        contents = [table.content for table in self._tables.values()]
        parts = [
            part for each in contents for part in getattr(each, "__dict__", {"": each}).values()
        ]
        return sum(part.nbytes for part in parts if isinstance(part, np.ndarray))

    def table(self, name: str) -> Table | None:
        """The table of a family."""
        return self._tables.get(name)

    def forget(self) -> None:
        """Drop all tables, as when another mesh is opened."""
        self._tables = {}

    def compute(self, asked: FieldRequest) -> Answer | None:
        """Values of a field; None until `prepare` has been called, where there is no other way."""
        return asked.family.compute(asked.spectrum, self._tables.get(asked.family.name))

    def prepared(self, asked: FieldRequest) -> bool:
        """Whether `prepare` has nothing to do."""
        return asked.family.prepared(asked.spectrum, self._tables.get(asked.family.name))

    def prepare(self, asked: FieldRequest, cancel: CancelCallback | None = None) -> None:
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
        if table is not None and family.serves(spectrum, table):
            tables[family.name] = family.improve(spectrum, table, cancel)
            return
        tables.pop(family.name, None)  # before the new one takes room
        tables[family.name] = family.prepare(spectrum, cancel)


def expected_bytes(n_vertices: int, n_columns: int = 32) -> int:
    """Bytes that a window holds for fields and live features of a mesh.

    ``4 n (40 + columns + 32 / 2 + 4)``: heat table, a table of all columns of one feature,
    similarity table (a direction for every other column), fields. Eigenpairs are mapped from the
    store and are not counted.
    """
    columns = _HEAT_COLUMNS + n_columns + (max(n_columns, 32) + 1) // 2 + _FIELDS
    return 4 * n_vertices * columns


def shown_family(display: Display) -> Family:
    """The family that is chosen, or the first one where that still lacks what to show."""
    return display.family if display.family.usable else display.fields[next(iter(FAMILIES))]


def request_of(document: Document) -> FieldRequest | None:
    """Snapshot of what a document wants on its render; None while there is nothing to show."""
    spectrum, display, ready = document.known, document.display, document.ready
    if ready is None:
        return None
    assert spectrum is not None  # it comes with the mesh
    chosen = shown_family(display)
    if chosen.needs_pairs and not len(spectrum):
        return None
    return FieldRequest(
        spectrum,
        ready.mesh.unit,
        chosen.resolved(spectrum, display.fields),
        sample=ready.sample,
        places=ready.mesh.vertices,
    )


def compute_field(request: FieldRequest, live: LiveFeatures) -> Field | None:
    """The field that a request asks for; None if `live` has to be prepared first."""
    answer = live.compute(request)
    if answer is None:
        return None
    return Field(answer.values, request, answer.draft)
