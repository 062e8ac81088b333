"""Eigenpairs of a mesh, and features computed from them.

Eigenvalues are per squared unit of the mesh: 1e-8 is a wavelength of 63 µm for coordinates in nm,
but below all nonzero eigenvalues of a mesh of size 1. Times are in squared unit, and features have
the unit of φ², one over squared unit.

The eigenvectors are orthonormal with respect to `M`, so a function `f` is projected on them by
``eigenvectors.T @ (M @ f)``. `meshmash_viewer.spectral_coefficients` computes this projection
without unreferenced vertices, which are NaN; `reconstruct` is the inverse.
"""

from __future__ import annotations

import warnings
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import MeshWarning, of_mesh, unknown
from meshmash_viewer.features.descriptors import (
    compute_geometry_vectors,
    compute_hks,
    spectral_geometry_filter,
)
from meshmash_viewer.features.filters import (
    construct_bspline_basis,
    construct_bspline_filter,
    get_hks_filter,
)
from meshmash_viewer.laplacian import SparseMatrix, cotangent_laplacian
from meshmash_viewer.mesh import Mesh, MeshLike, mask_text, masked
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.eigenpairs import as_pair
from meshmash_viewer.spectral.eigensolver import check_bands, solve_and_warn
from meshmash_viewer.units import whole_number

__all__ = [
    "compute_geometry_vectors",
    "compute_hks",
    "construct_bspline_basis",
    "construct_bspline_filter",
    "decompose_laplacian",
    "decompose_laplacian_by_bands",
    "decompose_mesh",
    "get_hks_filter",
    "spectral_geometry_filter",
]

Array: TypeAlias = npt.NDArray[np.floating[Any]]

#: Default of `sigma`, which means "just below zero" in any unit.
_BELOW_ZERO = -1e-10


