"""Spectral filtering of maps on a surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filter_parameters import checked_coefficients
from meshmash_viewer.features.map_values import (
    as_map_values,
    check_decomposition,
    without_gaps,
)
from meshmash_viewer.features.shape import reconstruct, spectral_coefficients

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigensolver import Decomposition


FloatArray: TypeAlias = npt.NDArray[np.float64]


def filter_map(
    decomposition: Decomposition,
    values: npt.ArrayLike,
    response: Callable[[FloatArray], npt.ArrayLike],
) -> FloatArray:
    """Filter a function on the surface, ``Φ h(Λ) Φᵀ M f``.

    With ``exp(-t λ)`` this is heat flow for a time t (within the computed eigenpairs); a low-pass
    filter keeps the waves of the function below its cut-off [1]_.

    Parameters
    ----------
    decomposition : Decomposition
        The eigenpairs; the remainder of the function beyond them is left out.
    values : VertexMap or array_like, shape (n,) or (n, d)
        One function in each column; values at unreferenced vertices are ignored. NaN and
        infinite values are replaced by the area-weighted mean of the other values of the function,
        so that the result there is interpolated.
    response : callable
        ``(k,) -> (k,)`` or ``(f, k)``: a `FilterBank` of f columns, or any function of the
        eigenvalues.

    Returns
    -------
    ndarray of float64
        In the unit of `values`; NaN at unreferenced vertices. The shape is (n,) for one function
        and one filter, (n, d) for d functions, (n, f) for f filters, and (n, d, f) for both.

    Raises
    ------
    InputError
        If the filter returns a wrong shape or values that are not finite, the map has another
        number of vertices or no finite value, or the arguments are in another order.

    Warns
    -----
    MissingValuesWarning
        If there are vertices without a value.

    References
    ----------
    .. [1] Vallet, B. and Lévy, B. (2008). "Spectral Geometry Processing with Manifold Harmonics."
       Computer Graphics Forum 27(2).

    Examples
    --------
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    >>> pairs = mv.solve(*mv.cotangent_laplacian((corners, faces)), 4)
    >>> mv.filter_map(pairs, [2.0, 2.0, 2.0, 2.0], mv.low_pass_bank(1e-3)).round(6)
    array([2., 2., 2., 2.])
    """
    check_decomposition(decomposition, "filter_map(pairs, values, response)")
    if not callable(response):
        raise InputError(
            "The filter comes last, as filter_map(pairs, values, response): it is a FilterBank or "
            f"another function of the eigenvalues, not of type {type(response).__name__}."
        )
    given = as_map_values(values, decomposition.rows.shape[1])
    weights = checked_coefficients(response(decomposition.eigenvalues), decomposition.eigenvalues)
    columns, mass = decomposition.rows.T, decomposition.mass
    coefficients = spectral_coefficients(columns, mass, without_gaps(given, mass))
    if len(weights) == 1:
        return reconstruct(columns, (weights[0] * coefficients.T).T)
    # (k, f), or (k, d, f)
    filtered = weights.T if given.ndim == 1 else weights.T[:, np.newaxis]
    filtered = coefficients[..., np.newaxis] * filtered
    sums = reconstruct(columns, filtered.reshape(len(filtered), -1))
    return sums.reshape(len(sums), *filtered.shape[1:])
