"""One thread for BLAS while eigenpairs are computed, whoever else computes at the same time."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager


def limit_accelerate(environment: MutableMapping[str, str]) -> None:
    """Limit Accelerate of macOS to one thread, in processes that start with these variables.

    NumPy's wheels use it there, and nothing limits it once it is loaded. A value that the user has
    set stays.
    """
    if sys.platform == "darwin":
        environment.setdefault("VECLIB_MAXIMUM_THREADS", "1")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread: several make products of thin matrices slower, not faster.

    With most BLAS the limit is the whole process's: set and restored by each solve, one that ends
    would lift the limit of another, or restore it for good. So a thread of its own holds it, from
    the first solve that begins to the last that ends. Where BLAS counts threads for each thread
    that calls it (OpenMP), the calling one is limited as well.
    """
    from threadpoolctl import threadpool_limits

    _limit.enter()
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        _limit.leave()


class _Limit:
    """The limit of the process, while anybody needs it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._holder: ThreadPoolExecutor

    def enter(self) -> None:
        from threadpoolctl import threadpool_limits

        with self._lock:
            if self._users == 0:
                self._holder = ThreadPoolExecutor(1, "blas-limit")
                self._limits = self._holder.submit(threadpool_limits, 1, "blas").result()
            self._users += 1

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._holder.submit(self._limits.restore_original_limits).result()
                self._holder.shutdown()


_limit = _Limit()
