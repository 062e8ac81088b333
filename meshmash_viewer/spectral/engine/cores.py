"""How many cores a computation may plan for."""

from __future__ import annotations

__all__ = ["core_count"]


def core_count() -> int:
    """Cores that the caller may plan for: one, inside a worker that shares them with others.

    Whoever runs several solutions side by side names joblib's sequential backend around each.
    """
    from joblib.parallel import get_active_backend

    return int(get_active_backend(prefer="threads")[0].effective_n_jobs(-1))
