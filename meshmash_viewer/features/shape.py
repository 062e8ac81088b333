"""Comparison of shapes by their eigenvalues, matches of vertices by features, smoothed shapes.

Unreferenced vertices (NaN rows) are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from meshmash_viewer.arrays import FloatArray, blocks, check_vertex
from meshmash_viewer.errors import InputError, other_mesh, other_units, wrong_shape
from meshmash_viewer.features.map_spectrum import inner_products, partial_sum
from meshmash_viewer.laplacian import compute_vertex_areas, cotangent_laplacian
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.eigenpairs import EigenpairsLike, as_eigenpairs
from meshmash_viewer.units import check_number, counted, whole_number

#: `Features`, or their values alone, shape (n, f).
FeaturesLike: TypeAlias = Any
#: Vertices matched between two calls of `cancel`.
_AT_ONCE = 4096
#: Pairs added at a time: some hundredths of a second for a million vertices.
_STEP = 8
#: Share of different matches below which a match has collapsed.
_COLLAPSED = 0.1


@dataclass(frozen=True, eq=False)
class Matches:
    """Vertices of another shape with the most similar features, for each vertex of a shape."""

    #: Shape (n,): vertex of the other shape; -1 for a vertex without features.
    indices: npt.NDArray[np.int64]
    #: Shape (n,): distance of the two vertices in feature space; NaN without a match.
    scores: FloatArray
    #: Shape (n,): whether the score is within the lowest share `quantile` of all scores.
    confident: npt.NDArray[np.bool_]
    #: Requested share of confident matches.
    quantile: float

    @classmethod
    def of(
        cls,
        n: int,
        rows: npt.NDArray[np.int64],
        indices: npt.NDArray[np.int64],
        scores: FloatArray,
        quantile: float = 0.1,
    ) -> Matches:
        """Create matches of n vertices, from indices and scores of the vertices `rows`."""
        found = cls(np.full(n, -1), np.full(n, np.nan), np.zeros(n, dtype=np.bool_), quantile)
        found.indices[rows], found.scores[rows] = indices, scores
        # not "<": perfect matches, with scores of 0, are confident
        found.confident[rows] = scores <= np.quantile(scores, quantile)
        return found

    def collapse(self, n_others: int) -> str:
        """Describe a match to fewer different vertices than a tenth of each shape; "" if not.

        `n_others` is the number of vertices of the other shape.
        """
        at = self.indices[self.indices >= 0]
        targets = len(np.unique(at))
        if targets >= _COLLAPSED * min(len(at), n_others):
            return ""
        return f"{counted(len(at), 'vertex')} match only {counted(targets, 'vertex')} of the other"


class Reconstruction:
    """The sum ``Φ_k Φ_kᵀ M v`` for the vertices v, updated when the number of pairs changes.

    The centre of mass of each component is subtracted first, which avoids cancellation far from the
    origin, and keeps each component at its position even if there are more components than pairs.
    The result is the same, because eigenfunctions of eigenvalue zero represent centres exactly.

    `rows` are eigenvectors, shape (>= k, n), and may be a memory map; `mass`, shape (n,), is 0 at
    unreferenced vertices.
    """

    def __init__(self, mesh: Mesh, rows: Any, mass: FloatArray) -> None:
        self._mesh, self._rows = mesh, rows
        self._used = used = mass > 0.0
        labels = mesh.component_labels[used]
        self._mass = np.where(used, mass, 0.0)
        total = np.bincount(labels, weights=mass[used])
        vertices = mesh.vertices[used].T
        centres = np.stack([np.bincount(labels, mass[used] * axis) / total for axis in vertices])
        # centre of the component of each vertex, and offset of the vertex from it
        self._centres = mesh.vertices.T.copy()
        self._centres[:, used] = centres[:, labels]
        self._offsets = mesh.vertices.T - self._centres
        self._coefficients = np.zeros((3, 0))
        self._sum = np.zeros(self._offsets.shape)
        #: Number of pairs in the sum.
        self.count = 0

    def move_to(self, count: int) -> Iterator[None]:
        """Add or subtract pairs until the sum has `count`; it is valid after each step."""
        while self.count != count:
            step = min(max(count - self.count, -_STEP), _STEP)
            first, last = sorted((self.count, self.count + step))
            known = self._coefficients.shape[1]
            if last > known:
                weighted = self._offsets * self._mass
                more = inner_products(self._rows, weighted, self._used, known, last)
                self._coefficients = np.concatenate([self._coefficients, more], axis=1)
            change = partial_sum(self._rows, self._coefficients, first, last)
            if not self._used.all():
                change[:, ~self._used] = 0.0
            if step > 0:
                self._sum += change
            else:
                self._sum -= change
            self.count += step
            yield

    @property
    def vertices(self) -> FloatArray:
        """Reconstructed vertices, shape (n, 3), in the unit of the mesh.

        Unreferenced vertices are unchanged.
        """
        return np.ascontiguousarray((self._centres + self._sum).T)

    @property
    def rms_distance(self) -> float:
        """Area-weighted root mean square distance between reconstructed and original vertices."""
        left = np.square(self._offsets - self._sum).sum(axis=0)
        return float(np.sqrt(left @ self._mass / self._mass.sum()))


def low_pass_vertices(mesh: MeshLike, decomposition: EigenpairsLike, n: int) -> FloatArray:
    """Reconstruct the coordinates from the first `n` eigenvectors: a smoothed shape [1]_.

    `InputError` is raised if `n` < 1 or above the number of eigenpairs, or the decomposition is of
    another mesh.

    Parameters
    ----------
    mesh, decomposition : MeshLike, Eigenpairs
        The mesh, and its eigenpairs.
    n : int
        Number of eigenpairs to use, zero eigenvalues included.

    Returns
    -------
    ndarray of float64, shape (n_vertices, 3)
        In the unit of the mesh. Each connected component keeps its centre of mass even if `n` is
        below the number of components; unreferenced vertices are unchanged.

    References
    ----------
    .. [1] Vallet, B. and Lévy, B. (2008). "Spectral Geometry Processing with Manifold
       Harmonics." Computer Graphics Forum 27(2).

    Examples
    --------
    >>> smooth = low_pass_vertices(ball, pairs, 4)
    >>> bool(np.abs(smooth - ball.vertices).max() < 0.01)
    True
    """
    mesh = as_mesh(mesh)
    decomposition = as_eigenpairs("low_pass_vertices(mesh, pairs, n)", decomposition, mesh)
    if decomposition.rows.shape[1] != mesh.n_vertices:
        raise other_mesh("The eigenpairs", decomposition.rows.shape[1], mesh.n_vertices)
    whole_number(n, "The number of eigenpairs", decomposition.n_components)
    sums = Reconstruction(mesh, decomposition.rows, decomposition.mass)
    for _ in sums.move_to(n):
        pass
    return sums.vertices


def spectral_distance(
    mesh_a: MeshLike,
    mesh_b: MeshLike,
    n_components: int = 100,
    *,
    normalize: bool = True,
    robust: bool = True,
    mollify_factor: float = 1e-5,
) -> float:
    """Compute the distance of two shapes by their lowest eigenvalues, "Shape-DNA" [1]_.

    `InputError` is raised if a mesh has too few vertices, or the units differ without `normalize`.

    Parameters
    ----------
    mesh_a, mesh_b : MeshLike
    n_components : int
        Number of eigenvalues to compare, zeros included; at most the number of vertices.
    normalize : bool
        True: multiply eigenvalues by the area of their mesh, so that the distance is dimensionless
        and independent of size and unit. False: compare eigenvalues per squared unit; both meshes
        have to be in the same unit.
    robust, mollify_factor : bool, float
        See `meshmash_viewer.laplacian.cotangent_laplacian`.

    Returns
    -------
    float
        Euclidean distance of the two lists of eigenvalues.

    References
    ----------
    .. [1] Reuter, M., Wolter, F.-E. and Peinecke, N. (2006). "Laplace–Beltrami spectra as
       'Shape-DNA' of surfaces and solids." Computer-Aided Design 38(4).

    Examples
    --------
    >>> small, large = (trimesh.creation.icosphere(3, radius) for radius in (1.0, 5.0))
    >>> round(spectral_distance(small, large, 20), 6)
    0.0
    """
    from meshmash_viewer.spectral.eigensolver import solve

    meshes = as_mesh(mesh_a), as_mesh(mesh_b)
    if not normalize and meshes[0].unit != meshes[1].unit:
        remedy = "convert them to one unit, or use normalize=True"
        raise other_units("The meshes", meshes[0].unit, meshes[1].unit, remedy)
    spectra = []
    for mesh in meshes:
        count = int(np.count_nonzero(compute_vertex_areas(mesh)))
        if count < n_components:
            fault = (
                f"A mesh has only {counted(count, 'vertex')} with area for {n_components:,} pairs"
            )
            raise InputError("too-few-vertices", fault, "ask for fewer")
        stiffness, mass = cotangent_laplacian(mesh, robust=robust, mollify_factor=mollify_factor)
        spectrum = solve(stiffness, mass, n_components).eigenvalues
        spectra.append(spectrum * (mass.diagonal().sum() if normalize else 1.0))
    return float(np.linalg.norm(spectra[0] - spectra[1]))


def match_features(
    a: FeaturesLike,
    b: FeaturesLike,
    *,
    quantile: float = 0.1,
    standardize: bool = False,
    cancel: CancelCallback | None = None,
) -> Matches:
    """Find the vertex of `b` with the nearest features for each vertex of `a`.

    `InputError` is raised if the numbers of columns differ, or one side has no row without NaN.

    Parameters
    ----------
    a, b : Features or array_like, shapes (n, f) and (m, f)
        Features of the two shapes, made with the same filters.
    quantile : float
        Share of the matches, those with the lowest scores, that are confident.
    standardize : bool
        Divide each column by its spread over `b` first (`column_spread`). Otherwise the columns
        with the largest values dominate, such as the shortest times of a heat kernel signature.
    cancel : callable, optional
        Called repeatedly; `Cancelled` is raised after it returns True.

    Returns
    -------
    Matches
        Found with a k-d tree: memory is linear in n + m.

    Examples
    --------
    >>> first, second = [[0.0], [1.0], [2.0]], [[2.1], [0.1], [1.1]]
    >>> match_features(first, second).indices
    array([1, 2, 0])
    """
    values_a, values_b = _values(a), _values(b)
    if values_a.shape[1] != values_b.shape[1]:
        columns = f"{values_a.shape[1]} and {values_b.shape[1]} columns"
        fault = f"Features of {columns} cannot be matched"
        raise InputError("wrong-shape", fault, "make both with the same filters")
    check_number(quantile, "quantile", 0.0, 1.0)
    rows_a, rows_b = (np.flatnonzero(np.isfinite(v).all(axis=1)) for v in (values_a, values_b))
    if not (len(rows_a) and len(rows_b)):
        raise InputError("no-values", "One of the shapes has no vertex with features to match")
    scale = column_spread(values_b[rows_b]) if standardize else 1.0
    tree = KDTree(values_b[rows_b] / scale)
    distances = np.empty(len(rows_a))
    nearest = np.empty(len(rows_a), dtype=np.int64)
    for some in blocks(len(rows_a), _AT_ONCE):
        check_cancelled(cancel)
        distances[some], nearest[some] = tree.query(values_a[rows_a[some]] / scale, workers=-1)
    return Matches.of(len(values_a), rows_a, rows_b[nearest], distances, quantile)


def distinct_matches(
    distances: FloatArray, places: npt.NDArray[np.floating], radius: float, count: int = 4
) -> npt.NDArray[np.int64]:
    """Find the best matches of a vertex that are not close to each other.

    Parameters
    ----------
    distances : ndarray of float64, shape (n,)
        Distances in feature space from the vertex to all vertices of the other shape.
    places : ndarray, shape (n, 3)
        Coordinates of the vertices of the other shape.
    radius : float
        Minimum distance of a match from all better matches, in the unit of `places`.
    count : int
        Maximum number of matches.

    Returns
    -------
    ndarray of int64, shape (<= count,)
        Matches, the best first.

    Examples
    --------
    >>> places = np.array([[0.0, 0, 0], [0.1, 0, 0], [5.0, 0, 0]])
    >>> distinct_matches(np.array([0.2, 0.3, 0.4]), places, radius=1.0)
    array([0, 2])
    """
    left = np.where(np.isfinite(distances), distances, np.inf)
    found: list[int] = []
    while len(found) < count and np.isfinite(left).any():
        best = int(np.argmin(left))
        found.append(best)
        with np.errstate(over="ignore"):  # coordinates of unreferenced vertices may be very large
            left[np.linalg.norm(places - places[best], axis=1) <= radius] = np.inf
    return np.array(found, dtype=np.int64)


def feature_distance(
    features: FeaturesLike, vertex: int, *, standardize: bool = True
) -> FloatArray:
    """Compute the distance of every vertex from a given vertex in feature space.

    `InputError` is raised if the vertex does not exist, or has no features.

    Parameters
    ----------
    features : Features or array_like, shape (n, f)
    vertex : int
        Vertex from which distances are measured.
    standardize : bool
        Divide each column by its spread over the mesh first (`column_spread`), so that all columns
        have equal weight and the distance is dimensionless.

    Returns
    -------
    ndarray of float64, shape (n,)
        0 at `vertex`; NaN at unreferenced vertices.

    Examples
    --------
    >>> features = [[0.0, 1.0], [3.0, 5.0], [0.0, 1.0]]
    >>> mv.feature_distance(features, 0, standardize=False)
    array([0., 5., 0.])
    """
    values = _values(features)
    check_vertex(vertex, len(values))
    if not np.isfinite(values[vertex]).all():
        raise InputError("vertex-unused", f"Vertex {vertex} has no features, as no face uses it")
    used = np.isfinite(values).all(axis=1)
    scale = column_spread(values[used]) if standardize else 1.0
    return np.asarray(np.linalg.norm((values - values[vertex]) / scale, axis=1), dtype=np.float64)


def _values(features: FeaturesLike) -> FloatArray:
    values = np.asarray(features, dtype=np.float64)
    if values.ndim != 2:
        raise wrong_shape("Features", values.shape, "one row per vertex, shape (n, f)")
    return values


def column_spread(values: FloatArray) -> FloatArray:
    """Return half the range between the 15.9th and the 84.1th percentile of each finite column.

    For normally distributed values this is the standard deviation, but it is not dominated by small
    components, whose features are thousands of times larger than the others. If two thirds of a
    column are one number, the result is the standard deviation; for a constant column it is 1.
    """
    rounding = 1e-12 * np.abs(values).max(axis=0, initial=0.0)
    low, high = np.percentile(values, (15.865525, 84.134475), axis=0)
    spread = np.where((high - low) / 2.0 > rounding, (high - low) / 2.0, values.std(axis=0))
    return np.where(spread > rounding, spread, 1.0)
