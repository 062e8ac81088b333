"""What the entries of a JSON file may be: types, bounds, and what to say of one that is neither.

A check is a function that takes what was read and gives back what it means, or raises `Refused`::

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

#: Indices and counts are whole numbers of 32 bits, as the window's fields are.
MOST_INDEX = 2**31 - 1
#: Characters of a name out of a file, which may be a sentence or a whole path.
MOST_NAME = 100_000
#: Characters of a value that a sentence repeats.
_SHOWN = 40


class Refused(ValueError):
    """A value that is not what its place is for.

    Parameters
    ----------
    expected : str
        What it should be: "a whole number from 1 to 1024".
    value : object
        What it is.
    place : str
        Where within the value that was checked: ".limits.low".
    """

    def __init__(self, expected: str, value: object, place: str = "") -> None:
        super().__init__(expected)
        self.expected = expected
        self.value = value
        self.place = place

    def within(self, place: str) -> Refused:
        """The same, told from one level further out."""
        return Refused(self.expected, self.value, place + self.place)


def understood(check: Check, value: object, path: Path, entry: str) -> Any:
    """What an entry of a file means.

    Raises
    ------
    InputError
        If it is not what it should be; the sentence names the file, the entry and its value.
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
            f"{refused.expected}: mend that entry, or open another file."
        ) from refused


def flag(value: object) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise Refused("true or false", value)
    return value


def whole(least: int, most: int) -> Check:
    """A whole number within bounds, both included; 50.0 is one, as some programs write it."""

    def check(value: object) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise Refused(f"a whole number from {least} to {most}", value)
        return value

    return check


def number(least: float = -1e300, most: float = 1e300) -> Check:
    """A finite number within bounds, both included."""
    bounds = f"from {least:g} to {most:g}"
    expected = "a finite number" if (least, most) == (-1e300, 1e300) else f"a number {bounds}"

    def check(value: object) -> float:
        known = isinstance(value, int | float) and not isinstance(value, bool)
        if not known or not least <= value <= most or not math.isfinite(value):  # type: ignore[operator,arg-type]
            raise Refused(expected, value)
        return float(value)  # type: ignore[arg-type]

    return check


def text(most: int = 4096) -> Check:
    """A text that can be the name of a file, too."""

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
    """A text that `sound` has nothing against, which raises `InputError` if it has."""
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
    """One of some texts; `named` says what they are where there are too many to list."""
    known = tuple(values)
    expected = named or " or ".join(f'"{each}"' for each in known)

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in known:
            raise Refused(expected, value)
        return value

    return check


def none_or(check: Check) -> Check:
    """Null, or what another check takes."""

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
    """A list of so many values; `different` says that none comes twice."""
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
            raise Refused("a list in which no value comes twice", value)
        return taken

    return each


def named(check: Check, most: int) -> Check:
    """An object with so many entries of any names, as pairs of name and value."""

    def entries(value: object) -> tuple[tuple[str, Any], ...]:
        if not isinstance(value, dict) or len(value) > most:
            raise Refused(f"an object with at most {most} entries", value)
        taken = record(dict.fromkeys(value, check))(value)
        return tuple(taken.items())

    return entries


def record(checks: Mapping[str, Check], *, whole: bool = False) -> Check:
    """An object with some entries; those that it has not are left out, unknown ones passed over.

    `whole` says that it has all of them.
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
