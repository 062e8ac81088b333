"""Colour limits of a field: the ends of its colour bar, and a linear or logarithmic scale."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt
from msgspec import Meta, Struct

from meshmash_viewer.fields.parameter import Finite

Ends: TypeAlias = tuple[float, float]
Values: TypeAlias = npt.NDArray[np.floating]
Sample: TypeAlias = npt.NDArray[np.int64] | None
Percent = Annotated[float, Meta(ge=0.0, le=100.0)]

#: Smallest lower limit of a log scale.
_TINY = 1e-36
#: Ratio of the 99th to the 1st percentile above which the scale is logarithmic by default.
MANY_DECADES = 100.0


class Limits(NamedTuple):
    """Ends of a colour bar; `logarithmic` if colours follow the logarithm of the values."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share of the colour bar; infinite at its open ends."""
        if share <= 0.0 or share >= 1.0:
            return -math.inf if share <= 0.0 else math.inf
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + (self.high - self.low) * share)

    def share_of(self, value: float) -> float:
        """Return the position of a value on the colour bar, from 0 to 1."""
        if value <= self.low or value >= self.high:
            return float(value > self.low)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class LimitPolicy(Protocol):
    """Interface of rules that choose limits; implementations are frozen and compared by value.

    In JSON, their class is the entry ``policy``.
    """

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        """Return limits ``low < high`` for values of shape (n,), ignoring NaN.

        Percentiles are computed over `sample` (`Mesh.area_sample`) or all vertices (None).
        """
        ...


def _opened(low: float, high: float) -> Ends:
    """Widen the empty interval of a constant field, relative to its value."""
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
    # fmin and fmax ignore NaN, and need no mask of all values
    low = float(np.fmin.reduce(values, initial=np.inf))
    high = float(np.fmax.reduce(values, initial=-np.inf))
    if not (np.isfinite(low) and np.isfinite(high)):
        finite = _finite(values)
        low, high = float(finite.min()), float(finite.max())
    return low, high


class SymmetricLimits(Struct, frozen=True, tag_field="policy", tag=True):
    """Limits symmetric about zero, for signed fields: the middle colour is at the nodal line.

    A `percent` below 100 excludes extreme values.
    """

    percent: Percent = 100.0

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        low, high = extremes_of(values)
        if self.percent < 100.0:
            low, high = PercentileLimits(100.0 - self.percent, self.percent).limits(values, sample)
        bound = max(abs(low), abs(high)) or 1.0
        return -bound, bound


class MinMaxLimits(Struct, frozen=True, tag_field="policy", tag=True):
    """The smallest and the largest value."""

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(*extremes_of(values))


class PercentileLimits(Struct, frozen=True, tag_field="policy", tag=True):
    """Two percentiles over the area of the surface, for fields with few extreme values."""

    low: Percent = 1.0
    high: Percent = 99.0

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        looked_at = _finite(values if sample is None else values[sample])
        low, high = np.percentile(looked_at, (self.low, self.high))
        return _opened(float(low), float(high))


class LockedLimits(Struct, frozen=True, tag_field="policy", tag=True):
    """Two fixed numbers, independent of the field."""

    low: Finite
    high: Finite

    def limits(self, values: Values, sample: Sample = None) -> Ends:
        return _opened(self.low, self.high)


def spans_decades(ends: Ends, values: Values) -> bool:
    """Return whether the default scale is logarithmic: no negative values, over two decades.

    `ends` are the 1st and the 99th percentile over the surface; decades are counted between them.
    """
    low, high = ends
    return 0.0 < low * MANY_DECADES < high and extremes_of(values)[0] >= 0.0


def logarithmic_limits(ends: Ends, values: Values, sample: Sample = None) -> Limits:
    """Return limits of a log scale, or linear limits if no value is positive.

    A lower end that is not positive is replaced by the 1st percentile of the positive values.
    """
    low, high = ends
    if low <= 0.0 < high:
        looked_at = _finite(values if sample is None else values[sample])
        positive = looked_at[looked_at > 0.0]
        low = float(np.percentile(positive, PercentileLimits().low)) if positive.size else 0.0
    # colours are computed in single precision, which has no smaller normal numbers
    return Limits(low, high, True) if _TINY < low < high else Limits(*ends)


def beyond_limits(limits: Limits, extremes: Ends) -> tuple[bool, bool]:
    """Return whether values lie below the lower limit, and whether above the upper limit."""
    margin = 1e-6 * (limits.high - limits.low)
    return extremes[0] < limits.low - margin, extremes[1] > limits.high + margin


def automatic_limits(*, signed: bool, tailed: bool = False) -> LimitPolicy:
    """Return the default policy of a field."""
    if signed:
        return SymmetricLimits(PercentileLimits().high if tailed else 100.0)
    return PercentileLimits()
