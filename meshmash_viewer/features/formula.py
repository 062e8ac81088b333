"""Filters as formulas: ``exp(-t*x)``, where x is λ and t a parameter.

Python's parser converts a formula to a syntax tree, which may contain only numbers, names,
arithmetic, comparisons and the functions of `FUNCTIONS`. A formula from an untrusted file can
therefore neither execute code nor take long.
"""

from __future__ import annotations

import ast
import itertools
import keyword
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.features.filter_responses import (
    ZERO_SHARE,
    as_parameters,
    as_spectrum,
    short_texts,
)
from meshmash_viewer.features.filters import FilterBank

#: Maximum number of characters of a formula, nesting depth, and number of parameters.
MOST_CHARACTERS, _DEEPEST, MOST_NAMES = 200, 30, 4

#: Names of the variable: λ is an alias of x.
_X = "x", "λ"
_CONSTANTS = {"pi": math.pi, "e": math.e}
#: Characters of printed formulas, and the Python operators that replace them.
_WRITTEN = {"^": "**", "−": "-", "·": "*", "×": "*", "²": "**2", "≤": "<=", "≥": ">="}
_TOKEN = re.compile(r"\d+\.?\d*(?:[eE][+-]?\d+)?|[^\W\d]\w*|\S")
#: Words of Python that a formula may contain.
_WORDS = {"and", "or", "not"}
#: Functions by name, with their number of arguments.
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "ln": (np.log, 1),
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
#: Number of characters that a message quotes, from the position of the error.
_QUOTED = 12
#: Largest number in a formula.
_LARGEST = 1e300
#: Number of samples of a formula beyond the last eigenvalue, and the value that replaces NaN and
#: infinity.
_PLACES, _ANYTHING = 2048, 1e200
#: Number of halvings of λ in the search for a limit at 0, relative difference of three successive
#: estimates of a limit, and number of halvings from there to the best estimate.
_HALVINGS, _ALIKE, _FURTHER = 64, 1e-7, 12
#: Possible units of a parameter as powers of length, the most likely first.
_POWERS = (0, 2, -2, 1, -1, 4, -4)
#: Share of samples at which a formula has to be invariant to a change of the unit; less than 1,
#: because a number in the formula may be an eigenvalue.
_MOSTLY = 0.8
#: Factor of the change of the unit.
_LARGER = 1.7


#: Remedy of a formula that cannot be read.
_EXAMPLE = "write one such as exp(-2*t*x)"


class FormulaError(InputError):
    """Error of a formula that cannot be parsed; `position` is the index of the wrong character."""

    def __init__(self, fault: str, remedy: str = "", position: int = 0) -> None:
        super().__init__("unreadable-formula", fault, remedy)
        self.position = position


class _NotAllowed(Exception):
    """Syntax that is not allowed; `column` is its byte offset in the text that is parsed."""

    def __init__(self, node: ast.expr, reason: str) -> None:
        super().__init__(reason)
        self.column = node.col_offset


