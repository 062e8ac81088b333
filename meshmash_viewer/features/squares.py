"""Sums of squared eigenvectors: what every feature is made of."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import CancelCallback, Cancelled
from meshmash_viewer.spectral.alignment import ShownRows

__all__ = ["add_squares", "sum_squares"]

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
) -> FloatArray:
    """Sum ``Σ_k coefficients[f, k] rows[k]²`` in double precision.

    Parameters
    ----------
    rows : ndarray, shape (>= k, n)
        May be a memory map; only rows with a coefficient are read.
    coefficients : ndarray of float64, shape (f, k)
    dtype : dtype
        Of what is returned.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.

    Returns
    -------
    ndarray, shape (f, n)
    """
    total = np.zeros((len(coefficients), rows.shape[1]), dtype=dtype)
    add_squares(total, rows, coefficients, np.float64, cancel)
    return total


def add_squares(
    total: FloatArray,
    rows: FloatArray | ShownRows,
    coefficients: npt.NDArray[np.float64],
    precision: npt.DTypeLike = np.float32,
    cancel: CancelCallback | None = None,
    *,
    negligible: float = _NEGLIGIBLE,
    density: npt.NDArray[np.float64] | None = None,
) -> None:
    """Add ``Σ_k coefficients[f, k] rows[k]²`` to `total`, shape (f, n), in place.

    Parameters
    ----------
    total : ndarray, shape (f, n)
    rows : ndarray, shape (>= k, n)
    coefficients : ndarray of float64, shape (f, k)
    precision : dtype
        Of the products: single precision is good to 1e-6 and twice as fast.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.
    negligible : float
        Pairs whose coefficients are at most this share of the largest are not read.
    density : ndarray of float64, shape (n,), optional
        Gets ``Σ_k rows[k]²`` of all pairs added, in the same pass.
    """
    size = np.abs(coefficients).max(axis=0, initial=0.0)
    read = size > negligible * size.max(initial=0.0)
    used = np.arange(len(size)) if density is not None else np.flatnonzero(read)
    if not len(used):
        if len(rows):
            total += 0.0 * rows[0]  # NaN stays NaN
        return
    for first in range(0, len(used), _ROWS):
        band = used[first : first + _ROWS]
        weights = coefficients[:, band].astype(precision)
        # rows that follow one another are read without gathering them
        together = band[-1] - band[0] + 1 == len(band)
        which = slice(int(band[0]), int(band[-1]) + 1) if together else band
        for start in range(0, rows.shape[1], _VERTICES):
            if cancel is not None and cancel():
                raise Cancelled
            part = slice(start, start + _VERTICES)
            squares = np.square(rows[which, part], dtype=precision)
            total[:, part] += weights @ squares
            if density is not None:
                density[part] += squares.sum(axis=0)
