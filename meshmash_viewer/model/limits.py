"""Colour limits: the policies that turn a field's values into the two ends of its colour bar."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = [
    "LimitPolicy",
    "LockedLimits",
    "MinMaxLimits",
    "PercentileLimits",
    "SymmetricLimits",
    "automatic_limits",
]

Ends: TypeAlias = tuple[float, float]
Values: TypeAlias = npt.NDArray[np.floating]
Sample: TypeAlias = npt.NDArray[np.int64] | None


class LimitPolicy(Protocol):
    """What every policy can do; policies are frozen and compare by value."""

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        """Limits ``low < high`` for values of shape (n,), also for constant ones; NaN is left out.

        A sample stands for the surface in statistics (`Mesh.area_sample`); without one every vertex
        counts once.
        """
        ...


def _opened(low: float, high: float) -> Ends:
    """Open an interval that a constant field has closed, relative to its size."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    if high - low > 1e-12 * max(abs(low), abs(high)):
        return low, high
    half = 1e-3 * max(abs(low), abs(high)) or 1.0
    return low - half, high + half


def _finite(values: Values) -> Values:
    kept = values[np.isfinite(values)]
    return kept if kept.size else np.zeros(1, dtype=values.dtype)


def _extremes(values: Values) -> Ends:
    """Smallest and largest finite value; (0, 0) if there is none."""
    low, high = float(values.min(initial=np.inf)), float(values.max(initial=-np.inf))
    if not (np.isfinite(low) and np.isfinite(high)):  # which is quicker than looking at each
        finite = _finite(values)
        low, high = float(finite.min()), float(finite.max())
    return low, high


@dataclass(frozen=True)
class SymmetricLimits:
    """Symmetric about zero: for signed fields, so that the middle colour is the nodal line.

    Less than the whole `percent` leaves out the tips of a field that has them.
    """

    percent: float = 100.0

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        low, high = _extremes(values)
        if self.percent < 100.0:
            low, high = PercentileLimits(100.0 - self.percent, self.percent).limits(values, sample)
        bound = max(abs(low), abs(high)) or 1.0
        return -bound, bound


@dataclass(frozen=True)
class MinMaxLimits:
    """From the smallest value to the largest."""

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(*_extremes(values))


@dataclass(frozen=True)
class PercentileLimits:
    """Between two percentiles of the surface: for fields whose tips would take all the colours."""

    low: float = 1.0
    high: float = 99.0

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        looked_at = _finite(values if sample is None else values[sample])
        low, high = np.percentile(looked_at, (self.low, self.high))
        return _opened(float(low), float(high))


@dataclass(frozen=True)
class LockedLimits:
    """Two numbers that stay when the field changes."""

    low: float
    high: float

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(self.low, self.high)


def automatic_limits(*, signed: bool, tailed: bool = False) -> LimitPolicy:
    """The policy a field has before anyone chose one."""
    if signed:
        return SymmetricLimits(PercentileLimits().high if tailed else 100.0)
    return PercentileLimits()
