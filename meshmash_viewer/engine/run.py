"""One decomposition from start to end: which way it goes, and who hears of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.certificate import Certificate
from meshmash_viewer.engine.arnoldi import pairs_of_inverse
from meshmash_viewer.engine.blas_threads import one_blas_thread
from meshmash_viewer.engine.dissection import DissectionCrew
from meshmash_viewer.engine.factorization import FactorizationError, OrderedPencil, order_pencil
from meshmash_viewer.engine.lanczos import IntervalPairs, measure_pairs
from meshmash_viewer.engine.orthogonality import orthonormalise
from meshmash_viewer.engine.output import Output
from meshmash_viewer.engine.pencil import Pencil, reduce_pencil
from meshmash_viewer.engine.plan import SpectrumPlan
from meshmash_viewer.engine.request import Request
from meshmash_viewer.engine.slices import run_slices
from meshmash_viewer.engine.workers import is_dense, worker_count
from meshmash_viewer.errors import InputError, UnprovenError
from meshmash_viewer.progress import Cancelled, Progress

__all__ = ["Run"]

FloatArray = npt.NDArray[np.float64]

#: A threshold keeps eigenvalues up to this relative distance above it: rounding.
_THRESHOLD_MARGIN = 1e-11
#: So many more pairs than asked for are borne with where a multiple eigenvalue ends the count.
_MOST_COPIES = 1000
#: Pairs of the slice below a threshold that is an eigenvalue.
_LAST_SLICE = 80
#: Pairs beyond those asked for that a given inverse is asked for.
_EXTRA = 6
#: What is said of stages in which no pairs are counted yet.
_MESSAGES = {
    "matrices": "Preparing the solver (the first run after an installation compiles it)",
    "order": "Factoring and counting eigenvalues",
}


class Run:
    """A request at work on a pencil.

    Attributes
    ----------
    output : Output
        What has come out so far.
    certificate : Certificate
        What proves that `output` holds all there is, once it is written.
    timings : dict of float
    """

    output: Output

    def __init__(self, stiffness: Any, mass: Any, request: Request) -> None:
        self.began = time.perf_counter()
        self.request = request
        # What is wrong with the matrices is said where they are reduced.
        crew = DissectionCrew(max(np.shape(stiffness), default=0))
        self.pencil = reduce_pencil(stiffness, mass)
        self._crew = crew
        self._count, self._remark = Certificate("none"), ""
        self.timings: dict[str, float] = {"matrices": time.perf_counter() - self.began}
        self._stop = np.zeros(1, dtype=np.uint8)
        self._plan: SpectrumPlan | None = None
        self._heard = 0.0
        self._jobs = 1

    @property
    def certificate(self) -> Certificate:
        """What proves that `output` holds all there is, with what was measured of its pairs."""
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

    def batches(self) -> Iterator[slice]:
        """Find everything; yields the places of rows that have just become final."""
        self._report("matrices")
        with one_blas_thread():
            try:
                yield from self._found()
            except (ArithmeticError, FactorizationError) as fault:
                if self._plan is not None:
                    self._stop[0] = 0
                    self._refuse_negative(self._plan)
                raise UnprovenError(
                    f"The eigenpairs of this matrix cannot be proven ({fault}): its entries may "
                    "differ too much in size; try robust=True, repair the mesh, or ask for "
                    "another number of pairs."
                ) from fault
            finally:
                if hasattr(self, "output"):
                    self.output.close()

    def _found(self) -> Iterator[slice]:
        if self.request.op_inv is None and self._is_dense(self.request.n_components or 0):
            yield from self._dense()
            return
        ordered = self._order()
        if self.request.op_inv is not None:
            pairs = self._through_given_inverse(ordered)
            if pairs is not None:
                yield from self._write_all(*pairs)
                return
            if self._is_dense(self.request.n_components or 0):
                yield from self._dense()
                return
        yield from self._sliced(ordered)

    def _is_dense(self, wanted: int) -> bool:
        return is_dense(self.pencil.n, self.pencil.n_null, wanted)

    def _order(self) -> OrderedPencil:
        started = time.perf_counter()
        ordered = order_pencil(self.pencil, self._poll, self._crew)
        self.pencil = ordered.pencil
        self._spend("order", started)
        self._report("order")
        return ordered

    # The lowest pairs, or those around a value, slice by slice -----------------------------------

    def _sliced(self, ordered: OrderedPencil) -> Iterator[slice]:
        pencil, request = self.pencil, self.request
        self._jobs = self._workers(ordered, request.n_components or 0)
        plan = SpectrumPlan(ordered, self._stop, self._poll, self._jobs, request.lean)
        self._plan = plan
        started = time.perf_counter()
        if request.target is not None:
            yield from self._nearest(ordered, plan, request.target / pencil.unit)
            return
        below, held = 0.0, None
        if request.max_eigenvalue is not None:
            threshold = request.max_eigenvalue / pencil.unit
            top = plan.settle(min(threshold, plan.top))
            wanted = plan.count(top)
            if wanted > plan.count(plan.settle(threshold, -1.0)):
                below, held = self._around_threshold(ordered, plan, threshold, top)
                wanted = held.interval.first + len(held.values)
        else:
            assert request.n_components is not None
            wanted = min(request.n_components, pencil.n)
            top = 0.0
            if wanted > pencil.n_null:
                top = plan.find_top(wanted, wanted + max(4, wanted // 40))
        counted = plan.count(top)
        self._spend("count", started)
        if self._is_dense(wanted):
            yield from self._dense()
            return
        if top > 0.0 and counted > _MOST_COPIES + 2 * wanted:
            raise UnprovenError(
                f"{counted - wanted} more eigenvalues than the {wanted} asked for are equal to "
                f"{top * pencil.unit:.4g}: ask for fewer pairs, or for all of them."
            )
        self._open(wanted)
        null = min(pencil.n_null, wanted)
        yield self._write(np.zeros(null), pencil.null_residuals[:null], pencil.null_rows(null))
        if wanted <= pencil.n_null:
            self._refuse_negative(plan)
            self._count = Certificate("inertia", counted, counted, top * pencil.unit)
            if pencil.n_null:
                self._count = Certificate("null space", pencil.n_null, pencil.n_null)
            return
        low = 0.0
        known = self._known(ordered, plan, top if held is None else below)
        if known is not None:
            low = known[0]
            yield self._write(*known[1:])
        yield from self._slices(ordered, plan, low, top if held is None else below)
        if held is not None:
            yield self._write(held.values, held.residuals, held.rows, held.orthonormality)
        self._count = Certificate("inertia", counted, counted, top * pencil.unit)

    def _around_threshold(
        self, ordered: OrderedPencil, plan: SpectrumPlan, threshold: float, top: float
    ) -> tuple[float, IntervalPairs]:
        """Where the last slice begins, and its pairs up to a threshold that is an eigenvalue.

        It is found first, since its values decide how many pairs there are to be.
        """
        less = plan.count(plan.settle(threshold, -1.0)) - _LAST_SLICE
        below = (
            plan.settle(plan.find(less, less + _LAST_SLICE // 2))
            if less > self.pencil.n_null
            else 0.0
        )
        held = next(
            run_slices(
                ordered,
                [plan.interval(below, top)],
                self.request.tolerance,
                1,
                self._stop,
                self._poll,
            )
        )
        self._stop[0] = 0
        null = np.zeros(self.pencil.n_null if below == 0.0 else 0)
        kept = self._kept(np.concatenate([null, held.values]), threshold) - len(null)
        pairs = replace(
            held,
            values=held.values[:kept],
            residuals=held.residuals[:kept],
            rows=held.rows[:kept],
        )
        return below, pairs

    def _refuse_negative(self, plan: SpectrumPlan) -> None:
        if negative := plan.negative():
            raise InputError(
                f"The Laplacian has negative eigenvalues, {negative} of {self.pencil.n}: it must "
                "be positive semidefinite, as that of every mesh is."
            )

    def _kept(self, values: FloatArray, threshold: float) -> int:
        """How many of ascending eigenvalues a threshold keeps: all copies of one, or none."""
        rounding = max(_THRESHOLD_MARGIN * threshold, self.pencil.noise)
        kept = int(np.searchsorted(values, threshold + rounding, side="right"))
        while 0 < kept < len(values) and values[kept] - values[kept - 1] <= rounding:
            kept += 1
        copies = int(np.count_nonzero(np.abs(values - threshold) <= rounding))
        if copies and threshold > rounding:
            number = "which is" if copies == 1 else f"whose {copies} copies are"
            self._remark = f"the threshold is an eigenvalue, {number} included"
        return kept

    def _workers(self, ordered: OrderedPencil, pairs: int) -> int:
        return worker_count(ordered, self.request.n_jobs, pairs, self.request.lean)

    def _slices(
        self, ordered: OrderedPencil, plan: SpectrumPlan, low: float, high: float
    ) -> Iterator[slice]:
        """Write the pairs from low to high; where a border proves doubtful, go on from there.

        That a border lies on an eigenvalue is seen when its slice is found. The slices below it
        stay; all further borders are then counted on both sides.
        """
        started = time.perf_counter()
        jobs = self._workers(ordered, plan.count(high))
        for settled in (False, True):
            try:
                for pairs in run_slices(
                    ordered,
                    plan.slices(low, high, settled),
                    self.request.tolerance,
                    jobs,
                    self._stop,
                    self._poll,
                ):
                    yield self._write(
                        pairs.values, pairs.residuals, pairs.rows, pairs.orthonormality
                    )
                    low = pairs.interval.high
                    ordered.give_back(pairs.rows)
                break
            except (ArithmeticError, FactorizationError):
                self._stop[0] = 0
                if settled:
                    raise
                high = plan.settle(high)
        self._spend("slices", started)

    def _known(
        self, ordered: OrderedPencil, plan: SpectrumPlan, top: float
    ) -> tuple[float, FloatArray, FloatArray, FloatArray] | None:
        """Pairs of an earlier run up to a border between them, if they fit this problem."""
        known, pencil = self.request.known, self.pencil
        if known is None or known.rows.shape[1] != pencil.n_all:
            return None
        inside = np.flatnonzero(known.eigenvalues[pencil.n_null :] < top * pencil.unit)
        if len(inside) < 8:
            return None
        rows = np.asarray(known.rows[pencil.n_null + inside], dtype=np.float64)
        rows = np.ascontiguousarray(rows[:, pencil.active]) * pencil.root_mass
        if known.rows.dtype != np.float64 or not np.isfinite(rows).all():
            return None
        values, residuals = measure_pairs(ordered, rows)
        if (residuals > 1e-7 * np.maximum(values, 1e-3)).any():
            return None
        # The border goes into the widest gap near the end, where no multiple eigenvalue is cut.
        tail = max(1, len(values) - 16)
        cut = tail + int(np.argmax(np.diff(values[tail - 1 :])))
        try:
            border = plan.settle(0.5 * float(values[cut - 1] + values[cut]))
        except FactorizationError:
            return None
        if border >= values[cut] or plan.count(border) != pencil.n_null + cut:
            return None
        try:
            orthonormalise(rows[:cut])
        except ArithmeticError:
            return None
        return border, values[:cut], residuals[:cut], rows[:cut]

    def _nearest(self, ordered: OrderedPencil, plan: SpectrumPlan, sigma: float) -> Iterator[slice]:
        """The pairs nearest a value: everything within a radius that holds enough, then those."""
        pencil = self.pencil
        assert self.request.n_components is not None
        wanted = min(self.request.n_components, pencil.n)
        sigma = min(sigma, plan.top)
        low, high = plan.around(sigma, wanted)
        inside = plan.count(high) - (plan.count(low) if low > 0.0 else 0)
        parts = []
        if low == 0.0:
            null = min(pencil.n_null, wanted)
            parts.append((np.zeros(null), pencil.null_residuals[:null], pencil.null_rows(null)))
        jobs = self._workers(ordered, inside)
        for pairs in run_slices(
            ordered,
            plan.slices(low, high, settled=True),
            self.request.tolerance,
            jobs,
            self._stop,
            self._poll,
        ):
            parts.append((pairs.values, pairs.residuals, pairs.rows))
        values, residuals = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        rows = np.concatenate([part[2] for part in parts])
        chosen = np.sort(np.argsort(np.abs(values - sigma), kind="stable")[:wanted])
        unit = pencil.unit
        self._count = Certificate("inertia", inside, inside, high * unit, low * unit)
        rows = rows[chosen]
        orthonormalise(rows)
        yield from self._write_all(values[chosen], residuals[chosen], rows)

    # Other ways ----------------------------------------------------------------------------------

    def _dense(self) -> Iterator[slice]:
        """All that is asked for, from the dense matrix of each component."""
        started = time.perf_counter()
        pencil = self.pencil
        values, columns = _dense_pairs(pencil, self._poll)
        lowest = float(values.min(initial=0.0))
        if lowest < -max(1e-6, 1e-9 * pencil.norm):
            raise InputError(
                f"The Laplacian has a negative eigenvalue, {lowest * pencil.unit:.4g}: it must "
                "be positive semidefinite, as that of every mesh is."
            )
        n_null = pencil.n_null
        chosen = self._chosen(np.concatenate([np.zeros(n_null), values]))
        null = chosen[chosen < n_null]
        rows = np.concatenate(
            [
                pencil.null_rows(len(null) and int(null[-1]) + 1)[null],
                columns[:, chosen[len(null) :] - n_null].toarray().T,
            ]
        )
        values = np.concatenate([np.zeros(len(null)), values[chosen[len(null) :] - n_null]])
        weight = pencil.root_mass
        # Sums in more digits, where the platform has them: what is measured is not their rounding.
        image = (pencil.matrix.astype(np.longdouble) @ rows.T.astype(np.longdouble)).T
        defect = np.asarray(image - values[:, None] * rows, dtype=np.float64) * weight
        residuals = np.linalg.norm(defect, axis=1) / np.linalg.norm(rows * weight, axis=1)
        self._spend("dense", started)
        # Pairs around a shift say where they begin, as those that were counted do.
        low = float(values[0]) * pencil.unit if len(chosen) and chosen[0] > 0 else None
        self._count = Certificate("dense", pencil.n, pencil.n, low=low)
        yield from self._write_all(values, residuals, rows)

    def _chosen(self, values: FloatArray) -> npt.NDArray[np.intp]:
        """Indices of the pairs that are asked for, of all eigenvalues in ascending order."""
        pencil, request = self.pencil, self.request
        if request.max_eigenvalue is not None:
            return np.arange(self._kept(values, request.max_eigenvalue / pencil.unit))
        if request.target is None:
            return np.arange(min(request.n_components or 0, len(values)))
        distance = np.abs(values - request.target / pencil.unit)
        return np.sort(np.argsort(distance, kind="stable")[: request.n_components])

    def _through_given_inverse(
        self, ordered: OrderedPencil
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Pairs through `op_inv`; None if a count shows that it missed some.

        A few more than asked for are found, so that the count can end in the widest gap behind
        the last one.
        """
        pencil, request = self.pencil, self.request
        assert request.n_components is not None
        started = time.perf_counter()
        wanted, n_rest = request.n_components, pencil.n - pencil.n_null
        asked = min(wanted + _EXTRA, n_rest - 1)
        if asked < 1 or wanted >= pencil.n_null + asked:
            return None
        found, rows = pairs_of_inverse(pencil, request.op_inv, asked, request.ncv, self._poll)
        values = np.concatenate([np.zeros(pencil.n_null), found])
        if len(values) <= wanted:
            return None
        sigma = (request.target or 0.0) / pencil.unit
        distance = np.abs(values - sigma)
        order = np.argsort(distance, kind="stable")
        away = distance[order]
        last = wanted - 1 + int(np.argmax(np.diff(away[wanted - 1 :])))
        radius = 0.5 * float(away[last] + away[last + 1])
        plan = SpectrumPlan(ordered, self._stop, self._poll)
        low = plan.settle(sigma - radius) if sigma > radius else 0.0
        high = plan.settle(sigma + radius)
        counted = plan.count(high) - (plan.count(low) if low > 0.0 else 0)
        self._spend("given inverse", started)
        if counted != last + 1:
            return None
        chosen = np.sort(order[:wanted])
        n_null = int(np.searchsorted(chosen, pencil.n_null))
        rows = np.concatenate(
            [pencil.null_rows(wanted)[chosen[:n_null]], rows[chosen[n_null:] - pencil.n_null]]
        )
        orthonormalise(rows)
        residuals = measure_pairs(ordered, rows)[1]
        unit = pencil.unit
        self._count = Certificate(
            "inertia", counted, last + 1, high * unit, low * unit if low > 0.0 else None
        )
        return values[chosen], residuals, rows

    # What comes out ------------------------------------------------------------------------------

    def _open(self, k: int) -> None:
        request = self.request
        self.output = Output(
            self.pencil,
            k,
            request.precision,
            request.max_eigenvalue,
            request.allocate,
            self._jobs,
        )

    def _write_all(
        self, values: FloatArray, residuals: FloatArray, rows: FloatArray
    ) -> Iterator[slice]:
        self._open(len(values))
        yield self._write(values, residuals, rows)

    def _write(
        self,
        values: FloatArray,
        residuals: FloatArray,
        rows: FloatArray,
        orthonormality: float | None = None,
    ) -> slice:
        started = time.perf_counter()
        output = self.output
        place = output.write(values, residuals, rows, orthonormality)
        self._spend("output", started)
        if self.request.on_pairs is not None:
            self.request.on_pairs(
                place.start, output.eigenvalues[place].copy(), output.residuals[place].copy()
            )
        self._report("eigenpairs", output.written, output.total)
        return place

    def _spend(self, stage: str, started: float) -> None:
        self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - started

    def _poll(self) -> None:
        if self.request.cancel is not None and self.request.cancel():
            self._stop[0] = 1
            raise Cancelled("the decomposition was cancelled")

    def _report(self, stage: str, done: int = 0, total: int = 0) -> None:
        self._poll()
        if self.request.progress is None:
            return
        fraction = done / total if total else 0.0
        elapsed = time.perf_counter() - self.began
        self.request.progress(
            Progress(
                stage=stage,
                fraction=fraction,
                remaining=elapsed * (1.0 / fraction - 1.0) if fraction > 0.05 else None,
                message=f"{done} of {total} eigenpairs" if total else _MESSAGES.get(stage, stage),
                converged=done,
                total=total,
            )
        )


