"""Diffusion of functions on a surface, by one implicit step."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.laplacian import SparseMatrix
from meshmash_viewer.progress import CancelCallback, check_cancelled

#: Residual relative to the right-hand side, and the largest number of steps to it.
_TOLERANCE, _STEPS = 1e-5, 3000


def diffused(
    stiffness: SparseMatrix,
    mass: FloatArray,
    values: FloatArray,
    length: float,
    start: FloatArray | None = None,
    cancel: CancelCallback | None = None,
) -> FloatArray:
    """Solve ``(M + t L) x = M f`` with t the square of a length: f smoothed over that length.

    All functions are solved for together, by conjugate gradients with the diagonal as
    preconditioner, which takes little memory and more steps for longer lengths.

    Parameters
    ----------
    stiffness : sparse matrix, shape (n, n)
        L, positive semidefinite.
    mass : ndarray, shape (n,)
        Diagonal of M. A vertex without mass keeps its value.
    values : ndarray, shape (n, d)
        The functions f.
    length : float
        √t, in the unit of the square root of `mass`; 0 changes nothing.
    start : ndarray, shape (n, d), optional
        Where the iteration begins, such as the solution for a shorter length.

    Returns
    -------
    ndarray of float64, shape (n, d)
        Between the smallest and the largest value where L has no positive entry off its diagonal.
    """
    if not length > 0.0:
        return values.copy()
    weights = np.where(mass > 0.0, mass, 1.0)
    system = (sparse.diags_array(weights) + length**2 * stiffness).tocsr()
    inverse = 1.0 / system.diagonal()[:, None]
    right = weights[:, None] * values
    x = (values if start is None else start).astype(np.float64)
    residual = right - system @ x
    bound = _TOLERANCE**2 * np.square(right).sum(axis=0)
    direction = np.zeros_like(x)
    size = np.ones(x.shape[1])
    for _ in range(_STEPS):
        check_cancelled(cancel)
        if (np.square(residual).sum(axis=0) <= bound).all():
            return x
        scaled = inverse * residual
        before, size = size, np.einsum("ij,ij->j", residual, scaled)
        direction = scaled + direction * np.divide(size, before, out=np.zeros_like(size),
                                                   where=before > 0.0)  # fmt: skip
        image = system @ direction
        curvature = np.einsum("ij,ij->j", direction, image)
        step = np.divide(size, curvature, out=np.zeros_like(size), where=curvature > 0.0)
        x += step * direction
        residual -= step * image
    raise InputError(
        f"Smoothing over {length:g} did not converge in {_STEPS:,} steps: take a shorter length,"
        " or repair the mesh (`meshmash-viewer info` counts its defects)."
    )
