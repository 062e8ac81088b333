"""Low eigenpairs of L φ = λ M φ, with the proof that none is missing.

`solve` gives a `Decomposition`; `iterate` gives the pairs in batches as they converge. Both are
the same computation, in `meshmash_viewer.spectral.engine`: the null space is known exactly and
deflated; the rest of the spectrum is cut into slices, whose eigenvalues are counted beforehand by
the inertia of a factor; the pairs of each slice are found by shifted block Lanczos, several slices
at a time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.engine.output import Allocate, Extend, PairsCallback
from meshmash_viewer.spectral.engine.request import Request
from meshmash_viewer.spectral.engine.run import Run
from meshmash_viewer.spectral.verification import verify_pairs

if TYPE_CHECKING:
    from meshmash_viewer.mesh import Mesh

__all__ = ["Batch", "Decomposition", "PairsCallback", "estimate_memory", "iterate", "solve"]

FloatArray: TypeAlias = npt.NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Decomposition:
    """Eigenpairs of L φ = λ M φ in ascending order, with the proof of their quality.

    It unpacks and indexes like the pair ``(eigenvalues, eigenvectors)``.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        In the inverse squared unit of the mesh.
    rows : ndarray of float64 or float32, shape (k, n)
        Row i is eigenvector i, M-orthonormal; NaN at vertices without mass. The entry of largest
        magnitude is positive.
    residuals : ndarray of float64, shape (k,)
        ``‖Lφ - λMφ‖ / (λ ‖Mφ‖)``; for the null space, relative to Weyl's spacing 4π / area.
    certificate : Certificate
        Evidence that none is missing, with the worst residual and the orthonormality.
    timings : dict of float
        Seconds by stage.
    mass : ndarray of float64, shape (n,)
        Diagonal of M.

    Examples
    --------
    >>> pairs.eigenvalues[:4].round(1)
    array([0., 2., 2., 2.])
    >>> pairs.certificate.complete, bool(pairs.residuals.max() < 1e-9)
    (True, True)
    >>> eigenvalues, eigenvectors = pairs
    >>> eigenvalues.shape, eigenvectors.shape
    ((16,), (642, 16))
    """

    eigenvalues: npt.NDArray[np.float64]
    rows: FloatArray
    residuals: npt.NDArray[np.float64]
    certificate: Certificate
    timings: dict[str, float] = field(default_factory=dict)
    mass: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __iter__(self) -> Iterator[FloatArray]:
        """Eigenvalues, shape (k,), then eigenvectors as columns, shape (n, k)."""
        return iter((self.eigenvalues, self.eigenvectors))

    @overload
    def __getitem__(self, index: int) -> FloatArray: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[FloatArray, ...]: ...
    def __getitem__(self, index: int | slice) -> FloatArray | tuple[FloatArray, ...]:
        """Return the eigenvalues for index 0, the eigenvectors for 1."""
        return (self.eigenvalues, self.eigenvectors)[index]

    def __len__(self) -> int:
        """Return 2, the length of the tuple; `n_components` is the number of eigenpairs."""
        return 2

    @property
    def eigenvectors(self) -> FloatArray:
        """The eigenvectors as columns, shape (n, k); a view of `rows`."""
        return self.rows.T

    @property
    def n_components(self) -> int:
        """Number of pairs."""
        return len(self.eigenvalues)

    @property
    def complete(self) -> bool:
        """Whether the certificate proves that no pair is missing and all are within tolerance."""
        return self.certificate.complete

    @property
    def orthonormality(self) -> float:
        """Largest entry of ``|ΦᵀMΦ - I|``."""
        return self.certificate.orthonormality

    def proof(self, unit: str = "") -> str:
        """Describe in one line the number of pairs, their count and their errors.

        `unit` is the length unit of the mesh, "" for none.
        """
        return self.certificate.sentence(self.n_components, unit)

    def on_file(self, mesh: Mesh) -> Decomposition:
        """Expand to all vertices of the file of a repaired mesh, as `Mesh.on_file`.

        Of merged vertices one has the mass, the others none. `mesh` is the one decomposed.
        """
        mass = np.zeros(mesh.n_file_vertices)
        mass[mesh.file_indices] = self.mass
        return replace(self, rows=mesh.on_file(self.rows.T).T, mass=mass)

    def verify(self, stiffness: Any, mass: Any) -> Certificate:
        """Recompute the certificate independently of the solver.

        Residuals and all inner products are computed anew, and eigenvalues are counted from
        another factorization, up to the bound of the certificate or, if these pairs are not all
        those below it, up to the highest gap between them.

        Parameters
        ----------
        stiffness : sparse matrix or array, shape (n, n)
            The L that was decomposed.
        mass : sparse matrix or array, shape (n, n), or ndarray, shape (n,)
            Its M.

        Returns
        -------
        Certificate
            The numbers measured here; `complete` is the verdict.

        Raises
        ------
        InputError
            If the size of the matrices differs.
        """
        return verify_pairs(self.eigenvalues, self.rows, self.certificate, stiffness, mass)


@dataclass(frozen=True, eq=False)
class Batch:
    """Consecutive pairs, final when they are yielded.

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
    extend: Extend | None = None,
    on_pairs: PairsCallback | None = None,
    early: bool = False,
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
        Diagonal M; eigenvectors are NaN at vertices without mass.
    n_components : int, optional
        Number of pairs; all of them if it exceeds their number.
    max_eigenvalue : float, optional
        Threshold: all pairs with λ ≤ max_eigenvalue. Exactly one of the two is given.
    sigma : float, optional
        With `n_components`: the pairs nearest sigma. None or a negative value: the lowest.
    tol : float
        Requested residual relative to λ, limited by float64 precision.
    dtype : dtype
        float64 or float32, of the rows. float32 relaxes `tol` to 1e-7 and uses smaller slices:
        about a third less memory. None is float64.
    n_jobs : int, optional
        Number of slices computed in parallel threads; None for as many as cores and memory allow.
    known : Decomposition, optional
        Lowest pairs of the same problem, found earlier; they are returned bit by bit, and only
        the others are computed. An eigenvalue of NaN marks a missing pair.
    allocate : callable, optional
        ``(k, n) -> array`` that the rows are written into, called once when k is known.
    extend : callable, optional
        ``(k, n, kept) -> array``, called instead if known pairs are kept: an array whose rows of
        indices `kept` are already those of `known`. They are not written to.
    on_pairs : callable, optional
        ``(start, eigenvalues, residuals)``, called after those rows are final.
    early : bool
        Whether a long run yields about sixteen of the lowest pairs first, in less than half the
        time; the whole run then takes about a tenth longer.
    progress, cancel : callable, optional
        Receives reports; is called often, and `Cancelled` is raised after it returns True.
    op_inv : LinearOperator or array, optional
        ``(L - sigma M)^-1``, with which ARPACK finds the pairs; requires `n_components`. They are
        still counted by one factorization; if some are missing, the solver recomputes all.
    ncv : int, optional
        Number of Lanczos vectors of ARPACK, with `op_inv` only: the solver's own bases grow as
        needed.

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
        n_components=n_components,
        max_eigenvalue=max_eigenvalue,
        sigma=sigma,
        tol=tol,
        dtype=dtype,
        n_jobs=n_jobs,
        known=known,
        allocate=allocate,
        extend=extend,
        on_pairs=on_pairs,
        early=early,
        progress=progress,
        cancel=cancel,
        op_inv=op_inv,
        ncv=ncv,
    )
    run = Run(stiffness, mass, request)
    for _ in run.batches():
        pass
    output = run.output
    if output.written != output.total:
        raise ArithmeticError(f"{output.written} of {output.total} eigenpairs found")
    mass = np.zeros(run.pencil.n_all)
    mass[run.pencil.active] = run.pencil.root_mass**2
    timings = {**run.timings, "total": time.perf_counter() - run.pace.began}
    return Decomposition(
        eigenvalues=output.eigenvalues,
        rows=output.rows,
        residuals=output.residuals,
        certificate=run.certificate,
        timings=timings,
        mass=mass,
    )


