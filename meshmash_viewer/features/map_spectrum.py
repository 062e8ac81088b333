"""Spectrum of a map: coefficients on the eigenfunctions, their energy, and bands."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.features.filter_responses import count_zeros
from meshmash_viewer.features.maps import as_map_values, filled, without_gaps
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike, as_eigenpairs

#: Pairs and vertices processed at a time, so that few rows of a memory map are in memory.
_ROWS, _VERTICES = 64, 1 << 15


@dataclass(frozen=True, eq=False)
class MapSpectrum:
    """Expansion of a map in the eigenfunctions of its surface.

    With all eigenfunctions of a mesh, the squares of the coefficients sum to `energy` (Parseval).
    With fewer eigenfunctions, the difference is the energy of the remainder.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        Ascending, in inverse squared units of length.
    coefficients : ndarray of float64, shape (k,)
        ``c = Φᵀ M f``, in the unit of the map times the unit of length.
    energy : float
        ``fᵀ M f``, the integral of the map's square over the surface.
    mesh_errors : ndarray of float64, shape (k,), optional
        The `Eigenpairs.mesh_errors`; empty if not estimated.

    Examples
    --------
    >>> height = mv.map_spectrum(pairs, ball.vertices[:, 2])
    >>> f"{height.share(4):.3f}"
    '1.000'
    """

    eigenvalues: FloatArray
    coefficients: FloatArray
    energy: float
    mesh_errors: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.coefficients)

    @cached_property
    def _sums(self) -> FloatArray:
        return np.append(0.0, np.cumsum(np.square(self.coefficients)))

    @cached_property
    def n_zeros(self) -> int:
        """Number of eigenvalues that are zero within rounding, one for each component."""
        return count_zeros(self.eigenvalues)

    def share(self, k: int) -> float:
        """Return the share of the energy in the lowest k pairs, from 0 to 1."""
        return self._ratio(float(self._sums[k]), self.energy)

    def varying_share(self, k: int) -> float:
        """Return `share` without the means of components, which often contain most energy."""
        constant = float(self._sums[self.n_zeros])
        return self._ratio(
            float(self._sums[max(k, self.n_zeros)]) - constant, self.energy - constant
        )

    def residual(self, k: int) -> float:
        """Return the norm of the map without its lowest k pairs, relative to the norm of the map.

        ``‖f - f_k‖ / ‖f‖`` in the norm of M, ``√(1 - share)``; values below 1e-7 are rounding.
        """
        return float(np.sqrt(max(1.0 - self.share(k), 0.0)))

    def _ratio(self, part: float, whole: float) -> float:
        # relative to the energy, values below rounding are zero
        return min(part / whole, 1.0) if whole > 1e-13 * self.energy else 1.0


def map_spectrum(decomposition: EigenpairsLike, values: npt.ArrayLike) -> MapSpectrum:
    """Project a map on eigenfunctions, and measure its energy.

    `InputError` is raised if there is not one value for each vertex, or no value is finite.

    Parameters
    ----------
    decomposition : Eigenpairs
        Eigenpairs of the mesh of the map, with its mass matrix.
    values : VertexMap or array_like, shape (n,)
        One number for each vertex. NaN and infinite values are replaced by the area-weighted mean
        of the others, as in `filter_map` and `spectral_coefficients`.

    Warns
    -----
    MissingValuesWarning
        If there are vertices without a value.

    Examples
    --------
    >>> from meshmash_viewer.samples import sample_path
    >>> mesh = mv.read_mesh(sample_path("dendrite"))
    >>> pairs = mv.solve(*mv.cotangent_laplacian(mesh, robust=True), n_components=10)
    >>> spectrum = mv.map_spectrum(pairs, pairs.eigenvectors[:, 3])
    >>> f"{spectrum.share(4):.6f} {spectrum.residual(3):.6f}"
    '1.000000 1.000000'
    """
    decomposition = as_eigenpairs("map_spectrum(pairs, values)", decomposition)
    f = as_map_values(values, decomposition.rows.shape[1], columns=False)
    f = without_gaps(f, decomposition.mass)
    found = project(decomposition.eigenvalues, decomposition.rows, decomposition.mass, f)
    return replace(found, mesh_errors=decomposition.mesh_errors)


def project(
    eigenvalues: FloatArray,
    rows: Any,
    mass: FloatArray,
    values: npt.NDArray[Any],
    cancel: CancelCallback | None = None,
) -> MapSpectrum:
    """Compute `map_spectrum` from rows of shape (>= k, n), which may be a memory map."""
    used = mass > 0.0
    f = filled(np.asarray(values, dtype=np.float64), mass)
    weighted = np.where(used, mass, 0.0) * f
    coefficients = inner_products(rows, weighted, used, 0, len(eigenvalues), cancel)
    return MapSpectrum(np.asarray(eigenvalues), coefficients, float(weighted @ f))


def inner_products(
    rows: Any,
    weighted: FloatArray,
    used: npt.NDArray[np.bool_],
    first: int,
    last: int,
    cancel: CancelCallback | None = None,
) -> FloatArray:
    """Compute products of eigenvectors `first` to `last` (exclusive) with weighted values.

    The values, shape (n,) or (m, n), are 0 at vertices that are not `used`.
    """
    products = np.zeros((*weighted.shape[:-1], last - first))
    for some in blocks(last, _ROWS, first):
        for part in blocks(len(used), _VERTICES):
            check_cancelled(cancel)
            block = rows[some, part]
            if not used[part].all():
                block = np.where(used[part], block, 0.0)  # NaN at unreferenced vertices
            products[..., some.start - first : some.stop - first] += weighted[..., part] @ block.T
    return products


def partial_sum(rows: Any, coefficients: FloatArray, first: int, last: int) -> FloatArray:
    """Sum ``c_i φ_i`` over pairs `first` to `last` (exclusive); NaN at unreferenced vertices.

    Coefficients of shape (k,) or (m, k) give a sum of shape (n,) or (m, n).
    """
    total = np.zeros((*coefficients.shape[:-1], rows.shape[1]))
    for part in blocks(rows.shape[1], _VERTICES):
        total[..., part] = coefficients[..., first:last] @ rows[first:last, part]
    return total


def band_edges(eigenvalues: FloatArray) -> FloatArray:
    """Return the edges of b bands, which are octaves of the eigenvalue, shape (b + 1,).

    The first edge is at the first nonzero eigenvalue; if all are zero, the result is empty. From
    one band to the next, the wavelength decreases by √2.
    """
    first = count_zeros(eigenvalues)
    if first == len(eigenvalues):
        return np.zeros(0)
    low, high = float(eigenvalues[first]), float(eigenvalues[-1])
    count = int(np.floor(np.log2(high / low) + 1e-9)) + 1
    # slightly lower, so that an eigenvalue at an edge belongs to the upper band
    return np.asarray(low * 2.0 ** (np.arange(count + 1) - 1e-9), dtype=np.float64)


def dominant_bands(
    spectrum: MapSpectrum, rows: Any, cancel: CancelCallback | None = None
) -> npt.NDArray[np.int64]:
    """Find the band in which a map is strongest at each vertex.

    The part of the map in a band of `band_edges` is the sum over the pairs of the band; the band
    with the largest absolute value at a vertex dominates.

    Parameters
    ----------
    rows : array_like, shape (>= k, n)
        Eigenvectors as rows.
    cancel : callable, optional
        `Cancelled` is raised after it returns True.

    Returns
    -------
    ndarray of int64, shape (n,)
        Index of the band, from 0; -1 at vertices without eigenvectors, and everywhere if all
        eigenvalues are zero.

    Examples
    --------
    >>> height = mv.map_spectrum(pairs, ball.vertices[:, 2])
    >>> len(mv.dominant_bands(height, pairs.rows))
    642
    """
    n, edges = rows.shape[1], band_edges(spectrum.eigenvalues)
    starts = np.searchsorted(spectrum.eigenvalues, edges)
    result = np.full(n, -1, dtype=np.int64)
    if not len(edges):
        return result
    for part in blocks(n, _VERTICES):
        check_cancelled(cancel)
        sums = np.stack(
            [
                spectrum.coefficients[first:last] @ rows[first:last, part]
                for first, last in pairwise(starts)
            ]
        )
        strongest = np.abs(np.nan_to_num(sums)).argmax(axis=0)
        result[part] = np.where(np.isnan(sums).any(axis=0), -1, strongest)
    return result
