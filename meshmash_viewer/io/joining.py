"""Joining of vertices at one place, for formats that repeat a vertex in each of its faces."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import FloatArray, IntArray, first_equal

#: Distance below which two vertices are one, relative to the longest side of the mesh: half the
#: step between float32 numbers at its ends, if its middle is at the origin.
_OF_EXTENT = 2.0**-26
#: The same relative to the smallest face at either vertex, measured by its longest edge. A face
#: smaller than the second, relative to the longest side of the mesh, is itself a residue.
_OF_FACE, _LEAST_FACE = 2.0**-7, 2.0**-38
#: Vertices whose distances differ by more are searched one after the other: with the distance of
#: the larger the smaller would all be neighbours.
_RATIO = 64.0
#: Residues come in twos and threes. So many vertices are counted around, and so many neighbours
#: may be found on average: beyond that the pairs would not fit into memory.
_SAMPLE, _MOST_NEIGHBOURS = 256, 64.0
#: Beyond it squared distances are not finite.
_LARGEST = 1e150


def join_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Join vertices at the same place, and drop the triangles that collapse by it.

    Exporters leave residues such as 1e-17 for 0. The same place therefore means closer than 2⁻²⁶
    of the longest side of the mesh, and than 2⁻⁷ of the smallest face at either vertex. Neither
    depends on where the origin is, nor on vertices that no face uses, so small parts of a large
    mesh keep their vertices. Joined vertices keep the order of their first appearance.

    Parameters
    ----------
    vertices : ndarray of float64, shape (n, 3)
        In the coordinates they were written in, before any transform.
    faces : ndarray of int64, shape (m, 3)
        Indices within range.

    Returns
    -------
    vertices : ndarray of float64, shape (n', 3)
    faces : ndarray of int64, shape (m', 3)
    kept : ndarray of int64, shape (n',)
        Which vertices are left.

    Raises
    ------
    InputError
        If a coordinate is not finite, or too many vertices are at nearly the same place.
    """
    if not len(vertices):
        return vertices, faces, np.arange(0)
    if not np.isfinite(vertices).all():
        raise InputError("has a vertex with a coordinate that is not finite")
    points = vertices + 0.0  # -0.0 and 0.0 are the same place
    representative = first_equal(points)
    faces = _without_collapsed(representative[faces])
    # Joining exact copies first leaves the slower search for near copies a sixth of the points.
    used = np.zeros(len(points), dtype=np.bool_)
    used[faces] = True
    used_at = np.flatnonzero(used)
    near = np.arange(len(points))
    near[used_at] = used_at[_first_near(points[used_at], _numbered(used)[faces])]
    representative = near[representative]
    kept = np.unique(representative)
    return vertices[kept], _without_collapsed(np.searchsorted(kept, near[faces])), kept


def _without_collapsed(faces: IntArray) -> IntArray:
    """The faces that have three different corners."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (a != c)])


def _numbered(used: np.typing.NDArray[np.bool_]) -> IntArray:
    return np.asarray(np.cumsum(used) - 1)


def _first_near(points: FloatArray, faces: IntArray) -> IntArray:
    """For each of the points, all of which are in faces, the first at its place."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(points)
    if not n or np.abs(points).max() > _LARGEST:  # larger ones are refused by the mesh itself
        return np.arange(n)
    pairs = _near_pairs(points, _reach(points, faces))
    if not len(pairs):
        return np.arange(n)
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, labels = connected_components(links, directed=False)
    _, first = np.unique(labels, return_index=True)
    return np.asarray(first[labels])


def _reach(points: FloatArray, faces: IntArray) -> FloatArray:
    """How near another vertex must be to be the same, shape (n,)."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    longest = np.sqrt(
        np.max([np.square(p - q).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], 0)
    )
    smallest = np.full(len(points), np.inf)
    for corner in faces.T:
        np.minimum.at(smallest, corner, longest)
    extent = float(np.ptp(points, axis=0).max())
    smallest = np.maximum(smallest, _LEAST_FACE * extent)
    return np.asarray(np.minimum(_OF_FACE * smallest, _OF_EXTENT * extent))


def _near_pairs(points: FloatArray, reach: FloatArray) -> IntArray:
    """Pairs of points that are nearer than either reaches, shape (p, 2)."""
    from scipy.spatial import cKDTree

    found = [np.zeros((0, 2), dtype=np.int64)]
    left = np.arange(len(points) if reach.any() else 0)  # one place alone has no extent
    while len(left):
        least = float(reach[left].min())
        small = reach[left] <= _RATIO * least
        distance = float(reach[left][small].max())
        tree = cKDTree(points[left])
        sample = tree.data[:: len(left) // _SAMPLE + 1]
        if tree.query_ball_point(sample, distance, return_length=True).mean() > _MOST_NEIGHBOURS:
            raise InputError(
                f"has a coordinate as large as {np.abs(points).max():.3g}, next to which the others"
                " are so small that they cannot be distinguished"
            )
        pairs = left[tree.query_pairs(distance, output_type="ndarray")]
        first, second = pairs.T
        apart = np.linalg.norm(points[first] - points[second], axis=1)
        found.append(pairs[apart <= np.minimum(reach[first], reach[second])])
        left = left[~small]
    return np.concatenate(found)
