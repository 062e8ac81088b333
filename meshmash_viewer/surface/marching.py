"""Compiled loops for distances along a surface, which release the interpreter lock.

Import this module inside the functions that use it, since it loads the compiler.

A surface is described by `faces`, shape (m, 3); `sides`, (m, 3), the length of the side opposite to
each corner; and `starts`, (n + 1,), and `around`: the faces of vertex v are
``around[starts[v] : starts[v + 1]]``. Any number of faces may meet at an edge.
"""

from __future__ import annotations

import heapq

import numpy as np

from meshmash_viewer.spectral.engine.compiler import import_compiler

numba = import_compiler()

#: Relative difference of distances that may be due to rounding.
_ROUNDING = 1e-11
#: Smallest height of a face, as a share of its base: paths also cross faces without area.
_FLATTEST = 1e-9
#: Longest side along which the directions of paths are interpolated, as a share of the distance.
_LONGEST = 0.5
#: How often the distance of a vertex is extended: once, and after corrections.
_EXTENDED = 4
#: Difference of the angles of faces that share a vertex and no edge.
_APART = 100.0
#: Smallest whole angle of a vertex at which shortest paths may turn: 2π, less its rounding error.
_STRAIGHT = 2.0 * np.pi - 1e-5


@numba.njit(cache=True, nogil=True)
def surround(vertices, faces):  # type: ignore[no-untyped-def]
    """Compute `sides`, `starts` and `around` of a surface."""
    m, n = len(faces), len(vertices)
    sides, around = np.empty((m, 3)), np.empty(3 * m, np.int32)
    starts = np.zeros(n + 2, np.int32)
    for f in range(m):
        for k in range(3):
            starts[faces[f, k] + 2] += 1
            square = 0.0
            for axis in range(3):
                a, b = vertices[faces[f, (k + 1) % 3], axis], vertices[faces[f, (k + 2) % 3], axis]
                square += (a - b) ** 2
            sides[f, k] = np.sqrt(square)
    for v in range(2, n + 2):
        starts[v] += starts[v - 1]
    for f in range(m):
        for k in range(3):
            around[starts[faces[f, k] + 1]] = f
            starts[faces[f, k] + 1] += 1
    return sides, starts[:-1], around


@numba.njit(cache=True, nogil=True)
def fans(starts, around, faces, sides):  # type: ignore[no-untyped-def]
    """Compute the angles of sides around their ends, and the whole angle of each vertex.

    ``angles[f, k, 0]`` and ``[f, k, 1]`` are the angles at corner k of the sides to the next corner
    and to the one after it. They are counted from face to face around the vertex, across edges of
    two faces. If the faces do not close, the whole angle is 0.
    """
    angles = np.full((len(faces), 3, 2), np.nan, np.float32)
    whole = np.zeros(len(starts) - 1, np.float32)
    for v in range(len(whole)):
        base = 0.0
        for border in (True, False):  # fans that begin at a border, then closed fans
            for place in range(starts[v], starts[v + 1]):
                f = around[place]
                k = _corner(faces, f, v)
                for after in (1, 2):
                    u = faces[f, (k + after) % 3]
                    if np.isnan(angles[f, k, 0]) and not (
                        border and _other(starts, around, faces, f, v, u) >= 0
                    ):
                        end, closed = _fan(starts, around, faces, sides, angles, v, f, u, base)
                        whole[v] = end if closed and base == 0.0 else 0.0
                        base = end + _APART
    return angles, whole


@numba.njit(cache=True, nogil=True)
def _fan(starts, around, faces, sides, angles, v, f, u, angle):  # type: ignore[no-untyped-def]
    """Fill in the angles around v from the side vu of a face; return the last, and if it closes."""
    g = f
    while g >= 0:
        k = _corner(faces, g, v)
        if not np.isnan(angles[g, k, 0]):
            return angle, g == f
        near = 0 if faces[g, (k + 1) % 3] == u else 1
        angles[g, k, near] = angle
        angle += _angle(sides, g, k)
        angles[g, k, 1 - near] = angle
        u = faces[g, (k + 2 - near) % 3]
        g = _other(starts, around, faces, g, v, u)
    return angle, False


@numba.njit(cache=True, nogil=True)
def _corner(faces, f, v):  # type: ignore[no-untyped-def]
    return 0 if faces[f, 0] == v else (1 if faces[f, 1] == v else 2)


