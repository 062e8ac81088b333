"""Parameters of fields, shapes and sessions, each declared once.

A declaration is the default of a field of a frozen dataclass::

    time: float | None = parameter(
        None, Positive, power=2, option="time", help="diffusion time (unit²)"
    )

The check of a session entry (by msgspec), the option of the command line and the control in the
window are made from the declaration.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, Optional, Self, TypedDict

import msgspec
from msgspec import Meta

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_whole

#: Largest index or count, a 32-bit integer as in the fields of the window.
MOST_INDEX = 2**31 - 1
#: Smallest and largest positive number.
ABOVE_ZERO, LARGEST = 1e-300, 1e300
#: Maximum length of a value quoted in a message.
_SHOWN = 40
#: Texts that can be a part of a file name.
_FILE_NAME = r"^[^\x00\ud800-\udc7f\udd00-\udfff]*\Z"

Index = Annotated[int, Meta(ge=0, le=MOST_INDEX)]
Finite = Annotated[float, Meta(ge=-LARGEST, le=LARGEST)]
NotNegative = Annotated[float, Meta(ge=0.0, le=LARGEST)]
Positive = Annotated[float, Meta(ge=ABOVE_ZERO, le=LARGEST)]
#: A number from 0 to 1.
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
#: A file or a short text, and a name from a file, which may be a sentence.
Text = Annotated[str, Meta(max_length=4096, pattern=_FILE_NAME)]
Name = Annotated[str, Meta(max_length=100_000, pattern=_FILE_NAME)]


class CheckedText(str):
    """Text for which `check` does not raise `ValueError`."""

    @staticmethod
    def check(text: str) -> object:
        raise NotImplementedError


def one_of(keys: Iterable[str]) -> Any:
    """Return the type of texts that are one of some keys."""
    return Literal[tuple(keys)]


def record(kinds: Mapping[str, Any]) -> Any:
    """Return the type of JSON objects whose entries may be missing; others are ignored."""
    return TypedDict("record", kinds, total=False)  # type: ignore[operator]


def checked_entry(kind: Any, value: object, path: Path, entry: str = "") -> Any:
    """Convert an entry of a file from JSON types to a type that msgspec knows.

    `InputError` is raised for an invalid value; the message names file, entry and fault.
    """
    try:
        return msgspec.convert(value, kind, dec_hook=_check_text)
    except msgspec.ValidationError as fault:
        text, _, place = str(fault).partition(" - at `$")
        text = text.partition(" matching regex")[0]
        place = (entry + place.rstrip("`")).lstrip(".")
        raise invalid_entry(path, place, text) from None


def invalid_entry(path: Path, entry: str, fault: str) -> InputError:
    """Return the error for an entry of a file."""
    about = f"{path.name} has an invalid {entry} ({printable(fault).rstrip('.')})"
    return InputError("invalid-entry", about, "correct that entry, or open another file")


def _check_text(kind: type[CheckedText], value: object) -> CheckedText:
    if not isinstance(value, str):
        raise ValueError(f"Expected `str`, got `{type(value).__name__}`")
    kind.check(value)
    return kind(value)


_type_info = cache(msgspec.inspect.type_info)


def _read_number(least: float, most: float, text: str) -> float:
    """Convert the text of an option; `InputError` is raised if it is not a number in bounds."""
    value = parse_number(text)
    if not least <= value <= most:
        bounds = f"a number from {least:g} to {most:g}"
        raise InputError("out-of-range", f"the value is {bounds}, not {printable(text, _SHOWN)}")
    return value


# -- declarations -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Parameter:
    """Declaration of a parameter."""

    #: Type and range, as msgspec knows them.
    kind: Any
    #: The keys that a text may be, with labels; None for all texts.
    labels: Mapping[str, Any] | None = None
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
        return hasattr(self.info, "item_type") or hasattr(self.info, "value_type")

    @property
    def choices(self) -> tuple[str, ...] | None:
        """Allowed values of the option; None for any."""
        return self.offered or (None if self.labels is None else tuple(self.labels))

    @property
    def parse(self) -> Callable[[str], Any]:
        """Function that parses the text of the option; units of quantities are converted later."""
        if self.power:
            return partial(parse_quantity, power=self.power)
        info: Any = getattr(self.info, "item_type", self.info)
        whole = isinstance(info, msgspec.inspect.IntType)
        if whole:
            return partial(parse_whole, least=info.ge, most=info.le, noun="the value")
        return partial(_read_number, info.ge, info.le) if hasattr(info, "ge") else str

    @property
    def info(self) -> Any:
        """Description of the type, such as ``IntType(ge=1, le=9)``."""
        return _type_info(self.kind)

    @property
    def entry(self) -> Any:
        """Type of the entry of a session."""
        kind = self.kind if self.labels is None else one_of(self.labels)
        return Optional[kind] if self.optional else kind  # noqa: UP045  a type made at run time


def parameter(default: Any, kind: Any, **about: Any) -> Any:
    """Declare a parameter as the default of a field; `about` are fields of `Parameter`."""
    declared = Parameter(kind, optional=default is None, **about)
    if callable(default):
        return field(default_factory=default, metadata={"parameter": declared})
    return field(default=default, metadata={"parameter": declared})


def _plain(value: Any, kind: msgspec.inspect.Type) -> Any:
    if isinstance(kind, msgspec.inspect.DictType):
        return dict(value)
    if isinstance(value, frozenset | tuple):
        return sorted(value) if isinstance(value, frozenset) else list(value)
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


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
    def entries(cls) -> dict[str, Any]:
        """Return the types of the saved parameters by name."""
        return {name: each.entry for name, each in cls.declared().items() if each.saved}

    def plain(self) -> dict[str, Any]:
        """Convert the saved parameters to JSON types."""
        return {
            name: _plain(getattr(self, name), each.info)
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