def _dense_pairs(pencil: Pencil, poll: Callable[[], None]) -> tuple[FloatArray, Any]:
    """All pairs beyond the known null space: ascending values, shape (r,), and sparse columns.

    Component by component, since one may be a million times as stiff as another.
    """
    from scipy import sparse
    from scipy.linalg import eigh
    from scipy.sparse.csgraph import connected_components

    count, component = connected_components(pencil.matrix, directed=False)
    places = np.split(
        np.argsort(component, kind="stable"),
        np.cumsum(np.bincount(component, minlength=count))[:-1],
    )
    values, columns, rows, starts = [], [], [], [0]
    for place in places:
        is_null = pencil.labels[place[0]] >= 0
        if is_null and len(place) == 1:
            continue
        poll()
        matrix = pencil.matrix[place][:, place].toarray()
        if is_null:
            # Lifted above all others, the constant does not mix with small eigenvalues.
            constant = pencil.null_direction[place]
            matrix += 1.1 * np.abs(matrix).sum(axis=0).max() * np.outer(constant, constant)
        found, vectors = eigh(matrix, driver="evd")
        kept = len(place) - int(is_null)
        values.append(found[:kept])
        columns.append(vectors[:, :kept].T.ravel())
        rows.append(np.tile(place, kept))
        starts.extend(starts[-1] + len(place) * np.arange(1, kept + 1))
    if not values:
        return np.zeros(0), sparse.csc_array((pencil.n, 0))
    every = np.concatenate(values)
    parts = (np.concatenate(columns), np.concatenate(rows), np.array(starts))
    matrix = sparse.csc_array(parts, shape=(pencil.n, len(every)))
    order = np.argsort(every, kind="stable")
    return every[order], matrix[:, order]