@numba.njit(cache=True, nogil=True)
def _angle(sides, f, k):  # type: ignore[no-untyped-def]
    """Compute the angle of a face at a corner; 0 next to a side of no length."""
    p, q = sides[f, (k + 1) % 3], sides[f, (k + 2) % 3]
    if p <= 0.0 or q <= 0.0:
        return 0.0
    cosine = (p * p + q * q - sides[f, k] * sides[f, k]) / (2.0 * p * q)
    return np.arccos(min(max(cosine, -1.0), 1.0))


@numba.njit(cache=True, nogil=True)
def _other(starts, around, faces, f, v, u):  # type: ignore[no-untyped-def]
    """Return the other face at an edge vu of exactly two faces; else -1."""
    found, count = -1, 0
    for place in range(starts[v], starts[v + 1]):
        g = around[place]
        if g != f and (faces[g, 0] == u or faces[g, 1] == u or faces[g, 2] == u):
            found, count = g, count + 1
    return found if count == 1 else -1


@numba.njit(cache=True, nogil=True)
def _third(base, left, right):  # type: ignore[no-untyped-def]
    """Compute where the third corner of a face lies: along its base from the left, and above it."""
    x = 0.5 * (base + (left - right) * (left + right) / base)
    return x, np.sqrt(max(left * left - x * x, (_FLATTEST * base) ** 2))


@numba.njit(cache=True, nogil=True)
def march(surface, angles, whole, distance, seeds, exact, passable, radius):  # type: ignore[no-untyped-def]
    """Extend distances over faces, nearest vertices first; return the mask of vertices reached.

    `surface` is ``(starts, around, faces, sides)``. `distance`, shape (n,), is given at `seeds`,
    which are extended, and updated within the radius; distances up to `exact` are not changed. Only
    vertices in the mask `passable` are reached, or all if it is empty.

    A vertex is corrected when a neighbour becomes nearer, so that obtuse faces are no exception.
    The number of corrections is limited, since rounding could repeat them without end.
    """
    starts, around, faces, sides = surface
    arrival = np.full(len(distance), np.nan, np.float32)
    extended = np.zeros(len(distance), np.uint8)
    queue = [(distance[v], np.int64(v)) for v in seeds]
    heapq.heapify(queue)
    while len(queue):
        here, v = heapq.heappop(queue)
        if here > distance[v]:
            continue
        extended[v] += 1
        for place in range(starts[v], starts[v + 1]):
            f = around[place]
            at = _corner(faces, f, v)
            for turn in (1, 2):
                i, j = (at + turn) % 3, (at + 3 - turn) % 3
                u, there = faces[f, i], distance[faces[f, j]]
                if distance[u] <= max(exact, min(here, there)) or extended[u] == _EXTENDED:
                    continue
                if len(passable) and not passable[u]:
                    continue
                found, turned = here + sides[f, j], 0.0
                if abs(there - here) < sides[f, i]:
                    bearings = (
                        _bearing(angles, whole, arrival[v], v, f, at, j),
                        _bearing(angles, whole, arrival[faces[f, j]], faces[f, j], f, j, at),
                    )
                    crossed, beyond = _cross(
                        sides[f, i], sides[f, j], sides[f, at], here, there, *bearings
                    )
                    if crossed < found:
                        found, turned = crossed, beyond
                if found < distance[u] * (1.0 - _ROUNDING) and found <= radius:
                    distance[u] = found
                    side = 0 if at == (i + 1) % 3 else 1
                    first, last = angles[f, i, side], angles[f, i, 1 - side]
                    arrival[u] = first + turned if last >= first else first - turned
                    heapq.heappush(queue, (found, np.int64(u)))
    return extended > 0


@numba.njit(cache=True, nogil=True)
def _bearing(angles, whole, arrival, v, f, k, j):  # type: ignore[no-untyped-def]
    """Compute the angle from the side of corners k and j, away from the face, to a path's arrival.

    It is NaN if the path to corner k, vertex v, does not arrive from beyond this side.
    """
    side = 0 if j == (k + 1) % 3 else 1
    base, inner = angles[f, k, side], angles[f, k, 1 - side]
    angle = arrival - base if base > inner else base - arrival
    if whole[v] > 0.0 and angle < 0.0:
        angle += whole[v]
    return angle if 0.0 <= angle <= np.pi else np.nan


