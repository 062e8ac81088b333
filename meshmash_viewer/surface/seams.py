"""Seams: open edges of a surface that lie on one another, as chunks of one surface have them."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.mesh import IntArray
from meshmash_viewer.surface.edges import side_codes


def join_seams(places: IntArray, faces: IntArray) -> IntArray:
    """Join the vertices of open edges that lie on one another.

    A seam is where exactly two edges of one face each have both ends at the same places, and these
    faces are not the same triangle. Sheets that touch, at a vertex, along edges that have two
    faces, or where it is not clear which of more than two edges belong together, stay apart.

    Parameters
    ----------
    places : ndarray of int64, shape (n,)
        For each vertex, the lowest index of those at exactly the same place.
    faces : ndarray of int64, shape (m, 3)

    Returns
    -------
    ndarray of int64, shape (n,)
        For each vertex, the lowest index of those that it is one with.
    """
    joined = np.arange(len(places))
    if np.array_equal(places, joined):
        return joined
    at = places[faces]
    # faces with two corners at one place are no part of the surface
    a, b, c = at.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    while True:
        pairs = _seam_ends(places, joined[faces])
        if not len(pairs):
            return joined
        joined = _lowest(pairs, len(places))[joined]


def _seam_ends(places: IntArray, faces: IntArray) -> IntArray:
    """Pairs of vertices at one place that the ends of a seam have, shape (p, 2)."""
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
    """Lengths of runs of equal numbers, and where they start."""
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    return np.diff(starts, append=len(ordered)), starts


def _lowest(pairs: IntArray, n: int) -> IntArray:
    """The lowest index that each of n is connected with."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    _, first = np.unique(labels, return_index=True)
    return np.asarray(first[labels])
