"""Functional maps between two shapes, refined to maps of vertices (ZoomOut).

A functional map is a matrix C that takes the spectral coefficients of a function on the second
shape to those of the corresponding function on the first [1]_. The least-squares estimate maps
descriptors and landmarks to one another, and commutes with the Laplacians and with multiplication
by descriptors [2]_. The refinement converts the matrix to a map of vertices and back, repeatedly
and with more eigenfunctions each time [3]_. If meshes are given, the estimate also commutes with
operators that change sign in a mirror image [4]_, and copies are matched by position. Both shapes
are scaled to an area of 1.

References
----------
.. [1] Ovsjanikov, M., Ben-Chen, M., Solomon, J., Butscher, A. and Guibas, L. (2012). "Functional
   Maps: A Flexible Representation of Maps between Shapes." ACM Transactions on Graphics 31(4).
.. [2] Nogneng, D. and Ovsjanikov, M. (2017). "Informative Descriptor Preservation via
   Commutativity for Shape Matching." Computer Graphics Forum 36(2).
.. [3] Melzi, S., Ren, J., Rodolà, E., Sharma, A., Wonka, P. and Ovsjanikov, M. (2019). "ZoomOut:
   Spectral Upsampling for Efficient Shape Correspondence." ACM Transactions on Graphics 38(6).
.. [4] Ren, J., Poulenard, A., Wonka, P. and Ovsjanikov, M. (2018). "Continuous and
   Orientation-preserving Correspondences via Functional Maps." ACM Transactions on Graphics 37(6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy import sparse
from scipy.spatial import KDTree

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError, not_carried, other_mesh, wrong_shape
from meshmash_viewer.features import MATCHED_COLUMNS
from meshmash_viewer.features.copies import Placed, copied, nearest_by_position
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.features.shape import Matches
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.eigenpairs import (
    Eigenpairs,
    EigenpairsLike,
    as_two_eigenpairs,
    first_nonzero,
)
from meshmash_viewer.units import whole_number

#: Number of eigenfunctions of each shape in the first map, and in the refined map.
_FIRST, _LAST = 30, 150
#: Eigenfunctions added in a step of the refinement.
_STEP = 10
#: Number of descriptors whose multiplication commutes with the map.
_PRODUCTS = 10
#: Number of functions of the first map if there are fewer descriptors than that.
_LEAST = 10
#: Deviation of a descriptor, relative to its norm, below which it is constant but for rounding.
_CONSTANT = 1e-3
#: Area of a component, relative to the shape, below which it is left out.
_DEBRIS = 0.01
#: Weights of the commutators with Laplacians and with descriptors, relative to the descriptors.
_LAPLACIANS, _COMMUTATORS = 1.0, 0.3
#: Ratio of residuals below which the map that reverses orientation replaces the map that preserves
#: it. On a shape with a mirror symmetry the ratio is 1, so that its sides are not swapped.
_MIRRORED = 0.8
#: Singular value of the first map below which a function is undetermined, and share of determined
#: functions below which the map is ambiguous: a symmetry of order 2 determines a half.
_UNDETERMINED, _AMBIGUOUS = 0.25, 0.67
#: Reason for an ambiguous map.
AMBIGUOUS = (
    "several matches are equally good, as on a shape with a symmetry, or the shapes differ much"
)
#: Enclosed volume, relative to a ball of the same area, above which faces are oriented outward.
_SOLID = 0.01
#: Number of vertices of the first shape used in the refinement, and of vertices matched at a time.
_SAMPLES, _AT_ONCE = 6000, 1024
#: Number of candidate vertices above which a k-d tree is used instead of all distances.
_ALL = 20_000


@dataclass(frozen=True, eq=False)
class FunctionalMap:
    """Map of functions on a second shape to functions on a first shape, and its map of vertices.

    Parameters
    ----------
    matrix : ndarray of float64, shape (k, l)
        Maps l spectral coefficients on the second to k on the first, both scaled to an area of 1.
    matches : Matches
        Corresponding vertex of the second for each vertex of the first. Scores are distances in the
        space of the l eigenfunctions; for a copy (`rigid`), distances of positions divided by
        √area.
    mirrored : bool
        Whether the map reverses orientation, because descriptors fit a mirror image better.
    determined : float
        Share of the functions that descriptors, landmarks and orientation determine. Below about ⅔
        landmarks are needed: the shape has a symmetry, with several equally good maps, or the
        shapes differ much.
    rigid : ndarray of float64, shape (4, 4), optional
        Similarity transform from positions of the first to the second, if the shapes are copies
        up to noise. The matches are then the nearest positions.
    n_landmarks : int
        Number of landmarks that the map was estimated from.

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
    mirrored: bool = False
    determined: float = 1.0
    rigid: FloatArray | None = None
    n_landmarks: int = 0

    @property
    def ambiguous(self) -> bool:
        """Whether landmarks are needed to determine the map."""
        return self.determined < _AMBIGUOUS

    @property
    def remark(self) -> str:
        """Warning about the map; "" for none."""
        if self.ambiguous:
            return f"{AMBIGUOUS}: set {'more ' if self.n_landmarks else ''}landmarks."
        return "the match reverses left and right, as in a mirror image." if self.mirrored else ""

    def carry(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Carry values at the vertices of the second shape, shape (m,) or (m, f), to the first.

        The result, shape (n,) or (n, f), is NaN at vertices without a match, or -1 for integers.
        `InputError` is raised if there are fewer rows than vertices, or the map is `ambiguous` or
        has too few different matches (`Matches.collapse`).
        """
        given, at = np.asarray(values), self.matches.indices
        if doubt := AMBIGUOUS if self.ambiguous else self.matches.collapse(len(given)):
            raise not_carried(doubt)
        if not len(given) > at.max(initial=-1):
            raise InputError("other-mesh", f"There are {len(given):,} values for more vertices")
        carried, missing = given[at], np.nan
        if not np.issubdtype(given.dtype, np.inexact):
            carried, missing = carried.astype(np.result_type(given.dtype, np.int8), copy=False), -1
        carried[at < 0] = missing
        return carried


@dataclass(frozen=True, eq=False)
class _Shape(Placed):
    """Eigenpairs of a shape scaled to an area of 1, at its vertices with mass.

    Components of less than a hundredth of the area, and their eigenfunctions, are left out.
    Faces are oriented outward; without a mesh, there are neither positions nor faces.
    """

    eigenvalues: FloatArray
    functions: FloatArray
    mass: FloatArray
    vertices: IntArray
    n_vertices: int

    @classmethod
    def of(cls, pairs: Eigenpairs, count: int, mesh: Mesh | None) -> _Shape:
        used, area = np.flatnonzero(pairs.mass > 0.0), float(pairs.mass.sum())
        mass, eigenvalues = pairs.mass[used], pairs.eigenvalues
        null = np.asarray(pairs.rows[: first_nonzero(pairs)], dtype=np.float64)[:, used]
        # the squares of null vectors add up to one over the area of the component
        kept = np.square(null).sum(axis=0) * _DEBRIS * area < 1.0
        if kept.all() or not 2.0 * mass[kept].sum() > area:
            rows = np.asarray(pairs.rows[:count], dtype=np.float64)[:, used]
        else:
            rows = np.asarray(pairs.rows[: len(eigenvalues)], dtype=np.float64)[:, used[kept]]
            used, mass = used[kept], mass[kept]
            rows, eigenvalues = _restricted(rows, eigenvalues, len(null), mass)
        positions, faces = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
        if mesh is not None:
            if mesh.n_vertices != len(pairs.mass):
                name = mesh.name or "a mesh"
                raise other_mesh(f"Eigenpairs of {name}", len(pairs.mass), mesh.n_vertices)
            place = np.full(len(pairs.mass), -1)
            place[used], positions = np.arange(len(used)), mesh.vertices[used]
            faces = place[mesh.faces]
            faces = faces[(faces >= 0).all(axis=1)]
            corners = (positions - positions.mean(axis=0))[faces]
            if np.linalg.det(corners).sum() < -_SOLID * area**1.5 / np.sqrt(np.pi):
                faces = faces[:, ::-1]
        functions = np.ascontiguousarray(rows[:count].T) * np.sqrt(area)
        scaled = eigenvalues[:count] * area, functions, mass / area
        return cls(positions, faces, area, *scaled, used, len(pairs.mass))

    def standardized(self, values: FloatArray) -> FloatArray:
        """Return columns, shape (n, f), without their means, divided by their deviations.

        Means say nothing about the correspondence, and would outweigh the rest.
        """
        norms = np.sqrt(np.square(values).T @ self.mass)
        centred = values - self.mass @ values / self.mass.sum()
        deviations = np.sqrt(np.square(centred).T @ self.mass)
        scales = np.maximum(deviations, _CONSTANT * norms)
        return np.asarray(centred / np.where(scales > 0.0, scales, 1.0))

    def sampled(self) -> IntArray | slice:
        """Return up to 6,000 random vertices, with probabilities proportional to area."""
        if (n := len(self.mass)) <= _SAMPLES:
            return slice(None)
        share = self.mass / self.mass.sum()
        return np.random.default_rng(0).choice(n, _SAMPLES, replace=False, p=share)

    def coefficients(self, values: FloatArray, count: int) -> FloatArray:
        return np.asarray(self.functions[:, :count].T @ (self.mass[:, None] * values))

    def product(self, values: FloatArray, count: int) -> FloatArray:
        """Compute the matrix of g ↦ values · g, shape (count, count)."""
        return self.coefficients(values[:, None] * self.functions[:, :count], count)

    def orientation(self, values: FloatArray, count: int) -> FloatArray:
        """Compute the matrix of g ↦ n · (∇ values × ∇g), divided by its norm, (count, count)."""
        faces, functions = self.faces, self.functions[:, :count]
        corners = values[faces]
        size = len(corners), len(functions)
        ends = np.arange(0, 3 * len(corners) + 1, 3)
        around = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
        sums, derivative = (
            sparse.csr_array((each.ravel(), faces.ravel(), ends), shape=size) @ functions
            for each in (np.ones_like(around), around)
        )
        found = np.asarray(sums.T @ derivative)
        return found / max(float(np.linalg.norm(found)), np.finfo(np.float64).tiny)


def functional_map(
    first: EigenpairsLike,
    second: EigenpairsLike,
    bank: FilterBank | None = None,
    *,
    landmarks: npt.ArrayLike = (),
    n_functions: int = _FIRST,
    meshes: tuple[MeshLike, MeshLike] | None = None,
) -> FunctionalMap:
    """Estimate the functional map between two shapes from descriptors and landmarks.

    `InputError` is raised if there are fewer than two eigenpairs, or a landmark does not exist.

    Parameters
    ----------
    first, second : Eigenpairs
        Eigenpairs of the shapes, up to about the same eigenvalue times area.
    bank : FilterBank, optional
        Filters of the descriptors, for eigenvalues times area. Default: the wave kernel signature
        with 100 energies in the spectrum of the first.
    landmarks : array_like of int, shape (p, 2), optional
        Corresponding vertices of the first and the second. Without landmarks and `meshes`, a
        symmetric shape may be matched to its mirror image.
    n_functions : int
        Largest number of eigenfunctions of each shape. No more than descriptors are used, but up to
        10 with few descriptors; fewer if a shape has fewer.
    meshes : tuple of two MeshLike, optional
        The two meshes. The map preserves their orientation, unless a map that reverses it fits
        better (`FunctionalMap.mirrored`), as for a left and a right hemisphere.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 12)
    >>> found = mv.functional_map(pairs, pairs, landmarks=[[0, 0]])
    >>> bool(np.allclose(found.matrix, np.eye(12), atol=0.1))
    True
    """
    first, second = as_two_eigenpairs("functional_map(first, second)", first, second, meshes)
    known = min(len(first.eigenvalues), len(second.eigenvalues))
    shapes = _shapes_of(first, second, known, meshes)
    known = len(shapes[0].eigenvalues)
    count = min(n_functions, known)
    if count < 2:
        raise InputError("too-few-pairs", "A functional map takes at least two pairs of each shape")
    if bank is None:
        bank = wave_kernel_bank(shapes[0].eigenvalues, MATCHED_COLUMNS)
    top, step = shapes[0].eigenvalues[-1], max(bank.n_filters // _PRODUCTS, 1)
    joined = []
    for shape, points in zip(shapes, _checked(landmarks, *shapes), strict=True):
        heights = bank(np.minimum(shape.eigenvalues, top))
        features = accumulate_features(shape.functions.T, heights)
        # kernels of some filters, centred at each landmark
        around = shape.functions[np.searchsorted(shape.vertices, points)]
        kernels = shape.functions @ (heights[::step] * around[:, None]).reshape(-1, known).T
        joined.append(shape.standardized(np.hstack([features, kernels])))
    both = list(zip(shapes, joined, strict=True))
    # more functions than descriptors would follow from the penalties alone
    count = min(count, max(joined[0].shape[1], _LEAST))
    mine, other = (shape.coefficients(each, count) for shape, each in both)
    products, orientations = [], []
    for shape, each in both:
        some = each[:, ::step].T
        products.append(np.stack([shape.product(values, count) for values in some]))
        orientations.append(np.stack([shape.orientation(values, count) for values in some]))
    # normal equations for the entries of C, row by row
    normal = np.kron(np.eye(count), other @ other.T)
    gaps = np.square(np.subtract.outer(*(shape.eigenvalues[:count] for shape in shapes)))
    normal[np.diag_indices(count * count)] += _LAPLACIANS * (gaps / gaps.max()).ravel()
    squares, mixed = _commutators(*products)
    normal += squares - mixed
    squares, mixed = _commutators(*orientations)  # zero without meshes
    normal += squares
    wanted, found = (mine @ other.T).ravel(), []
    for side in (1.0,) if meshes is None else (1.0, -1.0):
        matrix = normal - side * mixed
        # QR with pivoting: products of a symmetric shape may leave some entries undetermined
        entries = scipy.linalg.lstsq(matrix, wanted, lapack_driver="gelsy")[0]
        residual = entries @ matrix @ entries - 2.0 * wanted @ entries + np.square(mine).sum()
        found.append((entries.reshape(count, count), float(residual)))
    mirrored = len(found) > 1 and found[1][1] < _MIRRORED * found[0][1]
    matrix = found[mirrored][0]
    share = np.mean(scipy.linalg.svdvals(matrix) > _UNDETERMINED)
    result = _with_matches(matrix, *shapes, cancel=None)
    marks = len(np.asarray(landmarks))
    return replace(result, mirrored=mirrored, determined=float(share), n_landmarks=marks)


def zoomout(
    first: EigenpairsLike,
    second: EigenpairsLike,
    start: FunctionalMap,
    *,
    n_functions: int = _LAST,
    step: int = _STEP,
    cancel: CancelCallback | None = None,
    meshes: tuple[MeshLike, MeshLike] | None = None,
) -> FunctionalMap:
    """Refine a functional map with an increasing number of eigenfunctions.

    Steps use up to 6,000 random vertices of the first shape; the last step uses all vertices.

    Parameters
    ----------
    first, second : Eigenpairs
    start : FunctionalMap
        Map to refine, see `functional_map`.
    n_functions : int
        Number of eigenfunctions of each shape in the last step; fewer if a shape has fewer.
    step : int
        Number of eigenfunctions added in each step.
    cancel : callable, optional
        Called repeatedly; `Cancelled` is raised if it returns True.
    meshes : tuple of two MeshLike, optional
        The two meshes, to match a moved, scaled copy by position (`FunctionalMap.rigid`).

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 40)
    >>> start = mv.functional_map(pairs, pairs, landmarks=[[0, 0]], n_functions=12)
    >>> found = mv.zoomout(pairs, pairs, start)
    >>> found.matrix.shape, float(np.mean(found.matches.indices == np.arange(98)))
    ((40, 40), 1.0)
    """
    first, second = as_two_eigenpairs("zoomout(first, second, start)", first, second, meshes)
    whole_number(step, "step")
    first_shape, second_shape = whole = _shapes_of(first, second, n_functions, meshes)
    last = len(first_shape.eigenvalues)
    some = first_shape.sampled()
    here, there = first_shape.functions[some], second_shape.functions
    matrix, count = start.matrix[:last, :last], min(*start.matrix.shape, last)
    near = _nearest(here[:, : len(matrix)] @ matrix, second_shape, cancel)[0]

    def as_copy(near: IntArray) -> tuple[FloatArray, IntArray, FloatArray] | None:
        return copied(*whole, some, near, start.mirrored) if meshes is not None else None

    copy = as_copy(near)
    while copy is None and count < last:
        count = min(count + step, last)
        mine = here[:, :count]
        matrix = scipy.linalg.lstsq(mine.T @ mine, mine.T @ there[near, :count])[0]
        if count < last:
            near = _nearest(mine @ matrix, second_shape, cancel)[0]
    if copy is None:
        found = _with_matches(matrix, *whole, cancel=cancel)
        near = np.searchsorted(second_shape.vertices, found.matches.indices[first_shape.vertices])
        copy = as_copy(near[some])
    if copy is not None:
        rigid, near, distances = copy
        matrix = scipy.linalg.lstsq(here.T @ here, here.T @ there[near[some]])[0]
        found = FunctionalMap(matrix, _matches(*whole, near, distances), rigid=rigid)
    return replace(start, matrix=found.matrix, matches=found.matches, rigid=found.rigid)


def inverse_matches(
    first: Eigenpairs,
    second: Eigenpairs,
    found: FunctionalMap,
    cancel: CancelCallback | None = None,
    meshes: tuple[MeshLike, MeshLike] | None = None,
) -> Matches:
    """Find the nearest vertex of the first for each vertex of the second, with the same map."""
    shapes = _shapes_of(first, second, len(found.matrix), meshes)[::-1]
    if found.rigid is not None and meshes is not None:
        return _matches(*shapes, *nearest_by_position(found.rigid, *shapes[::-1])[1])
    return _with_matches(found.matrix.T, *shapes, cancel=cancel).matches


def _shapes_of(
    first: Eigenpairs, second: Eigenpairs, count: int, meshes: tuple[MeshLike, MeshLike] | None
) -> tuple[_Shape, _Shape]:
    here, there = (None, None) if meshes is None else (as_mesh(each) for each in meshes)
    both = _Shape.of(first, count, here), _Shape.of(second, count, there)
    least = min(len(each.eigenvalues) for each in both)
    one, other = (
        replace(each, eigenvalues=each.eigenvalues[:least], functions=each.functions[:, :least])
        for each in both
    )
    return one, other


def _restricted(
    rows: FloatArray, eigenvalues: FloatArray, n_null: int, mass: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the eigenpairs of some components of a shape, with the first `n_null` zero.

    `rows`, shape (k, n), are the eigenvectors of the whole shape at the n vertices of these
    components.
    """
    _, norms, null = scipy.linalg.svd(rows[:n_null] * np.sqrt(mass), full_matrices=False)
    null = null[norms > np.sqrt(0.5)] / np.sqrt(mass)
    share = np.square(rows[n_null:]) @ mass
    ours = share > 0.5
    others = rows[n_null:][ours] / np.sqrt(share[ours])[:, None]
    values = np.concatenate([np.zeros(len(null)), eigenvalues[n_null : len(rows)][ours]])
    return np.concatenate([null, others]), values


