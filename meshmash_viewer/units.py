"""Length units of mesh coordinates, voxel sizes, and formatting of numbers with units."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TypeAlias

from meshmash_viewer.errors import InputError

#: Size of a voxel along x, y and z, by which voxel coordinates are multiplied.
Voxel: TypeAlias = tuple[float, float, float]

#: Voxel size of coordinates that are lengths.
NO_VOXEL: Voxel = (1.0, 1.0, 1.0)

#: Length units of coordinates; "" if the unit is not stated.
LENGTH_UNITS: tuple[str, ...] = ("", "nm", "µm", "mm", "m")

#: Forms that `parse_unit` accepts, for messages and help.
UNIT_FORMS = 'nm, µm, mm, m, none, or a voxel such as "8 nm" or "4 x 4 x 40 nm"'

#: Accepted names of units of length, and their size as a power of ten of a metre.
METRES: dict[str, int] = {
    "pm": -12,
    **dict.fromkeys(("Å", "\N{ANGSTROM SIGN}", "angstrom"), -10),
    **dict.fromkeys(("nm", "nanometer", "nanometre"), -9),
    **dict.fromkeys(("µm", "um", "micron", "micrometer", "micrometre"), -6),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), -3),
    "cm": -2,
    **dict.fromkeys(("m", "meter", "metre"), 0),
    "km": 3,
}
METRES |= {f"{name}s": METRES[name] for name in METRES if name[-2:] in ("on", "er", "re", "om")}


def _mesh_unit(power: int) -> tuple[float, str]:
    """Return the factor to the next smaller of `LENGTH_UNITS`, and this unit."""
    smaller = [unit for unit in LENGTH_UNITS[1:] if METRES[unit] <= power]
    unit = smaller[-1] if smaller else "nm"
    return 10.0 ** (power - METRES[unit]), unit


#: For each accepted name, the factor to one of `LENGTH_UNITS`, and this unit.
MESH_UNITS: dict[str, tuple[float, str]] = {
    **{name: _mesh_unit(power) for name, power in METRES.items()},
    **dict.fromkeys(("", "none"), (1.0, "")),
}

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_FROM_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
#: Space between number and unit.
NO_BREAK = "\N{NO-BREAK SPACE}"
_POWER_OF_LENGTH = re.compile("(nm|µm|mm|m)([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]*)")
#: Range of short numbers by absolute power of the length: 1 for a length, 2 for an area.
_SHORT = {1: (0.1, 1e3), 2: (0.01, 1e4)}
#: Numbers below this are written without an exponent.
_LONG = 1e6


def is_voxel(voxel: tuple[float, ...]) -> bool:
    """Whether a tuple is three positive, finite sizes."""
    return len(voxel) == 3 and all(0.0 < size < math.inf for size in voxel)


def written_unit(unit: str, voxel: Voxel = NO_VOXEL) -> str:
    """Write unit and voxel size as `parse_unit` reads them: "nm", "none", "4 × 4 × 40 nm"."""
    if voxel == NO_VOXEL:
        return unit or "none"
    sizes = voxel[:1] if len(set(voxel)) == 1 else voxel
    return f"{' × '.join(f'{size:.15g}' for size in sizes)} {unit}"


def power_unit(unit: str, power: int) -> str:
    """Write a power of a length unit: ``power_unit("nm", -2)`` is "nm⁻²", "" stays ""."""
    if not unit or power == 0:
        return ""
    return unit if power == 1 else unit + superscript(power)


def engineering(size: float, unit: str) -> tuple[int, str]:
    """Choose the unit in which a quantity is a short number.

    `size` is the largest magnitude to write, `unit` a result of `power_unit`; any other text, such
    as "mV", is kept. Returns the power of ten by which numbers are multiplied, and their unit.

    Examples
    --------
    >>> engineering(40_370.0, "nm"), engineering(1.2e-8, "nm⁻²"), engineering(98_000.0, "mm²")
    ((-3, 'µm'), (6, 'µm⁻²'), (0, 'mm²'))
    """
    match = _POWER_OF_LENGTH.fullmatch(unit)
    power = int(match[2].translate(_FROM_SUPERSCRIPTS) or 1) if match else 0
    if match is None or abs(power) not in _SHORT or not 0.0 < size < math.inf:
        return 0, unit
    low, high = _SHORT[abs(power)]
    # only lengths change from mm to m: 0.05 mm⁻¹ is easier to read than 50 m⁻¹
    lengths = LENGTH_UNITS[1:] if power == 1 or match[1] == "m" else LENGTH_UNITS[1:-1]
    at = lengths.index(match[1])
    step = 1 if (size >= high) == (power > 0) else -1
    exponent = 0
    while not low <= size * 10.0**exponent < high and 0 <= at + step < len(lengths):
        at += step
        exponent -= 3 * power * step
    return exponent, power_unit(lengths[at], power)


def format_quantity(
    value: float, unit: str, power: int = 1, digits: int = 3, *, like: float | None = None
) -> str:
    """Write a quantity in the unit in which it is a short number: "40.4 µm", "12 µm⁻²".

    Number and unit are separated by a no-break space. The unit may also be any other text, or
    empty. `like` is the size that determines the unit, for several numbers with a common unit.
    """
    exponent, written = engineering(abs(value if like is None else like), power_unit(unit, power))
    text = format_number(value * 10.0**exponent, digits)
    return f"{text}{NO_BREAK}{written}" if written else text


def plain_number(value: float, digits: int = 4) -> str:
    """Write a number for an input field, with an exponent (1.2e-08) if it is otherwise long."""
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(float(text)) < _LONG:
        text = f"{float(text):.0f}"
    return minus(text[:1]) + text[1:]


def format_number(value: float, digits: int = 4) -> str:
    """Write a number for display: "1.2×10⁻⁸", "−0.5"."""
    text, _, exponent = plain_number(value, digits).partition("e")
    return text + (f"×10{superscript(int(exponent))}" if exponent else "")


def grouped(value: float, digits: int = 4) -> str:
    """Write a number like `format_number`, with a comma after thousands, for tables: "98,100"."""
    whole, point, fraction = format_number(value, digits).partition(".")
    if len(whole) > len("1234"):
        whole = re.sub(r"(?<=\d)(?=(\d{3})+$)", ",", whole)
    return whole + point + fraction


def minus(text: str) -> str:
    """Replace hyphens by minus signs."""
    return text.replace("-", "\N{MINUS SIGN}")


def plain_text(text: str) -> str:
    """Replace no-break spaces and minus signs by ASCII, for files and terminals."""
    return text.replace(NO_BREAK, " ").replace("\N{MINUS SIGN}", "-")


def format_share(share: float, digits: int = 3) -> str:
    """Write a share in percent: "81.9 %"."""
    return f"{format_number(100.0 * share, digits)}{NO_BREAK}%"


def format_position(position: Iterable[float], digits: int = 9) -> str:
    """Write a position for the dialog *Go to* (Ctrl+G): "612400.2, 418900, 287300"."""
    return ", ".join(f"{value:.{digits}g}" for value in position)


def format_range(
    low: float,
    high: float,
    unit: str,
    power: int = 1,
    *,
    word: str = "–",
    digits: int = 3,
    like: float | None = None,
) -> str:
    """Write two numbers in the same unit: "0 – 12 µm⁻²"; for `like` see `format_quantity`."""
    like = max(abs(low), abs(high)) if like is None else like
    exponent, _ = engineering(like, power_unit(unit, power))
    first = format_number(low * 10.0**exponent, digits)
    return f"{first} {word} {format_quantity(high, unit, power, digits, like=like)}"


def format_lengths(lengths: Iterable[float], unit: str, digits: int = 3) -> str:
    """Write lengths in one unit: "15.9 × 15.8 × 6.04 µm", "(1.92 × 2.65 × 0.18)×10⁷"."""
    lengths = tuple(lengths)
    exponent, written = engineering(max(lengths), unit)
    power = math.floor(math.log10(max(lengths))) + exponent if max(lengths) > 0.0 else 0
    power = 0 if -4 < power < 6 else power
    scale = 10.0 ** (exponent - power)
    sides = " × ".join(format_number(length * scale, digits) for length in lengths)
    if power:
        sides = f"({sides})×10{superscript(power)}"
    return f"{sides}{NO_BREAK}{written}" if written else sides


def distinct_digits(low: float, high: float, least: int = 4) -> int:
    """Return the digits needed to write two numbers so that their difference has three digits."""
    size, gap = max(abs(low), abs(high)), abs(high - low)
    if not 0.0 < gap < math.inf:
        return least
    return min(max(math.floor(math.log10(size / gap)) + 3, least), 10)


def round_length(longest: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `longest` (> 0)."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= longest * 1.000001)


def counted(number: int, noun: str) -> str:
    """Write a count with its noun: "1 pair", "22,351 vertices"."""
    plural = {"vertex": "vertices", "mesh": "meshes", "class": "classes"}.get(noun, f"{noun}s")
    return f"{number:,} {noun if number == 1 else plural}"


def named_vertex(vertex: int) -> str:
    """Write the index of a vertex: "vertex 22,351"."""
    return f"vertex {vertex:,}"


def superscript(number: int) -> str:
    """Write a whole number as superscript: "⁻¹²"."""
    return str(number).translate(_SUPERSCRIPTS)


def subscript(number: int) -> str:
    """Write an index as subscript: "₁₂"."""
    return str(number).translate(_SUBSCRIPTS)


def is_real(value: object) -> bool:
    """Whether a value is a real number, or an array of shape () with one."""
    try:
        float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return False
    return not isinstance(value, (str, bytes))


def whole_number(count: float, name: str, most: float = math.inf) -> int:
    """Return a count as int; raise `InputError` with its `name` unless whole, from 1 to `most`."""
    if not (is_real(count) and math.isfinite(count) and 1 <= count <= most and count == int(count)):
        limit = f" to {most:,}" if math.isfinite(most) else ""
        raise InputError("out-of-range", f"{name} is {count}", f"give a whole number from 1{limit}")
    return int(count)


def check_number(value: float, name: str, low: float = 0.0, high: float = math.inf) -> None:
    """Raise `InputError` unless `value` is a finite number from `low` to `high`."""
    if not (is_real(value) and math.isfinite(value) and low <= value <= high):
        limit = f" to {high:g}" if math.isfinite(high) else ""
        raise InputError("out-of-range", f"{name} is {value}", f"give a number from {low:g}{limit}")


def check_positive(value: float | None, name: str) -> None:
    """Raise `InputError` unless `value` is a finite number above 0."""
    if value is None or not (is_real(value) and 0.0 < value < math.inf):
        raise InputError("out-of-range", f"{name} is {value}", "give a positive number")


def named_quantity(name: str, unit: str, power: int = 1) -> str:
    """Write the title of an axis: "Time t (nm²)", or "Time t" without a unit."""
    written = power_unit(unit, power)
    return f"{name} ({written})" if written else name


def power_text(exponent: int, factor: int = 1) -> str:
    """Write a power of ten: "10⁻⁸", "2×10⁻⁸"; from 10⁻³ to 10³ as a decimal."""
    if -3 <= exponent <= 3:
        return f"{factor * 10.0**exponent:.10g}"
    power = "10" + superscript(exponent)
    return power if factor == 1 else f"{factor}×{power}"