@numba.njit(cache=True, nogil=True)
def _cross(base, left, right, here, there, first, last):  # type: ignore[no-untyped-def]
    """Compute the distance of the third corner of a face by paths that cross its base.

    `here` and `there` are the distances of the ends of the base, `first` and `last` the angles
    between the base and the paths to them. The distances determine the source in the plane of the
    face, and so the path. On a curved surface this alone accumulates an error of first order, so
    distances along the base are corrected by the cubic that has the slopes of the angles.

    Returned are the distance, infinite if no path crosses the base, and the angle of the path from
    the left side.
    """
    x = 0.5 * (base + (here - there) * (here + there) / base)
    deep = np.sqrt(max(here * here - x * x, 0.0))
    foot, top = _third(base, left, right)
    at = x + (foot - x) * deep / (deep + top)
    if not 0.0 <= at <= base:
        return np.inf, 0.0
    found = np.sqrt((foot - x) ** 2 + (deep + top) ** 2)
    if base < _LONGEST * min(here, there) and not np.isnan(first + last):
        t = at / base
        r = 1.0 - t
        # slopes at the ends, minus those of distances from the source in the plane
        leave, reach = x / here - np.cos(first), (x - base) / there + np.cos(last)
        found += base * t * r * (leave * r - reach * t)
        # one Newton step to where the path is shortest; it changes the angle, not the distance
        slope = leave * r * (r - 2.0 * t) + reach * t * (t - 2.0 * r)
        planar = max(np.sqrt((at - x) ** 2 + deep * deep), 1e-300)
        rest = np.sqrt((foot - at) ** 2 + top * top)
        bend = (top / rest) ** 2 * (1.0 / rest + 1.0 / planar)
        at = min(max(at - slope / bend, 0.0), base)
    return found, np.arctan2(at * top, foot * (foot - at) + top * top)


@numba.njit(cache=True, nogil=True)
def unfold(surface, whole, distance, budget):  # type: ignore[no-untyped-def]
    """Compute exact distances near sources; return the distance up to which they are exact.

    A window is a part of a side that is seen in straight lines, through a strip of unfolded faces,
    from a source or a vertex at which shortest paths may turn, by its `whole` angle (`fans`).
    Windows are continued through the faces, nearest first [1]_, until about `budget` faces have
    been visited.

    `distance`, shape (n,), is 0 at sources, infinite elsewhere, and updated. Those above the
    returned distance are lengths of some path, not of the shortest.

    References
    ----------
    .. [1] Xin, S.-Q. and Wang, G.-J. (2009). "Improving Chen and Han's Algorithm on the Discrete
       Geodesic Problem." ACM Transactions on Graphics 28(4).
    """
    starts, _, faces, _ = surface
    # at each corner, the best distance through the opposite side, and where its path crosses it
    best, split = np.full(faces.shape, np.inf), np.zeros(faces.shape)
    #: face to enter, its corner opposite to the window, ends of the window and position of the
    #: source (along the side and before it), distance of that source
    windows = [(np.int64(0), np.int64(0), 0.0, 0.0, 0.0, 0.0, 0.0) for _ in range(0)]
    #: distance, and index of a window, or -1 - v for a vertex
    queue = [(0.0, -1 - v) for v in np.flatnonzero(distance == 0.0)]
    while len(queue) and budget > 0:
        here, item = heapq.heappop(queue)
        if item >= 0:
            budget -= 1 + _continue(surface, distance, best, split, windows, queue, windows[item])
        elif here <= distance[-1 - item]:
            v = -1 - item
            # paths turn at sources, and at vertices except inside a closed fan of less than 2π
            turns = here == 0.0 or not 0.0 < whole[v] < _STRAIGHT
            budget -= starts[v + 1] - starts[v]
            budget -= _leave(surface, distance, windows, queue, v, turns)
    return queue[0][0] if len(queue) else np.inf