def decompose_laplacian(
    L: SparseMatrix,
    M: SparseMatrix,
    n_components: int = 100,
    op_inv: Any = None,
    sigma: float = _BELOW_ZERO,
    tol: float = 1e-10,
    ncv: int | None = None,
    prefactor: str | None = None,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> tuple[npt.NDArray[np.float64], Array]:
    """Solve ``L φ = λ M φ`` for the lowest eigenpairs, or for those nearest `sigma`.

    `InputError` is raised if `n_components` < 1, `prefactor` is unknown, or the matrices are
    invalid.

    Parameters
    ----------
    L : sparse matrix or array, shape (n, n)
        Laplacian. float32 matrices give float32 eigenvectors, and tolerances no tighter than
        1e-7.
    M : sparse matrix or array, shape (n, n)
        Diagonal mass matrix.
    n_components : int
        Number of eigenpairs; if it exceeds n, all n pairs and a `MeshWarning`.
    op_inv : LinearOperator, optional
        ``(L - sigma M)^-1``, with which ARPACK finds the pairs. The pairs are still counted by one
        factorization; if some are missing, the solver recomputes all.
    sigma : float
        Shift, per squared unit of the mesh. The default and all other values up to zero select the
        lowest pairs; a shift inside the spectrum selects the pairs nearest to it.
    tol : float
        Required residual, relative to λ.
    ncv : int, optional
        Number of Lanczos vectors of ARPACK, with `op_inv` only.
    prefactor : {None, "lu"}
        Accepted for compatibility; the shifted matrix is always factored.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    eigenvalues : ndarray of float64, shape (k,)
        Ascending; exactly 0 once for each connected component.
    eigenvectors : ndarray, shape (n, k)
        M-orthonormal columns, with a positive entry of largest magnitude; NaN at vertices without
        mass. A view of rows: ``eigenvectors.T`` is C-contiguous.

    Examples
    --------
    >>> eigenvalues, eigenvectors = mv.decompose_laplacian(L, M, 4)
    >>> eigenvalues.round(1), eigenvectors.shape
    (array([0., 2., 2., 2.]), (642, 4))
    """
    return _decomposed(
        L, M, n_components, sigma, prefactor,
        tol=tol, ncv=ncv, op_inv=op_inv, progress=progress, cancel=cancel,
    )  # fmt: skip


def _decomposed(
    L: SparseMatrix,
    M: SparseMatrix,
    n_components: int,
    sigma: float | None,
    prefactor: str | None,
    **options: Any,
) -> tuple[npt.NDArray[np.float64], Array]:
    if prefactor not in (None, "lu"):
        raise unknown("prefactor", prefactor, ('"lu"', None))
    result = solve_and_warn(
        L,
        M,
        n_components=whole_number(n_components, "n_components"),
        sigma=None if sigma is None or sigma == _BELOW_ZERO else float(sigma),
        stacklevel=4,
        **options,
    )
    if (every := result.n_components) < n_components:
        requested = f"{of_mesh(options.get('name', ''))}{n_components:,} eigenpairs were requested"
        text = f"{requested}; the mesh has {every:,}, and all of them are returned."
        warnings.warn(text, MeshWarning, stacklevel=3)
    return as_pair(result)


def decompose_mesh(
    mesh: MeshLike,
    n_components: int = 100,
    op_inv: Any = None,
    sigma: float = _BELOW_ZERO,
    tol: float = 1e-10,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    prefactor: str | None = None,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> tuple[npt.NDArray[np.float64], Array]:
    """Solve the eigenproblem of a mesh: `cotangent_laplacian`, then `decompose_laplacian`.

    Parameters
    ----------
    mesh : MeshLike
        The mesh, n vertices.
    robust, mollify_factor : bool, float
        See `meshmash_viewer.laplacian.cotangent_laplacian`.
    n_components, op_inv, sigma, tol, prefactor, progress, cancel
        See `decompose_laplacian`.
    mask : array_like of bool, shape (n,), optional
        Solve on these vertices only, see `Mesh.masked`.

    Returns
    -------
    eigenvalues : ndarray of float64, shape (k,)
        Per squared unit of the mesh.
    eigenvectors : ndarray of float64, shape (n, k)
        NaN at unreferenced vertices, and outside of the mask.

    Examples
    --------
    >>> eigenvalues, eigenvectors = mv.decompose_mesh(ball, 4)
    >>> eigenvalues.round(1), eigenvectors.shape
    (array([0., 2., 2., 2.]), (642, 4))
    """
    mesh = masked(mesh, mask)
    stiffness, mass = cotangent_laplacian(mesh, robust=robust, mollify_factor=mollify_factor)
    return _decomposed(
        stiffness, mass, n_components, sigma, prefactor,
        tol=tol, op_inv=op_inv, progress=progress, cancel=cancel,
        name=mesh.name if isinstance(mesh, Mesh) else "",
        mask="" if mask is None else mask_text(mesh),
    )  # fmt: skip


def decompose_laplacian_by_bands(
    L: SparseMatrix,
    M: SparseMatrix,
    max_eigenvalue: float = 1e-9,
    band_size: int = 50,
    truncate_extra: bool = True,
    verbose: int = False,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> tuple[npt.NDArray[np.float64], Array]:
    """Solve ``L φ = λ M φ`` for every eigenpair up to a threshold.

    `InputError` is raised if `max_eigenvalue` is negative or NaN, or `band_size` < 1.

    Parameters
    ----------
    L, M : sparse matrix or array, shape (n, n)
        See `decompose_laplacian`.
    max_eigenvalue : float
        Per squared unit of the mesh; pairs with λ ≤ max_eigenvalue are returned, all n if it is
        above the whole spectrum. `meshmash_viewer.spectral.weyl.weyl_count` estimates their number.
    band_size : int
        Accepted for compatibility; the solver chooses its own division of the spectrum.
    truncate_extra : bool
        Accepted for compatibility. The pairs below the threshold are counted beforehand, so that no
        additional pairs are computed.
    verbose : int
        1 draws a progress bar on stderr and prints the certificate at the end.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    eigenvalues : ndarray of float64, shape (k,)
    eigenvectors : ndarray, shape (n, k)

    References
    ----------
    .. [1] Vallet, B. and Lévy, B. (2008). "Spectral Geometry Processing with Manifold
       Harmonics." Computer Graphics Forum 27(2).

    Examples
    --------
    >>> eigenvalues, eigenvectors = mv.decompose_laplacian_by_bands(L, M, 7.0)
    >>> eigenvalues.round(1)
    array([0., 2., 2., 2., 6., 6., 6., 6., 6.])
    """
    check_bands(max_eigenvalue, band_size)
    result = solve_and_warn(
        L, M, max_eigenvalue=max_eigenvalue, verbose=verbose, progress=progress, cancel=cancel
    )
    return as_pair(result)
