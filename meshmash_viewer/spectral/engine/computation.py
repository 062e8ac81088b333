"""Computation of requested pairs by the fastest method: slices of the spectrum, or dense `eigh`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import UnprovenError
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.cost import can_be_dense, core_count, is_dense, worker_count
from meshmash_viewer.spectral.engine import known
from meshmash_viewer.spectral.engine.arnoldi import pairs_around
from meshmash_viewer.spectral.engine.basis import orthonormalise
from meshmash_viewer.spectral.engine.dense import DenseSpectrum, dense_residuals
from meshmash_viewer.spectral.engine.factorization import (
    FactorizationError,
    OrderedPencil,
    order_pencil,
)
from meshmash_viewer.spectral.engine.lanczos import find_pairs, run_slices
from meshmash_viewer.spectral.engine.output import Output, Pace
from meshmash_viewer.spectral.engine.pairs import Interval, ReducedPairs, joined
from meshmash_viewer.spectral.engine.pencil import Pencil, indefinite
from meshmash_viewer.spectral.engine.plan import SpectrumPlan
from meshmash_viewer.spectral.engine.refinement import measure_pairs
from meshmash_viewer.spectral.engine.request import Request

#: Relative rounding error by which an eigenvalue may exceed a threshold.
_THRESHOLD_MARGIN = 1e-11
#: Maximum number of additional pairs due to a multiple eigenvalue at the end of the count.
_MOST_COPIES = 1000
#: Number of pairs of the slice below a threshold that is an eigenvalue.
_LAST_SLICE = 80
#: Factor by which the highest border may be moved if its count is unreliable.
_BEYOND = 1.25


class Computation:
    """Computation of the pairs of a request, in one thread and the threads that it starts.

    `output` is the result so far. `sizes` returns the number of pairs of each slice for a total
    number. `report` receives functions that report progress, to be called by the starting thread.
    """

    output: Output

    def __init__(
        self,
        pencil: Pencil,
        request: Request,
        pace: Pace,
        sizes: Callable[[int], list[float]],
        report: Callable[[Callable[[], None]], None],
    ) -> None:
        self.pencil, self.request = pencil, request
        self._pace, self._sizes, self._report = pace, sizes, report
        self._count, self._remark = Certificate("none"), ""
        self.timings: dict[str, float] = {}
        self._stop = np.zeros(1, dtype=np.uint8)
        self.is_left = False
        self._ordered: OrderedPencil | None = None
        self._plan: SpectrumPlan | None = None
        # Determined here, since joblib's result depends on the calling thread.
        self._cores = core_count() if request.n_jobs is None else 1
        self._n_kept = 0  # leading pairs of `request.known` that are used

    @property
    def steps(self) -> int:
        """Number of blocks solved so far."""
        return 0 if self._ordered is None else self._ordered.steps

    def certificate(self) -> Certificate:
        """Return the certificate of `output`, with the measured errors of its pairs."""
        output = self.output
        worst = int(np.argmax(output.residuals)) if output.total else 0
        return replace(
            self._count,
            residual=float(output.residuals[worst]) if output.total else 0.0,
            residual_index=worst,
            orthonormality=output.orthonormality,
            precision="float32" if self.request.lean else "float64",
            remark=self._remark,
        )

    def leave(self) -> None:
        """Request an early end, from another thread."""
        self.is_left = True
        self._stop[0] = 1

    def _check(self) -> None:
        if self.is_left:
            raise Cancelled("the iterator was closed")

    def _resume(self) -> None:
        """Allow further slices after an error; raise `Cancelled` if the iterator was closed."""
        self._stop[0] = 0
        self._check()

    def batches(self) -> Iterator[slice]:
        """Compute all pairs; yield slices of rows when they become final."""
        try:
            yield from self._compute_by_best_method()
        except (ArithmeticError, FactorizationError, np.linalg.LinAlgError) as fault:
            if self._plan is not None:
                self._resume()
                self._refuse_negative(self._plan)
            raise UnprovenError(
                "not-provable",
                f"The eigenpairs of this matrix cannot be proven ({fault})",
                "use robust=True, repair the mesh, or ask for another number of pairs",
            ) from fault

    def _compute_by_best_method(self) -> Iterator[slice]:
        if self.request.op_inv is not None:
            pairs = self._through_given_inverse(self._order())
            if pairs is not None:
                yield from self._write_all(pairs)
                return
        if self._is_dense(self.request.n_components or 0):
            yield from self._dense()
            return
        try:
            yield from self._sliced(self._ordered or self._order())
        except (ArithmeticError, FactorizationError, np.linalg.LinAlgError):
            # Published pairs are final; before the first one a small mesh can be solved densely.
            n_published = self.output.written if hasattr(self, "output") else 0
            if n_published > self.pencil.n_null or not can_be_dense(self.pencil.n):
                raise
            self._resume()
            yield from self._dense()

    def _is_dense(self, wanted: int) -> bool:
        return is_dense(self.pencil.n, self.pencil.n_null, wanted)

    def _order(self) -> OrderedPencil:
        started = time.perf_counter()
        ordered = self._ordered = order_pencil(self.pencil)
        ordered.stop = self._stop
        self.pencil = ordered.pencil
        self._spend("order", started)
        self._report(partial(self._pace.stage, "order"))
        return ordered

    # -- the lowest pairs, or those around a value, slice by slice --------------------------------

    def _sliced(self, ordered: OrderedPencil) -> Iterator[slice]:
        pencil, request = self.pencil, self.request
        jobs = self._workers(ordered, request.n_components or 0)
        plan = SpectrumPlan(ordered, self._sizes, jobs)
        self._plan = plan
        started = time.perf_counter()
        if request.target is not None:
            yield from self._nearest(ordered, plan, request.target / pencil.unit)
            return
        below, last_slice = 0.0, None
        given = request.known
        is_known = given is not None and known.solves(given, ordered)
        if request.max_eigenvalue is not None:
            threshold = min(request.max_eigenvalue / pencil.unit, plan.top)
            top = plan.settle(threshold)
            ordered.repeated.solve(_BEYOND * top)
            wanted = plan.count(top)
            if wanted > plan.count(plan.settle(threshold, -1.0)):
                below, last_slice = self._around_threshold(ordered, plan, threshold, top)
                wanted = plan.count(below) + len(last_slice)
        else:
            assert request.n_components is not None
            wanted = min(request.n_components, pencil.n)
            top = 0.0
            if wanted > pencil.n_null:
                top = plan.find_top(wanted, wanted + max(4, wanted // 40))
                ordered.repeated.solve(_BEYOND * top)
        counted = plan.count(top)
        self._spend("count", started)
        if self._is_dense(wanted):
            yield from self._dense()
            return
        sought = counted - ordered.repeated.count(0.0, top)
        if top > 0.0 and sought > _MOST_COPIES + 2 * wanted:
            raise UnprovenError(
                "not-provable",
                f"{counted - wanted} more eigenvalues than the {wanted} requested are equal to"
                f" {top * pencil.unit:.4g}",
                "ask for fewer pairs, or for all of them",
            )
        end, last = (top, wanted) if last_slice is None else (below, plan.count(below))
        if given is not None and is_known and not (len(given) >= last == plan.count(end)):
            # Counted apart, so that the slices are those of a run without known pairs.
            aside = SpectrumPlan(ordered, self._sizes, jobs)
            is_known = known.agree_with_counts(given, aside, pencil, last)
        self._open(wanted, len(given) if given is not None and is_known else 0)
        yield from self._place_null()
        if wanted <= pencil.n_null:
            self._refuse_negative(plan)
            self._count = Certificate("inertia", counted, counted, top * pencil.unit)
            if pencil.n_null:
                self._count = Certificate("null space", pencil.n_null, pencil.n_null)
            return
        yield from self._slices(ordered, plan, end)
        if last_slice is not None:
            yield from self._place_slice(ordered, last_slice)
        self._count = Certificate("inertia", counted, counted, top * pencil.unit)

    def _around_threshold(
        self, ordered: OrderedPencil, plan: SpectrumPlan, threshold: float, top: float
    ) -> tuple[float, ReducedPairs]:
        """Return the start of the last slice, and its pairs, for a threshold at an eigenvalue.

        This slice is computed first, since its values determine the number of pairs.
        """
        less = plan.count(plan.settle(threshold, -1.0)) - _LAST_SLICE
        below = (
            plan.settle(plan.find(less, less + _LAST_SLICE // 2))
            if less > self.pencil.n_null
            else 0.0
        )
        interval = plan.interval(below, top)
        found = find_pairs(ordered, interval, self.request.tolerance)
        null = np.zeros(self.pencil.n_null if below == 0.0 else 0)
        kept = self._kept(np.concatenate([null, found.values]), threshold) - len(null)
        return below, found[:kept]

    def _refuse_negative(self, plan: SpectrumPlan) -> None:
        if negative := plan.negative():
            raise indefinite(f"{negative} of {self.pencil.n}")

    def _kept(self, values: FloatArray, threshold: float) -> int:
        """Return the number of eigenvalues up to a threshold, with all copies of the last one."""
        rounding = max(_THRESHOLD_MARGIN * threshold, self.pencil.noise)
        kept = int(np.searchsorted(values, threshold + rounding, side="right"))
        while 0 < kept < len(values) and values[kept] - values[kept - 1] <= rounding:
            kept += 1
        copies = int(np.count_nonzero(np.abs(values - threshold) <= rounding))
        if copies and threshold > rounding:
            number = "which is" if copies == 1 else f"whose {copies} copies are"
            self._remark = f"the threshold is an eigenvalue, {number} included"
        return kept

    def _found(
        self, ordered: OrderedPencil, intervals: Iterable[Interval], count: int
    ) -> Iterator[ReducedPairs]:
        """Find the pairs of intervals in parallel, as memory for `count` pairs allows."""
        jobs = self._workers(ordered, count)
        return run_slices(ordered, intervals, self.request.tolerance, jobs)

    def _workers(self, ordered: OrderedPencil, pairs: int) -> int:
        return self.request.n_jobs or worker_count(ordered, self._cores, pairs, self.request.lean)

    def _slices(self, ordered: OrderedPencil, plan: SpectrumPlan, high: float) -> Iterator[slice]:
        """Compute and write the pairs below a value, except slices that are known.

        If a border proves to lie on an eigenvalue, the slices already computed are kept, and
        further borders are counted on both sides.
        """
        if self._n_kept == self.output.total:
            yield from self._keep(self._n_kept)
        if high <= 0.0 or self.output.written == self.output.total:
            return
        started, low, count = time.perf_counter(), 0.0, plan.count(high)
        self._report(partial(self._pace.begin_slices, count - max(plan.count(low), self._n_kept)))
        for settled in (False, True):
            planned = plan.slices(low, high, settled)
            begun: list[Interval] = []
            try:
                for each in planned:
                    if self._n_kept < each.first + each.n_expected:
                        begun.append(each)
                        break
                    yield from self._keep(each.first + each.n_expected)
                intervals = (
                    replace(each, most=self._needed(each.first))
                    for each in chain(begun, planned)
                    if self._needed(each.first) != 0
                )
                for pairs in self._found(ordered, intervals, count):
                    yield from self._place_slice(ordered, pairs)
                    low = pairs.interval.high if pairs.interval else low
                    del pairs  # free its memory
                break
            except (ArithmeticError, FactorizationError):
                self._resume()
                if settled:
                    raise
                high = plan.settle(high, wide=True)
        self._spend("slices", started)

    def _needed(self, first: int) -> int | None:
        """Return the number of pairs needed of a slice from index `first`; None for all pairs."""
        return max(self.output.total - first, 0) if first >= self._n_kept else None

    def _place_slice(self, ordered: OrderedPencil, pairs: ReducedPairs) -> Iterator[slice]:
        """Accept the known pairs of a slice, and write the others."""
        first, kept = self.output.written, self._n_kept
        yield from self._keep(first + len(pairs))
        if kept <= first:
            yield from self._place(pairs)
        elif kept < first + len(pairs):
            rest = self._without_known(slice(first, kept), pairs)
            residuals = measure_pairs(ordered, rest.rows)[1]
            yield from self._place(replace(rest, residuals=residuals))

    def _without_known(self, part: slice, pairs: ReducedPairs) -> ReducedPairs:
        """Return the pairs of a slice that are not among a part of the known pairs."""
        assert self.request.known is not None
        return known.complement(self.request.known, self.pencil, part, pairs)

    def _place_null(self) -> Iterator[slice]:
        """Accept the known part of the requested null space, and write the rest."""
        kept, count = self._n_kept, min(self.pencil.n_null, self.output.total)
        yield from self._keep(count)
        if kept < count:
            yield from self._place(self._null_pairs(count)[kept:])

    def _null_pairs(self, count: int) -> ReducedPairs:
        pencil = self.pencil
        return ReducedPairs(np.zeros(count), pencil.null_rows(count), pencil.null_residuals[:count])

    def _nearest(self, ordered: OrderedPencil, plan: SpectrumPlan, sigma: float) -> Iterator[slice]:
        """Compute all pairs within a sufficient radius of a value, and select the nearest ones."""
        pencil = self.pencil
        assert self.request.n_components is not None
        wanted = min(self.request.n_components, pencil.n)
        sigma = min(sigma, plan.top)
        low, high = plan.around(sigma, wanted)
        inside = plan.count(high) - (plan.count(low) if low > 0.0 else 0)
        if self._is_dense(inside if low == 0.0 else inside + pencil.n_null):
            yield from self._dense()
            return
        parts = [self._null_pairs(min(pencil.n_null, wanted))] if low == 0.0 else []
        ordered.repeated.solve(_BEYOND * high)
        self._report(partial(self._pace.begin_slices, inside))
        parts += self._found(ordered, plan.slices(low, high, settled=True), inside)
        pairs = joined(parts)
        chosen = np.sort(np.argsort(np.abs(pairs.values - sigma), kind="stable")[:wanted])
        unit = pencil.unit
        # No lower end means that the pairs are the lowest.
        below = None if low == 0.0 and chosen[0] == 0 else low * unit
        self._count = Certificate("inertia", inside, inside, high * unit, below)
        pairs = replace(pairs[chosen], orthonormality=None)
        if len(parts) > 1:
            orthonormalise(pairs.rows)
            residuals = np.maximum(pairs.residuals, measure_pairs(ordered, pairs.rows)[1])
            pairs = replace(pairs, residuals=residuals)
        yield from self._write_all(pairs)

    # -- other methods ----------------------------------------------------------------------------

    def _dense(self) -> Iterator[slice]:
        """Compute the requested pairs from the dense matrix of each component."""
        started = time.perf_counter()
        pencil, given = self.pencil, self.request.known
        spectrum = DenseSpectrum(pencil, self._check)
        every, n_null = spectrum.values, pencil.n_null
        chosen = self._chosen(every)
        count, kept, is_begun = len(chosen), 0, hasattr(self, "output")
        if is_begun:
            kept = self.output.written
            if self.output.total != count:
                raise ArithmeticError("two counts disagree")
        elif given is not None and self.request.target is None:
            if known.fits(given, pencil) and known.agree(given, pencil, every):
                kept = min(len(given), count)
            if kept > n_null:
                # Include all copies of a multiple eigenvalue, of which some may be known.
                gaps = np.diff(every[count - 1 :]) > 1e-6 * np.maximum(every[count:], 1e-3)
                chosen = np.arange(count + (int(np.argmax(gaps)) if gaps.any() else len(gaps)))
        null = chosen[chosen < n_null]
        pairs = spectrum.pairs(chosen)
        # Pairs around a shift have a lower end.
        low = float(pairs.values[0]) * pencil.unit if len(chosen) and chosen[0] > 0 else None
        self._count = Certificate("dense", pencil.n, pencil.n, low=low)
        rest = pairs[kept:]
        if not is_begun and kept > n_null:
            try:
                rest = self._without_known(slice(n_null, kept), pairs[n_null:])
            except ArithmeticError:
                kept, rest = 0, pairs
        self._spend("dense", started)
        if not is_begun:
            self._open(count, kept)
            yield from self._keep(count)
        rest, null = rest[: count - kept], null[kept:]
        residuals = dense_residuals(pencil, rest)
        residuals[: len(null)] = pencil.null_residuals[null]
        yield from self._place(replace(rest, residuals=residuals))

    def _chosen(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """Return the indices of the requested pairs among all eigenvalues in ascending order."""
        pencil, request = self.pencil, self.request
        if request.max_eigenvalue is not None:
            return np.arange(self._kept(values, request.max_eigenvalue / pencil.unit))
        if request.target is None:
            return np.arange(min(request.n_components or 0, len(values)))
        # A target above the spectrum is moved to its end: distances from far away are equal.
        distance = np.abs(values - min(request.target / pencil.unit, values.max(initial=0.0)))
        return np.sort(np.argsort(distance, kind="stable")[: request.n_components])

    def _through_given_inverse(self, ordered: OrderedPencil) -> ReducedPairs | None:
        """Compute pairs with `op_inv`; return None if a count shows that some were missed."""
        started = time.perf_counter()
        pairs = pairs_around(self.pencil, self.request, self._check)
        if pairs is None or pairs.interval is None:
            return None
        plan, found = SpectrumPlan(ordered, self._sizes), pairs.interval
        low = plan.settle(found.low) if found.low > 0.0 else 0.0
        high = plan.settle(found.high)
        below = plan.count(low) if low > 0.0 else 0
        counted = plan.count(high) - below
        self._spend("given inverse", started)
        if counted != found.n_expected:
            return None
        unit = self.pencil.unit
        # No lower end means that the pairs are the lowest.
        begin = low * unit if below + found.first else None
        self._count = Certificate("inertia", counted, counted, high * unit, begin)
        return replace(pairs, residuals=measure_pairs(ordered, pairs.rows)[1])

    # -- output -----------------------------------------------------------------------------------

    def _open(self, k: int, n_known: int = 0) -> None:
        """Allocate k rows, of which the first are those of the `n_known` known pairs."""
        self._n_kept = min(k, n_known)
        self.output = Output.allocate(self.pencil, self.request, k, self._n_kept)

    def _keep(self, stop: int) -> Iterator[slice]:
        """Accept the known pairs below an index."""
        stop, given = min(stop, self._n_kept), self.request.known
        if given is not None and self.output.written < stop:
            started = time.perf_counter()
            place = self.output.keep(given, stop)
            self._spend("output", started)
            yield place

    def _write_all(self, pairs: ReducedPairs) -> Iterator[slice]:
        self._open(len(pairs))
        yield from self._place(pairs)

    def _place(self, pairs: ReducedPairs) -> Iterator[slice]:
        """Write the next pairs, up to the requested number."""
        if len(pairs) and self.output.written < self.output.total:
            started = time.perf_counter()
            place = self.output.write(pairs)
            self._spend("output", started)
            yield place

    def _spend(self, stage: str, started: float) -> None:
        self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - started
