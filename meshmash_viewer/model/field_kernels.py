"""Compiled loops of fields from tables: one pass over all vertices, without temporary arrays.

Imported by the thread that builds a table: a window without one needs no compiler.
"""

from __future__ import annotations

import numba
import numpy as np

from meshmash_viewer.engine import compilation as _compilation  # noqa: F401  before any kernel

__all__ = ["combine", "distances"]

#: Vertices at a time: their sums stay in the processor's nearest cache.
_BLOCK = 4096


@numba.njit(
    "void(int16[:, ::1], float32[::1], float32, float32[::1], int64, int64)",
    cache=True,
    nogil=True,
    fastmath={"contract", "reassoc"},
)
def distances(coordinates, here, step, out, first, last):  # type: ignore[no-untyped-def]
    """Write ``out[j] = step * |coordinates[:, j] - here|`` from a first vertex j to a last.

    Coordinates have shape (r, n). Four rows are added at a time: otherwise it is the reading of
    the sums and not that of the coordinates that takes longest.
    """
    n_rows = len(coordinates)
    sums = np.empty(_BLOCK, np.float32)
    for start in range(first, last, _BLOCK):
        count = min(_BLOCK, last - start)
        stop = start + count
        sums[:] = 0.0
        row = 0
        while row + 4 <= n_rows:
            row_a, row_b = coordinates[row, start:stop], coordinates[row + 1, start:stop]
            row_c, row_d = coordinates[row + 2, start:stop], coordinates[row + 3, start:stop]
            here_a, here_b = here[row], here[row + 1]
            here_c, here_d = here[row + 2], here[row + 3]
            for i in range(count):
                a, b = np.float32(row_a[i]) - here_a, np.float32(row_b[i]) - here_b
                c, d = np.float32(row_c[i]) - here_c, np.float32(row_d[i]) - here_d
                sums[i] += (a * a + b * b) + (c * c + d * d)
            row += 4
        while row < n_rows:
            row_a, here_a = coordinates[row, start:stop], here[row]
            for i in range(count):
                a = np.float32(row_a[i]) - here_a
                sums[i] += a * a
            row += 1
        part = out[start:stop]
        for i in range(count):
            part[i] = np.sqrt(sums[i]) * step


@numba.njit(
    "void(float32[:, ::1], float64[::1], float32[::1], float32[::1], int64, int64)",
    cache=True,
    nogil=True,
    fastmath={"contract", "reassoc"},
)
def combine(columns, weights, base, out, first, last):  # type: ignore[no-untyped-def]
    """Write ``out[j] = weights @ columns[:, j] + base[j]`` from a first vertex j to a last.

    Columns have shape (6, n); one base may stand for all vertices. Weights may be large and of
    opposite signs: the sums are in float64.
    """
    c0, c1, c2 = columns[0, first:last], columns[1, first:last], columns[2, first:last]
    c3, c4, c5 = columns[3, first:last], columns[4, first:last], columns[5, first:last]
    out = out[first:last]
    w0, w1, w2, w3, w4, w5 = (
        weights[0], weights[1], weights[2], weights[3], weights[4], weights[5]
    )  # fmt: skip
    if len(base) == 1:
        same = base[0]
        for j in range(len(out)):
            near = w2 * c2[j] + w3 * c3[j]
            far = (w0 * c0[j] + w1 * c1[j]) + (w4 * c4[j] + w5 * c5[j])
            out[j] = (near + far) + same
        return
    base = base[first:last]
    for j in range(len(out)):
        near = w2 * c2[j] + w3 * c3[j]
        far = (w0 * c0[j] + w1 * c1[j]) + (w4 * c4[j] + w5 * c5[j])
        out[j] = (near + far) + base[j]
