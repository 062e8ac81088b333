"""Profiles of one vertex: what the features and the eigenfunctions say about it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.band_curves import band_bank
from meshmash_viewer.filters import hks_times

__all__ = ["FINE", "band_profile", "fine_times", "heat_profile"]

FloatArray = npt.NDArray[np.float64]

#: Times of a curve; the exported ones are dots on it.
FINE = 96


@lru_cache(maxsize=4)
def fine_times(t_min: float, t_max: float, count: int = FINE) -> FloatArray:
    """Times evenly spaced in log t, shape (count,)."""
    return hks_times(np.empty(0), t_min, t_max, count)


def heat_profile(eigenvalues: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """HKS of a vertex at some times, shape (f,), of its eigenfunction values, shape (k,)."""
    return np.exp(-np.outer(times, eigenvalues)) @ np.square(values)


def band_profile(
    eigenvalues: FloatArray, values: FloatArray, low: float, high: float, count: int
) -> FloatArray:
    """Geometry vector of a vertex, shape (count,), of its eigenfunction values, shape (k,)."""
    return band_bank(low, high, count)(eigenvalues) @ np.square(values)
