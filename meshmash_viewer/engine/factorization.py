"""Factors of shifted copies of a symmetric matrix, and eigenvalue counts from their inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

__all__ = ["Factor", "FactorizationError", "factor_shifted"]

FloatArray = npt.NDArray[np.float64]

#: Largest relative residual of the probe solve that a factor may show.
_PROBE_TOLERANCE = 1e-7


class FactorizationError(RuntimeError):
    """No usable factor near the wanted shift."""


class Factor:
    """``A - shift I = L D Lᵀ``, permuted to low fill, without pivoting.

    Sylvester's law of inertia: the number of negative pivots in D is the number of
    eigenvalues of A below the shift.
    """

    def __init__(self, matrix: Any, shift: float) -> None:
        from scipy.sparse.linalg import splu

        n = matrix.shape[0]
        self.shift = shift
        shifted = sp.csc_array(matrix - shift * sp.eye_array(n, format="csc"))
        try:
            self._lu = splu(
                shifted,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as fault:  # an exactly zero pivot
            raise FactorizationError(str(fault)) from fault
        self.symmetric = bool(np.array_equal(self._lu.perm_r, self._lu.perm_c))
        pivots = self._lu.U.diagonal()
        self.count_below = int(np.count_nonzero(pivots < 0.0))
        probe = np.cos(np.arange(n, dtype=np.float64))
        answer = self._lu.solve(probe)
        size = float(np.linalg.norm(answer)) * float(abs(shifted).max())
        error = float(np.linalg.norm(shifted @ answer - probe))
        self.probe_residual = error / (float(np.linalg.norm(probe)) + size)
        self.usable = self.symmetric and self.probe_residual < _PROBE_TOLERANCE

    def solve(self, columns: FloatArray) -> FloatArray:
        """Solve ``(A - shift I) X = columns`` for shape (n,) or (n, b)."""
        return np.asarray(self._lu.solve(columns))


def factor_shifted(matrix: Any, shift: float, nudge: float) -> Factor:
    """Factor near a shift, moving it by `nudge` at most five times until the factor is sound.

    Raises
    ------
    FactorizationError
        If no shift gave a sound factor.
    """
    for attempt in range(6):
        try:
            factor = Factor(matrix, shift + attempt * nudge)
        except FactorizationError:
            continue
        if factor.usable:
            return factor
    raise FactorizationError(f"no stable factor near shift {shift:.6g}")
