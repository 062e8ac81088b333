"""Eigenpairs of the reduced problem in one interval, by shifted block Lanczos.

Grimes, Lewis & Simon 1994: the inverse ``(A - σ)^-1`` maps the eigenvalues around the shift to
the ends of its spectrum, where a block Krylov basis finds them first. The number of pairs in the
interval is known from inertia, so the iteration ends when this number has converged.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import replace

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.spectral.engine.basis import BLOCK, KrylovBasis, orthonormalise, project_out
from meshmash_viewer.spectral.engine.factorization import Factor, OrderedPencil
from meshmash_viewer.spectral.engine.pairs import Interval, ReducedPairs, joined
from meshmash_viewer.spectral.engine.refinement import refine_pairs, rotate_to_pairs

#: Slope and intercept of the usual basis size at convergence, as a function of the number of pairs.
_USUAL = (2.3, 56)
#: Number of consecutive restarts without new pairs after which an interval fails.
_PATIENCE = 6
#: Factor of the tolerance after a restart without new pairs.
_LENIENCE = 1e3
#: Backward error of a factor above which the lowest pairs lose accuracy.
_BLURRED = 2e-14
#: Distance of an eigenvalue from the shift, in mean spacings, below which its rounding dominates.
_NEAR = 1e-3
#: Distance by which such a shift is moved, in mean spacings, and maximum number of moves.
_MOVE, _MOVES = 0.3, 5


class UnclearBorder(ArithmeticError):
    """An eigenvalue lies on the border of a slice, so its count is unreliable."""


def usual_rows(pairs: float) -> int:
    """Return the usual size of a basis when the pairs of a slice have converged."""
    return int(_USUAL[0] * pairs) + _USUAL[1]


def run_slices(
    ordered: OrderedPencil, intervals: Iterable[Interval], tolerance: float, n_jobs: int
) -> Iterator[ReducedPairs]:
    """Find the pairs of intervals in parallel, and yield the pairs of each interval in order.

    The kernels release the interpreter lock, so `n_jobs` threads are used; results do not depend on
    their number. `intervals` may be computed lazily; `tolerance` is the residual relative to the
    eigenvalue. If the iteration is left early, running kernels are stopped.
    """
    if n_jobs == 1:
        for interval in intervals:
            yield find_pairs(ordered, interval, tolerance)
        return
    with ThreadPoolExecutor(n_jobs, "slice") as threads:
        started: deque[Future[ReducedPairs]] = deque()
        try:
            for interval in intervals:
                started.append(threads.submit(find_pairs, ordered, interval, tolerance))
                busy = [slice_ for slice_ in started if not slice_.done()]
                if len(busy) == n_jobs:
                    wait(busy, return_when=FIRST_COMPLETED)
                while started and started[0].done():
                    yield started.popleft().result()
            while started:
                yield started.popleft().result()
        except BaseException:
            ordered.stop[0] = 1
            raise


def find_pairs(ordered: OrderedPencil, interval: Interval, tolerance: float) -> ReducedPairs:
    """Find the pairs of an interval, or the lowest `most` of them.

    `tolerance` is the residual relative to the eigenvalue. `UnclearBorder` is raised if the upper
    end lies on an eigenvalue, `ArithmeticError` if the iteration fails, `Cancelled` if another
    thread stops it.
    """
    low, high, repeated = interval.low, interval.high, ordered.repeated
    count = repeated.count(low, high)
    if count != repeated.count(low, high - interval.clearance):
        raise UnclearBorder(f"an eigenvalue lies on the border {high:.6g}")
    rest = replace(interval, n_expected=interval.n_expected - count)
    pairs, factor = _search(ordered, rest, tolerance)
    if count:
        pairs = joined([pairs, repeated.within(low, high, interval.most)])
    order = np.argsort(pairs.values, kind="stable")[: interval.most]
    if np.any(np.diff(order) < 0) or len(order) < len(pairs):
        pairs = pairs[order]
    pairs = refine_pairs(ordered, factor, pairs, tolerance, lowest=low < 0.0)
    return replace(pairs, interval=interval)


def _search(
    ordered: OrderedPencil, interval: Interval, tolerance: float
) -> tuple[ReducedPairs, Factor]:
    """Find the pairs of an interval with Krylov bases, restarted until all are found.

    Pairs of repeated components are not sought. Returns the pairs and the last factor.
    """
    width = interval.high - interval.low
    factor = _factor(ordered, interval)
    n, n_expected = ordered.pencil.n, interval.n_expected
    left_out = ordered.repeated.vertices(interval.low, interval.high)
    n_left_out = 0 if left_out is None else int(left_out.sum())
    found = nothing = ReducedPairs(np.zeros(0), np.zeros((0, n)), orthonormality=0.0)
    fruitless = 0
    moves = 0
    careful = False
    spacing = width / max(n_expected, 1)
    for attempt in range(40 + n_expected):
        missing = n_expected - len(found)
        if missing <= 0:
            break
        # One missing copy of a multiple eigenvalue may take as many steps as all pairs.
        free = n - ordered.pencil.n_null - len(found) - n_left_out
        # A basis that is too small cannot resolve close pairs near an end: double its capacity.
        capacity = (4 * n_expected + 20 * BLOCK) * 2**fruitless
        capacity = min(capacity, BLOCK * max(free // BLOCK, 1))
        seed = (interval.first, n_expected, attempt)
        basis = KrylovBasis(ordered, factor, found.rows, capacity, seed, careful, left_out)
        # The last pairs, which converge slowly, are refined afterwards.
        target = tolerance * (_LENIENCE if fruitless else 1.0)
        try:
            new = rotate_to_pairs(
                ordered, _converge(basis, interval, missing, factor.shift, target)
            )
        except UnclearBorder:
            raise
        except (ArithmeticError, np.linalg.LinAlgError):
            # The basis lost its orthogonality and contained a pair twice.
            new, careful = nothing, True
        del basis  # free its memory before the next one is allocated
        if moves < _MOVES and np.any(np.abs(new.values - factor.shift) < _NEAR * spacing):
            moves += 1
            factor = ordered.factor(factor.shift + _MOVE * spacing, 0.03 * width)
            found = nothing
            continue
        fruitless = fruitless + 1 if len(new) == 0 else 0
        if fruitless == _PATIENCE:
            break
        if len(found):
            for _ in range(2):
                project_out(new.rows, found.rows)
                orthonormalise(new.rows)
            new = joined([found, new])
            new = replace(new, orthonormality=orthonormalise(new.rows))
        found = new
    if len(found) != n_expected:
        raise ArithmeticError(
            f"{len(found)} of {n_expected} eigenvalues found between "
            f"{interval.low:.6g} and {interval.high:.6g}"
        )
    return found, factor


def _factor(ordered: OrderedPencil, interval: Interval) -> Factor:
    """Return a factor at the shift of an interval or close to it.

    A nearly vanishing pivot hardly affects eigenvalues far above zero. In the lowest slice all
    pairs would have to be refined, and another factor is cheaper.
    """
    nudge = 0.03 * (interval.high - interval.low)
    best = ordered.factor(interval.shift, nudge)
    for side in (1.0, -1.0):
        if interval.low > 0.0 or best.error < _BLURRED:
            break
        other = ordered.factor(interval.shift + side * nudge, nudge)
        best = min(best, other, key=lambda factor: factor.error)
    return best


def _converge(
    basis: KrylovBasis, interval: Interval, missing: int, shift: float, tolerance: float
) -> FloatArray:
    """Extend a basis until the missing pairs have converged or no new pairs appear.

    Returns nearly orthonormal rows of ascending eigenvalues, shape (p, n).
    """
    b = BLOCK
    usual = min(usual_rows(missing), basis.capacity)
    # Early checks find multiple eigenvalues, of which a basis contains at most eight copies.
    check = min(10 * b, usual)
    stagnant = 0
    before = (-1, -1)
    worst_before: tuple[int, float] | None = None
    while True:
        basis.extend()
        size = basis.size
        full = size + b > basis.capacity
        if size < check and not full:
            continue
        pairs = basis.ritz()
        theta = shift + 1.0 / pairs.mu
        inside = (theta > interval.low) & (theta < interval.high)
        # `ratio` compares residuals after one more implicit solve, independent of the norm of A,
        # with a bound, limited by the width so that distant slices are equally orthogonal.
        width = interval.high - interval.low
        wanted = tolerance * np.clip(np.abs(theta), 1e-3, width)
        floor = 1e-15 * np.linalg.norm(pairs.coupling) / pairs.mu**2
        ratio = pairs.errors / pairs.mu**2 / np.maximum(wanted, floor)
        converged = ratio <= 1.0
        if np.any(converged & (np.abs(theta - interval.high) < interval.clearance)):
            raise UnclearBorder(f"an eigenvalue lies on the border {interval.high:.6g}")
        n_inside, good = int(inside.sum()), int((inside & converged).sum())
        stagnant = stagnant + 1 if (n_inside, good) == before else 0
        before = (n_inside, good)
        # All pairs inside have converged, but fewer than expected: the basis contains no further
        # copies of multiple eigenvalues.
        copies_left = n_inside == good < missing and good > 0 and stagnant >= 2
        if good > missing:
            raise ArithmeticError("more pairs converged than were counted")
        if good == missing or full or copies_left:
            chosen = np.flatnonzero(inside & converged)
            chosen = chosen[np.argsort(theta[chosen], kind="stable")]
            return basis.vectors(pairs, chosen)
        check = size + (b if 0 < good == n_inside else 2 * b)
        if good < n_inside or good == 0:
            check = max(check, min(usual, 3 * size // 2))
        if n_inside == missing and good < missing:
            # Errors decrease by a constant factor: check again when they should be small enough.
            worst = float(np.log(ratio[inside].max()))
            if worst_before is not None and worst < worst_before[1]:
                rate = (worst_before[1] - worst) / (size - worst_before[0])
                check = max(check, size + b * int(0.9 * worst / rate / b))
            worst_before = (size, worst)
