"""Joining of coincident vertices, for formats that repeat a vertex in each of its faces."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray, distinct_corners, first_equal
from meshmash_viewer.errors import InputError
from meshmash_viewer.surface.edges import connected

#: Largest distance of two vertices that are merged, relative to the longest side of the mesh: half
#: the spacing of float32 numbers at its ends, if it is centred on the origin.
_OF_EXTENT = 2.0**-26
#: The same relative to the smallest face at either vertex, measured by its longest edge; and the
#: size relative to the longest side of the mesh below which a face is a rounding residue.
_OF_FACE, _LEAST_FACE = 2.0**-7, 2.0**-38
#: Largest coordinate whose square is finite.
_LARGEST = 1e150


def join_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Join coincident vertices, and drop the triangles that collapse.

    Exporters leave rounding residues such as 1e-17 for 0. Vertices are therefore coincident if they
    are closer than 2⁻²⁶ of the longest side of the mesh and 2⁻⁷ of the smallest face at either
    vertex, independently of the origin. `vertices`, shape (n, 3), are those of the file, before any
    transform. The remaining vertices keep their order; their indices are the third result.
    `InputError` is raised if a coordinate is not finite, or so large that most faces are residues.
    """
    if not len(vertices):
        return vertices, faces, np.arange(0)
    if not np.isfinite(vertices).all():
        raise InputError("has a vertex with a coordinate that is not finite")
    points = vertices + 0.0  # makes -0.0 equal to 0.0 in bits
    representative = first_equal(points)
    faces = representative[faces]
    faces = faces[distinct_corners(faces)]
    # joining exact copies first leaves a sixth of the points for the search of near copies
    used = np.zeros(len(points), dtype=np.bool_)
    used[faces] = True
    used_at, number = np.flatnonzero(used), np.cumsum(used) - 1
    near = np.arange(len(points))
    near[used_at] = used_at[_first_near(points[used_at], number[faces])]
    kept = np.unique(near[representative])
    faces = np.searchsorted(kept, near[faces])
    return vertices[kept], faces[distinct_corners(faces)], kept


def _first_near(points: FloatArray, faces: IntArray) -> IntArray:
    """Return for each point the first coincident one; all points are in faces."""
    from scipy.spatial import cKDTree

    first = np.arange(len(points))
    if not len(points) or np.abs(points).max() > _LARGEST:  # refused when the mesh is made
        return first
    reach = _reach(points, faces)
    while True:
        left = np.unique(first)
        tree: Any = cKDTree(points[left])
        most = float(reach[left].max())
        distances, nearest = tree.query(tree.data, k=2, distance_upper_bound=most)
        other = np.minimum(nearest[:, 1], len(left) - 1)  # without a neighbour the distance is inf
        near = np.flatnonzero(distances[:, 1] <= np.minimum(reach[left], reach[left[other]]))
        if not len(near):
            return first
        # more than two points may be coincident: repeat until none is near
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
            f"has a coordinate as large as {np.abs(points).max():.3g}, next to which the others are"
            " so small that they cannot be distinguished"
        )
    smallest = np.full(len(points), np.inf)
    for corner in faces.T:
        np.minimum.at(smallest, corner, longest)
    smallest = np.maximum(smallest, _LEAST_FACE * extent)
    return np.asarray(np.minimum(_OF_FACE * smallest, _OF_EXTENT * extent))
