"""Compiled loops over the vertices and faces of a surface.

Import this module where it is used, as it loads the compiler. All loops release the interpreter
lock.
"""

from __future__ import annotations

import heapq

import numpy as np

from meshmash_viewer.spectral.engine.compiler import import_compiler

numba = import_compiler()


@numba.njit(cache=True, nogil=True)
def spread(starts, around, faces, points, sources, radius, passable, distance, done):  # type: ignore[no-untyped-def]
    """Return the vertices within a distance of sources in their order, and the distances.

    `distance`, infinite everywhere, and `done`, nowhere true, are scratch, and left as they were.
    """
    queue = [(np.float32(0.0), sources[0])]
    for source in sources:
        distance[source] = 0.0
        heapq.heappush(queue, (np.float32(0.0), source))
    reached = [sources[0] for _ in range(0)]
    while len(queue):
        here, v = heapq.heappop(queue)
        if done[v]:
            continue
        done[v] = True
        reached.append(v)
        for place in range(starts[v], starts[v + 1]):
            f = around[place]
            for at in range(3):
                u = faces[f, at]
                if u == v or done[u] or not passable[u]:
                    continue
                w = faces[f, 0] + faces[f, 1] + faces[f, 2] - u - v
                found = np.float32(
                    _crossed(points[v], points[w], points[u], here, distance[w], done[w])
                )
                if found < distance[u] and found <= radius:
                    distance[u] = found
                    heapq.heappush(queue, (found, u))
    vertices = np.array(reached)
    found_at = distance[vertices]
    distance[vertices] = np.inf  # what has been reached has been in the queue
    done[vertices] = False
    return vertices, found_at


@numba.njit(cache=True, nogil=True)
def _crossed(a, b, c, at_a, at_b, known_b):  # type: ignore[no-untyped-def]
    """Compute the distance of c from those of a and b, by the straight line across the triangle."""
    edge = foot = side_a = side_b = 0.0
    for k in range(3):
        along, across, other = b[k] - a[k], c[k] - a[k], c[k] - b[k]
        edge += along * along
        foot += along * across
        side_a += across * across
        side_b += other * other
    if not known_b or edge <= 0.0:
        return at_a + np.sqrt(side_a)
    straight = min(at_a + np.sqrt(side_a), at_b + np.sqrt(side_b))
    edge = np.sqrt(edge)
    foot /= edge
    # the source in the plane of the triangle: x along the edge, `deep` below it
    x = (edge * edge + at_a * at_a - at_b * at_b) / (2.0 * edge)
    if at_a * at_a < x * x:
        return straight
    deep = np.sqrt(at_a * at_a - x * x)
    top = np.sqrt(max(side_a - foot * foot, 0.0))
    crossing = x + (foot - x) * deep / max(deep + top, 1e-300)
    if crossing < 0.0 or crossing > edge:
        return straight
    return np.sqrt((foot - x) ** 2 + (top + deep) ** 2)


@numba.njit(cache=True, nogil=True)
def in_picture(seen, low, picture):  # type: ignore[no-untyped-def]
    """Find the points over the marked pixels of a picture whose first pixel is at `low`, (n,)."""
    rows, columns = picture.shape
    result = np.zeros(len(seen), np.bool_)
    for v in range(len(seen)):
        x, y = seen[v, 0] - low[0] + 0.5, seen[v, 1] - low[1] + 0.5
        if 0.0 <= x < columns and 0.0 <= y < rows:
            result[v] = picture[int(y), int(x)]
    return result


@numba.njit(cache=True, nogil=True)
def heights_of(seen, faces, low, cell, rows, columns):  # type: ignore[no-untyped-def]
    """Return the largest heights of the faces in cells, at samples no farther apart than those."""
    heights = np.full((rows, columns), -np.inf, np.float32)
    # on which sides a vertex is outside, in one byte: of most faces nothing else is read
    sides = np.empty(len(seen), np.uint8)
    for v in range(len(seen)):
        x, y = seen[v, 0] - low[0], seen[v, 1] - low[1]
        across = 1 if x < 0.0 else 2 if x >= columns * cell else 0
        sides[v] = across | (4 if y < 0.0 else 8 if y >= rows * cell else 0)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if sides[a] & sides[b] & sides[c]:
            continue
        ax, bx, cx = (seen[a, 0] - low[0]), (seen[b, 0] - low[0]), (seen[c, 0] - low[0])
        ay, by, cy = (seen[a, 1] - low[1]), (seen[b, 1] - low[1]), (seen[c, 1] - low[1])
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        below, above = min(ay, by, cy), max(ay, by, cy)
        extent = max(right - left, above - below)
        if extent <= cell:  # most faces of large meshes: the corners are enough
            for v, x, y in ((a, ax, ay), (b, bx, by), (c, cx, cy)):
                if 0.0 <= x < columns * cell and 0.0 <= y < rows * cell:
                    row, column = min(int(y / cell), rows - 1), min(int(x / cell), columns - 1)
                    if seen[v, 2] > heights[row, column]:
                        heights[row, column] = seen[v, 2]
            continue
        pieces = int(np.ceil(min(extent / cell, 2000.0)))
        for i in range(pieces + 1):
            for j in range(pieces + 1 - i):
                p, q = i / pieces, j / pieces
                r = 1.0 - p - q
                x, y = (p * ax + q * bx + r * cx) / cell, (p * ay + q * by + r * cy) / cell
                if 0.0 <= x < columns and 0.0 <= y < rows:
                    z = p * seen[a, 2] + q * seen[b, 2] + r * seen[c, 2]
                    if z > heights[int(y), int(x)]:
                        heights[int(y), int(x)] = z
    return heights


@numba.njit(cache=True, nogil=True)
def parts_of(faces, mask):  # type: ignore[no-untyped-def]
    """Number the parts of a mask that sides of faces connect from 0, -1 outside, shape (n,)."""
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
                number[v] = number[root]  # the root is the lowest of its part
    return number
