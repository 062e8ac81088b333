"""Distance in feature space from any vertex, from a few principal directions of the features."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.model.squares import sum_squares
from meshmash_viewer.progress import CancelCallback

__all__ = ["SimilarityTable", "build_similarity_table"]

ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Share of the variance that may be left out: an error of 2e-3 is half a step of colour.
_VARIANCE = 4e-6
#: How many spreads from the median a vertex may be before its length stops to count.
_FAR = 3.0


@dataclass(frozen=True, eq=False)
class SimilarityTable:
    """Features in which the plain distance is the one of `shape.feature_distance`.

    Parameters
    ----------
    spectrum : Spectrum
    coordinates : ndarray of float32, shape (r, n)
        Principal coordinates, centred.
    squares : ndarray of float32, shape (n,)
        Squared length of each vertex's coordinates.
    error : float
        Root of the share of the variance that was left out: the error of a typical distance,
        relative to a typical distance.
    """

    spectrum: Spectrum
    coordinates: ColumnArray
    squares: ColumnArray
    error: float

    @property
    def nbytes(self) -> int:
        """Bytes that it holds."""
        return self.coordinates.nbytes + self.squares.nbytes

    def from_vertex(self, vertex: int) -> ColumnArray:
        """Distance of every vertex from one, shape (n,), a pure number."""
        # |x - p|² = |x|² + |p|² - 2 x·p reads each coordinate once
        here = self.coordinates[:, vertex]
        distance = (-2.0 * here) @ self.coordinates
        distance += self.squares
        distance += self.squares[vertex]
        np.maximum(distance, 0.0, out=distance)
        np.sqrt(distance, out=distance)
        if np.isfinite(distance[vertex]):
            distance[vertex] = 0.0
        return np.asarray(distance)


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
    from meshmash_viewer.shape import column_spread

    features -= np.median(features[:, used], axis=1, keepdims=True)
    spread = column_spread(np.asarray(features[:, used].T, dtype=np.float64))
    standard = np.asarray(features / spread[:, None], dtype=np.float32)
    del features
    gram = np.zeros((len(standard), len(standard)))
    far = _FAR * np.sqrt(len(standard))
    for start in range(0, standard.shape[1], 1 << 16):
        part = standard[:, start : start + (1 << 16)]
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
    coordinates = directions[:, :n_kept].T.astype(np.float32) @ standard
    squares = np.einsum("rn,rn->n", coordinates, coordinates)
    error = float(np.sqrt(max(left_out[n_kept - 1], 0.0)))
    return SimilarityTable(spectrum, coordinates, squares, error)
