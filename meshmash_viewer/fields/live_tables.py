"""Tables for fast computation of fields while a control moves.

`PairTable` approximates the field of any filter from a few stored columns and a few pairs. Smooth
filters are approximated by a few functions that span all heat kernels, other filters by a piecewise
linear function of λ with nodes at chosen eigenvalues. The columns of this function are sums from
each node on, so that columns of constant pieces are not read. The few pairs with the largest
remainder, such as the pairs next to a sharp edge, are added one by one.

`HeatTable` interpolates the heat kernel signature in time. The signature of a vertex is a smooth
function of log t, so it is interpolated between nodes evenly spaced in log t. Polynomials would be
inaccurate where ``exp(-λ t)`` decreases steeply; instead the six nodes around a time are combined
with the weights of a least-squares fit of ``exp(-λ_k t)`` over the spectrum. The error is at most
1e-4 of the sum of ``exp(-λ_k t)``.

Spectra, means and sums of maps are cached, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.map_spectrum import MapSpectrum, band_edges, partial_sum
from meshmash_viewer.features.sums import fill_in_parts, sum_squares
from meshmash_viewer.fields.family import Answer, ColumnArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero
from meshmash_viewer.spectral.weyl import wavelength
from meshmash_viewer.units import format_quantity
from meshmash_viewer.vertex_map import Label, VertexMap

#: Number of smooth functions, and of nodes of the piecewise linear function.
_SMOOTH, _BENDS = 12, 40
#: Maximum number of stored columns.
MOST_COLUMNS = _SMOOTH + _BENDS
#: Maximum number of pairs read with columns, and without columns. Reading a pair, in double
#: precision, takes as long as four columns; a field of a million vertices takes less than a frame.
_MOST_PAIRS, _MOST_ALONE = 2, 10
#: Number of vertices up to which one thread is faster than two.
_FEW = 1 << 18
#: Shares of the sum of absolute weights: smallest visible pair or remainder, largest accepted
#: remainder, and smallest column that is read.
_SEEN, _LEFT, _NOTHING = 5e-4, 2e-3, 5e-5


@dataclass(eq=False)
class PairTable:
    """Stored columns, and the filter of each."""

    #: Shape (s, k): Smooth filters at the eigenvalues, orthonormal.
    smooth: FloatArray
    #: Shape (m, k): For each node the function that is 1 there, 0 at the other nodes, and linear
    #: between.
    hats: FloatArray
    #: Shape (m,): Indices of the pairs whose eigenvalues are the nodes.
    bends: npt.NDArray[np.int64]
    #: Shape (s + m, n): ``Σ_k b_k φ_k²``, or with coefficients ``Σ_k b_k c_k φ_k``, where b is a
    #: row of `basis`: a smooth filter, or the sum of the hats from one node on.
    columns: ColumnArray
    #: Shape (k,): Coefficients c of a filtered map; None for φ².
    coefficients: FloatArray | None = None
    #: Shapes (k,) and (n,): Weights of the last exact sum over all pairs, and the sum.
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
        """Return values at the nodes, pairs with large remainders, and the remaining error."""
        line = weights[self.bends]
        left = weights - line @ self.hats
        apart = np.sort(np.argsort(np.abs(left))[-_MOST_PAIRS:])
        apart = apart[np.abs(left[apart]) > seen]
        others = np.delete(np.arange(len(weights)), apart)
        if np.abs(left[others]).sum() > seen:
            # least squares instead of interpolation, at nodes near other pairs with a remainder
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
    """Compute the exact sum over all pairs, which `PairTable.at` approximates."""
    if coefficients is None:
        return np.asarray(sum_squares(rows, weights[None], cancel=cancel)[0])
    last = int(np.max(np.flatnonzero(weights), initial=-1)) + 1
    return partial_sum(rows, weights * coefficients, 0, last).astype(np.float32)


def build_pair_table(
    spectrum: Eigenpairs,
    cancel: CancelCallback | None = None,
    coefficients: FloatArray | None = None,
) -> PairTable:
    """Compute the table of a spectrum, or of a map with coefficients of shape (k,)."""
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
    values = np.maximum(spectrum.eigenvalues, 0.0)  # exp would amplify negative rounding errors
    lowest, highest = values[min(first_nonzero(spectrum), len(values) - 1)], values[-1]
    times = 1.0 / np.geomspace(max(lowest / 12.0, 1e-300), max(3.0 * highest, 1e-300), 80)
    kernels = np.exp(-np.outer(np.append(times, 0.0), values))
    kernels /= np.linalg.norm(kernels, axis=1, keepdims=True)
    kernels[-1] *= 3.0  # higher weight of the constant, for accuracy
    return np.asarray(np.linalg.svd(kernels, full_matrices=False)[2][:_SMOOTH])


#: Number of nodes combined for one time, and their distance in log t.
_STENCIL, _STEP = 6, 0.27
#: Singular values of a fit below this share of the largest one are neglected.
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
    #: Shape (6, k) for each group of six nodes: Matrix from decays of the pairs to weights.
    fits: list[FloatArray]
    #: Shape (n,): Contribution of the null space, constant in time and possibly much larger than
    #: the rest.
    base: ColumnArray

    def covers(self, time: float, last: float | None = None) -> bool:
        """Whether a time, or the range from `time` to `last`, is within the table."""
        rounding = 1.0 + 1e-9
        return self.times[0] <= time * rounding and (last or time) <= self.times[1] * rounding

    def at(self, time: float) -> ColumnArray:
        """Interpolate the signature at a time within the table, shape (n,), in 1 / area."""
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
    # The same number of nodes below and above a time.
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
    """Compute ``exp(-λ_k t)`` divided by its sum over k, without underflow, (times, k)."""
    decay = np.exp(-np.outer(times, rates - rates[:1]))
    return np.asarray(decay / np.maximum(decay.sum(axis=1, keepdims=True), 1e-300))


#: Key of the means of maps in `Mesh.derived`.
MEANS = "means of maps"
#: Key of the spectra of maps, with eigenpairs, in `Mesh.derived`.
_PROJECTED = "spectra of maps"


def projected(
    spectrum: Eigenpairs,
) -> WeakKeyDictionary[VertexMap, tuple[Eigenpairs, MapSpectrum]]:
    """Return spectra by map; the computing thread writes, the main thread reads."""
    return WeakKeyDictionary() if spectrum.mesh is None else kept_by_map(spectrum.mesh, _PROJECTED)


def kept_by_map(mesh: Mesh, name: str) -> WeakKeyDictionary[VertexMap, Any]:
    """Return a cache with maps as keys.

    It is stored in `Mesh.derived`: its values refer to eigenpairs, eigenpairs to the mesh, and the
    mesh to the maps, so entries of a cache that outlives the mesh would never be freed.
    """
    known: WeakKeyDictionary[VertexMap, Any] = mesh.derived.setdefault(name, WeakKeyDictionary())
    return known


def mean_over(mesh: Mesh, values: FloatArray) -> float:
    """Compute the area-weighted mean of finite values; NaN without any."""
    weights = mesh.vertex_areas * np.isfinite(values)
    total = weights.sum()
    return float(weights @ np.nan_to_num(values) / total) if total > 0.0 else np.nan


class MapSums:
    """Spectrum of a map, and its sums over the lowest pairs, updated incrementally."""

    def __init__(self, spectrum: MapSpectrum, bands: ColumnArray | None) -> None:
        self.spectrum = spectrum
        self.bands = bands
        self._last: tuple[int, FloatArray | None] = 0, None
        #: Table of approximate filtered sums; None until a sum is requested.
        self.near: PairTable | None = None

    def up_to(self, count: int, rows: Any) -> ColumnArray:
        """Compute the sum over the lowest `count` pairs from the previous sum."""
        known, total = self._last
        if total is None or abs(count - known) > count:
            known, total = 0, np.zeros(rows.shape[1])
        first, last = sorted((count, known))
        change = self.spectrum.coefficients[first:last] * (1.0 if count >= known else -1.0)
        shown = np.empty(len(total), dtype=np.float32)

        def fill(part: slice) -> None:
            total[part] += change @ rows[first:last, part]
            shown[part] = total[part]

        fill_in_parts(len(total), fill)
        self._last = count, total
        return shown


def band_labels(eigenvalues: FloatArray, unit: str) -> tuple[Label, ...]:
    """Return a label for each band, with wavelengths, from yellow (long) to violet."""
    from matplotlib import colormaps

    edges = [wavelength(float(edge)) for edge in band_edges(eigenvalues)]
    shades = colormaps["viridis_r"](np.linspace(0.0, 1.0, max(len(edges) - 1, 1)), bytes=True)
    return tuple(
        Label(
            at,
            f"{format_quantity(edges[at], unit)} to {format_quantity(edges[at + 1], unit)}",
            "#" + "".join(f"{part:02x}" for part in shades[at][:3].tolist()),
        )
        for at in range(len(edges) - 1)
    )
