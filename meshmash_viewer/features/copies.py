"""Matching by position of shapes that differ by a rotation, a scale, a shift and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from meshmash_viewer.arrays import FloatArray, IntArray

#: Largest root mean square distance between the vertices of two copies, in edges. For random points
#: on equilateral triangles, the distance from the nearest vertex is √5 / 6 = 0.37.
_COPY = 0.25
#: Maximum number of iterations of a fit, and maximum number of fitted vertices.
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
    """Fit the first shape to the second by iterated closest points, if they are copies.

    `near`, shape (m,), are vertices of the second that match the vertices `some` of the first: the
    start of the fit.

    Returns
    -------
    tuple of ndarray, or None
        The similarity, shape (4, 4), and for each vertex of the first the nearest one of the second
        and its distance. None if distances between the vertices of the shapes are too large.
    """
    from trimesh.registration import procrustes  # slow to import

    every = slice(None, None, len(near) // _FITTED + 1)
    points, near, tree = first.positions[some][every], near[every], KDTree(second.positions)
    flip = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0, 1.0])
    kept = np.ones(len(points), dtype=np.bool_)
    for _ in range(_FITS):
        flipped, places = points[kept] @ flip[:3, :3], second.positions[near[kept]]
        matrix = procrustes(flipped, places, reflection=False, return_cost=False) @ flip
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
    """Return nearest vertices and distances from the moved first shape to the second, and back.

    Distances are divided by √area.
    """
    moved = first.positions @ matrix[:3, :3].T + matrix[:3, 3]
    ways = (moved, second.positions), (second.positions, moved)
    found = (KDTree(places).query(points) for points, places in ways)
    return [(np.asarray(near), far / np.sqrt(second.area)) for far, near in found]
