"""Curvatures of a surface, and widths of the necks of its parts."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.surface.edges import edges_of, side_codes, winding_of
from meshmash_viewer.units import counted

#: Key of the result of `direction_fault` in `Mesh.derived`.
DIRECTION_FAULT = "fault of directions"


def mean_curvature(mesh: MeshLike) -> FloatArray:
    """Compute the mean curvature, half the sum of the two principal curvatures.

    ``H = ½ (L x) · n / A`` with the cotangent Laplacian L of the coordinates x, the vertex normal
    n and the mixed area A of Meyer et al. [1]_. H is 1/r on a sphere of radius r, and positive
    where the surface is convex, seen from the side on which its faces are counter-clockwise.

    `InputError` is raised if the mesh is not valid.

    Parameters
    ----------
    mesh : MeshLike
        The mesh, with consistently oriented faces, which determine the sign. At an edge with
        inconsistent faces, vertex normals and curvatures are wrong.

    Returns
    -------
    ndarray of float64, shape (n,)
        In inverse units of length. NaN on the boundary and at vertices without faces. Faces without
        area are ignored.

    Warns
    -----
    MeshWarning
        If neighbouring faces are inconsistently oriented, see `direction_fault`.

    References
    ----------
    .. [1] Meyer, M., Desbrun, M., Schröder, P. and Barr, A. (2003). "Discrete Differential-Geometry
       Operators for Triangulated 2-Manifolds." Visualization and Mathematics III.

    Examples
    --------
    >>> float(np.median(mv.mean_curvature(ball)).round(2))
    1.0
    """
    mesh = as_mesh(mesh)
    if fault := direction_fault(mesh):
        warnings.warn(fault, MeshWarning, stacklevel=2)
    corners = _Corners(mesh)
    bend = np.zeros((mesh.n_vertices, 3))
    for corner in range(3):
        # the cotangent of an angle is the weight of the opposite edge
        first, second = (corner + 1) % 3, (corner + 2) % 3
        pull = (0.5 * corners.cotangents[:, corner])[:, None] * corners.edge(first, second)
        for axis in range(3):
            bend[:, axis] -= np.bincount(corners.faces[:, first], pull[:, axis], mesh.n_vertices)
            bend[:, axis] += np.bincount(corners.faces[:, second], pull[:, axis], mesh.n_vertices)
    along = np.einsum("ij,ij->i", bend, mesh.vertex_normals)
    return corners.inside(0.5 * along)


def direction_fault(mesh: Mesh) -> str:
    """Return a message about inconsistently oriented faces; "" if there are none."""
    if DIRECTION_FAULT not in mesh.derived:
        mesh.derived[DIRECTION_FAULT] = _direction_fault(mesh)
    return str(mesh.derived[DIRECTION_FAULT])


def _direction_fault(mesh: Mesh) -> str:
    winding = winding_of(mesh)
    if not len(winding.one_way):
        return ""
    name = f"{mesh.name}: f" if mesh.name else "F"
    remedy = (
        "make them agree by the repair orient_faces first"
        if winding.reversed_faces.any()
        else "the surface has one side only, so no repair makes them agree"
    )
    return (
        f"{name}aces do not agree on which side is outside at"
        f" {counted(len(winding.one_way), 'edge')}, so the mean curvature has the wrong sign"
        f" on some, and is wrong next to these edges: {remedy}."
    )


def gaussian_curvature(mesh: MeshLike) -> FloatArray:
    """Compute the Gaussian curvature, the product of the two principal curvatures.

    ``K = (2π - Σ θ) / A`` with the angles θ of the faces around a vertex and its mixed area A
    (`mixed_areas`): 1/r² on a sphere of radius r, negative on a saddle. The sum of K A over a
    closed surface is exactly 2π times its Euler characteristic.

    Returns
    -------
    ndarray of float64, shape (n,)
        In inverse squared units of length; NaN on the boundary and at vertices without faces.

    Examples
    --------
    >>> float(np.median(mv.gaussian_curvature(ball)).round(2))
    1.0
    """
    mesh = as_mesh(mesh)
    corners = _Corners(mesh)
    angles = np.arctan2(1.0, corners.cotangents)
    around = np.bincount(corners.faces.ravel(), angles.ravel(), mesh.n_vertices)
    return corners.inside(np.asarray(2.0 * np.pi - around))


def mixed_areas(mesh: MeshLike) -> FloatArray:
    """Compute the mixed area of each vertex, the divisor in curvatures (`mean_curvature`).

    A face without an obtuse angle is divided into the points nearest to each of its vertices. Of an
    obtuse face, the vertex at the obtuse angle gets a half, the other vertices a quarter each.
    (`compute_vertex_areas` assigns a third of each face to each of its vertices.)

    Returns
    -------
    ndarray of float64, shape (n,)
        In squared units of length; their sum is the area of the mesh. 0 at vertices without faces.

    Examples
    --------
    >>> corners = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> mixed_areas((corners, [[0, 1, 2], [0, 2, 3]]))
    array([1., 1., 1., 1.])
    """
    return _Corners(as_mesh(mesh)).mixed_areas()


class _Corners:
    """Faces that have an area, and the cotangents of their angles, shape (m, 3) each."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.faces = mesh.faces[~mesh.degenerate_faces]
        self._places = [mesh.vertices[self.faces[:, corner]] for corner in range(3)]
        self._doubled = np.linalg.norm(np.cross(self.edge(0, 1), self.edge(0, 2)), axis=1)
        # the cotangent of the angle at each corner: dot product over cross product of its edges
        self.cotangents = np.column_stack(
            [
                np.einsum("ij,ij->i", self.edge(a, (a + 1) % 3), self.edge(a, (a + 2) % 3))
                / self._doubled
                for a in range(3)
            ]
        )

    def edge(self, start: int, end: int) -> FloatArray:
        """Return the vectors from one corner of each face to another, shape (m, 3)."""
        return np.asarray(self._places[end] - self._places[start])

    def inside(self, totals: FloatArray) -> FloatArray:
        """Divide totals by the mixed area of each vertex; NaN on the boundary."""
        areas = self.mixed_areas()
        open_ends = self._on_boundary() | (areas <= 0.0)
        return np.where(open_ends, np.nan, totals / np.where(open_ends, 1.0, areas))

    def mixed_areas(self) -> FloatArray:
        """Compute the mixed areas, shape (n,); see the function `mixed_areas`."""
        obtuse = self.cotangents < 0.0
        shares = np.empty_like(self.cotangents)
        for corner in range(3):
            first, second = (corner + 1) % 3, (corner + 2) % 3
            sides = ((first, second), (second, first))
            shares[:, corner] = sum(
                self.cotangents[:, opposite] * np.square(self.edge(corner, end)).sum(axis=1) / 8.0
                for end, opposite in sides
            )
        halves = np.where(obtuse, 0.25, 0.125) * self._doubled[:, None]
        shares = np.where(np.any(obtuse, axis=1, keepdims=True), halves, shares)
        total = np.bincount(self.faces.ravel(), shares.ravel(), self._mesh.n_vertices)
        return np.asarray(total, dtype=np.float64)

    def _on_boundary(self) -> npt.NDArray[np.bool_]:
        """Find the vertices of edges with one face, shape (n,)."""
        n = self._mesh.n_vertices
        edges = edges_of(side_codes(self.faces, n))
        single = edges.keys[edges.counts == 1]
        on_it = np.zeros(n, dtype=np.bool_)
        on_it[single // n] = on_it[single % n] = True
        return on_it


#: Number of level sets that are measured for each part.
_LEVELS = 64
#: Share of the area of a part, measured from the rest of the surface, in which cuts are sought.
_NEAR = 0.5
#: Relative residual and largest number of iterations of the linear solver.
_PRECISION, _STEPS = 1e-7, 10_000


def neck_widths(mesh: Mesh, parts: IntArray, n_parts: int) -> FloatArray:
    """Measure the length of a short cut that separates each part from the rest of the surface.

    The cuts are 64 level sets of a function that is 1 on the rest, 0 on the half of the area of the
    part that is farthest from the rest along edges, and harmonic on the nearer half. A level set
    consists of closed curves, or of curves that end at open edges. The shortest level set is an
    upper bound of the shortest cut through the nearer half of the part.

    `parts`, shape (n,), is the part of each vertex, -1 for none. The widths, shape (n_parts,), are
    in the unit of the mesh; NaN for a part that does not touch the rest.
    """
    of_corners = parts[mesh.faces]
    touched = (of_corners >= 0).any(axis=1) & mesh.distinct_corners
    joins = touched & (of_corners != of_corners[:, :1]).any(axis=1)
    joined = np.zeros(n_parts + 1, dtype=np.bool_)
    joined[of_corners[joins]] = True
    joined[-1] = False  # set above by vertices in no part, whose index is -1
    widths = np.full(n_parts, np.nan)
    if joined.any():
        faces = mesh.faces[touched & joined[of_corners].any(axis=1)]
        parts = np.where(joined[parts], parts, -1)
        near = _near(mesh, faces, parts)
        values = _harmonic(mesh, faces[near[faces].any(axis=1)], parts, near)
        lengths = _cut_lengths(mesh.vertices, faces, parts, values, n_parts)
        widths[joined[:-1]] = lengths[joined[:-1]]
    return widths


def _near(mesh: Mesh, faces: IntArray, parts: IntArray) -> npt.NDArray[np.bool_]:
    """Return a mask of the half of each part that is nearest to the rest, shape (n,)."""
    from scipy import sparse
    from scipy.sparse.csgraph import dijkstra

    n = mesh.n_vertices
    low, high = np.divmod(np.unique(side_codes(faces, n) >> 1), n)
    lengths = np.linalg.norm(mesh.vertices[low] - mesh.vertices[high], axis=1)
    lengths = np.maximum(lengths, np.finfo(np.float64).tiny)  # sparse graphs drop edges of length 0
    within = parts[low] == parts[high]
    # Node n stands for the rest of the surface, with an edge to each vertex at a border.
    ends, across = np.append(low[~within], high[~within]), np.tile(lengths[~within], 2)
    nearest = np.full(n, np.inf)
    np.minimum.at(nearest, ends, across)
    border = np.flatnonzero(np.isfinite(nearest) & (parts >= 0))
    rows = np.concatenate([low[within], high[within], np.full(len(border), n)])
    columns = np.concatenate([high[within], low[within], border])
    weights = np.concatenate([lengths[within], lengths[within], nearest[border]])
    graph = sparse.csr_array((weights, (rows, columns)), shape=(n + 1, n + 1))
    distances = dijkstra(graph, indices=[n])[0, :n]

    inside = np.flatnonzero(parts >= 0)
    order = inside[np.lexsort((distances[inside], parts[inside]))]
    areas, of_part = mesh.vertex_areas[order], parts[order]
    total = np.bincount(of_part, areas)
    before = np.cumsum(total) - total
    near = np.zeros(n, dtype=np.bool_)
    nearest_half = np.cumsum(areas) - before[of_part] <= _NEAR * total[of_part]
    near[order] = nearest_half & (areas > 0.0)  # faces without area have no Laplacian
    return near


def _harmonic(
    mesh: Mesh, faces: IntArray, parts: IntArray, near: npt.NDArray[np.bool_]
) -> FloatArray:
    """Compute the harmonic function of `neck_widths` at near vertices, 0 elsewhere, shape (n,)."""
    from scipy import sparse
    from scipy.sparse.linalg import cg

    from meshmash_viewer.laplacian import cotangent_laplacian

    values = np.zeros(mesh.n_vertices)
    unknown = np.flatnonzero(near)
    if len(unknown):
        around = mesh.vertices, faces
        rows = cotangent_laplacian(around, robust=True)[0].tocsr()[unknown].tocoo()
        other = parts[unknown[rows.row]] != parts[rows.col]
        known = -np.bincount(rows.row[other], rows.data[other], len(unknown))
        place = np.full(mesh.n_vertices, -1)
        place[unknown] = np.arange(len(unknown))
        kept = ~other & near[rows.col]
        matrix = sparse.csr_array(
            (rows.data[kept], (rows.row[kept], place[rows.col[kept]])), shape=(len(unknown),) * 2
        )
        scale = sparse.diags_array(1.0 / matrix.diagonal())
        # level sets of any function are cuts, so the bound holds even without convergence
        values[unknown] = cg(matrix, known, rtol=_PRECISION, maxiter=_STEPS, M=scale)[0]
    return values


def _cut_lengths(
    vertices: FloatArray, faces: IntArray, parts: IntArray, values: FloatArray, n_parts: int
) -> FloatArray:
    """Return the length of the shortest level set in each part, shape (n_parts,)."""
    cuts = []
    of_corners = parts[faces]
    for corner in range(3):  # each face once for each part that it touches
        own = of_corners[:, corner]
        first = (own >= 0) & (of_corners[:, :corner] != own[:, None]).all(axis=1)
        at = np.where(of_corners == own[:, None], values[faces], 1.0)
        first &= at.max(axis=1) > at.min(axis=1)
        cuts.append((faces[first], own[first], at[first]))
    faces, own, at = (np.concatenate(each) for each in zip(*cuts, strict=True))
    shortest = np.full(n_parts, np.inf)
    for level in (np.arange(_LEVELS) + 0.5) / _LEVELS:
        above = at > level
        count = above.sum(axis=1)
        crossed = np.flatnonzero((count == 1) | (count == 2))
        # the corner that is alone on its side of the level
        alone = np.argmax(above[crossed] == (count[crossed] == 1)[:, None], axis=1)
        points = []
        for step in (1, 2):
            tip = (alone + step) % 3
            start, end = at[crossed, alone], at[crossed, tip]
            share = ((level - start) / (end - start))[:, None]
            tail_at, tip_at = vertices[faces[crossed, alone]], vertices[faces[crossed, tip]]
            points.append(tail_at + share * (tip_at - tail_at))
        lengths = np.linalg.norm(points[0] - points[1], axis=1)
        sums = np.bincount(own[crossed], lengths, n_parts)
        shortest = np.where(sums > 0.0, np.minimum(shortest, sums), shortest)
    return shortest
