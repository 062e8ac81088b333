"""Parameters of fields, shapes and sessions, each declared once.

A declaration is the default of a field of a frozen dataclass::

    time: float | None = parameter(
        None, Number(ABOVE_ZERO), power=2, option="time", help="diffusion time (unit²)"
    )

The check of a session entry, the option of the command line and the control in the window are made
from the declaration.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_whole

#: Largest index or count, a 32-bit integer as in the fields of the window.
MOST_INDEX = 2**31 - 1
#: Maximum length of a name from a file, which may be a sentence or a path.
MOST_NAME = 100_000
#: Smallest positive number.
ABOVE_ZERO = 1e-300
#: Maximum length of a value quoted in a message.
_SHOWN = 40


class Refused(ValueError):
    """Error for an invalid value, with a description of valid values: "a number from 1 to 4".

    `place` is the path of the invalid value within the checked value: ".limits.low".
    """

    def __init__(self, expected: str, value: object, place: str = "") -> None:
        super().__init__(expected)
        self.expected = expected
        self.value = value
        self.place = place


def checked_entry(check: Callable[[object], Any], value: object, path: Path, entry: str) -> Any:
    """Convert an entry of a file.

    `InputError` is raised for an invalid value; the message names file, entry and value.
    """
    try:
        return check(value)
    except Refused as refused:
        try:
            shown = json.dumps(refused.value, ensure_ascii=False)
        except (TypeError, ValueError):
            shown = type(refused.value).__name__
        raise InputError(
            f"{path.name} has {entry}{refused.place} = {printable(shown, _SHOWN)}, which should be "
            f"{refused.expected}: correct that entry, or open another file."
        ) from refused


def _within(check: Callable[[object], Any], value: object, place: str) -> Any:
    """Check a part of a value, and prepend its place to the path of an error."""
    try:
        return check(value)
    except Refused as refused:
        raise Refused(refused.expected, refused.value, place + refused.place) from None


# -- kinds of values --------------------------------------------------------------------------


class Kind:
    """Type and range of a value. Calling it converts a value from JSON, or raises `Refused`."""

    def __call__(self, value: object) -> Any:
        raise NotImplementedError

    def plain(self, value: Any) -> Any:
        """Convert a value to JSON types."""
        return value


class Flag(Kind):
    """True or false."""

    def __call__(self, value: object) -> bool:
        if not isinstance(value, bool):
            raise Refused("true or false", value)
        return value


@dataclass(frozen=True)
class Whole(Kind):
    """A whole number within bounds, both included; 50.0 is accepted."""

    least: int = 0
    most: int = MOST_INDEX

    def __call__(self, value: object) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        known = isinstance(value, int) and not isinstance(value, bool)
        if not known or not self.least <= value <= self.most:  # type: ignore[operator]
            raise Refused(f"a whole number from {self.least} to {self.most}", value)
        return int(value)  # type: ignore[call-overload,no-any-return]


@dataclass(frozen=True)
class Number(Kind):
    """A finite number within bounds, both included."""

    least: float = -1e300
    most: float = 1e300

    def __call__(self, value: object) -> float:
        known = isinstance(value, int | float) and not isinstance(value, bool)
        if not known or not self.least <= value <= self.most:  # type: ignore[operator]
            bounded = self != Number()
            bounds = f"a number from {self.least:g} to {self.most:g}"
            raise Refused(bounds if bounded else "a finite number", value)
        return float(value)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Text(Kind):
    """A text that can also be a file name, and for which `check` does not raise `ValueError`.

    `expected` describes texts that `check` accepts; by default, messages contain its error.
    """

    most: int = 4096
    check: Callable[[str], object] = str
    expected: str = ""

    def __call__(self, value: object) -> str:
        try:
            fits = isinstance(value, str) and len(value) <= self.most
            fits = fits and b"\0" not in os.fsencode(str(value))
        except UnicodeEncodeError:
            fits = False
        if not fits:
            raise Refused(f"a text of at most {self.most} characters", value)
        try:
            self.check(str(value))
        except ValueError as fault:
            wanted = self.expected or f"a valid text, but: {str(fault).rstrip('.')}"
            raise Refused(wanted, value) from fault
        return str(value)


@dataclass(frozen=True)
class Choice(Kind):
    """A key of `labels`; `named` describes the keys in messages if they are too many to list."""

    labels: Mapping[str, Any]
    named: str = ""

    def __call__(self, value: object) -> str:
        if not isinstance(value, str) or value not in self.labels:
            raise Refused(self.named or " or ".join(f'"{each}"' for each in self.labels), value)
        return value


@dataclass(frozen=True)
class Listing(Kind):
    """A list of `least` to `most` values, all `different` if requested, converted to `into`."""

    kind: Callable[[object], Any]
    most: int
    least: int = 0
    into: type[list[Any]] | type[frozenset[Any]] | type[tuple[Any, ...]] = list
    different: bool = False

    def __call__(self, value: object) -> Any:
        least, most = self.least, self.most
        if not isinstance(value, list) or not least <= len(value) <= most:
            some = f"{least}" if least == most else f"at most {most}"
            raise Refused(f"a list of {some} values", value)
        taken = [_within(self.kind, each, f"[{at}]") for at, each in enumerate(value)]
        if self.different and len(set(taken)) < len(taken):
            raise Refused("a list without repeated values", value)
        return self.into(taken)

    def plain(self, value: Any) -> list[Any]:
        return sorted(value) if self.into is frozenset else list(value)


@dataclass(frozen=True)
class Named(Kind):
    """A JSON object with any names, converted to pairs of name and value."""

    kind: Kind
    most: int

    def __call__(self, value: object) -> tuple[tuple[str, Any], ...]:
        if not isinstance(value, dict) or len(value) > self.most:
            raise Refused(f"an object with at most {self.most} entries", value)
        return tuple(Record(dict.fromkeys(value, self.kind))(value).items())

    def plain(self, value: Any) -> dict[str, Any]:
        return dict(value)


@dataclass(frozen=True)
class Record(Kind):
    """A JSON object; entries may be missing unless `required`, unknown entries are ignored."""

    kinds: Mapping[str, Callable[[object], Any]]
    required: bool = False

    def __call__(self, value: object) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise Refused("an object", value)
        for name in self.kinds:
            if self.required and name not in value:
                raise Refused(f"an object with {name}", value)
        known = ((name, kind) for name, kind in self.kinds.items() if name in value)
        return {name: _within(kind, value[name], f".{name}") for name, kind in known}


def in_order(taken: Mapping[str, Any], low: str, high: str, value: object) -> None:
    """Raise `Refused` if the entry `low` is not less than the entry `high`."""
    first, second = taken.get(low), taken.get(high)
    if first is not None and second is not None and not first < second:
        raise Refused(f"an object with {low} below {high}", value)


def _read_number(kind: Number, text: str) -> float:
    """Convert the text of an option; `InputError` is raised if it is not a number in bounds."""
    value = parse_number(text)
    try:
        return kind(value)
    except Refused as refused:
        raise InputError(
            f"the value is {refused.expected}, not {printable(text, _SHOWN)}."
        ) from None


# -- declarations -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """Declaration of a parameter."""

    #: Type and range.
    kind: Kind
    #: Whether the value may be None, to be determined by the spectrum.
    optional: bool = False
    #: Unit as a power of length.
    power: int = 0
    #: Whether the value is a vertex or several vertices.
    vertex: bool = False
    #: Whether session files contain the parameter.
    saved: bool = True
    #: Option of the command line, with underscores; "t_min" is given as ``--t-min``. Families may
    #: share an option. Empty for none.
    option: str = ""
    #: Description of the option.
    help: str = ""
    #: Placeholder of the value of the option.
    metavar: str | None = None
    #: Values that the option allows; empty for all.
    offered: tuple[str, ...] = ()
    #: Text and description of its control; empty without one.
    text: str = ""
    tip: str = ""
    #: Object name of the control, if it is not made from the names of family and parameter.
    control: str = ""

    @property
    def flag(self) -> str:
        """The option as typed on the command line."""
        return f"--{self.option.replace('_', '-')}"

    @property
    def many(self) -> bool:
        """Whether the option may be given several times."""
        return isinstance(self.kind, Listing | Named)

    @property
    def choices(self) -> tuple[str, ...] | None:
        """Allowed values of the option; None for any."""
        return self.offered or (tuple(self.kind.labels) if isinstance(self.kind, Choice) else None)

    @property
    def parse(self) -> Callable[[str], Any]:
        """Function that parses the text of the option; units of quantities are converted later."""
        if self.power:
            return partial(parse_quantity, power=self.power)
        kind = self.kind.kind if isinstance(self.kind, Listing) else self.kind
        if isinstance(kind, Whole):
            return partial(parse_whole, least=kind.least, most=kind.most, noun="the value")
        return partial(_read_number, kind) if isinstance(kind, Number) else str

    def check(self, value: object) -> Any:
        """Convert a value from JSON, or raise `Refused`."""
        if value is None and self.optional:
            return None
        try:
            return self.kind(value)
        except Refused as refused:
            if not self.optional or refused.place:
                raise
            raise Refused(f"null or {refused.expected}", value) from None


def parameter(default: Any, kind: Kind, **about: Any) -> Any:
    """Declare a parameter as the default of a field; `about` are fields of `Parameter`."""
    declared = Parameter(kind, optional=default is None, **about)
    if callable(default):
        return field(default_factory=default, metadata={"parameter": declared})
    return field(default=default, metadata={"parameter": declared})


class Parameters:
    """Base class of frozen dataclasses whose fields are parameters."""

    @classmethod
    def declared(cls) -> dict[str, Parameter]:
        """Return the declarations by name."""
        return {
            each.name: each.metadata["parameter"]
            for each in fields(cls)  # type: ignore[arg-type]
            if each.metadata
        }

    @classmethod
    def entries(cls) -> Record:
        """Return the check of a JSON object of saved parameters, any of which may be missing."""
        return Record({name: each.check for name, each in cls.declared().items() if each.saved})

    def plain(self) -> dict[str, Any]:
        """Convert the saved parameters to JSON types."""
        return {
            name: None if getattr(self, name) is None else each.kind.plain(getattr(self, name))
            for name, each in self.declared().items()
            if each.saved
        }

    def at_vertices(self, vertex: Callable[[int], int | None]) -> Self:
        """Replace each vertex by the result of a function; None removes the vertex."""

        def moved(at: Any) -> Any:
            if isinstance(at, tuple):
                return tuple(there for each in at if (there := vertex(each)) is not None)
            return None if at is None else vertex(at)

        vertices = (name for name, each in self.declared().items() if each.vertex)
        found: dict[str, Any] = {name: moved(getattr(self, name)) for name in vertices}
        return replace(self, **found)  # type: ignore[type-var]
