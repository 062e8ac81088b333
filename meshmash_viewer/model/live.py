"""Features of the displayed spectrum at a cost that does not grow with the number of pairs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from meshmash_viewer.model.display import SimilarityBasis
from meshmash_viewer.model.field import FieldRequest
from meshmash_viewer.model.spectrum import Spectrum

__all__ = ["LiveFeatures"]

FloatArray = npt.NDArray[np.float32]


def direct_sum(spectrum: Spectrum, coefficients: npt.NDArray[np.float64]) -> FloatArray:
    """Sum ``Σ_k coefficients[f, k] φ_k²`` over the pairs that count, shape (f, n)."""
    n = spectrum.rows.shape[1]
    total = np.zeros((len(coefficients), n), dtype=np.float64)
    for k in np.flatnonzero(np.abs(coefficients).max(axis=0, initial=0.0) > 0.0):
        square = np.square(spectrum.rows[k], dtype=np.float64)
        for f, coefficient in enumerate(coefficients[:, k]):
            if coefficient:
                total[f] += coefficient * square
    return total.astype(np.float32)


class LiveFeatures:
    """Answers feature requests; direct sums for now."""

    def heat_kernel(self, request: FieldRequest) -> tuple[FloatArray, bool]:
        """HKS at one time, shape (n,), and whether a better answer is on its way."""
        decay = np.exp(-request.spectrum.eigenvalues * request.time)
        return direct_sum(request.spectrum, decay[None])[0], False

    def band(self, request: FieldRequest) -> tuple[FloatArray, bool]:
        """One geometry vector, shape (n,), and whether a better answer is on its way."""
        from meshmash_viewer.filters import bspline_bank

        bank = bspline_bank(*request.eigenvalues, request.band_count)
        response = bank.response(request.spectrum.eigenvalues)[request.band]
        return direct_sum(request.spectrum, response[None])[0], False

    def similarity(self, request: FieldRequest) -> tuple[FloatArray, bool]:
        """Feature distance from one vertex, shape (n,), and whether it will get better."""
        from meshmash_viewer.filters import bspline_bank, heat_kernel_bank, hks_times

        values = request.spectrum.eigenvalues
        if request.basis is SimilarityBasis.HKS:
            bank = heat_kernel_bank(hks_times(values, *request.times, request.scales))
        else:
            bank = bspline_bank(*request.eigenvalues, request.band_count)
        features = direct_sum(request.spectrum, bank.response(values))
        spread = np.nanstd(features, axis=1, keepdims=True)
        features /= np.where(spread > 0.0, spread, 1.0)
        difference = features - features[:, request.vertex, None]
        return np.sqrt(np.square(difference).mean(axis=0)), False
