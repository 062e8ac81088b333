"""Geodesic distances: lengths of shortest paths along a surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, check_vertex
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh

#: Number of faces visited for the exact distances near the sources, which takes about 10 ms.
_EXACT = 100_000
_ANY = np.zeros(0, dtype=np.bool_)


class GeodesicSolver:
    """Geodesic distances by fast marching over faces [1]_, with exact distances near the source.

    `mesh` may be non-manifold and have several components and faces without area. Distances are
    never above the length of a path along edges, and do not depend on other components. Near the
    source, windows are unfolded over the faces [2]_; from there, distances are extended from face
    to face with the directions of the paths, so that the error is of second order in the length of
    the edges. Faces, sides and angles take 76 bytes a face.

    References
    ----------
    .. [1] Kimmel, R. and Sethian, J. A. (1998). "Computing Geodesic Paths on Manifolds." PNAS
       95(15).
    .. [2] Xin, S.-Q. and Wang, G.-J. (2009). "Improving Chen and Han's Algorithm on the Discrete
       Geodesic Problem." ACM Transactions on Graphics 28(4).

    Examples
    --------
    >>> solver = mv.GeodesicSolver(ball)
    >>> north, south = ball.vertices[:, 2].argmax(), ball.vertices[:, 2].argmin()
    >>> float((solver.from_vertex(north)[south] / np.pi).round(2))
    0.99
    """

    def __init__(self, mesh: MeshLike) -> None:
        from meshmash_viewer.surface.marching import fans, surround

        self.mesh = as_mesh(mesh)
        faces = self.mesh.faces[self.mesh.distinct_corners].astype(np.int32)
        sides, starts, around = surround(self.mesh.vertices, faces)
        self._surface = starts, around, faces, sides
        self._fans = fans(*self._surface)

    def from_vertex(self, vertex: int) -> FloatArray:
        """Compute distances to all vertices in the unit of the mesh, shape (n,).

        No distance is below the straight line, nor above a path along edges. Distances are NaN in
        other components, and to and from unreferenced vertices.

        `InputError` is raised if the vertex does not exist.
        """
        found, places = self.nearest([vertex]), self.mesh.vertices
        reached = np.isfinite(found)
        straight = np.linalg.norm(places[reached] - places[vertex], axis=1)
        found[reached] = np.maximum(found[reached], straight)
        return found

    def nearest(self, vertices: npt.ArrayLike) -> FloatArray:
        """Compute the distance of each vertex from the nearest of some vertices, shape (n,).

        Distances are NaN in components without any of the vertices.

        `InputError` is raised if there is none, or one does not exist.
        """
        from meshmash_viewer.surface.marching import march, unfold

        sources = _checked(self.mesh, vertices)
        if not sources:
            raise InputError("no-vertices", "The distance is from no vertex", "give one or more")
        distances = self.unreached()
        distances[sources] = 0.0
        exact = unfold(self._surface, self._fans[1], distances, _EXACT)
        seeds = np.flatnonzero(np.isfinite(distances))
        march(self._surface, *self._fans, distances, seeds, exact, _ANY, np.inf)
        distances[np.isinf(distances) | ~self.mesh.referenced] = np.nan
        return distances

    def unreached(self) -> FloatArray:
        """Return infinite distances, shape (n,), for the first of several calls of `within`."""
        return np.full(self.mesh.n_vertices, np.inf)

    def within(
        self,
        sources: npt.ArrayLike,
        radius: float,
        passable: npt.NDArray[np.bool_] | None = None,
        distances: FloatArray | None = None,
    ) -> tuple[IntArray, FloatArray]:
        """Find the vertices within a distance of sources, and their distances, shape (k,) each.

        Distances are not exact near the sources, so that a small radius takes little time. Only
        vertices in `passable`, shape (n,), and the sources are reached. After earlier calls with
        the same `distances` (see `unreached`), only vertices nearer to the new sources are found.
        """
        from meshmash_viewer.surface.marching import march

        if distances is None:
            distances = self.unreached()
        seeds = np.unique(np.asarray(sources, dtype=np.int64))
        distances[seeds] = 0.0
        mask = _ANY if passable is None else passable
        reached = march(self._surface, *self._fans, distances, seeds, 0.0, mask, radius)
        vertices = np.flatnonzero(reached)
        return vertices, distances[vertices]


def geodesic_distance(mesh: MeshLike, vertices: npt.ArrayLike) -> FloatArray:
    """Compute distances along the surface from a vertex, or a column for each of several.

    For measured errors see the page on distances. To compute more for the same mesh, keep a
    `GeodesicSolver`; for the nearest of several vertices see `nearest_distance`.

    Returns
    -------
    ndarray of float64, shape (n,) for one vertex, or (n, f)
        In the unit of the mesh; NaN in other components.

    Examples
    --------
    >>> float((mv.geodesic_distance(ball, 0).max() / np.pi).round(2))
    0.99
    >>> mv.geodesic_distance(ball, [1, 2, 3]).shape
    (642, 3)
    """
    solver = GeodesicSolver(mesh)
    if np.ndim(vertices) == 0:
        return solver.from_vertex(vertices)  # type: ignore[arg-type]
    chosen = _checked(solver.mesh, vertices)
    values = np.empty((solver.mesh.n_vertices, len(chosen)), order="F")
    for column, vertex in enumerate(chosen):
        values[:, column] = solver.from_vertex(vertex)
    return values


def nearest_distance(mesh: MeshLike, vertices: npt.ArrayLike) -> FloatArray:
    """Compute the distance along the surface of each vertex from the nearest of some vertices.

    `InputError` is raised if there is none, or one does not exist.

    Returns
    -------
    ndarray of float64, shape (n,)
        In the unit of the mesh; NaN in components without any of the vertices.

    Examples
    --------
    >>> several = mv.geodesic_distance(ball, [1, 2, 3])
    >>> bool(np.abs(mv.nearest_distance(ball, [1, 2, 3]) - several.min(axis=1)).max() < 0.01)
    True
    """
    return GeodesicSolver(mesh).nearest(vertices)


def _checked(mesh: Mesh, vertices: npt.ArrayLike) -> list[int]:
    chosen: list[int] = np.atleast_1d(np.asarray(vertices)).tolist()
    for vertex in chosen:
        check_vertex(vertex, mesh.n_vertices)
    return chosen
