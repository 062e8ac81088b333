"""Edges of triangles: their faces and directions, borders of regions, and open seams."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray, distinct_corners
from meshmash_viewer.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a set of faces."""

    #: Shape (e,): key ``low * n + high`` of each edge, from its two vertices; ascending.
    keys: IntArray
    #: Shape (e,): number of faces of each edge.
    counts: IntArray
    #: Shape (e,): whether the edge has two faces that traverse it in the same direction: one of
    #: them is reversed.
    one_way: npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Winding:
    """Consistency of the orientation of the faces of a mesh."""

    #: Shape (e,): keys of the edges with two faces that traverse the edge in the same direction;
    #: duplicate faces are ignored.
    one_way: IntArray
    #: Shape (m,): mask of faces to reverse so that neighbours agree and closed parts face outwards.
    #: In an open part the orientation with less area is reversed, in a one-sided part none.
    reversed_faces: npt.NDArray[np.bool_]


def side_codes(faces: IntArray, n: int) -> IntArray:
    """Encode the sides 01, 12 and 20 of faces as integers, shape (3m,).

    A code is twice the key of the edge, plus 1 if the side goes from the higher vertex to the
    lower. Integers sort several times faster than pairs, and codes do not overflow for n below 2e9.
    """
    tail, tip = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    codes = np.minimum(tail, tip) * np.int64(n)
    codes += np.maximum(tail, tip)
    codes *= 2
    codes += tail > tip
    return codes


def edges_of(codes: IntArray) -> Edges:
    """Find the edges of faces from their `side_codes`."""
    ordered = np.sort(codes)
    keys = ordered >> 1
    starts, counts = _runs(keys)
    one_way = counts == 2
    one_way[one_way] = ordered[starts[one_way]] == ordered[starts[one_way] + 1]
    return Edges(keys[starts], counts, one_way)


