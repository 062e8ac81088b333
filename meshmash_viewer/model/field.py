"""The displayed field: its request, its values at every vertex, and steps of its position."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Answer, Description, Family, Table
from meshmash_viewer.fields.table import FAR
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.limits import (
    LimitPolicy,
    Limits,
    LockedLimits,
    automatic_limits,
    beyond_limits,
    extremes_of,
    logarithmic_limits,
    spans_decades,
)
from meshmash_viewer.model.pins import pin_at
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted, engineering, format_quantity, plain_text, round_length
from meshmash_viewer.vertex_map import Label, VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.model.display import Display

#: Columns of a typical heat table; fields in memory: drawn, previous, computed and requested.
_HEAT_COLUMNS, _FIELDS = 40, 4
#: Approximate number of contour lines, before their spacing is rounded.
_LINES = 8


@dataclass(frozen=True)
class FieldRequest:
    """Request for a field of a spectrum; equal requests have equal fields."""

    #: Eigenpairs, compared by identity.
    spectrum: Eigenpairs
    unit: str
    #: A result of `Family.resolved`, so that parameters without effect are equal.
    family: Family
    #: Vertices from which limits are computed; not compared.
    sample: npt.NDArray[np.int64] | None = field(default=None, compare=False, repr=False)
    #: Mask of hidden vertices, which do not influence limits, shape (n,); not compared.
    hidden: npt.NDArray[np.bool_] | None = field(default=None, compare=False, repr=False)
    #: Identity of `hidden`, compared in place of the array; 0 for None.
    hides: int = 0
    #: Name of the pin at the source vertex of the field; "" for none.
    pin: str = ""

    @property
    def description(self) -> Description:
        """Texts of the field; some are more detailed once the field is computed."""
        texts = self.family.describe(self.spectrum, self.unit)
        vertex = _vertex(self.family)
        if not self.pin or vertex is None:
            return texts
        quantity = texts.quantity.replace(self.spectrum.named_vertex(vertex), self.pin, 1)
        return replace(texts, quantity=quantity)

    @property
    def caption(self) -> str:
        """Caption that distinguishes the field from other fields of its family in a gallery."""
        return self.description.caption or self.description.quantity

    def same_mesh(self, other: FieldRequest) -> bool:
        """Return whether two requests have the same coordinates; units may differ."""
        mine, their = self.spectrum.mesh, other.spectrum.mesh
        return getattr(mine, "vertices", None) is getattr(their, "vertices", None)


@dataclass(frozen=True, eq=False)
class Field:
    """Values at every vertex, with their description."""

    #: Values in `unit`, shape (n,); NaN at vertices without a face.
    values: npt.NDArray[np.float32] = field(repr=False)
    request: FieldRequest = field(repr=False)
    #: Whether more accurate values for the same request will follow.
    draft: bool = False
    #: Length unit of the first mesh, if values are scaled to its area (`at_size`).
    first_unit: str | None = None
    _limits: dict[LimitPolicy | None, tuple[float, float]] = field(default_factory=dict, repr=False)

    def limits(self, policy: LimitPolicy | None) -> tuple[float, float]:
        """Return the colour limits under a policy, by default `automatic_limits`; cached."""
        if self.labels:  # the values 0, 1, 2 … are the centres of the colours
            return -0.5, len(self.labels) - 0.5
        if policy not in self._limits:
            self._limits[policy] = self._find_limits(policy)
        return self._limits[policy]

    def _find_limits(self, policy: LimitPolicy | None) -> tuple[float, float]:
        sample = self.request.sample
        if policy is not None:
            return policy.limits(self._visible(self.values), sample)
        values, signed = self._basis
        automatic = automatic_limits(signed=signed, tailed=self.family.tailed)
        given = self.family.given_limits
        low, high = given[:2] if given is not None else automatic.limits(values, sample)
        if self.signed and not signed:  # differences from a mean, as wide as the values
            return -0.5 * (high - low), 0.5 * (high - low)
        return low, high

    @cached_property
    def _basis(self) -> tuple[npt.NDArray[np.float32], bool]:
        """Values from which automatic limits are computed, and whether they are signed."""
        shared = self.family.limits_of(self.request.spectrum)
        values, signed = (self.values, self.signed) if shared is None else shared
        return self._visible(values), signed

    @cached_property
    def spans_decades(self) -> bool:
        """Whether colours follow the logarithm of the values by default."""
        if not self.has_log_scale:
            return False
        if self.family.given_limits is not None:
            return self.family.given_limits[2]
        return spans_decades(self.limits(None), self._basis[0])

    @property
    def has_log_scale(self) -> bool:
        """Whether colours can follow the logarithm of the values."""
        return not (self.signed or self.labels)

    def scaled(self, ends: tuple[float, float], logarithmic: bool | None) -> Limits:
        """Return limits on a linear or logarithmic scale; for None, `spans_decades` decides."""
        wanted = self.spans_decades if logarithmic is None else logarithmic
        if not (wanted and self.has_log_scale):
            return Limits(*ends)
        return logarithmic_limits(ends, self._basis[0], self.request.sample)

    @cached_property
    def _extremes(self) -> tuple[float, float]:
        return extremes_of(self._visible(self.values))

    def _visible(self, values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return values with NaN at hidden vertices."""
        hidden = self.request.hidden
        return values if hidden is None else np.where(hidden, np.float32(np.nan), values)

    def beyond(self, limits: Limits) -> tuple[bool, bool]:
        """Return whether values lie below the lower limit, and whether above the upper limit."""
        return beyond_limits(limits, self._extremes)

    def colors(self, display: Display) -> tuple[Limits, str | tuple[str, ...]]:
        """Return the colour limits, and the name of the colour map or the colours of labels."""
        key = self.family.limits_key
        limits = self.scaled(self.limits(display.policies.get(key)), display.log_scales.get(key))
        if self.labels:
            return limits, tuple(label.color for label in self.labels)
        named = display.diverging_colormap if self.signed else display.sequential_colormap
        reverse = self.family.bright_low and not self.signed
        return limits, reversed_map(named) if reverse else named

    def as_map(self) -> VertexMap:
        """Return the values as a map of the mesh, with the name that the render shows.

        The name has the number of eigenpairs if values depend on it.
        """
        is_map = self.family.own and not self.family.of_pairs
        quantity = self.quantity.partition(": ")[0]  # without a share after the colon
        name = self.title if is_map else plain_text(f"{self.title} {quantity}")
        if self.family.needs_pairs and not self.family.of_one_pair:
            name += f", {counted(len(self.request.spectrum), 'pair')}"
        if not self.labels:
            return VertexMap(name, self.values, unit=self.unit)
        labels = tuple(replace(each, key=at) for at, each in enumerate(self.labels))
        keys = np.nan_to_num(self.values, nan=-1.0).astype(np.int64)
        return VertexMap(name, keys, labels)

    def carried(self, vertices: npt.NDArray[np.int64]) -> Field:
        """Return the field on another mesh: the values at `vertices` of this mesh, NaN for -1."""
        values = np.where(vertices >= 0, self.values[vertices], np.float32(np.nan))
        return replace(self, values=values, _limits=dict(self._limits))

    def at_size(self, length: float, unit: str) -> Field:
        """Return the field as on this mesh divided by `length`, in the unit of the first mesh.

        Eigenfunctions have unit norm, so values and their sums are larger on a smaller shape.
        Fields without eigenpairs (curvatures, maps, geodesic distances) are not scaled.
        """
        if not self.family.needs_pairs or (unit == self.request.unit and np.isclose(length, 1.0)):
            return self
        scale = length**-self.texts.power
        return replace(
            self,
            values=self.values * np.float32(scale),
            first_unit=unit,
            _limits={
                policy: (low * scale, high * scale)
                for policy, (low, high) in self._limits.items()
                if not isinstance(policy, LockedLimits)
            },
        )

    @cached_property
    def texts(self) -> Description:
        """Texts of the field."""
        return self.request.description

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the values 0, 1, 2 …; empty for a field of numbers."""
        return self.texts.labels

    @property
    def family(self) -> Family:
        """The family of the field, with its parameters."""
        return self.request.family

    @property
    def title(self) -> str:
        """Title of the field: "Eigenfunction 5", "Heat kernel signature"."""
        return self.texts.title

    @property
    def quantity(self) -> str:
        """Position with its unit: "λ₅ = 0.012 µm⁻²", "t = 0.31 µm² (√t = 557 nm)"."""
        return self.texts.quantity

    @property
    def unit(self) -> str:
        """Unit of the values; empty for pure numbers and for meshes without a unit."""
        return self.texts.unit(self.request.unit if self.first_unit is None else self.first_unit)

    @cached_property
    def spacing(self) -> float:
        """Rounded spacing of contour lines in `unit`; 0 if the field has none."""
        largest = extremes_of(self.values)[1] if self.family.contoured else 0.0
        return round_length(largest / _LINES) if largest > 0.0 else 0.0

    @property
    def line_spacing(self) -> float | None:
        """Spacing of the lines that can be drawn; 0 for one line at zero, None for no lines."""
        return self.spacing or (0.0 if self.signed else None)

    def value_text(self, vertex: int, digits: int = 5) -> str:
        """Format the value at a vertex with its unit, or return the name of its label."""
        value = float(self.values[vertex])
        if not math.isfinite(value):
            return "no value"
        if self.labels:
            return self.labels[int(value)].name
        return format_quantity(value, self.unit, 1, digits, like=self.size)

    @cached_property
    def size(self) -> float:
        """Largest magnitude of the values; it determines the prefix of the unit in texts."""
        return max(map(abs, self._extremes))

    @property
    def written_unit(self) -> str:
        """The unit that `value_text` writes."""
        return engineering(self.size, self.unit)[1]

    def description(self, lines: bool) -> str:
        """Describe the field: its quantity, and "lines every 500 nm" if contours are drawn."""
        spaced = lines and self.spacing
        lined = f"lines every {format_quantity(self.spacing, self.unit)}" if spaced else ""
        at = "" if self.first_unit is None else "values at the area of the first mesh"
        return " · ".join(filter(None, [self.quantity, lined, at]))

    @property
    def signed(self) -> bool:
        """Whether the field has positive and negative values."""
        return self.family.signed


def reversed_map(name: str) -> str:
    """Return the name of the reversed colour map of matplotlib."""
    return name.removesuffix("_r") if name.endswith("_r") else f"{name}_r"


class LiveFeatures:
    """Computation of fields, with one precomputed table per family that has been shown.

    `compute` uses the table of the family if it exists, else the direct sum; `prepare` builds the
    table for fast later requests of its family. The methods may run in different threads.
    """

    def __init__(self) -> None:
        #: Tables by family, replaced as a whole, so that reading one needs no lock.
        self.tables: dict[str, Table] = {}

    def forget(self) -> None:
        """Drop all tables, as when another mesh is opened."""
        self.tables = {}

    def compute(self, asked: FieldRequest) -> Answer | None:
        """Return the values of a field; None if they need a table that is not built yet."""
        return asked.family.compute(asked.spectrum, self.tables.get(asked.family.name))

    def prepared(self, asked: FieldRequest) -> bool:
        """Return whether the table for a request exists or none is needed."""
        return asked.family.prepared(asked.spectrum, self.tables.get(asked.family.name))

    def prepare(self, asked: FieldRequest, cancel: CancelCallback | None = None) -> None:
        """Build the table for the family of a request, unless the table exists.

        `Cancelled` is raised if `cancel` returned True; the table is then unchanged or missing,
        never incomplete.
        """
        family, spectrum = asked.family, asked.spectrum
        tables = self.tables  # `forget` replaces the dictionary for another mesh
        table = tables.get(family.name)
        if family.prepared(spectrum, table):
            return
        if table is not None and not family.serves(spectrum, table):
            table = None
            del tables[family.name]  # frees its memory before the new one is built
        tables[family.name] = family.prepare(spectrum, cancel, table)


def expected_bytes(n_vertices: int, n_columns: int = 32) -> int:
    """Estimate the memory of fields and live features of a mesh in bytes.

    ``4 n (40 + columns + max(columns, 32) / 2 + 4)``: heat table, a table of all columns of one
    feature, similarity table (one direction for two columns), fields. Eigenpairs are memory-mapped
    from the store and not counted.
    """
    columns = _HEAT_COLUMNS + n_columns + (max(n_columns, 32) + 1) // 2 + _FIELDS
    return 4 * n_vertices * columns


def shown_family(display: Display) -> Family:
    """Return the chosen family, or the first family if the chosen one is not usable yet."""
    return display.family if display.family.usable else display.fields[next(iter(FAMILIES))]


def request_of(document: Document) -> FieldRequest | None:
    """Return the request for the displayed field; None if there is nothing to show."""
    spectrum, display, ready = document.known, document.display, document.ready
    if ready is None:
        return None
    assert spectrum is not None and spectrum.mesh is not None  # noqa: PT018  set with the mesh
    chosen = shown_family(display)
    if chosen.needs_pairs and not len(spectrum):
        return None
    pin = pin_at(document.pins.placed, _vertex(chosen))
    return FieldRequest(
        spectrum,
        ready.mesh.unit,
        chosen.resolved(spectrum, display.fields),
        sample=ready.sample,
        hidden=document.hidden,
        hides=0 if document.hidden is None else id(document.hidden),
        pin="" if pin is None else pin.name,
    )


def _vertex(family: Family) -> int | None:
    """Return the source vertex of the field of a family, or None."""
    names = (name for name, each in family.declared().items() if each.vertex and not each.many)
    vertex: int | None = getattr(family, next(names, ""), None)
    return vertex


def compute_field(request: FieldRequest, live: LiveFeatures) -> Field | None:
    """Return the field of a request; None if `live.prepare` has to be called first."""
    answer = live.compute(request)
    return None if answer is None else Field(answer.values, request, answer.draft)


def step(document: Document, steps: int) -> bool:
    """Move the position by a number of steps within its range; `FAR` steps reach an end.

    Return whether the position has changed.
    """
    spectrum, display = document.known, document.display
    if spectrum is None or (display.family.needs_pairs and not len(spectrum)):
        return False
    moved = display.family.step(spectrum, steps)
    if moved == display.family:
        return False
    display.put(moved)
    return True


def advance(document: Document) -> None:
    """Move one step forward, or from the end to the start."""
    if not step(document, 1):
        step(document, -FAR)
