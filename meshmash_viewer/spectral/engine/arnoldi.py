"""Pairs through an inverse that the caller brings along, by SciPy's ARPACK."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.spectral.engine.orthogonality import orthonormalise
from meshmash_viewer.spectral.engine.pencil import Pencil

__all__ = ["pairs_of_inverse"]

FloatArray = npt.NDArray[np.float64]


def pairs_of_inverse(
    pencil: Pencil, inverse: Any, k: int, ncv: int | None, poll: Callable[[], None]
) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (k,), ascending, and rows (k, n) beyond the null space; fewer if some fail.

    Parameters
    ----------
    pencil : Pencil
    inverse : LinearOperator or array, shape (n_all, n_all)
        ``(L - σ M)^-1``; the pairs are those nearest its σ.
    k : int
    ncv : int, optional
        Size of the Krylov basis.
    poll : callable
        Called before each application.
    """
    from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigsh

    n = pencil.n
    if np.shape(inverse) != (pencil.n_all, pencil.n_all):
        raise InputError(
            f"op_inv has shape {np.shape(inverse)}: give an operator of shape "
            f"({pencil.n_all}, {pencil.n_all}), like the Laplacian."
        )

    def apply(column: FloatArray) -> FloatArray:
        poll()
        inner = column.reshape(n).copy()
        pencil.remove_null(inner)
        # (A - s)^-1 = unit M^1/2 (L - sigma M)^-1 M^1/2 on the active vertices.
        whole = np.zeros(pencil.n_all)
        whole[pencil.active] = pencil.root_mass * inner
        answer = np.asarray(inverse @ whole).ravel()[pencil.active] * pencil.root_mass
        answer *= pencil.unit
        pencil.remove_null(answer)
        return answer

    start = np.random.default_rng(0).standard_normal(n)
    pencil.remove_null(start)
    operator = LinearOperator((n, n), matvec=apply, dtype=np.float64)
    basis = min(n, max(ncv or 0, 2 * k + 20))
    columns: Any
    try:
        _, columns = eigsh(operator, k=k, which="LM", v0=start, ncv=basis, tol=1e-13)
    except ArpackNoConvergence as fault:
        columns = fault.eigenvectors
    except ArpackError:
        columns = np.zeros((n, 0))
    rows = np.ascontiguousarray(columns.T)
    if not np.isfinite(rows).all():
        rows = rows[:0]
    orthonormalise(rows)
    small = rows @ (pencil.matrix @ rows.T)
    values, turn = np.linalg.eigh(0.5 * (small + small.T))
    return values, turn.T @ rows