@numba.njit(cache=True, nogil=True)
def _leave(surface, distance, windows, queue, v, turns):  # type: ignore[no-untyped-def]
    """Follow the edges of a vertex, and make windows of the opposite sides if paths turn at it."""
    starts, around, faces, sides = surface
    here, visited = distance[v], 0
    for place in range(starts[v], starts[v + 1]):
        f = around[place]
        k = _corner(faces, f, v)
        i, j = (k + 1) % 3, (k + 2) % 3
        _reach(distance, queue, faces[f, i], here + sides[f, j])
        _reach(distance, queue, faces[f, j], here + sides[f, i])
        base = sides[f, k]
        if turns and base > 0.0:
            x, y = _third(base, sides[f, j], sides[f, i])
            window = 0.0, base, x, y, here
            visited += _enter(surface, windows, queue, f, faces[f, i], faces[f, j], base, window)
    return visited


@numba.njit(cache=True, nogil=True)
def _reach(distance, queue, v, found):  # type: ignore[no-untyped-def]
    if found < distance[v]:
        distance[v] = found
        heapq.heappush(queue, (found, -1 - np.int64(v)))


@numba.njit(cache=True, nogil=True)
def _continue(surface, distance, best, split, windows, queue, window):  # type: ignore[no-untyped-def]
    """Continue a window through a face, unless other paths are shorter; return faces visited."""
    _, _, faces, sides = surface
    f, k, low, high, x, y, before = window
    a, b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3], faces[f, k]
    base, left, right = sides[f, k], sides[f, (k + 2) % 3], sides[f, (k + 1) % 3]
    more = 1.0 + _ROUNDING
    at_low = before + np.sqrt((low - x) ** 2 + y * y)
    at_high = before + np.sqrt((high - x) ** 2 + y * y)
    if at_high > (distance[a] + high) * more or at_low > (distance[b] + base - low) * more:
        return 0
    foot, top = _third(base, left, right)
    at = x + (foot - x) * y / (y + top)
    over_low, over_high = np.hypot(foot - low, top), np.hypot(foot - high, top)
    to_left = left > 0.0 and at > low and at_low <= (distance[c] + over_low) * more
    to_right = right > 0.0 and at < high and at_high <= (distance[c] + over_high) * more
    if low - _ROUNDING * base <= at <= high + _ROUNDING * base:
        found = before + np.sqrt((foot - x) ** 2 + (y + top) ** 2)
        _reach(distance, queue, c, found)
        if found < best[f, k]:
            best[f, k], split[f, k] = found, at
        elif found > best[f, k] * more:
            to_left, to_right = to_left and at < split[f, k], to_right and at > split[f, k]
    visited = 0
    if to_left:
        seen = _seen(low, min(high, at), x, y, foot, top, left)
        visited += _enter(surface, windows, queue, f, a, c, left, (*seen, before))
    if to_right:
        seen = _seen(base - high, base - max(low, at), base - x, y, base - foot, top, right)
        visited += _enter(surface, windows, queue, f, b, c, right, (*seen, before))
    return visited


@numba.njit(cache=True, nogil=True)
def _seen(low, high, x, y, foot, top, side):  # type: ignore[no-untyped-def]
    """Return the window on a side, from the base to the third corner, seen through a window."""
    near, far = foot * y - (low - x) * top, foot * y - (high - x) * top
    start = side * min(low * y / near, 1.0) if near > 0.0 else side
    stop = side * min(high * y / far, 1.0) if far > 0.0 else side
    return start, stop, (x * foot - y * top) / side, abs(x * top + y * foot) / side


@numba.njit(cache=True, nogil=True)
def _enter(surface, windows, queue, f, p, q, length, window):  # type: ignore[no-untyped-def]
    """Add a window on the side pq, measured from p, for each other face; return faces visited."""
    starts, around, faces, _ = surface
    low, high, x, y, before = window
    if not low < high or y <= 0.0:
        return 0
    nearest = before + np.hypot(max(low - x, 0.0, x - high), y)
    for place in range(starts[p], starts[p + 1]):
        g = np.int64(around[place])
        for k in range(3):
            i, j = faces[g, (k + 1) % 3], faces[g, (k + 2) % 3]
            if g == f or not ((i == p and j == q) or (i == q and j == p)):
                continue
            if i == p:
                windows.append((g, k, low, high, x, y, before))
            else:
                windows.append((g, k, length - high, length - low, length - x, y, before))
            heapq.heappush(queue, (nearest, len(windows) - 1))
    return starts[p + 1] - starts[p]
