"""Geometry of triangles: areas, normals, connected components."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, blocks, distinct_corners, first_equal

#: A component with less than this share of the area of the largest one is small, see
#: `Triangles.small_components`.
SMALL = 0.05
#: A face whose height is below this share of its longest edge is numerically degenerate.
_FLAT = 1e-12
#: Faces processed at a time, so that what is derived of them fits into the cache.
_FACES = 16384


@dataclass(frozen=True, eq=False)
class Triangles:
    """What follows from vertices, shape (n, 3), and faces, shape (m, 3): the base of `Mesh`."""

    vertices: FloatArray
    faces: IntArray

    @property
    def n_vertices(self) -> int:
        """Number of vertices, unreferenced ones included."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest coordinates of the surface, shape (2, 3), in `unit`.

        Vertices that no face uses are not on it: one far away would set the size of everything.
        """
        points = self.vertices[self.referenced] if len(self.unreferenced) else self.vertices
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def face_areas(self) -> FloatArray:
        """Area of each face, shape (m,), in squared `unit`."""
        areas = np.empty(self.n_faces)
        for part in blocks(self.n_faces, _FACES):
            areas[part] = 0.5 * np.linalg.norm(self._crosses(part), axis=1)
        return areas

    @cached_property
    def area(self) -> float:
        """Area of the whole surface, in squared `unit`."""
        return float(self.face_areas.sum())

    @cached_property
    def vertex_areas(self) -> FloatArray:
        """A third of the area of the faces around each vertex, shape (n,), in squared `unit`."""
        return self._sums_at_vertices(self.face_areas / 3.0)

    def area_sample(self, count: int = 10_000) -> IntArray:
        """Vertices spread over the surface in proportion to its area.

        Statistics over them are those of the surface: many vertices on little area weigh as little
        as they look. `small_components` are left out: debris has values of its own, as heat that
        cannot flow away. The indices, shape (count,), ascend, so that values are read in order; a
        vertex may occur many times. They are the same for the same mesh.
        """
        large = ~self.small_components[self.faces[:, 0]]
        filled = np.cumsum(self.face_areas * large)
        drawn = np.searchsorted(filled, (np.arange(count) + 0.5) / count * filled[-1])
        corners = self.faces[np.minimum(drawn, self.n_faces - 1), np.arange(count) % 3]
        return np.sort(corners).astype(np.int64)

    @cached_property
    def referenced(self) -> npt.NDArray[np.bool_]:
        """Which vertices a face with three different corners uses, shape (n,)."""
        used = np.zeros(self.n_vertices, dtype=np.bool_)
        used[self.faces[self.distinct_corners]] = True
        return used

    @cached_property
    def unreferenced(self) -> IntArray:
        """Indices of the other vertices, which are no part of the surface."""
        return np.flatnonzero(~self.referenced)

    def on_surface(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Values of shape (n,), with 0 at unreferenced vertices: what is NaN then can be seen."""
        if len(self.unreferenced):
            values = values.copy()
            values[self.unreferenced] = 0.0
        return values

    @cached_property
    def distinct_corners(self) -> npt.NDArray[np.bool_]:
        """Which faces have three different corners, shape (m,); the others are no triangles."""
        return distinct_corners(self.faces)

    @property
    def proper_faces(self) -> IntArray:
        """The faces with three different corners; not a copy if all are."""
        distinct = self.distinct_corners
        return self.faces if distinct.all() else self.faces[distinct]

    @cached_property
    def degenerate_faces(self) -> npt.NDArray[np.bool_]:
        """Which faces have a corner twice, or no area but for rounding, shape (m,)."""
        a, b, c = self._corners(slice(None))
        squares = [np.square(p - q).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]
        longest = np.sqrt(np.max(squares, axis=0))
        # The height over the longest edge is known no better than the coordinates themselves.
        rounding = 4.0 * np.finfo(np.float64).eps * np.abs(self.bounds).max()
        flat = 2.0 * self.face_areas <= (_FLAT * longest + rounding) * longest
        return np.asarray(~self.distinct_corners | flat)

    @cached_property
    def duplicate_faces(self) -> npt.NDArray[np.bool_]:
        """Which faces have the three vertices of an earlier one, shape (m,)."""
        return np.asarray(first_equal(np.sort(self.faces, axis=1)) != np.arange(self.n_faces))

    @cached_property
    def component_labels(self) -> IntArray:
        """Connected component of each vertex, shape (n,); -1 where unreferenced.

        Faces that share a vertex are connected. Components are numbered by their lowest vertex.
        """
        from scipy import sparse
        from scipy.sparse.csgraph import connected_components

        index = sparse.get_index_dtype(maxval=self.n_vertices)
        corners = self.proper_faces.T.astype(index, order="C")
        sides = corners[:2].ravel(), corners[1:].ravel()
        joined = sparse.coo_array(
            (np.ones(len(sides[0]), dtype=np.int8), sides), shape=(self.n_vertices,) * 2
        )
        _, labels = connected_components(joined, directed=False)
        result = np.full(self.n_vertices, -1, dtype=np.int64)
        # SciPy numbers in that order, and counts what is in no face too
        result[self.referenced] = np.unique(labels[self.referenced], return_inverse=True)[1]
        return result

    @cached_property
    def small_components(self) -> npt.NDArray[np.bool_]:
        """Vertices of components with less than `SMALL` of the area of the largest, shape (n,)."""
        labels = self.component_labels
        areas = np.bincount(
            np.maximum(labels[self.faces[:, 0]], 0), self.face_areas, int(labels.max()) + 1
        )
        return np.asarray((areas < SMALL * areas.max())[labels] & (labels >= 0))

    @property
    def n_components(self) -> int:
        """Number of connected components; unreferenced vertices are in none."""
        return int(self.component_labels.max()) + 1

    @cached_property
    def vertex_normals(self) -> npt.NDArray[np.float32]:
        """Unit normals, shape (n, 3): the area-weighted mean over the faces around a vertex.

        Where it vanishes (unreferenced vertices, faces that cancel) the normal is (0, 0, 1), so
        that nothing drawn with it is ever NaN.
        """
        crosses = np.empty((self.n_faces, 3))
        for part in blocks(self.n_faces, _FACES):
            crosses[part] = self._crosses(part)
        total = np.column_stack([self._sums_at_vertices(axis) for axis in crosses.T])
        length = np.linalg.norm(total, axis=1, keepdims=True)
        # sums below rounding, relative to the largest possible one, have no direction
        vanishing = length[:, 0] <= 1e-12 * self.area / self.n_faces
        total[vanishing] = (0.0, 0.0, 1.0)
        length[vanishing] = 1.0
        return np.asarray(total / length, dtype=np.float32)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of coordinates and indices: 64 hexadecimal digits."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces):
            digest.update(str(array.shape).encode())
            digest.update(array.ravel().data)
        return digest.hexdigest()

    def _sums_at_vertices(self, of_faces: FloatArray) -> FloatArray:
        """Sum of a value over the faces around each vertex, shape (n,)."""
        repeated = np.repeat(of_faces, 3)
        return np.bincount(self.faces.ravel(), repeated, self.n_vertices).astype(np.float64)

    def _crosses(self, part: slice) -> FloatArray:
        """Cross product of two edges of some faces, shape (p, 3): twice the area, along the normal.

        An edge is a difference, so a far-away origin costs no digits here.
        """
        a, b, c = self._corners(part)
        return np.asarray(np.cross(b - a, c - a), dtype=np.float64)

    def _corners(self, part: slice) -> tuple[FloatArray, ...]:
        """Coordinates of the three corners of some faces, shape (p, 3) each.

        Those of faces with a corner twice are all at one: the other may be anywhere.
        """
        faces, distinct = self.faces[part], self.distinct_corners[part]
        if not distinct.all():
            faces = np.where(distinct[:, None], faces, faces[:, :1])
        return tuple(self.vertices[faces[:, corner]] for corner in range(3))
