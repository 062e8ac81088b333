"""Powers of ten as marks along a range, written 2×10⁻⁸."""

from __future__ import annotations

import math
from typing import NamedTuple

from meshmash_viewer.units import superscript


class Mark(NamedTuple):
    """A labelled place along a range; `share` is how far along it is, 0 to 1."""

    share: float
    text: str


def power_text(exponent: int, factor: int = 1) -> str:
    """Write a power of ten, ``10⁻⁸`` or ``2×10⁻⁸``; powers near one are written out."""
    if -3 <= exponent <= 3:
        return f"{factor * 10.0**exponent:.10g}"
    power = "10" + superscript(exponent)
    return power if factor == 1 else f"{factor}×{power}"


def log_share(value: float, low: float, high: float) -> float:
    """How far along a range in log scale a value lies; 0 where the range is a single number."""
    return math.log(value / low) / math.log(high / low) if high > low else 0.0


def decade_marks(low: float, high: float) -> tuple[Mark, ...]:
    """Marks at the powers of ten of a range in log scale; at 2 and 5 too where it is short."""
    if not (0.0 < low < high):
        return ()
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = math.log10(high / low)
    factors = (1,) if decades > 2.5 else (1, 3) if decades > 1.6 else (1, 2, 5)
    stride = max(1, round(decades / 6))
    marks = []
    for exponent in range(first, last + 1):
        for factor in factors:
            value = factor * 10.0**exponent
            if low <= value <= high and exponent % stride == 0:
                marks.append(Mark(log_share(value, low, high), power_text(exponent, factor)))
    return tuple(marks)
