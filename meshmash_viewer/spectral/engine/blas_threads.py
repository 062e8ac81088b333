"""One thread for BLAS while eigenpairs are computed, whoever else computes at the same time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["one_blas_thread"]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread: several make products of thin matrices slower, not faster.

    With most BLAS the limit is the whole process's: set and restored by each solve, one that ends
    would lift the limit of another, or restore it for good. So a thread of its own holds it, from
    the first solve that begins to the last that ends. Where BLAS counts threads for each thread
    that calls it (OpenMP), the calling one is limited as well.
    """
    from threadpoolctl import threadpool_limits

    _holder.enter()
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        _holder.leave()


class _Holder:
    """Keeps a thread that holds the limit while anybody needs it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._done = threading.Event()
        self._thread: threading.Thread

    def enter(self) -> None:
        with self._lock:
            self._users += 1
            if self._users > 1:
                return
            held, self._done = threading.Event(), threading.Event()
            self._thread = threading.Thread(
                target=_hold, args=(held, self._done), name="blas-limit", daemon=True
            )
            self._thread.start()
            held.wait()

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._done.set()
                self._thread.join()


def _hold(held: threading.Event, done: threading.Event) -> None:
    from threadpoolctl import threadpool_limits

    try:
        with threadpool_limits(1, user_api="blas"):
            held.set()
            done.wait()
    finally:
        held.set()  # whatever went wrong, nobody waits for ever


_holder = _Holder()
