"""Compiled loops of the preview: over edges, faces and vertices of a large mesh.

Imported when a preview is made; nothing else needs the compiler. All release the interpreter lock.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compilation import numba

__all__ = ["border_flows", "interpolate", "join_nearest", "nearest_seeds"]

#: Vertices interpolated before they are written: rows are far apart in memory.
_TOGETHER = 64


@numba.njit(cache=True, nogil=True)
def nearest_seeds(vertices, faces, seeds):  # type: ignore[no-untyped-def]
    """Index of the seed that is nearest along edges, shape (n,); -1 where none is reached.

    Distances are lowered until none can be lowered any more, roughly the shortest first; a
    heap would order them fully, at several times the cost. Faces have three corners.
    """
    n = len(vertices)
    starts = np.zeros(n + 2, np.int64)
    total, count = 0.0, 3 * len(faces)
    # Each face's sides in one direction: every corner is reached from every other, neighbours
    # mostly bring the other direction, and half the edges are half the time.
    for face in range(len(faces)):
        for corner in range(3):
            one, other = faces[face, corner], faces[face, (corner + 1) % 3]
            starts[one + 2] += 1
            total += np.sqrt(_squared(vertices, one, vertices, other))
    for vertex in range(n):
        starts[vertex + 2] += starts[vertex + 1]
    ends = np.empty(count, np.int32)
    for face in range(len(faces)):
        for corner in range(3):
            one = faces[face, corner]
            ends[starts[one + 1]] = faces[face, (corner + 1) % 3]
            starts[one + 1] += 1
    cells = np.full(n, -1, np.int64)
    distances = np.full(n, np.inf)
    queued = np.zeros(n, np.bool_)
    now = np.empty(n, np.int32)
    after = np.empty(n, np.int32)
    n_now, n_after = 0, 0
    for seed in range(len(seeds)):
        vertex = seeds[seed]
        cells[vertex] = seed
        distances[vertex] = 0.0
        queued[vertex] = True
        now[n_now] = vertex
        n_now += 1
    step = total / max(count, 1)
    # Coincident neighbours are as near as can be, but a zero would tell no order.
    shortest = 1e-6 * step
    bound = step
    while n_now:
        n_after = 0
        nearest = np.inf
        for place in range(n_now):
            vertex = now[place]
            own = distances[vertex]
            if own > bound:
                after[n_after] = vertex
                n_after += 1
                nearest = min(nearest, own)
                continue
            queued[vertex] = False
            for edge in range(starts[vertex], starts[vertex + 1]):
                other = ends[edge]
                length = np.sqrt(_squared(vertices, vertex, vertices, other))
                through = own + max(length, shortest)
                if through < distances[other]:
                    distances[other] = through
                    cells[other] = cells[vertex]
                    if not queued[other]:
                        queued[other] = True
                        after[n_after] = other
                        n_after += 1
                    nearest = min(nearest, through)
        now, after = after, now
        n_now = n_after
        if nearest > bound:
            bound = nearest + step
    return cells


@numba.njit(cache=True, nogil=True)
def _squared(points, a, others, b):  # type: ignore[no-untyped-def]
    x = points[a, 0] - others[b, 0]
    y = points[a, 1] - others[b, 1]
    z = points[a, 2] - others[b, 2]
    return x * x + y * y + z * z


@numba.njit(cache=True, nogil=True)
def join_nearest(vertices, cells, centroids, near):  # type: ignore[no-untyped-def]
    """The nearest centroid of each vertex among the candidates of its cell, shape (n,)."""
    result = np.empty_like(cells)
    for vertex in range(len(vertices)):
        cell = cells[vertex]
        best, shortest = cell, np.inf
        if cell >= 0:
            for place in range(near.shape[1]):
                candidate = near[cell, place]
                squared = _squared(vertices, vertex, centroids, candidate)
                if squared < shortest:
                    best, shortest = candidate, squared
        result[vertex] = best
    return result


@numba.njit(cache=True, nogil=True)
def border_flows(vertices, faces, areas, cells, centroids):  # type: ignore[no-untyped-def]
    """Weights between cells: one entry for each edge of a face that crosses a border.

    Returns rows, columns and weights; `areas` are those of the faces.
    """
    count = 0
    for face in range(len(faces)):
        p, q, r = cells[faces[face, 0]], cells[faces[face, 1]], cells[faces[face, 2]]
        count += (p != q) + (q != r) + (r != p)
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    weights = np.empty(count)
    count = 0
    for face in range(len(faces)):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        p, q, r = cells[i], cells[j], cells[k]
        if (p == q and q == r) or min(p, q, r) < 0 or areas[face] <= 0.0:
            continue
        for _ in range(3):
            if q != r:
                # half the cotangent at i, times the difference of a linear function along the
                # line between both centroids
                dot, along, squared = 0.0, 0.0, 0.0
                for axis in range(3):
                    u = vertices[j, axis] - vertices[i, axis]
                    v = vertices[k, axis] - vertices[i, axis]
                    between = centroids[q, axis] - centroids[r, axis]
                    dot += u * v
                    along += (u - v) * between
                    squared += between * between
                rows[count], columns[count] = q, r
                weights[count] = 0.25 * dot / areas[face] * along / max(squared, 1e-300)
                count += 1
            i, j, k = j, k, i
            p, q, r = q, r, p
    return rows[:count], columns[:count], weights[:count]


@numba.njit(cache=True, nogil=True)
def interpolate(rows, first, last, vertices, cells, centroids, near, values):  # type: ignore[no-untyped-def]
    """Write rows[:, first:last]: values at vertices between those at the centroids around them.

    The weight of a centroid is smooth, highest there, and zero where a candidate comes and goes.
    """
    width, n_rows = near.shape[1], values.shape[1]
    squared = np.empty(width)
    block = np.empty((_TOGETHER, n_rows), np.float32)
    for start in range(first, last, _TOGETHER):
        stop = min(start + _TOGETHER, last)
        block[:] = 0.0
        for vertex in range(start, stop):
            cell = cells[vertex]
            if cell < 0:
                continue
            farthest = 0.0
            for place in range(width):
                squared[place] = _squared(vertices, vertex, centroids, near[cell, place])
                farthest = max(farthest, squared[place])
            reach = 1.05 * farthest + 1e-300
            total = 0.0
            for place in range(width):
                # where there are fewer candidates the last one is repeated
                if near[cell, place] == near[cell, place - 1]:
                    squared[place] = 0.0
                else:
                    share = 1.0 - squared[place] / reach
                    squared[place] = share * share / (squared[place] + 1e-3 * reach)
                total += squared[place]
            if total <= 0.0:
                continue
            for place in range(width):
                weight = np.float32(squared[place] / total)
                if weight > 0.0:
                    candidate = near[cell, place]
                    for row in range(n_rows):
                        block[vertex - start, row] += weight * values[candidate, row]
        for row in range(n_rows):
            for vertex in range(start, stop):
                rows[row, vertex] = block[vertex - start, row]
