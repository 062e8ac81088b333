"""Comparison of two shapes: spectra, corresponding vertices and corresponding eigenfunctions.

The comparison is independent of size: eigenvalues are multiplied by the area of their mesh, and
features are computed for the shapes scaled to an area of 1.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, MeshWarning, not_carried
from meshmash_viewer.features import MATCHED_COLUMNS
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.features.functional_map import (
    AMBIGUOUS,
    FunctionalMap,
    functional_map,
    inverse_matches,
    zoomout,
)
from meshmash_viewer.features.shape import Matches, column_spread, distinct_matches, match_features
from meshmash_viewer.features.sums import Features, accumulate_features
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.alignment import Alignment, align_multiplets
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, EigenpairsLike, as_two_eigenpairs
from meshmash_viewer.structures import brain_side
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap

#: Squared correlation above which two eigenfunctions correspond; at most one can exceed it.
_SAME = 0.5
#: Relative difference up to which eigenvalues are equal.
_ROUNDING = 1e-6
#: Share of matched eigenfunctions below which a remark suggests ZoomOut.
_FEW = 0.5
#: Number of landmarks that a remark asks for.
_LANDMARKS = 3
#: Minimum number of nonzero eigenvalues for a comparison.
_FEWEST = 3
#: Name of the map of scores.
SCORE = "match score"


@dataclass(frozen=True, eq=False)
class FunctionMatches:
    """Eigenfunctions of a second shape that correspond to those of a first shape.

    Parameters
    ----------
    indices : ndarray of int64, shape (k,)
        Index of the function of the second; -1 if it is not determined: within multiplets, since
        any orthogonal combination of their functions is an eigenfunction, and where features do not
        distinguish the sides of a symmetric shape.
    signs : ndarray of float64, shape (k,)
        Factor of the function of the second, 1 or -1; 0 where `indices` is -1.
    correlations : ndarray of float64, shape (k,)
        Correlation of the matched functions, from 0 to about 1; above √½ if they correspond.
    rotations : Alignment
        Rotations within multiplets of the second, applied before the comparison; empty unless
        requested (`match_functions`).

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> pairs = mv.solve(*mv.cotangent_laplacian(box), 4)
    >>> found = match_functions(pairs, pairs, np.arange(len(box.vertices)))
    >>> found.indices, found.signs
    (array([0, 1, 2, 3]), array([1., 1., 1., 1.]))
    """

    indices: IntArray
    signs: FloatArray
    correlations: FloatArray
    rotations: Alignment = field(default_factory=Alignment)

    @property
    def determined(self) -> npt.NDArray[np.bool_]:
        """Whether the correspondence is determined, shape (k,)."""
        return np.asarray(self.indices >= 0)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Result of `compare_shapes`.

    Parameters
    ----------
    spectra : tuple of two ndarrays of float64, shape (k,)
        Eigenvalues times area.
    distance : float
        Euclidean distance of the two spectra, "Shape-DNA".
    forth, back : Matches
        Matches of the first shape in the second, and of the second in the first.
    mutual : ndarray of bool, shape (n,)
        Mask of the vertices of the first that are the match of their match.
    functions : FunctionMatches
        Matches of the eigenfunctions of the first in the second.
    features : tuple of two ndarrays of float32, shapes (n, f) and (m, f)
        Features used for matching, in units of their spread over the second.
    given : bool
        Whether corresponding vertices were given. They are then the matches, and scores are the
        distances of their features.
    functional : FunctionalMap, optional
        The refined functional map, if vertices were matched by one.

    Examples
    --------
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
    functional: FunctionalMap | None = None

    @property
    def relative_distance(self) -> float:
        """Distance divided by the norm of the first spectrum; infinite if the norm is zero."""
        length = float(np.linalg.norm(self.spectra[0]))
        if length == 0.0:
            return math.inf if self.distance > 0.0 else 0.0
        return self.distance / length

    @property
    def mutual_share(self) -> float:
        """Share of the matched vertices of the first that have a mutual match."""
        return float(self.mutual.sum() / max(np.count_nonzero(self.forth.indices >= 0), 1))

    @property
    def doubt(self) -> str:
        """Reason not to use the match of vertices, which is then not carried; "" for none.

        The functional map is ambiguous (`FunctionalMap.determined` below ⅔), or the vertices of the
        first match fewer different vertices of the second than a tenth of each shape.
        """
        if self.given:
            return ""
        if self.functional is not None and self.functional.ambiguous:
            return AMBIGUOUS
        n_first, n_second = (int((each.indices >= 0).sum()) for each in (self.forth, self.back))
        forth, back = self.forth.collapse(n_second), self.back.collapse(n_first)
        return forth or (f"of the second, {back}" if back else "")

    @property
    def is_moved_copy(self) -> bool:
        """Whether the second is a moved, scaled copy, matched by position."""
        return self.functional is not None and self.functional.rigid is not None

    def carried(self, maps: Sequence[VertexMap], *, back: bool = False) -> tuple[VertexMap, ...]:
        """Carry maps of the second to the first or, with `back`, maps of the first to the second.

        Each vertex gets the value or label of its match; without a match, NaN or no label.
        `InputError` is raised if the match is in `doubt`.

        Parameters
        ----------
        maps : sequence of VertexMap
        back : bool

        Returns
        -------
        tuple of VertexMap
            The carried maps, and a map of the scores of the matches; matches with small scores are
            more reliable.

        Examples
        --------
        >>> found = mv.compare_shapes(pairs, pairs)
        >>> height = mv.VertexMap("height", ball.vertices[:, 2])
        >>> carried, score = found.carried([height])
        >>> score.name, float(score.values.max())
        ('match score', 0.0)
        """
        if self.doubt:
            raise not_carried(self.doubt)
        matches = self.back if back else self.forth
        at, missing = matches.indices, matches.indices < 0
        carried = []
        for known in maps:
            values = known.values[at]
            values[missing] = known.no_label if known.labels else np.nan
            carried.append(VertexMap(known.name, values, known.labels, known.unit))
        return (*carried, VertexMap(SCORE, matches.scores))

    def match_table(self, second_name: str, second: Mesh | None = None) -> Features:
        """Return match, score and mutuality of each vertex of the first, shape (n, 3).

        If `second` is given, matches are indices in its file.
        """
        matches = self.forth.indices
        if second is not None:
            matches = np.where(matches >= 0, second.file_indices[matches], -1)
        columns = matches, self.forth.scores, self.mutual
        values = np.stack(columns, axis=1).astype(np.float64)
        names = (f"vertex_of_{second_name or 'second'}", "score", "mutual")
        return Features(values, names, kind="match")

    def best_matches(
        self, vertex: int, places: npt.NDArray[np.floating], radius: float, count: int = 4
    ) -> tuple[tuple[int, float], ...]:
        """Return vertices of the second most similar to one of the first, with their scores.

        The match is first. See `distinct_matches`; `places` are the vertices of the second.
        """
        mine, others = self.features
        distances = np.linalg.norm(others - mine[vertex], axis=1).astype(np.float64)
        is_match = np.arange(len(others)) == self.forth.indices[vertex]
        found = distinct_matches(np.where(is_match, -1.0, distances), places, radius, count)
        return tuple((int(each), float(distances[each])) for each in found)


@dataclass(frozen=True, eq=False)
class Correspondence:
    """Correspondence of one shape to another; unknown parts are None."""

    #: Length scale of the other relative to this shape.
    length: float = 1.0
    #: Corresponding vertex of the other shape for each vertex of this shape, or -1.
    vertices: IntArray | None = None
    functions: FunctionMatches | None = None

    def vertex(self, index: int) -> int | None:
        """Return the corresponding vertex of the other shape; None if it is not known."""
        if self.vertices is None or not 0 <= index < len(self.vertices):
            return None
        found = int(self.vertices[index])
        return found if found >= 0 else None


def unit_area_spectrum(pairs: Eigenpairs) -> FloatArray:
    """Compute eigenvalues of the shape scaled to an area of 1, dimensionless, shape (k,)."""
    return np.asarray(pairs.eigenvalues * pairs.mass.sum())


def matched_top(first: Eigenpairs, area: float) -> float:
    """Return the eigenvalue up to which a shape of a given area is compared with the first."""
    # rounding may increase the last eigenvalue of an equal shape
    return float(unit_area_spectrum(first)[-1]) * (1.0 + 1e-9) / area


def comparison_remarks(
    first: Mesh,
    second: Mesh,
    *,
    n_components: tuple[int, int] | None = None,
    found: Comparison | None = None,
    set_landmarks: str = "pin at least three corresponding places on both meshes",
    refine: str = "refine the match by ZoomOut",
) -> list[str]:
    """Return warnings about two meshes, and about their comparison `found`.

    `n_components` are the numbers of components of the meshes, if they are known already.
    `set_landmarks` and `refine` are the remedies; the default is those of the window.
    """
    remarks = []
    if first.unit != second.unit:
        units = f"{first.unit or 'no unit'} and {second.unit or 'no unit'}"
        remarks.append(f"the meshes are in {units}; the comparison is independent of size.")
    counts = n_components or (first.n_components, second.n_components)
    if counts[0] != counts[1]:
        remarks.append(
            f"the meshes have {counts[0]:,} and {counts[1]:,} components, each with an eigenvalue"
            " of zero, which shifts all others: merge components that touch, or compare the"
            " largest."
        )
    if found is None or found.given:
        return remarks
    refined, marks = found.functional is not None, 0
    if found.functional is not None:
        marks = found.functional.n_landmarks
    # only remedies that were not applied
    remedies = [set_landmarks] if marks < _LANDMARKS else []
    remedies += [] if refined else [refine]
    remedy = ", and ".join(remedies) or "match in another feature, or with more landmarks"
    sides = {brain_side(mesh.structure, mesh.name) for mesh in (first, second)}
    if sides == {"left", "right"} and not marks and (not refined or found.doubt):
        remarks.append(
            "the meshes are a left and a right hemisphere, whose folds differ, so a match without"
            f" landmarks is unreliable: {remedy}."
        )
        return remarks
    if found.doubt:
        return [*remarks, f"{found.doubt}, so the match is not carried: {remedy}."]
    if found.functional is not None:
        return [*remarks, found.functional.remark] if found.functional.remark else remarks
    n_matched, total = int(found.functions.determined.sum()), len(found.functions.indices)
    if n_matched < _FEW * total:
        remarks.append(
            f"only {n_matched:,} of {counted(total, 'eigenfunction')} can be matched by features"
            f" alone: {refine}."
        )
    return remarks


def corresponding_vertices(first: MeshLike, second: MeshLike) -> IntArray | None:
    """Return the corresponding vertices of two meshes with the same connectivity.

    Their faces join the same vertices, in any orientation (as in a mirror image). Examples are a
    rotated, scaled or deformed mesh, two subjects on one template, and parts of such meshes
    (`Mesh.masked`). An equal number of vertices is not sufficient. Left and right hemispheres (by
    `Mesh.structure` or name) are mirror images: with faces of the same orientation, as in
    FreeSurfer's fsaverage, equal indices are at different places, and the result is None.

    Returns
    -------
    ndarray of int64, shape (n,), or None
        The indices ``0, 1, …, n - 1``; None if vertices have to be matched.

    Examples
    --------
    >>> ball, other = trimesh.creation.icosphere(1), trimesh.creation.icosphere(1, radius=2.0)
    >>> first, second = (mv.Mesh(each.vertices, each.faces) for each in (ball, other))
    >>> mv.corresponding_vertices(first, second)[:4]
    array([0, 1, 2, 3])
    """
    first, second = as_mesh(first), as_mesh(second)
    if first.n_vertices != second.n_vertices:
        return None
    faces = _faces_on(first, second), _faces_on(second, first)
    same = (
        faces[0].shape == faces[1].shape
        and len(faces[0]) > 0
        and np.array_equal(np.sort(faces[0], axis=1), np.sort(faces[1], axis=1))
        and not _hemispheres_of_one_orientation(first, second, faces)
    )
    return np.arange(first.n_vertices) if same else None


def _faces_on(mesh: Mesh, other: Mesh) -> IntArray:
    """Return the faces of a mesh or, if `other` is a part of the mesh, the faces of this part."""
    if len(mesh.faces) <= len(other.faces):
        return mesh.faces
    kept: IntArray = mesh.faces[other.referenced[mesh.faces].all(axis=1)]
    return kept


def _hemispheres_of_one_orientation(
    first: Mesh, second: Mesh, faces: tuple[IntArray, IntArray]
) -> bool:
    """Whether the meshes are a left and a right hemisphere with faces of the same orientation."""
    sides = {brain_side(mesh.structure, mesh.name) for mesh in (first, second)}
    if sides != {"left", "right"}:
        return False
    odd, other = ((a > b) ^ (b > c) ^ (a > c) for a, b, c in (each.T for each in faces))
    return bool(np.mean(odd == other) > 0.5)


def check_comparable(name: str, n_vertices: int, eigenvalues: FloatArray) -> None:
    """Raise `InputError` for a mesh with too few nonzero eigenvalues for a comparison."""
    above = int(np.count_nonzero(eigenvalues > 0.0))
    if above < _FEWEST:
        raise InputError(
            "too-few-pairs",
            f"{name or 'A mesh'} of {counted(n_vertices, 'vertex')} has"
            f" {counted(above, 'nonzero eigenvalue')}, too few for a comparison",
            "compute more, or give a mesh with more vertices",
        )


def compare_shapes(
    first: EigenpairsLike,
    second: EigenpairsLike,
    bank: FilterBank | None = None,
    cancel: CancelCallback | None = None,
    vertices: npt.ArrayLike | None = None,
    *,
    refine: bool = False,
    landmarks: npt.ArrayLike = (),
    meshes: tuple[MeshLike, MeshLike] | None = None,
    warn: bool = True,
) -> Comparison:
    """Compare two shapes by their eigenpairs.

    Parameters
    ----------
    first, second : Eigenpairs
        Eigenpairs up to about the same eigenvalue times area; excess pairs of a shape are ignored.
    bank : FilterBank, optional
        Filters of the features that match vertices, for eigenvalues times area. Default: the wave
        kernel signature with 100 energies in the spectrum of the first.
    cancel : callable, optional
        Called while vertices are matched; `Cancelled` is raised if it returns True.
    vertices : array_like of int, shape (n,), optional
        Corresponding vertex of the second for each vertex of the first, -1 for none, if known
        (`corresponding_vertices`). Eigenfunctions are matched with these vertices, after rotations
        within multiplets (`FunctionMatches.rotations`).
    refine : bool
        Whether to match vertices by a functional map, not by the nearest features alone. The map is
        estimated from the features and the `landmarks` (`functional_map`), and refined with up to
        150 eigenfunctions (`zoomout`). Scores are then distances in the space of eigenfunctions.
    landmarks : array_like of int, shape (p, 2), optional
        With `refine`: corresponding vertices of the first and the second.
    meshes : tuple of two MeshLike, optional
        With `refine`: the two meshes, so that left and right are distinguished by the orientation
        of faces, and a moved, scaled copy is matched by position.
    warn : bool
        Whether a match in doubt (`Comparison.doubt`) causes a `MeshWarning`.

    Returns
    -------
    Comparison
        The spectral distance is that of Reuter, Wolter and Peinecke (2006). Vertices are
        matched by the nearest features, with each column divided by its spread. On a symmetric
        shape, corresponding vertices of both sides are equally near, and either may be found.

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
    first, second = as_two_eigenpairs("compare_shapes(first, second)", first, second, meshes)
    count = min(len(first.eigenvalues), len(second.eigenvalues))
    spectra = unit_area_spectrum(first)[:count], unit_area_spectrum(second)[:count]
    if bank is None:
        bank = wave_kernel_bank(spectra[0], MATCHED_COLUMNS)
    # rounding may move the last eigenvalue outside of all bands
    top = spectra[0][-1]
    forth_features, back_features = (
        accumulate_features(
            each.rows[:count], bank(np.where(np.isclose(values, top, rtol=_ROUNDING), top, values))
        )
        * each.mass.sum()
        for each, values in zip((first, second), spectra, strict=True)
    )
    spread = column_spread(back_features[np.isfinite(back_features).all(axis=1)])
    mine, others = forth_features / spread, back_features / spread
    functional = None
    if vertices is None and refine:
        start = functional_map(first, second, bank, landmarks=landmarks, meshes=meshes)
        functional = zoomout(first, second, start, cancel=cancel, meshes=meshes)
        forth = functional.matches
        back = inverse_matches(first, second, functional, cancel, meshes)
    elif vertices is None:
        forth = match_features(forth_features, back_features, standardize=True, cancel=cancel)
        back = match_features(back_features, forth_features, standardize=True, cancel=cancel)
    else:
        there = _checked_vertices(vertices, first, second)
        inverse = np.full(len(second.mass), -1, dtype=np.int64)
        inverse[there[there >= 0]] = np.flatnonzero(there >= 0)
        forth = _given_matches(there, mine, others)
        back = _given_matches(inverse, others, mine)
    found = forth.indices >= 0
    mutual = np.zeros(len(found), dtype=np.bool_)
    mutual[found] = back.indices[forth.indices[found]] == np.flatnonzero(found)
    result = Comparison(
        spectra,
        float(np.linalg.norm(spectra[0] - spectra[1])),
        forth,
        back,
        mutual,
        match_functions(first, second, forth.indices, turned=vertices is not None),
        (mine.astype(np.float32), others.astype(np.float32)),
        given=vertices is not None,
        functional=functional,
    )
    if warn and result.doubt:
        warnings.warn(f"The match is unreliable: {result.doubt}.", MeshWarning, stacklevel=2)
    return result


