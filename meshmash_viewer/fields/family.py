"""Base class of families of fields: their parameters, values, plots and files.

A family is one frozen dataclass in a file of its own, listed in `meshmash_viewer.fields.FAMILIES`.
An instance is a choice of its parameters, each declared once (`meshmash_viewer.fields.parameter`).
Some of them may be None: `Family.resolved` sets these from a spectrum, and resets parameters that
do not affect the values.
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
    """Return logarithms to base 10, evenly spaced between those of two numbers, shape (count,)."""
    low, high = ends
    return np.linspace(math.log10(low), math.log10(high), count)


@dataclass(frozen=True, eq=False)
class Answer:
    """Values of a field at every vertex, shape (n,); `draft` if more exact ones will follow."""

    values: ColumnArray
    draft: bool = False


@dataclass(eq=False)
class Table:
    """Precomputed data for fast computation of further fields of a family."""

    #: The spectrum it was made from, or one with the same pairs.
    spectrum: Eigenpairs
    #: The family it was made for, at rest (see `Family.at_rest`).
    family: Family
    #: Data of the family.
    content: Any

    def holds(self, family: Family, spectrum: Eigenpairs) -> bool:
        """Whether it was made for this family at rest and these pairs."""
        return self.family == family and same_pairs(self.spectrum, spectrum)


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
    #: Caption in a gallery; empty for the quantity.
    caption: str = ""
    #: Labels of values 0, 1, 2 … if they name parts of the surface.
    labels: tuple[Label, ...] = ()

    def unit(self, length: str) -> str:
        """Return the unit of the values; empty for pure numbers and without a unit of length."""
        return self.own_unit or (power_unit(length, self.power) if self.power else "")


@dataclass(frozen=True, eq=False)
class Reading:
    """Texts and marks of the controls of a field."""

    title: str
    #: Values of `Family.facts`.
    facts: tuple[str, ...] = ()
    #: Sentence on values for which the computed pairs do not suffice.
    warning: str = ""
    #: The part of the spectrum that suffices.
    sufficient: Target | None = None
    #: Eigenvalues at both ends of the slider, of which decades are marked.
    decades: tuple[float, float] | None = None
    #: Share of the slider, from its low end, that the computed pairs do not resolve.
    hatched: float = 0.0


@dataclass(frozen=True, eq=False)
class Response:
    """Filters as functions of the eigenvalue, for the plot."""

    #: Shape (m,): Eigenvalues, and response of the filter of the chosen field.
    curve: tuple[FloatArray, FloatArray]
    #: Eigenvalue by which that filter is dragged; None if it cannot be moved along λ.
    handle: float | None
    #: Description as HTML.
    legend: str
    #: Other filters of the feature.
    others: tuple[tuple[FloatArray, FloatArray], ...] = ()
    #: Range of eigenvalues that can be dragged at both ends.
    ends: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """Positions of a profile, and coefficients of its values in the eigenfunctions at a vertex."""

    #: Shape (m,): Positions as drawn: log t, band, or index.
    places: FloatArray
    #: Shape (m, k): Coefficients of φ² for features; for eigenfunctions the sign of each, shape
    #: (k,).
    coefficients: FloatArray
    #: Whether the logarithm of values is drawn.
    logarithmic: bool = False

    def values(self, at_vertex: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute points to draw from the eigenfunction values at a vertex, shape (<= k,)."""
        length = len(at_vertex)
        if self.coefficients.ndim == 1:
            return self.places[:length], self.coefficients[:length] * at_vertex
        values = self.coefficients[:, :length] @ np.square(at_vertex)
        if self.logarithmic:
            values = np.log10(np.maximum(values, np.finfo(np.float64).tiny))
        return self.places, values


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile of a vertex."""

    curve: Samples
    #: The exported columns.
    dots: Samples
    #: Labels of the axes, bottom and left.
    axes: tuple[str, str]
    #: Range of the bottom axis that the computed pairs do not resolve.
    unresolved: tuple[float, float] | None = None


@dataclass(frozen=True)
class Family(Parameters):
    """A choice of parameters of one family."""

    #: Name in sessions, file names and names of controls.
    name: ClassVar[str]
    #: Text in menus, text on its tab, and a description.
    label: ClassVar[str]
    short: ClassVar[str]
    tip: ClassVar[str]
    #: Page of the documentation, in docs/algorithms; empty for none.
    page: ClassVar[str] = ""
    #: Drawing like those of `meshmash_viewer.app.theme.ICONS`.
    icon: ClassVar[str] = '<path d="M6 2v4M10 2v4M4 6h8v3a4 4 0 0 1-8 0zM8 13v3"/>'
    #: Noun for a position, singular and plural: "Band", "Bands".
    nouns: ClassVar[tuple[str, str]] = ("Column", "Columns")
    #: Object names of the facts about a position, and their texts.
    facts: ClassVar[dict[str, str]] = {}
    #: Kind of the exported features; empty without export.
    export: ClassVar[str] = ""
    #: Label of the export if it differs from `label`.
    export_label: ClassVar[str] = ""
    #: Name of the parameter that is the number of exported columns.
    counted: ClassVar[str] = ""
    #: Parameters that select a field of the family; the last part of cache keys.
    position: ClassVar[tuple[str, ...]] = ()
    #: Parameters that name something of the mesh, which another mesh may not have.
    own: ClassVar[tuple[str, ...]] = ()
    #: Two parameters, the first less than the second.
    ordered: ClassVar[tuple[str, str] | None] = None
    #: Parameter without which there is no field.
    required: ClassVar[str] = ""
    #: Label of the left axis of the response plot.
    response_label: ClassVar[str] = "Response"
    #: Noun for the contents of the response plot.
    response_noun: ClassVar[str] = "Filters"
    #: Powers of ten from 0 to 1 on that axis; 0 for a linear axis.
    response_decades: ClassVar[int] = 0
    #: Whether contour lines are drawn at round values.
    contoured: ClassVar[bool] = False
    #: Whether a few vertices may have values far beyond all others.
    tailed: ClassVar[bool] = False
    #: Whether low values are at the bright end of the colour map.
    bright_low: ClassVar[bool] = False
    #: Milliseconds a step when played; 0 if it cannot be played.
    interval: ClassVar[int] = 0
    #: Whether the axes of the profile, bottom and left, and of the response are logarithmic.
    logarithmic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    # -- what follows from the declarations ---------------------------------------------------

    @property
    def usable(self) -> bool:
        """Whether the required parameter is chosen."""
        return not self.required or getattr(self, self.required) is not None

    @classmethod
    def makes_features(cls) -> bool:
        """Whether it is exported as columns rather than as eigenpairs."""
        return cls.compute_features is not Family.compute_features

    def at_rest(self) -> Self:
        """Reset the position, so that equal families have equal columns."""
        start = {each.name: each.default for each in fields(self) if each.name in self.position}
        return replace(self, **start)

    def filled_in(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        """Set parameters that are None, as far as the spectrum allows."""
        if not self.usable or (self.needs_pairs and not len(spectrum)):
            return self
        known = self.resolved(spectrum, chosen)
        found = {name: getattr(known, name) for name in self.declared()}
        return replace(self, **{name: each for name, each in found.items() if each is not None})

    def measured_from(self, vertices: Sequence[int]) -> Self:
        """Export a column for each of some vertices, if columns belong to vertices."""
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

        Otherwise it is also computed with a spectrum without pairs, which has a mesh.
        """
        return True

    @property
    def of_pairs(self) -> bool:
        """Whether its values depend on eigenpairs."""
        return self.needs_pairs

    @classmethod
    def exported(cls, n_columns: int | None = None, unit: str | None = None, **chosen: Any) -> Self:
        """Create a family with a number of columns and the given options, by parameter.

        `unit` is that of the mesh, None if not known yet. `InputError` is raised if the options are
        not compatible.
        """
        count = {cls.counted: n_columns} if cls.counted and n_columns is not None else {}
        return cls(**count, **chosen)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        """Set parameters that are None, so that equal families have equal values.

        The spectrum has at least one pair if needed; `chosen` are the choices of all families,
        since one may use another.
        """
        raise NotImplementedError

    def for_other_mesh(self, n_components: int) -> Self:
        """Keep what applies to another mesh with some number of connected components."""
        return self

    def for_repair(self, n_components: int) -> Self:
        """Keep what applies to a part or a repair of the same mesh, in the same unit."""
        return self.for_other_mesh(n_components)

    def for_other_unit(self) -> Self:
        """Keep what applies to a mesh in another unit: no lengths, times and eigenvalues."""
        default = type(self)()
        sized = (name for name, each in self.declared().items() if each.power)
        return replace(self, **{name: getattr(default, name) for name in sized})

    def carried(self, to: Correspondence) -> Self:
        """Convert to another shape: lengths are scaled, vertices are the corresponding ones."""
        other: dict[str, Any] = {}
        for name, each in self.declared().items():
            if each.power and getattr(self, name) is not None:
                other[name] = getattr(self, name) * to.length**each.power
        return replace(self.at_vertices(to.vertex), **other)

    def within(self, spectrum: Eigenpairs) -> Self:
        """Limit the position to those of a spectrum."""
        return self

    # -- positions ----------------------------------------------------------------------------

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        """Return the positions of steps on the bottom axis of the profile; empty without steps."""
        return np.empty(0)

    def place(self, spectrum: Eigenpairs) -> float:
        """Return the position on that axis."""
        raise NotImplementedError

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        """Select the field nearest to a position on that axis."""
        raise NotImplementedError

    def step(self, spectrum: Eigenpairs, steps: int) -> Self:
        """Move by some steps, back if negative, up to the ends."""
        places = self.places(spectrum)
        if len(places) < 2:
            return self
        indices, before = np.arange(len(places)), self.place(spectrum)
        moved = np.interp(before, places, indices) + steps
        place = float(np.interp(moved, indices, places))  # which is clipped to the ends
        return self if abs(place - before) < 1e-9 else self.at_place(spectrum, place)

    @property
    def definition(self) -> str:
        """Short formula of the values; "" for none."""
        return ""

    # -- values of resolved families ----------------------------------------------------------

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        """Describe the field."""
        raise NotImplementedError

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        """Return the texts of its controls, if these are made from the declarations."""
        return Reading(self.describe(spectrum, unit).quantity)

    def limits_of(self, spectrum: Eigenpairs) -> tuple[ColumnArray, bool] | None:
        """Return the values that automatic limits are taken from, and whether these are signed.

        None for those of the field itself.
        """
        return None

    @property
    def limits_key(self) -> str:
        """Key of the chosen limits and scale: the name, for maps with the name of the map."""
        return self.name

    @property
    def given_limits(self) -> tuple[float, float, bool] | None:
        """Automatic limits that were given, and whether they are logarithmic; None to find them."""
        return None

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        """Compute values at every vertex, with a table if possible; None if one is required."""
        raise NotImplementedError

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        """Whether the table is up to date."""
        return True

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        """Build the table; `before` is an older one, which may be used again.

        `Cancelled` is raised after `cancel` returns True.
        """
        raise NotImplementedError

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        """Whether an older table can be used until the next one is built."""
        return False

    # -- plots --------------------------------------------------------------------------------

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        """Return the profile of a vertex; None if it has none for these pairs."""
        return None

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response | None:
        """Return the filters, sampled at eigenvalues `along` unless they choose their own."""
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
        """Compute the exported columns; `pairs` is None if they are not needed.

        `bound` is the threshold of the computation; `summed` goes to
        `meshmash_viewer.features.sums.compute_features`.
        """
        raise NotImplementedError

    def assumed(self, spectrum: Eigenpairs, unit: str) -> str:
        """Return the values that were not given and that a name may hide, such as "t = 2 nm²"."""
        return ""

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        """Return the names of the exported columns, and a sentence on their range.

        `InputError` is raised if there are none.
        """
        raise NotImplementedError

    def script(self, spectrum: Eigenpairs) -> list[str]:
        """Return Python lines that compute ``values`` from a ``decomposition`` and a ``mesh``.

        ``features``, if computed as well, are the exported ones.
        """
        raise NotImplementedError
