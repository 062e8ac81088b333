"""The B-spline bands as curves to draw and numbers to name.

Bands of another range are the same curves stretched, so they are made once for the range 0 to 1
and a number of bands; dragging an end then costs next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.filters import FilterBank, bspline_bank

__all__ = ["BandCurve", "band_centers", "band_curves", "band_responses", "band_support"]

FloatArray = npt.NDArray[np.float64]

#: Along the support of one band.
_SAMPLES = 33


@dataclass(frozen=True, eq=False)
class BandCurve:
    """One band sampled over its support; both arrays have shape (m,)."""

    eigenvalues: FloatArray
    response: FloatArray


@lru_cache(maxsize=8)
def _unit_bank(count: int) -> FilterBank:
    return bspline_bank(0.0, 1.0, count)


@lru_cache(maxsize=8)
def _unit_curves(count: int) -> tuple[BandCurve, ...]:
    curves = []
    for band in range(count):
        places = np.linspace(*band_support(0.0, 1.0, count, band), _SAMPLES)
        curves.append(BandCurve(places, np.zeros(_SAMPLES)))
    everywhere = np.concatenate([curve.eigenvalues for curve in curves])
    # all bands at all places at once is small and far cheaper than band by band
    responses = _unit_bank(count)(everywhere).reshape(count, count, _SAMPLES)
    return tuple(
        BandCurve(curve.eigenvalues, responses[band, band]) for band, curve in enumerate(curves)
    )


def band_centers(low: float, high: float, count: int) -> FloatArray:
    """Eigenvalue in the middle of each band, shape (count,)."""
    return low + (high - low) * _unit_bank(count).parameters


def band_responses(low: float, high: float, count: int, eigenvalues: FloatArray) -> FloatArray:
    """Response of all bands to some eigenvalues, shape (count, k)."""
    return _unit_bank(count)((eigenvalues - low) / (high - low))


def band_support(low: float, high: float, count: int, band: int) -> tuple[float, float]:
    """Range of eigenvalues in which a band is not zero: at most four knot spans."""
    degree = min(3, count - 1)
    spans = count - degree
    first, last = max(band - degree, 0), min(band + 1, spans)
    width = (high - low) / spans
    return low + first * width, low + last * width


def band_curves(low: float, high: float, count: int) -> tuple[BandCurve, ...]:
    """All bands, each sampled over its support only."""
    return tuple(
        BandCurve(low + (high - low) * curve.eigenvalues, curve.response)
        for curve in _unit_curves(count)
    )
