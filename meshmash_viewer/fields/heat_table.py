"""The heat kernel signature at any time of a range, from a few stored columns.

As a function of log t the signature of a vertex is smooth, so its values at nodes that are evenly
spaced in log t tell those in between. Polynomials would do poorly where ``exp(-λ t)`` falls
steeply; instead the four nodes around a time are combined with the weights that fit
``exp(-λ_k t)`` best, in least squares over the spectrum itself. Weights and error depend on the
eigenvalues alone, so the error is known before anything is drawn.

What a time costs is the reading of four columns, so these are kept in 16 bits, but for those of
the few vertices that are too far out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.squares import add_squares, sum_squares
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

__all__ = ["HeatTable", "build_heat_table"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Nodes that one time is combined from.
_STENCIL = 4
#: Distances of nodes in log t that are tried, and the error that decides.
_STEPS = (0.35, 0.3, 0.25, 0.2, 0.17, 0.14)
_TOLERANCE = 7e-5
#: The range of a column is that of almost all vertices, but no more than this many times that of
#: most of them: a scan has specks with thousands of times the signature of the rest.
_ALMOST_ALL, _MOST, _LONGEST = 0.999, 0.75, 4.0
#: Of this range, what there is room for below and above it.
_BELOW, _ABOVE = 0.25, 0.5
#: Steps of a column. Weights times the size of their columns add up to less than twice the size
#: of the signature in between, so rounding adds less than 3e-5 of the range to the error.
_REACH = 65535.0
#: How often columns may be rounded before they are computed anew.
_ROUNDED = 2
#: Vertices at a time, and how many tell the range.
_BLOCK, _SAMPLE = 1 << 16, 100_000
#: Pairs whose share of a column is below this add nothing to it.
_NEGLIGIBLE = 1e-9
#: Eigenvalues below this share of the largest are zero but for rounding.
_ZERO_SHARE = 1e-10
#: Stands for zero where something is divided by it: times can be so long that all else has died.
_SMALLEST = 1e-300


@dataclass(frozen=True, eq=False)
class HeatTable:
    """Stored columns of the signature, and how to combine them.

    Parameters
    ----------
    spectrum : Spectrum
        Whose signature this is.
    end : float
        log t of the last node.
    step : float
        Distance of neighbouring nodes in log t; nodes run from short to long times.
    columns : ndarray of uint16, shape (m, n)
        The signature at the nodes, without the null space, as ``low + width * columns``.
    low, width : ndarray of float64, shape (m,)
    far : ndarray of int64, shape (f,)
        Vertices that are beyond the reach of 16 bits, or NaN; ascending.
    far_columns : ndarray of float32, shape (m, f)
        The signature of theirs.
    base : ndarray of float32, shape (n,) or (1,)
        The null space's part, which is the same at all times; on a connected mesh also at all
        vertices.
    rounded : int
        How often columns were rounded, each time after the spectrum had grown.
    """

    spectrum: Spectrum
    end: float
    step: float
    columns: npt.NDArray[np.uint16]
    low: FloatArray
    width: FloatArray
    far: npt.NDArray[np.int64]
    far_columns: ColumnArray
    base: ColumnArray
    rounded: int = 1

    @property
    def n_nodes(self) -> int:
        """Number of nodes m."""
        return len(self.columns)

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.columns.nbytes + self.far_columns.nbytes + self.far.nbytes + self.base.nbytes

    @cached_property
    def _rates(self) -> FloatArray:
        """Nonzero eigenvalues, shape (k,)."""
        return _nonzero(self.spectrum.eigenvalues)

    @cached_property
    def _fits(self) -> list[FloatArray]:
        """Of all stencils, by their first node; empty where there is nothing to fit."""
        if not len(self._rates):
            return []
        first = self.end - self.step * (self.n_nodes - 1)
        starts = range(self.n_nodes - _STENCIL + 1)
        return [_fit(self._rates, first + self.step * start, self.step) for start in starts]

    def covers(self, time: float, last: float | None = None) -> bool:
        """Whether there are nodes on both sides of a time, or of a range of times."""
        if not time > 0.0:
            return False
        first = self.end - (self.n_nodes - 1) * self.step
        return first <= math.log(time) and math.log(last or time) <= self.end

    def at(self, time: float) -> ColumnArray:
        """The signature at one time, shape (n,), in inverse squared length units.

        Parameters
        ----------
        time : float
            One that the table `covers`.
        """
        start = _first_node(self.end, self.step, self.n_nodes, time)
        weights = np.zeros(_STENCIL)
        if self._fits:
            weights = self._fits[start] @ np.exp(-self._rates * time)
        from meshmash_viewer.fields.kernels import combine  # brings numba along

        values = np.empty(self.columns.shape[1], dtype=np.float32)
        nodes = slice(start, start + _STENCIL)
        stencil = self.columns[nodes]
        steps = np.asarray(weights * self.width[nodes], dtype=np.float32)
        low = float(weights @ self.low[nodes])
        combine(stencil, steps, self.base, low, values)
        null_space = self.base if len(self.base) == 1 else self.base[self.far]
        values[self.far] = weights @ self.far_columns[nodes] + null_space
        return values

    def unpacked(self, nodes: slice) -> ColumnArray:
        """The signature at some nodes, shape (nodes, n)."""
        columns = self.columns[nodes].astype(np.float32)
        columns *= self.width[nodes, None].astype(np.float32)
        columns += self.low[nodes, None].astype(np.float32)
        columns[:, self.far] = self.far_columns[nodes]
        return columns

    def error(self, time: float) -> float:
        """Bound of the mean error at a time, relative to the mean of what varies there.

        The mean over the surface of ``|Σ_k δ_k φ_k²|``, δ_k being the misfit of
        ``exp(-λ_k t)``, is at most ``Σ_k |δ_k| / area``; the mean of the signature less its null
        space is ``Σ_k exp(-λ_k t) / area``.
        """
        return _error(self._rates, self.end, self.step, self.n_nodes, time)


def build_heat_table(
    spectrum: Spectrum,
    times: tuple[float, float],
    known: HeatTable | None = None,
    cancel: CancelCallback | None = None,
) -> HeatTable:
    """Compute a table for a range of times.

    Parameters
    ----------
    spectrum : Spectrum
    times : tuple of float
        Shortest and longest time, in squared length units.
    known : HeatTable, optional
        Of the same spectrum before it grew; what it holds is not computed again.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.
    """
    rates = _nonzero(spectrum.eigenvalues)
    first, last = math.log(times[0]), math.log(times[1])
    n_pairs = len(spectrum)
    n_zero = n_pairs - len(rates)
    base = sum_squares(spectrum.rows, _only(n_pairs, slice(0, n_zero)), cancel=cancel)[0]
    if base.min() == base.max():
        base = base[:1].copy()
    end, step, n_nodes = _grid(rates, first, last, known)
    decay = np.zeros((n_nodes, n_pairs))
    nodes = np.exp(end - step * np.arange(n_nodes)[::-1])
    decay[:, n_zero:] = np.exp(-np.outer(nodes, rates))
    columns = np.zeros((n_nodes, spectrum.rows.shape[1]), dtype=np.float32)
    n_known = rounded = 0
    if known is not None and (known.end, known.step) == (end, step) and known.rounded < _ROUNDED:
        n_known, rounded = min(n_nodes, known.n_nodes), known.rounded
        columns[-n_known:] = known.unpacked(slice(-n_known, None))
        old = len(known.spectrum)
        decay[-n_known:, :old] = 0.0
    decay[decay < _NEGLIGIBLE * decay.max(axis=1, keepdims=True)] = 0.0
    fresh = n_nodes - n_known
    if fresh:
        add_squares(columns[:fresh], spectrum.rows, decay[:fresh], cancel=cancel)
    if n_known and decay[fresh:].any():
        add_squares(columns[fresh:], spectrum.rows, decay[fresh:], cancel=cancel)
    table = HeatTable(spectrum, end, step, *_packed(columns), base, rounded + 1)
    _ = table._fits  # now, and not when somebody waits for a time
    return table


def _packed(
    columns: ColumnArray,
) -> tuple[npt.NDArray[np.uint16], FloatArray, FloatArray, npt.NDArray[np.int64], ColumnArray]:
    """Columns in steps, their ends and steps, the vertices too far out, and theirs."""
    n = columns.shape[1]
    finite = np.flatnonzero(np.isfinite(columns[0]))
    sample = columns[:, finite[:: max(len(finite) // _SAMPLE, 1)]]
    if not sample.shape[1]:
        sample = np.zeros((len(columns), 1), dtype=np.float32)
    least = sample.min(axis=1).astype(np.float64)
    almost_all, most = np.quantile(sample, [_ALMOST_ALL, _MOST], axis=1) - least
    reach = np.minimum(almost_all, _LONGEST * most)
    low = least - _BELOW * reach
    width = (_BELOW + 1.0 + _ABOVE) * reach / _REACH
    # all but died away: what single precision has no step for is its lower end everywhere
    width[width < np.finfo(np.float32).tiny] = 1.0
    packed = np.empty(columns.shape, dtype=np.uint16)
    far, far_columns = [np.empty(0, np.int64)], [columns[:, :0]]
    for start in range(0, n, _BLOCK):
        part = columns[:, start : start + _BLOCK]
        steps = (part - low[:, None].astype(np.float32)) / width[:, None].astype(np.float32)
        fits = (steps.min(axis=0) >= 0.0) & (steps.max(axis=0) <= _REACH)
        outside = np.flatnonzero(~fits)  # NaN too
        far.append(outside + start)
        far_columns.append(part[:, outside])
        steps[:, outside] = 0.0
        packed[:, start : start + _BLOCK] = np.rint(steps)
    return packed, low, width, np.concatenate(far), np.concatenate(far_columns, axis=1)


def _grid(
    rates: FloatArray, first: float, last: float, known: HeatTable | None
) -> tuple[float, float, int]:
    """Last node, step and number of nodes for a range of log t; those of `known` if they do."""
    if known is not None:
        n_nodes = _count(first, known.end, known.step)
        enough = known.end >= last and known.end - last < 2.0 * _STENCIL * known.step
        if enough and _worst(rates, first, known.end, known.step, n_nodes) <= 1.2 * _TOLERANCE:
            return known.end, known.step, n_nodes
    for step in _STEPS:
        end = last + (_STENCIL // 2 - 1) * step
        n_nodes = _count(first, end, step)
        if _worst(rates, first, end, step, n_nodes) <= _TOLERANCE:
            break
    return end, step, n_nodes


def _count(first: float, end: float, step: float) -> int:
    """Number of nodes that put a time at `first` in the middle of its stencil."""
    return max(math.ceil((end - first) / step) + _STENCIL // 2, _STENCIL)


def _worst(rates: FloatArray, first: float, end: float, step: float, n_nodes: int) -> float:
    """Largest error of a grid, looked for between its nodes."""
    if not len(rates):
        return 0.0
    between = np.arange(first, end - (_STENCIL // 2 - 1) * step, step / 3.0)
    return max((_error(rates, end, step, n_nodes, math.exp(x)) for x in between), default=0.0)


def _first_node(end: float, step: float, n_nodes: int, time: float) -> int:
    """Where the stencil around a time begins."""
    position = n_nodes - 1 - (end - math.log(time)) / step
    return min(max(math.floor(position) - (_STENCIL // 2 - 1), 0), n_nodes - _STENCIL)


def _fit(rates: FloatArray, first: float, step: float) -> FloatArray:
    """Values at the rates to weights of the nodes from log t = first on, shape (4, k)."""
    nodes = np.exp(first + step * np.arange(_STENCIL))
    decay = np.exp(-np.outer(rates, nodes))
    # Columns of equal size, and a floor for singular values above the rounding of float32, so
    # that large weights of opposite sign do not blow that up.
    size = decay.sum(axis=0)
    size[size == 0.0] = 1.0
    left, singular, right = np.linalg.svd(decay / size, full_matrices=False)
    damped = singular / np.maximum(singular**2 + (1e-6 * singular[0]) ** 2, _SMALLEST)
    return np.asarray((right.T * damped) @ left.T / size[:, None])


def _error(rates: FloatArray, end: float, step: float, n_nodes: int, time: float) -> float:
    if not len(rates):
        return 0.0
    first = end - step * (n_nodes - 1 - _first_node(end, step, n_nodes, time))
    nodes = np.exp(first + step * np.arange(_STENCIL))
    wanted = np.exp(-rates * time)
    misfit = np.exp(-np.outer(rates, nodes)) @ (_fit(rates, first, step) @ wanted) - wanted
    return float(np.abs(misfit).sum() / max(wanted.sum(), _SMALLEST))


def _nonzero(eigenvalues: FloatArray) -> FloatArray:
    if not len(eigenvalues):
        return eigenvalues
    return eigenvalues[eigenvalues > _ZERO_SHARE * abs(float(eigenvalues[-1]))]


def _only(n_pairs: int, which: slice) -> FloatArray:
    coefficients = np.zeros((1, n_pairs))
    coefficients[0, which] = 1.0
    return coefficients
