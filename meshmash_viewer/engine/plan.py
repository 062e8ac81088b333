"""Cutting the spectrum into slices of about equal content, by counting eigenvalues.

Weyl's law says where to look first; it is off by a factor of two on a neuron, so every count
corrects it. Counts are exact (Sylvester's law of inertia), so each slice owes a known number.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import log

from meshmash_viewer.engine.factorization import OrderedPencil, StopFlag
from meshmash_viewer.engine.lanczos import Interval
from meshmash_viewer.engine.waiting import wait_for
from meshmash_viewer.engine.workers import slice_count

__all__ = ["SpectrumPlan"]

#: A border may lie this far, in parts of a slice, from where it was meant to be: where counting
#: again would be waited for, and where it goes on beside another count.
_SLACK, _SLACK_BESIDE = 0.2, 0.05
#: A shift may lie this far from the middle of its slice, in parts of what it holds: farther out
#: more steps are needed than a factor costs. In the lowest slice, whose far end is sparse, it
#: matters less.
_ASIDE, _ASIDE_LOWEST = 0.06, 0.25


class SpectrumPlan:
    """Counts of eigenvalues below chosen values, and slices between them.

    Values are in the reduced problem, and counts include the null space.

    Parameters
    ----------
    ordered : OrderedPencil
    stop : ndarray of uint8, shape (1,)
        Set from outside, or here when `poll` raises, to end a running factorization.
    poll : callable, optional
        Called several times a second while factoring; what it raises ends that.
    n_jobs : int
        Counts at a time, where several are known to be needed.
    lean : bool
        Small slices.
    """

    def __init__(
        self,
        ordered: OrderedPencil,
        stop: StopFlag,
        poll: Callable[[], None] | None = None,
        n_jobs: int = 1,
        lean: bool = False,
    ) -> None:
        self._ordered = ordered
        self._lean = lean
        self._poll = poll
        self._stop = stop
        self._n_jobs = n_jobs
        pencil = ordered.pencil
        top = 1.01 * pencil.norm + 1.0
        self._counts = {0.0: pencil.n_null, top: pencil.n}
        self._knots = [0.0, top]
        self._shifts: set[float] = set()

    def count(self, value: float) -> int:
        """Eigenvalues below a value (or a hair above it, should it be one)."""
        if value >= self._knots[-1]:
            return self._ordered.pencil.n
        self._count_all([value])
        return self._counts[value]

    def _count_all(self, values: Sequence[float]) -> None:
        """Count below several values, side by side."""
        unknown = sorted(set(values) - self._counts.keys())

        def factor() -> list[int]:
            if len(unknown) == 1 or self._n_jobs == 1:
                return [self._count_below(value) for value in unknown]
            with ThreadPoolExecutor(self._n_jobs, "count") as threads:
                return list(threads.map(self._count_below, unknown))

        def abandon() -> None:
            self._stop[0] = 1

        counts = wait_for(factor, self._poll, abandon) if unknown else []
        for value, count in zip(unknown, counts, strict=True):
            self._counts[value] = count
            insort(self._knots, value)

    def _count_below(self, value: float) -> int:
        nudge = 1e-11 * max(value, 1e-3)
        factor = self._ordered.factor(value, nudge, self._stop)
        if value in self._shifts and factor.shift == value:
            self._ordered.kept[value] = factor
        return factor.count_below

    def find_top(self, least: int, most: int) -> float:
        """A value with `least` to `most` eigenvalues below it, and knots that slices will need.

        The first counts are made in the middle of the first slices, whose factors these then are;
        they say how dense the spectrum is, and the next counts find its top and the borders below
        that, side by side. How many does not depend on `n_jobs`, nor does what is found.
        """
        first = self._counts[0.0]
        parts = slice_count(most - first, self._lean)
        ahead = range(min(parts, 2))
        middles = [_window(first, most, part + 0.5, parts) for part in ahead]
        borders = [_window(first, most, part + 1, parts, _SLACK_BESIDE) for part in ahead]
        values = [self._step(*window, 0)[0] for window in middles]
        self._shifts = set(sorted(values)[: self._n_jobs])
        if parts > len(middles):
            values.append(self._step(least, most, 0)[0])
        self._count_all(values)
        for turn in range(3):
            steps = [self._step(*window, turn) for window in ((least, most), *borders[: parts - 1])]
            values = [value for value, settled in steps if not settled]
            if steps[0][1]:
                break
            self._count_all(values)
        return self.find(least, most)

    def find(self, least: int, most: int) -> float:
        """A value with `least` to `most` eigenvalues below it.

        Where a multiple eigenvalue leaves no such value, the one just above it.
        """
        for turn in range(80):
            value, settled = self._step(least, most, turn)
            if settled:
                return value
            self.count(value)
        raise ArithmeticError(f"no border between {least} and {most} eigenvalues")

    def _step(self, least: int, most: int, turn: int) -> tuple[float, bool]:
        """What `find` gives, and True; or where it has to count next, and False."""
        i = bisect_left(self._knots, least, key=self._counts.__getitem__)
        fitting = self._knots[i : bisect_right(self._knots, most, key=self._counts.__getitem__)]
        if fitting:
            middle = 0.5 * (least + most)
            return min(fitting, key=lambda knot: abs(self._counts[knot] - middle)), True
        low, high = self._knots[i - 1], self._knots[i]
        if high - low < 1e-6 * high:
            return high, True
        value = self._between(low, high, 0.5 * (least + most), last=i == len(self._knots) - 1)
        if turn % 2 and turn > 3:  # a multiple eigenvalue makes the count jump
            value = 0.5 * (low + high)
        return value, False

    def _between(self, low: float, high: float, wanted: float, last: bool) -> float:
        """Where to count next, strictly between two knots.

        The count grows like a power of the value, on a surface like its first, along the branches
        of a neuron like its square root, at first by Weyl's law.
        """
        start = self._counts[0.0]
        known = [knot for knot in self._knots[:-1] if self._counts[knot] > start]
        if not known:
            return min(1.06 * (wanted - start), high * 0.9)
        i = min(bisect_left(known, low), len(known) - 1)
        at = known[i]
        other = known[i + 1] if i + 1 < len(known) else known[max(i - 1, 0)]
        power = 1.0
        if self._counts[other] != self._counts[at]:
            grown = log((self._counts[other] - start) / (self._counts[at] - start))
            power = min(max(grown / log(other / at), 0.3), 1.5)
        value: float = at * ((wanted - start) / (self._counts[at] - start)) ** (1.0 / power)
        if last:
            return min(max(value, 1.01 * low), 0.5 * (low + high))
        margin = (0.05 if low > 0.0 else 0.01) * (high - low)
        return min(max(value, low + margin), high - margin)

    def slices(self, low: float, high: float) -> Iterator[Interval]:
        """Slices from low to high, lowest first; borders are counted as they are reached."""
        first, last = self.count(low), self.count(high)
        parts = slice_count(last - first, self._lean)
        for knot in [knot for knot in self._ordered.kept if not low < knot < high]:
            del self._ordered.kept[knot]
        start, index = low, 0
        for part in range(1, parts + 1):
            if part == parts:
                end = high
            else:
                end = self.find(*_window(first, last, part, parts))
                if end >= high:
                    end = high
            owed = self.count(end) - self.count(start)
            if owed > 0:
                # The null space is deflated; what rounding leaves of it is below zero.
                inner = start if start > 0.0 else -0.02 * end
                shift = self._shift(start, end, inner)
                yield Interval(index, inner, end, self.count(start), owed, shift)
                index += 1
            start = end

    def _shift(self, start: float, end: float, inner: float) -> float:
        """A knot with about as many eigenvalues of a slice on either side, or its middle."""
        below, above = self._counts[start], self._counts[end]
        inside = [knot for knot in self._knots if start < knot < end]
        aside = {knot: abs(self._counts[knot] - 0.5 * (below + above)) for knot in inside}
        shift = min(inside, key=aside.__getitem__, default=start)
        allowed = _ASIDE if start > 0.0 else _ASIDE_LOWEST
        if not inside or aside[shift] > allowed * (above - below):
            shift = 0.5 * (inner + end)
        for knot in inside:
            if knot != shift:
                self._ordered.kept.pop(knot, None)
        return shift


def _window(
    first: int, last: int, part: float, parts: int, slack: float = _SLACK
) -> tuple[int, int]:
    """Least and most eigenvalues below the border after a part."""
    middle = first + part * (last - first) / parts
    slack *= (last - first) / parts
    return int(middle - slack), int(middle + slack) + 1
