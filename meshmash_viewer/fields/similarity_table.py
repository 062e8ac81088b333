"""Distance in feature space from any vertex, from a few principal directions of the features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.features.shape import column_spread
from meshmash_viewer.features.squares import sum_squares
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.progress import CancelCallback

__all__ = ["SimilarityTable", "build_similarity_table"]

ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Share of the variance that may be left out: an error of 2e-3 is half a step of colour.
_VARIANCE = 4e-6
#: How many spreads from the median a vertex may be before its length stops to count.
_FAR = 3.0
#: Vertices at a time, whose differences stay in the processor's cache.
_BLOCK = 1 << 14


@dataclass(frozen=True, eq=False)
class SimilarityTable:
    """Features in which the plain distance is the one of `shape.feature_distance`.

    Parameters
    ----------
    coordinates : ndarray of float32, shape (r, n)
        Along the principal directions.
    error : float
        Root of the share of the variance that was left out: the error of a typical distance,
        relative to a typical distance.
    """

    coordinates: ColumnArray
    error: float

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.coordinates.nbytes

    def from_vertex(self, vertex: int) -> ColumnArray:
        """Distance of every vertex from one, shape (n,), a pure number."""
        here = self.coordinates[:, vertex, None]
        squares = np.empty(self.coordinates.shape[1], dtype=np.float32)
        for start in range(0, len(squares), _BLOCK):
            part = slice(start, start + _BLOCK)
            way = self.coordinates[:, part] - here
            np.einsum("rn,rn->n", way, way, out=squares[part])
        return np.sqrt(squares, out=squares)


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
    sums = sum_squares(spectrum.rows, response(spectrum.eigenvalues), np.float64, cancel)
    features = np.asarray(sums, dtype=np.float64)
    used = np.isfinite(features[0])
    features -= np.median(features[:, used], axis=1, keepdims=True)
    features /= column_spread(features[:, used].T)[:, None]
    standard = features[:, used]
    # A neuron's specks lie thousands of times farther out than the rest: taken as they are they
    # alone would decide which directions are kept, so each counts as its direction.
    far = _FAR * np.sqrt(len(standard))
    standard /= np.maximum(np.linalg.norm(standard, axis=0) / far, 1.0)
    variances, directions = np.linalg.eigh(standard @ standard.T)
    variances, directions = np.maximum(variances[::-1], 0.0), directions[:, ::-1]
    left_out = 1.0 - np.cumsum(variances) / max(float(variances.sum()), 1e-300)
    n_kept = min(int(np.count_nonzero(left_out > _VARIANCE)) + 1, len(variances))
    coordinates = np.asarray(directions[:, :n_kept].T @ features, dtype=np.float32)
    return SimilarityTable(coordinates, float(np.sqrt(max(left_out[n_kept - 1], 0.0))))
