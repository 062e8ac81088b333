"""Copies of a shape that differ by a rotation, a scale, a shift and noise, matched by position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from meshmash_viewer.arrays import FloatArray, IntArray

#: Root mean square distance of the vertices of a copy, as a share of an edge.
_COPY = 0.25
#: Most iterations of a fit, and most vertices that it is made with.
_FITS, _FITTED = 50, 1000


@dataclass(frozen=True, eq=False)
class Placed:
    """Vertices of a shape, shape (n, 3), its faces and its area."""

    positions: FloatArray
    faces: IntArray
    area: float

    @property
    def edge(self) -> float:
        """Mean length of an edge, as a share of √area."""
        sides = self.positions[self.faces] - self.positions[np.roll(self.faces, 1, axis=1)]
        return float(np.linalg.norm(sides, axis=2).mean() / np.sqrt(self.area))


def copied(
    first: Placed, second: Placed, some: IntArray | slice, near: IntArray, mirrored: bool
) -> tuple[FloatArray, IntArray, FloatArray] | None:
    """Fit the positions of the first to those of the second, from the matches of `some`.

    Returns the similarity, shape (4, 4), and the nearest vertices and distances, or None unless the
    first is a copy of the second: the vertices of both are within a share of an edge of the other.
    """
    every = slice(None, None, len(near) // _FITTED + 1)
    points, near, tree = first.positions[some][every], near[every], KDTree(second.positions)
    kept = np.ones(len(points), dtype=np.bool_)
    for _ in range(_FITS):
        matrix = _similarity(points[kept], second.positions[near[kept]], mirrored)
        distances, found = tree.query(points @ matrix[:3, :3].T + matrix[:3, 3])
        if np.array_equal(found, near):
            break
        near, kept = np.asarray(found), np.asarray(distances <= 2.0 * np.median(distances))
    ways = nearest_by_position(matrix, first, second)
    size = np.sqrt(max(np.square(distances).mean() for _, distances in ways))
    return (matrix, *ways[0]) if size < _COPY * min(first.edge, second.edge) else None


def nearest_by_position(
    matrix: FloatArray, first: Placed, second: Placed
) -> list[tuple[IntArray, FloatArray]]:
    """Return nearest vertices of the moved first on the second, and back, with their distances.

    These are shares of √area.
    """
    moved = first.positions @ matrix[:3, :3].T + matrix[:3, 3]
    ways = (moved, second.positions), (second.positions, moved)
    found = (KDTree(places).query(points) for points, places in ways)
    return [(np.asarray(near), far / np.sqrt(second.area)) for far, near in found]


def _similarity(points: FloatArray, places: FloatArray, mirrored: bool) -> FloatArray:
    """Return the rotation, scale and shift of points that are nearest to places."""
    from trimesh.registration import procrustes

    flip = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
    found = procrustes(points @ flip[:3, :3], places, reflection=False, return_cost=False)
    return np.asarray(found @ flip)
