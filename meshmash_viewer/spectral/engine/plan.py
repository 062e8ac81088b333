"""Division of the spectrum into slices with about equal numbers of eigenvalues.

Eigenvalues below a value are counted exactly, by Sylvester's law of inertia, so the number in each
slice is known. Weyl's law gives the value of the first count; every count corrects the estimate. A
border close to an eigenvalue is verified by counts on both sides.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate, chain
from math import log
from typing import NamedTuple, TypeVar

from meshmash_viewer.spectral.engine.factorization import FactorizationError, OrderedPencil
from meshmash_viewer.spectral.engine.pairs import Interval

T = TypeVar("T")

#: Allowed deviation of a border from its intended index, as a share of a slice, for a separate
#: count and for counts in parallel.
_SLACK, _SLACK_PARALLEL = 0.2, 0.05
#: Allowed deviation of the border of a small first slice, which is not counted separately.
_SLACK_FIRST = 0.5
#: Allowed deviation of a shift from the middle of its slice, as a share of its eigenvalues: beyond,
#: additional steps cost more than another factor. The lowest slice needs fewer steps.
_ASIDE, _ASIDE_LOWEST = 0.06, 0.25
#: Relative distances from a value at which eigenvalues are counted on both sides.
_RUNGS = tuple(1e-9 * 8.0**i for i in range(10))
#: A count is reliable if no eigenvalue is closer than this multiple of the blur of the factor.
_BLURS = 16.0
#: Relative distance of an eigenvalue from a border below which the count is unreliable.
_CLEARANCE = 1e-10
#: Largest relative change of a shift at which a pivot vanishes.
_MOVE = 1e-2


class SpectrumPlan:
    """Counts of eigenvalues below chosen values, and slices between them.

    Values are in the unit of the reduced problem, and counts include the null space; `top` is above
    the whole spectrum. `sizes` returns the number of pairs of each slice for a total number;
    `n_jobs` is the number of parallel counts.
    """

    def __init__(
        self, ordered: OrderedPencil, sizes: Callable[[int], list[float]], n_jobs: int = 1
    ) -> None:
        self._ordered, self._sizes, self._n_jobs = ordered, sizes, n_jobs
        pencil = ordered.pencil
        self.top = 1.01 * pencil.norm + 1.0
        self._counts = {0.0: pencil.n_null, self.top: pencil.n}
        self._knots = [0.0, self.top]
        self._shifts: set[float] = set()
        # Distance of an eigenvalue from a knot below which the count at the knot is unreliable.
        self._clearance = {0.0: 0.0, self.top: 0.0}
        self._settled = {0.0, self.top}

    def count(self, knot: float) -> int:
        """Return the number of eigenvalues below a knot returned by `find` or `settle`."""
        return self._counts[knot]

    def negative(self) -> int:
        """Count eigenvalues that are below zero by more than rounding."""
        below = -max(1e-6, 1e-9 * self.top)
        return self._each([below], lambda v: self._ordered.factor(v, -v).count_below)[0]

    def settle(self, value: float, outward: float = 1.0, *, wide: bool = False) -> float:
        """Return a value as a border or, if an eigenvalue is near it, a border beyond it.

        Equal counts on both sides of the value prove that no eigenvalue is near, even if a pivot
        vanishes at the value. Otherwise counts at increasing distances find the next gap, whose
        middle is the border: above the value if `outward` is 1, below it if -1. With `wide` the
        border is always the middle of the gap. `FactorizationError` is raised if there is no gap
        within an eighth of the value.
        """
        if value in self._settled:
            return value
        scale = max(abs(value), 1.0)
        places = [value + outward * scale * rung for rung in (-_RUNGS[0], *_RUNGS)]
        begin: tuple[float, int] | None = None
        end: float | None = None
        # The first two counts, one on each side, are always needed and run in parallel.
        groups = (places[:2], *([place] for place in places[2:]))
        counts = chain.from_iterable(self._each(group, self._count_at) for group in groups)
        for place, counted in zip(places, counts, strict=True):
            if counted is None or _BLURS * counted[1] > abs(place - value):
                continue
            inside = min(max(place, 0.0), self.top)
            if begin is not None and begin[1] == counted[0]:
                end = inside
                if not wide and place is places[1]:
                    return self._settled_at(value, begin[1], 0.25 * abs(end - begin[0]))
            elif end is None:
                begin = inside, counted[0]
            else:
                break
        if begin is None or end is None:
            raise FactorizationError(f"no gap in the spectrum near {value:.6g}")
        middle = end if end in (0.0, self.top) else 0.5 * (begin[0] + end)
        return self._settled_at(middle, begin[1], 0.25 * abs(end - begin[0]))

    def _settled_at(self, border: float, count: int, clearance: float) -> float:
        self._note(border, count, clearance)
        self._settled.add(border)
        return border

    def _count_at(self, place: float) -> tuple[int, float] | None:
        """Return the count below a value and its blur, or None if a pivot vanishes."""
        if place <= 0.0:
            return self._counts[0.0], 0.0
        if place >= self.top:
            return self._counts[self.top], 0.0
        factor = self._ordered.factor_at(place)
        return None if factor is None else (factor.count_below, factor.blur)

    def _each(self, values: Sequence[float], work: Callable[[float], T]) -> list[T]:
        """Apply `work`, which factors at a value, to several values in parallel."""
        if len(values) == 1 or self._n_jobs == 1:
            return [work(value) for value in values]
        with ThreadPoolExecutor(self._n_jobs, "count") as threads:
            return list(threads.map(work, values))

    def _count_all(self, values: Sequence[float]) -> None:
        """Count eigenvalues below or close to several values, in parallel."""
        unknown = sorted(set(values) - self._counts.keys())
        for shift, count, blur in self._each(unknown, self._count_near) if unknown else []:
            self._note(shift, count, max(_BLURS * blur, _CLEARANCE * max(shift, 1.0)))

    def _count_near(self, value: float) -> tuple[float, int, float]:
        factor = self._ordered.factor(value, _MOVE * max(value, 1e-3))
        if value in self._shifts:
            self._ordered.kept[factor.shift] = factor
        return factor.shift, factor.count_below, factor.blur

    def _note(self, knot: float, count: int, clearance: float) -> None:
        if knot not in self._counts:
            insort(self._knots, knot)
        self._counts[knot], self._clearance[knot] = count, clearance

    def find_top(self, least: int, most: int) -> float:
        """Return a value with `least` to `most` eigenvalues below it, and prepare slices.

        The first counts, in the middle of the first slices, measure the density of the spectrum;
        the slices reuse their factors. Further counts find the value and the borders below it in
        parallel. Neither the number of counts nor the result depends on `n_jobs`.
        """
        cuts = self._cuts(self._counts[0.0], most)
        ahead = cuts[:2]
        values = [self._step(*_window(cut.shift, cut.slack), 0)[0] for cut in ahead]
        self._shifts = set(sorted(values)[: self._n_jobs])
        if len(cuts) > len(ahead):
            values.append(self._step(least, most, 0)[0])
        borders = [_window(cut.border, cut.slack_parallel) for cut in ahead[: len(cuts) - 1]]
        self._count_all(values)
        for turn in range(3):
            steps = [self._step(*window, turn) for window in ((least, most), *borders)]
            values = [value for value, found in steps if not found]
            if steps[0][1]:
                break
            self._count_all(values)
        return self.find(least, most)

    def find(self, least: int, most: int) -> float:
        """Return a knot with `least` to `most` eigenvalues below it.

        If a multiple eigenvalue prevents this, the knot is above the eigenvalue.
        """
        for turn in range(80):
            value, found = self._step(least, most, turn)
            if found:
                return value
            self._count_all([value])
        raise ArithmeticError(f"no border between {least} and {most} eigenvalues")

    def _step(self, least: int, most: int, turn: int) -> tuple[float, bool]:
        """Return the result of `find` and True, or the value of the next count and False."""
        i = bisect_left(self._knots, least, key=self._counts.__getitem__)
        fitting = self._knots[i : bisect_right(self._knots, most, key=self._counts.__getitem__)]
        if fitting:
            middle = 0.5 * (least + most)
            return min(fitting, key=lambda knot: abs(self._counts[knot] - middle)), True
        low, high = self._knots[i - 1], self._knots[i]
        if high - low < 1e-6 * high:
            return self.settle(high, wide=True), True
        value = self._between(low, high, 0.5 * (least + most), last=i == len(self._knots) - 1)
        if turn % 2 and turn > 3:  # a multiple eigenvalue makes the count jump
            value = 0.5 * (low + high)
        return value, False

    def _between(self, low: float, high: float, wanted: float, last: bool) -> float:
        """Return the value of the next count, strictly between two knots.

        The count is interpolated by a power of the value; the exponent is 1 on a surface, and 1/2
        along the branches of a neuron. Weyl's law gives the first value.
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

    def around(self, value: float, wanted: int) -> tuple[float, float]:
        """Return two borders around a value with `wanted` or few more eigenvalues between them.

        Both have the same distance from the value, so its nearest eigenvalues are between them.
        """
        enough, too_few = 2.0 * self.top, 0.0
        radius = 0.5 * wanted
        # A value below the rounding error of eigenvalues is treated as 0.
        value = value if value > self._ordered.pencil.noise else 0.0
        for _ in range(60):
            low, high = max(value - radius, 0.0), min(value + radius, self.top)
            (below, above) = self._each([low, high], self._count_below)
            inside = above - (below if low > 0.0 else 0)
            if inside >= wanted:
                enough = radius
                if inside <= 1.5 * wanted + 10:
                    break
            else:
                too_few = radius
            if enough - too_few < 1e-6 * enough:
                break
            radius *= float(min(max((1.2 * wanted + 3.0) / max(inside, 1), 0.3), 4.0))
            if not too_few < radius < enough:
                radius = 0.5 * (too_few + enough)
        low, high = value - enough, value + enough
        low = self.settle(low, -1.0) if low > 0.0 else 0.0
        return low, self.settle(high) if high < self.top else self.top

    def _count_below(self, value: float) -> int:
        """Count eigenvalues below a value, or a value close to it."""
        known = self._counts.get(value)
        return self._count_near(value)[1] if known is None else known

    def slices(self, low: float, high: float, settled: bool = False) -> Iterator[Interval]:
        """Yield slices between two knots, lowest first; each border is counted when needed.

        If `settled`, every border is counted on both sides, which takes twice the time and is only
        needed after a border was found to lie on an eigenvalue.
        """
        first, last = self.count(low), self.count(high)
        cuts = self._cuts(first, last)
        if low > 0.0 or settled:
            cuts = [cut for cut in cuts if cut.border != cut.shift]
        for knot in [knot for knot in self._ordered.kept if not low < knot < high]:
            del self._ordered.kept[knot]
        start = low
        for cut in cuts:
            end = high
            if cut is not cuts[-1]:
                end = self.find(*_window(cut.border, cut.slack))
                end = min(self.settle(end, wide=True) if settled else end, high)
            if self.count(end) > self.count(start):
                yield self.interval(start, end)
            start = end

    def interval(self, start: float, end: float) -> Interval:
        """Return the slice between two knots."""
        # The null space is deflated; its rounding errors lie above the lower end.
        inner = start - 0.5 * self._clearance[start] if start > 0.0 else -0.02 * end
        first, shift = self.count(start), self._shift(start, end, inner)
        n_expected = self.count(end) - first
        return Interval(inner, end, first, n_expected, shift, self._clearance[end])

    def _cuts(self, first: int, last: int) -> list[_Cut]:
        """Return the cuts of the slices that contain eigenvalues `first` to `last`."""
        sizes = self._sizes(last - first)
        cuts = []
        for size, border in zip(sizes, accumulate(sizes, initial=first), strict=False):
            border += size
            if size < sizes[-1]:
                cuts.append(_Cut(border, border, _SLACK_FIRST * size, _SLACK_FIRST * size))
            else:
                cuts.append(
                    _Cut(border - 0.5 * size, border, _SLACK * size, _SLACK_PARALLEL * size)
                )
        return cuts

    def _shift(self, start: float, end: float, inner: float) -> float:
        """Return a knot near the median eigenvalue of a slice, or the middle of the slice."""
        below, above = self._counts[start], self._counts[end]
        inside = [knot for knot in self._knots if start < knot < end]
        if not inside and end in self._ordered.kept:  # a small first slice
            return end
        aside = {knot: abs(self._counts[knot] - 0.5 * (below + above)) for knot in inside}
        shift = min(inside, key=aside.__getitem__, default=start)
        allowed = _ASIDE if start > 0.0 else _ASIDE_LOWEST
        if not inside or aside[shift] > allowed * (above - below):
            shift = 0.5 * (inner + end)
        for knot in inside:
            if knot != shift:
                self._ordered.kept.pop(knot, None)
        return shift


class _Cut(NamedTuple):
    """Intended numbers of eigenvalues below the shift and the upper border of a slice.

    `slack` is the allowed deviation of these numbers, `slack_parallel` that of a border counted in
    parallel with other values.
    """

    shift: float
    border: float
    slack: float
    slack_parallel: float


def _window(place: float, slack: float) -> tuple[int, int]:
    """Return the smallest and largest allowed number of eigenvalues below a value."""
    return int(place - slack), int(place + slack) + 1
