"""The ranges of times and eigenvalues in force: chosen by hand, or taken from the spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from meshmash_viewer.features.truncation import FloatArray, mean_shares
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.spectral.weyl import resolved_time

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank

__all__ = [
    "band_range",
    "first_nonzero",
    "hks_range",
    "hks_time",
    "missing_shares",
    "resolved_from",
]


def first_nonzero(spectrum: Spectrum) -> int:
    """Index of the first eigenvalue that is more than rounding; their number if there is none.

    Without one there is no scale to take times or bands from.
    """
    values = spectrum.eigenvalues
    if not len(values):
        return 0
    return int(np.searchsorted(values, 1e-10 * abs(float(values[-1])), side="right"))


def hks_range(spectrum: Spectrum, display: Display) -> tuple[float, float]:
    """Shortest and longest HKS time in force, in squared length units.

    Parameters
    ----------
    spectrum : Spectrum
        With at least one pair; its `time_range` is the automatic one.
    display : Display
        Its `hks_automatic`, `hks_t_min` and `hks_t_max` are read; an end left open by hand is
        automatic, and ends in the wrong order are exchanged.
    """
    t_min, t_max = spectrum.time_range
    if not display.hks_automatic:
        t_min = display.hks_t_min or t_min
        t_max = display.hks_t_max or t_max
    return (t_min, t_max) if t_min < t_max else (t_max, t_min)


def hks_time(spectrum: Spectrum, display: Display) -> float:
    """HKS time in force: the chosen one, or the middle of the range in log scale."""
    if display.time is not None:
        return display.time
    t_min, t_max = hks_range(spectrum, display)
    return math.sqrt(t_min) * math.sqrt(t_max)


def resolved_from(spectrum: Spectrum) -> float:
    """Time from which the known pairs tell the HKS but for 1 %; 0 where these are all there are.

    See `meshmash_viewer.spectral.weyl.resolved_time`. The automatic range begins above it.
    """
    if 0 < spectrum.n_vertices <= len(spectrum):
        return 0.0
    return resolved_time(max(float(spectrum.eigenvalues[-1]), spectrum.known_to))


def missing_shares(spectrum: Spectrum, bank: FilterBank, area: float) -> FloatArray:
    """Estimate what is missing of each column for want of eigenpairs, shape (f,).

    Parameters
    ----------
    spectrum : Spectrum
        With at least one pair.
    bank : FilterBank
    area : float
        Of the surface, in squared length units.
    """
    return mean_shares(
        bank, spectrum.eigenvalues, area, spectrum.n_vertices, spectrum.known_to or None
    )


def band_range(spectrum: Spectrum, display: Display) -> tuple[float, float]:
    """Smallest and largest eigenvalue of the bands in force, in inverse squared length units."""
    low, high = 0.0, float(spectrum.eigenvalues[-1])
    if not display.band_automatic:
        low = low if display.band_min is None else display.band_min
        high = high if display.band_max is None else display.band_max
    low, high = min(low, high), max(low, high)
    return (low, high) if low < high else (low, low + 1.0)
