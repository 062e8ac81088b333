"""Maps on a surface passed through a filter of its spectrum."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.shape import reconstruct, spectral_coefficients

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigensolver import Decomposition

__all__ = ["filter_map"]

FloatArray: TypeAlias = npt.NDArray[np.float64]


def filter_map(
    decomposition: Decomposition,
    values: npt.ArrayLike,
    response: Callable[[FloatArray], npt.ArrayLike],
) -> FloatArray:
    """Pass a function on the surface through a filter of its spectrum, ``Φ h(Λ) Φᵀ M f``.

    With ``exp(-t λ)`` that is heat flow for a time t (as far as the eigenpairs reach); with a
    low-pass filter, the waves of the function below its cut-off [1]_.

    Parameters
    ----------
    decomposition : Decomposition
        The eigenpairs; what is in no computed pair is left out, whatever the filter.
    values : array_like, shape (n,) or (n, d)
        One function a column; what it is at vertices that no face uses is not looked at.
    response : callable
        ``(k,) -> (k,)`` or ``(1, k)``: a `FilterBank` of one column, or any function of the
        eigenvalues.

    Returns
    -------
    ndarray of float64, shape (n,) or (n, d)
        In the unit of `values`; NaN at vertices that no face uses.

    Raises
    ------
    InputError
        If the filter has more than one column, or the shapes do not agree.

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
    eigenvalues = decomposition.eigenvalues
    weights = np.asarray(response(eigenvalues), dtype=np.float64)
    if weights.shape not in ((len(eigenvalues),), (1, len(eigenvalues))):
        raise InputError(
            f"The filter returned shape {weights.shape} for {len(eigenvalues)} eigenvalues: a map "
            "takes a filter of one column."
        )
    columns = decomposition.rows.T
    coefficients = spectral_coefficients(columns, decomposition.mass, values)
    return reconstruct(columns, (weights.reshape(-1) * coefficients.T).T)
