"""Cutting the spectrum into slices of about equal content, by counting eigenvalues.

Weyl's law says where to look first; it is off by a factor of two on a neuron, so every count
corrects it. Counts are exact (Sylvester's law of inertia), so each slice owes a known number.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable, Iterator

from meshmash_viewer.engine.factorization import OrderedPencil, StopFlag
from meshmash_viewer.engine.lanczos import Interval
from meshmash_viewer.engine.workers import slice_count

__all__ = ["SpectrumPlan"]

#: A border may lie this far, in parts of a slice, from where it was meant to be.
_SLACK = 0.2


class SpectrumPlan:
    """Counts of eigenvalues below chosen values, and slices between them.

    Values are in the reduced problem, and counts include the null space.
    """

    def __init__(
        self, ordered: OrderedPencil, stop: StopFlag, poll: Callable[[], None] | None = None
    ) -> None:
        self._ordered = ordered
        self._poll = poll
        self._stop = stop
        pencil = ordered.pencil
        top = 1.01 * pencil.norm + 1.0
        self._counts = {0.0: pencil.n_null, top: pencil.n}
        self._knots = [0.0, top]

    def count(self, value: float) -> int:
        """Eigenvalues below a value (or a hair above it, should it be one)."""
        if value >= self._knots[-1]:
            return self._ordered.pencil.n
        if value not in self._counts:
            nudge = 1e-11 * max(value, 1e-3)
            self._counts[value] = self._ordered.factor(value, nudge, self._stop).count_below
            insort(self._knots, value)
        return self._counts[value]

    def find(self, least: int, most: int) -> float:
        """A value with `least` to `most` eigenvalues below it.

        Where a multiple eigenvalue leaves no such value, the one just above it.
        """
        for turn in range(80):
            i = bisect_left(self._knots, least, key=self._counts.__getitem__)
            high = self._knots[i]
            if self._counts[high] <= most:
                return high
            low = self._knots[i - 1]
            if high - low < 1e-6 * high:
                return high
            value = self._between(low, high, 0.5 * (least + most), last=i == len(self._knots) - 1)
            if turn % 2 and turn > 3:  # a multiple eigenvalue makes the count jump
                value = 0.5 * (low + high)
            self.count(value)
        raise ArithmeticError(f"no border between {least} and {most} eigenvalues")

    def _between(self, low: float, high: float, wanted: float, last: bool) -> float:
        """Where to count next, strictly between two knots."""
        below, above = self._counts[low], self._counts[high]
        if last:
            # Nothing is known above: go by the density so far, at first by Weyl's.
            start = self._ordered.pencil.n_null
            density = (below - start) / low if low > 0.0 and below > start else 1.0
            value = low + 1.02 * (wanted - below) / density
            return min(value, 0.5 * (low + high)) if low > 0.0 else min(value, high * 0.9)
        share = (wanted - below) / (above - below)
        return low + min(max(share, 0.05), 0.95) * (high - low)

    def slices(self, low: float, high: float) -> Iterator[Interval]:
        """Slices from low to high, lowest first; borders are counted as they are reached."""
        first, last = self.count(low), self.count(high)
        parts = slice_count(last - first)
        slack = _SLACK * (last - first) / parts
        start, index = low, 0
        for part in range(1, parts + 1):
            if part == parts:
                end = high
            else:
                middle = first + part * (last - first) / parts
                end = self.find(int(middle - slack), int(middle + slack) + 1)
                if end >= high:
                    end = high
            owed = self.count(end) - self.count(start)
            if owed > 0:
                # The null space is deflated; what rounding leaves of it is below zero.
                inner = start if start > 0.0 else -0.02 * end
                yield Interval(index, inner, end, self.count(start), owed)
                index += 1
            start = end
