"""Feature columns: a filter bank applied to eigenpairs.

Column f at vertex v is ``F[v, f] = Σ_k coefficients[f, k] φ_k(v)²``. Squares do not depend on the
sign of an eigenvector, nor, summed over a multiple eigenvalue, on the choice of its basis.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import power_unit

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition
    from meshmash_viewer.filters import FilterBank

__all__ = ["Features", "accumulate_features", "compute_features"]

FloatArray: TypeAlias = npt.NDArray[np.float64]

#: Pairs and vertices squared at a time: 4 MB, so that squares are still in cache when summed.
_ROWS, _VERTICES = 32, 16384


@dataclass(frozen=True, eq=False)
class Features:
    """Named columns of numbers, one row a vertex.

    Parameters
    ----------
    values : ndarray, shape (n, f)
        NaN at unreferenced vertices.
    columns : tuple of str
        Name of each column.
    unit : str
        Unit of the values, such as "nm⁻²"; "" for none or not stated.
    kind : str
        What they are: "hks", "geometry-vectors", ...
    meta : dict
        How they were made; JSON-able.
    """

    values: npt.NDArray[np.floating[Any]]
    columns: tuple[str, ...]
    unit: str = ""
    kind: str = "features"
    meta: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.columns):
            raise InputError(
                f"Features of shape {self.values.shape} do not go with {len(self.columns)} column "
                "names: give one name a column."
            )


def compute_features(
    decomposition: Decomposition,
    bank: FilterBank,
    *,
    unit: str = "",
    drop_first: bool = False,
    dtype: npt.DTypeLike = np.float64,
) -> Features:
    """Apply a filter bank to eigenpairs.

    Parameters
    ----------
    decomposition : Decomposition
        The eigenpairs; rows may be a memory map.
    bank : FilterBank
        The filters; called once, with all eigenvalues that take part.
    unit : str
        Unit of the mesh's coordinates; the values then have its power -2, because eigenvectors
        have unit integral of their square.
    drop_first : bool
        Whether to leave out the first pair, exactly one.
    dtype : dtype
        Of the values; sums are in float64 anyway.

    Returns
    -------
    Features
        Values of shape (n, f).
    """
    start = 1 if drop_first else 0
    eigenvalues = decomposition.eigenvalues[start:]
    values = accumulate_features(eigenvalues, decomposition.rows[start:], bank(eigenvalues))
    meta = {
        "kind": bank.kind,
        "parameter": bank.parameter_name,
        "parameter_unit": power_unit(unit, bank.parameter_power),
        "parameters": bank.parameters.tolist(),
        "n_eigenpairs": len(eigenvalues),
        "drop_first": drop_first,
    }
    values = values.astype(dtype, copy=False)
    return Features(values, bank.columns, power_unit(unit, -2), bank.kind, meta)


def accumulate_features(
    eigenvalues: npt.ArrayLike,
    rows: npt.NDArray[np.floating[Any]],
    coefficients: npt.ArrayLike,
    out: FloatArray | None = None,
) -> FloatArray:
    """Sum ``coefficients[f, k] rows[k, v]²`` over k, reading each row once and in order.

    Parameters
    ----------
    eigenvalues : array_like, shape (k,)
        Only their number is looked at: it has to agree with the other two.
    rows : ndarray of float64 or float32, shape (k, n)
        Eigenvectors as rows; may be a memory map, of which a few rows are in memory at a time.
    coefficients : array_like, shape (f, k)
        What a filter bank returned for `eigenvalues`.
    out : ndarray of float64, shape (n, f), optional
        Added to, so that a spectrum can be summed band by band.

    Returns
    -------
    ndarray of float64, shape (n, f)
        `out`, or a new array.

    Raises
    ------
    InputError
        If the shapes do not agree, as when a filter returned one of its own.
    """
    weights = np.asarray(coefficients, dtype=np.float64)
    k, n = rows.shape
    if weights.ndim != 2 or weights.shape[1] != k or np.shape(eigenvalues) != (k,):
        raise InputError(
            f"The filter returned shape {weights.shape} for {k} eigenvalues: it has to return one "
            "row of coefficients a filter, shape (n_filters, n_eigenvalues)."
        )
    total = np.zeros((n, len(weights))) if out is None else out
    for first in range(0, k, _ROWS):
        band = slice(first, min(first + _ROWS, k))
        for left in range(0, n, _VERTICES):
            part = slice(left, min(left + _VERTICES, n))
            squares = np.square(rows[band, part], dtype=np.float64)
            total[part] += squares.T @ weights[:, band].T
    return total
