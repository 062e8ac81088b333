"""Checks of JSON values: types, bounds, and error messages.

A check is a function that converts a value that was read, or raises `Refused`::

    point = record({"x": number(0.0, 1.0), "kind": choice(["a", "b"])})
    point({"x": 0.5, "kind": "a"})
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from meshmash_viewer.errors import InputError, printable

Check: TypeAlias = Callable[[Any], Any]

#: Largest index or count, a 32-bit integer as in the fields of the window.
MOST_INDEX = 2**31 - 1
#: Maximum length of a name from a file, which may be a sentence or a path.
MOST_NAME = 100_000
#: Maximum length of a value quoted in a message.
_SHOWN = 40


class Refused(ValueError):
    """A value that is not valid.

    Parameters
    ----------
    expected : str
        Description of valid values: "a whole number from 1 to 1024".
    value : object
        The value.
    place : str
        Path within the checked value: ".limits.low".
    """

    def __init__(self, expected: str, value: object, place: str = "") -> None:
        super().__init__(expected)
        self.expected = expected
        self.value = value
        self.place = place

    def within(self, place: str) -> Refused:
        """Prepend to the path."""
        return Refused(self.expected, self.value, place + self.place)


def understood(check: Check, value: object, path: Path, entry: str) -> Any:
    """Convert an entry of a file.

    Raises
    ------
    InputError
        If it is not valid; the message names the file, the entry and its value.
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


def flag(value: object) -> bool:
    """Check for true or false."""
    if not isinstance(value, bool):
        raise Refused("true or false", value)
    return value


def whole(least: int, most: int) -> Check:
    """Make a check for a whole number within bounds, both included; 50.0 is accepted."""

    def check(value: object) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise Refused(f"a whole number from {least} to {most}", value)
        return value

    return check


def number(least: float = -1e300, most: float = 1e300) -> Check:
    """Make a check for a finite number within bounds, both included."""
    bounds = f"from {least:g} to {most:g}"
    expected = "a finite number" if (least, most) == (-1e300, 1e300) else f"a number {bounds}"

    def check(value: object) -> float:
        known = isinstance(value, int | float) and not isinstance(value, bool)
        if not known or not least <= value <= most or not math.isfinite(value):  # type: ignore[operator,arg-type]
            raise Refused(expected, value)
        return float(value)  # type: ignore[arg-type]

    return check


def text(most: int = 4096) -> Check:
    """Make a check for a text that can also be a file name."""

    def check(value: object) -> str:
        try:
            fits = isinstance(value, str) and len(value) <= most and b"\0" not in os.fsencode(value)
        except UnicodeEncodeError:
            fits = False
        if not fits:
            raise Refused(f"a text of at most {most} characters", value)
        return str(value)

    return check


def checked_text(most: int, sound: Callable[[str], object]) -> Check:
    """Make a check for a text for which `sound` does not raise `InputError`."""
    short = text(most)

    def check(value: object) -> str:
        taken: str = short(value)
        try:
            sound(taken)
        except InputError as fault:
            raise Refused(f"another one, as this fails: {str(fault).rstrip('.')}", value) from fault
        return taken

    return check


def choice(values: Iterable[str], named: str = "") -> Check:
    """Make a check for one of some texts; `named` describes them if they are too many."""
    known = tuple(values)
    expected = named or " or ".join(f'"{each}"' for each in known)

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in known:
            raise Refused(expected, value)
        return value

    return check


def none_or(check: Check) -> Check:
    """Make a check for null, or what another check accepts."""

    def either(value: object) -> Any:
        if value is None:
            return None
        try:
            return check(value)
        except Refused as refused:
            expected = refused.expected if refused.place else f"null or {refused.expected}"
            raise Refused(expected, refused.value, refused.place) from None

    return either


def listing(check: Check, most: int, least: int = 0, *, different: bool = False) -> Check:
    """Make a check for a list of `least` to `most` values, which may have to be `different`."""
    expected = f"a list of {least} values" if least == most else f"a list of at most {most} values"

    def each(value: object) -> list[Any]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise Refused(expected, value)
        taken = []
        for at, item in enumerate(value):
            try:
                taken.append(check(item))
            except Refused as refused:
                raise refused.within(f"[{at}]") from None
        if different and len(set(taken)) < len(taken):
            raise Refused("a list without repeated values", value)
        return taken

    return each


def named(check: Check, most: int) -> Check:
    """Make a check for an object with entries of any name; return pairs of name and value."""

    def entries(value: object) -> tuple[tuple[str, Any], ...]:
        if not isinstance(value, dict) or len(value) > most:
            raise Refused(f"an object with at most {most} entries", value)
        taken = record(dict.fromkeys(value, check))(value)
        return tuple(taken.items())

    return entries


def record(checks: Mapping[str, Check], *, whole: bool = False) -> Check:
    """Make a check for an object; missing entries are left out, unknown ones ignored.

    With `whole` all entries are required.
    """

    def entries(value: object) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise Refused("an object", value)
        taken = {}
        for name, check in checks.items():
            if name not in value:
                if whole:
                    raise Refused(f"an object with {name}", value)
                continue
            try:
                taken[name] = check(value[name])
            except Refused as refused:
                raise refused.within(f".{name}") from None
        return taken

    return entries
