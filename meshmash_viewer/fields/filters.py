"""Family of filters: sums of squared eigenfunctions, weighted by a formula in λ."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import (
    FilterBank,
    band_pass_bank,
    gaussian_pyramid_bank,
    low_pass_bank,
)
from meshmash_viewer.features.formula import Formula, formula_bank
from meshmash_viewer.fields.bank_columns import BankFamily, ColumnCount
from meshmash_viewer.fields.family import (
    Answer,
    Cancel,
    Description,
    Family,
    Profile,
    Response,
    Samples,
    Table,
    evenly_in_log,
)
from meshmash_viewer.fields.live_tables import PairTable, build_pair_table, summed
from meshmash_viewer.fields.parameter import CheckedText, Finite, NotNegative, parameter
from meshmash_viewer.quantities import parse_quantity
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero, same_pairs
from meshmash_viewer.units import format_number, format_quantity, named_quantity

if TYPE_CHECKING:
    from meshmash_viewer.features.comparison import Correspondence

#: Predefined filters: labels and formulas.
READY: dict[str, str] = {
    "Low-pass": "x < c",
    "Low-pass, smooth": "1 / (1 + (x/c)**8)",
    "Band-pass": "a <= x <= b",
    "Band-pass, smooth": "1 / (1 + (a/x)**8 + (x/b)**8)",
    "Gaussian": "exp(-s*x)",
    "Wave kernel": "exp(-log(x/c)**2 / (2*w**2))",
}

#: Cached formulas, since dragging a parameter creates many filters with one formula.
_formula = lru_cache(maxsize=64)(Formula)

#: Samples of a profile curve, and arrow-key steps over the range.
_FINE, _STEPS = 64, 32
#: Range of the slider of a dimensionless parameter.
_PURE = 0.1, 10.0
#: Factor by which an edge can exceed the ends of the spectrum.
_BEYOND = 1.001
#: Exponent λt of the slowest nonconstant pair at the longest time.
_DECAYED = 10.0

Values = tuple[tuple[str, float], ...]


class FormulaText(CheckedText):
    """Text of a formula."""

    @staticmethod
    def check(text: str) -> object:
        return Formula(text)


@dataclass(frozen=True)
class Filters(BankFamily):
    """Sum ``Σ h(λ_k) φ_k²`` with a filter h."""

    name = "filter"
    label = "Filter"
    page = "filters"
    short = "Filter"
    tip = "Low-pass, band-pass, Gaussian, or any formula in λ"
    icon = '<path d="M3 5h18l-7 8v6l-4 2v-8z"/>'
    export = "filter"
    counted = "count"
    ordered = ("low", "high")
    position = ("values",)
    interval = 100
    logarithmic = (True, False, False)

    #: Text of the `meshmash_viewer.features.formula.Formula` of h. Steps and exported columns vary
    #: its first parameter.
    text: str = parameter(
        READY["Low-pass"],
        FormulaText,
        option="formula",
        help='formula in x, which is λ, such as "exp(-t*x) * (x > 1e-8)"; default "x < c"',
    )
    #: Chosen values of parameters; the spectrum determines the others.
    values: Values = parameter(
        (),
        dict[str, Finite],
        option="set",
        metavar="NAME=VALUE",
        help="value of a parameter of the formula; NAME=LOW:HIGH spreads the columns over a range",
    )
    #: Number of exported columns. A single column is the present filter; for several, the first
    #: parameter varies over its range.
    count: int = parameter(1, ColumnCount)
    #: Whether the spectrum determines the range of the first parameter.
    automatic: bool = parameter(
        True, bool, text="Automatic, from the spectrum", tip="Of the first parameter"
    )
    low: float | None = parameter(None, NotNegative, text="Lowest value")
    high: float | None = parameter(None, NotNegative, text="Highest value")

    # -- parameters ---------------------------------------------------------------------------

    @property
    def formula(self) -> Formula:
        """The parsed formula."""
        return _formula(self.text)

    @property
    def signed(self) -> bool:
        return self.formula.signed

    @property
    def first(self) -> str:
        """Name of the first parameter, which steps vary; "" if there is none."""
        return next(iter(self.formula.parameters), "")

    def span(self, name: str, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return the meaningful range of a parameter for a spectrum."""
        power = self.formula.powers[name]
        zeros = first_nonzero(spectrum)
        if not power or zeros >= len(spectrum):
            return _PURE
        low, high = float(spectrum.eigenvalues[zeros]), float(spectrum.eigenvalues[-1])
        if power > 0:
            return high ** (-power / 2), (_DECAYED / low) ** (power / 2)
        return (low / _BEYOND) ** (-power / 2), (high * _BEYOND) ** (-power / 2)

    def range(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return the range of the first parameter."""
        if not self.first:
            return _PURE
        low, high = self.span(self.first, spectrum)
        if not self.automatic:
            low, high = self.low or low, self.high or high
        return (low, high) if low < high else (high, low)

    def value(self, name: str, spectrum: Eigenpairs) -> float:
        """Return the chosen value of a parameter, or a default within its span."""
        for known, value in self.values:
            if known == name:
                return value
        powers = self.formula.powers
        alike = [each for each in powers if powers[each] == powers[name]]
        low, high = self.span(name, spectrum)
        return low * math.pow(high / low, (alike.index(name) + 1) / (len(alike) + 1))

    def all_values(self, spectrum: Eigenpairs) -> dict[str, Any]:
        """Return the values of all parameters by name."""
        return {name: self.value(name, spectrum) for name in self.formula.parameters}

    def with_values(self, **values: float) -> Self:
        """Set values of parameters."""
        return replace(self, values=tuple({**dict(self.values), **values}.items()))

    def with_text(self, text: str) -> Self:
        """Change the formula; keep the values if the parameters are the same."""
        same = Formula(text).powers == self.formula.powers
        values = self.values if same else ()
        return replace(self, text=text, values=values, automatic=True, low=None, high=None)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        low, high = self.range(spectrum)
        values = tuple(self.all_values(spectrum).items())
        return replace(self, values=values, low=low, high=high, automatic=False)

    def for_other_mesh(self, n_components: int) -> Self:
        """Keep the formula only, since its parameters depend on the spectrum."""
        return replace(self, values=(), automatic=True, low=None, high=None)

    def for_repair(self, n_components: int) -> Self:
        return self

    def carried(self, to: Correspondence) -> Self:
        """Scale the parameters by their units, which follow from the formula."""
        powers = self.formula.powers

        def grown(name: str) -> float:
            return float(to.length ** powers.get(name, 0))

        values = tuple((name, value * grown(name)) for name, value in self.values)
        low, high = (end and end * grown(self.first) for end in (self.low, self.high))
        return replace(self, values=values, low=low, high=high)

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        powers = self.formula.powers
        chosen = [
            f"{name} = {format_quantity(value, unit, powers[name])}"
            for name, value in self.all_values(spectrum).items()
        ]
        return Description(", ".join([self.text, *chosen]), self.label)

    # -- values -------------------------------------------------------------------------------

    def weights(self, spectrum: Eigenpairs) -> FloatArray:
        """Compute the filter at the eigenvalues, shape (k,)."""
        return self.formula(spectrum.eigenvalues, **self.all_values(spectrum))

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer:
        """Return the exact sum if it is stored or fast, else the approximation of the table."""
        weights = self.weights(spectrum)
        if table is None or spectrum.small or not self.serves(spectrum, table):
            return Answer(summed(weights, spectrum.rows))
        table.spectrum = spectrum  # identical spectra are compared faster
        near: PairTable = table.content
        return near.answer(weights, spectrum.rows)

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        if spectrum.small:
            return True
        if table is None or not self.serves(spectrum, table):
            return False
        return bool(table.content.rests(self.weights(spectrum)))

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        near = before.content if before else build_pair_table(spectrum, cancel)
        near = near.rest(self.weights(spectrum), spectrum.rows, cancel)
        return Table(spectrum, self.at_rest(), near)

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        return same_pairs(table.spectrum, spectrum)

    # -- plots --------------------------------------------------------------------------------

    def edges(self, spectrum: Eigenpairs) -> tuple[tuple[str, float], ...]:
        """Return names and values of the parameters that are eigenvalues, by ascending value."""
        found = [
            (name, self.value(name, spectrum))
            for name, power in self.formula.powers.items()
            if power == -2
        ]
        return tuple(sorted(found, key=lambda each: each[1]))

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response:
        legend, edges = html.escape(self.text), self.edges(spectrum)
        # samples on both sides of an edge, so that sharp edges are drawn vertically
        at_edges = [edge * side for _, edge in edges for side in (1.0 - 1e-9, 1.0 + 1e-9)]
        along = np.sort(np.concatenate([along, at_edges]))
        heights = self.formula.sampled(along, self.all_values(spectrum))
        highest = float(np.max(np.abs(heights), initial=0.0, where=np.isfinite(heights)))
        if highest > 1.0:  # the axis ends at 1
            heights, legend = heights / highest, f"{legend}, ÷ {format_number(highest)}"
        curve = along, np.where(np.isfinite(heights), heights, np.nan)
        if len(edges) == 2:
            (_, low), (_, high) = edges
            return Response(curve, math.sqrt(low * high), legend, ends=(low, high))
        return Response(curve, self._held(spectrum), legend)

    def _held(self, spectrum: Eigenpairs) -> float | None:
        """Return the eigenvalue that corresponds to the first parameter with a unit, or None."""
        for name, power in self.formula.powers.items():
            if power:
                return float(self.value(name, spectrum) ** (-2.0 / power))
        return None

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        if not value > 0.0:
            return self
        edges = self.edges(spectrum)
        if len(edges) == 2:
            moved = value / math.sqrt(edges[0][1] * edges[1][1])
            return self.with_values(**{name: moved * edge for name, edge in edges})
        for name, power in self.formula.powers.items():
            if power:
                low, high = (
                    self.range(spectrum) if name == self.first else self.span(name, spectrum)
                )
                return self.with_values(**{name: min(max(value ** (-power / 2), low), high)})
        return self

    def between(self, low: float, high: float) -> Self:
        names = [name for name, power in self.formula.powers.items() if power == -2]
        order = sorted(names[:2], key=lambda name: dict(self.values).get(name, names.index(name)))
        return self.with_values(**dict(zip(order, (low, high), strict=True)))

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        if not self.first or first_nonzero(spectrum) >= len(spectrum):
            return None
        bottom = named_quantity(self.first, unit, self.formula.powers[self.first])
        fine, dots = (self._samples(spectrum, count) for count in (_FINE, self.count))
        return Profile(fine, dots, (bottom, named_quantity("Filter", unit, -2)))

    def _samples(self, spectrum: Eigenpairs, count: int) -> Samples:
        places = self._columns(spectrum, count)
        bank = formula_bank(self.formula, **{**self.all_values(spectrum), self.first: places})
        return Samples(np.log10(places), bank(spectrum.eigenvalues))

    def _columns(self, spectrum: Eigenpairs, count: int) -> FloatArray:
        """Return the values of the first parameter, one for each column."""
        if count == 1:
            return np.array([self.value(self.first, spectrum)])
        return np.geomspace(*self.range(spectrum), count)

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        if not self.first:
            return np.empty(0)
        n_steps = self.count - 1 or _STEPS
        return evenly_in_log(self.range(spectrum), n_steps + 1)

    def place(self, spectrum: Eigenpairs) -> float:
        return math.log10(self.value(self.first, spectrum)) if self.first else 0.0

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        if not self.first:
            return self
        low, high = self.range(spectrum)
        return self.with_values(**{self.first: min(max(10.0**place, low), high)})

    # -- files --------------------------------------------------------------------------------

    @classmethod
    def exported(cls, n_columns: int | None = None, unit: str | None = None, **chosen: Any) -> Self:
        """Create a filter; `values` are texts ``name=value``, or ``name=low:high`` for `first`."""
        family = cls(chosen.get("text", cls.text), count=1 if n_columns is None else n_columns)
        values: dict[str, float] = {}
        for given in chosen.get("values", ()):
            name, _, text = given.partition("=")
            if name not in family.formula.parameters:
                known = ", ".join(family.formula.parameters) or "none"
                fault = f"--set {given}: {family.text} has no parameter {name}"
                raise InputError("unknown-name", fault, f"give one of {known}")
            ends = _ends(given, name, text, family.formula.powers[name], unit)
            if len(ends) == 1:
                values[name] = ends[0]
            elif name != family.first or not 0.0 < ends[0] < ends[1]:
                remedy = f"give a range of {family.first}, from a positive number to a larger one"
                raise InputError("out-of-range", f"--set {given} is no range", remedy)
            else:
                family = replace(family, automatic=False, low=ends[0], high=ends[1])
        return family.with_values(**values)

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        none = np.empty((0, 0))
        spectrum = Eigenpairs(np.asarray(eigenvalues), none, none)
        values = self.all_values(spectrum)
        if self.first:
            values[self.first] = self._columns(spectrum, self.count)
        return _bank(self.text, values)

    def assumed(self, spectrum: Eigenpairs, unit: str) -> str:
        swept = {self.first} if self.count > 1 or not self.automatic else set()
        return ", ".join(
            f"{name} = {format_quantity(self.value(name, spectrum), unit, power)}"
            for name, power in self.formula.powers.items()
            if name not in swept | dict(self.values).keys()
        )

    def contents(self, spectrum: Eigenpairs, unit: str) -> str:
        if not self.first or self.count == 1:
            return f"{self.describe(spectrum, unit).quantity}."
        power = self.formula.powers[self.first]
        low, high = (format_quantity(each, unit, power) for each in self.range(spectrum))
        return f"{self.text}, {self.first} from {low} to {high}."

    def bank_script(self) -> str:
        columns = ""
        if self.first and self.count > 1:
            columns = f"np.geomspace({self.low!r}, {self.high!r}, {self.count})"
        return self._script(columns)

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [
            *super().script(spectrum),
            f"shown = mv.compute_features(decomposition, {self._script()})",
            "values = shown.values[:, 0]",
        ]

    def _script(self, columns: str = "") -> str:
        """Return the expression of the bank, with `columns` for the first parameter."""
        values = {name: repr(value) for name, value in self.values}
        if columns:
            values[self.first] = columns
        name = _bank_name(self.text, [] if columns else [value for _, value in self.values])
        if name == "formula_bank":
            given = "".join(f", {name}={value}" for name, value in values.items())
            return f"mv.formula_bank({self.text!r}{given})"
        if name == "gaussian_pyramid_bank":
            return f"mv.gaussian_pyramid_bank({columns or f'[{values[self.first]}]'})"
        return f"mv.{name}({', '.join(values.values())})"


def _ends(given: str, name: str, text: str, power: int, unit: str | None) -> list[float]:
    wanted = f"--set {given} is not {name}=3e6 or {name}=1e5:1e7"
    try:
        ends = [parse_quantity(end, power) for end in text.split(":")]
    except InputError as fault:
        raise fault.of(wanted) from None
    if len(ends) > 2:
        raise InputError("out-of-range", wanted)
    return [end.in_unit(end.unit if unit is None else unit) for end in ends]


def _bank_name(text: str, edges: Sequence[float]) -> str:
    """Return the name of the function of a bank; predefined banks have a known truncation error.

    `edges` are the parameters, empty unless each is a single number.
    """
    if text == READY["Gaussian"]:
        return "gaussian_pyramid_bank"
    if text == READY["Low-pass"] and edges:
        return "low_pass_bank"
    if text == READY["Band-pass"] and len(edges) == 2 and edges[0] <= edges[1]:
        return "band_pass_bank"
    return "formula_bank"


def _bank(text: str, values: dict[str, float | FloatArray]) -> FilterBank:
    columns = {name: np.atleast_1d(each) for name, each in values.items()}
    single = all(len(each) == 1 for each in columns.values())
    edges = [float(each[0]) for each in columns.values()] if single else []
    name = _bank_name(text, edges)
    if name == "gaussian_pyramid_bank":
        return gaussian_pyramid_bank(columns["s"])
    if name == "formula_bank":
        return formula_bank(text, **values)
    return low_pass_bank(*edges) if name == "low_pass_bank" else band_pass_bank(*edges)
