"""Two shapes side by side: their spectra, which vertex is which, and which eigenfunction is which.

Size does not count: eigenvalues are multiplied by the area of their mesh, and features are those of
the two shapes at an area of 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.features.shape import Matches, column_spread, match_features
from meshmash_viewer.features.sums import Features, accumulate_features
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.alignment import Alignment, align_multiplets
from meshmash_viewer.units import counted

__all__ = [
    "Comparison",
    "Correspondence",
    "Eigenpairs",
    "FunctionMatches",
    "check_comparable",
    "compare_shapes",
    "comparison_remarks",
    "corresponding_vertices",
    "distinct_matches",
    "match_functions",
    "matched_top",
    "unit_area_spectrum",
]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

#: Square of the correlation from which two eigenfunctions are the same one: no third can have it.
_SAME = 0.5
#: Relative difference of eigenvalues that are the same.
_ROUNDING = 1e-6
#: Share of known matches to call confident.
_CONFIDENT = 0.1
#: Energies of the default signature.
_ENERGIES = 100
#: Fewest eigenvalues above zero that say something of a shape.
_FEWEST = 3


class Eigenpairs(Protocol):
    """What is compared of a shape: a `Decomposition` has it, and others who know its pairs."""

    @property
    def eigenvalues(self) -> FloatArray:
        """Ascending, shape (k,)."""

    @property
    def rows(self) -> Any:
        """Eigenvectors, one a row, shape (>= k, n)."""

    @property
    def mass(self) -> FloatArray:
        """Area of each vertex, shape (n,)."""


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
    rotations : Alignment
        Rotations within multiplets of the other after which all this holds; none unless they were
        asked for (`match_functions`).

    Examples
    --------
    >>> import trimesh
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 4)
    >>> found = mv.match_functions(pairs, pairs, np.arange(len(box.vertices)))
    >>> found.indices, found.signs
    (array([0, 1, 2, 3]), array([1., 1., 1., 1.]))
    """

    indices: IntArray
    signs: FloatArray
    correlations: FloatArray
    rotations: Alignment = field(default_factory=Alignment)

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
    features : tuple of two ndarrays of float32, shapes (n, f) and (m, f)
        In which vertices are matched, in units of their spread over the second.
    given : bool
        Whether it was known which vertex is which: matches are those then, and their scores say
        how far apart features are.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(3)
    >>> L, M = mv.cotangent_laplacian(ball)
    >>> pairs = mv.solve(L, M, 16)
    >>> found = mv.compare_shapes(pairs, pairs)
    >>> found.distance, bool(found.mutual.all())
    (0.0, True)
    """

    spectra: tuple[FloatArray, FloatArray]
    distance: float
    forth: Matches
    back: Matches
    mutual: npt.NDArray[np.bool_]
    functions: FunctionMatches
    features: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]
    given: bool = False

    @property
    def relative_distance(self) -> float:
        """The distance beside the length of the first spectrum; infinite beside zeros alone."""
        length = float(np.linalg.norm(self.spectra[0]))
        if length == 0.0:
            return math.inf if self.distance > 0.0 else 0.0
        return self.distance / length

    @property
    def mutual_share(self) -> float:
        """Share of the vertices of the first with features that find themselves again."""
        return float(self.mutual.sum() / max(np.count_nonzero(self.forth.indices >= 0), 1))

    def match_table(self, second_name: str, second: Mesh | None = None) -> Features:
        """For each vertex of the first its match, the score, and whether it is mutual, (n, 3).

        Matches are by their index in the file of `second`, where that is given.
        """
        matches = self.forth.indices
        if second is not None:
            matches = np.where(matches >= 0, second.file_indices[matches], -1)
        columns = matches, self.forth.scores, self.mutual
        values = np.stack([np.asarray(each, dtype=np.float64) for each in columns], axis=1)
        names = (f"vertex_of_{second_name or 'second'}", "score", "mutual")
        return Features(values, names, kind="match")

    def best_matches(
        self, vertex: int, places: npt.NDArray[np.floating], radius: float, count: int = 4
    ) -> tuple[tuple[int, float], ...]:
        """Vertices of the second that look most like one of the first, with their scores.

        The match comes first. See `distinct_matches` for `places` of the second, `radius` and
        `count`.
        """
        mine, others = self.features
        distances = np.linalg.norm(others - mine[vertex], axis=1).astype(np.float64)
        ranked, match = distances.copy(), self.forth.indices[vertex]
        if match >= 0:
            ranked[match] = -1.0
        found = distinct_matches(ranked, places, radius, count)
        return tuple((int(each), float(distances[each])) for each in found)


@dataclass(frozen=True, eq=False)
class Correspondence:
    """What of one shape is what of another.

    Parameters
    ----------
    length : float
        A length of the other by the same of this.
    vertices : ndarray of int64, shape (n,), optional
        For each vertex of this the same one of the other, or -1.
    functions : FunctionMatches, optional
        The same of eigenfunctions.
    """

    length: float = 1.0
    vertices: IntArray | None = None
    functions: FunctionMatches | None = None

    def vertex(self, index: int) -> int | None:
        """The vertex of the other that one of this is; None where it cannot be told."""
        if self.vertices is None or not 0 <= index < len(self.vertices):
            return None
        found = int(self.vertices[index])
        return found if found >= 0 else None


def unit_area_spectrum(pairs: Eigenpairs) -> FloatArray:
    """Eigenvalues of the shape at an area of 1, pure numbers, shape (k,)."""
    return np.asarray(pairs.eigenvalues * pairs.mass.sum())


def matched_top(first: Eigenpairs, area: float) -> float:
    """Eigenvalue of a shape of some area up to which it is compared with the first; 0 for none."""
    # a copy's last eigenvalue may be larger by rounding
    return float(unit_area_spectrum(first)[-1]) * (1.0 + 1e-9) / area


def comparison_remarks(first: Mesh, second: Mesh) -> list[str]:
    """What to know of two meshes before one trusts the figures."""
    remarks = []
    if first.unit != second.unit:
        units = f"{first.unit or 'no unit'} and {second.unit or 'no unit'}"
        remarks.append(f"the meshes are in {units}; sizes do not count, only shapes do.")
    counts = first.n_components, second.n_components
    if counts[0] != counts[1]:
        remarks.append(
            f"the meshes have {counts[0]:,} and {counts[1]:,} components, each with an eigenvalue"
            " of zero, which moves all others: compare their largest ones."
        )
    return remarks


def corresponding_vertices(first: Mesh, second: Mesh) -> IntArray | None:
    """For each vertex of one mesh the same one of another, where both are of one template.

    That is where their faces join the same vertices, be they turned round as in a mirror image: a
    mesh that was turned, scaled or deformed, or two subjects on one template. As many vertices
    alone say nothing.

    Returns
    -------
    ndarray of int64, shape (n,), or None
        All in order; None where vertices have to be matched.

    Examples
    --------
    >>> import trimesh
    >>> ball, other = trimesh.creation.icosphere(1), trimesh.creation.icosphere(1, radius=2.0)
    >>> first, second = (mv.Mesh(each.vertices, each.faces) for each in (ball, other))
    >>> mv.corresponding_vertices(first, second)[:4]
    array([0, 1, 2, 3])
    """
    same = (
        first.n_vertices == second.n_vertices
        and first.faces.shape == second.faces.shape
        and np.array_equal(np.sort(first.faces, axis=1), np.sort(second.faces, axis=1))
    )
    return np.arange(first.n_vertices) if same else None


def check_comparable(name: str, n_vertices: int, eigenvalues: FloatArray) -> None:
    """Complain of a mesh with too few eigenvalues above zero to say something of a shape."""
    above = int(np.count_nonzero(eigenvalues > 0.0))
    if above < _FEWEST:
        raise InputError(
            f"{name or 'A mesh'} has {counted(above, 'eigenvalue')} above zero to be compared, of"
            f" {counted(n_vertices, 'vertex')}: compute more, or give a mesh of more vertices."
        )


def compare_shapes(
    first: Eigenpairs,
    second: Eigenpairs,
    bank: FilterBank | None = None,
    cancel: CancelCallback | None = None,
    vertices: npt.ArrayLike | None = None,
) -> Comparison:
    """Compare two shapes by their eigenpairs.

    Parameters
    ----------
    first, second : Eigenpairs
        Both up to about the same eigenvalue times area; what one has more is left out.
    bank : FilterBank, optional
        Filters for eigenvalues times area, in whose columns vertices are matched: by default the
        wave kernel signature of 100 energies of the first.
    cancel : callable, optional
        Asked while vertices are matched; `Cancelled` is raised if it says so.
    vertices : array_like of int, shape (n,), optional
        For each vertex of the first the same one of the second, -1 where there is none, if that is
        known (`corresponding_vertices`). Eigenfunctions are told by it then, those of a multiplet
        after it has been turned (`FunctionMatches.rotations`).

    Returns
    -------
    Comparison
        The spectral distance is that of Reuter, Wolter and Peinecke (2006). Vertices are matched by
        the nearest features, each column in units of its spread; on a symmetric shape those of
        either side are as near, and only one is found.

    Raises
    ------
    InputError
        If there are too few eigenpairs for the filters, or a vertex does not exist.

    Examples
    --------
    >>> from meshmash_viewer.samples import sample_path
    >>> mesh = mv.read_mesh(sample_path("dendrite"))
    >>> L, M = mv.cotangent_laplacian(mesh, robust=True)
    >>> pairs = mv.solve(L, M, 20)
    >>> mv.compare_shapes(pairs, pairs).distance
    0.0
    """
    count = min(len(first.eigenvalues), len(second.eigenvalues))
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
    spread = column_spread(back_features[np.isfinite(back_features).all(axis=1)])
    if vertices is None:
        forth = match_features(forth_features, back_features, standardize=True, cancel=cancel)
        back = match_features(back_features, forth_features, standardize=True, cancel=cancel)
    else:
        there = _checked_vertices(vertices, first, second)
        inverse = np.full(len(second.mass), -1, dtype=np.int64)
        inverse[there[there >= 0]] = np.flatnonzero(there >= 0)
        forth = _given_matches(there, forth_features / spread, back_features / spread)
        back = _given_matches(inverse, back_features / spread, forth_features / spread)
    found = forth.indices >= 0
    mutual = np.zeros(len(found), dtype=np.bool_)
    mutual[found] = back.indices[forth.indices[found]] == np.flatnonzero(found)
    return Comparison(
        spectra,
        float(np.linalg.norm(spectra[0] - spectra[1])),
        forth,
        back,
        mutual,
        match_functions(first, second, forth.indices, turned=vertices is not None),
        (
            (forth_features / spread).astype(np.float32),
            (back_features / spread).astype(np.float32),
        ),
        given=vertices is not None,
    )


def _given_matches(indices: IntArray, mine: FloatArray, others: FloatArray) -> Matches:
    """Known matches, with how far apart the features of the two are."""
    scores = np.linalg.norm(mine - others[indices], axis=1)
    scores[indices < 0] = np.nan
    known = np.where(np.isfinite(scores), indices, -1)
    confident = scores <= np.nanquantile(scores, _CONFIDENT)
    return Matches(known, scores, confident, _CONFIDENT)


def _checked_vertices(vertices: npt.ArrayLike, first: Eigenpairs, second: Eigenpairs) -> IntArray:
    there = np.asarray(vertices)
    n_first, n_second = len(first.mass), len(second.mass)
    if there.shape != (n_first,) or there.min(initial=0) < -1 or there.max(initial=0) >= n_second:
        raise InputError(
            f"Give for each of {n_first} vertices one of {n_second}, counted from 0, or -1."
        )
    return there


def match_functions(
    first: Eigenpairs, second: Eigenpairs, vertices: npt.ArrayLike, *, turned: bool = False
) -> FunctionMatches:
    """Tell which eigenfunction of one shape is which of another, and with which sign.

    Parameters
    ----------
    first, second : Eigenpairs
        With k and l pairs.
    vertices : array_like of int, shape (n,)
        For each vertex of the first the same one of the second, -1 where there is none: all in
        order for two meshes of the same vertices, or what features have matched.
    turned : bool
        Whether functions within a multiplet of the second, which any rotation leaves as good, are
        turned to be those of the first; `FunctionMatches.rotations` says how.

    Returns
    -------
    FunctionMatches
        One to one, of the greatest sum of squared correlations.

    Raises
    ------
    InputError
        If a vertex does not exist.

    Examples
    --------
    >>> import trimesh
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> turn = trimesh.transformations.rotation_matrix(1.0, [0.0, 0.0, 1.0])
    >>> turned = box.copy().apply_transform(turn)
    >>> first, second = (mv.solve(*mv.cotangent_laplacian(mesh), 4) for mesh in (box, turned))
    >>> mv.match_functions(first, second, np.arange(len(box.vertices))).indices
    array([0, 1, 2, 3])
    """
    from scipy.optimize import linear_sum_assignment

    there = _checked_vertices(vertices, first, second)
    used = (there >= 0) & (first.mass > 0.0)
    used[used] = second.mass[there[used]] > 0.0
    weights = first.mass[used]
    here = np.asarray(first.rows[: len(first.eigenvalues)])[:, used]
    carried = np.asarray(second.rows[: len(second.eigenvalues)])[:, there[used]]
    rotations = Alignment()
    if turned:
        rotations = align_multiplets(here, carried, second.eigenvalues, weights)
        for start, matrix in rotations.blocks:
            some = slice(start, start + len(matrix))
            carried[some] = matrix @ carried[some]
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
    return FunctionMatches(indices, signs, best, rotations)


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

    Examples
    --------
    >>> places = np.array([[0.0, 0, 0], [0.1, 0, 0], [5.0, 0, 0]])
    >>> mv.distinct_matches(np.array([0.2, 0.3, 0.4]), places, radius=1.0)
    array([0, 2])
    """
    left = np.where(np.isfinite(distances), distances, np.inf)
    found: list[int] = []
    while len(found) < count and np.isfinite(left).any():
        best = int(np.argmin(left))
        found.append(best)
        with np.errstate(over="ignore"):  # a vertex of no face may be anywhere
            left[np.linalg.norm(places - places[best], axis=1) <= radius] = np.inf
    return np.array(found, dtype=np.int64)
