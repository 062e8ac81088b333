"""Functional maps between two shapes, refined to maps of vertices (ZoomOut).

A functional map is a matrix C that takes the spectral coefficients of a function on the second
shape to those of the corresponding function on the first [1]_. It is estimated from descriptors and
landmarks, by least squares in which it commutes with the Laplacians and with products by the
descriptors [2]_, and refined by conversion to a map of vertices and back with more and more
eigenfunctions [3]_. Eigenvalues and eigenfunctions are those of the shapes scaled to an area of 1.

References
----------
.. [1] Ovsjanikov, M., Ben-Chen, M., Solomon, J., Butscher, A. and Guibas, L. (2012). "Functional
   Maps: A Flexible Representation of Maps between Shapes." ACM Transactions on Graphics 31(4).
.. [2] Nogneng, D. and Ovsjanikov, M. (2017). "Informative Descriptor Preservation via
   Commutativity for Shape Matching." Computer Graphics Forum 36(2).
.. [3] Melzi, S., Ren, J., Rodolà, E., Sharma, A., Wonka, P. and Ovsjanikov, M. (2019). "ZoomOut:
   Spectral Upsampling for Efficient Shape Correspondence." ACM Transactions on Graphics 38(6).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.spatial import KDTree

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.features.shape import Matches
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.progress import CancelCallback, check_cancelled

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Number of eigenfunctions of each shape in the first map, and in the refined one.
_FIRST, _LAST = 30, 150
#: Eigenfunctions added in a step of the refinement.
_STEP = 10
#: Energies of the default descriptors, and of those whose products the map commutes with.
_ENERGIES, _PRODUCTS = 100, 10
#: Weights of the commutators with the Laplacians and with products, relative to the descriptors.
_LAPLACIANS, _COMMUTATORS = 1.0, 0.3
#: Vertices of the first shape with which a map is refined; vertices matched at once.
_SAMPLES, _AT_ONCE = 6000, 1024
#: Number of candidate vertices up to which distances to all of them are computed.
_ALL = 20_000
#: Share of the matches that are confident.
_CONFIDENT = 0.1


@dataclass(frozen=True, eq=False)
class FunctionalMap:
    """Map of functions on a second shape to functions on a first one, and its map of vertices.

    Parameters
    ----------
    matrix : ndarray of float64, shape (k, l)
        Spectral coefficients on the first, of those on the second, for both scaled to an area of 1.
    matches : Matches
        For each vertex of the first the corresponding one of the second; scores are distances in
        the space of the l eigenfunctions.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 12)
    >>> found = mv.functional_map(pairs, pairs, landmarks=[[0, 0]])
    >>> found.matrix.shape, found.carry(np.arange(98)).shape
    ((12, 12), (98,))
    """

    matrix: FloatArray
    matches: Matches

    def carry(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Carry values at the vertices of the second to the first.

        Parameters
        ----------
        values : array_like, shape (m,) or (m, f)
            A map or features, or numbers of labels.

        Returns
        -------
        ndarray, shape (n,) or (n, f)
            NaN, or -1 for integers, where a vertex has no match.

        Raises
        ------
        InputError
            If there are fewer rows than vertices.
        """
        given, at = np.asarray(values), self.matches.indices
        if not len(given) > at.max(initial=-1):
            raise InputError(f"There are {len(given):,} values for more vertices.")
        carried = given[at]
        if not np.issubdtype(given.dtype, np.inexact):
            carried = carried.astype(np.result_type(given.dtype, np.int8), copy=False)
        carried[at < 0] = np.nan if np.issubdtype(given.dtype, np.inexact) else -1
        return carried


@dataclass(frozen=True, eq=False)
class _Shape:
    """Eigenpairs of a shape scaled to an area of 1, at its vertices with mass."""

    eigenvalues: FloatArray
    functions: FloatArray
    mass: FloatArray
    vertices: IntArray
    n_vertices: int

    @classmethod
    def of(cls, pairs: Eigenpairs, count: int) -> _Shape:
        used, area = np.flatnonzero(pairs.mass > 0.0), float(pairs.mass.sum())
        rows = np.asarray(pairs.rows[:count], dtype=np.float64)[:, used]
        return cls(
            pairs.eigenvalues[:count] * area,
            np.ascontiguousarray(rows.T) * np.sqrt(area),
            pairs.mass[used] / area,
            used,
            len(pairs.mass),
        )

    def sampled(self) -> FloatArray:
        """Return the eigenfunctions at some random vertices only, of equal areas."""
        if len(self.mass) <= _SAMPLES:
            return self.functions
        chosen = np.random.default_rng(0).choice(
            len(self.mass), _SAMPLES, replace=False, p=self.mass / self.mass.sum()
        )
        return self.functions[chosen]

    def coefficients(self, values: FloatArray, count: int) -> FloatArray:
        return np.asarray(self.functions[:, :count].T @ (self.mass[:, None] * values))


