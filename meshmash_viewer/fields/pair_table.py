"""Fast approximation of the field of any filter, from a few stored columns and a few pairs.

A smooth filter is approximated by the few functions that span all heat kernels. Any other filter is
approximated by a piecewise linear function of λ with nodes at chosen eigenvalues. Its columns are
the sums up to each node, so that columns of constant pieces need not be read; the few pairs with
the largest remainder are added one by one. A sharp edge has a large remainder only at the pairs
next to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.map_spectrum import partial_sum
from meshmash_viewer.features.sums import fill_in_parts, sum_squares
from meshmash_viewer.fields.family import Answer, ColumnArray
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero

#: Number of columns of smooth filters, and of nodes of the piecewise linear function.
_SMOOTH, _BENDS = 12, 40
#: Maximum number of stored columns.
MOST_COLUMNS = _SMOOTH + _BENDS
#: Maximum number of pairs read in addition to columns, or alone. Reading one, in double precision,
#: takes as long as four columns; all together take less than a frame at a million vertices.
_MOST_PAIRS, _MOST_ALONE = 2, 10
#: Number of vertices up to which one thread is faster than two.
_FEW = 1 << 18
#: Shares of the sum of a filter: above which a pair, or the whole remainder, is visible; that the
#: remainder may have; and below which a column is not read.
_SEEN, _LEFT, _NOTHING = 5e-4, 2e-3, 5e-5


@dataclass(eq=False)
class PairTable:
    """Stored columns, and their filters."""

    #: Shape (s, k): Smooth filters at the eigenvalues, orthonormal.
    smooth: FloatArray
    #: Shape (m, k): For each node the function that is 1 there, 0 at the other nodes, and linear
    #: between.
    hats: FloatArray
    #: Shape (m,): Pairs at whose eigenvalues the nodes are.
    bends: npt.NDArray[np.int64]
    #: Shape (s + m, n): ``Σ_k b_k φ_k²``, or with coefficients ``Σ_k b_k c_k φ_k``, where b is a
    #: row of `basis`: one of the smooth filters, or the sum of all hats from one on.
    columns: ColumnArray
    #: Shape (k,): Coefficients of a filtered map.
    coefficients: FloatArray | None = None
    #: Shapes (k,) and (n,): The weights of the last filter summed over all pairs, and that sum.
    resting: tuple[FloatArray, ColumnArray] | None = None

    def rests(self, weights: FloatArray) -> bool:
        """Whether the exact sum with these weights is stored."""
        return self.resting is not None and np.array_equal(self.resting[0], weights)

    def rest(
        self, weights: FloatArray, rows: Any, cancel: CancelCallback | None = None
    ) -> PairTable:
        """Compute and store the exact sum with these weights."""
        self.resting = weights, summed(weights, rows, self.coefficients, cancel)
        return self

    def answer(self, weights: FloatArray, rows: Any) -> Answer:
        """Return the exact sum with these weights if it is stored, else the approximate one."""
        known = self.resting  # another thread may replace it
        if known is not None and np.array_equal(known[0], weights):
            return Answer(known[1])
        return Answer(self.at(weights, rows), draft=True)

    def at(self, weights: FloatArray, rows: Any) -> ColumnArray:
        """Approximate ``Σ_k weights[k] rows[k]²`` or ``Σ_k weights[k] c_k rows[k]``, (n,)."""
        heights, apart = self._split(weights)
        # read one column even for the zero filter, so that NaN stays NaN
        used = np.flatnonzero(heights) if heights.any() else np.zeros(1, dtype=np.int64)
        # contiguous columns are read without a copy
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
        """The filters of the columns, shape (s + m, k)."""
        return np.concatenate([self.smooth, np.cumsum(self.hats[::-1], axis=0)[::-1]])

    def _split(self, weights: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
        """Return the factor of each column, and the pairs that are added one by one."""
        whole = np.abs(weights).sum()
        heights = np.zeros(len(self.basis))
        smooth = self.smooth @ weights
        if np.abs(weights - smooth @ self.smooth).sum() <= _LEFT * whole:
            heights[: len(smooth)] = smooth
            return heights, np.zeros(0, dtype=np.int64)
        alone = np.flatnonzero(np.abs(weights) > _SEEN * whole)
        if len(alone) <= _MOST_PAIRS:
            return heights, alone
        line, apart, left = self._fit_line(weights, _SEEN * whole)
        if left > _LEFT * whole and len(alone) <= _MOST_ALONE:
            return heights, alone
        rises = np.diff(line, prepend=0.0)
        shares = np.abs(rises) * self.basis[len(smooth) :].sum(axis=1)
        heights[len(smooth) :] = np.where(shares > _NOTHING * whole, rises, 0.0)
        return heights, apart

    def _fit_line(
        self, weights: FloatArray, seen: float
    ) -> tuple[FloatArray, npt.NDArray[np.int64], float]:
        """Return values at the nodes, pairs with the largest remainder, and that of the others."""
        line = weights[self.bends]
        left = weights - line @ self.hats
        apart = np.sort(np.argsort(np.abs(left))[-_MOST_PAIRS:])
        apart = apart[np.abs(left[apart]) > seen]
        others = np.delete(np.arange(len(weights)), apart)
        if np.abs(left[others]).sum() > seen:
            # least squares over the other pairs instead of interpolation, for the nodes near those
            # with a remainder
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
    """Compute the sum that `PairTable.at` approximates, over all pairs."""
    if coefficients is None:
        return np.asarray(sum_squares(rows, weights[None], cancel=cancel)[0])
    last = int(np.max(np.flatnonzero(weights), initial=-1)) + 1
    return partial_sum(rows, weights * coefficients, 0, last).astype(np.float32)


def build_pair_table(
    spectrum: Eigenpairs,
    cancel: CancelCallback | None = None,
    coefficients: FloatArray | None = None,
) -> PairTable:
    """Compute the columns for a spectrum, or for a map with these coefficients on it."""
    values, count = spectrum.eigenvalues, len(spectrum)
    # nodes are closer at the low end, where filters depend on the logarithm of λ
    places = np.arange(count)
    density = 0.6 * np.log1p(places) / np.log1p(count) + places / count
    wanted = np.linspace(0.0, density[-1], _BENDS)
    bends = np.unique(np.searchsorted(density, wanted * (1.0 - 1e-12)))
    # one node for equal eigenvalues
    bends = bends[np.unique(values[bends], return_index=True)[1]]
    hats = np.stack([np.interp(values, values[bends], unit) for unit in np.eye(len(bends))])
    found = PairTable(_smooth_filters(spectrum), hats, bends, np.zeros((0, 0), np.float32))
    if coefficients is None:
        columns = sum_squares(spectrum.rows, found.basis, cancel=cancel)
    else:
        columns = partial_sum(spectrum.rows, found.basis * coefficients, 0, count)
    return replace(found, columns=np.asarray(columns, np.float32), coefficients=coefficients)


def _smooth_filters(spectrum: Eigenpairs) -> FloatArray:
    """Return orthonormal functions that span heat kernels of all times, (at most 12, k)."""
    values = np.maximum(spectrum.eigenvalues, 0.0)  # negative rounding errors would grow
    lowest, highest = values[min(first_nonzero(spectrum), len(values) - 1)], values[-1]
    times = 1.0 / np.geomspace(max(lowest / 12.0, 1e-300), max(3.0 * highest, 1e-300), 80)
    kernels = np.exp(-np.outer(np.append(times, 0.0), values))
    kernels /= np.linalg.norm(kernels, axis=1, keepdims=True)
    kernels[-1] *= 3.0  # higher weight of the constant, for accuracy
    return np.asarray(np.linalg.svd(kernels, full_matrices=False)[2][:_SMOOTH])
