"""Any filter's field from a few stored columns and a few pairs: for filters that are dragged.

A smooth filter is a sum of the few functions that span all heat kernels. Any other is a broken
line over λ, bent at chosen eigenvalues, and what is left of it at the others. The columns of the
line are sums up to each bend, so that where it is level nothing is read; of what is left, the
largest few are added pair by pair. A sharp edge is far from its line for the pairs beside it alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.map_spectrum import partial_sum
from meshmash_viewer.features.sums import fill_in_parts, sum_squares
from meshmash_viewer.fields.family import Answer, ColumnArray, FloatArray
from meshmash_viewer.fields.spectrum import Spectrum, first_nonzero
from meshmash_viewer.progress import CancelCallback

#: Columns of smooth filters, and bends of a broken line.
_SMOOTH, _BENDS = 12, 40
#: Columns that are stored.
MOST_COLUMNS = _SMOOTH + _BENDS
#: Pairs that are read beside columns, or alone: one, in double precision, is read as long as four
#: columns are, and all of them together less than a frame at a million vertices.
_MOST_PAIRS, _MOST_ALONE = 2, 10
#: Vertices that one thread is done with before two have started.
_FEW = 1 << 18
#: Shares of its sum: that a pair, or all of them that are left of a line, has to be for it to be
#: seen; that may be left of all; and that below which a column is not read.
_SEEN, _LEFT, _NOTHING = 5e-4, 2e-3, 5e-5


@dataclass(eq=False)
class PairTable:
    """Stored columns, and the filters that they are of.

    Parameters
    ----------
    smooth : ndarray of float64, shape (s, k)
        Smooth filters at the eigenvalues, orthonormal.
    hats : ndarray of float64, shape (m, k)
        For each bend, what is 1 at its eigenvalue, 0 at those of the others, and straight between.
    bends : ndarray of int64, shape (m,)
        Pairs at whose eigenvalues the lines are bent.
    columns : ndarray of float32, shape (s + m, n)
        ``Σ_k b_k φ_k²``, or with coefficients ``Σ_k b_k c_k φ_k``, where b is one of the smooth
        filters, or of the sums of all hats from one on (`basis`).
    coefficients : ndarray of float64, shape (k,), optional
        Those of a map that is filtered.
    resting : tuple of two ndarrays, shapes (k,) and (n,), optional
        The weights of the last filter that was summed over all pairs, and that sum.
    """

    smooth: FloatArray
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
        # a filter that is nothing is 0, but NaN stays NaN
        used = np.flatnonzero(heights) if heights.any() else np.zeros(1, dtype=np.int64)
        # columns that lie together are read without gathering them
        lines = [
            (heights[run].astype(np.float32), self.columns[run[0] : run[-1] + 1])
            for run in np.split(used, np.flatnonzero(np.diff(used) > 1) + 1)
        ]
        left = weights - heights @ self.basis
        squared = self.coefficients is None
        if self.coefficients is not None:
            left = left * self.coefficients
        rest = left[apart].astype(np.float32)
        pairs = [np.asarray(rows[index]) for index in apart]
        values = np.empty(self.columns.shape[1], dtype=np.float32)

        def fill(part: slice) -> None:
            line, columns = lines[0]
            np.matmul(line, columns[:, part], out=values[part])
            for line, columns in lines[1:]:
                values[part] += line @ columns[:, part]
            if pairs:
                terms = np.array([each[part] for each in pairs], dtype=np.float32)
                values[part] += rest @ (np.square(terms, out=terms) if squared else terms)

        if len(values) > _FEW:
            fill_in_parts(len(values), fill)
        else:
            fill(slice(None))
        return values

    @cached_property
    def basis(self) -> FloatArray:
        """The filters that the columns are of, shape (s + m, k)."""
        return np.concatenate([self.smooth, np.cumsum(self.hats[::-1], axis=0)[::-1]])

    def _split(self, weights: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
        """What each column is taken times, and the pairs that are added one by one."""
        whole = np.abs(weights).sum()
        heights = np.zeros(len(self.basis))
        smooth = self.smooth @ weights
        if np.abs(weights - smooth @ self.smooth).sum() <= _LEFT * whole:
            heights[: len(smooth)] = smooth
            return heights, np.zeros(0, dtype=np.int64)
        alone = np.flatnonzero(np.abs(weights) > _SEEN * whole)
        if len(alone) <= _MOST_PAIRS:
            return heights, alone
        line, apart, left = self._broken_line(weights, _SEEN * whole)
        if left > _LEFT * whole and len(alone) <= _MOST_ALONE:
            return heights, alone
        rises = np.diff(line, prepend=0.0)
        shares = np.abs(rises) * self.basis[len(smooth) :].sum(axis=1)
        heights[len(smooth) :] = np.where(shares > _NOTHING * whole, rises, 0.0)
        return heights, apart

    def _broken_line(
        self, weights: FloatArray, seen: float
    ) -> tuple[FloatArray, npt.NDArray[np.int64], float]:
        """Its heights at the bends, the pairs farthest from it, and what is left of the others."""
        line = weights[self.bends]
        left = weights - line @ self.hats
        apart = np.sort(np.argsort(np.abs(left))[-_MOST_PAIRS:])
        apart = apart[np.abs(left[apart]) > seen]
        others = np.delete(np.arange(len(weights)), apart)
        if np.abs(left[others]).sum() > seen:
            # nearest to the other pairs, rather than through those it bends at; where they lie on
            # it already, it stays
            near = np.flatnonzero(self.hats[:, others] @ np.abs(left[others]) > seen / len(line))
            hats = self.hats[near][:, others]
            line = line.copy()
            line[near] += np.linalg.lstsq(hats @ hats.T, hats @ left[others], rcond=1e-10)[0]
            left = weights - line @ self.hats
        return line, apart, float(np.abs(left[others]).sum())


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
    places = np.arange(count)
    density = 0.6 * np.log1p(places) / np.log1p(count) + places / count
    wanted = np.linspace(0.0, density[-1], _BENDS)
    bends = np.unique(np.searchsorted(density, wanted * (1.0 - 1e-12)))
    # equal eigenvalues bend a line at one place
    bends = bends[np.unique(values[bends], return_index=True)[1]]
    hats = np.stack([np.interp(values, values[bends], unit) for unit in np.eye(len(bends))])
    found = PairTable(_smooth_filters(spectrum), hats, bends, np.zeros((0, 0), np.float32))
    if coefficients is None:
        columns = sum_squares(spectrum.rows, found.basis, cancel=cancel)
    else:
        columns = partial_sum(spectrum.rows, found.basis * coefficients, 0, count)
    return replace(found, columns=np.asarray(columns, np.float32), coefficients=coefficients)


def _smooth_filters(spectrum: Spectrum) -> FloatArray:
    """The functions that span heat kernels of all times, shape (at most 12, k), orthonormal."""
    values = np.maximum(spectrum.eigenvalues, 0.0)  # rounding must not grow
    lowest, highest = values[min(first_nonzero(spectrum), len(values) - 1)], values[-1]
    times = 1.0 / np.geomspace(max(lowest / 12.0, 1e-300), max(3.0 * highest, 1e-300), 80)
    kernels = np.exp(-np.outer(np.append(times, 0.0), values))
    kernels /= np.linalg.norm(kernels, axis=1, keepdims=True)
    kernels[-1] *= 3.0  # what is the same everywhere is to be told to the last digit
    return np.asarray(np.linalg.svd(kernels, full_matrices=False)[2][:_SMOOTH])