def iterate(
    stiffness: Any, mass: Any, n_components: int | None = None, **options: Any
) -> Iterator[Batch]:
    """Yield the pairs in batches as they converge, lowest first; arguments as for `solve`.

    The computation continues while a batch is processed. Closing the iterator cancels it.

    Examples
    --------
    >>> sum(len(batch.eigenvalues) for batch in mv.iterate(L, M, 16))
    16
    """
    run = Run(stiffness, mass, Request(n_components=n_components, **options))
    with closing(run.batches()) as batches:
        for at in batches:
            out = run.output
            yield Batch(at.start, out.eigenvalues[at], out.rows[at], out.residuals[at])


def estimate_memory(
    n: int,
    nnz: int,
    k: int,
    n_jobs: int | None = None,
    *,
    n_null: int = 1,
    dtype: npt.DTypeLike = np.float64,
) -> int:
    """Predict the bytes that a run allocates, its rows included, the given matrices not.

    Parameters
    ----------
    n, nnz, k : int
        Numbers of vertices, of stored entries of L, and of pairs.
    n_jobs : int, optional
        Number of slices computed in parallel; None for one on each core.
    n_null : int
        Number of connected components, whose constants are known.
    dtype : dtype
        float64 or float32, of the rows.
    """
    from joblib import cpu_count

    from meshmash_viewer.spectral.engine.workers import memory_of_run

    lean = np.dtype(dtype) == np.dtype(np.float32)
    return int(memory_of_run(n, nnz, k, n_jobs or int(cpu_count()), n_null, lean=lean))
