"""Compiled loops over the triangles of the robust Laplacian, which release the interpreter lock.

Import this module inside the functions that use it, since it loads the compiler.

The robust Laplacian is that of a closed surface: two copies of each of m faces, glued in pairs
along their sides, with flipped edges (see `meshmash_viewer.cotangent_laplacian`). Side 3 f + i goes
from corner i of face f to the next corner. `corners`, shape (2m, 3), are vertices; `twins`, (6m,),
is the side with which each side is glued, in the opposite direction; `squares`, (2m, 3), are the
squared lengths of sides. `counts`, (2m,), is how often a face counts in sums over both copies: 2
in the first and 0 in the second where both are mirror images, else 1.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compiler import import_compiler

numba = import_compiler()

#: The number of columns of `residuals` is a multiple of this, the length of vector registers.
LANES = 8
#: Number of faces whose sums are in single precision.
_FACES = 1024
#: Smallest sum of the cotangents opposite to an edge at which the edge remains.
_DELAUNAY = -1e-9
#: Smallest area of a face, as a share of its squared sides.
_FLATTEST = 1e-15


@numba.njit(cache=True, nogil=True)
def triangulate(vertices, faces, mollify, flipped):  # type: ignore[no-untyped-def]
    """Compute `corners`, `twins`, cotangents of corners, (2m, 3), doubled areas, and `counts`.

    `mollify` is `OperatorOptions.mollify_factor`. Without `flipped`, the triangles are the faces.
    """
    corners, twins, counts = _glue(faces, len(vertices))
    squares = _squares(vertices, corners, mollify if flipped else 0.0)
    areas = np.empty(len(corners))
    for f in range(len(corners)):
        areas[f] = _doubled(squares[f, 0], squares[f, 1], squares[f, 2])
    if flipped:
        _flip(corners, twins, squares, areas, counts)
    for f in range(len(corners)):
        p, q, r, half = squares[f, 0], squares[f, 1], squares[f, 2], 0.5 / areas[f]
        squares[f, 0], squares[f, 1] = half * (p + r - q), half * (q + p - r)
        squares[f, 2] = half * (r + q - p)
    return corners, twins, squares, areas, counts


@numba.njit(cache=True, nogil=True)
def _glue(faces, n):  # type: ignore[no-untyped-def]
    """Compute `corners`, `twins` and `counts`: one copy of each face with the other of the next.

    The faces at an edge follow each other in their order.
    """
    m = len(faces)
    corners, counts = np.empty((2 * m, 3), np.int32), np.empty(2 * m, np.int8)
    # sides by their lower end, with the upper end if they go up, else its complement
    head, after, upper = (
        np.full(n, -1, np.int32),
        np.empty(3 * m, np.int32),
        np.empty(3 * m, np.int32),
    )
    for f in range(m - 1, -1, -1):
        counts[f], counts[f + m] = 2, 0
        for i in range(3):
            a, b, h = faces[f, i], faces[f, i - 2], 3 * f + i
            corners[f, i] = corners[f + m, 2 - i] = a
            upper[h] = b if a < b else ~a
            after[h], head[min(a, b)] = head[min(a, b)], h
    twins, lower = np.empty(6 * m, np.int32), np.full(n, -1, np.int32)
    first, last, many = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    for v in range(n):
        h = head[v]
        while h >= 0:
            w = max(upper[h], ~upper[h])
            if lower[w] == v:
                _join(twins, upper, last[w], h)
                many[w] += 1
            else:
                lower[w], first[w], many[w] = v, h, 1
            last[w], h = h, after[h]
        h = head[v]
        while h >= 0:
            w = max(upper[h], ~upper[h])
            if last[w] == h:
                _join(twins, upper, h, first[w])
            if many[w] > 2:
                counts[h // 3] = counts[h // 3 + m] = 1
            h = after[h]
    return corners, twins, counts


@numba.njit(cache=True, nogil=True)
def _join(twins, upper, h, g):  # type: ignore[no-untyped-def]
    """Glue the copy of side h that goes up with the copy of side g that goes down."""
    m = len(upper)
    up = h if upper[h] >= 0 else m + h // 3 * 3 + (4 - h % 3) % 3
    down = g if upper[g] < 0 else m + g // 3 * 3 + (4 - g % 3) % 3
    twins[up], twins[down] = down, up


@numba.njit(cache=True, nogil=True)
def _squares(vertices, corners, mollify):  # type: ignore[no-untyped-def]
    """Compute `squares`, of sides that are longer by what makes the flattest face a triangle."""
    m, mean, flattest = len(corners) // 2, 0.0, np.inf
    squares = np.empty(corners.shape)
    for f in range(m):
        for i in range(3):
            a, b, square = corners[f, i], corners[f, i - 2], 0.0
            for axis in range(3):
                square += (vertices[a, axis] - vertices[b, axis]) ** 2
            squares[f, i] = np.sqrt(square)
            mean += squares[f, i] / (3 * m)
        p, q, r = squares[f, 0], squares[f, 1], squares[f, 2]
        flattest = min(flattest, p + q + r - 2.0 * max(p, q, r))
    added = max(mollify * mean - flattest, 0.0) if mollify else 0.0
    for f in range(m):
        for i in range(3):
            squares[f, i] = squares[f + m, (4 - i) % 3] = (squares[f, i] + added) ** 2
    return squares


@numba.njit(cache=True, nogil=True)
def _doubled(p, q, r):  # type: ignore[no-untyped-def]
    """Compute twice the area of a triangle from its squared sides."""
    return 0.5 * np.sqrt(max(4.0 * p * q - (p + q - r) ** 2, (_FLATTEST * (p + q + r)) ** 2))


@numba.njit(cache=True, nogil=True)
def _flat(h, t, squares, areas):  # type: ignore[no-untyped-def]
    """Whether the two angles opposite to an edge are larger than 180° together."""
    (f, i), (g, j) = divmod(h, 3), divmod(t, 3)
    here = (squares[f, i - 2] + squares[f, i - 1] - squares[f, i]) * areas[g]
    there = (squares[g, j - 2] + squares[g, j - 1] - squares[g, j]) * areas[f]
    return here + there < _DELAUNAY * areas[f] * areas[g] and f != g


@numba.njit(cache=True, nogil=True)
def _flip(corners, twins, squares, areas, counts):  # type: ignore[no-untyped-def]
    """Flip edges until all are Delaunay."""
    m, n = len(corners) // 2, len(twins)
    stack, stacked, size, flips = np.empty(n, np.int32), np.zeros(n, np.bool_), 0, 0
    for side in range(n):
        if side < twins[side] and _flat(side, twins[side], squares, areas):
            stack[size], stacked[side] = side, True
            size += 1
    while size > 0 and flips < 10 * n:
        size -= 1
        h = np.int64(stack[size])
        stacked[h] = False
        t = np.int64(twins[h])
        if not _flat(h, t, squares, areas):
            continue
        (f, i), (g, j) = divmod(h, 3), divmod(t, 3)
        ab, bc, ca = squares[f, i], squares[f, i - 2], squares[f, i - 1]
        ad, db, above, below = squares[g, j - 2], squares[g, j - 1], areas[f], areas[g]
        flips += 1
        if counts[f] != counts[g]:
            for face in (f, g):
                counts[face] = counts[(face + m) % (2 * m)] = 1
        # faces (a, b, c) and (b, a, d) become (a, d, c) and (b, c, d)
        cd = (0.25 * (ca - bc - ad + db) ** 2 + (above + below) ** 2) / ab
        corners[f, i - 2], corners[g, j - 2] = corners[g, j - 1], corners[f, i - 1]
        squares[f, i], squares[f, i - 2], squares[g, j], squares[g, j - 2] = ad, cd, bc, cd
        areas[f], areas[g] = _doubled(ad, cd, ca), _doubled(bc, cd, db)
        of_bc, of_ad = 3 * f + (i + 1) % 3, 3 * g + (j + 1) % 3
        right, left = twins[of_bc], twins[of_ad]
        right, left = (h if right == of_ad else right), (t if left == of_bc else left)
        twins[t], twins[right], twins[h], twins[left] = right, t, left, h
        twins[of_bc], twins[of_ad] = of_ad, of_bc
        for each in (h, t, 3 * f + (i + 2) % 3, 3 * g + (j + 2) % 3):
            lower = min(each, twins[each])
            if not stacked[lower] and _flat(each, twins[each], squares, areas):
                stack[size], stacked[lower] = lower, True
                size += 1


@numba.njit(cache=True, nogil=True, fastmath=True)
def residuals(corners, twins, cotangents, areas, counts, columns, values):  # type: ignore[no-untyped-def]
    """Compute the sums over triangles of `quick_error`, shape (2, k).

    `columns`, (n, k), are the values of k functions φ in single precision, k a multiple of `LANES`.
    The first sum is ``∫ (φa + φb + φc)² / 12``, for corners a, b, c of each triangle. The second
    is ``4/3 rᵀ K⁻¹ r``, where K is the stiffness matrix of three functions on a triangle, each 1 at
    the midpoint of a side and linear on the four parts of the triangle, and r is λ times their
    products with φ, plus half the flux of φ out of both triangles at the side.
    """
    single, width = numba.float32, columns.shape[1]
    sums, parts = np.zeros((2, width)), np.zeros((2, width), np.float32)
    near, w = np.empty(3, np.int64), np.empty((3, 4), np.float32)
    for f in range(len(corners)):
        if f % _FACES == 0:
            sums += parts
            parts[:] = 0.0
        count = counts[f]
        if count == 0:
            continue
        for i in range(3):
            here, after = cotangents[f, i], cotangents[f, i - 2]
            g, j = divmod(twins[3 * f + i], 3)
            near[i] = corners[g, j - 1]
            there, before = cotangents[g, j], cotangents[g, j - 2]
            w[i, 0], w[i, 1], w[i, 2] = here + after, there + before, after + there
            w[i, 3] = here + before
        x, y, z = cotangents[f, 0], cotangents[f, 1], cotangents[f, 2]
        s, d = x + y + z, count / (48.0 * (x + y) * (y + z) * (z + x))
        pp, qq, rr = (
            single(d * (s * s - z * z)),
            single(d * (s * s - x * x)),
            single(d * (s * s - y * y)),
        )
        d *= 2.0
        pq, qr, rp = (
            single(d * (y * s + z * x)),
            single(d * (z * s + x * y)),
            single(d * (x * s + y * z)),
        )
        mass, wave = single(count * areas[f] / 48.0), single(areas[f] / 10.0)
        a, b, c, d, e, g = corners[f, 0], corners[f, 1], corners[f, 2], near[0], near[1], near[2]
        p0, p1, p2, p3 = w[0, 0], w[0, 1], w[0, 2], w[0, 3]
        q0, q1, q2, q3 = w[1, 0], w[1, 1], w[1, 2], w[1, 3]
        r0, r1, r2, r3 = w[2, 0], w[2, 1], w[2, 2], w[2, 3]
        for k in range(width):
            u, v, t = columns[a, k], columns[b, k], columns[c, k]
            total = u + v + t
            parts[0, k] += mass * (total * total)
            total += total
            rate = wave * values[k]
            p = p0 * t + p1 * columns[d, k] - p2 * u - p3 * v + rate * (total - t)
            q = q0 * u + q1 * columns[e, k] - q2 * v - q3 * t + rate * (total - u)
            r = r0 * v + r1 * columns[g, k] - r2 * t - r3 * u + rate * (total - v)
            parts[1, k] += p * (pp * p + pq * q) + q * (qq * q + qr * r) + r * (rr * r + rp * p)
    return sums + parts
