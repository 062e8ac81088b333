"""Parsing of numbers with separators, exponents and units.

The same notation is accepted in every field of the window and every option of the command line:

* a decimal point or a decimal comma: "0.5", "0,5"
* groups of three digits with commas, points, spaces, apostrophes or underscores between them:
  "1 234", "1,234,567", "1.234,5"
* powers of ten: "1e-5", "1×10^-5", "10⁻⁵"
* a power of a unit of length, which is converted: "0.5 µm", "3/µm²"
* several numbers, with brackets or without, and a unit of all: "4 4 40", "[4, 4, 40] nm", "4x4x40"

A single comma before three digits is ambiguous, so "1,000" is refused, except for a whole number,
where it separates groups as in the output of this program. A single point is a decimal point; for a
whole number "1.000" is refused.
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
#: Sizes of voxels, for messages.
_VOXELS = '"8 nm" or "4 x 4 x 40 nm"'
#: Maximum length of a text quoted in a message, and of a number.
_SHOWN, _LONGEST = 40, 100
#: Largest exponent; larger exponents are out of the range of floats.
_LARGEST_POWER = 1000
_SUPERSCRIPTS = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
#: Typographic characters and their replacements.
_READ_AS = str.maketrans(
    {
        **dict.fromkeys("\u2212\u2010\u2011\u2012\u2013\ufe63\uff0d", "-"),
        **dict.fromkeys("\u2019\u2018\u02bc\uff07\u00b4\u0060\u066c", "'"),
        **dict.fromkeys("\u2715\u22c5\u00b7\u2219", "×"),
        **dict.fromkeys("\u2044\u2215", "/"),
        **dict.fromkeys("\u200b\u200e\u200f\u2060\ufeff", ""),
        "\uff0c": ",", "\uff0e": ".", "\u066b": ".", "\uff0b": "+", "\uff05": "%", "μ": "µ",
    }
)  # fmt: skip
_POWER_OF_TEN = r"10\ ?(?:\^|\*\*)\ ?\(?(?P<{}>[+-]?[0-9]+)\)?"
#: Number with unit, with single spaces; a space before "1/" ends the number: "2 1/µm²".
_NUMBER = re.compile(
    r"[≈~]?\ ?(?P<sign>[+-]?)\ ?(?:"
    + _POWER_OF_TEN.format("alone")
    + r"|(?P<digits>[.,]?[0-9](?:[0-9]|[.,'_](?=[0-9])|\ (?=[0-9])(?!1\ ?/))*\.?)"
    + r"(?:\ ?[eE]\ ?(?P<exponent>[+-]?[0-9]+)|\ ?[×x*]\ ?"
    + _POWER_OF_TEN.format("times")
    + r")?)\ ?(?P<unit>.*)"
)
_UNIT = re.compile(
    r"[×*]?\ ?(?P<per>(?:1?\ ?/|per\ )\ ?)?(?P<name>[^\W\d_]+)\ ?"
    r"(?:(?:\^|\*\*)?\ ?\(?(?P<power>[+-]?[0-9]+)\)?)?"
)


#: Separators of several numbers, in the order in which they are tried.
_NEXT = r"(?=[+-]? ?[.,]?[0-9])"
_SEPARATORS = (f" ?[;:] ?{_NEXT}", f" ?[x×*] ?{_NEXT}| , ?|, ", f" {_NEXT}", ",")
_BRACKETS = re.compile(r"[\[({] ?(?P<numbers>[^][(){}]+?) ?[])}](?P<unit>.*)")
#: Sizes of a voxel that may also be one number with groups of three digits.
_ONE_OR_THREE = re.compile("(?P<sizes>[1-9][0-9]{0,2}([ ,][0-9]{3}){2}) ?(?P<unit>[a-zµÅ]*)")


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
            raise InputError(
                f"{self.text} has a unit, and the mesh has none: write the number alone, or set"
                " the unit of the mesh."
            )
        shift = self.power * (METRES[self.unit] - METRES[unit]) if self.unit else 0
        return _float(self.value.scaleb(shift), self.text)


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
    if not written or _joined(written) == _joined(_plain(unit)):
        return _float(value, text)
    if _length_power(written) is None:
        raise _no_unit(text, written)
    meant = _length_power(_plain(unit))
    if meant is None:
        known = f"this is in {unit}" if unit else "none is known here"
        raise InputError(f"{_shown(text)} has a unit, and {known}: write the number alone.")
    return _quantity(value, written, meant[1], text).in_unit(meant[0])


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
    except _AmbiguousError as fault:
        raise InputError(f"{allowed}: {fault}") from None
    except InputError:
        raise InputError(f"{allowed}, not {_shown(text) if text.strip() else 'empty'}.") from None
    if written or value != value.to_integral_value() or not least <= value <= most:
        raise InputError(f"{allowed}, not {_shown(text)}.")
    return int(value)


def parse_several(
    text: str, count: int, parse: Callable[[str], _T], example: str
) -> tuple[_T, ...]:
    """Read `count` values with one separator, in brackets or not, each by `parse`.

    A unit after the last value is the unit of all values without one. `InputError` is raised if the
    text is not `count` values, with an `example`, or a value is ambiguous.

    Examples
    --------
    >>> parse_several("(4, 4, 40)", 3, parse_number, "4 4 40")
    (4.0, 4.0, 40.0)
    >>> [each.in_unit("nm") for each in parse_several("1 x 2 µm", 2, parse_quantity, "1 x 2")]
    [1000.0, 2000.0]
    """
    plain = _without_brackets(_plain(text))
    faults = list[InputError]()
    for separator in _SEPARATORS:
        parts = re.split(separator, plain)
        try:
            units = [_split(part)[1] for part in parts if len(parts) == count]
        except InputError as fault:
            faults += [fault] if isinstance(fault, _AmbiguousError) else []
            continue
        named = [
            part if unit else f"{part} {units[-1]}"
            for part, unit in zip(parts, units, strict=False)  # no units for another count
        ]
        try:
            if named:
                return tuple(map(parse, named))
        except InputError as fault:
            faults.append(fault)
    raise (
        faults[0]
        if faults
        else InputError(f"{_shown(text)} is not {count} numbers: write them like {example}.")
    )


def parse_voxel(text: str) -> tuple[Voxel, str]:
    """Read the size of a voxel, one number or three, as `parse_unit` but with or without a unit.

    Examples
    --------
    >>> parse_voxel("4x4x40"), parse_voxel("8 nm")
    (((4.0, 4.0, 40.0), ''), ((8.0, 8.0, 8.0), 'nm'))
    """
    plain = _without_brackets(_plain(text))
    if found := _ONE_OR_THREE.fullmatch(plain):
        parts, unit = re.split("[ ,]", found["sizes"]), found["unit"]
        raise _AmbiguousError(
            f"{_shown(text)} may be a voxel of {' × '.join(parts)} {unit} or of"
            f" {''.join(parts)} {unit}: write it like one of these."
        )
    try:
        sizes: tuple[Quantity, ...] = (parse_quantity(plain),) * 3
    except _AmbiguousError:
        raise
    except InputError:
        sizes = parse_several(plain, 3, parse_quantity, _VOXELS)
    name = sizes[-1].unit
    factor, unit = MESH_UNITS[name]
    x, y, z = (factor * size.in_unit(name) for size in sizes)
    if not is_voxel((x, y, z)):
        raise InputError(f"{_shown(text)} is no voxel: give positive sizes such as {_VOXELS}.")
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
    except _AmbiguousError:
        raise
    except InputError:
        unit = ""
    if not unit:
        raise InputError(f"{text!r} is not a length unit: give {UNIT_FORMS}.") from None
    return voxel, unit


class _AmbiguousError(InputError):
    """The text of a number is ambiguous."""


def _split(text: str, *, whole: bool = False) -> tuple[Decimal, str]:
    """Split a text into the number at its beginning, and the rest."""
    plain = _plain(text)
    match = _NUMBER.fullmatch(plain) if len(plain) <= _LONGEST else None
    if match is None:
        raise _no_number(text)
    digits, sign = match["digits"] or "1", match["sign"]
    power = int(match["alone"] or match["exponent"] or match["times"] or 0)
    scale = f"e{power}" if power else ""
    either = _EITHER.fullmatch(digits)
    if either and ("." if whole else ",") in digits:
        raise _ambiguous(text, sign, digits, scale)
    mantissa = _with_point(digits, "" if whole and either else _mark(digits))
    if mantissa is None:
        raise _no_number(text)
    if abs(power) > _LARGEST_POWER:
        raise _no_size(text)
    return Decimal(f"{sign}{mantissa}{scale}"), match["unit"]


#: Digits with a single mark that may separate groups or decimals.
_EITHER = re.compile(r"[1-9][0-9]{0,2}[.,][0-9]{3}")


def _mark(digits: str) -> str:
    """Return the decimal mark: the last point or comma, unless it is repeated."""
    last = max(".,", key=digits.rfind)
    return last if digits.count(last) == 1 else ""


def _with_point(digits: str, mark: str) -> str | None:
    """Remove separators and use a decimal point; None if groups are not of three digits."""
    before, _, after = digits.partition(mark) if mark else (digits, "", "")
    separators = set(re.sub("[0-9]", "", before + after))
    if len(separators) > 1:
        return None
    if separators:
        (separator,) = separators
        each = re.escape(separator)
        whole = f"[1-9][0-9]{{0,2}}({each}[0-9]{{3}})+|[0-9]*"
        if separator == ",":  # as in India, 12,34,567
            whole += "|[1-9][0-9]?(,[0-9]{2})+,[0-9]{3}"
        part = f"([0-9]{{3}}{each})+[0-9]{{1,3}}|[0-9]*"
        if not (re.fullmatch(whole, before) and re.fullmatch(part, after)):
            return None
        before, after = before.replace(separator, ""), after.replace(separator, "")
    return f"{before or 0}.{after or 0}"


def _plain(text: str) -> str:
    """Normalise a text: single spaces, ASCII digits, superscripts after "^"."""
    text = re.sub(
        "[⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"^{found[0].translate(_SUPERSCRIPTS)}", text
    ).translate(_READ_AS)
    digits = (str(unicodedata.decimal(each)) if each.isdecimal() else each for each in text)
    return " ".join("".join(digits).split())


def _without_brackets(plain: str) -> str:
    found = _BRACKETS.fullmatch(plain)
    return f"{found['numbers']} {found['unit'].strip()}".strip() if found else plain


def _joined(unit: str) -> str:
    return unit.replace("^", "").replace(" ", "")


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
        remedy = f"write it in {right}" if power else "write the number alone"
        raise InputError(f"{_shown(text)} is {_KINDS.get(own, 'in another unit')}: {remedy}.")
    return Quantity(value, name, power, text.strip())


_KINDS = {1: "a length", 2: "an area", -1: "an inverse length", -2: "an inverse area"}


def _float(value: Decimal, text: str) -> float:
    number = float(value)
    if not math.isfinite(number) or (number == 0.0) != (value == 0):
        raise _no_size(text)
    return number


def _ambiguous(text: str, sign: str, digits: str, scale: str) -> _AmbiguousError:
    mark = _mark(digits)
    thousands, decimal = digits.replace(mark, ""), float(digits.replace(mark, "."))
    return _AmbiguousError(
        f"{_shown(text)} may be {sign}{thousands}{scale} or {sign}{decimal}{scale}: write it like"
        " one of these."
    )


def _no_size(text: str) -> InputError:
    return InputError(f"{_shown(text)} is too large or too small: write a number such as 3.1e5.")


def _no_number(text: str) -> InputError:
    return InputError(f"{_shown(text)} is not a number: write 3.1e5.")


def _no_unit(text: str, written: str) -> InputError:
    if not _UNIT.fullmatch(written):
        return _no_number(text)
    return InputError(f"{_shown(text)} is in a unit that is not known: write the number alone.")


def _shown(text: str) -> str:
    return printable(text.strip(), _SHOWN) or "Nothing"
