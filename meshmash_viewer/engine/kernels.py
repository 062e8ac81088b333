"""Compiled loops: the multifrontal factor, its block solves, and the basis products.

All release the interpreter lock, so that slices run in threads. Blocks of vectors have shape
(n, 8), C order: eight columns fill two vector registers.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numba.core import config

from meshmash_viewer.engine import compilation as _compilation  # noqa: F401  before any kernel

__all__ = [
    "BLOCK",
    "collect_rows",
    "factor_numeric",
    "multiply_block",
    "multiply_block_exactly",
    "quotients_block",
    "remove_null_block",
    "solve_block",
    "spread_rows",
    "subtract_rows",
    "turn_rows",
]

#: Columns that a block solve takes at once.
BLOCK = 8
_PANEL = 48

U1, U2, U3, U4, U5, U6, U7, U8 = (np.uint64(i) for i in range(1, 9))
_SOLVE = "void(uint64[::1], uint64[::1], uint64[::1], uint64[::1], float64[::1], float64[::1])"
_PRODUCT = "void(uint64[::1], uint64[::1], float64[::1], float64[::1], float64[::1])"
_QUOTIENTS = "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])"
_SUBTRACTION = "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], int64, int64)"
_PASS = f"void({', '.join(['float64[:, ::1]'] * 9)})"
_TURN = "void(float64[:, ::1], float64[:, ::1])"
_TRANSPOSE = "void(float64[:, ::1], float64[:, ::1])"
_REMOVAL = "void(int64[::1], float64[::1], float64[:, ::1], float64[:, ::1])"

# The straight-line vectoriser doubles the speed of the solves; numba leaves it off unless told.
_config: Any = config
_slp_before = _config.SLP_VECTORIZE
_config.SLP_VECTORIZE = 1


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _eliminate(front, m, w):  # type: ignore[no-untyped-def]
    """Partial LDLᵀ of the leading w columns of the lower triangle of front[:m, :m], in place."""
    for k0 in range(0, w, _PANEL):
        k1 = min(k0 + _PANEL, w)
        # The panel itself, column after column.
        for k in range(k0, k1):
            pivot = front[k, k]
            if pivot == 0.0 or not np.isfinite(pivot):
                return False
            inverse = 1.0 / pivot
            for i in range(k + 1, m):
                scaled = front[i, k] * inverse
                if scaled != 0.0:
                    top = min(k1, i + 1)
                    for j in range(k + 1, top):
                        front[i, j] -= scaled * front[j, k]
            # Rows inside the panel are still needed unscaled by later rows; scale at the end.
            for i in range(k + 1, m):
                front[i, k] *= inverse
        rest = m - k1
        if rest <= 0:
            continue
        width = k1 - k0
        if rest * rest * width < 60000:
            for i in range(k1, m):
                for k in range(k0, k1):
                    scaled = front[i, k] * front[k, k]
                    for j in range(k1, i + 1):
                        front[i, j] -= scaled * front[j, k]
        else:
            lower = np.empty((rest, width))
            scaled_lower = np.empty((rest, width))
            for i in range(rest):
                for k in range(width):
                    lower[i, k] = front[k1 + i, k0 + k]
                    scaled_lower[i, k] = lower[i, k] * front[k0 + k, k0 + k]
            step = 192
            for t0 in range(0, rest, step):
                t1 = min(t0 + step, rest)
                update = np.dot(scaled_lower[t0:t1], lower[:t1].T)
                for i in range(t0, t1):
                    for j in range(i + 1):
                        front[k1 + i, k1 + j] -= update[i - t0, j]
    return True


@numba.njit(cache=True, nogil=True)
def factor_numeric(  # type: ignore[no-untyped-def]
    data,
    shift,
    first,
    row_start,
    rows,
    block_start,
    children,
    lower_start,
    lower_rows,
    lower_source,
    stack_size,
    front_size,
    blocks,
    stop,
):
    """Multifrontal LDLᵀ without pivoting; negative pivots, or -1 for failure, -2 for stop."""
    n = len(lower_start) - 1
    s_count = len(first) - 1
    stack = np.empty(stack_size, np.float64)
    front_data = np.empty(front_size * front_size, np.float64)
    pending = np.empty(s_count, np.int64)
    place = np.empty(n, np.int64)
    relative = np.empty(front_size, np.int64)
    top = 0
    n_pending = 0
    negative = 0
    for s in range(s_count):
        if stop[0] != 0:
            return -2
        m = row_start[s + 1] - row_start[s]
        w = first[s + 1] - first[s]
        front = front_data[: m * m].reshape((m, m))
        for i in range(m):
            for j in range(i + 1):
                front[i, j] = 0.0
        own = rows[row_start[s] : row_start[s + 1]]
        for i in range(m):
            place[own[i]] = i
        for k in range(w):
            j = first[s] + k
            for p in range(lower_start[j], lower_start[j + 1]):
                i = lower_rows[p]
                front[place[i], k] += data[lower_source[p]]
                if i == j:
                    front[k, k] -= shift
        for _ in range(children[s]):
            n_pending -= 1
            child = pending[n_pending]
            child_rows = rows[
                row_start[child] + first[child + 1] - first[child] : row_start[child + 1]
            ]
            u = len(child_rows)
            top -= u * u
            update = stack[top : top + u * u].reshape((u, u))
            for i in range(u):
                relative[i] = place[child_rows[i]]
            for i in range(u):
                target = front[relative[i]]
                for j in range(i + 1):
                    target[relative[j]] += update[i, j]
        if not _eliminate(front, m, w):
            return -1
        block = blocks[block_start[s] : block_start[s + 1]].reshape((m, w))
        for i in range(m):
            for k in range(w):
                block[i, k] = front[i, k] if k <= i else 0.0
        for k in range(w):
            if front[k, k] < 0.0:
                negative += 1
        u = m - w
        if u > 0:
            update = stack[top : top + u * u].reshape((u, u))
            for i in range(u):
                for j in range(i + 1):
                    update[i, j] = front[w + i, w + j]
            top += u * u
            pending[n_pending] = s
            n_pending += 1
    return negative


@numba.njit(_SOLVE, cache=True, nogil=True, fastmath={"contract", "nsz"})
def solve_block(first, row_start, rows, block_start, blocks, x):  # type: ignore[no-untyped-def]
    """Solve L D Lᵀ X = X in place; x is X of shape (n, 8), flat.

    Eight named sums and unsigned indices let the compiler keep a row of X in two registers.
    """
    s_count = len(first) - U1
    for s in range(s_count):
        c0 = first[s] * U8
        w = first[s + U1] - first[s]
        r0 = row_start[s]
        m = row_start[s + U1] - r0
        base = block_start[s]
        for i in range(U1, m):
            at = rows[r0 + i] * U8
            b = base + i * w
            a0 = x[at]
            a1 = x[at + U1]
            a2 = x[at + U2]
            a3 = x[at + U3]
            a4 = x[at + U4]
            a5 = x[at + U5]
            a6 = x[at + U6]
            a7 = x[at + U7]
            j = c0
            for k in range(b, b + min(i, w)):
                p = blocks[k]
                a0 -= p * x[j]
                a1 -= p * x[j + U1]
                a2 -= p * x[j + U2]
                a3 -= p * x[j + U3]
                a4 -= p * x[j + U4]
                a5 -= p * x[j + U5]
                a6 -= p * x[j + U6]
                a7 -= p * x[j + U7]
                j += U8
            x[at] = a0
            x[at + U1] = a1
            x[at + U2] = a2
            x[at + U3] = a3
            x[at + U4] = a4
            x[at + U5] = a5
            x[at + U6] = a6
            x[at + U7] = a7
    for back in range(s_count):
        node = s_count - U1 - back
        c0 = first[node] * U8
        w = first[node + U1] - first[node]
        r0 = row_start[node]
        m = row_start[node + U1] - r0
        base = block_start[node]
        for k in range(w):
            inverse = 1.0 / blocks[base + k * w + k]
            for c in range(U8):
                x[c0 + k * U8 + c] *= inverse
        for up in range(U1, m):
            i = m - up
            at = rows[r0 + i] * U8
            b = base + i * w
            a0 = x[at]
            a1 = x[at + U1]
            a2 = x[at + U2]
            a3 = x[at + U3]
            a4 = x[at + U4]
            a5 = x[at + U5]
            a6 = x[at + U6]
            a7 = x[at + U7]
            j = c0
            for k in range(b, b + min(i, w)):
                p = blocks[k]
                x[j] -= p * a0
                x[j + U1] -= p * a1
                x[j + U2] -= p * a2
                x[j + U3] -= p * a3
                x[j + U4] -= p * a4
                x[j + U5] -= p * a5
                x[j + U6] -= p * a6
                x[j + U7] -= p * a7
                j += U8


@numba.njit(_PRODUCT, cache=True, nogil=True, fastmath={"contract", "nsz"})
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


@numba.njit(_PRODUCT, cache=True, nogil=True)
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


@numba.njit(_REMOVAL, cache=True, nogil=True)
def remove_null_block(labels, direction, sums, x):  # type: ignore[no-untyped-def]
    """Project the direction of each component out of X of shape (n, 8), in place."""
    sums[:] = 0.0
    for i in range(len(labels)):
        if labels[i] >= 0:
            for c in range(8):
                sums[labels[i], c] += direction[i] * x[i, c]
    for i in range(len(labels)):
        if labels[i] >= 0:
            for c in range(8):
                x[i, c] -= direction[i] * sums[labels[i], c]


@numba.njit(_QUOTIENTS, cache=True, nogil=True)
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


@numba.njit(_SUBTRACTION, cache=True, nogil=True, fastmath={"contract", "nsz", "reassoc"})
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


@numba.njit(_SUBTRACTION, cache=True, nogil=True, fastmath={"contract", "nsz", "reassoc"})
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


@numba.njit(_PASS, cache=True, nogil=True)
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


@numba.njit(_TURN, cache=True, nogil=True, fastmath={"contract", "nsz", "reassoc"})
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


@numba.njit(_TRANSPOSE, cache=True, nogil=True)
def spread_rows(rows, columns):  # type: ignore[no-untyped-def]
    """columns = rowsᵀ for rows of shape (8, n)."""
    for i in range(columns.shape[0]):
        for c in range(8):
            columns[i, c] = rows[c, i]


@numba.njit(_TRANSPOSE, cache=True, nogil=True)
def collect_rows(columns, rows):  # type: ignore[no-untyped-def]
    """rows = columnsᵀ for columns of shape (n, 8)."""
    for i in range(columns.shape[0]):
        for c in range(8):
            rows[c, i] = columns[i, c]


_config.SLP_VECTORIZE = _slp_before
