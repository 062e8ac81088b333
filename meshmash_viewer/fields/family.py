"""Base class of families of fields: parameters, values, plots and files.

A family is a frozen dataclass in its own module, listed in `meshmash_viewer.fields.FAMILIES`. Its
parameters are declared as in `meshmash_viewer.fields.parameter`; an instance consists of a value
for each. `Family.resolved` sets parameters that are None from a spectrum, and resets parameters
that do not affect the field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.sums import Features
from meshmash_viewer.fields.parameter import Parameters
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, same_pairs
from meshmash_viewer.units import power_unit
from meshmash_viewer.vertex_map import Label

if TYPE_CHECKING:
    from meshmash_viewer.features.comparison import Correspondence
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.weyl import Target

ColumnArray: TypeAlias = npt.NDArray[np.float32]
Cancel: TypeAlias = CancelCallback | None

#: Maximum number of exported columns.
MOST_COUNT = 1024


def evenly_in_log(ends: tuple[float, float], count: int) -> FloatArray:
    """Return evenly spaced numbers from log10 of one end to log10 of the other, shape (count,)."""
    low, high = ends
    return np.linspace(math.log10(low), math.log10(high), count)


@dataclass(frozen=True, eq=False)
class Answer:
    """Values of a field, shape (n,); a `draft` is shown until exact values are computed."""

    values: ColumnArray
    draft: bool = False


@dataclass(eq=False)
class Table:
    """Precomputed data for fast computation of fields of a family."""

    #: Spectrum of the data, or another one with the same pairs.
    spectrum: Eigenpairs
    #: Family of the data, at rest (see `Family.at_rest`).
    family: Family
    #: The data, of a type that depends on the family.
    content: Any

    def holds(self, family: Family, spectrum: Eigenpairs) -> bool:
        """Whether the data are of this family, at rest, and of these pairs.

        The spectrum is then stored, since identical spectra are compared faster.
        """
        held = self.family == family and same_pairs(self.spectrum, spectrum)
        self.spectrum = spectrum if held else self.spectrum
        return held


@dataclass(frozen=True, eq=False)
class Description:
    """Texts of a field."""

    #: Position within the family, with its unit: "λ₅ = 0.012 µm⁻²".
    quantity: str
    #: Title on the render.
    title: str
    #: Unit of the values as a power of length; eigenvectors are M-orthonormal, so φ² is per area.
    power: int = -2
    #: Unit of the values if it is no power of length.
    own_unit: str = ""
    #: Caption in a gallery; if empty, `quantity`.
    caption: str = ""
    #: Labels of values 0, 1, 2 … if these number parts of the surface.
    labels: tuple[Label, ...] = ()

    def unit(self, length: str) -> str:
        """Return the unit of the values; empty for pure numbers or if `length` is empty."""
        return self.own_unit or (power_unit(length, self.power) if self.power else "")


@dataclass(frozen=True, eq=False)
class Reading:
    """Texts and marks of the controls of a field."""

    title: str
    #: Values of `Family.facts`.
    facts: tuple[str, ...] = ()
    #: Sentence on values that need more pairs than computed; empty for none.
    warning: str = ""
    #: Target of a computation with enough pairs.
    sufficient: Target | None = None
    #: Eigenvalues at the ends of the slider, for marks at decades; None for no marks.
    decades: tuple[float, float] | None = None
    #: Share of the slider, from its low end, that the computed pairs do not resolve.
    hatched: float = 0.0


@dataclass(frozen=True, eq=False)
class Response:
    """Filters as functions of the eigenvalue, for the response plot."""

    #: Shape (m,): Eigenvalues, and the filter of the chosen field.
    curve: tuple[FloatArray, FloatArray]
    #: Eigenvalue of the handle that drags the filter; None if the filter cannot be moved.
    handle: float | None
    #: Legend as HTML.
    legend: str
    #: Filters of all columns of the feature, as `curve`.
    others: tuple[tuple[FloatArray, FloatArray], ...] = ()
    #: Range of eigenvalues, whose ends can be dragged.
    ends: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """Positions of a profile, and coefficients of its values in eigenfunctions."""

    #: Shape (m,): Positions on the bottom axis: log t, band, or index.
    places: FloatArray
    #: Shape (m, k): Coefficients of φ², or shape (k,): Factors of φ, with k positions.
    coefficients: FloatArray
    #: Whether the logarithm of values is drawn.
    logarithmic: bool = False

    def values(self, at_vertex: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and values, from the eigenfunctions at a vertex, shape (<= k,)."""
        length = len(at_vertex)
        if self.coefficients.ndim == 1:
            return self.places[:length], self.coefficients[:length] * at_vertex
        values = self.coefficients[:, :length] @ np.square(at_vertex)
        if self.logarithmic:
            values = np.log10(np.maximum(values, np.finfo(np.float64).tiny))
        return self.places, values


