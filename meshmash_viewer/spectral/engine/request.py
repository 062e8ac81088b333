"""Options of the eigensolver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.compiler import check_compiler

#: ``(k, n, n_kept) -> array of shape (k, n)`` whose first `n_kept` rows are those of known pairs.
Allocate: TypeAlias = Callable[[int, int, int], npt.NDArray[np.floating[Any]]]


@dataclass(frozen=True, eq=False)
class Request:
    """Options of `meshmash_viewer.solve`: what to compute, how, and what to report.

    Parameters
    ----------
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
    known : Eigenpairs, optional
        Lowest pairs of the same problem, found earlier; they are returned bit by bit, and only
        the others are computed.
    allocate : callable, optional
        ``(k, n, n_kept) -> array`` that the rows are written into, called once when k is known.
        Its first `n_kept` rows must be those of `known`, and are not written to.
    on_pairs : callable, optional
        Receives all leading pairs that are final, each time that there are more.
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
        If they are invalid, or numba is not installed.
    """

    n_components: int | None = None
    max_eigenvalue: float | None = None
    sigma: float | None = None
    tol: float = 1e-10
    dtype: npt.DTypeLike = np.float64
    n_jobs: int | None = None
    known: Eigenpairs | None = None
    allocate: Allocate | None = None
    on_pairs: Callable[[Eigenpairs], None] | None = None
    early: bool = False
    progress: ProgressCallback | None = None
    cancel: CancelCallback | None = None
    op_inv: Any = None
    ncv: int | None = None

    def __post_init__(self) -> None:
        check_compiler()
        if (self.n_components is None) == (self.max_eigenvalue is None):
            raise InputError("Give either a number of eigenpairs or a largest eigenvalue.")
        if self.n_components is not None and self.n_components < 1:
            raise InputError(f"At least one eigenpair must be requested, not {self.n_components}.")
        if self.max_eigenvalue is not None and not self.max_eigenvalue >= 0.0:
            raise InputError(f"The largest eigenvalue must not be negative: {self.max_eigenvalue}.")
        if self.precision not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise InputError(f"Eigenvectors come as float64 or float32, not {self.precision}.")
        if self.sigma is not None and not np.isfinite(self.sigma):
            raise InputError(f"The shift sigma is {self.sigma}: give a finite number or None.")
        if not self.tol >= 0.0:
            raise InputError(f"The tolerance must not be negative: {self.tol}.")
        if self.op_inv is not None and self.n_components is None:
            raise InputError("op_inv requires n_components, a number of eigenpairs.")
        if self.n_jobs is not None and self.n_jobs < 1:
            raise InputError(f"n_jobs must be at least 1, not {self.n_jobs}.")

    @property
    def precision(self) -> np.dtype[Any]:
        """Type of the rows."""
        return np.dtype(np.float64 if self.dtype is None else self.dtype)

    @property
    def lean(self) -> bool:
        """Whether rows are float32, to save memory."""
        return self.precision == np.dtype(np.float32)

    @property
    def tolerance(self) -> float:
        """Residual to reach, relative to λ, limited by the precision of the rows."""
        return max(self.tol, 1e-7 if self.lean else 1e-13)

    @property
    def target(self) -> float | None:
        """Value inside the spectrum whose nearest pairs are requested; None for the lowest."""
        if self.sigma is None or self.sigma <= 0.0 or self.n_components is None:
            return None
        return self.sigma
