"""Distances along a surface from vertices to those within a radius."""

from __future__ import annotations

from threading import Lock

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.surface.masks import Mask


class Geodesics:
    """The faces around each vertex of a surface, along which distances are found.

    Vertices have shape (n, 3), faces (m, 3). It takes 38 bytes a face.
    """

    def __init__(self, vertices: npt.NDArray[np.floating], faces: IntArray) -> None:
        from scipy import sparse

        self._vertices = np.ascontiguousarray(vertices, dtype=np.float32)
        self._faces = np.ascontiguousarray(faces, dtype=np.int32)
        m, n = len(faces), len(vertices)
        corners = self._faces.ravel(), np.arange(0, 3 * m + 1, 3, dtype=np.int32)
        by_vertex = sparse.csr_array((np.ones(3 * m, np.int8), *corners), shape=(m, n)).tocsc()
        self._starts = by_vertex.indptr.astype(np.int32)
        self._around = by_vertex.indices.astype(np.int32)
        self._scratch = np.full(n, np.inf, dtype=np.float32), np.zeros(n, dtype=np.bool_)
        self._lock = Lock()

    def within(
        self, sources: IntArray, radius: float, passable: Mask | None = None
    ) -> tuple[IntArray, FloatArray]:
        """Find the vertices within a distance of sources, and their distances, shape (k,) each.

        A front crosses each face from two of its corners to the third, in a straight line from
        where their distances place the source in its plane: exact on a plane without obtuse faces.
        `passable`, shape (n,), says which vertices it may reach.
        """
        from meshmash_viewer.surface.kernels import spread

        if passable is None:
            passable = np.ones(len(self._vertices), dtype=np.bool_)
        given = np.unique(sources).astype(np.int32)
        surface = self._starts, self._around, self._faces, self._vertices
        with self._lock:
            vertices, distances = spread(*surface, given, radius, passable, *self._scratch)
        return np.asarray(vertices, dtype=np.int64), np.asarray(distances, dtype=np.float64)