def border_edges(faces: IntArray, values: npt.NDArray[Any]) -> IntArray:
    """Find the edges between faces of different values, shape (e, 2).

    The value of a face is the value of its last corner, as in the render.
    """
    first, second, last = (values[faces[:, corner]] for corner in range(3))
    mixed = (first != last) | (second != last)
    near = np.zeros(len(values), dtype=np.bool_)
    near[faces[mixed]] = True
    # at least one face of such an edge has different values, so that both ends are near
    n_near = sum(near[faces[:, corner]].astype(np.int8) for corner in range(3))
    candidates = np.flatnonzero(n_near > 1)
    keys = side_codes(faces[candidates], len(values)) >> 1
    order = np.argsort(keys, kind="stable")
    keys, of_face = keys[order], np.repeat(last[candidates], 3)[order]
    differs = (keys[1:] == keys[:-1]) & (of_face[1:] != of_face[:-1])
    found = np.unique(keys[1:][differs])
    return np.column_stack([found // len(values), found % len(values)])


def region_graph(vertices: FloatArray, faces: IntArray, values: npt.NDArray[Any]) -> IntArray:
    """Find pairs of regions that touch, shape (e, 2).

    A region is a connected set of vertices with equal values, represented in the result by its
    vertex nearest to its mean position. Vertices with values below zero are in no region.
    """
    n = len(vertices)
    keys = np.unique(side_codes(faces, n) >> 1)
    a, b = np.divmod(keys[(values[keys // n] >= 0) & (values[keys % n] >= 0)], n)
    same = values[a] == values[b]
    region = connected(a[same], b[same], n)
    size = np.bincount(region)
    means = np.stack([np.bincount(region, each) / size for each in vertices.T], axis=1)
    apart = np.linalg.norm(vertices - means[region], axis=1)
    order = np.lexsort((apart, region))
    nearest = order[np.cumsum(size) - size]
    pairs = np.sort(np.stack([region[a[~same]], region[b[~same]]], axis=1), axis=1)
    return np.asarray(nearest[np.unique(pairs, axis=0)])


def winding_of(mesh: Mesh, edges: Edges | None = None) -> Winding:
    """Find the faces whose orientation differs from that of their neighbours.

    `edges` are the edges of the faces with three distinct corners, if known.
    """
    n, none = mesh.n_vertices, np.zeros(mesh.n_faces, dtype=np.bool_)
    at = np.flatnonzero(mesh.distinct_corners)
    if edges is None:
        edges = edges_of(side_codes(mesh.faces[at], n))
    if edges.one_way.any() or (edges.counts > 2).any():
        repeated = mesh.duplicate_faces[at]
        if repeated.any():
            at = at[~repeated]
            edges = edges_of(side_codes(mesh.faces[at], n))
    one_way = edges.keys[edges.one_way]
    if len(one_way):
        none[at] = _reversed(mesh.vertices, mesh.faces[at], mesh.face_areas[at])
    return Winding(one_way, none)


def _reversed(vertices: FloatArray, faces: IntArray, areas: FloatArray) -> npt.NDArray[np.bool_]:
    """Find the faces to reverse (`Winding.reversed_faces`), shape (m,)."""
    m = len(faces)
    codes = side_codes(faces, len(vertices))
    order = np.argsort(codes, kind="stable")
    starts, counts = _runs(codes[order] >> 1)
    two = counts == 2
    sides = order[starts[two]], order[starts[two] + 1]
    first, second = sides[0] // 3, sides[1] // 3
    against = codes[sides[0]] == codes[sides[1]]
    # The graph has two nodes for each face: as it is, and reversed. Faces that agree are connected
    # in the same state, other faces in opposite states. A two-sided part then has two components.
    rows = np.concatenate([first, first + m])
    columns = np.concatenate([second + m * against, second + m * ~against])
    labels = connected(rows, columns, 2 * m)
    as_is, reversed_ = labels[:m], labels[m:]
    part = np.unique(np.minimum(as_is, reversed_), return_inverse=True)[1]
    side = as_is > reversed_
    n_parts = int(part.max()) + 1
    two_sided = np.bincount(part, as_is == reversed_, n_parts) == 0
    size = np.bincount(part, None, n_parts)
    held = np.bincount(part, side, n_parts)
    mixed = two_sided & (held > 0) & (held < size)
    open_ends = order[np.repeat(~two, counts)] // 3
    is_open = np.bincount(part[open_ends], None, n_parts) > 0
    larger = 2.0 * np.bincount(part, areas * side, n_parts) > np.bincount(part, areas, n_parts)
    # volumes with the faces of `side` reversed; a nearby origin avoids cancellation
    volumes = np.linalg.det(vertices[faces] - vertices[faces[0, 0]])
    inward = np.bincount(part, np.where(side, -volumes, volumes), n_parts) < 0.0
    # for each part: whether the faces of `side` are kept, and the other faces reversed
    stays = np.where(is_open, larger, inward)
    return np.asarray(mixed[part] & (side != stays[part]))


def join_seams(places: IntArray, faces: IntArray) -> IntArray:
    """Join the vertices of coincident open edges.

    A seam consists of exactly two edges with one face each, whose ends are at the same positions,
    unless the faces are the same triangle. Sheets that touch at a vertex, along edges with two
    faces, or along more than two coincident edges are not joined.

    `places`, shape (n,), is the lowest index of the vertices at the position of each vertex. The
    result, shape (n,), is the lowest index of the vertices joined with each vertex.
    """
    joined = np.arange(len(places))
    if np.array_equal(places, joined):
        return joined
    faces = faces[distinct_corners(places[faces])]
    while True:
        pairs = _seam_ends(places, joined[faces])
        if not len(pairs):
            return joined
        labels = connected(pairs[:, 0], pairs[:, 1], len(places))
        lowest = np.unique(labels, return_index=True)[1][labels]
        joined = lowest[joined]


def _seam_ends(places: IntArray, faces: IntArray) -> IntArray:
    """Find pairs of coincident vertices at the ends of seams, shape (p, 2)."""
    n = len(places)
    codes = side_codes(faces, n)
    order = np.argsort(codes >> 1, kind="stable")
    starts, counts = _runs((codes >> 1)[order])
    sides = order[starts[counts == 1]]
    tail, tip = faces.ravel()[sides], faces[:, [1, 2, 0]].ravel()[sides]
    opposite = places[faces[:, [2, 0, 1]].ravel()[sides]]
    swapped = places[tail] > places[tip]
    low, high = np.where(swapped, tip, tail), np.where(swapped, tail, tip)
    key = places[low] * np.int64(n) + places[high]
    order = np.argsort(key, kind="stable")
    starts, counts = _runs(key[order])
    first, second = order[starts[counts == 2]], order[starts[counts == 2] + 1]
    other = opposite[first] != opposite[second]
    first, second = first[other], second[other]
    ends = np.concatenate(
        [np.column_stack([low[first], low[second]]), np.column_stack([high[first], high[second]])]
    )
    return np.asarray(ends[ends[:, 0] != ends[:, 1]])


def _runs(ordered: IntArray) -> tuple[IntArray, IntArray]:
    """Return starts and lengths of the runs of equal numbers in a sorted array."""
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    return starts, np.diff(starts, append=len(ordered))


def count_connected(rows: IntArray, columns: IntArray, n: int) -> int:
    """Return the number of connected components of a graph of n nodes."""
    return int(connected(rows, columns, n).max(initial=-1)) + 1


def connected(rows: IntArray, columns: IntArray, n: int) -> IntArray:
    """Return the connected component of each of n nodes of a graph."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])
