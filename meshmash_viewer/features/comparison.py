"""Two shapes side by side: their spectra, which vertex is which, and which eigenfunction is which.

Size does not count: eigenvalues are multiplied by the area of their mesh, and features are those of
the two shapes at an area of 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.features.shape import Matches, match_features
from meshmash_viewer.features.sums import accumulate_features

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigensolver import Decomposition

__all__ = [
    "Comparison",
    "FunctionMatches",
    "compare_shapes",
    "distinct_matches",
    "match_functions",
    "unit_area_spectrum",
]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

#: Square of the correlation from which two eigenfunctions are the same one: no third can have it.
_SAME = 0.5
#: Relative difference of eigenvalues that are the same.
_ROUNDING = 1e-6
#: Energies of the default signature.
_ENERGIES = 100


@dataclass(frozen=True, eq=False)
class FunctionMatches:
    """For each eigenfunction of one shape, the same one of another, where that can be told.

    Parameters
    ----------
    indices : ndarray of int64, shape (k,)
        Index in the other; -1 where it cannot be told, as within multiplets, which any rotation
        leaves as good, and where a symmetry makes vertices of two sides look alike.
    signs : ndarray of float64, shape (k,)
        1 or -1 to multiply the other with; 0 where it cannot be told.
    correlations : ndarray of float64, shape (k,)
        Of the two functions, from 0 to about 1; two that are the same have more than √½.
    """

    indices: IntArray
    signs: FloatArray
    correlations: FloatArray

    @property
    def told(self) -> npt.NDArray[np.bool_]:
        """Which of them can be told, shape (k,)."""
        return np.asarray(self.indices >= 0)


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare_shapes` finds.

    Parameters
    ----------
    spectra : tuple of two ndarrays of float64, shape (k,)
        Eigenvalues times area, as many of both.
    distance : float
        Euclidean distance of the two, "Shape-DNA".
    forth, back : Matches
        From the first to the second, and from the second to the first.
    mutual : ndarray of bool, shape (n,)
        Vertices of the first that the match of their match leads back to.
    functions : FunctionMatches
        Eigenfunctions of the first among those of the second.
    """

    spectra: tuple[FloatArray, FloatArray]
    distance: float
    forth: Matches
    back: Matches
    mutual: npt.NDArray[np.bool_]
    functions: FunctionMatches


def unit_area_spectrum(decomposition: Decomposition) -> FloatArray:
    """Eigenvalues of the shape at an area of 1, pure numbers, shape (k,)."""
    return np.asarray(decomposition.eigenvalues * decomposition.mass.sum())


def compare_shapes(
    first: Decomposition, second: Decomposition, bank: FilterBank | None = None
) -> Comparison:
    """Compare two shapes by their eigenpairs.

    Parameters
    ----------
    first, second : Decomposition
        Both up to about the same eigenvalue times area; what one has more is left out.
    bank : FilterBank, optional
        Filters for eigenvalues times area, in whose columns vertices are matched: by default the
        wave kernel signature of 100 energies of the first.

    Returns
    -------
    Comparison
        The spectral distance is that of Reuter, Wolter and Peinecke (2006). Vertices are matched by
        the nearest features, each column in units of its spread; on a symmetric shape those of
        either side are as near, and only one is found.

    Raises
    ------
    InputError
        If there are too few eigenpairs for the filters.

    Examples
    --------
    >>> import meshmash_viewer as mv
    >>> from meshmash_viewer.samples import sample_path
    >>> mesh = mv.read_mesh(sample_path("dendrite"))
    >>> L, M = mv.cotangent_laplacian(mesh, robust=True)
    >>> pairs = mv.solve(L, M, 20)
    >>> compare_shapes(pairs, pairs).distance
    0.0
    """
    count = min(first.n_components, second.n_components)
    spectra = unit_area_spectrum(first)[:count], unit_area_spectrum(second)[:count]
    if bank is None:
        bank = wave_kernel_bank(spectra[0], _ENERGIES)
    # a last eigenvalue that is larger by rounding alone would be outside of all bands
    top = spectra[0][-1]
    forth_features, back_features = (
        accumulate_features(
            each.rows[:count], bank(np.where(np.isclose(values, top, rtol=_ROUNDING), top, values))
        )
        * each.mass.sum()
        for each, values in zip((first, second), spectra, strict=True)
    )
    forth = match_features(forth_features, back_features, standardize=True)
    back = match_features(back_features, forth_features, standardize=True)
    found = forth.indices >= 0
    mutual = np.zeros(len(found), dtype=np.bool_)
    mutual[found] = back.indices[forth.indices[found]] == np.flatnonzero(found)
    return Comparison(
        spectra,
        float(np.linalg.norm(spectra[0] - spectra[1])),
        forth,
        back,
        mutual,
        match_functions(first, second, forth.indices),
    )


def match_functions(
    first: Decomposition, second: Decomposition, vertices: npt.ArrayLike
) -> FunctionMatches:
    """Tell which eigenfunction of one shape is which of another, and with which sign.

    Parameters
    ----------
    first, second : Decomposition
        With k and l pairs.
    vertices : array_like of int, shape (n,)
        For each vertex of the first the same one of the second, -1 where there is none: all in
        order for two meshes of the same vertices, or what features have matched.

    Returns
    -------
    FunctionMatches
        One to one, of the greatest sum of squared correlations.

    Raises
    ------
    InputError
        If a vertex does not exist.
    """
    from scipy.optimize import linear_sum_assignment

    there = np.asarray(vertices)
    n_first, n_second = len(first.mass), len(second.mass)
    if there.shape != (n_first,) or there.min(initial=0) < -1 or there.max(initial=0) >= n_second:
        raise InputError(
            f"Give for each of {n_first} vertices one of {n_second}, counted from 0, or -1."
        )
    used = (there >= 0) & (first.mass > 0.0)
    used[used] = second.mass[there[used]] > 0.0
    weights = first.mass[used]
    here = first.rows[:, used]
    carried = second.rows[:, there[used]]
    products = (here * weights) @ carried.T
    norms = np.sqrt(np.square(here) @ weights)[:, None] * np.sqrt(np.square(carried) @ weights)
    correlations = np.divide(products, norms, out=np.zeros(products.shape), where=norms > 0.0)
    rows, columns = linear_sum_assignment(-np.square(correlations))
    indices = np.full(len(here), -1, dtype=np.int64)
    signs, best = np.zeros(len(here)), np.zeros(len(here))
    found = correlations[rows, columns]
    best[rows] = np.abs(found)
    same = np.square(found) > _SAME
    indices[rows[same]], signs[rows[same]] = columns[same], np.sign(found[same])
    return FunctionMatches(indices, signs, best)


def distinct_matches(
    distances: FloatArray, places: npt.NDArray[np.floating], radius: float, count: int = 4
) -> IntArray:
    """The best matches of a vertex that are not all neighbours of one another.

    Parameters
    ----------
    distances : ndarray of float64, shape (n,)
        In feature space from the vertex to all of the other shape.
    places : ndarray, shape (n, 3)
        Where those are.
    radius : float
        How far a match has to be from all better ones, in the unit of `places`.
    count : int
        How many to find at most.

    Returns
    -------
    ndarray of int64, shape (<= count,)
        Best first.
    """
    left = np.where(np.isfinite(distances), distances, np.inf)
    found: list[int] = []
    while len(found) < count and np.isfinite(left).any():
        best = int(np.argmin(left))
        found.append(best)
        left[np.linalg.norm(places - places[best], axis=1) <= radius] = np.inf
    return np.array(found, dtype=np.int64)