def functional_map(
    first: Eigenpairs,
    second: Eigenpairs,
    bank: FilterBank | None = None,
    *,
    landmarks: npt.ArrayLike = (),
    n_functions: int = _FIRST,
) -> FunctionalMap:
    """Estimate the functional map between two shapes from descriptors and landmarks.

    Parameters
    ----------
    first, second : Eigenpairs
        Both up to about the same eigenvalue times area.
    bank : FilterBank, optional
        Filters of the descriptors, for eigenvalues times area: by default the wave kernel signature
        of 100 energies of the first.
    landmarks : array_like of int, shape (p, 2), optional
        Corresponding vertices of the first and the second. Without them a symmetric shape may be
        matched to its mirror image.
    n_functions : int
        Number of eigenfunctions of each shape; fewer if one has fewer.

    Returns
    -------
    FunctionalMap

    Raises
    ------
    InputError
        If there are fewer than two eigenpairs, or a landmark does not exist.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 12)
    >>> found = mv.functional_map(pairs, pairs, landmarks=[[0, 0]])
    >>> bool(np.allclose(found.matrix, np.eye(12), atol=0.1))
    True
    """
    known = min(len(first.eigenvalues), len(second.eigenvalues))
    count = min(n_functions, known)
    if count < 2:
        raise InputError("A functional map takes at least two eigenpairs of each shape.")
    shapes = _Shape.of(first, known), _Shape.of(second, known)
    if bank is None:
        bank = wave_kernel_bank(shapes[0].eigenvalues, _ENERGIES)
    top = shapes[0].eigenvalues[-1]
    columns = []
    for shape, pairs, points in zip(
        shapes, (first, second), _checked(landmarks, first, second), strict=True
    ):
        heights = bank(np.minimum(shape.eigenvalues, top))
        features = accumulate_features(pairs.rows[:known], heights)[shape.vertices]
        # the kernels of some filters around each landmark
        chosen = heights[:: max(bank.n_filters // _PRODUCTS, 1)]
        around = shape.functions[np.searchsorted(shape.vertices, points)]
        kernels = shape.functions @ (chosen[None] * around[:, None]).reshape(-1, known).T
        columns.append(_of_length_one(features, kernels, mass=shape.mass))
    mine, other = (
        shape.coefficients(features, count) for shape, features in zip(shapes, columns, strict=True)
    )
    # normal equations for the rows of C, one after another
    normal = np.kron(np.eye(count), other @ other.T)
    gaps = np.square(
        np.subtract.outer(shapes[0].eigenvalues[:count], shapes[1].eigenvalues[:count])
    )
    normal[np.diag_indices(count * count)] += _LAPLACIANS * (gaps / gaps.max()).ravel()
    products = range(0, mine.shape[1], max(bank.n_filters // _PRODUCTS, 1))
    for at in products:
        here, there = (
            shape.coefficients(features[:, at, None] * shape.functions[:, :count], count)
            for shape, features in zip(shapes, columns, strict=True)
        )
        # the square of C ↦ C there - here C; both are symmetric
        weight = _COMMUTATORS / len(products)
        normal += weight * (
            np.kron(np.eye(count), there @ there)
            - 2.0 * np.kron(here, there)
            + np.kron(here @ here, np.eye(count))
        )
    # QR with pivoting: products of a symmetric shape may leave some entries undetermined
    matrix = scipy.linalg.lstsq(normal, (mine @ other.T).ravel(), lapack_driver="gelsy")[0]
    return _with_matches(matrix.reshape(count, count), *shapes, cancel=None)


def zoomout(
    first: Eigenpairs,
    second: Eigenpairs,
    start: FunctionalMap,
    *,
    n_functions: int = _LAST,
    step: int = _STEP,
    cancel: CancelCallback | None = None,
) -> FunctionalMap:
    """Refine a functional map with more and more eigenfunctions.

    Parameters
    ----------
    first, second : Eigenpairs
    start : FunctionalMap
        See `functional_map`.
    n_functions : int
        Number of eigenfunctions of each shape in the last step; fewer if one has fewer.
    step : int
        Number of eigenfunctions added in each step.
    cancel : callable, optional
        Called repeatedly; `Cancelled` is raised if it returns True.

    Returns
    -------
    FunctionalMap
        Of a first shape with more than 6,000 vertices the steps take so many random ones, and the
        last step takes all.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 40)
    >>> start = mv.functional_map(pairs, pairs, landmarks=[[0, 0]], n_functions=12)
    >>> found = mv.zoomout(pairs, pairs, start)
    >>> found.matrix.shape, float(np.mean(found.matches.indices == np.arange(98)))
    ((40, 40), 1.0)
    """
    if step < 1:
        raise InputError(f"step is {step}: give at least 1.")
    last = min(n_functions, len(first.eigenvalues), len(second.eigenvalues))
    whole = _Shape.of(first, last), _Shape.of(second, last)
    here, there = whole[0].sampled(), whole[1].functions
    matrix, count = start.matrix[:last, :last], min(*start.matrix.shape, last)
    while count < last:
        near = _nearest(here[:, : len(matrix)] @ matrix, whole[1], cancel)[0]
        count = min(count + step, last)
        mine = here[:, :count]
        matrix = scipy.linalg.lstsq(mine.T @ mine, mine.T @ there[near, :count])[0]
    return _with_matches(matrix, *whole, cancel=cancel)


def inverse_matches(
    first: Eigenpairs,
    second: Eigenpairs,
    found: FunctionalMap,
    cancel: CancelCallback | None = None,
) -> Matches:
    """Return for each vertex of the second the nearest one of the first, by the same map."""
    count = len(found.matrix)
    shapes = _Shape.of(second, count), _Shape.of(first, count)
    return _with_matches(found.matrix.T, *shapes, cancel=cancel).matches


def _of_length_one(*columns: FloatArray, mass: FloatArray) -> FloatArray:
    """Join columns, each divided by its norm."""
    joined = np.hstack(columns)
    length = np.sqrt(np.square(joined).T @ mass)
    return np.asarray(joined / np.where(length > 0.0, length, 1.0))


def _checked(
    landmarks: npt.ArrayLike, first: Eigenpairs, second: Eigenpairs
) -> tuple[IntArray, IntArray]:
    """Return the landmarks of each shape; raise `InputError` unless all of them have mass."""
    points = np.asarray(landmarks)
    points = points.reshape(0, 2) if points.size == 0 else points
    if points.ndim != 2 or points.shape[1] != 2 or not np.issubdtype(points.dtype, np.integer):
        if points.size:
            raise InputError("Landmarks are pairs of vertices, of the first and of the second.")
        points = points.astype(np.int64)
    for pairs, column in zip((first, second), points.T, strict=True):
        inside = (column >= 0) & (column < len(pairs.mass))
        bad = column[~inside] if not inside.all() else column[~(pairs.mass[column] > 0.0)]
        if len(bad):
            raise InputError(
                f"Vertex {bad[0]} is no landmark: there is none of that index, or no face uses it."
            )
    return points[:, 0], points[:, 1]


def _with_matches(
    matrix: FloatArray, first: _Shape, second: _Shape, cancel: CancelCallback | None
) -> FunctionalMap:
    near, distances = _nearest(first.functions[:, : len(matrix)] @ matrix, second, cancel)
    indices = np.full(first.n_vertices, -1, dtype=np.int64)
    scores = np.full(first.n_vertices, np.nan)
    confident = np.zeros(first.n_vertices, dtype=np.bool_)
    indices[first.vertices], scores[first.vertices] = second.vertices[near], distances
    confident[first.vertices] = distances <= np.quantile(distances, _CONFIDENT)
    return FunctionalMap(matrix, Matches(indices, scores, confident, _CONFIDENT))


def _nearest(
    points: FloatArray, shape: _Shape, cancel: CancelCallback | None
) -> tuple[IntArray, FloatArray]:
    """Return the nearest vertices of a shape in the space of its eigenfunctions, and distances."""
    candidates = np.ascontiguousarray(shape.functions[:, : points.shape[1]])
    near, distances = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    tree = KDTree(candidates) if len(candidates) > _ALL else None
    single, half = candidates.astype(np.float32), 0.5 * np.square(candidates).sum(axis=1)
    half = half.astype(np.float32)
    for some in blocks(len(points), _AT_ONCE):
        check_cancelled(cancel)
        if tree is None:
            near[some] = np.argmax(points[some].astype(np.float32) @ single.T - half, axis=1)
            distances[some] = np.linalg.norm(points[some] - candidates[near[some]], axis=1)
        else:
            distances[some], near[some] = tree.query(points[some], workers=-1)
    return near, distances