def _given_matches(indices: IntArray, mine: FloatArray, others: FloatArray) -> Matches:
    """Return known matches, with the distances of their features as scores.

    Scores are NaN outside of a mask, where there are no features.
    """
    scores = np.linalg.norm(mine - others[indices], axis=1)
    rows = np.flatnonzero((indices >= 0) & np.isfinite(scores))
    found = Matches.of(len(indices), rows, indices[rows], scores[rows])
    found.indices[:] = indices
    return found


def _checked_vertices(vertices: npt.ArrayLike, first: Eigenpairs, second: Eigenpairs) -> IntArray:
    there = np.asarray(vertices)
    n_first, n_second = len(first.mass), len(second.mass)
    if there.shape != (n_first,) or there.min(initial=0) < -1 or there.max(initial=0) >= n_second:
        remedy = f"give for each of {n_first} vertices one of {n_second}, counted from 0, or -1"
        raise InputError("vertex-out-of-range", "Matches name vertices that do not exist", remedy)
    return there


def match_functions(
    first: EigenpairsLike, second: EigenpairsLike, vertices: npt.ArrayLike, *, turned: bool = False
) -> FunctionMatches:
    """Match the eigenfunctions of one shape to those of another, with their signs.

    Parameters
    ----------
    first, second : Eigenpairs
        Eigenpairs of the shapes, k and l pairs.
    vertices : array_like of int, shape (n,)
        Corresponding vertex of the second for each vertex of the first, -1 for none:
        ``0, 1, …, n - 1`` for two meshes of the same vertices, or matches by features.
    turned : bool
        Whether functions within a multiplet of the second, which are determined up to a rotation,
        are rotated to match the first; see `FunctionMatches.rotations`.

    Returns
    -------
    FunctionMatches
        One-to-one matches with the largest sum of squared correlations.

    Raises
    ------
    InputError
        If a vertex does not exist.

    Examples
    --------
    >>> box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide()
    >>> turn = trimesh.transformations.rotation_matrix(1.0, [0.0, 0.0, 1.0])
    >>> turned = box.copy().apply_transform(turn)
    >>> first, second = (mv.solve(*mv.cotangent_laplacian(mesh), 4) for mesh in (box, turned))
    >>> match_functions(first, second, np.arange(len(box.vertices))).indices
    array([0, 1, 2, 3])
    """
    from scipy.optimize import linear_sum_assignment

    first, second = as_two_eigenpairs("match_functions(first, second, vertices)", first, second)
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
