"""Sums of squared eigenvectors: what every feature is made of."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import CancelCallback, Cancelled
from meshmash_viewer.spectral.alignment import ShownRows

__all__ = ["sum_squares"]

FloatArray: TypeAlias = npt.NDArray[np.floating[Any]]

#: Pairs and vertices squared at a time: 4 MB, so that squares are still in cache when summed, and
#: few rows of a memory map are in memory.
_ROWS, _VERTICES = 128, 4096
#: Pairs whose coefficient is below this share of the largest are not even read.
_NEGLIGIBLE = 1e-13


def sum_squares(
    rows: FloatArray | ShownRows,
    coefficients: npt.NDArray[np.float64],
    dtype: npt.DTypeLike = np.float32,
    cancel: CancelCallback | None = None,
    *,
    order: Literal["C", "F"] = "C",
    negligible: float = _NEGLIGIBLE,
    density: npt.NDArray[np.float64] | None = None,
) -> FloatArray:
    """Sum ``Σ_k coefficients[f, k] rows[k]²`` in double precision.

    Parameters
    ----------
    rows : ndarray, shape (>= k, n)
        May be a memory map; only rows with a coefficient are read.
    coefficients : ndarray of float64, shape (f, k)
    dtype : dtype
        Of what is returned.
    order : {"C", "F"}
        How that lies in memory.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.
    negligible : float
        Pairs whose coefficients are at most this share of the largest are not read.
    density : ndarray of float64, shape (n,), optional
        Gets ``Σ_k rows[k]²`` of all pairs added, in the same pass.

    Returns
    -------
    ndarray, shape (f, n)
    """
    total = np.zeros((len(coefficients), rows.shape[1]), dtype, order)
    size = np.abs(coefficients).max(axis=0, initial=0.0)
    read = size > negligible * size.max(initial=0.0)
    used = np.arange(len(size)) if density is not None else np.flatnonzero(read)
    if not len(used) and len(rows):
        total += 0.0 * rows[0]  # NaN stays NaN
    for first in range(0, len(used), _ROWS):
        band = used[first : first + _ROWS]
        # rows that follow one another are read without gathering them
        together = band[-1] - band[0] + 1 == len(band)
        which = slice(int(band[0]), int(band[-1]) + 1) if together else band
        for start in range(0, rows.shape[1], _VERTICES):
            if cancel is not None and cancel():
                raise Cancelled
            part = slice(start, start + _VERTICES)
            squares = np.square(rows[which, part], dtype=np.float64)
            total[:, part] += coefficients[:, band] @ squares
            if density is not None:
                density[part] += squares.sum(axis=0)
    return total