@dataclass(frozen=True)
class Formula:
    """A filter h(λ) written as text.

    `InputError` is raised if the text is not a valid formula; its subclass `FormulaError` contains
    the position of the error.

    Examples
    --------
    >>> Formula("exp(-t*x)").parameters
    ('t',)
    >>> Formula("exp(-t*x)")([0.0, 1.0], t=2.0).round(3)
    array([1.   , 0.135])
    """

    #: Arithmetic (``+ - * / ^``, also ``**`` and ``− · × ²``), comparisons (``a <= x <= b``),
    #: ``and``, ``or``, ``not``, parentheses, numbers, ``pi``, ``e``, the functions of `FUNCTIONS`,
    #: the eigenvalue x or λ, and names of parameters. A comparison is 1 where true, else 0.
    text: str

    def __post_init__(self) -> None:
        # text from a file may begin with a byte order mark
        object.__setattr__(self, "text", self.text.removeprefix("\ufeff"))
        try:
            _checked(_parsed(self.text), 0)
        except _NotAllowed as fault:
            position = _position(self.text, fault.column)
            at = printable(self.text[position : position + _QUOTED])
            where = f"at character {position + 1}, {at}"
            raise FormulaError(f"The formula is wrong {where}", str(fault), position) from None
        if len(self.parameters) > MOST_NAMES:
            many = f"The formula has {len(self.parameters)} parameters"
            raise InputError("too-many", many, f"give numbers for all but {MOST_NAMES}")

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, in order of appearance."""
        names = [node for node in ast.walk(_parsed(self.text)) if isinstance(node, ast.Name)]
        ordered = sorted(names, key=lambda node: (node.lineno, node.col_offset))
        known = {*_X, *_CONSTANTS, *FUNCTIONS}
        return tuple(dict.fromkeys(node.id for node in ordered if node.id not in known))

    def __call__(self, eigenvalues: npt.ArrayLike, **values: float) -> FloatArray:
        """Compute the filter at eigenvalues of shape (k,), with `values` of its parameters: (k,).

        Where the formula has no value at λ = 0, such as ``sin(x)/x``, its limit is taken.

        `InputError` is raised if the names of `values` are not those of the parameters, or if the
        filter is not finite at an eigenvalue.
        """
        spectrum = as_spectrum(eigenvalues)
        # eigenvalues that are zero within rounding are set to 0, where 1 / x is infinite
        zero = spectrum <= ZERO_SHARE * spectrum.max(initial=0.0)
        spectrum = np.where(zero, 0.0, spectrum)
        self._check_names(values)
        found = self.sampled(spectrum, values)
        if (zero & ~np.isfinite(found)).any():
            found[zero] = self._limit(spectrum[~zero].min(initial=1.0), values, found[zero][0])
        wrong = np.flatnonzero(~np.isfinite(found))
        if len(wrong):
            first = wrong[np.argmax(spectrum[wrong] > 0.0)]  # λ = 0 has another remedy
            raise self._complaint(spectrum[first], found[first])
        return found

    def _limit(self, start: float, values: Mapping[str, float], otherwise: float) -> float:
        """Return the limit at λ = 0 from values at `start` / 2, / 4 …; `otherwise` without one."""
        halves = self.sampled(start * 0.5 ** np.arange(1.0, _HALVINGS), values)
        with np.errstate(all="ignore"):
            straight = 2.0 * halves[1:] - halves[:-1]  # exact where the formula is linear
            most = np.maximum.accumulate(np.abs(halves))[2:]
            steps = np.abs(np.diff(straight))
            alike = steps <= _ALIKE * most
        runs = alike[2:] & alike[1:-1] & alike[:-2]
        if not runs.any():
            return otherwise
        first = int(np.argmax(runs))  # much further on, differences in the formula cancel
        return float(straight[first + np.argmin(steps[first : first + _FURTHER]) + 1])

    @cached_property
    def signed(self) -> bool:
        """Whether the formula is negative at some λ, with parameters near 1."""
        values = {name: 1.0 + 0.37 * place for place, name in enumerate(self.parameters)}
        return bool((self.sampled(np.geomspace(1e-30, 1e30, 20 * _PLACES), values) < 0.0).any())

    @property
    def powers(self) -> dict[str, int]:
        """Unit of each parameter as a power of length: 2 for a time, -2 for an eigenvalue.

        The powers are found by trial: with them, a change of the unit does not change the values of
        the formula.
        """
        return dict(zip(self.parameters, _powers(self), strict=True))

    def _check_names(self, values: Mapping[str, object]) -> None:
        written = f"The formula {printable(self.text)} has"
        for name in self.parameters:
            if name not in values:
                remedy = "say what it is (--set, or a slider), or write x where λ is meant"
                raise InputError("missing-argument", f"{written} a parameter {name}", remedy)
        for name in values:
            if name not in self.parameters:
                raise InputError("unknown-name", f"{written} no parameter {name}")

    def sampled(self, eigenvalues: FloatArray, values: Mapping[str, float]) -> FloatArray:
        """Compute the filter at eigenvalues of shape (k,) without checks: shape (k,)."""
        names = {**_CONSTANTS, **{name: float(value) for name, value in values.items()}}
        with np.errstate(all="ignore"):
            found = _value(_parsed(self.text), {**names, **dict.fromkeys(_X, eigenvalues)})
        return np.broadcast_to(np.asarray(found, np.float64), eigenvalues.shape).copy()

    def _complaint(self, eigenvalue: float, value: float) -> InputError:
        fault = f"The formula is {'not a number' if np.isnan(value) else 'infinite'}"
        remedy = "choose its parameters smaller or larger"
        if eigenvalue == 0.0 or not self.parameters:
            remedy = f"write where({'x > 0' if eigenvalue == 0.0 else '…'}, …, 0) around it"
        return InputError("not-finite", f"{fault} at λ = {eigenvalue:.4g}", remedy)


@dataclass(frozen=True)
class FormulaResponse:
    """Formula with the values of its parameters in each of f columns.

    Supremum and integral beyond an eigenvalue are computed from samples at increasing distances.
    """

    formula: Formula
    values: tuple[tuple[tuple[str, float], ...], ...]

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        """Compute values at eigenvalues of shape (k,): shape (f, k)."""
        return np.stack([self.formula(eigenvalues, **dict(column)) for column in self.values])

    def supremum(self, start: float) -> FloatArray:
        """Return the largest sampled magnitude at eigenvalues from `start`, shape (f,)."""
        start = max(start, 0.0)
        distances = (start or 1.0) * np.geomspace(1e-9, 1e9, _PLACES)
        return np.asarray(self._sizes(start + np.append(0.0, distances)).max(axis=1))

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        """Compute ``∫ h dλ`` from `start` to each of `ends` by the trapezoidal rule: (m, f)."""
        start = max(start, 0.0)
        widths = np.maximum(np.nan_to_num(ends) - start, 0.0)
        steps = np.append(0.0, widths.max(initial=0.0) * np.geomspace(1e-9, 1.0, _PLACES))
        sizes = self._sizes(start + steps)
        areas = 0.5 * (sizes[:, 1:] + sizes[:, :-1]) * np.diff(steps)
        sums = np.pad(np.cumsum(areas, axis=1), ((0, 0), (1, 0)))
        columns = [np.interp(widths, steps, column) for column in sums]
        return np.asarray(np.stack(columns, axis=1), dtype=np.float64)

    def _sizes(self, places: FloatArray) -> FloatArray:
        """Return magnitudes of the values; NaN and infinity are replaced by a large number."""
        found = np.stack([self.formula.sampled(places, dict(column)) for column in self.values])
        return np.asarray(np.nan_to_num(np.minimum(np.abs(found), _ANYTHING), nan=_ANYTHING))


def formula_bank(formula: str | Formula, **values: npt.ArrayLike) -> FilterBank:
    """Make a filter bank from a formula.

    `InputError` is raised if the formula is invalid, a parameter is missing, or two parameters are
    lists.

    Parameters
    ----------
    formula : str
        See `Formula`.
    **values
        A number for each parameter; for one parameter a list of f numbers, for f columns.

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
        fault = f"{' and '.join(lists)} are lists"
        raise InputError("conflicting-arguments", fault, "give only one of them as a list")
    swept = (lists or list(formula.parameters) or [""])[0]
    places = as_parameters(columns.get(swept, [0.0]), f"value of {swept}")
    each = tuple(
        tuple((name, float(column[index % len(column)])) for name, column in columns.items())
        for index in range(len(places))
    )
    power = formula.powers.get(swept, 0)
    names = tuple(f"filter_{swept}={text}" for text in short_texts(places))
    return FilterBank(
        "filter", names if swept else ("filter",), places, swept, power,
        FormulaResponse(formula, each),
    )  # fmt: skip


