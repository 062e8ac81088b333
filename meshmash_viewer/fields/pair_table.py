"""Any filter's field from a few stored columns and a few pairs: for filters that are dragged.

A filter is a broken line over λ, bent at chosen eigenvalues, and what is left of it at the others.
The columns tell the broken line; of what is left, the largest few are added pair by pair. A smooth
filter is near its broken line, and a sharp edge is far from it for the pairs beside it alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.map_spectrum import partial_sum
from meshmash_viewer.features.sums import fill_in_parts, sum_squares
from meshmash_viewer.fields.family import Answer, ColumnArray, FloatArray
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

__all__ = ["MOST_COLUMNS", "PairTable", "build_pair_table", "summed"]

#: Columns that are stored, and pairs that are read beside them, or alone: together less than a
#: frame at a million vertices.
MOST_COLUMNS, _MOST_PAIRS, _MOST_ALONE = 24, 6, 10
#: Share of its sum that a pair, or all of them that are left, has to be for it to be seen; and
#: that below which a column at either end is not read.
_SEEN, _NOTHING = 5e-4, 5e-5


@dataclass(eq=False)
class PairTable:
    """Stored columns of broken lines over λ.

    Parameters
    ----------
    hats : ndarray of float64, shape (m, k)
        For each bend, what is 1 at its eigenvalue, 0 at those of the others, and straight between.
    bends : ndarray of int64, shape (m,)
        Pairs at whose eigenvalues the lines are bent.
    columns : ndarray of float32, shape (m, n)
        ``Σ_k hats[j, k] φ_k²``, or with coefficients ``Σ_k hats[j, k] c_k φ_k``.
    coefficients : ndarray of float64, shape (k,), optional
        Those of a map that is filtered.
    resting : tuple of two ndarrays, shapes (k,) and (n,), optional
        The weights of the last filter that was summed over all pairs, and that sum.
    """

    hats: FloatArray
    bends: npt.NDArray[np.int64]
    columns: ColumnArray
    coefficients: FloatArray | None = None
    resting: tuple[FloatArray, ColumnArray] | None = None

    def rests(self, weights: FloatArray) -> bool:
        """Whether the sum with these weights is there."""
        return self.resting is not None and np.array_equal(self.resting[0], weights)

    def rest(
        self, weights: FloatArray, rows: Any, cancel: CancelCallback | None = None
    ) -> PairTable:
        """Compute the sum with these weights."""
        self.resting = weights, summed(weights, rows, self.coefficients, cancel)
        return self

    def answer(self, weights: FloatArray, rows: Any) -> Answer:
        """The sum with these weights, or about it until it rests."""
        known = self.resting  # another thread may replace it
        if known is not None and np.array_equal(known[0], weights):
            return Answer(known[1])
        return Answer(self.at(weights, rows), draft=True)

    def at(self, weights: FloatArray, rows: Any) -> ColumnArray:
        """About ``Σ_k weights[k] rows[k]²`` or ``Σ_k weights[k] c_k rows[k]``, shape (n,)."""
        heights, apart = self._split(weights)
        share = np.abs(heights) * self.hats.sum(axis=1) / max(np.abs(weights).sum(), 1e-300)
        used = np.flatnonzero(share > _NOTHING)
        # what lies together is read faster than a gathering of the columns
        which = slice(int(used[0]), int(used[-1]) + 1) if len(used) else slice(0, 1)
        # a filter that is nothing is 0, but NaN stays NaN
        line = heights[which].astype(np.float32) if len(used) else np.zeros(1, dtype=np.float32)
        left = weights - heights @ self.hats
        squared = self.coefficients is None
        if self.coefficients is not None:
            left = left * self.coefficients
        rest = left[apart].astype(np.float32)
        pairs = [np.asarray(rows[index]) for index in apart]
        values = np.empty(self.columns.shape[1], dtype=np.float32)

        def fill(part: slice) -> None:
            np.matmul(line, self.columns[which, part], out=values[part])
            if pairs:
                terms = np.array([each[part] for each in pairs], dtype=np.float32)
                values[part] += rest @ (np.square(terms, out=terms) if squared else terms)

        fill_in_parts(len(values), fill)
        return values

    def _split(self, weights: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
        """Heights of the broken line at its bends, and the pairs that are added one by one."""
        seen = _SEEN * np.abs(weights).sum()
        alone = np.flatnonzero(np.abs(weights) > seen)
        if len(alone) <= _MOST_ALONE:
            return np.zeros(len(self.bends)), alone
        heights = weights[self.bends]
        left = np.abs(weights - heights @ self.hats)
        apart = np.sort(np.argsort(left)[-_MOST_PAIRS:])
        apart = apart[left[apart] > seen]
        if left.sum() - left[apart].sum() > seen:
            # the line that is nearest to all other pairs, rather than one through those it bends at
            others = np.delete(self.hats, apart, axis=1)
            wanted = others @ np.delete(weights, apart)
            heights = np.asarray(np.linalg.lstsq(others @ others.T, wanted, rcond=1e-10)[0])
        return heights, apart


def summed(
    weights: FloatArray,
    rows: Any,
    coefficients: FloatArray | None = None,
    cancel: CancelCallback | None = None,
) -> ColumnArray:
    """The sum that `PairTable.at` is about, over all pairs."""
    if coefficients is None:
        return np.asarray(sum_squares(rows, weights[None], cancel=cancel)[0])
    last = int(np.max(np.flatnonzero(weights), initial=-1)) + 1
    return partial_sum(rows, weights * coefficients, 0, last).astype(np.float32)


def build_pair_table(
    spectrum: Spectrum,
    cancel: CancelCallback | None = None,
    coefficients: FloatArray | None = None,
) -> PairTable:
    """Compute the columns for a spectrum, or for a map with these coefficients on it."""
    values, count = spectrum.eigenvalues, len(spectrum)
    # close together at the low end, where filters change by the logarithm of λ
    density = np.log1p(np.arange(count)) / np.log1p(count) + np.arange(count) / count
    wanted = np.linspace(0.0, density[-1], MOST_COLUMNS)
    bends = np.unique(np.searchsorted(density, wanted * (1.0 - 1e-12)))
    # equal eigenvalues bend a line at one place
    bends = bends[np.unique(values[bends], return_index=True)[1]]
    hats = np.stack([np.interp(values, values[bends], unit) for unit in np.eye(len(bends))])
    if coefficients is None:
        columns = np.asarray(sum_squares(spectrum.rows, hats, cancel=cancel), dtype=np.float32)
    else:
        columns = partial_sum(spectrum.rows, hats * coefficients, 0, count).astype(np.float32)
    return PairTable(hats, bends, columns, coefficients)
