"""Coarser meshes by quadric edge collapse, and by clusters of vertices for fast rendering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, distinct_corners
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh


def decimated(
    mesh: Mesh, reduction: float, aggressiveness: float = 7.0, least: int = 0
) -> tuple[Mesh, IntArray]:
    """Remove a share of the faces of each connected component.

    Components are decimated separately, in the order of their lowest vertex, so that none is merged
    with another. Components with fewer than `least` vertices are left out. A larger
    `aggressiveness` is faster and less exact. The result is deterministic.

    Returns the decimated mesh, without unreferenced vertices, and the index in it of each vertex of
    `mesh`, shape (n,), -1 if left out. `InputError` is raised if `reduction` is not in [0, 1), or
    all components are left out.
    """
    from scipy.ndimage import value_indices

    if not 0.0 <= reduction < 1.0:
        fault = f"The share of faces to remove is {reduction:g}"
        raise InputError("out-of-range", fault, "give one from 0 to below 1")
    sizes = np.bincount(mesh.component_labels[mesh.component_labels >= 0])
    if not (sizes >= least).any():
        fault = f"All components have fewer than {least:,} vertices, at most {sizes.max():,}"
        remedy = "give a smaller threshold (--min-vertices, min_vertex_threshold=)"
        raise InputError("no-faces", fault, remedy)
    faces = mesh.faces[mesh.distinct_corners]
    mapping = np.full(mesh.n_vertices, -1, dtype=np.int64)
    parts, count = [], 0
    for component, (own,) in value_indices(mesh.component_labels[faces[:, 0]]).items():
        if sizes[component] < least:
            continue
        used, corners = np.unique(faces[own], return_inverse=True)
        points, kept, places = _collapsed(
            mesh.vertices[used], corners.reshape(-1, 3), reduction, aggressiveness
        )
        mapping[used] = places + count
        parts.append((points, kept + count))
        count += len(points)
    vertices, triangles = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Mesh(vertices, triangles, unit=mesh.unit, name=mesh.name), mapping


def _collapsed(
    vertices: FloatArray, faces: IntArray, reduction: float, aggressiveness: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Decimate a component; return its vertices, its faces and the new index of each old vertex."""
    import fast_simplification

    same = vertices, faces, np.arange(len(vertices))
    if reduction == 0.0:
        return same
    center = vertices.mean(axis=0)  # the library replays collapses in single precision
    points, corners = vertices - center, faces.astype(np.int32)
    _, _, collapses = fast_simplification.simplify(
        points, corners, reduction, agg=aggressiveness, return_collapses=True
    )
    if not len(collapses):
        return same
    points, kept, mapping = fast_simplification.replay_simplification(points, corners, collapses)
    if not len(kept):
        return same  # a component of few faces would vanish
    return points.astype(np.float64) + center, kept, mapping


@dataclass(frozen=True, eq=False)
class CoarseMesh:
    """Coarse mesh of a subset of the vertices of a mesh, so that fields are only indexed.

    `representatives` are indices of vertices of the mesh; `faces` are indices into these.
    """

    representatives: IntArray
    faces: IntArray


def cluster_vertices(
    vertices: npt.NDArray[np.floating], faces: npt.NDArray[np.integer], count: int
) -> CoarseMesh:
    """Merge the vertices that share a cell of a regular grid (Rossignac & Borrel 1993).

    A cell is represented by its vertex nearest to the mean of its vertices; representatives are in
    ascending order. Faces that do not span three cells, and copies of faces, are removed. `count`
    is the approximate number of cells. Most of the time is spent on sorting the vertices twice and
    the remaining faces once.
    """
    faces = faces[distinct_corners(faces)]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    members = np.flatnonzero(used)
    points = vertices[members].astype(np.float64)
    points -= points.min(axis=0)
    size = float(points.max()) or 1.0
    # The number of occupied cells is about proportional to the squared number per side.
    cells_per_side = max(2.0, np.sqrt(count / 4.0))
    for _ in range(3):
        met = len(np.unique(_keys(points[:: max(1, len(points) // 200_000)], size, cells_per_side)))
        cells_per_side = float(np.clip(cells_per_side * np.sqrt(count / max(met, 1)), 1.0, 2e6))
    keys = _keys(points, size, cells_per_side)
    _, cluster, sizes = np.unique(keys, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(cluster, points[:, axis]) for axis in range(3)], axis=1)
    points -= (sums / sizes[:, None])[cluster]
    nearest_first = np.lexsort((np.einsum("ij,ij->i", points, points), cluster))
    # representatives in ascending order, which makes indexing a field fast
    chosen, rank = np.unique(members[nearest_first[np.cumsum(sizes) - sizes]], return_inverse=True)
    coarse_of = np.full(len(vertices), -1, dtype=np.int64)
    coarse_of[members] = rank[cluster]
    corners = coarse_of[faces]
    corners = corners[distinct_corners(corners)]
    # the smallest corner first, so that copies of a face are equal rows
    first = np.argmin(corners, axis=1)
    row = np.arange(len(corners))[:, None]
    corners = corners[row, (first[:, None] + np.arange(3)) % 3]
    # one integer for each face, large enough for three indices below two million
    keys = corners @ np.array([len(chosen) ** 2, len(chosen), 1], dtype=np.int64)
    return CoarseMesh(chosen, corners[np.unique(keys, return_index=True)[1]])


def _keys(points: npt.NDArray[np.float64], size: float, per_side: float) -> IntArray:
    """Return the cell index of each point, in a grid of `per_side` cells along `size`."""
    cells = np.minimum((points * (per_side / size)).astype(np.int64), int(per_side))
    side = int(per_side) + 1
    return np.asarray((cells[:, 0] * side + cells[:, 1]) * side + cells[:, 2])
