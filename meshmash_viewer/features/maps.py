"""Maps, functions on a surface: projection on eigenvectors, filters, and missing values."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, MissingValuesWarning, wrong_shape, wrong_type
from meshmash_viewer.features.filter_responses import checked_coefficients
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike, as_eigenpairs
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import SparseMatrix


def spectral_coefficients(eigenvectors: Any, M: SparseMatrix, f: npt.ArrayLike) -> FloatArray:
    """Project functions on the eigenvectors, ``Φᵀ M f``.

    `InputError` is raised if the shapes do not agree, M is not diagonal, or a function has no
    finite value.

    Parameters
    ----------
    eigenvectors : array_like, shape (n, k)
        M-orthonormal columns.
    M : sparse matrix or array, shape (n, n), or array_like, shape (n,)
        Diagonal mass matrix, or its diagonal.
    f : VertexMap or array_like, shape (n,) or (n, d)
        One or d functions; values at vertices without mass are ignored. NaN and infinite values are
        replaced by the mean of the other values of the function, weighted by M.

    Returns
    -------
    ndarray of float64, shape (k,) or (k, d)
        Coefficients, in the unit of the function times the unit of the mesh.

    Warns
    -----
    MissingValuesWarning
        If there are vertices with mass but without a value.

    Examples
    --------
    >>> ones = np.ones(len(ball.vertices))
    >>> coefficients = mv.spectral_coefficients(pairs.eigenvectors, M, ones)
    >>> bool(np.isclose(coefficients[0] ** 2, ball.area))
    True
    >>> bool(np.abs(coefficients[1:]).max() < 1e-9)
    True
    """
    from meshmash_viewer.spectral.engine.pencil import mass_diagonal  # loads SciPy

    columns = _eigenvectors(eigenvectors)
    values = as_map_values(f, len(columns))
    mass = mass_diagonal(M, len(columns))
    values = without_gaps(values, mass)
    used = mass > 0.0
    weighted = (mass[used] * values[used].T).T
    # rows of the transpose are contiguous in memory
    rows = columns.T if used.all() else columns.T[:, used]
    return np.asarray(rows @ weighted, dtype=np.float64)


def reconstruct(eigenvectors: Any, coefficients: npt.ArrayLike) -> FloatArray:
    """Sum eigenvectors with coefficients, lowest first: ``Σ_k c_k φ_k``.

    `InputError` is raised if there are more coefficients than eigenvectors, or they are not finite.

    Parameters
    ----------
    eigenvectors : array_like, shape (n, k)
        Eigenvectors as columns.
    coefficients : array_like, shape (j,) or (j, d)
        Coefficients of the first j ≤ k eigenvectors.

    Returns
    -------
    ndarray of float64, shape (n,) or (n, d)
        NaN at vertices without mass, where the eigenvectors are NaN.

    Examples
    --------
    >>> height = ball.vertices[:, 2]
    >>> coefficients = mv.spectral_coefficients(pairs.eigenvectors, M, height)
    >>> back = mv.reconstruct(pairs.eigenvectors, coefficients)
    >>> bool(np.abs(back - height).max() < 0.01)
    True
    """
    columns = _eigenvectors(eigenvectors)
    weights = np.asarray(coefficients, dtype=np.float64)
    if weights.ndim not in (1, 2) or len(weights) > columns.shape[1]:
        wanted = f"at most {columns.shape[1]}, one for each eigenvector"
        raise wrong_shape("Coefficients", weights.shape, wanted)
    bad = np.argwhere(~np.isfinite(weights))
    if len(bad):
        fault = f"Coefficient {bad[0][0]} is {weights[tuple(bad[0])]}"
        raise InputError("not-finite", fault, "give finite coefficients")
    return np.asarray(columns[:, : len(weights)] @ weights, dtype=np.float64)


def filter_map(
    decomposition: EigenpairsLike,
    values: npt.ArrayLike,
    response: Callable[[FloatArray], npt.ArrayLike],
) -> FloatArray:
    """Filter a function on the surface, ``Φ h(Λ) Φᵀ M f``.

    The filter ``exp(-t λ)`` is heat flow for a time t (within the computed eigenpairs). A low-pass
    filter keeps the waves of the function below its cut-off (Vallet and Lévy 2008, see
    `low_pass_vertices`).

    `InputError` is raised if the filter returns a wrong shape or values that are not finite, the
    map has another number of vertices or no finite value, or the arguments are in another order.

    Parameters
    ----------
    decomposition : Eigenpairs
        The eigenpairs; the part of the function beyond the last eigenvalue is left out.
    values : VertexMap or array_like, shape (n,) or (n, d)
        One function in each column; values at unreferenced vertices are ignored. NaN and
        infinite values are replaced by the area-weighted mean of the other values of the function,
        so that the result there is interpolated.
    response : callable
        Function from eigenvalues, shape (k,), to coefficients, shape (k,) or (f, k), such as a
        `FilterBank` of f columns.

    Returns
    -------
    ndarray of float64
        In the unit of `values`; NaN at unreferenced vertices. The shape is (n,) for one function
        and one filter, (n, d) for d functions, (n, f) for f filters, and (n, d, f) for both.

    Warns
    -----
    MissingValuesWarning
        If there are vertices without a value.

    Examples
    --------
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> pairs = mv.solve(*mv.cotangent_laplacian((corners, faces)), 4)
    >>> mv.filter_map(pairs, [2.0, 2.0, 2.0, 2.0], mv.low_pass_bank(1e-3)).round(6)
    array([2., 2., 2., 2.])
    """
    decomposition = as_eigenpairs("filter_map(pairs, values, response)", decomposition)
    if not callable(response):
        raise wrong_type("Last arguments of filter_map", type(response), "a filter")
    given = as_map_values(values, decomposition.rows.shape[1])
    weights = checked_coefficients(response(decomposition.eigenvalues), decomposition.eigenvalues)
    columns, mass = decomposition.eigenvectors, decomposition.mass
    coefficients = spectral_coefficients(columns, mass, without_gaps(given, mass))
    if len(weights) == 1:
        return reconstruct(columns, (weights[0] * coefficients.T).T)
    # (k, f), or (k, d, f)
    filtered = weights.T if given.ndim == 1 else weights.T[:, np.newaxis]
    filtered = coefficients[..., np.newaxis] * filtered
    sums = reconstruct(columns, filtered.reshape(len(filtered), -1))
    return sums.reshape(len(sums), *filtered.shape[1:])


def as_map_values(given: Any, n: int, *, columns: bool = True) -> FloatArray:
    """Convert a map of n vertices or, with `columns`, d maps to an array: shape (n,) or (n, d).

    `InputError` is raised if the shape differs, or values are labels or not real numbers.
    """
    wanted = f"one number per vertex, shape ({n},)" + (f" or ({n}, d)" if columns else "")
    if isinstance(given, VertexMap):
        if given.labels:
            fault = f"Map {given.name!r} has labels, whose numbers are not values of a function"
            raise InputError("labels-not-values", fault, "give another map")
        given = given.values
    if hasattr(given, "tocsr") or callable(given):
        raise wrong_type("Values of a map", type(given), f"{wanted}, in this order")
    try:
        array = np.asarray(given)
        if array.dtype.kind not in "biufO":
            raise TypeError
        values = array.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError("wrong-type", "A map is not of real numbers", f"give {wanted}") from None
    if values.ndim not in ((1, 2) if columns else (1,)) or len(values) != n:
        raise wrong_shape("Values of a map", values.shape, wanted)
    return values


def filled(values: FloatArray, mass: FloatArray) -> FloatArray:
    """Replace values that are not finite, shape (n,) or (n, d), by the mean of finite values.

    The mean of each column is weighted by `mass`, the areas of vertices; it is 0 if all values of
    the column are missing. The result is 0 at vertices without area.
    """
    used = mass > 0.0
    known_at = np.isfinite(values) & (used if values.ndim == 1 else used[:, np.newaxis])
    known = np.where(known_at, values, 0.0)
    if known_at[used].all():
        return known
    weight = np.where(used, mass, 0.0) @ known_at
    total = np.where(used, mass, 0.0) @ known
    mean = np.divide(total, weight, out=np.zeros_like(total), where=weight > 0.0)
    result: FloatArray = np.where(known_at, known, mean)
    result[~used] = 0.0
    return result


def without_gaps(values: FloatArray, mass: FloatArray) -> FloatArray:
    """Warn of missing values, and replace them as `filled`; `InputError` if all are missing."""
    used = mass > 0.0
    finite = np.isfinite(values[used])
    if finite.all():
        return filled(values, mass)
    if not finite.any(axis=0).all():
        raise InputError("no-values", "The map has no finite value at any vertex of the surface")
    gaps = int((~(finite if finite.ndim == 1 else finite.all(axis=1))).sum())
    warnings.warn(
        f"{gaps:,} of {int(used.sum()):,} vertices of the surface have no finite value in the map: "
        "they have no weight, and are replaced by the mean of the others.",
        MissingValuesWarning,
        stacklevel=3,
    )
    return filled(values, mass)


def _eigenvectors(given: Any) -> npt.NDArray[np.floating[Any]]:
    if hasattr(given, "tocsr") or hasattr(given, "eigenvectors"):
        raise wrong_type("Eigenvectors", type(given), "a matrix such as `pairs.eigenvectors`")
    columns = np.asarray(given)
    if columns.ndim != 2 or columns.dtype.kind not in "iuf":
        fault = f"Eigenvectors have shape {columns.shape} and type {columns.dtype}"
        raise InputError("wrong-shape", fault, "give a matrix of numbers, shape (n, k)")
    return columns
