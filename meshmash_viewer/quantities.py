"""Parsing of numbers with a unit.

The same notation is accepted in every field of the window and every option of the command line: a
decimal point or comma, spaces between groups of three digits, a power of ten ("1e-5", "1×10⁻⁵") and
a power of a unit of length, which is converted ("0.5 µm", "3/µm²"). Commas between groups are read
where they cannot be decimal commas: in a whole number, if there are several, and before a decimal
point. "1,000" is refused elsewhere, and so is "1.000" for a whole number.
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
#: Remedies, and sizes of voxels for messages.
_ALONE, _EITHER_FORM = "write the number alone", "write it like one of these"
_VOXELS = '"8 nm" or "4 x 4 x 40 nm"'
#: Maximum length of a text quoted in a message, and of a number.
_SHOWN, _LONGEST = 40, 100
#: Largest exponent; larger exponents are out of the range of floats.
_LARGEST_POWER = 1000
_SUPERSCRIPTS = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
#: Characters that are read as others, after normalisation (NFKC).
_READ_AS = str.maketrans({"\u2212": "-", "\u2013": "-", "μ": "µ", "×": "x"})
#: Number and unit, with single spaces.
_NUMBER = re.compile(
    r"≈? ?(?P<sign>[+-]?)(?:10\^(?P<alone>[+-]?[0-9]+)|(?P<digits>[0-9.,](?:[0-9.,]| (?=[0-9]))*)"
    r"(?:[eE](?P<exponent>[+-]?[0-9]+)| ?x ?10\^(?P<times>[+-]?[0-9]+))?) ?(?P<unit>.*)"
)
#: Digits with one mark that may separate groups or decimals.
_EITHER = re.compile(r"[1-9][0-9]{0,2}[.,][0-9]{3}")
_COMMAS = re.compile(r"[1-9][0-9]{0,2}(,[0-9]{3})+(\.[0-9]*)?")
_SPACES = re.compile(r"[1-9][0-9]{0,2}( [0-9]{3})+([.,][0-9]*)?")
_UNIT = re.compile(r"(?P<per>/ ?)?(?P<name>[^\W\d_]+) ?\^?(?P<power>[+-]?[0-9]+)?")
#: Separators of several numbers, in the order in which they are tried.
_SEPARATORS = (" ?[x;] ?", " ?, ?", " ")


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


class AmbiguousError(InputError):
    """A text that may be two different numbers."""


def parse_number(text: str, unit: str = "", *, share: bool = False, whole: bool = False) -> float:
    """Read a number in a unit.

    `unit` is the unit of the result: a power of a length as written by `units.power_unit` ("nm",
    "nm²", "nm⁻²"), to which other lengths are converted, or any text, such as "mV", that may follow
    the number; empty if unknown. With `share` the number may be in percent: "0.1 %" is 0.001. With
    `whole` a comma before three digits separates groups. `InputError` is raised if the text is not
    a number, is ambiguous, out of the range of floats, or in another unit.

    Examples
    --------
    >>> parse_number("0.5 µm", "nm")
    500.0
    >>> parse_number("1 234,5")
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
    value, written = _split(text)
    if written:
        return _quantity(value, written, power, text)
    return Quantity(value, "", power, text.strip())


def parse_whole(text: str, least: int, most: int, noun: str) -> int:
    """Read a whole number from `least` to `most`.

    `InputError` is raised if the text is not a whole number, out of bounds, or ambiguous. Its
    message begins with `noun`: "The number of times".

    Examples
    --------
    >>> parse_whole("1,234", 0, 2000, "The index")
    1234
    """
    allowed = f"{noun} is a whole number from {least:,} to {most:,}"
    try:
        value, written = _split(text, whole=True)
    except AmbiguousError as fault:
        raise InputError(fault.code, f"{allowed}: {fault.fault}", fault.remedy) from None
    except InputError:
        given = _shown(text) if text.strip() else "empty"
        raise InputError("not-a-number", f"{allowed}, not {given}") from None
    if written or value != value.to_integral_value() or not least <= value <= most:
        raise InputError("out-of-range", f"{allowed}, not {_shown(text)}")
    return int(value)


