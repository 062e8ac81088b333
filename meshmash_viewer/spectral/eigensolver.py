"""Low eigenpairs of L φ = λ M φ, with the proof that none is missing.

`solve` uses `meshmash_viewer.spectral.engine`: the null space is known exactly and deflated; the
rest of the spectrum is divided into slices, whose eigenvalues are counted by the inertia of a
factor; shifted block Lanczos finds the pairs of several slices in parallel.
"""

from __future__ import annotations

import queue
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.errors import InputError, UnprovenWarning, of_mesh
from meshmash_viewer.laplacian import SparseMatrix
from meshmash_viewer.progress import CancelCallback, Cancelled, ProgressBar, ProgressCallback
from meshmash_viewer.spectral.cost import slice_sizes
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.compiler import one_blas_thread
from meshmash_viewer.spectral.engine.computation import Computation
from meshmash_viewer.spectral.engine.output import Output, Pace
from meshmash_viewer.spectral.engine.pencil import reduce_pencil
from meshmash_viewer.spectral.engine.request import Allocate, Request
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import is_real, whole_number

#: Number of pairs assumed in progress reports until the number is known.
_USUAL_PAIRS = 80
#: Seconds between two calls of `cancel`.
_INTERVAL = 0.05


class Run:
    """Run of a request: one thread computes, and the calling thread reports.

    `InputError` is raised if the matrices are invalid.
    """

    def __init__(self, stiffness: Any, mass: Any, request: Request) -> None:
        self._request = request
        n = max(np.shape(stiffness), default=0)
        sizes = partial(slice_sizes, n, lean=request.lean, early=request.early)
        self._pace = Pace(request.progress, request.n_components or _USUAL_PAIRS, sizes)
        pencil = reduce_pencil(stiffness, mass)
        # Events for the calling thread: slices of final rows, functions that report progress, and
        # at the end an exception or None.
        self._events = queue.Queue[slice | Callable[[], None] | BaseException | None]()
        self._computation = Computation(pencil, request, self._pace, sizes, self._events.put)
        self._computation.timings["matrices"] = time.perf_counter() - self._pace.began

    @property
    def output(self) -> Output:
        """Results so far."""
        return self._computation.output

    def pairs(self) -> Eigenpairs:
        """Compute and return all pairs, with their certificate."""
        self._run()
        output, certificate = self.output, self._computation.certificate()
        if output.written != output.total:
            raise ArithmeticError(f"{output.written} of {output.total} eigenpairs found")
        seconds = time.perf_counter() - self._pace.began
        return replace(
            output.leading(output.total),
            rows=output.rows,
            certificate=certificate,
            timings={**self._computation.timings, "total": seconds},
            known_to=(self._request.max_eigenvalue or 0.0) if certificate.complete else 0.0,
        )

    def _run(self) -> None:
        """Compute all pairs in another thread, and report those that become final."""
        finder = threading.Thread(target=self._find, name="eigenpairs", daemon=True)
        self._pace.stage("matrices")
        with one_blas_thread():
            finder.start()
            try:
                while True:
                    self._poll()
                    try:
                        event = self._events.get(timeout=_INTERVAL)
                    except queue.Empty:
                        continue
                    if event is None:
                        return
                    if isinstance(event, BaseException):
                        try:
                            raise event
                        finally:
                            del event  # its traceback refers to all arrays
                    if isinstance(event, slice):
                        self._publish(event)
                    else:
                        event()
            finally:
                self._computation.leave()
                finder.join()

    def _find(self) -> None:
        try:
            with one_blas_thread():
                for place in self._computation.batches():
                    self._events.put(place)
            self._events.put(None)
        except BaseException as fault:  # noqa: BLE001 - raised in the waiting thread
            if not self._computation.is_left:
                self._events.put(fault)

    def _publish(self, place: slice) -> None:
        output = self.output
        if self._request.on_pairs is not None:
            self._request.on_pairs(output.leading(place.stop))
        self._pace.pairs(place.stop, output.total, self._computation.steps)

    def _poll(self) -> None:
        if self._request.cancel is not None and self._request.cancel():
            raise Cancelled("the decomposition was cancelled")
        self._pace.step(self._computation.steps)


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
    known: Eigenpairs | None = None,
    allocate: Allocate | None = None,
    on_pairs: Callable[[Eigenpairs], None] | None = None,
    early: bool = False,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
    op_inv: Any = None,
    ncv: int | None = None,
) -> Eigenpairs:
    """Compute the lowest eigenpairs, or those nearest a shift, and prove that none is missing.

    Parameters
    ----------
    stiffness : sparse matrix or array, shape (n, n)
        Symmetric positive semidefinite L.
    mass : sparse matrix or array, shape (n, n), or ndarray, shape (n,)
        Diagonal M; eigenvectors are NaN at vertices without mass.
    n_components : int, optional
        Number of pairs; all pairs if it exceeds their number.
    max_eigenvalue : float, optional
        Threshold: all pairs with λ ≤ max_eigenvalue. Give either this or `n_components`.
    sigma : float, optional
        With `n_components`: compute the pairs nearest sigma; None or negative: the lowest pairs.
    tol : float
        Requested residual relative to λ, limited by float64 precision.
    dtype : dtype
        float64 or float32, of the rows. float32 relaxes `tol` to 1e-7 and uses smaller slices:
        about a third less memory. None is float64.
    n_jobs : int, optional
        Number of slices computed in parallel threads; None for as many as cores and memory allow.
    known : Eigenpairs, optional
        Lowest pairs of the same problem, found earlier; they are returned bit by bit, and only
        the other pairs are computed.
    allocate : callable, optional
        ``(k, n, n_kept) -> array`` for the rows, called once when k is known. The first `n_kept`
        rows of the array must be the rows of `known`, and are not written to.
    on_pairs : callable, optional
        Receives all leading pairs that are final, each time that their number has grown.
    early : bool
        Whether a long run yields about sixteen of the lowest pairs first, in less than half the
        time; the whole run then takes about a tenth longer.
    progress, cancel : callable, optional
        `progress` receives reports; `cancel` is called often, and `Cancelled` is raised if it
        returns True.
    op_inv : LinearOperator or array, optional
        ``(L - sigma M)^-1``, with which ARPACK finds the pairs; requires `n_components`. The pairs
        are still counted by one factorization; if some are missing, the solver recomputes all.
    ncv : int, optional
        Number of Lanczos vectors of ARPACK, with `op_inv` only.

    Raises
    ------
    InputError
        If the matrices or the request are invalid.
    Cancelled
        If `cancel` returned True.

    Examples
    --------
    >>> pairs = mv.solve(L, M, max_eigenvalue=7.0)
    >>> pairs.eigenvalues.round(1)
    array([0., 2., 2., 2., 6., 6., 6., 6., 6.])
    """
    request = Request(
        n_components, max_eigenvalue, sigma, tol, dtype, n_jobs, known, allocate, on_pairs, early,
        progress, cancel, op_inv, ncv,
    )  # fmt: skip
    return Run(stiffness, mass, request).pairs()


