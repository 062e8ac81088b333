"""Mean and Gaussian curvature at the vertices of a triangle mesh."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.surface.edges import edges_of, side_codes, winding_of
from meshmash_viewer.units import counted

#: Key of the sentence in `Mesh.derived`.
DIRECTION_FAULT = "fault of directions"


def mean_curvature(mesh: MeshLike) -> FloatArray:
    """Compute the mean curvature, half the sum of the two principal ones.

    ``H = ½ (L x) · n / A`` with the cotangent Laplacian L of the coordinates x, the vertex normal
    n and the mixed area A of Meyer et al. [1]_: positive where the surface bulges towards the side
    from which its faces are counter-clockwise, 1/r on a sphere of radius r.

    `InputError` is raised if the mesh is not valid.

    Parameters
    ----------
    mesh : MeshLike
        Its faces should agree on which side is outside. They determine the sign, and next to an
        edge where they do not agree the vertex normal and the curvature are wrong.

    Returns
    -------
    ndarray of float64, shape (n,)
        In inverse units of length. NaN on the boundary and at vertices without faces. Faces without
        area are ignored.

    Warns
    -----
    MeshWarning
        If neighbouring faces do not agree on which side is outside, see `direction_fault`.

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
    """Describe faces that do not agree on which side is outside; empty if all do."""
    if DIRECTION_FAULT not in mesh.derived:
        mesh.derived[DIRECTION_FAULT] = _direction_fault(mesh)
    return str(mesh.derived[DIRECTION_FAULT])


def _direction_fault(mesh: Mesh) -> str:
    winding = winding_of(mesh)
    if not winding.disagreeing_edges:
        return ""
    name = f"{mesh.name}: f" if mesh.name else "F"
    remedy = (
        "make them agree by the repair orient_faces first"
        if winding.reversed_faces.any()
        else "the surface has one side only, so no repair makes them agree"
    )
    return (
        f"{name}aces do not agree on which side is outside at"
        f" {counted(winding.disagreeing_edges, 'edge')}, so the mean curvature has the wrong sign"
        f" on some, and is wrong next to these edges: {remedy}."
    )


def gaussian_curvature(mesh: MeshLike) -> FloatArray:
    """Compute the Gaussian curvature, the product of the two principal ones.

    ``K = (2π - Σ θ) / A`` with the angles θ of the faces around a vertex and its mixed area A, as
    `mean_curvature`: 1/r² on a sphere of radius r, negative on a saddle. Over a closed surface
    ``Σ K A`` is exactly 2π times its Euler characteristic.

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
    """Compute the mixed area of each vertex, by which the curvatures divide (`mean_curvature`).

    A face without an obtuse angle is divided between its vertices by the nearest one. Of an obtuse
    face the vertex at the obtuse angle has a half, the others a quarter each.
    (`compute_vertex_areas` assigns a third of every face to each.)

    Returns
    -------
    ndarray of float64, shape (n,)
        In squared unit of the mesh; their sum is the area of the mesh. 0 at vertices without faces.

    Examples
    --------
    >>> corners = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    >>> mv.mixed_areas((corners, [[0, 1, 2], [0, 2, 3]]))
    array([1., 1., 1., 1.])
    """
    return _Corners(as_mesh(mesh)).mixed_areas()


class _Corners:
    """The faces that have an area, and the cotangents of their angles, shape (m, 3)."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.faces = mesh.faces[~mesh.degenerate_faces]
        self._places = [mesh.vertices[self.faces[:, corner]] for corner in range(3)]
        self._doubled = np.linalg.norm(np.cross(self.edge(0, 1), self.edge(0, 2)), axis=1)
        # of the angle between the two edges at a corner
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
        """Compute the area of faces nearest to each vertex; ½, ¼ and ¼ for obtuse faces."""
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
        """Find vertices of edges with one face only."""
        n = self._mesh.n_vertices
        edges = edges_of(side_codes(self.faces, n))
        single = edges.keys[edges.counts == 1]
        on_it = np.zeros(n, dtype=np.bool_)
        on_it[single // n] = on_it[single % n] = True
        return on_it
