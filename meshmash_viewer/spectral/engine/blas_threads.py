"""Limit of BLAS to one thread while eigenpairs are computed."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager


def limit_accelerate(environment: MutableMapping[str, str]) -> None:
    """Limit Accelerate on macOS to one thread, in processes started with these variables.

    NumPy's wheels use it there, and it cannot be limited once it is loaded. A value set by the user
    is kept.
    """
    if sys.platform == "darwin":
        environment.setdefault("VECLIB_MAXIMUM_THREADS", "1")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread: several threads make products of thin matrices slower.

    With most BLAS libraries the limit applies to the whole process. If each solve set and restored
    it, a solve that ends would lift the limit of another one, or restore a wrong limit permanently.
    So a separate thread holds the limit from the start of the first solve to the end of the last.
    Where the limit applies to the calling thread (OpenMP), that one is limited as well.
    """
    from threadpoolctl import threadpool_limits

    _limit.enter()
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        _limit.leave()


class _Limit:
    """The limit of the process, held while there are users."""

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
