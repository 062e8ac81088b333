"""Estimates of the memory and time that a decomposition takes."""

from __future__ import annotations

from meshmash_viewer.spectral.eigensolver import estimate_memory

#: Seconds a vertex and pair on two cores of 2024; replaced by what the last run took.
_SECONDS = 2.5e-7
#: Share of the time that does not depend on the number of pairs, as if it were pairs.
_FIXED_PAIRS = 15


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
