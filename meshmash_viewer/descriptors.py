"""Descriptors of a mesh's vertices in one call: what a filter makes of its eigenpairs.

All have the unit of φ², one over squared unit of the mesh. Their names are documented in
`meshmash_viewer.decompose`, from where they can be imported too.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.eigenpairs import check_bands, find_eigenpairs, scratch_rows, whole_number
from meshmash_viewer.errors import ConstantFeaturesWarning, InputError
from meshmash_viewer.features import accumulate_features
from meshmash_viewer.filters import bspline_bank, get_hks_filter
from meshmash_viewer.laplacian import SparseMatrix, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.weyl import weyl_eigenvalue

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition

__all__ = ["compute_geometry_vectors", "compute_hks", "spectral_geometry_filter"]

Array: TypeAlias = npt.NDArray[np.floating[Any]]
#: Any accepted form of a mesh, or its ``(L, M)``.
MeshOrMatrices: TypeAlias = Any
Filter: TypeAlias = Callable[[npt.NDArray[np.float64]], npt.ArrayLike]

#: What a message proposes as a useful number of eigenpairs.
_USEFUL_COUNT = 100


def spectral_geometry_filter(
    mesh: MeshOrMatrices,
    filter: Filter | None = None,
    max_eigenvalue: float = 1e-8,
    band_size: int = 50,
    truncate_extra: bool = True,
    drop_first: bool = True,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    verbose: int = False,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Any:
    """Compute ``F[v, f] = Σ_k filter(λ)[f, k] φ_k(v)²`` over all eigenpairs up to a threshold.

    Parameters
    ----------
    mesh : MeshLike or pair of sparse matrices
        The mesh, n vertices, or its (L, M).
    filter : callable, optional
        Called once with all eigenvalues, a 1-D array of shape (k,); returns coefficients of
        shape (n_filters, k). None: return the eigenpairs themselves.
    max_eigenvalue, band_size, truncate_extra
        See `decompose_laplacian_by_bands`.
    drop_first : bool
        Leave out the first pair, exactly one, however many zero eigenvalues there are.
    decomposition_dtype : dtype
        float32 halves the memory of eigenvectors and loosens tolerances to 1e-7; the result has
        the same dtype. None is float64.
    robust, mollify_factor
        See `meshmash_viewer.laplacian.cotangent_laplacian`.
    verbose : int
        1 draws a progress bar on stderr.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ndarray, shape (n, n_filters)
        NaN at unreferenced vertices. With ``filter=None``: a tuple of eigenvalues, shape (k,),
        and eigenvectors, shape (n, k).

    Raises
    ------
    InputError
        If the threshold is negative, or the filter returns a wrong shape or values that are not
        finite.

    Warns
    -----
    ConstantFeaturesWarning
        If only zero eigenvalues lie below the threshold, as when it is meant for another unit:
        the features are then right, but tell no two vertices of a component apart.

    Notes
    -----
    Where the eigenvectors would take a large part of the free memory they go to a temporary
    file (in ``TMPDIR``), and are read back once, a few rows at a time.
    """
    check_bands(max_eigenvalue, band_size)
    dtype = np.dtype(np.float64 if decomposition_dtype is None else decomposition_dtype)
    stiffness, mass = _matrices(mesh, robust, mollify_factor)
    start = 1 if drop_first else 0

    def solve(allocate: Callable[[int, int], Array] | None) -> Decomposition:
        return find_eigenpairs(
            stiffness,
            mass,
            max_eigenvalue=max_eigenvalue,
            dtype=dtype,
            allocate=allocate,
            verbose=verbose,
            unit=mesh.unit if isinstance(mesh, Mesh) else "",
            progress=progress,
            cancel=cancel,
        )

    if filter is None:
        result = solve(None)
        return result.eigenvalues[start:], result.eigenvectors[:, start:]
    with scratch_rows(dtype) as allocate:
        result = solve(allocate)
        eigenvalues, rows = result.eigenvalues[start:], result.rows[start:]
        if not eigenvalues.any():
            _warn_of_zeros(max_eigenvalue, result)
        returned = filter(eigenvalues.copy())
        coefficients = _checked_coefficients(returned, eigenvalues)
        features = accumulate_features(eigenvalues, rows, coefficients)
        features[result.mass == 0.0] = np.nan
        del rows, result
    return features.astype(dtype, copy=False)


def compute_hks(
    mesh: MeshOrMatrices,
    max_eigenvalue: float = 1e-8,
    t_max: float | None = None,
    t_min: float | None = None,
    n_components: int = 32,
    band_size: int = 50,
    truncate_extra: bool = False,
    drop_first: bool = False,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    verbose: int = False,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Array:
    """Compute the heat kernel signature, ``Σ_k exp(-λ_k t) φ_k(v)²``, at a range of times.

    Parameters
    ----------
    mesh : MeshLike or pair of sparse matrices
        The mesh, n vertices, or its (L, M).
    max_eigenvalue : float
        Largest eigenvalue to take part. Times much below ``1 / max_eigenvalue`` need more.
    t_max, t_min : float, optional
        Longest and shortest time, in squared unit of the mesh; None: from the spectrum, see
        `meshmash_viewer.filters.hks_time_range`.
    n_components : int
        Number of times, evenly spaced in log t.
    band_size, truncate_extra, drop_first, robust, mollify_factor, decomposition_dtype, verbose
        See `spectral_geometry_filter`.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ndarray, shape (n, n_components)
        Columns from short to long times; one over squared unit.

    Raises
    ------
    InputError
        If an argument makes no sense.

    References
    ----------
    .. [1] Sun, J., Ovsjanikov, M. and Guibas, L. (2009). "A Concise and Provably Informative
       Multi-Scale Signature Based on Heat Diffusion." Computer Graphics Forum 28(5).
    """
    features: Array = spectral_geometry_filter(
        mesh,
        get_hks_filter(
            t_max=t_max, t_min=t_min, n_scales=whole_number(n_components, "n_components")
        ),
        max_eigenvalue=max_eigenvalue,
        band_size=band_size,
        truncate_extra=truncate_extra,
        drop_first=drop_first,
        decomposition_dtype=decomposition_dtype,
        robust=robust,
        mollify_factor=mollify_factor,
        verbose=verbose,
        progress=progress,
        cancel=cancel,
    )
    return features


def compute_geometry_vectors(
    mesh: MeshOrMatrices,
    max_eigenvalue: float = 1e-8,
    n_components: int = 32,
    band_size: int = 50,
    truncate_extra: bool = False,
    drop_first: bool = False,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    verbose: int = False,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Array:
    """Compute ``Σ_k B_f(λ_k) φ_k(v)²`` for cubic B-splines over ``[0, max_eigenvalue]``.

    Parameters
    ----------
    mesh : MeshLike or pair of sparse matrices
        The mesh, n vertices, or its (L, M).
    max_eigenvalue : float
        End of the range that the bands divide evenly.
    n_components : int
        Number of bands.
    band_size, truncate_extra, drop_first, robust, mollify_factor, decomposition_dtype, verbose
        See `spectral_geometry_filter`.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ndarray, shape (n, n_components)
        Columns from low to high eigenvalues; their sum is that of all φ². One over squared unit.

    Raises
    ------
    InputError
        If `max_eigenvalue` is not positive and finite, or an argument makes no sense.

    References
    ----------
    .. [1] Litman, R. and Bronstein, A. M. (2014). "Learning Spectral Descriptors for Deformable
       Shape Correspondence." IEEE TPAMI 36(1).
    """
    features: Array = spectral_geometry_filter(
        mesh,
        bspline_bank(0.0, max_eigenvalue, whole_number(n_components, "n_components")),
        max_eigenvalue=max_eigenvalue,
        band_size=band_size,
        truncate_extra=truncate_extra,
        drop_first=drop_first,
        decomposition_dtype=decomposition_dtype,
        robust=robust,
        mollify_factor=mollify_factor,
        verbose=verbose,
        progress=progress,
        cancel=cancel,
    )
    return features


def _matrices(
    mesh: MeshOrMatrices, robust: bool, mollify_factor: float
) -> tuple[SparseMatrix, SparseMatrix]:
    from scipy import sparse

    if isinstance(mesh, (tuple, list)) and len(mesh) == 2 and sparse.issparse(mesh[0]):
        return mesh[0], mesh[1]
    return cotangent_laplacian(mesh, robust=robust, mollify_factor=mollify_factor)


def _checked_coefficients(
    returned: npt.ArrayLike, eigenvalues: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    given = np.asarray(returned)
    if given.dtype.kind not in "biuf":
        # None, text, or complex numbers, of which a cast would keep half without a sound.
        raise InputError(
            f"The filter returned {_described(returned, given)}: let it return real numbers, shape "
            "(n_filters, n_eigenvalues)."
        )
    coefficients = given.astype(np.float64)
    if coefficients.shape == eigenvalues.shape:
        coefficients = coefficients[np.newaxis]  # one filter, written without the axis for it
    bad = np.argwhere(~np.isfinite(coefficients))
    if len(bad) and coefficients.ndim == 2 and coefficients.shape[1] == len(eigenvalues):
        raise InputError(
            f"The filter returned {coefficients[tuple(bad[0])]} for the eigenvalue "
            f"{eigenvalues[bad[0][-1]]:.4g}: let it return finite numbers for every eigenvalue, "
            "zero included."
        )
    return coefficients


def _described(returned: object, given: npt.NDArray[Any]) -> str:
    return f"values of type {given.dtype}" if given.shape else repr(returned)[:60]


def _warn_of_zeros(max_eigenvalue: float, result: Decomposition) -> None:
    useful = weyl_eigenvalue(float(result.mass.sum()), _USEFUL_COUNT)
    warnings.warn(
        "Only zero eigenvalues, one for each connected component, lie below max_eigenvalue "
        f"({max_eigenvalue:.4g}), so the features are constant on each: about {_USEFUL_COUNT} "
        f"eigenpairs of this mesh lie below {useful:.2g} per squared unit of its coordinates.",
        ConstantFeaturesWarning,
        stacklevel=3,
    )
