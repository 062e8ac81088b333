"""Compiled loops of the multifrontal factor and its block solves.

They release the interpreter lock, so that slices of the spectrum run in threads. Blocks of vectors
have shape (n, 8), C order.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compiler import compiled, import_compiler
from meshmash_viewer.spectral.engine.kernels import added, load, store

numba = import_compiler()

_PANEL = 48
#: Number of multiplications in an update above which BLAS is faster.
_LARGE = 60000

U1, U2, U8 = (np.uint64(i) for i in (1, 2, 8))
_ELIMINATION = "boolean(float64[:, ::1], float64[:, ::1], int64, int64)"
_UPDATE = "void(float64[:, ::1], float64[:, ::1], int64, int64)"
_SOLVE = (
    "void(uint64[::1], uint64[::1], uint64[::1], uint64[::1],"
    " float64[::1], float64[::1], float64[::1])"
)


@compiled(_ELIMINATION, "contract", "nsz")
def _eliminate_panel(front, columns, k0, k1):  # type: ignore[no-untyped-def]
    """Factor columns k0 to k1 of the lower triangle of a front, without updating later columns.

    `columns` receives the unscaled columns as contiguous rows. Returns False if a pivot vanishes.
    """
    m = front.shape[0]
    for k in range(k0, k1):
        pivot = front[k, k]
        if pivot == 0.0 or not np.isfinite(pivot):
            return False
        inverse = 1.0 / pivot
        column = columns[k - k0]
        for i in range(k + 1, m):
            column[i] = front[i, k]
            front[i, k] *= inverse
        for i in range(k + 1, m):
            scaled = front[i, k]
            row = front[i]
            for j in range(k + 1, min(k1, i + 1)):
                row[j] -= scaled * column[j]
    return True


@compiled(_UPDATE, "contract", "nsz")
def _update_rest(front, columns, k0, k1):  # type: ignore[no-untyped-def]
    """Update the columns after a panel, lower triangle only."""
    for i in range(k1, front.shape[0]):
        row = front[i]
        k = k0
        while k + 4 <= k1:
            s0 = row[k]
            s1 = row[k + 1]
            s2 = row[k + 2]
            s3 = row[k + 3]
            c0 = columns[k - k0]
            c1 = columns[k - k0 + 1]
            c2 = columns[k - k0 + 2]
            c3 = columns[k - k0 + 3]
            for j in range(k1, i + 1):
                row[j] -= s0 * c0[j] + s1 * c1[j] + s2 * c2[j] + s3 * c3[j]
            k += 4
        while k < k1:
            s0 = row[k]
            c0 = columns[k - k0]
            for j in range(k1, i + 1):
                row[j] -= s0 * c0[j]
            k += 1


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _eliminate(front, w, columns):  # type: ignore[no-untyped-def]
    """Factor the leading w columns of the lower triangle of a front, in place."""
    m = front.shape[0]
    for k0 in range(0, w, _PANEL):
        k1 = min(k0 + _PANEL, w)
        if not _eliminate_panel(front, columns, k0, k1):
            return False
        rest = m - k1
        width = k1 - k0
        if rest * rest * width < _LARGE:
            _update_rest(front, columns, k0, k1)
            continue
        lower = np.empty((rest, width))
        unscaled = np.empty((rest, width))
        for i in range(rest):
            for k in range(width):
                lower[i, k] = front[k1 + i, k0 + k]
                unscaled[i, k] = columns[k, k1 + i]
        step = 192
        for t0 in range(0, rest, step):
            t1 = min(t0 + step, rest)
            update = np.dot(lower[t0:t1], unscaled[:t1].T)
            for i in range(t0, t1):
                row = front[k1 + i]
                for j in range(i + 1):
                    row[k1 + j] -= update[i - t0, j]
    return True


@numba.njit(cache=True, nogil=True)
def factor_numeric(  # type: ignore[no-untyped-def]  # noqa: C901
    data,
    shift,
    first,
    row_start,
    rows,
    block_start,
    children,
    start,
    index,
    stack_size,
    front_size,
    blocks,
    inverse,
    stop,
):
    """Compute LDLᵀ without pivoting; return the number of negative pivots.

    Returns -1 if a pivot vanishes, -2 if `stop` is set.

    `blocks` receives L with D on its diagonal, and `inverse` the diagonal of D⁻¹.
    """
    n = len(start) - 1
    s_count = len(first) - 1
    stack = np.empty(stack_size, np.float64)
    front_data = np.empty(front_size * front_size, np.float64)
    columns = np.empty((min(_PANEL, front_size), front_size), np.float64)
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
            for p in range(start[j], start[j + 1]):
                i = index[p]
                if i >= j:
                    front[place[i], k] += data[p]
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
        if not _eliminate(front, w, columns):
            return -1
        block = blocks[block_start[s] : block_start[s + 1]].reshape((m, w))
        for i in range(m):
            for k in range(w):
                block[i, k] = front[i, k] if k <= i else 0.0
        for k in range(w):
            inverse[first[s] + k] = 1.0 / front[k, k]
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


@compiled(_SOLVE, "contract", "nsz")
def solve_block(  # type: ignore[no-untyped-def]  # noqa: C901
    first, row_start, rows, block_start, blocks, inverse, x
):
    """Solve L D Lᵀ X = B in place; x is B, flat (n, 8), and `inverse` the diagonal of D⁻¹.

    Unsigned indices let the compiler keep a row of X in two registers. Rows are processed in pairs
    to hide the latency of sums; memory is read in ascending order in the forward solve and in
    descending order in the backward solve, so that the processor prefetches it.
    """
    s_count = len(first) - U1
    for s in range(s_count):
        start = first[s] * U8
        w = first[s + U1] - first[s]
        r0 = row_start[s]
        m = row_start[s + U1] - r0
        base = block_start[s]
        i = U1
        while i < m:
            at = rows[r0 + i] * U8
            b = base + i * w
            j = start
            one = load(x, at)
            if i < w or i + U1 == m:
                for k in range(b, b + min(i, w)):
                    one = added(one, -blocks[k], load(x, j))
                    j += U8
                i += U1
            else:
                also = rows[r0 + i + U1] * U8
                two = load(x, also)
                for k in range(b, b + w):
                    row = load(x, j)
                    one = added(one, -blocks[k], row)
                    two = added(two, -blocks[k + w], row)
                    j += U8
                store(x, also, two)
                i += U2
            store(x, at, one)
    for back in range(s_count):
        node = s_count - U1 - back
        start = first[node] * U8
        w = first[node + U1] - first[node]
        r0 = row_start[node]
        m = row_start[node + U1] - r0
        base = block_start[node]
        for k in range(w):
            pivot = inverse[first[node] + k]
            for c in range(U8):
                x[start + k * U8 + c] *= pivot
        i = m
        while i > U1:
            i -= U1
            b = base + i * w
            j = start
            one = load(x, rows[r0 + i] * U8)
            if i <= w:
                for k in range(b, b + min(i, w)):
                    store(x, j, added(load(x, j), -blocks[k], one))
                    j += U8
                continue
            i -= U1
            two = load(x, rows[r0 + i] * U8)
            b -= w
            for k in range(b, b + w):
                row = added(load(x, j), -blocks[k + w], one)
                store(x, j, added(row, -blocks[k], two))
                j += U8
