"""Colour limits: the two ends of a colour bar, and its scale, from the values of a field."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.fields.parameter import Number, Parameters, parameter

Ends: TypeAlias = tuple[float, float]
Values: TypeAlias = npt.NDArray[np.floating]
Sample: TypeAlias = npt.NDArray[np.int64] | None

#: Smallest lower limit of a log scale.
_TINY = 1e-36
#: Ratio of the 99th percentile to the 1st from which colours follow the logarithm by default.
MANY_DECADES = 100.0


class Limits(NamedTuple):
    """Ends of a colour bar; `logarithmic` if colours follow the logarithm of the values."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share of the colour bar; infinite at its ends, for all beyond."""
        if share <= 0.0 or share >= 1.0:
            return -math.inf if share <= 0.0 else math.inf
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + (self.high - self.low) * share)

    def share_of(self, value: float) -> float:
        """Return where a value is on the colour bar, from 0 to 1."""
        if value <= self.low or value >= self.high:
            return float(value > self.low)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class LimitPolicy(Protocol):
    """Interface of the policies, which are frozen and compare by value."""

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        """Return limits ``low < high`` for values of shape (n,), even constant ones; skips NaN.

        Percentiles are taken over `sample` (`Mesh.area_sample`), without it over all vertices.
        """
        ...


def _opened(low: float, high: float) -> Ends:
    """Widen an empty interval, that of a constant field, relative to its size."""
    if not (np.isfinite(low) and np.isfinite(high)):
        return -1.0, 1.0
    if high - low > 1e-12 * max(abs(low), abs(high)):
        return low, high
    half = 1e-3 * max(abs(low), abs(high)) or 1.0
    return low - half, high + half


def _finite(values: Values) -> Values:
    kept = values[np.isfinite(values)]
    return kept if kept.size else np.zeros(1, dtype=values.dtype)


def extremes_of(values: Values) -> Ends:
    """Return the smallest and largest finite value; (0, 0) if there is none."""
    # which skip NaN, faster than a mask of all values
    low = float(np.fmin.reduce(values, initial=np.inf))
    high = float(np.fmax.reduce(values, initial=-np.inf))
    if not (np.isfinite(low) and np.isfinite(high)):
        finite = _finite(values)
        low, high = float(finite.min()), float(finite.max())
    return low, high


@dataclass(frozen=True)
class SymmetricLimits(Parameters):
    """Symmetric about zero: for signed fields, so that the middle colour is the nodal line.

    A `percent` below 100 leaves out extreme values.
    """

    percent: float = 100.0

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        low, high = extremes_of(values)
        if self.percent < 100.0:
            low, high = PercentileLimits(100.0 - self.percent, self.percent).limits(values, sample)
        bound = max(abs(low), abs(high)) or 1.0
        return -bound, bound


@dataclass(frozen=True)
class MinMaxLimits(Parameters):
    """From the smallest value to the largest."""

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(*extremes_of(values))


@dataclass(frozen=True)
class PercentileLimits(Parameters):
    """Between two percentiles of the surface: for fields with few extreme values."""

    low: float = parameter(1.0, Number(0.0, 100.0))
    high: float = parameter(99.0, Number(0.0, 100.0))

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        looked_at = _finite(values if sample is None else values[sample])
        low, high = np.percentile(looked_at, (self.low, self.high))
        return _opened(float(low), float(high))


@dataclass(frozen=True)
class LockedLimits(Parameters):
    """Two numbers that stay when the field changes."""

    low: float = parameter(MISSING, Number())
    high: float = parameter(MISSING, Number())

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(self.low, self.high)


def spans_decades(ends: Ends, values: Values) -> bool:
    """Whether a log scale serves a field: it is not below 0, and spans more than two decades.

    `ends` are the 1st and the 99th percentile of the surface, between which these are counted.
    """
    low, high = ends
    return 0.0 < low * MANY_DECADES < high and extremes_of(values)[0] >= 0.0


def logarithmic_limits(ends: Ends, values: Values, sample: Sample = None) -> Limits:
    """Return limits of a log scale, from the 1st percentile of what is positive if `low` is not.

    Linear ones if nothing is positive.
    """
    low, high = ends
    if low <= 0.0 < high:
        looked_at = _finite(values if sample is None else values[sample])
        positive = looked_at[looked_at > 0.0]
        low = float(np.percentile(positive, PercentileLimits().low)) if positive.size else 0.0
    # single precision, in which colours are computed, has nothing below
    return Limits(low, high, True) if _TINY < low < high else Limits(*ends)


def beyond_limits(limits: Limits, extremes: Ends) -> tuple[bool, bool]:
    """Whether there are values below the lower limit, and above the upper one."""
    margin = 1e-6 * (limits.high - limits.low)
    return extremes[0] < limits.low - margin, extremes[1] > limits.high + margin


def automatic_limits(*, signed: bool, tailed: bool = False) -> LimitPolicy:
    """Return the default policy of a field."""
    if signed:
        return SymmetricLimits(PercentileLimits().high if tailed else 100.0)
    return PercentileLimits()
