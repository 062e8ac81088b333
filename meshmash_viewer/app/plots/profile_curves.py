"""Profiles of vertices: what the features and the eigenfunctions say about each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.plots.band_curves import band_responses
from meshmash_viewer.features.filters import hks_times
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.ranges import band_range, hks_range
from meshmash_viewer.model.spectrum import Spectrum

__all__ = ["Samples", "samples_of"]

FloatArray = npt.NDArray[np.float64]

#: Times of a curve; the exported ones are dots on it.
_FINE = 96


@dataclass(frozen=True, eq=False)
class Samples:
    """Places of a profile, and how its values there come from a vertex's eigenfunction values.

    Parameters
    ----------
    places : ndarray of float64, shape (m,)
        As drawn: log t, band, or index.
    coefficients : ndarray of float64, shape (m, k)
        Of φ² for features; for eigenfunctions the sign of each, shape (k,).
    logarithmic : bool
        Whether values are drawn as their logarithm.
    """

    places: FloatArray
    coefficients: FloatArray
    logarithmic: bool = False

    def values(self, at_vertex: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points to draw for the eigenfunction values at a vertex, shape (<= k,)."""
        length = len(at_vertex)
        if self.coefficients.ndim == 1:
            return self.places[:length], self.coefficients[:length] * at_vertex
        values = self.coefficients[:, :length] @ np.square(at_vertex)
        if self.logarithmic:
            values = np.log10(np.maximum(values, np.finfo(np.float64).tiny))
        return self.places, values


def samples_of(view: str, spectrum: Spectrum, display: Display) -> tuple[Samples, Samples]:
    """What to draw as a curve and what as dots on it; the dots are the exported columns.

    Parameters
    ----------
    view : str
        "hks", "bands" or "eigenfunctions".
    spectrum : Spectrum
    display : Display
    """
    eigenvalues = spectrum.eigenvalues
    if view == "eigenfunctions":
        signs = np.ones(len(eigenvalues))
        signs[[index for index in display.flipped if index < len(signs)]] = -1.0
        both = Samples(np.arange(len(eigenvalues), dtype=np.float64), signs)
        return both, both
    if view == "bands":
        count = display.band_count
        responses = band_responses(*band_range(spectrum, display), count, eigenvalues)
        both = Samples(np.arange(count, dtype=np.float64), responses)
        return both, both
    between = hks_range(spectrum, display)
    curve, dots = (
        Samples(np.log10(times), np.exp(-np.outer(times, eigenvalues)), logarithmic=True)
        for times in (
            hks_times(eigenvalues, *between, _FINE),
            hks_times(eigenvalues, *between, display.hks_scales),
        )
    )
    return curve, dots
