"""Interpolation of the heat kernel signature in time, from a few stored columns.

The signature of a vertex is a smooth function of log t, so it is interpolated between nodes evenly
spaced in log t. Polynomials would be inaccurate where ``exp(-λ t)`` decreases steeply; instead the
six nodes around a time are combined with the weights of a least-squares fit of ``exp(-λ_k t)`` over
the spectrum, with an error of at most 1e-4 of its sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.sums import sum_squares
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero

ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Number of nodes combined for one time, and their distance in log t.
_STENCIL, _STEP = 6, 0.27
#: Share of the largest singular value below which others are neglected in a fit.
_ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class HeatTable:
    """Stored columns of the signature, and weights to combine them."""

    #: Shortest and longest time, in squared length units.
    times: tuple[float, float]
    #: Shape (k,): Nonzero eigenvalues.
    rates: FloatArray
    #: Shape (m, n): The signature at the nodes without the null space, divided by the heat trace.
    columns: ColumnArray
    #: Shape (6, k): For each first node: matrix from the normalised decay of the pairs to weights.
    fits: list[FloatArray]
    #: Shape (n,): Contribution of the null space, constant in time and possibly much larger than
    #: the rest.
    base: ColumnArray

    def covers(self, time: float, last: float | None = None) -> bool:
        """Whether a time, or a range of times, is within that of the table."""
        rounding = 1.0 + 1e-9
        return self.times[0] <= time * rounding and (last or time) <= self.times[1] * rounding

    def at(self, time: float) -> ColumnArray:
        """Interpolate the signature at one time that the table `covers`, shape (n,), 1 / area."""
        start = int(math.log(max(time / self.times[0], 1.0)) / _STEP)
        start = min(start, len(self.fits) - 1)
        weights = self.fits[start] @ _shares(self.rates, np.array([time]))[0]
        weights *= np.exp(-self.rates * time).sum()
        values: ColumnArray = weights.astype(np.float32) @ self.columns[start : start + _STENCIL]
        values += self.base
        return values


def build_heat_table(
    spectrum: Eigenpairs, times: tuple[float, float], cancel: CancelCallback | None = None
) -> HeatTable:
    """Compute the table for a range of times, in squared length units."""
    n_zero = first_nonzero(spectrum)
    rates = spectrum.eigenvalues[n_zero:]
    n_fits = max(math.ceil(math.log(times[1] / times[0]) / _STEP), 1)
    # As many nodes below a time as above it.
    places = np.arange(n_fits + _STENCIL - 1) - (_STENCIL // 2 - 1)
    shares = _shares(rates, times[0] * np.exp(_STEP * places))
    coefficients = np.zeros((1 + len(shares), len(spectrum)))
    coefficients[0, :n_zero] = 1.0
    coefficients[1:, n_zero:] = shares
    sums = sum_squares(spectrum.rows, coefficients, cancel=cancel)
    stencils = (shares[start : start + _STENCIL] for start in range(n_fits))
    fits = [np.asarray(np.linalg.pinv(stencil.T, rcond=_ROUNDING)) for stencil in stencils]
    return HeatTable(times, rates, np.asarray(sums[1:]), fits, np.asarray(sums[0]))


def _shares(rates: FloatArray, times: FloatArray) -> FloatArray:
    """Compute the decay of each pair divided by the sum, without underflow, (times, k)."""
    decay = np.exp(-np.outer(times, rates - rates[:1]))
    return np.asarray(decay / np.maximum(decay.sum(axis=1, keepdims=True), 1e-300))