@lru_cache(maxsize=64)
def _powers(formula: Formula) -> tuple[int, ...]:
    """Find `Formula.powers` by trial, at values of λ and all parameters near 1."""
    names, eigenvalues = formula.parameters, np.geomspace(0.03, 30.0, 301)
    values = np.array([1.0 + 0.37 * place for place in range(len(names))])
    here = formula.sampled(eigenvalues, dict(zip(names, values, strict=True)))

    def same(powers: tuple[int, ...]) -> float:
        scaled = values * _LARGER ** np.array(powers)
        there = formula.sampled(eigenvalues / _LARGER**2, dict(zip(names, scaled, strict=True)))
        return float(np.isclose(here, there, rtol=1e-9, atol=1e-300, equal_nan=True).mean())

    # max returns the first, most likely, of equally good combinations
    every = itertools.product(_POWERS, repeat=len(names))
    likeliest_first = sorted(every, key=lambda powers: sum(map(_POWERS.index, powers)))
    best = max(likeliest_first, key=same)
    return best if same(best) >= _MOSTLY else (0,) * len(names)


@lru_cache(maxsize=64)
def _parsed(text: str) -> ast.expr:
    """Return the syntax tree of a formula."""
    if not text.strip():
        raise InputError("unreadable-formula", "There is no formula", f"{_EXAMPLE}, with x for λ")
    if len(text) > MOST_CHARACTERS:
        fault = f"The formula is longer than {MOST_CHARACTERS} characters"
        raise InputError("unreadable-formula", fault, "shorten it")
    written = "".join(_WRITTEN.get(each, each) for each in text.strip())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(written, mode="eval").body
    except SyntaxError as fault:
        raise _unreadable(text, fault) from None
    except (ValueError, RecursionError, MemoryError):
        raise FormulaError(f"The formula {printable(text)} cannot be read", _EXAMPLE) from None


