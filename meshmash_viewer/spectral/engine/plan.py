"""Cutting the spectrum into slices of about equal content, by counting eigenvalues.

Weyl's law says where to look first; it is off by a factor of two on a neuron, so every count
corrects it. Counts are exact (Sylvester's law of inertia), so each slice has a known number to
find; where a border lies next to an eigenvalue, the count is proved by counts on both sides.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import accumulate, chain
from math import log
from typing import NamedTuple, TypeVar

from meshmash_viewer.spectral.engine.factorization import (
    FactorizationError,
    OrderedPencil,
    StopFlag,
)
from meshmash_viewer.spectral.engine.lanczos import Interval

T = TypeVar("T")

#: A border may lie this far, in parts of a slice, from where it was meant to be: where counting
#: again would be waited for, and where it goes on beside another count.
_SLACK, _SLACK_BESIDE = 0.2, 0.05
#: The border of a small first slice may lie anywhere near: no count is made for it alone.
_SLACK_FIRST = 0.5
#: A shift may lie this far from the middle of its slice, in parts of what it holds: farther out
#: more steps are needed than a factor costs. In the lowest slice, whose far end is sparse, it
#: matters less.
_ASIDE, _ASIDE_LOWEST = 0.06, 0.25
#: Distances, relative to a value, at which it is counted on both sides.
_RUNGS = tuple(1e-9 * 8.0**i for i in range(10))
#: A count speaks of eigenvalues farther away than so many times the blur of its factor.
_BLURS = 16.0
#: An eigenvalue nearer to a border than this, relative to it, makes its count doubtful.
_CLEARANCE = 1e-10
#: A shift that meets a vanishing pivot is moved by this share of itself at most.
_MOVE = 1e-2


class SpectrumPlan:
    """Counts of eigenvalues below chosen values, and slices between them.

    Values are in the reduced problem, and counts include the null space.

    Parameters
    ----------
    ordered : OrderedPencil
    stop : ndarray of uint8, shape (1,)
        Set from outside to end a running factorization.
    sizes : callable
        Gives, for a number of pairs, how many each slice is to hold.
    n_jobs : int
        Counts at a time, where several are known to be needed.

    Attributes
    ----------
    top : float
        A value above the whole spectrum.
    """

    def __init__(
        self,
        ordered: OrderedPencil,
        stop: StopFlag,
        sizes: Callable[[int], list[float]],
        n_jobs: int = 1,
    ) -> None:
        self._ordered = ordered
        self._sizes = sizes
        self._stop = stop
        self._n_jobs = n_jobs
        pencil = ordered.pencil
        self.top = 1.01 * pencil.norm + 1.0
        self._counts = {0.0: pencil.n_null, self.top: pencil.n}
        self._knots = [0.0, self.top]
        self._shifts: set[float] = set()
        # How near an eigenvalue may lie to a knot before its count is in doubt.
        self._clearance = {0.0: 0.0, self.top: 0.0}
        self._settled = {0.0, self.top}

    def count(self, knot: float) -> int:
        """Eigenvalues below a value that was counted at: what `find` and `settle` return."""
        return self._counts[knot]

    def negative(self) -> int:
        """Number of eigenvalues that are below zero by more than rounding."""
        below = -max(1e-6, 1e-9 * self.top)
        return self._each([below], lambda v: self._ordered.factor(v, -v, self._stop).count_below)[0]

    def settle(self, value: float, outward: float = 1.0, *, wide: bool = False) -> float:
        """A border at a value, or as little beyond as it takes to be clear of all eigenvalues.

        Counts on both sides that agree prove that nothing lies between them, wherever in between
        a pivot vanishes. Where they differ, the value is an eigenvalue or next to one, and counts
        at larger and larger distances find the gap behind it; the border goes into its middle.

        Parameters
        ----------
        value : float
        outward : {1.0, -1.0}
            The side on which the border may lie.
        wide : bool
            Whether it is to lie in the middle of the gap in any case: an eigenvalue is near.

        Returns
        -------
        float
            The value itself where it is clear.

        Raises
        ------
        FactorizationError
            If there is no gap within an eighth of the value.
        """
        if value in self._settled:
            return value
        scale = max(abs(value), 1.0)
        places = [value + outward * scale * rung for rung in (-_RUNGS[0], *_RUNGS)]
        begin: tuple[float, int] | None = None
        end: float | None = None
        # Two sides are always needed, so they are counted side by side.
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
        """Eigenvalues below a place and the blur of that count, or None if a pivot vanishes."""
        if place <= 0.0:
            return self._counts[0.0], 0.0
        if place >= self.top:
            return self._counts[self.top], 0.0
        factor = self._ordered.factor_at(place, self._stop)
        return None if factor is None else (factor.count_below, factor.blur)

    def _each(self, values: Sequence[float], work: Callable[[float], T]) -> list[T]:
        """Work that factors, for several values side by side."""
        if len(values) == 1 or self._n_jobs == 1:
            return [work(value) for value in values]
        with ThreadPoolExecutor(self._n_jobs, "count") as threads:
            return list(threads.map(work, values))

    def _count_all(self, values: Sequence[float]) -> None:
        """Count below several values, or next to them, side by side."""
        unknown = sorted(set(values) - self._counts.keys())
        for shift, count, blur in self._each(unknown, self._count_near) if unknown else []:
            self._note(shift, count, max(_BLURS * blur, _CLEARANCE * max(shift, 1.0)))

    def _count_near(self, value: float) -> tuple[float, int, float]:
        factor = self._ordered.factor(value, _MOVE * max(value, 1e-3), self._stop)
        if value in self._shifts:
            self._ordered.kept[factor.shift] = factor
        return factor.shift, factor.count_below, factor.blur

    def _note(self, knot: float, count: int, clearance: float) -> None:
        if knot not in self._counts:
            insort(self._knots, knot)
        self._counts[knot], self._clearance[knot] = count, clearance

    def find_top(self, least: int, most: int) -> float:
        """A value with `least` to `most` eigenvalues below it, and knots that slices will need.

        The first counts are made in the middle of the first slices, whose factors these then are;
        they say how dense the spectrum is, and the next counts find its top and the borders below
        that, side by side. How many does not depend on `n_jobs`, nor does what is found.
        """
        cuts = self._cuts(self._counts[0.0], most)
        ahead = cuts[:2]
        values = [self._step(*_window(cut.shift, cut.slack), 0)[0] for cut in ahead]
        self._shifts = set(sorted(values)[: self._n_jobs])
        if len(cuts) > len(ahead):
            values.append(self._step(least, most, 0)[0])
        borders = [_window(cut.border, cut.slack_beside) for cut in ahead[: len(cuts) - 1]]
        self._count_all(values)
        for turn in range(3):
            steps = [self._step(*window, turn) for window in ((least, most), *borders)]
            values = [value for value, found in steps if not found]
            if steps[0][1]:
                break
            self._count_all(values)
        return self.find(least, most)

    def find(self, least: int, most: int) -> float:
        """A knot with `least` to `most` eigenvalues below it.

        Where a multiple eigenvalue leaves no such place, one clear above it.
        """
        for turn in range(80):
            value, found = self._step(least, most, turn)
            if found:
                return value
            self._count_all([value])
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
            return self.settle(high, wide=True), True
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

    def around(self, value: float, wanted: int) -> tuple[float, float]:
        """Borders around a value with at least `wanted` eigenvalues between, and few more.

        Both are at the same distance, so those nearest the value are among them.
        """
        enough, too_few = 2.0 * self.top, 0.0
        radius = 0.5 * wanted
        # Down there nothing but rounding tells a value from the null space.
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
        """Eigenvalues below a value or next to it."""
        known = self._counts.get(value)
        return self._count_near(value)[1] if known is None else known

    def slices(self, low: float, high: float, settled: bool = False) -> Iterator[Interval]:
        """Slices from low to high, lowest first; borders are counted as they are reached.

        Parameters
        ----------
        low, high : float
            Knots.
        settled : bool
            Whether every border is counted on both sides: twice the counts, needed only where a
            slice has shown that one lies on an eigenvalue.
        """
        first, last = self.count(low), self.count(high)
        cuts = self._cuts(first, last)
        if low > 0.0 or settled:
            cuts = [cut for cut in cuts if cut.border != cut.shift]
        for knot in [knot for knot in self._ordered.kept if not low < knot < high]:
            del self._ordered.kept[knot]
        start, index = low, 0
        for cut in cuts:
            end = high
            if cut is not cuts[-1]:
                end = self.find(*_window(cut.border, cut.slack))
                end = min(self.settle(end, wide=True) if settled else end, high)
            if self.count(end) > self.count(start):
                yield self.interval(start, end, index)
                index += 1
            start = end

    def interval(self, start: float, end: float, index: int = 0) -> Interval:
        """The slice between two knots."""
        # The null space is deflated; what rounding leaves of it is below zero.
        inner = start - 0.5 * self._clearance[start] if start > 0.0 else -0.02 * end
        first, shift = self.count(start), self._shift(start, end, inner)
        owed = self.count(end) - first
        return Interval(index, inner, end, first, owed, shift, self._clearance[end])

    def _cuts(self, first: int, last: int) -> list[_Cut]:
        """Where slices of so many eigenvalues are cut; `first` of them lie below the lowest."""
        sizes = self._sizes(last - first)
        cuts = []
        for size, border in zip(sizes, accumulate(sizes, initial=first), strict=False):
            border += size
            if size < sizes[-1]:
                cuts.append(_Cut(border, border, _SLACK_FIRST * size, _SLACK_FIRST * size))
            else:
                cuts.append(_Cut(border - 0.5 * size, border, _SLACK * size, _SLACK_BESIDE * size))
        return cuts

    def _shift(self, start: float, end: float, inner: float) -> float:
        """A knot with about as many eigenvalues of a slice on either side, or its middle."""
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
    """Of one slice, how many eigenvalues are to be below its shift and its upper border.

    What both may be off; and the border where it is counted beside other values.
    """

    shift: float
    border: float
    slack: float
    slack_beside: float


def _window(place: float, slack: float) -> tuple[int, int]:
    """Least and most eigenvalues below a value that may be off by so many."""
    return int(place - slack), int(place + slack) + 1
