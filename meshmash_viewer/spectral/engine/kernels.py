"""Compiled operations on blocks of vectors.

They release the interpreter lock, so that slices of the spectrum run in threads. Blocks have shape
(n, 8), C order: eight columns fill two vector registers.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compiler import compiled, import_compiler

numba = import_compiler()

U1, U2, U3, U4, U5, U6, U7, U8 = (np.uint64(i) for i in range(1, 9))
_PRODUCT = "void(uint64[::1], uint64[::1], float64[::1], float64[::1], float64[::1])"
_QUOTIENTS = "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])"
_TRANSPOSE = "void(float64[:, ::1], float64[:, ::1])"
_REMOVAL = "void(int64[::1], float64[::1], float64[:, ::1], float64[:, ::1])"


# Only without a loop does the compiler keep the eight numbers of a row in two registers.


@numba.njit(inline="always")
def load(x, at):  # type: ignore[no-untyped-def]
    """Return the eight numbers of a flat block that start at index `at`."""
    return (
        x[at],
        x[at + U1],
        x[at + U2],
        x[at + U3],
        x[at + U4],
        x[at + U5],
        x[at + U6],
        x[at + U7],
    )


@numba.njit(inline="always")
def store(x, at, row):  # type: ignore[no-untyped-def]
    """Write eight numbers into a flat block, starting at index `at`."""
    x[at] = row[0]
    x[at + U1] = row[1]
    x[at + U2] = row[2]
    x[at + U3] = row[3]
    x[at + U4] = row[4]
    x[at + U5] = row[5]
    x[at + U6] = row[6]
    x[at + U7] = row[7]


@numba.njit(inline="always")
def added(row, factor, other):  # type: ignore[no-untyped-def]
    """Return row + factor · other for rows of eight numbers."""
    return (
        row[0] + factor * other[0],
        row[1] + factor * other[1],
        row[2] + factor * other[2],
        row[3] + factor * other[3],
        row[4] + factor * other[4],
        row[5] + factor * other[5],
        row[6] + factor * other[6],
        row[7] + factor * other[7],
    )


@compiled(_PRODUCT, "contract", "nsz")
def multiply_block(start, index, data, x, y):  # type: ignore[no-untyped-def]
    """Compute Y = A X for symmetric A in compressed form; x and y are flat blocks (n, 8)."""
    for i in range(len(start) - U1):
        row = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for p in range(start[i], start[i + U1]):
            row = added(row, data[p], load(x, index[p] * U8))
        store(y, i * U8, row)


@compiled(_PRODUCT)
def multiply_block_exactly(start, index, data, x, y):  # type: ignore[no-untyped-def]
    """Compute Y = A X with sums in twice the precision, rounded once (Dekker 1971)."""
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
    """Project the null vector of each component out of X, shape (n, 8), in place."""
    sums[:] = 0.0
    if len(sums) == 1:
        # One component needs no slow indirect indexing: outside it the direction is 0.
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
    """Compute x·y and ‖w (y - (x·y) x)‖ / ‖w x‖ of each column, for x and y of shape (n, 8)."""
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


@compiled(_TRANSPOSE)
def collect_rows(columns, rows):  # type: ignore[no-untyped-def]
    """Set rows to columnsᵀ for columns of shape (n, 8)."""
    for i in range(columns.shape[0]):
        for c in range(8):
            rows[c, i] = columns[i, c]
