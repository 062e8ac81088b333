"""Options of the eigensolver."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, unknown
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.compiler import check_compiler
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import check_number, whole_number

#: ``(k, n, n_kept) -> array of shape (k, n)`` whose first `n_kept` rows are the known pairs.
Allocate: TypeAlias = Callable[[int, int, int], npt.NDArray[np.floating[Any]]]


@dataclass(frozen=True, eq=False)
class Request:
    """Options of `meshmash_viewer.solve`, described there.

    `InputError` is raised if an option is invalid or numba is not installed.
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
            fault = "Neither or both of n_components and max_eigenvalue are given"
            raise InputError("conflicting-arguments", fault, "give only one of them")
        if self.n_components is not None:
            whole_number(self.n_components, "n_components")
        if self.max_eigenvalue is not None and not self.max_eigenvalue >= 0.0:
            fault = f"max_eigenvalue is {self.max_eigenvalue}"
            raise InputError("out-of-range", fault, "give a positive number")
        if self.precision not in (np.dtype(np.float64), np.dtype(np.float32)):
            raise unknown("type of eigenvectors", str(self.precision), ("float64", "float32"))
        if self.sigma is not None:
            check_number(self.sigma, "sigma", -math.inf)
        check_number(self.tol, "tol")
        if self.op_inv is not None and self.n_components is None:
            raise InputError("missing-argument", "op_inv requires n_components", "give both")
        if self.n_jobs is not None:
            whole_number(self.n_jobs, "n_jobs")

    @property
    def asked(self) -> Target:
        """The requested number of pairs, or largest eigenvalue."""
        if self.n_components is not None:
            return Target("count", self.n_components)
        assert self.max_eigenvalue is not None
        return Target("max_eigenvalue", self.max_eigenvalue)

    @property
    def precision(self) -> np.dtype[Any]:
        """Data type of the rows."""
        return np.dtype(np.float64 if self.dtype is None else self.dtype)

    @property
    def lean(self) -> bool:
        """Whether rows are float32, to save memory."""
        return self.precision == np.dtype(np.float32)

    @property
    def tolerance(self) -> float:
        """Required residual relative to λ, not below the precision of the rows."""
        return max(self.tol, 1e-7 if self.lean else 1e-13)

    @property
    def target(self) -> float | None:
        """Value whose nearest pairs are requested; None for the lowest pairs."""
        if self.sigma is None or self.sigma <= 0.0 or self.n_components is None:
            return None
        return self.sigma
