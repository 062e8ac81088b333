"""Length units of mesh coordinates, and numbers written with them."""

from __future__ import annotations

import re

from meshmash_viewer.errors import InputError

__all__ = ["LENGTH_UNITS", "format_quantity", "parse_unit", "power_unit"]

#: Length units that coordinates can carry; the empty unit means "none stated".
LENGTH_UNITS: tuple[str, ...] = ("", "nm", "µm", "mm", "m")

_ALIASES = {
    "": "",
    "none": "",
    "nm": "nm",
    "µm": "µm",  # micro sign
    "μm": "µm",  # Greek letter mu
    "um": "µm",
    "mm": "mm",
    "m": "m",
}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PATTERN = re.compile(r"^\s*(?P<factor>[0-9.eE+-]*?)\s*(?P<unit>[a-zµμ]*)\s*$")


def parse_unit(text: str) -> tuple[float, str]:
    """Read a unit such as "nm", "none" or, for voxel coordinates, "8 nm".

    Parameters
    ----------
    text : str
        A length unit, optionally after the size of a voxel in it.

    Returns
    -------
    factor : float
        What coordinates are multiplied by to be in `unit`; 1 without a voxel size.
    unit : str
        One of `LENGTH_UNITS`.

    Raises
    ------
    InputError
        If the text is not a unit, or the voxel size is not a positive number.
    """
    match = _PATTERN.match(text)
    fault = InputError(
        f"{text!r} is not a length unit: give one of nm, µm, mm, m, none, "
        'or a voxel size such as "8 nm".'
    )
    if match is None or match["unit"] not in _ALIASES:
        raise fault
    unit = _ALIASES[match["unit"]]
    if not match["factor"]:
        return 1.0, unit
    try:
        factor = float(match["factor"])
    except ValueError:
        raise fault from None
    if not (0.0 < factor < float("inf")) or not unit:
        raise fault
    return factor, unit


def power_unit(unit: str, power: int) -> str:
    """Write a power of a length unit: ``power_unit("nm", -2)`` is "nm⁻²", "" stays ""."""
    if not unit or power == 0:
        return ""
    return unit if power == 1 else unit + str(power).translate(_SUPERSCRIPTS)


def format_quantity(value: float, unit: str, power: int = 1, digits: int = 4) -> str:
    """Write a number with a power of a length unit: "1.234e-08 nm⁻²"."""
    text = f"{value:.{digits}g}"
    written = power_unit(unit, power)
    return f"{text} {written}" if written else text
