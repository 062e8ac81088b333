"""Compiled loops over the vertices and faces of a surface, which release the interpreter lock.

Import this module inside the functions that use it, since it loads the compiler.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compiler import import_compiler

numba = import_compiler()

#: Side of the cells in which heights are compared, in pixels.
CELL = 3.0
#: Largest slope of a surface against the screen, within a cell.
_STEEPEST = 5.0


@numba.njit(cache=True, nogil=True)
def in_picture(seen, low, picture):  # type: ignore[no-untyped-def]
    """Return a mask of the points over True pixels of a picture with first pixel `low`, (n,)."""
    rows, columns = picture.shape
    result = np.zeros(len(seen), np.bool_)
    for v in range(len(seen)):
        x, y = seen[v, 0] - low[0] + 0.5, seen[v, 1] - low[1] + 0.5
        if 0.0 <= x < columns and 0.0 <= y < rows:
            result[v] = picture[int(y), int(x)]
    return result


@numba.njit(cache=True, nogil=True)
def project(points, axes, shift):  # type: ignore[no-untyped-def]
    """Compute ``points @ axes.T + shift`` in single precision, shape (n, 3)."""
    result = np.empty((len(points), 3), np.float32)
    for v in range(len(points)):
        x, y, z = points[v, 0], points[v, 1], points[v, 2]
        for k in range(3):
            result[v, k] = axes[k, 0] * x + axes[k, 1] * y + axes[k, 2] * z + shift[k]
    return result


@numba.njit(cache=True, nogil=True)
def visible(seen, faces, facing, chosen, drawn):  # type: ignore[no-untyped-def]
    """Return a mask of chosen vertices that face the eye and that no drawn face covers, (n,).

    `seen` and `facing` are attributes of `masks.Projection`. A face is drawn if its three corners
    are drawn; faces of at most `CELL` pixels may be left out. A vertex is compared with the largest
    height in its cell (see `heights_of`), minus the height by which its own face may rise within
    the cell, so that a steep surface does not cover itself.
    """
    result = chosen & (facing > 0.0)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for v in np.flatnonzero(result):
        for k in range(2):
            low[k], high[k] = min(low[k], seen[v, k]), max(high[k], seen[v, k])
    if low[0] > high[0]:
        return result
    columns, rows = int((high[0] - low[0]) / CELL) + 1, int((high[1] - low[1]) / CELL) + 1
    heights = heights_of(seen, faces, drawn, low, rows, columns)
    for v in np.flatnonzero(result):
        slope = np.sqrt(max(1.0 - facing[v] ** 2, 0.0)) / max(facing[v], 1e-6)
        room = CELL * (0.5 + 1.5 * min(slope, _STEEPEST))
        row, column = int((seen[v, 1] - low[1]) / CELL), int((seen[v, 0] - low[0]) / CELL)
        result[v] = seen[v, 2] >= heights[row, column] - room
    return result


@numba.njit(cache=True, nogil=True)
def heights_of(seen, faces, drawn, low, rows, columns):  # type: ignore[no-untyped-def]
    """Compute the largest height of the drawn faces in each cell, shape (rows, columns).

    `seen`, shape (n, 3), is the horizontal, the vertical position and the height of each vertex.
    A face is drawn if its three corners are drawn. It is sampled at its corners, and between
    corners more than one cell apart at distances of at most a cell.
    """
    heights = np.full((rows, columns), -np.inf, np.float32)
    # row and column of each vertex in four bytes: faces in random order read little memory
    cells = np.full((len(seen), 2), -32768, np.int16)
    for v in range(len(seen)):
        if drawn[v]:
            row, column = (seen[v, 1] - low[1]) / CELL, (seen[v, 0] - low[0]) / CELL
            cells[v, 0] = i = int(np.floor(min(max(row, -32000.0), 32000.0)))
            cells[v, 1] = j = int(np.floor(min(max(column, -32000.0), 32000.0)))
            if 0 <= i < rows and 0 <= j < columns:
                heights[i, j] = max(heights[i, j], seen[v, 2])
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        bottom = min(cells[a, 0], cells[b, 0], cells[c, 0])
        top = max(cells[a, 0], cells[b, 0], cells[c, 0])
        left = min(cells[a, 1], cells[b, 1], cells[c, 1])
        right = max(cells[a, 1], cells[b, 1], cells[c, 1])
        extent = max(top - bottom, right - left)
        if extent <= 1 or bottom == -32768:  # the corners suffice, or the face is not drawn
            continue
        if top < 0 or bottom >= rows or right < 0 or left >= columns:
            continue
        pieces = min(extent + 1, 2000)
        for i in range(pieces + 1):
            for j in range(pieces + 1 - i):
                p, q = i / pieces, j / pieces
                r = 1.0 - p - q
                x = (p * seen[a, 0] + q * seen[b, 0] + r * seen[c, 0] - low[0]) / CELL
                y = (p * seen[a, 1] + q * seen[b, 1] + r * seen[c, 1] - low[1]) / CELL
                if 0.0 <= x < columns and 0.0 <= y < rows:
                    z = p * seen[a, 2] + q * seen[b, 2] + r * seen[c, 2]
                    heights[int(y), int(x)] = max(heights[int(y), int(x)], z)
    return heights


@numba.njit(cache=True, nogil=True)
def parts_of(faces, mask):  # type: ignore[no-untyped-def]
    """Number the parts of a mask that are connected by edges, from 0; -1 outside, shape (n,)."""
    n = len(mask)
    parent = np.arange(n)
    for f in range(len(faces)):
        for at in range(3):
            v, w = faces[f, at], faces[f, (at + 1) % 3]
            if mask[v] and mask[w]:
                while parent[v] != v:
                    parent[v] = parent[parent[v]]
                    v = parent[v]
                while parent[w] != w:
                    parent[w] = parent[parent[w]]
                    w = parent[w]
                if v < w:
                    parent[w] = v
                else:
                    parent[v] = w
    number, count = np.full(n, -1, np.int64), 0
    for v in range(n):
        if mask[v]:
            root = v
            while parent[root] != root:
                root = parent[root]
            if root == v:
                number[v] = count
                count += 1
            else:
                number[v] = number[root]  # the root, the lowest vertex, is already numbered
    return number
