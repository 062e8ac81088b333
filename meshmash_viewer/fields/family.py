"""What a family of fields is: its parameters, and all that the rest of the house asks of it.

A family is one frozen dataclass in a file of its own, listed in `meshmash_viewer.fields.FAMILIES`.
An instance holds a choice of its parameters. Some of them may be left open: `Family.resolved`
fills these in from a spectrum, and leaves out what makes no difference to the values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.features.sums import Features, truncated_features
from meshmash_viewer.fields.schema import Check, none_or
from meshmash_viewer.fields.spectrum import Spectrum, same_pairs
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.units import power_unit
from meshmash_viewer.vertex_map import Label

if TYPE_CHECKING:
    from meshmash_viewer.features.comparison import Correspondence
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.eigensolver import Decomposition

FloatArray: TypeAlias = npt.NDArray[np.float64]
ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Most columns that a feature is exported with.
MOST_COUNT = 1024


def parameter(default: Any, check: Check | None, *, power: int = 0, vertex: bool = False) -> Any:
    """A parameter that a session keeps.

    Parameters
    ----------
    default : Any
        None is a value, too: left open.
    check : callable or None
        What other values may be, see `meshmash_viewer.fields.schema`; None for the name of a
        feature, which their table knows.
    power : int
        Of a length that it is.
    vertex : bool
        Whether it is a vertex.
    """
    check = none_or(check) if check and default is None else check
    return field(default=default, metadata={"check": check, "power": power, "vertex": vertex})


def is_vertex(parameter: Field[Any]) -> bool:
    """Whether a parameter of a family is a vertex of the mesh."""
    return bool(parameter.metadata.get("vertex"))


@dataclass(frozen=True)
class Option:
    """One option of the command line; a name that two families share is one option of the command.

    Parameters
    ----------
    name : str
        With underscores; "t_min" is given as ``--t-min``.
    about : str
        What it is, for ``--help``.
    metavar : str, optional
        What stands for its value there.
    kind : callable
        Makes the value of the text, or a `Quantity` whose unit is that of a mesh.
    values : tuple of str, optional
        All that it may be.
    many : bool
        Whether it may be given many times.
    """

    name: str
    about: str
    metavar: str | None = None
    kind: Callable[[str], Any] = str
    values: tuple[str, ...] | None = None
    many: bool = False

    @property
    def flag(self) -> str:
        """As it is typed."""
        return f"--{self.name.replace('_', '-')}"


@dataclass(frozen=True, eq=False)
class Answer:
    """Values of a field at every vertex, shape (n,); a draft where a better answer will follow."""

    values: ColumnArray
    draft: bool = False


@dataclass(eq=False)
class Table:
    """What makes the next fields of a family cheap.

    Parameters
    ----------
    spectrum : Spectrum
        Which it was made from, or the same pairs as they are known now.
    family : Family
        At rest, see `Family.at_rest`: what it was made for.
    content : Any
        The family's own.
    """

    spectrum: Spectrum
    family: Family
    content: Any

    def holds(self, family: Family, spectrum: Spectrum) -> bool:
        """Whether it was made for a family at rest and for these pairs."""
        return self.family == family and same_pairs(self.spectrum, spectrum)


@dataclass(frozen=True, eq=False)
class Response:
    """Filters over the eigenvalue.

    Parameters
    ----------
    curve : tuple of two ndarrays of float64, shape (m,)
        Eigenvalues, and the response of the filter whose field is chosen.
    handle : float or None
        Eigenvalue at which that filter is held; None if it cannot be moved along λ.
    legend : str
        What it is, as HTML.
    others : tuple of such curves
        The other filters of the feature.
    ends : tuple of float, optional
        Range of eigenvalues that can be dragged at both ends.
    """

    curve: tuple[FloatArray, FloatArray]
    handle: float | None
    legend: str
    others: tuple[tuple[FloatArray, FloatArray], ...] = ()
    ends: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """Places of a profile, and how its values there come from a vertex's eigenfunction values.

    Parameters
    ----------
    places : ndarray of float64, shape (m,)
        As drawn: log t, band, or index.
    coefficients : ndarray of float64, shape (m, k)
        Of φ² for features; for eigenfunctions the sign of each, shape (k,).
    logarithmic : bool
        Whether values are drawn as their logarithm.
    """

    places: FloatArray
    coefficients: FloatArray
    logarithmic: bool = False

    def values(self, at_vertex: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points to draw for the eigenfunction values at a vertex, shape (<= k,)."""
        length = len(at_vertex)
        if self.coefficients.ndim == 1:
            return self.places[:length], self.coefficients[:length] * at_vertex
        values = self.coefficients[:, :length] @ np.square(at_vertex)
        if self.logarithmic:
            values = np.log10(np.maximum(values, np.finfo(np.float64).tiny))
        return self.places, values


