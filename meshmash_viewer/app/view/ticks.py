"""Round numbers: ticks of a colour bar, and how a scale bar is written."""

from __future__ import annotations

from math import ceil, floor, log10

from meshmash_viewer.units import format_quantity, superscript

__all__ = ["exponent_text", "scale_bar_text", "ticks"]

#: Each unit with the next larger one and how many of it make one of that.
_LARGER = {"nm": ("µm", 1000.0), "µm": ("mm", 1000.0), "mm": ("m", 1000.0)}
_SMALLER = {"m": ("mm", 1000.0), "mm": ("µm", 1000.0), "µm": ("nm", 1000.0)}


def scale_bar_text(length: float, unit: str) -> str:
    """Write a length in the unit that suits its size: 2000 nm is "2 µm"."""
    while unit in _LARGER and length >= 1000.0:
        unit, factor = _LARGER[unit]
        length /= factor
    while unit in _SMALLER and length < 0.1:
        unit, factor = _SMALLER[unit]
        length *= factor
    if not unit:
        return f"{length:g} units" if 1e-4 <= length < 1e6 else f"{length:.0e} units"
    return format_quantity(length, unit)


def exponent_text(exponent: int) -> str:
    """Write a power of ten as a factor: "×10⁻⁵", and nothing for 0."""
    return f"×10{superscript(exponent)}" if exponent else ""


def ticks(low: float, high: float, most: int = 6) -> tuple[list[float], str, int]:
    """Round values within ``[low, high]`` with one common power of ten.

    Parameters
    ----------
    low, high : float
        Ends of the bar, ``low < high``.
    most : int
        Largest number of ticks, at least 2.

    Returns
    -------
    values : list of float
        Each over ``10**exponent``.
    form : str
        How they are written, as the operator ``%`` takes it: all with as many decimals.
    exponent : int
        0 where plain numbers are short.
    """
    largest = max(abs(low), abs(high))
    exponent = floor(log10(largest)) if largest > 0.0 else 0
    if -3 < exponent < 4:
        exponent = 0
    # 10.0**-320 is no longer a normal number; texts are taken relative to it all the same.
    low, high = low / 10.0**exponent, high / 10.0**exponent
    # The smallest round step that does not give too many.
    power = 10.0 ** floor(log10((high - low) / (most + 1)))
    for step in (factor * power for factor in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)):
        first, last = ceil(low / step - 1e-6), floor(high / step + 1e-6)
        if last - first < most:
            break
    decimals = max(0, -floor(log10(step) + 1e-9))
    # A narrow range far from zero: the common part cannot be left out without lying.
    form = f"%.{decimals}f" if decimals <= 6 else "%.9g"
    return [k * step for k in range(first, last + 1)], form, exponent