# -- for the documented functions: arguments, precision, progress bar and memory -----------------

Array: TypeAlias = npt.NDArray[np.floating[Any]]

#: The documented default of the descriptors' `max_eigenvalue`.
DEFAULT_MAX_EIGENVALUE = 1e-8
#: Share of the free memory that eigenvectors may take before they go to a temporary file.
_MEMORY_SHARE = 0.25


def solve_and_warn(
    stiffness: SparseMatrix,
    mass: SparseMatrix,
    *,
    dtype: npt.DTypeLike | None = None,
    verbose: int = False,
    unit: str = "",
    name: str = "",
    mask: str = "",
    stacklevel: int = 3,
    progress: ProgressCallback | None = None,
    **options: Any,
) -> Eigenpairs:
    """Call `solve` with a progress bar and a warning.

    The null space of a float32 Laplacian, which rounding destroys, is restored first. `dtype` is
    the type of the eigenvectors, by default that of `stiffness`. `verbose` draws a progress bar on
    stderr, and prints the certificate at the end. `unit` and `name` are those of the mesh, `mask`
    describes the part that is solved (see `Eigenpairs.on_mask`), `stacklevel` is the level of the
    warning, and `progress` receives every report.

    `UnprovenWarning` is issued if the certificate is not complete.
    """
    from tqdm import tqdm

    single = getattr(stiffness, "dtype", None) == np.float32
    if single:
        stiffness = _with_exact_null_space(stiffness)
    if dtype is None:
        dtype = np.float32 if single else np.float64
    with ProgressBar("eigenpairs", progress) if verbose else nullcontext(progress) as reports:
        result = solve(stiffness, mass, dtype=dtype, progress=reports, **options).on_mask(mask)
    if verbose:
        tqdm.write(result.proof(unit), file=sys.stderr)
    if not result.complete:
        text = f"{of_mesh(name)}{result.proof(unit)}"
        warnings.warn(text, UnprovenWarning, stacklevel=stacklevel)
    return result


