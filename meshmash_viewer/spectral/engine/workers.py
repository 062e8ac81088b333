"""How many slices run at once, and what memory a run takes."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.spectral.engine.factorization import OrderedPencil

#: Pairs a slice should hold: more make its basis dear, fewer its factor and its ends. In float32
#: pairs converge in fewer steps, and small slices take a third less memory in the same time.
_SLICE_PAIRS, _LEAN_SLICE_PAIRS = 140, 50
#: Fewer pairs than this are one slice.
_INDIVISIBLE = 48
#: A run that has more numbers to find than this takes some seven seconds or more: where somebody
#: waits for something to look at, so many of the lowest pairs come first, in their own slice.
_LONG_RUN, _FIRST_PAIRS = 3e7, 16

#: Up to this many vertices all pairs are computed at once, by dense `eigh`.
_DENSE_VERTICES = 700
#: Up to this many, constants aside, where more than a third of the pairs is asked for.
_DENSE_VERTICES_MOST_PAIRS = 2500

#: Entries of the factor per vertex and bit of the number of vertices, on surfaces under METIS:
#: 2 on a branching neuron, 3.4 on a head.
_FACTOR_DENSITY = 2.6
#: Rows of a basis when its pairs have converged, by pairs and for none; it is not all touched
#: before.
_BASIS_ROWS, _LEAN_BASIS_ROWS = (2.3, 110), (2.3, 85)
#: Freed blocks that the allocator keeps: up to this share, and this many bytes.
_KEPT_SHARE, _KEPT_BYTES = 0.3, 110e6


def slice_count(pairs: int, lean: bool = False) -> int:
    """Slices for so many pairs: an even number, so that two cores end together.

    Never a matter of how many cores there are, or results would depend on the machine.

    Parameters
    ----------
    pairs : int
    lean : bool
        Small ones, for float32.
    """
    if pairs < _INDIVISIBLE:
        return 1
    return 2 * max(1, round(pairs / (2 * (_LEAN_SLICE_PAIRS if lean else _SLICE_PAIRS))))


def slice_sizes(n: int, pairs: int, lean: bool = False, early: bool = False) -> list[float]:
    """About how many pairs each slice holds, from the lowest on.

    Parameters
    ----------
    n, pairs : int
        Vertices, and pairs to find.
    lean : bool
        Whether slices are those of float32.
    early : bool
        Whether a long run begins with a small one.
    """
    count = slice_count(pairs, lean)
    first = [float(_FIRST_PAIRS)] if early and count > 1 and n * pairs > _LONG_RUN else []
    return first + [(pairs - sum(first)) / count] * count


def is_dense(n: int, n_null: int, wanted: int) -> bool:
    """Whether all pairs of n vertices at once, by dense `eigh`, are the fastest way.

    Constants count among the pairs wanted, but nothing has to be found for them.
    """
    free, owed = n - n_null, wanted - n_null
    most = owed > free // 3 and free <= _DENSE_VERTICES_MOST_PAIRS
    return n <= _DENSE_VERTICES or most or free < 64


def can_be_dense(n: int) -> bool:
    """Whether dense `eigh` of n vertices takes no longer than a person would wait."""
    return n <= _DENSE_VERTICES_MOST_PAIRS


def core_count() -> int:
    """Cores that the caller may plan for: one, inside a worker that shares them with others.

    Whoever runs several solutions side by side names joblib's sequential backend around each.
    """
    from joblib.parallel import get_active_backend

    return int(get_active_backend(prefer="threads")[0].effective_n_jobs(-1))


def worker_count(ordered: OrderedPencil, cores: int, pairs: int, lean: bool = False) -> int:
    """Slices to compute at a time for so many pairs, as cores and memory allow."""
    import psutil

    pencil = ordered.pencil
    nnz, n_null = int(pencil.matrix.nnz), pencil.n_null
    entries = ordered.structure.n_entries
    room = 0.8 * psutil.virtual_memory().available
    for workers in range(cores, 1, -1):
        if memory_of_run(pencil.n, nnz, pairs, workers, n_null, entries, lean) <= room:
            return workers
    return 1


def memory_of_run(
    n: int,
    nnz: int,
    k: int,
    workers: int,
    n_null: int = 1,
    entries: float | None = None,
    lean: bool = False,
) -> float:
    """Bytes that a run takes at most, its rows included.

    The peak is where the last slices have their pairs converged, or where these are written.
    Measured within 25 % from 6 thousand to 400 thousand vertices.

    Parameters
    ----------
    n, nnz, k, workers : int
        Vertices, entries of L, pairs, slices at a time.
    n_null : int
        Components of the mesh: their pairs are known and take no basis.
    entries : float, optional
        Entries of the factor, where known.
    lean : bool
        Whether rows come in float32.
    """
    if entries is None:
        entries = _FACTOR_DENSITY * n * float(np.log2(max(n, 4)))
    k, n_null = min(k, n), min(k, n_null)
    if is_dense(n, n_null, k):
        # A component is no larger than what is free in all of them, and its constant.
        return 40.0 * (n - n_null + 1) ** 2 + 8.0 * n * k + _KEPT_BYTES / 11.0
    slices = slice_count(k - n_null, lean)
    pairs, at_once = (k - n_null) / slices, min(workers, slices) if k > n_null else 0
    rows_of_basis = _LEAN_BASIS_ROWS if lean else _BASIS_ROWS
    basis = rows_of_basis[0] * pairs + rows_of_basis[1]
    row, factor = 8.0 * n, 8.0 * entries
    written = row / (2.0 if lean else 1.0)
    matrices = 95.0 * nnz + 200.0 * n
    # The last slices run while pairs of those before wait to be written.
    waiting = pairs * min(at_once // 2, slices - at_once)
    known = max(k - n_null - pairs * at_once, 0.0)
    running = row * (basis * at_once + waiting + n_null) + factor * at_once + written * known
    # One slice writes its rows when its factor has gone; others may still have theirs.
    ending = row * (pairs * at_once + waiting + n_null) + written * k + factor * max(at_once - 1, 0)
    total = matrices + max(running, ending)
    return total + min(_KEPT_SHARE * total, _KEPT_BYTES) + _KEPT_BYTES / 11.0