def parse_several(
    text: str, count: int, parse: Callable[[str], _T], example: str
) -> tuple[_T, ...]:
    """Read `count` values with one separator, each by `parse`.

    A unit after the last value is the unit of all values without one. `InputError` is raised if the
    text is not `count` values, with an `example`, or a value is ambiguous.

    Examples
    --------
    >>> parse_several("4, 4, 40", 3, parse_number, "4 4 40")
    (4.0, 4.0, 40.0)
    >>> [each.in_unit("nm") for each in parse_several("1 x 2 µm", 2, parse_quantity, "1 x 2")]
    [1000.0, 2000.0]
    """
    what, remedy = f"{_shown(text)} is not {count} numbers", f"write them like {example}"
    fault = InputError("not-a-number", what, remedy)
    numbers, unit = re.fullmatch(r"(.*?) ?([^\W\dx_]*)", _plain(text)).groups()  # type: ignore[union-attr]
    for separator in _SEPARATORS:
        parts = re.split(separator, numbers)
        if len(parts) == count:
            try:
                return tuple(
                    parse(f"{part} {unit}".strip() if part[-1:].isdigit() else part)
                    for part in parts
                )
            except InputError as refused:
                fault = refused
    raise fault


def parse_voxel(text: str) -> tuple[Voxel, str]:
    """Read the size of a voxel, one number or three, as `parse_unit` but with or without a unit.

    Examples
    --------
    >>> parse_voxel("4x4x40"), parse_voxel("8 nm")
    (((4.0, 4.0, 40.0), ''), ((8.0, 8.0, 8.0), 'nm'))
    """
    ways: tuple[Callable[[], tuple[Quantity, ...]], ...] = (
        lambda: (parse_quantity(text),) * 3,
        lambda: parse_several(text, 3, parse_quantity, _VOXELS),
    )
    readings = list[tuple[Quantity, ...]]()
    for parse in ways:
        try:
            readings.append(parse())
        except InputError as refused:
            fault = refused
            if isinstance(refused, AmbiguousError):
                break
    if not readings:
        raise fault
    if len(readings) == 2:
        (one, *_), three = ([f"{size.value:f}" for size in each] for each in readings)
        unit = readings[0][0].unit
        what = f"{_shown(text)} may be a voxel of {' × '.join(three)} {unit} or of {one} {unit}"
        raise AmbiguousError("ambiguous-number", what, _EITHER_FORM)
    sizes = readings[0]
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
    except AmbiguousError:
        raise
    except InputError:
        unit = ""
    if not unit:
        what = f"{text!r} is not a length unit"
        raise InputError("wrong-unit", what, f"give {UNIT_FORMS}") from None
    return voxel, unit


def _split(text: str, *, whole: bool = False) -> tuple[Decimal, str]:
    """Split a text into the number at its beginning, and the rest."""
    plain = _plain(text)
    match = _NUMBER.fullmatch(plain) if len(plain) <= _LONGEST else None
    if match is None:
        raise _no_number(text)
    sign, digits = match["sign"], match["digits"] or "1"
    power = int(match["alone"] or match["exponent"] or match["times"] or 0)
    scale = f"e{power}" if power else ""
    if _EITHER.fullmatch(digits) and ("." if whole else ",") in digits:
        thousands, decimal = re.sub("[.,]", "", digits), float(digits.replace(",", "."))
        what = f"{_shown(text)} may be {sign}{thousands}{scale} or {sign}{decimal}{scale}"
        raise AmbiguousError("ambiguous-number", what, _EITHER_FORM)
    several = whole or "." in digits or digits.count(",") > 1
    if several and _COMMAS.fullmatch(digits):
        digits = digits.replace(",", "")
    elif _SPACES.fullmatch(digits):
        digits = digits.replace(" ", "")
    if not re.fullmatch("[0-9]+[.,]?[0-9]*|[.,][0-9]+", digits):
        raise _no_number(text)
    if abs(power) > _LARGEST_POWER:
        raise _no_size(text)
    return Decimal(f"{sign}{digits.replace(',', '.')}{scale}"), match["unit"]


def _plain(text: str) -> str:
    """Normalise a text: single spaces, superscripts after "^"."""
    text = re.sub("[⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"^{found[0].translate(_SUPERSCRIPTS)}", text)
    return " ".join(unicodedata.normalize("NFKC", text).translate(_READ_AS).split())


def _length_power(unit: str) -> tuple[str, int] | None:
    """Return length and power of a unit; None if it is not a power of length."""
    match = _UNIT.fullmatch(unit)
    if match is None or match["name"] not in METRES:
        return None
    power = int(match["power"] or 1)
    return match["name"], -power if match["per"] else power


def _quantity(value: Decimal, written: str, power: int, text: str) -> Quantity:
    found = _length_power(written)
    if found is None:
        raise _no_unit(text, written)
    name, own = found
    if own != power:
        right = power_unit(name.replace("um", "µm"), power)
        remedy = f"write it in {right}" if power else _ALONE
        what = f"{_shown(text)} is {_KINDS.get(own, 'in another unit')}"
        raise InputError("wrong-unit", what, remedy)
    return Quantity(value, name, power, text.strip())


_KINDS = {1: "a length", 2: "an area", -1: "an inverse length", -2: "an inverse area"}


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
