"""A filter as a line of text: ``exp(-t*x)``, where x stands for λ and t for a number to choose.

The line is taken apart by Python's own parser and computed by a walk over its tree that knows
numbers, names, arithmetic, comparisons and the functions of `FUNCTIONS`, and nothing else: a line
out of a stranger's file can be wrong, but it cannot run code, and it cannot run for long.
"""

from __future__ import annotations

import ast
import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.features.filter_parameters import (
    ZERO_SHARE,
    as_parameters,
    as_spectrum,
    short_text,
)
from meshmash_viewer.features.filters import FilterBank

__all__ = [
    "FUNCTIONS",
    "MOST_CHARACTERS",
    "MOST_NAMES",
    "Formula",
    "FormulaResponse",
    "formula_bank",
]

FloatArray: TypeAlias = npt.NDArray[np.float64]

#: Longest line, deepest nesting, and most names, none of which a filter comes near.
MOST_CHARACTERS, _DEEPEST, MOST_NAMES = 200, 30, 4

#: The variable; whoever has the letter may write it.
_X = "x", "λ"
_CONSTANTS = {"pi": math.pi, "e": math.e}
#: Functions by name, and how many values each takes.
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sqrt": (np.sqrt, 1),
    "abs": (np.abs, 1),
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tanh": (np.tanh, 1),
    "minimum": (np.minimum, 2),
    "maximum": (np.maximum, 2),
    "where": (np.where, 3),
}
_ARITHMETIC: dict[type[ast.operator], Callable[..., Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.BitAnd: np.logical_and,
    ast.BitOr: np.logical_or,
}
_SIGNS: dict[type[ast.unaryop], Callable[..., Any]] = {
    ast.USub: np.negative,
    ast.UAdd: np.positive,
    ast.Not: np.logical_not,
}
_COMPARISONS: dict[type[ast.cmpop], Callable[..., Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}
#: Largest number that can be written.
_LARGEST = 1e300
#: Places where a formula is looked at beyond the last eigenvalue, and what stands for its values
#: where it has none.
_PLACES, _ANYTHING = 2048, 1e200
#: Powers of length that a parameter may be, the likeliest first.
_POWERS = (0, 2, -2, 1, -1, 4, -4)
#: Shares of samples at which a formula is the same on a mesh of another size, for it to be so:
#: numbers in it that are eigenvalues themselves may differ.
_MOSTLY = 0.8
#: How much larger the other mesh is.
_LARGER = 1.7


@dataclass(frozen=True)
class Formula:
    """A filter h(λ), as it was written.

    Parameters
    ----------
    text : str
        Arithmetic (``+ - * / **``), comparisons (``a <= x <= b``), ``and``, ``or``, ``not``,
        parentheses, numbers, ``pi``, ``e``, the functions of `FUNCTIONS`, ``x`` or λ, and names of
        parameters. A comparison is 1 where it holds and 0 elsewhere.

    Raises
    ------
    InputError
        If it is anything else; the sentence says what and at which character.

    Examples
    --------
    >>> Formula("exp(-t*x)").parameters
    ('t',)
    >>> Formula("exp(-t*x)")([0.0, 1.0], t=2.0).round(3)
    array([1.   , 0.135])
    """

    text: str

    def __post_init__(self) -> None:
        # text of a file may come with its byte order mark
        object.__setattr__(self, "text", self.text.removeprefix("\ufeff"))
        _checked(_parsed(self.text), 0)
        if len(self.parameters) > MOST_NAMES:
            raise InputError(
                f"The formula has {len(self.parameters)} parameters: give numbers for all but"
                f" {MOST_NAMES} of them."
            )

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names that need a value, in the order in which they are written."""
        names = [node for node in ast.walk(_parsed(self.text)) if isinstance(node, ast.Name)]
        ordered = sorted(names, key=lambda node: (node.lineno, node.col_offset))
        known = {*_X, *_CONSTANTS, *FUNCTIONS}
        return tuple(dict.fromkeys(node.id for node in ordered if node.id not in known))

    def __call__(self, eigenvalues: npt.ArrayLike, **values: float) -> FloatArray:
        """The filter at eigenvalues of shape (k,), with a value for each parameter: shape (k,).

        Raises
        ------
        InputError
            If a parameter has no value or a value no parameter, or if the filter is not finite or
            is negative at one of the eigenvalues.
        """
        spectrum = as_spectrum(eigenvalues)
        # zero but for rounding is zero: 1 / x, or a root, tells these apart
        zero = spectrum <= ZERO_SHARE * spectrum.max(initial=0.0)
        spectrum = np.where(zero, 0.0, spectrum)
        self._check_names(values)
        found = self.sampled(spectrum, values)
        wrong = np.flatnonzero(~(np.isfinite(found) & (found >= 0.0)))
        if len(wrong):
            raise InputError(self._complaint(spectrum[wrong[0]], found[wrong[0]]))
        return found

    @property
    def powers(self) -> dict[str, int]:
        """What power of length each parameter is: 2 for a time, -2 for an eigenvalue, 0 for none.

        Found by trying: these are the powers under which the formula is the same on a mesh of
        another size, where all eigenvalues are others.
        """
        return dict(zip(self.parameters, _powers(self), strict=True))

    def _check_names(self, values: Mapping[str, object]) -> None:
        for name in self.parameters:
            if name not in values:
                raise InputError(
                    f"The formula {printable(self.text)} has a parameter {name}: say what it is"
                    " (--set, or a slider), or write x where λ is meant."
                )
        for name in values:
            if name not in self.parameters:
                raise InputError(f"The formula {printable(self.text)} has no parameter {name}.")

    def sampled(self, eigenvalues: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """The filter at eigenvalues of shape (k,), be it a sound one or not: shape (k,)."""
        names = {**_CONSTANTS, **{name: float(value) for name, value in values.items()}}
        with np.errstate(all="ignore"):
            found = _value(_parsed(self.text), {**names, **dict.fromkeys(_X, eigenvalues)})
        return np.broadcast_to(np.asarray(found, np.float64), eigenvalues.shape).copy()

    def _complaint(self, eigenvalue: float, value: float) -> str:
        at = f"at λ = {eigenvalue:.4g}"
        if np.isfinite(value):
            return (
                f"The formula is {value:.4g} {at}, and weights of squares are not negative: write"
                " maximum(0, …) around it."
            )
        what = "not a number" if np.isnan(value) else "infinite"
        if eigenvalue == 0.0:
            return f"The formula is {what} {at}: write where(x > 0, …, 0) around it."
        return f"The formula is {what} {at}: its parameters are too large or too small there."


@dataclass(frozen=True)
class FormulaResponse:
    """A formula with the values of its parameters in each of f columns.

    Nothing is known of a formula but its values, so what it does beyond an eigenvalue is looked at
    in many places, ever further apart.
    """

    formula: Formula
    values: tuple[tuple[tuple[str, float], ...], ...]

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        """Values at eigenvalues of shape (k,): shape (f, k)."""
        return np.stack([self.formula(eigenvalues, **dict(column)) for column in self.values])

    def supremum(self, start: float) -> FloatArray:
        """Largest value found from an eigenvalue on, shape (f,)."""
        start = max(start, 0.0)
        distances = (start or 1.0) * np.geomspace(1e-9, 1e9, _PLACES)
        return np.asarray(self._sizes(start + np.append(0.0, distances)).max(axis=1))

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        """``∫ h dλ`` from `start` to each of `ends` by trapezoids between places: shape (m, f)."""
        start = max(start, 0.0)
        widths = np.maximum(np.nan_to_num(ends) - start, 0.0)
        steps = np.append(0.0, widths.max(initial=0.0) * np.geomspace(1e-9, 1.0, _PLACES))
        sizes = self._sizes(start + steps)
        areas = 0.5 * (sizes[:, 1:] + sizes[:, :-1]) * np.diff(steps)
        sums = np.pad(np.cumsum(areas, axis=1), ((0, 0), (1, 0)))
        columns = [np.interp(widths, steps, column) for column in sums]
        return np.asarray(np.stack(columns, axis=1), dtype=np.float64)

    def _sizes(self, places: FloatArray) -> FloatArray:
        """Sizes of the values; what is no number may be anything, so it counts as very large."""
        found = np.stack([self.formula.sampled(places, dict(column)) for column in self.values])
        return np.asarray(np.nan_to_num(np.minimum(np.abs(found), _ANYTHING), nan=_ANYTHING))


def formula_bank(formula: str | Formula, **values: npt.ArrayLike) -> FilterBank:
    """Columns of a filter that is written as a formula.

    Parameters
    ----------
    formula : str
        See `Formula`.
    **values
        A number for each of its parameters; one of them may be a list of f numbers, which makes f
        columns.

    Returns
    -------
    FilterBank

    Raises
    ------
    InputError
        If the formula cannot be understood, a parameter is missing, or two of them are lists.

    Examples
    --------
    >>> bank = mv.formula_bank("exp(-t*x)", t=[1.0, 2.0])
    >>> bank([0.0, 1.0]).round(3)
    array([[1.   , 0.368],
           [1.   , 0.135]])
    """
    formula = Formula(formula) if isinstance(formula, str) else formula
    formula._check_names(values)
    columns = {name: np.atleast_1d(np.asarray(each, np.float64)) for name, each in values.items()}
    lists = [name for name, each in columns.items() if len(each) != 1]
    if len(lists) > 1:
        raise InputError(f"Of {' and '.join(lists)} only one can be a list.")
    swept = (lists or list(formula.parameters) or [""])[0]
    places = as_parameters(columns.get(swept, [0.0]), f"value of {swept}")
    each = tuple(
        tuple((name, float(column[index % len(column)])) for name, column in columns.items())
        for index in range(len(places))
    )
    power = formula.powers.get(swept, 0)
    names = tuple(f"filter_{swept}={short_text(places, at)}" for at in range(len(places)))
    return FilterBank(
        "filter", names if swept else ("filter",), places, swept, power,
        FormulaResponse(formula, each),
    )  # fmt: skip


@lru_cache(maxsize=64)
def _powers(formula: Formula) -> tuple[int, ...]:
    """See `Formula.powers`; tried where λ and all parameters are about 1."""
    names, eigenvalues = formula.parameters, np.geomspace(0.03, 30.0, 301)
    values = np.array([1.0 + 0.37 * place for place in range(len(names))])
    here = formula.sampled(eigenvalues, dict(zip(names, values, strict=True)))

    def same(powers: tuple[int, ...]) -> float:
        scaled = values * _LARGER ** np.array(powers)
        there = formula.sampled(eigenvalues / _LARGER**2, dict(zip(names, scaled, strict=True)))
        return float(np.isclose(here, there, rtol=1e-9, atol=1e-300, equal_nan=True).mean())

    # of those that are as good, the likeliest
    every = itertools.product(_POWERS, repeat=len(names))
    likeliest_first = sorted(every, key=lambda powers: sum(map(_POWERS.index, powers)))
    best = max(likeliest_first, key=same)
    return best if same(best) >= _MOSTLY else (0,) * len(names)


@lru_cache(maxsize=64)
def _parsed(text: str) -> ast.expr:
    """The tree of a line."""
    if not text.strip():
        raise InputError("There is no formula: write one such as exp(-t*x), with x for λ.")
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"The formula is longer than {MOST_CHARACTERS} characters: shorten it.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.strip(), mode="eval").body
    except SyntaxError as fault:
        at = f" at character {fault.offset}" if fault.offset else ""
        raise InputError(
            f"The formula {printable(text)} cannot be read{at}: write one such as exp(-t*x)."
        ) from None
    except (ValueError, RecursionError, MemoryError):
        raise InputError(
            f"The formula {printable(text)} cannot be read: write one such as exp(-t*x)."
        ) from None


def _checked(node: ast.expr, depth: int) -> None:
    """Refuse what is not of the grammar."""
    if depth > _DEEPEST:
        raise InputError(f"The formula is nested deeper than {_DEEPEST} levels: simplify it.")
    for part in _parts(node):
        _checked(part, depth + 1)


def _parts(node: ast.expr) -> Iterator[ast.expr]:
    """What an allowed node is made of; any other is refused."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if not abs(value) < _LARGEST:
                raise _refusal(node, "the number is too large")
        case ast.Name():
            if node.id in FUNCTIONS:
                raise _refusal(node, f"{node.id} is a function: write {node.id}(…)")
        case ast.UnaryOp() if type(node.op) in _SIGNS:
            yield node.operand
        case ast.BinOp() if type(node.op) in _ARITHMETIC:
            yield from (node.left, node.right)
        case ast.BoolOp():
            yield from node.values
        case ast.Compare() if all(type(each) in _COMPARISONS for each in node.ops):
            yield from (node.left, *node.comparators)
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
            count = FUNCTIONS[name][1]
            if node.keywords or len(node.args) != count:
                raise _refusal(node, f"{name} takes {count} value{'s' * (count > 1)}")
            yield from node.args
        case ast.Call(func=ast.Name(id=name)):
            raise _refusal(node, f"{name} is no function: there are {', '.join(FUNCTIONS)}")
        case _:
            raise _refusal(node, "only numbers, names, + - * / **, comparisons and functions go")


def _refusal(node: ast.expr, why: str) -> InputError:
    return InputError(f"The formula is wrong at character {node.col_offset + 1}: {why}.")


def _value(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """A node's value, an array or a number."""
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name():
            return names[node.id]
        case ast.UnaryOp():
            return _as_number(_SIGNS[type(node.op)](_value(node.operand, names)))
        case ast.BinOp():
            both = _value(node.left, names), _value(node.right, names)
            return _as_number(_ARITHMETIC[type(node.op)](*both))
        case ast.BoolOp():
            join = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            return _as_number(reduce(join, (_value(each, names) for each in node.values)))
        case ast.Compare():
            sides = [_value(each, names) for each in (node.left, *node.comparators)]
            held = [
                _COMPARISONS[type(op)](*pair)
                for op, pair in zip(node.ops, itertools.pairwise(sides), strict=True)
            ]
            return _as_number(reduce(np.logical_and, held))
        case ast.Call(func=ast.Name(id=name)):
            return FUNCTIONS[name][0](*(_value(each, names) for each in node.args))
    raise AssertionError(f"{type(node).__name__} has been refused before")


def _as_number(value: Any) -> FloatArray:
    """What is true is 1, what is false 0."""
    return np.asarray(value, np.float64)
