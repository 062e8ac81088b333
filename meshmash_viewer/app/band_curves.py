"""The B-spline bands as curves to draw and numbers to name."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from meshmash_viewer.filters import FilterBank, bspline_bank

__all__ = ["BandCurve", "band_bank", "band_curves", "band_support"]

_SAMPLES = 48


@dataclass(frozen=True, eq=False)
class BandCurve:
    """One band sampled over its support; both arrays have shape (m,)."""

    eigenvalues: npt.NDArray[np.float64]
    response: npt.NDArray[np.float64]


@lru_cache(maxsize=16)
def band_bank(low: float, high: float, count: int) -> FilterBank:
    """The bank of a range and a number of bands; the last few are kept."""
    return bspline_bank(low, high, count)


def band_support(low: float, high: float, count: int, band: int) -> tuple[float, float]:
    """Range of eigenvalues in which a band is not zero: at most four knot spans."""
    degree = min(3, count - 1)
    spans = count - degree
    first, last = max(band - degree, 0), min(band + 1, spans)
    width = (high - low) / spans
    return low + first * width, low + last * width


@lru_cache(maxsize=16)
def band_curves(low: float, high: float, count: int) -> tuple[BandCurve, ...]:
    """All bands, each sampled over its support only."""
    curves = []
    # one call for all would be count² × samples: each band is asked on its own support instead
    from meshmash_viewer.filters import construct_bspline_basis

    for band, basis in enumerate(construct_bspline_basis(low, high, count)):
        start, end = band_support(low, high, count, band)
        x = np.linspace(start, end, _SAMPLES)
        curves.append(BandCurve(x, np.maximum(basis(x), 0.0)))
    return tuple(curves)
