"""Distance in feature space from any vertex, from a few principal directions of the features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.squares import sum_squares
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

__all__ = ["SimilarityTable", "build_similarity_table"]

ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Share of the variance that may be left out: an error of 2e-3 is half a step of colour.
_VARIANCE = 4e-6
#: Coordinates are kept in steps of this share of a typical distance. With r of them a distance is
#: off by ``sqrt(r)`` steps at most, 8e-4 of a typical one for r = 12: less than what is left out.
_STEP = 2.0**-12
#: Steps that a coordinate of 16 bits can be from the middle: eight typical distances.
_REACH = 32767.0
#: How many spreads from the median a vertex may be before its length stops to count.
_FAR = 3.0
#: Vertices at a time.
_BLOCK = 1 << 16


@dataclass(frozen=True, eq=False)
class SimilarityTable:
    """Features in which the plain distance is the one of `shape.feature_distance`.

    A distance from any vertex reads all coordinates, and takes as long as that: so they are kept
    in 16 bits, but for those of the few vertices that are too far out.

    Parameters
    ----------
    spectrum : Spectrum
    coordinates : ndarray of int16, shape (r, n)
        Principal coordinates in multiples of `step`.
    step : float
    far : ndarray of int64, shape (f,)
        Vertices whose coordinates do not fit into 16 bits, or are NaN; ascending.
    far_coordinates : ndarray of float32, shape (r, f)
        Theirs, in multiples of `step`.
    error : float
        Root of the share of the variance that was left out: the error of a typical distance,
        relative to a typical distance.
    """

    spectrum: Spectrum
    coordinates: npt.NDArray[np.int16]
    step: float
    far: npt.NDArray[np.int64]
    far_coordinates: ColumnArray
    error: float

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.coordinates.nbytes + self.far.nbytes + self.far_coordinates.nbytes

    @property
    def rounding(self) -> float:
        """Bound of what steps add to the error of a distance: half a step at each of two ends."""
        return float(np.sqrt(len(self.coordinates))) * self.step

    def from_vertex(self, vertex: int) -> ColumnArray:
        """Distance of every vertex from one, shape (n,), a pure number."""
        from meshmash_viewer.fields.kernels import distances  # brings numba along

        here = self._steps(vertex)
        result = np.empty(self.coordinates.shape[1], dtype=np.float32)
        step = np.float32(self.step)
        distances(self.coordinates, here, step, result)
        beyond = np.linalg.norm(self.far_coordinates - here[:, None], axis=0)
        result[self.far] = step * beyond
        return result

    def _steps(self, vertex: int) -> ColumnArray:
        """Coordinates of a vertex in multiples of `step`, shape (r,)."""
        place = int(np.searchsorted(self.far, vertex))
        if place < len(self.far) and self.far[place] == vertex:
            return np.ascontiguousarray(self.far_coordinates[:, place])
        return self.coordinates[:, vertex].astype(np.float32)


def build_similarity_table(
    spectrum: Spectrum,
    response: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]],
    cancel: CancelCallback | None = None,
) -> SimilarityTable:
    """Compute features, standardise them, and turn them to their principal directions.

    Parameters
    ----------
    spectrum : Spectrum
    response : callable
        Of a filter bank, ``(k,) -> (f, k)``.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.
    """
    coefficients = response(spectrum.eigenvalues)
    features = sum_squares(spectrum.rows, coefficients, np.float64, cancel)
    used = np.isfinite(features[0])
    from meshmash_viewer.features.shape import column_spread

    features -= np.median(features[:, used], axis=1, keepdims=True)
    spread = column_spread(np.asarray(features[:, used].T, dtype=np.float64))
    standard = np.asarray(features / spread[:, None], dtype=np.float32)
    del features
    gram = np.zeros((len(standard), len(standard)))
    far = _FAR * np.sqrt(len(standard))
    for start in range(0, standard.shape[1], _BLOCK):
        part = standard[:, start : start + _BLOCK]
        part = part[:, np.isfinite(part[0])].astype(np.float64)
        # A neuron's specks lie thousands of times farther out than the rest: taken as they are
        # they alone would decide which directions are kept, so each counts as its direction.
        part /= np.maximum(np.linalg.norm(part, axis=0) / far, 1.0)
        gram += part @ part.T
    variances, directions = np.linalg.eigh(gram)
    variances, directions = np.maximum(variances[::-1], 0.0), directions[:, ::-1]
    total = max(float(variances.sum()), 1e-300)
    left_out = 1.0 - np.cumsum(variances) / total
    n_kept = min(int(np.count_nonzero(left_out > _VARIANCE)) + 1, len(variances))
    error = float(np.sqrt(max(left_out[n_kept - 1], 0.0)))
    # The mean square of the distance between two vertices is twice their variance.
    typical = float(np.sqrt(2.0 * variances.sum() / max(int(used.sum()), 1)))
    step = _STEP * typical or 1.0
    turn = np.asarray(directions[:, :n_kept].T / step, dtype=np.float32)
    coordinates, far, far_coordinates = _in_steps(turn, standard)
    return SimilarityTable(spectrum, coordinates, step, far, far_coordinates, error)


def _in_steps(
    turn: ColumnArray, standard: ColumnArray
) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.int64], ColumnArray]:
    """``turn @ standard`` in whole numbers; the vertices that are too far out, and theirs."""
    n = standard.shape[1]
    coordinates = np.empty((len(turn), n), dtype=np.int16)
    far, far_coordinates = [np.empty(0, np.int64)], [np.empty((len(turn), 0), np.float32)]
    for start in range(0, n, _BLOCK):
        part = turn @ standard[:, start : start + _BLOCK]
        fits = np.abs(part).max(axis=0) <= _REACH
        outside = np.flatnonzero(~fits)
        far.append(outside + start)
        far_coordinates.append(part[:, outside])
        part[:, outside] = 0.0
        coordinates[:, start : start + _BLOCK] = np.rint(part)
    return coordinates, np.concatenate(far), np.concatenate(far_coordinates, axis=1)
