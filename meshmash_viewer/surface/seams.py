"""Seams: coincident open edges of a surface, as between chunks of one mesh."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.mesh import IntArray
from meshmash_viewer.surface.edges import side_codes


def join_seams(places: IntArray, faces: IntArray) -> IntArray:
    """Join the vertices of coincident open edges.

    A seam consists of exactly two edges, each of one face, with both ends at the same positions,
    unless the faces are the same triangle. Sheets that touch at a vertex, along edges with two
    faces, or along more than two coincident edges are not joined.

    Parameters
    ----------
    places : ndarray of int64, shape (n,)
        For each vertex, the lowest index of those at exactly the same position.
    faces : ndarray of int64, shape (m, 3)

    Returns
    -------
    ndarray of int64, shape (n,)
        For each vertex, the lowest index of those joined with it.
    """
    joined = np.arange(len(places))
    if np.array_equal(places, joined):
        return joined
    at = places[faces]
    # faces with two corners at one position are ignored
    a, b, c = at.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    while True:
        pairs = _seam_ends(places, joined[faces])
        if not len(pairs):
            return joined
        joined = _lowest(pairs, len(places))[joined]


def _seam_ends(places: IntArray, faces: IntArray) -> IntArray:
    """Find pairs of coincident vertices at the ends of seams, shape (p, 2)."""
    n = len(places)
    codes = side_codes(faces, n)
    order = np.argsort(codes >> 1, kind="stable")
    counts, starts = _runs((codes >> 1)[order])
    sides = order[starts[counts == 1]]
    tail, tip = faces.ravel()[sides], faces[:, [1, 2, 0]].ravel()[sides]
    opposite = places[faces[:, [2, 0, 1]].ravel()[sides]]
    swapped = places[tail] > places[tip]
    low, high = np.where(swapped, tip, tail), np.where(swapped, tail, tip)
    key = places[low] * np.int64(n) + places[high]
    order = np.argsort(key, kind="stable")
    counts, starts = _runs(key[order])
    first, second = order[starts[counts == 2]], order[starts[counts == 2] + 1]
    other = opposite[first] != opposite[second]
    first, second = first[other], second[other]
    ends = np.concatenate(
        [
            np.column_stack([low[first], low[second]]),
            np.column_stack([high[first], high[second]]),
        ]
    )
    return np.asarray(ends[ends[:, 0] != ends[:, 1]])


def _runs(ordered: IntArray) -> tuple[IntArray, IntArray]:
    """Return lengths and starts of runs of equal numbers."""
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    return np.diff(starts, append=len(ordered)), starts


def _lowest(pairs: IntArray, n: int) -> IntArray:
    """Return the lowest index connected with each of n vertices."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    _, first = np.unique(labels, return_index=True)
    return np.asarray(first[labels])