def _unreadable(text: str, fault: SyntaxError) -> FormulaError:
    """Return the error of a text that Python cannot parse, with its position and a remedy."""
    if fault.offset:
        position = _position(text, len((fault.text or "")[: fault.offset - 1].encode()))
    else:  # the formula is incomplete
        position = len(text.rstrip()) - 1
    position, remedy = next(_slips(text), (position, _EXAMPLE))
    where = f"cannot be read at character {position + 1}"
    return FormulaError(f"The formula {printable(text)} {where}", remedy, position)


#: Names to use in place of words that Python reserves.
_INSTEAD = {"lambda": "x for λ"}


def _slips(text: str) -> Iterator[tuple[int, str]]:
    """Yield positions, and remedies, of unmatched brackets, missing signs and reserved words."""
    opened: list[int] = []
    before = ""
    for token in _TOKEN.finditer(text):
        word, at = token.group(), token.start()
        if keyword.iskeyword(word) and word not in _WORDS:
            yield at, f"{word} is a reserved word, so write {_INSTEAD.get(word, 'another name')}"
        begins = word not in _WORDS and (word[0].isalnum() or word == "(")
        called = word == "(" and before[:1].isalpha()
        if _ends_value(before) and begins and not called:
            yield at, f"write a sign such as * between {before} and {word}"
        if word == "(":
            opened.append(at)
        elif word == ")" and not opened:
            yield at, "this bracket closes none, so remove it"
        elif word == ")":
            opened.pop()
        before = word
    if opened:
        yield opened[-1], "this bracket is not closed, so add )"


def _ends_value(token: str) -> bool:
    return token == ")" or (token[:1].isalnum() and token not in _WORDS)


def _position(text: str, column: int) -> int:
    """Convert a byte offset in the parsed text to the index of a character of `text`."""
    start = len(text) - len(text.lstrip())
    sizes = (len(_WRITTEN.get(each, each).encode()) for each in text[start:])
    ends = itertools.accumulate(sizes)
    return start + sum(end <= column for end in ends)


def _checked(node: ast.expr, depth: int) -> None:
    """Raise `_NotAllowed` for syntax that is not allowed, `InputError` for deep nesting."""
    if depth > _DEEPEST:
        fault = f"The formula is nested deeper than {_DEEPEST} levels"
        raise InputError("unreadable-formula", fault, "simplify it")
    for part in _parts(node):
        _checked(part, depth + 1)


def _parts(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the children of a node; raise `_NotAllowed` if its syntax is not allowed."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if not abs(value) < _LARGEST:
                raise _NotAllowed(node, "the number is too large")
        case ast.Name():
            if node.id in FUNCTIONS:
                raise _NotAllowed(node, f"{node.id} is a function: write {node.id}(…)")
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
                raise _NotAllowed(node, f"{name} takes {count} value{'s' * (count > 1)}")
            yield from node.args
        case ast.Call(func=ast.Name(id=name)):
            raise _NotAllowed(
                node, f"{name} is not a function; functions are {', '.join(FUNCTIONS)}"
            )
        case _:
            raise _NotAllowed(node, "use only numbers, names, + - * / ^, comparisons and functions")


def _value(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """Evaluate a node; return an array or a number."""
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
    """Convert booleans to 1 and 0."""
    return np.asarray(value, np.float64)
