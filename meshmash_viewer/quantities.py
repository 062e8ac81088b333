"""Parsing of numbers with a unit.

The same notation is accepted in every field of the window and every option of the command line: a
decimal point or comma, thin spaces between groups of digits, a power of ten ("1e-5", "1×10⁻⁵") and
a power of a unit of length, which is converted ("0.5 µm", "3 µm⁻²"). A comma before three digits
is refused, because it may separate groups: "1,000"; so is a point in a whole number.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import TypeVar

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.units import (
    MESH_UNITS,
    METRES,
    UNIT_FORMS,
    Voxel,
    is_voxel,
    power_unit,
)

_T = TypeVar("_T")
#: Remedy, and sizes of voxels for messages.
_ALONE = "write the number alone"
_VOXELS = '"8 nm" or "4 x 4 x 40 nm"'
#: Maximum length of a text quoted in a message.
_SHOWN = 40
_SUPERSCRIPTS = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
#: Characters that are read as others, after normalisation (NFKC).
_READ_AS = str.maketrans({"\u2212": "-", "\u2013": "-", "μ": "µ", "×": "x"})
#: Thin spaces between groups.
_THIN = re.compile("(?<=[0-9])[\u2009\u202f](?=[0-9]{3}(?![0-9]))")
#: Number and unit, with single spaces.
_NUMBER = re.compile(
    r"(?:≈ )?(?P<digits>[+-]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+))"
    r"(?P<scale>(?:[eE]|x10\^)[+-]?[0-9]{1,3})?(?! ?[0-9.,]) ?(?P<unit>.*)"
)
#: Digits with a comma that may separate groups or decimals.
_EITHER = re.compile("[+-]?[1-9][0-9]{0,2},[0-9]{3}")
_GROUPS = re.compile("[1-9][0-9]{0,2}(,[0-9]{3})+")
_UNIT = re.compile(r"(?P<name>[^\W\d_]+) ?\^?(?P<power>[+-]?[0-9]+)?")
#: Separators of several numbers; "x10^-5" is part of a number.
_SEPARATOR = re.compile(r" ?(?:x(?!10\^)|;) ?|, | (?=[-+.0-9])")


@dataclass(frozen=True)
class Quantity:
    """A number to be converted to the unit of length of a mesh that has not been read yet."""

    value: Decimal
    #: Unit of the text, a name of `units.METRES`; empty for none.
    unit: str
    #: Power of the length.
    power: int
    #: The original text.
    text: str

    def in_unit(self, unit: str) -> float:
        """Convert the number to a unit of length; unchanged if the text has no unit.

        `InputError` is raised if the text has a unit and `unit` is empty.
        """
        if self.unit and not unit:
            remedy = "write the number alone, or set the unit of the mesh"
            raise InputError("no-unit", f"{self.text} has a unit, and the mesh has none", remedy)
        shift = self.power * (METRES[self.unit] - METRES[unit]) if self.unit else 0
        return _float(self.value.scaleb(shift), self.text)


def parse_number(text: str, unit: str = "", *, share: bool = False, whole: bool = False) -> float:
    """Read a number in a unit.

    `unit` is the unit of the result: a power of a length as written by `units.power_unit` ("nm",
    "nm²", "nm⁻²"), to which other lengths are converted, or any text, such as "mV", that may follow
    the number; empty if unknown. With `share` the number may be in percent: "0.1 %" is 0.001.
    With `whole`, commas between groups are read, as the program writes them, and a point before
    three digits is refused. `InputError` is raised if the text is not a number, is ambiguous, out
    of the range of floats, or in another unit.

    Examples
    --------
    >>> parse_number("0.5 µm", "nm")
    500.0
    >>> parse_number("1234,5")
    1234.5
    """
    value, written = _split(text, whole=whole)
    if share and written == "%":
        return _float(value.scaleb(-2), text)
    if not written or written == _plain(unit):
        return _float(value, text)
    if _length_power(written) is None:
        raise _no_unit(text, written)
    expected = _length_power(_plain(unit))
    if expected is None:
        known = f"this is in {unit}" if unit else "none is known here"
        raise InputError("no-unit", f"{_shown(text)} has a unit, and {known}", _ALONE)
    return _quantity(value, written, expected[1], text).in_unit(expected[0])


def parse_quantity(text: str, power: int = 1) -> Quantity:
    """Read a number whose unit, a power of a length, is converted later.

    `InputError` is raised if the text is not a number, is ambiguous, or in a unit of another power.

    Examples
    --------
    >>> parse_quantity("20 um^2", 2).in_unit("nm")
    20000000.0
    """
    return _quantity(*_split(text), power, text)


def parse_whole(text: str, least: int, most: int, noun: str) -> int:
    """Read a whole number from `least` to `most`.

    `InputError` is raised if the text is not a whole number, ambiguous, or out of bounds; its
    message begins with `noun`: "The number of times".

    Examples
    --------
    >>> parse_whole("1,234", 0, 2000, "The index")
    1234
    """
    allowed = f"{noun} is a whole number from {least:,} to {most:,}"
    try:
        value = parse_number(text, whole=True)
    except InputError:
        given = _shown(text) if text.strip() else "empty"
        raise InputError("not-a-number", f"{allowed}, not {given}") from None
    if not (value.is_integer() and least <= value <= most):
        raise InputError("out-of-range", f"{allowed}, not {_shown(text)}")
    return int(value)


def parse_several(
    text: str, count: int, parse: Callable[[str], _T], example: str
) -> tuple[_T, ...]:
    """Read `count` values, separated by spaces, "×", ";" or a comma and a space, each by `parse`.

    A unit after the last value is the unit of all values without one. `InputError` is raised if the
    text is not `count` values, with an `example`, or a value is ambiguous.

    Examples
    --------
    >>> parse_several("4, 4, 40", 3, parse_number, "4 4 40")
    (4.0, 4.0, 40.0)
    >>> [each.in_unit("nm") for each in parse_several("1 x 2 µm", 2, parse_quantity, "1 x 2")]
    [1000.0, 2000.0]
    """
    numbers, unit = re.fullmatch(r"(.*?) ?([^\W\dx_]*)", _plain(text)).groups()  # type: ignore[union-attr]
    parts = _SEPARATOR.split(numbers)
    if len(parts) != count:
        what, remedy = f"{_shown(text)} is not {count} numbers", f"write them like {example}"
        raise InputError("not-a-number", what, remedy)
    return tuple(parse(f"{part} {unit}" if not part[-1:].isalpha() else part) for part in parts)


def parse_voxel(text: str) -> tuple[Voxel, str]:
    """Read the size of a voxel, one number or three, as `parse_unit` but with or without a unit.

    Examples
    --------
    >>> parse_voxel("4x4x40"), parse_voxel("8 nm")
    (((4.0, 4.0, 40.0), ''), ((8.0, 8.0, 8.0), 'nm'))
    """
    sizes: tuple[Quantity, ...]
    try:
        sizes = (parse_quantity(text),) * 3
    except InputError as fault:
        if fault.code == "ambiguous-number":
            raise
        sizes = parse_several(text, 3, parse_quantity, _VOXELS)
    name = sizes[-1].unit
    factor, unit = MESH_UNITS[name]
    x, y, z = (factor * size.in_unit(name) for size in sizes)
    if not is_voxel((x, y, z)):
        remedy = f"give positive sizes such as {_VOXELS}"
        raise InputError("out-of-range", f"{_shown(text)} is no voxel", remedy)
    return (x, y, z), unit


def parse_unit(text: str) -> tuple[Voxel, str]:
    """Read a unit such as "nm", "none" or, for voxel coordinates, "8 nm" or "4 × 4 × 40 nm".

    The voxel size is one number, or three along x, y and z. Returns the factors that convert
    coordinates to the unit (`NO_VOXEL` without a voxel size) and the unit, one of `LENGTH_UNITS`;
    "cm" is a voxel of 10 mm. `InputError` is raised if the text is not a unit, or the size is
    ambiguous or not positive.

    Examples
    --------
    >>> parse_unit("8,5 nm")
    ((8.5, 8.5, 8.5), 'nm')
    """
    plain = _plain(str(text))
    if plain in MESH_UNITS:
        factor, unit = MESH_UNITS[plain]
        return (factor, factor, factor), unit
    try:
        voxel, unit = parse_voxel(str(text))
    except InputError as fault:
        if fault.code == "ambiguous-number":
            raise
        unit = ""
    if not unit:
        what = f"{text!r} is not a length unit"
        raise InputError("wrong-unit", what, f"give {UNIT_FORMS}") from None
    return voxel, unit


def _split(text: str, *, whole: bool = False) -> tuple[Decimal, str]:
    """Split a text into the number at its beginning, and the rest."""
    plain = _plain(text)
    if whole:
        plain = plain.replace(",", "") if _GROUPS.fullmatch(plain) else plain.replace(".", ",")
    match = _NUMBER.fullmatch(plain)
    if match is None:
        raise _no_number(text)
    digits, scale = match["digits"], (match["scale"] or "").replace("x10^", "e")
    if _EITHER.fullmatch(digits):
        thousands, decimal = digits.replace(",", ""), float(digits.replace(",", "."))
        what = f"{_shown(text)} may be {thousands}{scale} or {decimal}{scale}"
        raise InputError("ambiguous-number", what, "write it like one of these")
    return Decimal(digits.replace(",", ".") + scale), match["unit"]


def _plain(text: str) -> str:
    """Normalise a text: single spaces, none between groups, superscripts after "^"."""
    text = _THIN.sub("", text)
    text = re.sub("[⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"^{found[0].translate(_SUPERSCRIPTS)}", text)
    return " ".join(unicodedata.normalize("NFKC", text).translate(_READ_AS).split())


def _length_power(unit: str) -> tuple[str, int] | None:
    """Return length and power of a unit; None if it is not a power of length."""
    match = _UNIT.fullmatch(unit)
    if match is None or match["name"] not in METRES:
        return None
    return match["name"], int(match["power"] or 1)


def _quantity(value: Decimal, written: str, power: int, text: str) -> Quantity:
    found = _length_power(written) if written else ("", power)
    if found is None:
        raise _no_unit(text, written)
    name, own = found
    if own != power:
        right = power_unit(name.replace("um", "µm"), power)
        remedy = f"write it in {right}" if power else _ALONE
        raise InputError("wrong-unit", f"{_shown(text)} is in another unit", remedy)
    return Quantity(value, name, power, text.strip())


def _float(value: Decimal, text: str) -> float:
    number = float(value)
    if not math.isfinite(number) or (number == 0.0) != (value == 0):
        raise _no_size(text)
    return number


def _no_size(text: str) -> InputError:
    what = f"{_shown(text)} is too large or too small"
    return InputError("out-of-range", what, "write a number such as 3.1e5")


def _no_number(text: str) -> InputError:
    return InputError("not-a-number", f"{_shown(text)} is not a number", "write 3.1e5")


def _no_unit(text: str, written: str) -> InputError:
    if not _UNIT.fullmatch(written):
        return _no_number(text)
    return InputError("wrong-unit", f"{_shown(text)} is in a unit that is not known", _ALONE)


def _shown(text: str) -> str:
    return printable(text.strip(), _SHOWN) or "Nothing"