@dataclass(frozen=True, eq=False)
class Profile:
    """What the profile of a vertex is drawn from; dots are the exported columns."""

    curve: Samples
    dots: Samples


@dataclass(frozen=True)
class Family:
    """A choice of parameters of one family; see the attributes for what it says of itself.

    Attributes
    ----------
    name : str
        In sessions, in names of files and of controls.
    label, short, tip : str
        On menus, on its tab, and a sentence of what it is.
    export : str
        Kind of features that it is exported as; empty where it is not.
    export_label : str
        What that is called where it differs from `label`.
    counted : str
        Name of the parameter that is the number of exported columns.
    options : tuple of Option
        What `exported` takes from the command line besides the number of columns.
    position : tuple of str
        Parameters that say where in the family one is; they come last in what is remembered.
    own : tuple of str
        Parameters that name something of the mesh itself, which another may not have.
    ordered : tuple of str
        Two parameters of which the first is below the second.
    response_label : str
        What the left axis of its response is.
    response_decades : int
        Powers of ten from 0 to 1 of that axis; 0 where it is even.
    contoured : bool
        Whether lines are drawn on it at round values.
    tailed : bool
        Whether a few vertices may have values far beyond all others.
    interval : int
        Milliseconds a step when played; 0 where there is nothing to play.
    logarithmic : tuple of bool
        Whether the axes of its profile, bottom and left, and that of its response are powers of
        ten.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    short: ClassVar[str]
    tip: ClassVar[str]
    export: ClassVar[str] = ""
    export_label: ClassVar[str] = ""
    counted: ClassVar[str] = ""
    options: ClassVar[tuple[Option, ...]] = ()
    position: ClassVar[tuple[str, ...]] = ()
    own: ClassVar[tuple[str, ...]] = ()
    ordered: ClassVar[tuple[str, str] | None] = None
    response_label: ClassVar[str] = "Response"
    response_decades: ClassVar[int] = 0
    contoured: ClassVar[bool] = False
    tailed: ClassVar[bool] = False
    interval: ClassVar[int] = 0
    logarithmic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    # -- choices ------------------------------------------------------------------------------

    @property
    def signed(self) -> bool:
        """Whether zero is in the middle of the values rather than at their end."""
        return False

    @property
    def usable(self) -> bool:
        """Whether it is chosen what to show."""
        return True

    @property
    def needs_pairs(self) -> bool:
        """Whether there is nothing to see before the first eigenpair.

        If not, it is asked with a spectrum of no pairs, which has its mesh.
        """
        return True

    @property
    def of_pairs(self) -> bool:
        """Whether its values are made of eigenpairs; not if there is the same to see without."""
        return self.needs_pairs

    @property
    def table_columns(self) -> int:
        """Columns in single precision that its table holds."""
        return 0

    def resolved(self, spectrum: Spectrum, chosen: Mapping[str, Family]) -> Self:
        """The same with what was left open filled in; equal ones have equal values.

        The spectrum has a pair or more if they are needed; `chosen` is every family, for one may
        build on another.
        """
        raise NotImplementedError

    def at_rest(self) -> Self:
        """The same without the position: equal ones have equal columns."""
        start = {each.name: each.default for each in fields(self) if each.name in self.position}
        return replace(self, **start)

    def for_other_mesh(self, n_components: int) -> Self:
        """What of it carries over to another mesh, which has so many connected components."""
        return self

    def for_repaired(self, n_components: int, vertex: Callable[[int], int | None]) -> Self:
        """The same on the repaired mesh, of which a function gives the same vertices, or None."""
        moved = self.for_other_mesh(n_components)
        return replace(moved, **self._vertices(vertex))

    def at_vertices(self, vertex: Callable[[int], int | None]) -> Self:
        """The same at the vertices that a function gives for those that it has."""
        return replace(self, **self._vertices(vertex))

    def _vertices(self, vertex: Callable[[int], int | None]) -> dict[str, Any]:
        """Parameters that are vertices, changed by a function."""
        chosen = {each.name: getattr(self, each.name) for each in fields(self) if is_vertex(each)}
        return {name: None if at is None else vertex(at) for name, at in chosen.items()}

    def carried(self, to: Correspondence) -> Self:
        """The same on another shape: what are lengths grows with it, vertices are the same ones."""
        other: dict[str, Any] = {}
        for each in fields(self):
            value = getattr(self, each.name)
            if value is None or not each.metadata:
                continue
            if each.metadata["vertex"]:
                other[each.name] = to.vertex(value)
            elif power := each.metadata["power"]:
                other[each.name] = value * to.length**power
        return replace(self, **other)

    def told(self, to: Correspondence) -> str:
        """Which one of another shape is shown for it, where that is a question."""
        return ""

    def filled_in(self, spectrum: Spectrum, chosen: Mapping[str, Family]) -> Self:
        """The same with the parameters that were left open, where they can be told."""
        if not self.usable or (self.needs_pairs and not len(spectrum)):
            return self
        known = self.resolved(spectrum, chosen)
        names = (each.name for each in fields(self) if each.metadata)
        told = {name: getattr(known, name) for name in names if getattr(known, name) is not None}
        return replace(self, **told)

    def within(self, spectrum: Spectrum) -> Self:
        """The same at a position that a spectrum has."""
        return self

    def turned(self) -> Self:
        """The same with the other sign; itself where there is but one."""
        return self

    def like(self, vertex: int) -> Self | None:
        """The one that shows what looks like a vertex; None where it tells no such thing."""
        return None

    def of_map(self, name: str) -> Self | None:
        """The one that shows a map of the mesh; None where it shows no maps."""
        return None

    def behind(self, chosen: Mapping[str, Family]) -> Family:
        """The family whose filters and profiles say what this one is made of."""
        return self

    def step(self, spectrum: Spectrum, steps: int) -> Self:
        """Some steps on, or back by a negative number; stops at the ends."""
        return self

    # -- values, of resolved ones -------------------------------------------------------------

    def title(self) -> str:
        """What the field is called on the render."""
        return self.label

    def quantity(self, spectrum: Spectrum, unit: str) -> str:
        """Which one it is, with the unit: "λ₅ = 1.2e-08 nm⁻²"."""
        raise NotImplementedError

    def caption(self, spectrum: Spectrum, unit: str) -> str:
        """What tells it from the other columns of a gallery."""
        return self.quantity(spectrum, unit)

    def unit(self, length: str) -> str:
        """Unit of the values; eigenvectors are M-orthonormal, so that φ² is per area."""
        return power_unit(length, -2)

    def labels(self, spectrum: Spectrum, unit: str) -> tuple[Label, ...]:
        """What values 0, 1, 2 … stand for, where they name parts of the surface."""
        return ()

    def compute(self, spectrum: Spectrum, table: Table | None) -> Answer | None:
        """Values at every vertex, from a table where it serves; None if there is no other way."""
        raise NotImplementedError

    def prepared(self, spectrum: Spectrum, table: Table | None) -> bool:
        """Whether `prepare` would have nothing to do."""
        return True

    def prepare(self, spectrum: Spectrum, cancel: CancelCallback | None) -> Table:
        """Build the table for fields like this one; `Cancelled` is raised if `cancel` says so."""
        raise NotImplementedError

    def improve(self, spectrum: Spectrum, table: Table, cancel: CancelCallback | None) -> Table:
        """The table for fields like this one, made from an older one that serves."""
        return self.prepare(spectrum, cancel)

    def serves(self, spectrum: Spectrum, table: Table) -> bool:
        """Whether an older table tells something until the next is built."""
        return False

    # -- plots --------------------------------------------------------------------------------

    @classmethod
    def responds(cls) -> bool:
        """Whether it has something to be drawn over the eigenvalue."""
        return cls.response is not Family.response

    def response(self, spectrum: Spectrum, along: FloatArray) -> Response | None:
        """Filters, sampled along some eigenvalues where they have no places of their own."""
        return None

    def at_eigenvalue(self, spectrum: Spectrum, value: float) -> Self:
        """The one whose filter is held at an eigenvalue."""
        return self

    def between(self, low: float, high: float) -> Self:
        """The same over another range of eigenvalues."""
        return self

    def profile(self, spectrum: Spectrum) -> Profile | None:
        """How the profile of a vertex is made; None where it has none of its own."""
        return None

    def axes(self, unit: str) -> tuple[str, str]:
        """Names of the profile's axes, bottom and left."""
        raise NotImplementedError

    def place(self, spectrum: Spectrum) -> float:
        """Where on the bottom axis of the profile it is."""
        raise NotImplementedError

    def at_place(self, spectrum: Spectrum, place: float) -> Self:
        """The one nearest to a place of the bottom axis."""
        raise NotImplementedError

    def unresolved(self, spectrum: Spectrum) -> tuple[float, float] | None:
        """What part of the bottom axis the pairs at hand do not resolve."""
        return None

    # -- files --------------------------------------------------------------------------------

    @classmethod
    def exported(cls, n_columns: int | None = None, **chosen: Any) -> Self:
        """One with so many columns, and other parameters as they are asked for.

        `InputError` is raised if they do not go together.
        """
        count = {cls.counted: n_columns} if cls.counted and n_columns is not None else {}
        return cls(**count, **chosen)

    @classmethod
    def makes_features(cls) -> bool:
        """Whether it is exported as columns, rather than as eigenpairs."""
        return bool(cls.counted) or cls.compute_features is not Family.compute_features

    def measured_from(self, vertices: Sequence[int]) -> Self:
        """The same with a column for each of some vertices, where its columns are of vertices."""
        return self

    def check_mesh(self, mesh: Mesh) -> None:
        """Raise `InputError` if a mesh does not have what was asked for."""

    def compute_features(
        self,
        pairs: Decomposition | None,
        mesh: Mesh,
        area: float | None = None,
        bound: float | None = None,
        **summed: Any,
    ) -> Features:
        """The exported columns; without pairs if it needs none.

        `area` and `bound` are those of `bank`, `summed` goes to
        `meshmash_viewer.features.sums.compute_features`.
        """
        assert pairs is not None
        bank = self.bank(pairs.eigenvalues, area, bound)
        return truncated_features(pairs, bank, unit=mesh.unit, **summed)

    def column_names(self, spectrum: Spectrum) -> tuple[str, ...]:
        """Names of the exported columns; `InputError` is raised where there are none."""
        return self.bank(spectrum.eigenvalues).columns

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        """Filters of the exported columns, for eigenvalues of shape (k,).

        `area` gives a range where all eigenvalues are zero, `bound` is the threshold that they were
        computed to. `InputError` is raised if they do not suffice.
        """
        raise NotImplementedError

    def contents(self, spectrum: Spectrum, unit: str) -> str:
        """One sentence on the range of the exported columns."""
        return ""

    def bank_script(self) -> str:
        """The expression that makes the bank of the exported columns."""
        raise NotImplementedError

    def script(self, spectrum: Spectrum) -> list[str]:
        """Python lines that make ``values`` of a ``decomposition`` and a ``mesh``.

        Where they make ``features`` as well, these are what is exported.
        """
        raise NotImplementedError
