"""Coarse meshes made of some of the vertices of a mesh, for fast rendering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import IntArray, distinct_corners


@dataclass(frozen=True, eq=False)
class CoarseMesh:
    """Faces between some vertices of a mesh, so that fields are indexed rather than computed.

    Each of `representatives` is a vertex of the full mesh; `faces` are indices into them.
    """

    representatives: IntArray
    faces: IntArray


def cluster_vertices(
    vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer], count: int
) -> CoarseMesh:
    """Merge the vertices that share a cell of a regular grid (Rossignac & Borrel 1993).

    Each cell is represented by its vertex nearest to the mean of the cell, in ascending order;
    faces that do not span three cells are removed, and so are copies. It takes the time of two
    sorts of the vertices and one of the remaining faces. `count` is the approximate cell count.
    """
    faces = faces[distinct_corners(faces)]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    members = np.flatnonzero(used)
    points = vertices[members].astype(np.float64)
    points -= points.min(axis=0)
    size = float(points.max()) or 1.0
    # The number of cells is proportional to area over cell area: one trial gives the constant.
    cells_per_side = max(2.0, np.sqrt(count / 4.0))
    for _ in range(3):
        met = len(np.unique(_keys(points[:: max(1, len(points) // 200_000)], size, cells_per_side)))
        cells_per_side = float(np.clip(cells_per_side * np.sqrt(count / max(met, 1)), 1.0, 2e6))
    keys = _keys(points, size, cells_per_side)
    _, cluster, sizes = np.unique(keys, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(cluster, points[:, axis]) for axis in range(3)], axis=1)
    points -= (sums / sizes[:, None])[cluster]
    nearest_first = np.lexsort((np.einsum("ij,ij->i", points, points), cluster))
    # Ascending order of representatives makes indexing a field fast.
    chosen, rank = np.unique(members[nearest_first[np.cumsum(sizes) - sizes]], return_inverse=True)
    coarse_of = np.full(len(vertices), -1, dtype=np.int64)
    coarse_of[members] = rank[cluster]
    corners = coarse_of[faces]
    corners = corners[distinct_corners(corners)]
    # Rotate each face so that its smallest corner is first: copies are then equal rows.
    first = np.argmin(corners, axis=1)
    row = np.arange(len(corners))[:, None]
    corners = corners[row, (first[:, None] + np.arange(3)) % 3]
    # One integer for each face, sufficient for three indices below two million.
    keys = corners @ np.array([len(chosen) ** 2, len(chosen), 1], dtype=np.int64)
    return CoarseMesh(chosen, corners[np.unique(keys, return_index=True)[1]])


def _keys(points: npt.NDArray[np.float64], size: float, per_side: float) -> IntArray:
    """Return the cell index of each point."""
    cells = np.minimum((points * (per_side / size)).astype(np.int64), int(per_side))
    side = int(per_side) + 1
    return np.asarray((cells[:, 0] * side + cells[:, 1]) * side + cells[:, 2])
