"""Compiled products of blocks of vectors: with the matrix, with each other, along rows.

All release the interpreter lock, so that slices run in threads. Blocks of vectors have shape
(n, 8), C order: eight columns fill two vector registers.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compilation import compiled

__all__ = [
    "collect_rows",
    "multiply_block",
    "multiply_block_exactly",
    "quotients_block",
    "remove_null_block",
    "spread_rows",
    "subtract_rows",
    "turn_rows",
]

U1, U2, U3, U4, U5, U6, U7, U8 = (np.uint64(i) for i in range(1, 9))
_PRODUCT = "void(uint64[::1], uint64[::1], float64[::1], float64[::1], float64[::1])"
_QUOTIENTS = "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])"
_SUBTRACTION = "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], int64, int64)"
_PASS = f"void({', '.join(['float64[:, ::1]'] * 9)})"
_TURN = "void(float64[:, ::1], float64[:, ::1])"
_TRANSPOSE = "void(float64[:, ::1], float64[:, ::1])"
_REMOVAL = "void(int64[::1], float64[::1], float64[:, ::1], float64[:, ::1])"


@compiled(_PRODUCT, "contract", "nsz")
def multiply_block(start, index, data, x, y):  # type: ignore[no-untyped-def]
    """Y = A X for symmetric A in compressed form; x and y are of shape (n, 8), flat."""
    for i in range(len(start) - U1):
        a0 = 0.0
        a1 = 0.0
        a2 = 0.0
        a3 = 0.0
        a4 = 0.0
        a5 = 0.0
        a6 = 0.0
        a7 = 0.0
        for p in range(start[i], start[i + U1]):
            v = data[p]
            j = index[p] * U8
            a0 += v * x[j]
            a1 += v * x[j + U1]
            a2 += v * x[j + U2]
            a3 += v * x[j + U3]
            a4 += v * x[j + U4]
            a5 += v * x[j + U5]
            a6 += v * x[j + U6]
            a7 += v * x[j + U7]
        at = i * U8
        y[at] = a0
        y[at + U1] = a1
        y[at + U2] = a2
        y[at + U3] = a3
        y[at + U4] = a4
        y[at + U5] = a5
        y[at + U6] = a6
        y[at + U7] = a7


@compiled(_PRODUCT)
def multiply_block_exactly(start, index, data, x, y):  # type: ignore[no-untyped-def]
    """Y = A X as `multiply_block`, each sum in twice the precision, rounded once (Dekker 1971)."""
    for i in range(len(start) - U1):
        for c in range(U8):
            total = 0.0
            rest = 0.0
            for p in range(start[i], start[i + U1]):
                v = data[p]
                u = x[index[p] * U8 + c]
                product = v * u
                split = 134217729.0 * v
                v_high = split - (split - v)
                split = 134217729.0 * u
                u_high = split - (split - u)
                v_low = v - v_high
                u_low = u - u_high
                lost = (
                    (v_high * u_high - product) + v_high * u_low + v_low * u_high
                ) + v_low * u_low
                after = total + product
                part = after - total
                rest += ((total - (after - part)) + (product - part)) + lost
                total = after
            y[i * U8 + c] = total + rest


@compiled(_REMOVAL)
def remove_null_block(labels, direction, sums, x):  # type: ignore[no-untyped-def]
    """Project the direction of each component out of X of shape (n, 8), in place."""
    sums[:] = 0.0
    if len(sums) == 1:
        # Vertices outside have the direction 0; a sum that has no place to be looked up is faster.
        only = sums[0]
        for i in range(len(direction)):
            for c in range(8):
                only[c] += direction[i] * x[i, c]
        for i in range(len(direction)):
            for c in range(8):
                x[i, c] -= direction[i] * only[c]
        return
    for i in range(len(labels)):
        if labels[i] >= 0:
            for c in range(8):
                sums[labels[i], c] += direction[i] * x[i, c]
    for i in range(len(labels)):
        if labels[i] >= 0:
            for c in range(8):
                x[i, c] -= direction[i] * sums[labels[i], c]


@compiled(_QUOTIENTS)
def quotients_block(x, y, weight, values, residuals):  # type: ignore[no-untyped-def]
    """x·y by columns, and ‖w (y - (x·y) x)‖ / ‖w x‖, for x and y of shape (n, 8)."""
    size = np.zeros(8)
    values[:] = 0.0
    residuals[:] = 0.0
    for i in range(x.shape[0]):
        for c in range(8):
            values[c] += x[i, c] * y[i, c]
    for i in range(x.shape[0]):
        for c in range(8):
            weighted = weight[i] * x[i, c]
            size[c] += weighted * weighted
            defect = weight[i] * y[i, c] - values[c] * weighted
            residuals[c] += defect * defect
    for c in range(8):
        if size[c] > 0.0:
            residuals[c] = np.sqrt(residuals[c] / size[c])


@compiled(_SUBTRACTION, "contract", "nsz", "reassoc")
def _subtract_stretch(target, source, weights, start, stop):  # type: ignore[no-untyped-def]
    """target -= weights · source between two places of the rows."""
    for s in range(0, source.shape[0], 4):
        s0 = source[s, start:stop]
        s1 = source[s + 1, start:stop]
        s2 = source[s + 2, start:stop]
        s3 = source[s + 3, start:stop]
        for r in range(0, 8, 2):
            t = target[r, start:stop]
            u = target[r + 1, start:stop]
            w0 = weights[r, s]
            w1 = weights[r, s + 1]
            w2 = weights[r, s + 2]
            w3 = weights[r, s + 3]
            v0 = weights[r + 1, s]
            v1 = weights[r + 1, s + 1]
            v2 = weights[r + 1, s + 2]
            v3 = weights[r + 1, s + 3]
            for c in range(stop - start):
                t[c] -= w0 * s0[c] + w1 * s1[c] + w2 * s2[c] + w3 * s3[c]
                u[c] -= v0 * s0[c] + v1 * s1[c] + v2 * s2[c] + v3 * s3[c]


@compiled(_SUBTRACTION, "contract", "nsz", "reassoc")
def _multiply_stretch(target, against, products, start, stop):  # type: ignore[no-untyped-def]
    """products += target · againstᵀ between two places of the rows."""
    for a in range(0, against.shape[0], 4):
        a0 = against[a, start:stop]
        a1 = against[a + 1, start:stop]
        a2 = against[a + 2, start:stop]
        a3 = against[a + 3, start:stop]
        for r in range(0, 8, 2):
            t0 = target[r, start:stop]
            t1 = target[r + 1, start:stop]
            p00 = p01 = p02 = p03 = p10 = p11 = p12 = p13 = 0.0
            for c in range(stop - start):
                p00 += t0[c] * a0[c]
                p01 += t0[c] * a1[c]
                p02 += t0[c] * a2[c]
                p03 += t0[c] * a3[c]
                p10 += t1[c] * a0[c]
                p11 += t1[c] * a1[c]
                p12 += t1[c] * a2[c]
                p13 += t1[c] * a3[c]
            products[r, a] += p00
            products[r, a + 1] += p01
            products[r, a + 2] += p02
            products[r, a + 3] += p03
            products[r + 1, a] += p10
            products[r + 1, a + 1] += p11
            products[r + 1, a + 2] += p12
            products[r + 1, a + 3] += p13


@compiled(_PASS)
def subtract_rows(  # type: ignore[no-untyped-def]
    target, first, first_weights, second, second_weights, one, one_products, two, two_products
):
    """target -= weights · sources, then products = target · rowsᵀ, in one pass over memory.

    Rows of shape (8, n) for `target`; two sources, and two sets of rows for products, of a
    multiple of four rows each, or none. The stretches fit the first cache.
    """
    n = target.shape[1]
    one_products[:] = 0.0
    two_products[:] = 0.0
    for start in range(0, n, 512):
        stop = min(start + 512, n)
        _subtract_stretch(target, first, first_weights, start, stop)
        _subtract_stretch(target, second, second_weights, start, stop)
        _multiply_stretch(target, one, one_products, start, stop)
        _multiply_stretch(target, two, two_products, start, stop)


@compiled(_TURN, "contract", "nsz", "reassoc")
def turn_rows(target, lower):  # type: ignore[no-untyped-def]
    """target = lower · target for rows of shape (8, n) and a lower triangle, in place."""
    n = target.shape[1]
    for start in range(0, n, 384):
        stop = min(start + 384, n)
        for r in range(7, -1, -1):
            t = target[r, start:stop]
            w = lower[r, r]
            for c in range(stop - start):
                t[c] *= w
            for s in range(r):
                w = lower[r, s]
                other = target[s, start:stop]
                for c in range(stop - start):
                    t[c] += w * other[c]


@compiled(_TRANSPOSE)
def spread_rows(rows, columns):  # type: ignore[no-untyped-def]
    """columns = rowsᵀ for rows of shape (8, n)."""
    for i in range(columns.shape[0]):
        for c in range(8):
            columns[i, c] = rows[c, i]


@compiled(_TRANSPOSE)
def collect_rows(columns, rows):  # type: ignore[no-untyped-def]
    """rows = columnsᵀ for columns of shape (n, 8)."""
    for i in range(columns.shape[0]):
        for c in range(8):
            rows[c, i] = columns[i, c]
