"""Decimation by quadric edge collapse, with the vertex that each vertex was collapsed into."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.units import counted


def decimated(
    mesh: Mesh, reduction: float, aggressiveness: float = 7.0, least: int = 0
) -> tuple[Mesh, IntArray]:
    """Remove a share of the faces of each connected component.

    Components are decimated separately, in the order of their lowest vertex, so that none is
    collapsed into another. The result is deterministic.

    `InputError` is raised if `reduction` is out of range, or all components are left out.

    Parameters
    ----------
    mesh : Mesh
    reduction : float
        Share of the faces to remove, at least 0 and below 1.
    aggressiveness : float
        Larger values are faster, and less exact.
    least : int
        Components with fewer vertices are left out.

    Returns
    -------
    simple : Mesh
        Without unreferenced vertices.
    mapping : ndarray of int, shape (n,)
        The vertex of `simple` for each vertex of `mesh`; -1 for vertices that are left out.
    """
    if not 0.0 <= reduction < 1.0:
        raise InputError(
            f"The share of faces to remove is {reduction:g}: give one from 0 to below 1."
        )
    labels = mesh.component_labels
    sizes = np.bincount(labels[labels >= 0])
    if not (sizes >= least).any():
        raise InputError(
            f"All components have fewer than {least} vertices, the largest"
            f" {counted(int(sizes.max()), 'vertex')}: give a smaller min_vertex_threshold."
        )
    faces = mesh.faces[mesh.distinct_corners]
    of_face = labels[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    groups = np.split(faces[order], np.cumsum(np.bincount(of_face))[:-1])
    mapping = np.full(mesh.n_vertices, -1, dtype=np.int64)
    parts, count = [], 0
    for group, size in zip(groups, sizes, strict=True):
        if size < least:
            continue
        used, corners = np.unique(group, return_inverse=True)
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
    """Return vertices, faces and mapping of a decimated component."""
    import fast_simplification

    same = vertices, faces, np.arange(len(vertices))
    if reduction == 0.0:
        return same
    center = vertices.mean(axis=0)  # the collapses are replayed in single precision
    points, corners = vertices - center, faces.astype(np.int32)
    _, _, collapses = fast_simplification.simplify(
        points, corners, reduction, agg=aggressiveness, return_collapses=True
    )
    if not len(collapses):
        return same
    points, kept, mapping = fast_simplification.replay_simplification(points, corners, collapses)
    used, kept = np.unique(kept, return_inverse=True)
    if not len(used):
        return same  # a component of few faces is collapsed as a whole
    places = np.full(len(points), -1)
    places[used] = np.arange(len(used))
    places = places[mapping]
    alone = np.flatnonzero(places < 0)
    if len(alone):  # collapsed into a vertex of no face: the nearest of the others
        from scipy.spatial import cKDTree

        places[alone] = cKDTree(points[used]).query(vertices[alone] - center)[1]
    return points[used].astype(np.float64) + center, kept.reshape(-1, 3), places
