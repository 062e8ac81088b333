"""Low eigenpairs of L φ = λ M φ, with the proof that none is missing.

`solve` gives a `Decomposition`; `iterate` gives the pairs in batches as they converge. Both are
the same computation on the reduced problem of `meshmash_viewer.engine.pencil`: the null space is
known exactly and deflated, the rest is found by shift-invert Lanczos, and the inertia of a
factor just below the largest pair counts what must have been found.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from queue import Queue
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.engine.factorization import Factor, FactorizationError, factor_shifted
from meshmash_viewer.engine.pencil import reduce_pencil
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import CancelCallback, Cancelled, Progress, ProgressCallback

__all__ = ["Batch", "Decomposition", "estimate_memory", "iterate", "solve"]

FloatArray: TypeAlias = npt.NDArray[np.floating[Any]]
#: ``(k, n) -> array of shape (k, n)`` that the rows are written into.
Allocate: TypeAlias = Callable[[int, int], FloatArray]
#: ``(start, eigenvalues, residuals)`` of pairs whose rows have just become final.
PairsCallback: TypeAlias = Callable[[int, npt.NDArray[np.float64], npt.NDArray[np.float64]], None]

#: Up to this many vertices all pairs are computed at once by dense `eigh`.
_DENSE_VERTICES = 700
#: Pairs that one shift finds.
_BAND = 100
#: A certificate counts up to the last pair, less this relative distance.
_COUNT_MARGIN = 1e-9
#: A threshold keeps eigenvalues up to this relative distance above it: rounding.
_THRESHOLD_MARGIN = 1e-11


@dataclass(frozen=True, eq=False)
class Decomposition:
    """Eigenpairs of L φ = λ M φ in ascending order, with the proof of their quality.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        In the inverse squared unit of the mesh.
    rows : ndarray of float64 or float32, shape (k, n)
        Row i is eigenvector i, M-orthonormal; NaN at vertices without mass. The entry of largest
        magnitude is positive.
    residuals : ndarray of float64, shape (k,)
        ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``; for the null space, relative to Weyl's spacing 4π / area.
    orthonormality : float
        Largest entry of ``|ΦᵀMΦ - I|``.
    complete : bool
        Whether a count of eigenvalues proves that none is missing.
    certificate : str
        That proof in one sentence.
    timings : dict of float
        Seconds by stage.
    mass : ndarray of float64, shape (n,)
        Diagonal of M.
    """

    eigenvalues: npt.NDArray[np.float64]
    rows: FloatArray
    residuals: npt.NDArray[np.float64]
    orthonormality: float
    complete: bool
    certificate: str
    timings: dict[str, float] = field(default_factory=dict)
    mass: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    @property
    def eigenvectors(self) -> FloatArray:
        """The eigenvectors as columns, shape (n, k); a view of `rows`."""
        return self.rows.T

    @property
    def n_components(self) -> int:
        """Number of pairs."""
        return len(self.eigenvalues)

    def proof(self) -> str:
        """Say in one line how many pairs there are and how well they are proven."""
        state = "complete" if self.complete else "not proven complete"
        return (
            f"{self.n_components} pairs · {state} ({self.certificate}) · "
            f"worst residual {self.residuals.max(initial=0.0):.0e} · "
            f"orthonormality {self.orthonormality:.0e}"
        )


@dataclass(frozen=True, eq=False)
class Batch:
    """Consecutive pairs that have just become final.

    Parameters
    ----------
    start : int
        Index of the first pair; batches come in ascending order without gaps.
    eigenvalues : ndarray of float64, shape (b,)
    rows : ndarray, shape (b, n)
        View into the array that all rows are written into.
    residuals : ndarray of float64, shape (b,)
    """

    start: int
    eigenvalues: npt.NDArray[np.float64]
    rows: FloatArray
    residuals: npt.NDArray[np.float64]

    @property
    def stop(self) -> int:
        """Index after the last pair of the batch."""
        return self.start + len(self.eigenvalues)


def solve(
    stiffness: Any,
    mass: Any,
    n_components: int | None = None,
    *,
    max_eigenvalue: float | None = None,
    sigma: float | None = None,
    tol: float = 1e-10,
    dtype: npt.DTypeLike = np.float64,
    n_jobs: int | None = None,
    known: Decomposition | None = None,
    allocate: Allocate | None = None,
    on_pairs: PairsCallback | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
    op_inv: Any = None,
    ncv: int | None = None,
) -> Decomposition:
    """Compute the lowest eigenpairs, or those nearest a shift, and prove that none is missing.

    Parameters
    ----------
    stiffness : sparse matrix or array, shape (n, n)
        Symmetric positive semidefinite L.
    mass : sparse matrix or array, shape (n, n), or ndarray, shape (n,)
        Diagonal M; vertices without mass are left out and come back as NaN.
    n_components : int, optional
        Number of pairs; all of them if it exceeds their number.
    max_eigenvalue : float, optional
        Threshold: all pairs with λ ≤ max_eigenvalue. Exactly one of the two is given.
    sigma : float, optional
        With `n_components`: the pairs nearest sigma. None or a negative value: the lowest.
    tol : float
        Wanted residual relative to λ; never below what float64 can give.
    dtype : dtype
        float64 or float32, of the rows; float32 loosens `tol` to 1e-7. None is float64.
    n_jobs : int, optional
        Processes to use; None for as many as cores and memory allow.
    known : Decomposition, optional
        Lowest pairs of the same problem, found earlier; only the others are computed.
    allocate : callable, optional
        ``(k, n) -> array`` the rows are written into, called once when k is known.
    on_pairs : callable, optional
        ``(start, eigenvalues, residuals)``, called after those rows are final.
    progress, cancel : callable, optional
        Reports, and a question asked often; `Cancelled` is raised after it returns True.
    op_inv : LinearOperator or array, optional
        ``(L - sigma M)^-1`` to use in place of a factorization; needs `n_components`.
    ncv : int, optional
        Size of the Krylov basis; the default is almost always best.

    Raises
    ------
    InputError
        If the matrices or the request make no sense.
    Cancelled
        If `cancel` said so.
    """
    run = _Run(
        stiffness,
        mass,
        n_components,
        max_eigenvalue,
        sigma,
        tol,
        dtype,
        known,
        allocate,
        on_pairs,
        progress,
        cancel,
        op_inv,
        ncv,
    )
    for _ in run.batches():
        pass
    return run.result()


def iterate(
    stiffness: Any, mass: Any, n_components: int | None = None, **options: Any
) -> Iterator[Batch]:
    """Yield the pairs in batches as they converge, lowest first; arguments as for `solve`.

    The computation runs on while a batch is looked at. Closing the iterator cancels it.
    """
    queue: Queue[Batch | BaseException | None] = Queue()
    closed = threading.Event()
    asked = options.pop("cancel", None)
    options["cancel"] = lambda: closed.is_set() or (asked is not None and asked())
    names = [
        "max_eigenvalue",
        "sigma",
        "tol",
        "dtype",
        "known",
        "allocate",
        "on_pairs",
        "progress",
        "cancel",
        "op_inv",
        "ncv",
    ]
    defaults: dict[str, Any] = {"tol": 1e-10, "dtype": np.float64}
    options.pop("n_jobs", None)
    run = _Run(
        stiffness, mass, n_components, *(options.pop(name, defaults.get(name)) for name in names)
    )
    if options:
        raise TypeError(f"unknown options: {', '.join(options)}")

    def work() -> None:
        try:
            for batch in run.batches():
                queue.put(batch)
            queue.put(None)
        except BaseException as fault:  # noqa: BLE001 - handed over whole to the consumer
            queue.put(fault)

    thread = threading.Thread(target=work, name="eigenpairs", daemon=True)
    thread.start()
    try:
        while True:
            item = queue.get()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            yield item
    finally:
        closed.set()
        thread.join()


def estimate_memory(n: int, nnz: int, k: int) -> int:
    """Predict the bytes a run takes beyond the matrices given.

    Parameters
    ----------
    n : int
        Number of vertices.
    nnz : int
        Number of stored entries of L.
    k : int
        Number of pairs.
    """
    band = min(k, _BAND)
    factor = 2 * 12 * 6.0 * n * np.log2(max(n, 2))
    basis = 8.0 * n * (2 * band + 20 + 2 * band)
    return int(factor + basis + 8.0 * n * k + 3 * 16.0 * nnz)


class _Run:
    """One computation: what is asked, what is found so far, who listens."""

    def __init__(
        self,
        stiffness: Any,
        mass: Any,
        n_components: int | None,
        max_eigenvalue: float | None,
        sigma: float | None,
        tol: float,
        dtype: npt.DTypeLike,
        known: Decomposition | None,
        allocate: Allocate | None,
        on_pairs: PairsCallback | None,
        progress: ProgressCallback | None,
        cancel: CancelCallback | None,
        op_inv: Any,
        ncv: int | None,
    ) -> None:
        if (n_components is None) == (max_eigenvalue is None):
            raise InputError("Give either a number of eigenpairs or a largest eigenvalue.")
        if n_components is not None and n_components < 1:
            raise InputError(f"At least one eigenpair must be asked for, not {n_components}.")
        if max_eigenvalue is not None and not max_eigenvalue >= 0.0:
            raise InputError(f"The largest eigenvalue must not be negative: {max_eigenvalue}.")
        self.dtype = np.dtype(np.float64 if dtype is None else dtype)
        if self.dtype not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise InputError(f"Eigenvectors come as float64 or float32, not {self.dtype}.")
        if not tol >= 0.0:
            raise InputError(f"The tolerance must not be negative: {tol}.")
        self.began = time.perf_counter()
        self.timings: dict[str, float] = {}
        self.tol = max(tol, 1e-7 if self.dtype == np.dtype(np.float32) else 1e-14)
        self.pencil = reduce_pencil(stiffness, mass)
        self.mass = np.zeros(self.pencil.n_all)
        self.mass[self.pencil.active] = self.pencil.root_mass**2
        self.n_components = n_components
        self.max_eigenvalue = max_eigenvalue
        self.sigma = None if sigma is None or sigma <= 0.0 else sigma / self.pencil.unit
        self.known, self.allocate, self.on_pairs = known, allocate, on_pairs
        self.progress, self.cancel, self.op_inv, self.ncv = progress, cancel, op_inv, ncv
        self.complete = False
        self.certificate = "no count"
        self.total = 0
        self.emitted = 0
        self.rows: FloatArray = np.zeros((0, self.pencil.n_all))
        self.eigenvalues = np.zeros(0)
        self.residuals = np.zeros(0)

    # The reduced problem ---------------------------------------------------------------------

    def batches(self) -> Iterator[Batch]:
        """Find everything, yielding the pairs as they become final."""
        pencil = self.pencil
        self._report("matrices")
        wanted = 0 if self.n_components is None else min(self.n_components, pencil.n)
        if pencil.n <= _DENSE_VERTICES or wanted > pencil.n // 3:
            values, vectors = self._dense()
            yield from self._emit_all(values, vectors)
            return
        if self.sigma is not None and self.n_components is not None:
            values, vectors = self._nearest(wanted, self.sigma)
            yield from self._emit_all(values, vectors)
            return
        if self.max_eigenvalue is not None:
            # The null space is at or below any threshold, whatever rounding makes of it.
            wanted = max(self._count_below(self._threshold()), pencil.n_null)
        if wanted > pencil.n // 3:
            values, vectors = self._dense()
            yield from self._emit_all(values, vectors)
            return
        yield from self._lowest(wanted)

    def _threshold(self) -> float:
        """The threshold in the reduced problem, with room for rounding."""
        assert self.max_eigenvalue is not None
        theta = self.max_eigenvalue / self.pencil.unit
        return max(theta * (1.0 + _THRESHOLD_MARGIN), self.pencil.noise)

    def _count_below(self, theta: float) -> int:
        """Eigenvalues of the reduced matrix below theta, null space included."""
        if theta > self.pencil.norm:
            return self.pencil.n
        return self._factor(theta, max(theta, 1.0) * 1e-11).count_below

    def _factor(self, shift: float, nudge: float) -> Factor:
        self._ask()
        started = time.perf_counter()
        factor = factor_shifted(self.pencil.matrix, shift, nudge)
        self._spend("factorization", started)
        return factor

    def _dense(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """All pairs that are asked for, from the dense matrix: values and (k, n) vectors."""
        from scipy.linalg import eigh

        started = time.perf_counter()
        pencil = self.pencil
        self._ask()
        values, columns = eigh(pencil.matrix.toarray(), driver="evd")
        # The known null space stands for what the dense solution has of it.
        values[: pencil.n_null] = 0.0
        columns[:, : pencil.n_null] = pencil.null_rows().T
        rest = columns[:, pencil.n_null :]
        pencil.remove_null(rest)
        self._spend("dense", started)
        self.complete = True
        self.certificate = f"all {pencil.n} eigenvalues computed"
        if self.max_eigenvalue is not None:
            keep = values <= self._threshold()
        else:
            assert self.n_components is not None
            k = min(self.n_components, pencil.n)
            order = np.argsort(np.abs(values - (self.sigma or 0.0)), kind="stable")
            if self.sigma is None:
                order = np.arange(pencil.n)
            keep = np.zeros(pencil.n, dtype=bool)
            keep[order[:k]] = True
        return values[keep], np.ascontiguousarray(columns[:, keep].T)

    def _shift_invert(
        self, factor: Factor, m: int, found: list[npt.NDArray[np.float64]], seed: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """The m pairs nearest the factor's shift that are orthogonal to all found rows."""
        from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

        pencil, n = self.pencil, self.pencil.n

        def project(column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            pencil.remove_null(column)
            for rows in found:
                column -= rows.T @ (rows @ column)
            return column

        def apply(column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            self._ask()
            return project(self._invert(factor, project(column.reshape(n).copy())))

        started = time.perf_counter()
        start = project(np.random.default_rng(seed).standard_normal(n))
        inverse = LinearOperator((n, n), matvec=apply, dtype=np.float64)
        ncv = min(n, max(self.ncv or 0, 2 * m + 20))
        try:
            # The inverse's own largest eigenvalues: the matrix itself is never asked.
            columns: Any
            _, columns = eigsh(inverse, k=m, which="LM", v0=start, ncv=ncv, tol=1e-13)
        except ArpackNoConvergence as fault:
            columns = fault.eigenvectors
        values, vectors = self._refine(columns, found)
        self._spend("lanczos", started)
        return values, vectors

    def _invert(self, factor: Factor, column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        if self.op_inv is None:
            return factor.solve(column)
        # (A - s)^-1 = unit M^1/2 (L - sigma M)^-1 M^1/2 on the active vertices.
        pencil = self.pencil
        whole = np.zeros(pencil.n_all)
        whole[pencil.active] = pencil.root_mass * column
        answer = np.asarray(self.op_inv @ whole)[pencil.active]
        return np.asarray(pencil.unit * pencil.root_mass * answer)

    def _refine(
        self, columns: npt.NDArray[np.float64], found: list[npt.NDArray[np.float64]]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Orthonormalise against everything found, then Rayleigh–Ritz; values and rows."""
        for _ in range(2):
            self.pencil.remove_null(columns)
            for rows in found:
                columns = columns - rows.T @ (rows @ columns)
            columns, _ = np.linalg.qr(columns)
        small = columns.T @ (self.pencil.matrix @ columns)
        values, turn = np.linalg.eigh(0.5 * (small + small.T))
        return values, np.ascontiguousarray((columns @ turn).T)

    def _lowest(self, wanted: int) -> Iterator[Batch]:
        """Bands of pairs from zero upwards, each counted before it is given out."""
        pencil = self.pencil
        self._allocate(wanted)
        null = pencil.null_rows()[:wanted]
        self.complete = True
        self.certificate = f"null space of {pencil.n_null} components"
        yield self._emit(np.zeros(len(null)), null)
        values = np.zeros(len(null))
        found: list[npt.NDArray[np.float64]] = []
        if self.known is not None and self.sigma is None:
            reused = self._reuse(self.known, wanted)
            if reused is not None:
                yield self._emit(*reused)
                values = np.concatenate([values, reused[0]])
                found.append(reused[1])
        beyond = 3 if self.n_components is not None else 0
        while len(values) < wanted:
            m = min(wanted - len(values) + beyond, _BAND)
            m = min(m, pencil.n - len(values) - 1)
            shift = -1.0 if len(values) == pencil.n_null else values[-1] + 0.3
            factor = self._factor(shift, 0.07)
            band_values, band = self._shift_invert(factor, m, found, seed=len(values))
            for attempt in range(1, 20):
                top = band_values[-1] * (1.0 - _COUNT_MARGIN)
                owed = self._factor(top, -1e-10 * max(top, 1e-3)).count_below
                missing = owed - len(values) - int(np.count_nonzero(band_values < top))
                if missing <= 0:
                    break
                more, rows = self._shift_invert(factor, missing, [*found, band], seed=attempt)
                both = np.concatenate([band, rows])
                band_values, band = self._refine(both.T, found)
                del more
            self.complete = missing == 0
            take = min(len(band_values), wanted - len(values))
            if take < wanted - len(values):
                take = max(1, take - beyond)
            values = np.concatenate([values, band_values[:take]])
            found.append(band[:take])
            self.certificate = f"inertia {owed} below {top * pencil.unit:.4g}"
            yield self._emit(band_values[:take], band[:take])
            if not self.complete:
                return

    def _reuse(
        self, known: Decomposition, wanted: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]] | None:
        """Pairs of an earlier run beyond the null space, if they fit this problem."""
        pencil = self.pencil
        k = min(known.n_components, wanted)
        if k <= pencil.n_null or known.rows.shape[1] != pencil.n_all:
            return None
        rows = np.asarray(known.rows[pencil.n_null : k], dtype=np.float64)
        rows = rows[:, pencil.active] * pencil.root_mass
        if not np.isfinite(rows).all():
            return None
        values, refined = self._refine(rows.T.copy(), [])
        drift = pencil.matrix @ refined.T - refined.T * values
        if np.linalg.norm(drift, axis=0).max() > 1e-4 * max(float(values[-1]), 1.0):
            return None
        top = values[-1] * (1.0 - _COUNT_MARGIN)
        owed = self._factor(top, -1e-10 * max(top, 1e-3)).count_below
        if owed != pencil.n_null + int(np.count_nonzero(values < top)):
            return None
        self.complete = True
        self.certificate = f"inertia {owed} below {top * pencil.unit:.4g}"
        return values, refined

    def _nearest(
        self, wanted: int, sigma: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """The wanted pairs nearest sigma, null space among them where it is that near."""
        pencil = self.pencil
        factor = self._factor(sigma, 0.01 * min(sigma, 1.0))
        values, rows = self._shift_invert(factor, min(wanted + 2, pencil.n // 2), [], seed=0)
        for attempt in range(1, 20):
            null = np.zeros(pencil.n_null)
            everything = np.concatenate([null, values])
            order = np.argsort(np.abs(everything - sigma), kind="stable")[:wanted]
            radius = abs(everything[order[-1]] - sigma) * (1.0 - 1e-7)
            low, high = sigma - radius, sigma + radius
            below = 0 if low <= 0.0 else self._factor(low, 1e-9 * sigma).count_below
            above = self._factor(high, -1e-9 * sigma).count_below
            inside = int(np.count_nonzero((everything > low) & (everything < high)))
            missing = above - below - inside
            if missing <= 0:
                break
            _, more = self._shift_invert(factor, missing, [rows], seed=attempt)
            values, rows = self._refine(np.concatenate([rows, more]).T, [])
        self.complete = missing == 0
        self.certificate = (
            f"inertia {above - below} from {low * pencil.unit:.4g} to {high * pencil.unit:.4g}"
        )
        chosen = np.sort(order)
        whole = np.concatenate([pencil.null_rows(), rows])
        return everything[chosen], whole[chosen]

    # What comes out --------------------------------------------------------------------------

    def _emit_all(
        self, values: npt.NDArray[np.float64], rows: npt.NDArray[np.float64]
    ) -> Iterator[Batch]:
        self._allocate(len(values))
        yield self._emit(values, rows)

    def _allocate(self, k: int) -> None:
        shape = (k, self.pencil.n_all)
        self.total = k
        self.eigenvalues, self.residuals = np.zeros(k), np.zeros(k)
        if self.allocate is None:
            self.rows = np.empty(shape, dtype=self.dtype)
        else:
            self.rows = self.allocate(*shape)
            if self.rows.shape != shape:
                raise ValueError(f"allocate gave {self.rows.shape} for {shape}")

    def _emit(self, values: npt.NDArray[np.float64], rows: npt.NDArray[np.float64]) -> Batch:
        """Write reduced pairs as final ones: original scaling, signs, residuals."""
        started = time.perf_counter()
        pencil = self.pencil
        start, stop = self.emitted, self.emitted + len(values)
        eigenvalues = values * pencil.unit
        if self.max_eigenvalue is not None:
            eigenvalues = np.minimum(eigenvalues, self.max_eigenvalue)
        block = rows / pencil.root_mass
        fix_signs(block)
        defect = (rows @ pencil.matrix.T - values[:, None] * rows) * pencil.root_mass
        size = np.linalg.norm(rows * pencil.root_mass, axis=1)
        scale = np.where(values > pencil.noise, values, 1.0)
        residuals = np.linalg.norm(defect, axis=1) / (scale * size)
        if pencil.n < pencil.n_all:
            self.rows[start:stop] = np.nan
            self.rows[start:stop, pencil.active] = block
        else:
            self.rows[start:stop] = block
        self.eigenvalues[start:stop] = eigenvalues
        self.residuals[start:stop] = residuals
        self.emitted = stop
        self._spend("output", started)
        if self.on_pairs is not None:
            self.on_pairs(start, eigenvalues, residuals)
        self._report("eigenpairs")
        return Batch(start, eigenvalues, self.rows[start:stop], residuals)

    def result(self) -> Decomposition:
        """Everything found, with its proof; call it after `batches` has run out."""
        if self.emitted != self.total:
            raise FactorizationError(
                f"{self.emitted} of {self.total} eigenpairs found, the rest stayed out of reach"
            )
        started = time.perf_counter()
        orthonormality = measure_orthonormality(self.rows, self.mass, self.pencil.active)
        self._spend("proof", started)
        self.timings["total"] = time.perf_counter() - self.began
        return Decomposition(
            eigenvalues=self.eigenvalues,
            rows=self.rows,
            residuals=self.residuals,
            orthonormality=orthonormality,
            complete=self.complete,
            certificate=self.certificate,
            timings=self.timings,
            mass=self.mass,
        )

    def _spend(self, stage: str, started: float) -> None:
        self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - started

    def _ask(self) -> None:
        if self.cancel is not None and self.cancel():
            raise Cancelled("the decomposition was cancelled")

    def _report(self, stage: str) -> None:
        self._ask()
        if self.progress is None:
            return
        fraction = self.emitted / self.total if self.total else 0.0
        elapsed = time.perf_counter() - self.began
        self.progress(
            Progress(
                stage=stage,
                fraction=fraction,
                remaining=elapsed * (1.0 / fraction - 1.0) if fraction > 0.0 else None,
                message=f"{self.emitted} of {self.total} eigenpairs" if self.total else stage,
                converged=self.emitted,
                total=self.total,
            )
        )


def fix_signs(rows: FloatArray) -> None:
    """Turn each row, shape (k, n), so that its entry of largest magnitude is positive.

    Of entries whose magnitudes agree to 1e-6 the first decides, so that rounding does not.
    """
    for row in rows:
        size = np.abs(row)
        leading = int(np.argmax(size >= (1.0 - 1e-6) * size.max(initial=0.0)))
        if row[leading] < 0.0:
            np.negative(row, out=row)


def measure_orthonormality(
    rows: FloatArray, mass: npt.NDArray[np.float64], active: npt.NDArray[np.int64]
) -> float:
    """Largest entry of |ΦᵀMΦ - I| for rows of shape (k, n), in chunks of vertices."""
    k = len(rows)
    gram = np.zeros((k, k))
    for start in range(0, len(active), 8192):
        chunk = active[start : start + 8192]
        part = np.asarray(rows[:, chunk], dtype=np.float64)
        gram += (part * mass[chunk]) @ part.T
    gram[np.diag_indices(k)] -= 1.0
    return float(np.abs(gram).max(initial=0.0))