def _with_exact_null_space(stiffness: SparseMatrix) -> SparseMatrix:
    """Restore the zero row sums of a Laplacian that was rounded to float32.

    Otherwise its null space, the constants, would mix with the lowest eigenfunctions. Rows whose
    sum is not zero within rounding are unchanged.
    """
    exact = sparse.csr_array(stiffness).astype(np.float64)
    excess = np.asarray(exact.sum(axis=1)).ravel()
    size = np.asarray(abs(exact).sum(axis=1)).ravel()
    rounding = np.abs(excess) <= 64.0 * np.finfo(np.float32).eps * size
    return sparse.csc_array(exact - sparse.diags_array(np.where(rounding, excess, 0.0)))


def check_bands(max_eigenvalue: float, band_size: int) -> None:
    """Raise `InputError` for a negative threshold or an empty band."""
    if not (is_real(max_eigenvalue) and max_eigenvalue >= 0.0):
        fault, remedy = f"max_eigenvalue is {max_eigenvalue}", "give a positive number"
        raise InputError("out-of-range", fault, remedy)
    whole_number(band_size, "band_size")


def chosen_extent(
    max_eigenvalue: float, count: int | str | None, wavelength: float | None
) -> tuple[int | None, float | None]:
    """Return the number of pairs and the threshold, one of which is None.

    `InputError` is raised if more than one of the three is given, or a value is out of range.
    """
    refuse_two_extents(max_eigenvalue, count, wavelength)
    if count is not None:
        if isinstance(count, str):
            raise InputError("out-of-range", f"count is {count!r}", 'give a number or "auto"')
        return whole_number(count, "count"), None
    if wavelength is not None:
        return None, Target("wavelength", wavelength).max_eigenvalue
    return None, max_eigenvalue


def refuse_two_extents(
    max_eigenvalue: float, count: int | str | None, wavelength: float | None
) -> None:
    """Raise `InputError` if more than one of the three limits of a spectrum is given."""
    given = {
        "max_eigenvalue": max_eigenvalue != DEFAULT_MAX_EIGENVALUE,
        "count": count is not None,
        "wavelength": wavelength is not None,
    }
    names = [name for name, is_given in given.items() if is_given]
    if len(names) > 1:
        fault = f"{' and '.join(names)} are given"
        raise InputError("conflicting-arguments", fault, "give only one of them")


@contextmanager
def scratch_rows(dtype: np.dtype[Any]) -> Iterator[Allocate]:
    """Provide an allocator of rows, shape (k, n), in memory if they fit, else in a temporary file.

    The rows are deleted when the context is left.
    """
    with ExitStack() as files:

        def allocate(k: int, n: int, n_kept: int) -> Array:
            import psutil

            size = k * n * dtype.itemsize
            if size <= _MEMORY_SHARE * psutil.virtual_memory().available:
                return np.empty((k, n), dtype=dtype)
            file = files.enter_context(tempfile.TemporaryFile(prefix="meshmash-viewer-"))
            return np.memmap(file, dtype=dtype, mode="w+", shape=(k, n))

        yield allocate