@dataclass(frozen=True, eq=False)
class Profile:
    """Plot of the fields of a family at one vertex."""

    curve: Samples
    #: Exported columns.
    dots: Samples
    #: Labels of the axes, bottom and left.
    axes: tuple[str, str]
    #: Range of the bottom axis that the computed pairs do not resolve.
    unresolved: tuple[float, float] | None = None


@dataclass(frozen=True)
class Family(Parameters):
    """Base class of families; an instance is a choice of parameters."""

    #: Name in sessions, file names and names of controls.
    name: ClassVar[str]
    #: Text in menus, text on the tab, and tooltip.
    label: ClassVar[str]
    short: ClassVar[str]
    tip: ClassVar[str]
    #: Page of the documentation, in docs/algorithms; empty for none.
    page: ClassVar[str] = ""
    #: SVG elements, as in `meshmash_viewer.app.theme.ICONS`.
    icon: ClassVar[str] = '<path d="M6 2v4M10 2v4M4 6h8v3a4 4 0 0 1-8 0zM8 13v3"/>'
    #: Noun for a position, singular and plural: "Band", "Bands".
    nouns: ClassVar[tuple[str, str]] = ("Column", "Columns")
    #: Captions of the facts about a position, by object name of the label.
    facts: ClassVar[dict[str, str]] = {}
    #: Kind of the exported features; empty without export.
    export: ClassVar[str] = ""
    #: Label of the export if it differs from `label`.
    export_label: ClassVar[str] = ""
    #: Name of the parameter that is the number of exported columns.
    counted: ClassVar[str] = ""
    #: Parameters that select one of the fields that share a table.
    position: ClassVar[tuple[str, ...]] = ()
    #: Parameters that refer to data of the mesh, such as a map, which others may lack.
    own: ClassVar[tuple[str, ...]] = ()
    #: Two parameters, the first less than the second.
    ordered: ClassVar[tuple[str, str] | None] = None
    #: Parameter without which there is no field.
    required: ClassVar[str] = ""
    #: Label of the left axis of the response plot.
    response_label: ClassVar[str] = "Response"
    #: Noun for the contents of the response plot.
    response_noun: ClassVar[str] = "Filters"
    #: Number of decades from 0 to 1 on the left axis of that plot; 0 for a linear axis.
    response_decades: ClassVar[int] = 0
    #: Whether values depend on a single eigenpair, not on the number of computed pairs.
    of_one_pair: ClassVar[bool] = False
    #: Whether contour lines are drawn at round values.
    contoured: ClassVar[bool] = False
    #: Whether a few vertices may have values far beyond all others.
    tailed: ClassVar[bool] = False
    #: Whether low values are at the bright end of the colour map.
    bright_low: ClassVar[bool] = False
    #: Milliseconds per step when played; 0 if the family cannot be played.
    interval: ClassVar[int] = 0
    #: Whether axes are logarithmic: bottom and left of the profile, bottom of the response.
    logarithmic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    # -- derived from the declarations --------------------------------------------------------

    @property
    def usable(self) -> bool:
        """Whether the required parameter is chosen."""
        return not self.required or getattr(self, self.required) is not None

    @classmethod
    def makes_features(cls) -> bool:
        """Whether the family exports columns rather than eigenpairs."""
        return cls.compute_features is not Family.compute_features

    def at_rest(self) -> Self:
        """Reset the position; families that are equal at rest share a table."""
        start = {each.name: each.default for each in fields(self) if each.name in self.position}
        return replace(self, **start)

    def filled_in(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        """Set the parameters that `resolved` sets, if there are enough pairs."""
        if not self.usable or (self.needs_pairs and not len(spectrum)):
            return self
        known = self.resolved(spectrum, chosen)
        found = {name: getattr(known, name) for name in self.declared()}
        return replace(self, **{name: each for name, each in found.items() if each is not None})

    def measured_from(self, vertices: Sequence[int]) -> Self:
        """Set the vertices of exported columns, if each column belongs to a vertex."""
        several = [name for name, each in self.declared().items() if each.vertex and each.many]
        found: dict[str, Any] = dict.fromkeys(several, tuple(vertices))
        return replace(self, **found)

    # -- choices ------------------------------------------------------------------------------

    @property
    def signed(self) -> bool:
        """Whether zero is the centre of the range of values."""
        return False

    @property
    def needs_pairs(self) -> bool:
        """Whether the field needs at least one eigenpair.

        Otherwise the spectrum may have a mesh but no pairs.
        """
        return True

    @property
    def divergence(self) -> str:
        """Sentence without a full stop on a sum that grows with every further pair; "" if none."""
        return ""

    @property
    def of_pairs(self) -> bool:
        """Whether the values depend on eigenpairs."""
        return self.needs_pairs

    @classmethod
    def exported(cls, n_columns: int | None = None, unit: str | None = None, **chosen: Any) -> Self:
        """Create a family from a number of exported columns, and parameters by name.

        `unit` is the length unit of the mesh, None if not known yet. `InputError` is raised for
        parameters that exclude one another.
        """
        count = {cls.counted: n_columns} if cls.counted and n_columns is not None else {}
        return cls(**count, **chosen)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        """Set parameters that are None; families that are equal when resolved have equal values.

        The spectrum has at least one pair if `needs_pairs`. `chosen` contains all families by name,
        since a family may depend on another.
        """
        raise NotImplementedError

    def for_other_mesh(self, n_components: int) -> Self:
        """Reset parameters that do not apply to another mesh, with `n_components` components."""
        return self

    def for_repair(self, n_components: int) -> Self:
        """Reset parameters that do not apply to a part or a repair of the mesh, in its unit."""
        return self.for_other_mesh(n_components)

    def for_other_unit(self) -> Self:
        """Reset lengths, times and eigenvalues, for a mesh in another unit."""
        default = type(self)()
        sized = (name for name, each in self.declared().items() if each.power)
        return replace(self, **{name: getattr(default, name) for name in sized})

    def carried(self, to: Correspondence) -> Self:
        """Convert to another shape: scale lengths, and replace vertices by corresponding ones."""
        other: dict[str, Any] = {}
        for name, each in self.declared().items():
            if each.power and getattr(self, name) is not None:
                other[name] = getattr(self, name) * to.length**each.power
        return replace(self.at_vertices(to.vertex), **other)

    def within(self, spectrum: Eigenpairs) -> Self:
        """Limit the position to positions that a spectrum has."""
        return self

    # -- positions ----------------------------------------------------------------------------

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        """Return the positions of steps on the bottom axis of the profile; empty without steps."""
        return np.empty(0)

    def place(self, spectrum: Eigenpairs) -> float:
        """Return the position on the bottom axis of the profile."""
        raise NotImplementedError

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        """Select the field nearest to a position on the bottom axis."""
        raise NotImplementedError

    def step(self, spectrum: Eigenpairs, steps: int) -> Self:
        """Move the position by a number of steps, up to the ends of its range."""
        places = self.places(spectrum)
        if len(places) < 2:
            return self
        indices, before = np.arange(len(places)), self.place(spectrum)
        moved = np.interp(before, places, indices) + steps
        place = float(np.interp(moved, indices, places))  # interp clips to the ends
        return self if abs(place - before) < 1e-9 else self.at_place(spectrum, place)

    @property
    def definition(self) -> str:
        """Short formula of the values; "" for none."""
        return ""

    # -- values of resolved families ----------------------------------------------------------

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        """Return the texts of the field."""
        raise NotImplementedError

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        """Return the texts of controls made from the declarations."""
        return Reading(self.describe(spectrum, unit).quantity)

    def limits_of(self, spectrum: Eigenpairs) -> tuple[ColumnArray, bool] | None:
        """Return the values that determine automatic limits, and whether they are signed.

        None if the field itself determines the limits.
        """
        return None

    @property
    def limits_key(self) -> str:
        """Key of the chosen limits and scale: the family, for maps followed by the map name."""
        return self.name

    @property
    def given_limits(self) -> tuple[float, float, bool] | None:
        """Stored automatic limits, and whether they are logarithmic; None to compute them."""
        return None

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        """Compute values at every vertex; None without a table, if the family requires one."""
        raise NotImplementedError

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        """Whether the table is up to date."""
        return True

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        """Build the table; parts of `before`, an older table, may be reused.

        `Cancelled` is raised after `cancel` returns True.
        """
        raise NotImplementedError

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        """Whether an older table can be used until the new table is built."""
        return False

    # -- plots --------------------------------------------------------------------------------

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        """Return the profile; None if these pairs have none."""
        return None

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response | None:
        """Return the filters, sampled at eigenvalues `along` or at others; None without filters."""
        return None

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        """Move the filter to an eigenvalue."""
        return self

    def between(self, low: float, high: float) -> Self:
        """Change the range of eigenvalues."""
        return self

    # -- files --------------------------------------------------------------------------------

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise `InputError` if the mesh does not have a required vertex or map."""

    def compute_features(
        self, pairs: Eigenpairs | None, mesh: Mesh, bound: float | None = None, **summed: Any
    ) -> Features:
        """Compute the exported columns; `pairs` is None if not `of_pairs`.

        `bound` is the requested maximum eigenvalue, if any; `summed` are arguments of
        `meshmash_viewer.features.sums.compute_features`.
        """
        raise NotImplementedError

    def assumed(self, spectrum: Eigenpairs, unit: str) -> str:
        """Return the parameters of the export that the spectrum determined: "t = 2 nm²"."""
        return ""

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        """Return the names of the exported columns, and a sentence on their range.

        `InputError` is raised if there are no columns.
        """
        raise NotImplementedError

    def script(self, spectrum: Eigenpairs) -> list[str]:
        """Return Python lines that compute ``values`` from a ``decomposition`` and a ``mesh``.

        They may also compute ``features``, the exported columns.
        """
        raise NotImplementedError
