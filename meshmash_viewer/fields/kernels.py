"""Compiled loops of fields from tables: one pass over all vertices, without temporary arrays.

Imported by the thread that builds a table: a window without one needs no compiler.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.compilation import numba

__all__ = ["combine", "distances"]

#: Vertices at a time: their sums stay in the processor's nearest cache.
_BLOCK = 4096


@numba.njit(
    "void(int16[:, ::1], float32[::1], float32, float32[::1])",
    cache=True,
    nogil=True,
    fastmath={"contract", "reassoc"},
)
def distances(coordinates, here, step, out):  # type: ignore[no-untyped-def]
    """Write ``out[j] = step * |coordinates[:, j] - here|`` for all vertices j.

    Coordinates have shape (r, n). Four rows are added at a time: otherwise it is the reading of
    the sums and not that of the coordinates that takes longest.
    """
    n_rows = len(coordinates)
    sums = np.empty(_BLOCK, np.float32)
    for start in range(0, len(out), _BLOCK):
        count = min(_BLOCK, len(out) - start)
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
    "void(uint16[:, ::1], float32[::1], float32[::1], float64, float32[::1])",
    cache=True,
    nogil=True,
    fastmath={"contract", "reassoc"},
)
def combine(columns, weights, base, low, out):  # type: ignore[no-untyped-def]
    """Write ``out[j] = weights @ columns[:, j] + base[j] + low`` for all vertices j.

    Columns have shape (4, n); one base may stand for all vertices. It may be thousands of times
    larger than what varies, so that it is added in float64.
    """
    c0, c1, c2, c3 = columns[0], columns[1], columns[2], columns[3]
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    same = np.float64(base[0]) + low
    many = len(base) > 1
    for j in range(len(out)):
        outer = w0 * np.float32(c0[j]) + w3 * np.float32(c3[j])
        inner = w1 * np.float32(c1[j]) + w2 * np.float32(c2[j])
        out[j] = np.float64(outer + inner) + (np.float64(base[j]) + low if many else same)
