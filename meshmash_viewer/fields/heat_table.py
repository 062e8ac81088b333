"""The heat kernel signature at any time of a range, from a few stored columns.

The signatures of all times lie near a space of few dimensions, so some of them tell the others.
Which ones, and how they are combined, follows from the eigenvalues alone: a pivoted QR
factorisation of ``exp(-λ_k t)``, an interpolative decomposition (Cheng et al. 2005), takes times
until all that lie between are within a tolerance. So the error is known before anything is drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.squares import sum_squares
from meshmash_viewer.fields.spectrum import Spectrum, first_nonzero
from meshmash_viewer.progress import CancelCallback

__all__ = ["HeatTable", "build_heat_table"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Largest error of a time's mean signature; a step of colour is 4e-3.
_TOLERANCE = 7e-5
#: Times that are looked at for each e-fold of the range.
_DENSITY = 12


@dataclass(frozen=True, eq=False)
class HeatTable:
    """Stored columns of the signature, and how to combine them.

    Parameters
    ----------
    times : tuple of float
        The shortest and the longest that it tells, in squared length units.
    rates : ndarray of float64, shape (k,)
        Nonzero eigenvalues.
    columns : ndarray of float32, shape (m, n)
        The signature at m times without the null space, each over its heat trace.
    weights : ndarray of float64, shape (m, k)
        Decay of the pairs at a time, over its sum, to weights of the columns.
    base : ndarray of float32, shape (n,) or (1,)
        The null space's part, which is the same at all times; on a connected mesh also at all
        vertices. Beside it, what varies may be small.
    """

    times: tuple[float, float]
    rates: FloatArray
    columns: ColumnArray
    weights: FloatArray
    base: ColumnArray

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.columns.nbytes + self.base.nbytes

    def covers(self, time: float, last: float | None = None) -> bool:
        """Whether it tells a time, or a range of times."""
        rounding = 1.0 + 1e-9
        return self.times[0] <= time * rounding and (last or time) <= self.times[1] * rounding

    def at(self, time: float) -> ColumnArray:
        """The signature at one time that the table `covers`, shape (n,), in 1 / area."""
        trace = np.exp(-self.rates * time).sum()
        weights = trace * (self.weights @ _shares(self.rates, np.array([time]))[0])
        values: ColumnArray = weights.astype(np.float32) @ self.columns
        values += self.base
        return values


def build_heat_table(
    spectrum: Spectrum, times: tuple[float, float], cancel: CancelCallback | None = None
) -> HeatTable:
    """Compute a table for a range of times.

    Parameters
    ----------
    spectrum : Spectrum
    times : tuple of float
        Shortest and longest time, in squared length units.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.
    """
    n_zero = first_nonzero(spectrum)
    rates = spectrum.eigenvalues[n_zero:]
    chosen, weights = _interpolation(rates, times)
    coefficients = np.zeros((1 + len(chosen), len(spectrum)))
    coefficients[0, :n_zero] = 1.0
    coefficients[1:, n_zero:] = _shares(rates, chosen)
    sums = sum_squares(spectrum.rows, coefficients, cancel=cancel)
    base = np.asarray(sums[0])
    if base.min() == base.max():
        base = base[:1].copy()
    return HeatTable(times, rates, np.asarray(sums[1:]), weights, base)


def _interpolation(rates: FloatArray, times: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Times whose columns tell all in a range, and the weights of `HeatTable`."""
    from scipy.linalg import qr, solve_triangular

    if not len(rates):
        return np.zeros(0), np.zeros((0, 0))
    looked_at = np.geomspace(*times, 2 + math.ceil(_DENSITY * math.log(times[1] / times[0])))
    q, r, order = qr(_shares(rates, looked_at).T, mode="economic", pivoting=True)
    rank = next(
        (m for m in range(1, len(r)) if np.abs(q[:, m:] @ r[m:]).sum(axis=0).max() <= _TOLERANCE),
        len(r),
    )
    weights = solve_triangular(r[:rank, :rank], q[:, :rank].T)
    return looked_at[order[:rank]], np.asarray(weights, dtype=np.float64)


def _shares(rates: FloatArray, times: FloatArray) -> FloatArray:
    """Decay of each pair over the sum of all, shape (times, k), however little is left."""
    decay = np.exp(-np.outer(times, rates - rates[:1]))
    return np.asarray(decay / np.maximum(decay.sum(axis=1, keepdims=True), 1e-300))
