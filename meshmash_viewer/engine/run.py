"""One decomposition from start to end: which way it goes, and who hears of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.certificate import Certificate
from meshmash_viewer.engine.arnoldi import pairs_of_inverse
from meshmash_viewer.engine.dissection import DissectionCrew
from meshmash_viewer.engine.factorization import OrderedPencil, order_pencil
from meshmash_viewer.engine.lanczos import measure_pairs
from meshmash_viewer.engine.orthogonality import orthonormalise
from meshmash_viewer.engine.output import Output
from meshmash_viewer.engine.pencil import reduce_pencil
from meshmash_viewer.engine.plan import SpectrumPlan
from meshmash_viewer.engine.request import Request
from meshmash_viewer.engine.slices import run_slices
from meshmash_viewer.engine.workers import is_dense, worker_count
from meshmash_viewer.progress import Cancelled, Progress

__all__ = ["Run"]

FloatArray = npt.NDArray[np.float64]

#: A threshold keeps eigenvalues up to this relative distance above it: rounding.
_THRESHOLD_MARGIN = 1e-11
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
        self._count = Certificate("none")
        self.timings: dict[str, float] = {"matrices": time.perf_counter() - self.began}
        self._stop = np.zeros(1, dtype=np.uint8)
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
        )

    def batches(self) -> Iterator[slice]:
        """Find everything; yields the places of rows that have just become final."""
        from threadpoolctl import threadpool_limits

        self._report("matrices")
        # Several BLAS threads make products this thin slower, not faster.
        with threadpool_limits(1, user_api="blas"):
            try:
                yield from self._found()
            finally:
                if hasattr(self, "output"):
                    self.output.close()

    def _found(self) -> Iterator[slice]:
        if self._is_dense(self.request.n_components or 0):
            yield from self._dense()
            return
        ordered = self._order()
        if self.request.op_inv is not None:
            pairs = self._through_given_inverse(ordered)
            if pairs is not None:
                yield from self._write_all(*pairs)
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
        started = time.perf_counter()
        if request.target is not None:
            yield from self._nearest(ordered, plan, request.target / pencil.unit)
            return
        if request.max_eigenvalue is not None:
            top = request.max_eigenvalue / pencil.unit * (1.0 + _THRESHOLD_MARGIN)
            top = max(top, pencil.noise)
            # The null space is at or below any threshold, whatever rounding makes of it.
            wanted = max(plan.count(top), pencil.n_null)
        else:
            assert request.n_components is not None
            wanted = min(request.n_components, pencil.n)
            top = 0.0
            if wanted > pencil.n_null:
                top = plan.find_top(wanted, wanted + max(4, wanted // 40))
        self._spend("count", started)
        if self._is_dense(wanted):
            yield from self._dense()
            return
        self._open(wanted)
        none = np.zeros(min(pencil.n_null, wanted))
        yield self._write(none, none, pencil.null_rows()[:wanted])
        low = 0.0
        if wanted > pencil.n_null:
            known = self._known(ordered, plan, top)
            if known is not None:
                low = known[0]
                yield self._write(*known[1:])
            yield from self._slices(ordered, plan, low, top)
        if wanted > pencil.n_null:
            counted = plan.count(top)
            self._count = Certificate("inertia", counted, counted, top * pencil.unit)
        else:
            self._count = Certificate("null space", pencil.n_null, pencil.n_null)

    def _workers(self, ordered: OrderedPencil, pairs: int) -> int:
        return worker_count(ordered, self.request.n_jobs, pairs, self.request.lean)

    def _slices(
        self, ordered: OrderedPencil, plan: SpectrumPlan, low: float, high: float
    ) -> Iterator[slice]:
        started = time.perf_counter()
        jobs = self._workers(ordered, plan.count(high))
        for pairs in run_slices(
            ordered,
            plan.slices(low, high),
            self.request.tolerance,
            jobs,
            self._stop,
            self._poll,
        ):
            yield self._write(pairs.values, pairs.residuals, pairs.rows, pairs.orthonormality)
            ordered.give_back(pairs.rows)
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
        border = 0.5 * float(values[cut - 1] + values[cut])
        if plan.count(border) != pencil.n_null + cut:
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
        radius = 0.5 * wanted
        reach = max(pencil.norm, sigma) * 1.1
        for _ in range(60):
            low, high = max(sigma - radius, 0.0), min(sigma + radius, reach)
            below = plan.count(low) if low > 0.0 else 0
            inside = plan.count(high) - below
            if wanted <= inside and (inside <= 1.5 * wanted + 10 or high - low < 1e-9 * sigma):
                break
            if high - low > 2.0 * reach:
                break
            radius *= float(np.clip((1.2 * wanted + 3.0) / max(inside, 1), 0.3, 4.0))
        parts = []
        if low == 0.0:
            n_null = pencil.n_null
            parts.append((np.zeros(n_null), np.zeros(n_null), pencil.null_rows()))
        jobs = self._workers(ordered, inside)
        for pairs in run_slices(
            ordered, plan.slices(low, high), self.request.tolerance, jobs, self._stop, self._poll
        ):
            parts.append((pairs.values, pairs.residuals, pairs.rows))
        values, residuals = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
        rows = np.concatenate([part[2] for part in parts])
        chosen = np.sort(np.argsort(np.abs(values - sigma), kind="stable")[:wanted])
        unit = pencil.unit
        self._count = Certificate("inertia", inside, len(values), high * unit, low * unit)
        rows = rows[chosen]
        orthonormalise(rows)
        yield from self._write_all(values[chosen], residuals[chosen], rows)

    # Other ways ----------------------------------------------------------------------------------

    def _dense(self) -> Iterator[slice]:
        """All that is asked for, from the dense matrix."""
        from scipy.linalg import eigh

        started = time.perf_counter()
        pencil, request = self.pencil, self.request
        self._poll()
        values, columns = eigh(pencil.matrix.toarray(), driver="evd")
        # The known null space stands for what the dense solution has of it.
        values[: pencil.n_null] = 0.0
        columns[:, : pencil.n_null] = pencil.null_rows().T
        pencil.remove_null(columns[:, pencil.n_null :])
        if request.max_eigenvalue is not None:
            threshold = request.max_eigenvalue / pencil.unit * (1.0 + _THRESHOLD_MARGIN)
            chosen = np.flatnonzero(values <= max(threshold, pencil.noise))
        else:
            distance = np.abs(values - (request.target or 0.0) / pencil.unit)
            order = np.arange(pencil.n)
            if request.target is not None:
                order = np.argsort(distance, kind="stable")
            chosen = np.sort(order[: request.n_components])
        rows = np.ascontiguousarray(columns[:, chosen].T)
        weight = pencil.root_mass
        defect = (rows @ pencil.matrix - values[chosen, None] * rows) * weight
        residuals = np.linalg.norm(defect, axis=1) / np.linalg.norm(rows * weight, axis=1)
        self._spend("dense", started)
        self._count = Certificate("dense", pencil.n, pencil.n)
        yield from self._write_all(values[chosen], residuals, rows)

    def _through_given_inverse(
        self, ordered: OrderedPencil
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Pairs through `op_inv`; None if a count shows that it missed some."""
        pencil, request = self.pencil, self.request
        if request.n_components is None:
            return None
        started = time.perf_counter()
        wanted = min(request.n_components, pencil.n - 1)
        null = np.zeros(pencil.n_null)
        found, rows = pairs_of_inverse(pencil, request.op_inv, wanted, request.ncv, self._poll)
        values = np.concatenate([null, found])
        sigma = (request.target or 0.0) / pencil.unit
        chosen = np.sort(np.argsort(np.abs(values - sigma), kind="stable")[:wanted])
        plan = SpectrumPlan(ordered, self._stop, self._poll)
        radius = float(np.abs(values[chosen] - sigma).max()) * (1.0 - 1e-9)
        low, high = sigma - radius, sigma + radius
        counted = plan.count(high) - (plan.count(low) if low > 0.0 else 0)
        self._spend("given inverse", started)
        if counted != int(np.count_nonzero((values > low) & (values < high))):
            return None
        rows = np.concatenate([pencil.null_rows(), rows])[chosen]
        orthonormalise(rows)
        residuals = measure_pairs(ordered, rows)[1]
        self._count = Certificate("inertia", counted, counted, high * pencil.unit)
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
