"""Joining of coincident vertices, for formats that store a vertex once per face."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray, distinct_corners, first_equal
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import REPAIR
from meshmash_viewer.surface.edges import connected

#: Largest distance of joined vertices, relative to the longest side of the bounding box: half the
#: spacing of float32 numbers at the ends of a mesh that is centred on the origin.
_OF_EXTENT = 2.0**-26
#: Largest distance of joined vertices, relative to the longest edge of the smallest face at either
#: vertex; and the size below which a face is a rounding residue, relative to the longest side.
_OF_FACE, _LEAST_FACE = 2.0**-7, 2.0**-38
#: Largest coordinate whose square is finite.
_LARGEST = 1e150


def join_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Join coincident vertices, and drop the triangles that collapse.

    Exporters leave rounding residues such as 1e-17 for 0. Two vertices are therefore coincident if
    their distance is at most 2⁻²⁶ of the longest side of the bounding box, and at most 2⁻⁷ of the
    smallest face at either vertex, independently of the origin. `vertices`, shape (n, 3), are the
    coordinates in the file, before any transform. Returned are the remaining vertices in their
    order, the faces, and the indices of the remaining vertices. `InputError` is raised if a
    coordinate is not finite, or so large that most faces are rounding residues.
    """
    if not len(vertices):
        return vertices, faces, np.arange(0)
    if not np.isfinite(vertices).all():
        raise InputError("not-finite", "has a vertex with a coordinate that is not finite", REPAIR)
    points = vertices + 0.0  # replaces -0.0 by 0.0, as bits are compared
    representative = first_equal(points)
    faces = representative[faces]
    faces = faces[distinct_corners(faces)]
    # exact copies are joined first: the search for near ones then has a sixth of the points
    used = np.zeros(len(points), dtype=np.bool_)
    used[faces] = True
    used_at, number = np.flatnonzero(used), np.cumsum(used) - 1
    near = np.arange(len(points))
    near[used_at] = used_at[_first_near(points[used_at], number[faces])]
    kept = np.unique(near[representative])
    faces = np.searchsorted(kept, near[faces])
    return vertices[kept], faces[distinct_corners(faces)], kept


def _first_near(points: FloatArray, faces: IntArray) -> IntArray:
    """Return the index of the first coincident point of each point; each must be in a face."""
    from scipy.spatial import cKDTree

    first = np.arange(len(points))
    if not len(points) or np.abs(points).max() > _LARGEST:  # `Mesh` raises the error
        return first
    reach = _reach(points, faces)
    while True:
        left = np.unique(first)
        tree: Any = cKDTree(points[left])
        most = float(reach[left].max())
        distances, nearest = tree.query(tree.data, k=2, distance_upper_bound=most)
        other = np.minimum(nearest[:, 1], len(left) - 1)  # n, at distance inf, if none
        near = np.flatnonzero(distances[:, 1] <= np.minimum(reach[left], reach[left[other]]))
        if not len(near):
            return first
        # more than two points may be coincident: repeat until no pair is left
        labels = connected(near, other[near], len(left))
        _, lowest = np.unique(labels, return_index=True)
        first = left[lowest[labels]][np.searchsorted(left, first)]


def _reach(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return the distance within which another vertex is coincident, shape (n,)."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    edges = [np.linalg.norm(p - q, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    longest = np.max(edges, axis=0)
    extent = float(np.ptp(points, axis=0).max())
    if np.median(longest) < _LEAST_FACE * extent:
        raise InputError(
            "beyond-floating-point",
            f"has a coordinate as large as {np.abs(points).max():.3g}, next to which the others are"
            " so small that they cannot be distinguished",
        )
    smallest = np.full(len(points), np.inf)
    for corner in faces.T:
        np.minimum.at(smallest, corner, longest)
    smallest = np.maximum(smallest, _LEAST_FACE * extent)
    return np.asarray(np.minimum(_OF_FACE * smallest, _OF_EXTENT * extent))
