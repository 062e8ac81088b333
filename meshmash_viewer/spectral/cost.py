"""Memory and time of a decomposition, and its division into parallel slices."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import NO_BREAK, counted, format_number

if TYPE_CHECKING:
    from meshmash_viewer.spectral.engine.factorization import OrderedPencil

#: Seconds per vertex and pair on two cores of 2024, until a run has been measured.
_SECONDS = 2.5e-7
#: Maximum share of the free memory for a run.
_SHARE = 0.9
#: Bytes for each value of a feature: in double precision, and a copy.
_VALUE_BYTES = 16
#: Time that does not depend on the number of pairs, expressed in pairs.
_FIXED_PAIRS = 15


def estimate_memory(
    n: int,
    nnz: int,
    k: int,
    n_jobs: int | None = None,
    *,
    n_null: int = 1,
    dtype: npt.DTypeLike = np.float64,
) -> int:
    """Predict the bytes that a run allocates, including its rows, without the given matrices.

    The mesh has n vertices and `n_null` components, L nnz stored entries; k pairs are computed, in
    `n_jobs` parallel slices, by default one on each core. `dtype` is the type of the rows.
    """
    from joblib import cpu_count

    lean = np.dtype(dtype) == np.dtype(np.float32)
    return int(memory_of_run(n, nnz, k, n_jobs or int(cpu_count()), n_null, lean=lean))


def free_memory() -> int:
    """Return the bytes of memory that are available."""
    import psutil

    return int(psutil.virtual_memory().available)


def check_memory(n: int, nnz: int, k: int, free: int, n_null: int = 1) -> None:
    """Raise an `InputError` if k pairs take more than the `free` bytes.

    The mesh has n vertices and `n_null` components, and its Laplacian nnz entries.
    """

    def need(count: int) -> int:
        # with little memory, slices are computed one at a time
        return estimate_memory(n, nnz, count, 1, n_null=n_null)

    k = min(k, n)
    needed = need(k)
    if needed <= _SHARE * free:
        return
    fitting = bisect_right(range(1, k + 1), _SHARE * free, key=need)
    remedy = f"ask for at most {fitting:,}" if fitting else "simplify the mesh"
    what = f"{counted(k, 'eigenpair')} of {counted(n, 'vertex')}"
    raise _no_room(what, needed, free, remedy)


def _no_room(what: str, needed: float, free: float, remedy: str) -> InputError:
    fault = f"{what} take about {written_bytes(needed)} of memory, and {written_bytes(free)}"
    return InputError("out-of-memory", f"{fault} are free", f"{remedy}, or close other programs")


def check_room(what: str, needed: float, remedy: str) -> None:
    """Raise an `InputError` if arrays take more than the free memory.

    `what` is the plural subject of the message, `needed` the bytes, `remedy` an imperative.
    """
    free = free_memory()
    if needed > _SHARE * free:
        raise _no_room(what, needed, free, remedy)


def check_columns(n_vertices: int, n_columns: int) -> None:
    """Raise an `InputError` if feature columns take more than the free memory."""
    fewer = "take fewer columns (--n-components, n_components=)"
    what = f"{counted(n_columns, 'column')} of {counted(n_vertices, 'vertex')}"
    check_room(what, _VALUE_BYTES * float(n_vertices) * n_columns, fewer)


def decomposition_bytes(n_vertices: int, n_pairs: float) -> int:
    """Predict the bytes of memory that a decomposition takes beyond the mesh.

    Removing debris may increase the memory: fewer pairs are known constants, or the mesh becomes
    small enough for dense `eigh`. So that the prediction never decreases with the number of
    vertices, it assumes one component, and at least the memory of the largest mesh solved densely.
    """
    n_pairs = max(1, min(round(n_pairs), n_vertices))
    dense = max(_DENSE_VERTICES, min(3 * n_pairs - 3, _DENSE_VERTICES_MOST_PAIRS + 1))
    # a closed surface has 3 edges a vertex, so 7 entries a row
    return max(estimate_memory(n, 7 * n, n_pairs) for n in (n_vertices, min(n_vertices, dense)))


def decomposition_seconds(n_vertices: int, n_pairs: float, rate: float | None = None) -> float:
    """Predict the seconds that a decomposition takes, from a `measured_rate` if it is given."""
    pairs = min(n_pairs, n_vertices) + _FIXED_PAIRS
    return n_vertices * pairs * (rate or _SECONDS)


def measured_rate(n_vertices: int, n_pairs: int, seconds: float) -> float | None:
    """Compute the seconds per vertex and pair of a run; None if it is not representative.

    A short run may have read its pairs from the store, and with few pairs the set-up dominates.
    """
    if seconds <= 2.0 or n_pairs < _FIXED_PAIRS:
        return None
    return seconds / (n_vertices * (n_pairs + _FIXED_PAIRS))


def written_bytes(count: float) -> str:
    """Format a number of bytes: "1.2 GB"."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g}{NO_BREAK}{unit}"
        count /= 1000.0
    return f"{format_number(count, 3)}{NO_BREAK}GB"


def written_duration(seconds: float) -> str:
    """Format a duration: "under a second", "12 s", "3 min 20 s", "2 h 5 min"."""
    if seconds < 1.0:
        return "under a second"
    whole = round(seconds)
    if whole < 60:
        text = f"{whole} s"
    elif whole < 3600:
        text = f"{whole // 60} min {whole % 60} s" if whole < 600 else f"{round(whole / 60)} min"
    else:
        text = f"{whole // 3600} h {whole % 3600 // 60} min"
    return text.replace(" ", NO_BREAK)


