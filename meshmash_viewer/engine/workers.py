"""How many slices run at once, and what memory a run takes."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.engine.factorization import OrderedPencil

__all__ = ["memory_of_run", "slice_count", "worker_count"]

#: Pairs a slice should hold: more make its basis dear, fewer its factor and its ends.
_SLICE_PAIRS = 68
#: Fewer pairs than this are one slice.
_INDIVISIBLE = 48

#: Entries of the factor per vertex and bit of the number of vertices, on surfaces under METIS.
_FACTOR_DENSITY = 2.0


def slice_count(pairs: int) -> int:
    """Slices for so many pairs: an even number, so that two cores end together.

    Never a matter of how many cores there are, or results would depend on the machine.
    """
    if pairs < _INDIVISIBLE:
        return 1
    return 2 * max(1, round(pairs / (2 * _SLICE_PAIRS)))


def worker_count(ordered: OrderedPencil, asked: int | None) -> int:
    """Slices to compute at a time: as asked, or as cores and free memory allow."""
    if asked is not None:
        return asked
    import psutil
    from joblib import cpu_count

    n = ordered.pencil.n
    entries = ordered.structure.n_entries if ordered.structure is not None else 0
    need = memory_of_slice(n, entries or factor_entries(n), 1.2 * _SLICE_PAIRS)
    room = 0.8 * psutil.virtual_memory().available
    return max(1, min(int(cpu_count()), int(room // need)))


def factor_entries(n: int) -> float:
    """Entries of the factor of a surface's Laplacian with n vertices, from experience."""
    return _FACTOR_DENSITY * n * float(np.log2(max(n, 4)))


def memory_of_slice(n: int, entries: float, pairs: float) -> float:
    """Bytes that one slice takes: factor, Krylov basis, Ritz rows."""
    basis = 3.6 * pairs + 48
    return 8.0 * entries + 8.0 * n * (basis + pairs + 40)


def memory_of_run(n: int, nnz: int, k: int, workers: int) -> float:
    """Bytes that a run takes at most, its rows in float64 included."""
    slices = slice_count(k)
    pairs, at_once = k / slices, min(workers, slices)
    entries = factor_entries(n)
    matrices = 3.0 * 16.0 * nnz + 40.0 * n
    structure = 16.0 * 0.35 * entries
    working = at_once * memory_of_slice(n, entries, pairs)
    results = 8.0 * n * k + 8.0 * n * (3.0 * pairs + 8)
    return matrices + structure + working + results
