"""Estimates of the memory and time that a decomposition takes."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.spectral.engine.workers import memory_of_run
from meshmash_viewer.units import counted

#: Seconds a vertex and pair on two cores of 2024; replaced by what the last run took.
_SECONDS = 2.5e-7
#: Share of the free memory that a run may take.
_SHARE = 0.9
#: Share of the time that does not depend on the number of pairs, as if it were pairs.
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
    """Predict the bytes that a run allocates, its rows included, the given matrices not.

    There are n vertices, nnz stored entries of L, k pairs and `n_null` components; `n_jobs` slices
    are computed in parallel, by default one on each core. `dtype` is that of the rows.
    """
    from joblib import cpu_count

    lean = np.dtype(dtype) == np.dtype(np.float32)
    return int(memory_of_run(n, nnz, k, n_jobs or int(cpu_count()), n_null, lean=lean))


def free_memory() -> int:
    """Return the bytes of memory that are available."""
    import psutil

    return int(psutil.virtual_memory().available)


def refuse_what_cannot_fit(n: int, nnz: int, k: int, free: int, n_null: int = 1) -> None:
    """Raise an `InputError` if k pairs take more than the `free` bytes.

    The mesh has n vertices and `n_null` components, and its Laplacian nnz entries.
    """

    def need(count: int) -> int:
        # where memory is short, one slice of the spectrum is computed at a time
        return estimate_memory(n, nnz, count, 1, n_null=n_null)

    k = min(k, n)
    needed = need(k)
    if needed <= _SHARE * free:
        return
    fitting = bisect_right(range(1, k + 1), _SHARE * free, key=need)
    way_out = f"ask for at most {fitting:,}" if fitting else "simplify the mesh"
    raise InputError(
        f"{counted(k, 'eigenpair')} of {counted(n, 'vertex')} take about "
        f"{written_bytes(needed)} of memory, and "
        f"{written_bytes(free)} are free: {way_out}, or close other programs."
    )


def decomposition_bytes(n_vertices: int, n_pairs: float, n_components: int = 1) -> int:
    """Predict the bytes of memory that a decomposition takes beyond the mesh."""
    n_pairs = max(1, min(round(n_pairs), n_vertices))
    # a closed surface has 3 edges a vertex, so 7 entries a row
    return estimate_memory(n_vertices, 7 * n_vertices, n_pairs, n_null=n_components)


def decomposition_seconds(n_vertices: int, n_pairs: float, rate: float | None = None) -> float:
    """Predict the seconds that a decomposition takes, from a `measured_rate` if there is one."""
    pairs = min(n_pairs, n_vertices) + _FIXED_PAIRS
    return n_vertices * pairs * (rate or _SECONDS)


def measured_rate(n_vertices: int, n_pairs: int, seconds: float) -> float | None:
    """Compute the seconds per vertex and pair of a run; None where it was too short to measure.

    Short runs may only have read the store, and with few pairs the set-up dominates.
    """
    if seconds <= 2.0 or n_pairs < _FIXED_PAIRS:
        return None
    return seconds / (n_vertices * (n_pairs + _FIXED_PAIRS))


def written_bytes(count: float) -> str:
    """Format a number of bytes: "1.2 GB"."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} GB"


def written_duration(seconds: float) -> str:
    """Format a duration: "under a second", "12 s", "3 min 20 s", "2 h 5 min"."""
    if seconds < 1.0:
        return "under a second"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s" if whole < 600 else f"{round(whole / 60)} min"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
