"""Level lines of a function on the vertices, those of zero first, by marching triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

__all__ = ["level_lines", "line_lengths", "nodal_lines", "nodal_segments"]


def nodal_lines(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    values: npt.NDArray[np.floating],
) -> npt.NDArray[np.floating]:
    """Segments along which the linear interpolation of `values` is zero, shape (s, 2, 3).

    A vertex of value zero counts as positive, so that each face that is crossed gives exactly one
    segment and the segments of neighbouring faces meet. Faces with a vertex that is not finite
    give none. The segments have the dtype of `vertices`.
    """
    values = np.asarray(values)
    with np.errstate(invalid="ignore"):
        # One byte a vertex: 0 below, 1 above, 4 unknown. The sum over a face tells all.
        side = (values >= 0.0).astype(np.uint8)
    side[~np.isfinite(values)] = 4
    corners = side[faces]
    count = corners[:, 0] + corners[:, 1] + corners[:, 2]
    crossed = np.flatnonzero((count == 1) | (count == 2))
    kept, count, corners = faces[crossed], count[crossed], corners[crossed]
    # The lone corner is the only 1 among zeros, or the only 0 among ones.
    lone = np.argmax(corners == np.where(count == 1, 1, 0)[:, None], axis=1)
    row = np.arange(len(kept))
    apex, left, right = (kept[row, (lone + turn) % 3] for turn in range(3))
    segments = np.empty((len(kept), 2, 3), dtype=vertices.dtype)
    for end, other in enumerate((left, right)):
        # From the lower index to the higher: both faces at an edge find the very same point.
        first, second = np.minimum(apex, other), np.maximum(apex, other)
        # In double precision: the difference of two tiny float32 values may underflow.
        a, b = values[first].astype(np.float64), values[second].astype(np.float64)
        # Signs differ, so the denominator is zero only if both are: 0 counts as positive.
        share = (a / (a - b)).astype(vertices.dtype)[:, None]
        segments[:, end] = (1 - share) * vertices[first] + share * vertices[second]
    return segments


def level_lines(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    values: npt.NDArray[np.floating],
    levels: Sequence[float],
) -> npt.NDArray[np.floating]:
    """Segments along which the linear interpolation of `values` is at one of the ascending levels.

    See `nodal_lines`; those of one level follow one another, shape (s, 2, 3).
    """
    # how many levels are at or below each vertex: a face is crossed by those between its corners
    reached = np.searchsorted(np.asarray(levels), values, side="right").astype(np.int32)
    corners = reached[faces]
    least, most = corners.min(axis=1), corners.max(axis=1)
    crossed = np.flatnonzero(least < most)
    faces, least, most = faces[crossed], least[crossed], most[crossed]
    found = [
        nodal_lines(vertices, faces[(least <= at) & (at < most)], values - np.float64(level))
        for at, level in enumerate(levels)
    ]
    return np.concatenate(found) if found else np.empty((0, 2, 3), dtype=vertices.dtype)


def line_lengths(segments: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Length of the line that each segment belongs to, shape (s,): those that share an end are one.

    A nodal line around a branch is as long as the branch is wide times π.
    """
    if not len(segments):
        return np.zeros(0)
    lengths = np.linalg.norm(np.diff(segments, axis=1)[:, 0].astype(np.float64), axis=1)
    ends = np.ascontiguousarray(segments).reshape(-1, 3)
    _, point = np.unique(ends.view([("", ends.dtype)] * 3)[:, 0], return_inverse=True)
    start, end = point.reshape(-1, 2).T
    joined = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), (point.max() + 1,) * 2)
    _, line = connected_components(joined, directed=False)
    return np.asarray(np.bincount(line[start], lengths)[line[start]])


def nodal_segments(
    vertices: npt.NDArray[np.floating],
    faces: npt.NDArray[np.integer],
    values: npt.NDArray[np.floating],
    centre: npt.NDArray[np.floating],
    levels: Sequence[float] = (0.0,),
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """`level_lines` relative to a centre, with the width of the branch that each goes around.

    Returns
    -------
    segments : ndarray of float32, shape (s, 2, 3)
    widths : ndarray of float64, shape (s,)
        The length of a line that goes around a branch is as wide as that times π. Infinite for
        other levels than zero, which are far apart and mark thin branches as well.
    """
    if tuple(levels) == (0.0,):
        segments = nodal_lines(vertices, faces, values)
        widths = np.asarray(line_lengths(segments) / np.pi, dtype=np.float64)
    else:
        segments = level_lines(vertices, faces, values, levels)
        widths = np.full(len(segments), np.inf)
    return (segments - centre).astype(np.float32), widths