def _commutators(here: FloatArray, there: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrices S and X for which S - X is the quadratic form mean |C there - here C|².

    The variables are the joined rows of C. X changes sign if `here` or `there` does; S does not.
    """
    one = np.eye(here.shape[1])
    squares = np.kron(one, (there @ there.transpose(0, 2, 1)).sum(axis=0))
    squares += np.kron((here.transpose(0, 2, 1) @ here).sum(axis=0), one)
    both = np.einsum("pji,plk->ikjl", here, there, optimize=True).reshape(squares.shape)
    weight = _COMMUTATORS / len(here)
    return weight * squares, weight * (both + both.T)


def _checked(landmarks: npt.ArrayLike, first: _Shape, second: _Shape) -> tuple[IntArray, IntArray]:
    """Return the landmarks of each shape; raise `InputError` unless all are its vertices."""
    points = np.asarray(landmarks)
    if not points.size:
        points = np.empty((0, 2), dtype=np.int64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.issubdtype(points.dtype, np.integer):
        raise wrong_shape("Landmarks", points.shape, "pairs of vertices of both shapes")
    for shape, column in zip((first, second), points.T, strict=True):
        bad = np.setdiff1d(column, shape.vertices)
        if len(bad):
            raise InputError(
                "vertex-unused",
                f"Vertex {bad[0]} cannot be a landmark, as it does not exist, has no face, or"
                " is in a component of less than a hundredth of the area",
                "choose another",
            )
    return points[:, 0], points[:, 1]


def _with_matches(
    matrix: FloatArray, first: _Shape, second: _Shape, cancel: CancelCallback | None
) -> FunctionalMap:
    near, distances = _nearest(first.functions[:, : len(matrix)] @ matrix, second, cancel)
    return FunctionalMap(matrix, _matches(first, second, near, distances))


def _matches(first: _Shape, second: _Shape, near: IntArray, distances: FloatArray) -> Matches:
    return Matches.of(first.n_vertices, first.vertices, second.vertices[near], distances)


def _nearest(
    points: FloatArray, shape: _Shape, cancel: CancelCallback | None
) -> tuple[IntArray, FloatArray]:
    """Return the nearest vertices of a shape in the space of its eigenfunctions, and distances."""
    candidates = np.ascontiguousarray(shape.functions[:, : points.shape[1]])
    near, distances = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    tree = KDTree(candidates) if len(candidates) > _ALL else None
    single = candidates.astype(np.float32)
    half = 0.5 * np.square(candidates).sum(axis=1).astype(np.float32)
    for some in blocks(len(points), _AT_ONCE):
        check_cancelled(cancel)
        if tree is None:
            near[some] = np.argmax(points[some].astype(np.float32) @ single.T - half, axis=1)
        else:
            near[some] = tree.query(points[some], workers=-1)[1]
        distances[some] = np.linalg.norm(points[some] - candidates[near[some]], axis=1)
    return near, distances