#: Number of pairs of a slice: with more, the basis takes most of the time; with fewer, the factor.
#: In float32 pairs converge in fewer steps, and small slices save a third of the memory.
_SLICE_PAIRS, _LEAN_SLICE_PAIRS = 140, 50
#: Number of pairs up to which there is one slice.
_INDIVISIBLE = 48
#: Number of values (vertices times pairs) above which a run takes seven seconds or more, and number
#: of lowest pairs that such a run computes first, in a separate slice, if `early`.
_LONG_RUN, _FIRST_PAIRS = 3e7, 16

#: Number of vertices up to which all pairs are computed by dense `eigh`.
_DENSE_VERTICES = 700
#: The same if more than a third of the pairs is requested; constants do not count.
_DENSE_VERTICES_MOST_PAIRS = 2500

#: Entries of the factor divided by n log2(n), with METIS: 2 on a branching neuron, 3.4 on a head.
_FACTOR_DENSITY = 2.6
#: Slope and intercept of the basis size at convergence as a function of the number of pairs; memory
#: allocated for further rows is not used.
_BASIS_ROWS, _LEAN_BASIS_ROWS = (2.3, 110), (2.3, 85)
#: Memory kept by the allocator: at most this share, and this number of bytes.
_KEPT_SHARE, _KEPT_BYTES = 0.3, 110e6


def slice_count(pairs: int, lean: bool = False) -> int:
    """Return the number of slices, 1 or even, so that two cores end together.

    The number is independent of the number of cores, so that results do not depend on the machine.
    `lean` selects the small slices of float32.
    """
    if pairs < _INDIVISIBLE:
        return 1
    return 2 * max(1, round(pairs / (2 * (_LEAN_SLICE_PAIRS if lean else _SLICE_PAIRS))))


def slice_sizes(n: int, pairs: int, lean: bool = False, early: bool = False) -> list[float]:
    """Return the approximate number of pairs of each slice, lowest first, for n vertices.

    `lean` selects the slices of float32; with `early` a long run begins with a small slice.
    """
    count = slice_count(pairs, lean)
    first = [float(_FIRST_PAIRS)] if early and count > 1 and n * pairs > _LONG_RUN else []
    return first + [(pairs - sum(first)) / count] * count


def is_dense(n: int, n_null: int, wanted: int) -> bool:
    """Whether dense `eigh` of n vertices is the fastest method for `wanted` pairs.

    `wanted` includes the `n_null` constants, which are known.
    """
    free, n_expected = n - n_null, wanted - n_null
    most = n_expected > free // 3 and free <= _DENSE_VERTICES_MOST_PAIRS
    return n <= _DENSE_VERTICES or most or free < 64


def can_be_dense(n: int) -> bool:
    """Whether dense `eigh` of n vertices takes acceptable time."""
    return n <= _DENSE_VERTICES_MOST_PAIRS


def core_count() -> int:
    """Return the number of cores available to the calling thread.

    Under joblib's sequential backend it is 1, so that several problems can be solved in parallel.
    """
    from joblib.parallel import get_active_backend

    return int(get_active_backend(prefer="threads")[0].effective_n_jobs(-1))


def worker_count(ordered: OrderedPencil, cores: int, pairs: int, lean: bool = False) -> int:
    """Return the number of slices to compute in parallel, limited by cores and memory."""
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
    """Estimate the peak memory of a run in bytes, its rows included, for n vertices and k pairs.

    The peak is when the pairs of the last slices have converged, or when they are written. The
    estimate is within 25 % from 6 thousand to 400 thousand vertices. L has nnz entries; `workers`
    slices are computed in parallel; the constants of `n_null` components are known and need no
    basis; the factor has `entries`, estimated if None; rows are float32 if `lean`.
    """
    if entries is None:
        entries = _FACTOR_DENSITY * n * float(np.log2(max(n, 4)))
    k, n_null = min(k, n), min(k, n_null)
    if is_dense(n, n_null, k):
        # The largest component has at most all free vertices and its constant.
        return 40.0 * (n - n_null + 1) ** 2 + 8.0 * n * k + _KEPT_BYTES / 11.0
    slices = slice_count(k - n_null, lean)
    pairs, at_once = (k - n_null) / slices, min(workers, slices) if k > n_null else 0
    rows_of_basis = _LEAN_BASIS_ROWS if lean else _BASIS_ROWS
    basis = rows_of_basis[0] * pairs + rows_of_basis[1]
    row, factor = 8.0 * n, 8.0 * entries
    written = row / (2.0 if lean else 1.0)
    matrices = 95.0 * nnz + 200.0 * n
    # The last slices run while pairs of earlier ones wait to be written.
    waiting = pairs * min(at_once // 2, slices - at_once)
    known = max(k - n_null - pairs * at_once, 0.0)
    running = row * (basis * at_once + waiting + n_null) + factor * at_once + written * known
    # The rows of a slice are written after its factor is freed; other factors may still exist.
    ending = row * (pairs * at_once + waiting + n_null) + written * k + factor * max(at_once - 1, 0)
    total = matrices + max(running, ending)
    return total + min(_KEPT_SHARE * total, _KEPT_BYTES) + _KEPT_BYTES / 11.0
