"""Compilation of kernels with numba, its cache folder, and the limit of BLAS to one thread."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from meshmash_viewer.errors import InputError

_NUMBA = "numba, which compiles the eigensolver,"
_REMEDY = "install it into this environment with: python -m pip install numba"


def check_compiler() -> None:
    """Raise `InputError` if numba is not installed, without importing it, which takes 0.3 s."""
    if find_spec("numba") is None:
        raise InputError("package-missing", f"{_NUMBA} is missing", _REMEDY)


def import_compiler() -> Any:
    """Import numba.

    `InputError` is raised if it is not installed, or incompatible with other installed packages.
    """
    check_compiler()
    try:
        numba = import_module("numba")
    except ImportError as fault:
        broken = f"{_NUMBA} does not work here ({fault})"
        raise InputError("package-missing", broken, _REMEDY) from fault
    _provide_cache(numba.config)
    return numba


def compiled(signature: str, *fast: str) -> Callable[[Any], Any]:
    """Return a decorator that compiles a function at once, to run without the interpreter lock.

    The superword-level (SLP) vectoriser, off by default in numba, doubles the speed of these
    kernels. `signature` is in numba's notation; `fast` are ``fastmath`` flags such as "contract".
    """
    numba = import_compiler()

    def compile_now(function: Any) -> Any:
        settings = numba.config
        before, settings.SLP_VECTORIZE = settings.SLP_VECTORIZE, 1
        try:
            kernel = numba.njit(signature, cache=True, nogil=True, fastmath=set(fast))
            return kernel(function)
        finally:
            settings.SLP_VECTORIZE = before

    return compile_now


def _can_write_below(folder: Path) -> bool:
    nearest = next(place for place in (folder, *folder.parents) if place.exists())
    return nearest.is_dir() and os.access(nearest, os.W_OK)


def _provide_cache(settings: Any) -> None:
    """Set a temporary cache folder for numba, which fails without one, if no other is writable.

    This happens in a system-wide installation used by an account without a home folder.
    """
    import platformdirs

    places = (Path(__file__).parent / "__pycache__", Path(platformdirs.user_cache_dir("numba")))
    if settings.CACHE_DIR or any(_can_write_below(place) for place in places):
        return
    settings.CACHE_DIR = tempfile.mkdtemp(prefix="meshmash-kernels-")
    atexit.register(shutil.rmtree, settings.CACHE_DIR, ignore_errors=True)


def limit_accelerate(environment: MutableMapping[str, str]) -> None:
    """Limit Accelerate, the BLAS of NumPy on macOS, to one thread in new processes.

    Accelerate cannot be limited after it is loaded. A value set by the user is kept.
    """
    if sys.platform == "darwin":
        environment.setdefault("VECLIB_MAXIMUM_THREADS", "1")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread, since several threads make products of thin matrices slower.

    With most BLAS libraries the limit applies to the whole process. If each solve set and restored
    it, a solve that ends would lift the limit of another, or restore a wrong limit permanently.
    So a separate thread sets the limit before the first solve and lifts it after the last.
    With OpenMP the limit applies to a thread, so the calling thread is limited too.
    """
    from threadpoolctl import threadpool_limits

    with _Limit.lock:
        if _Limit.users == 0:
            _Limit.holder = ThreadPoolExecutor(1, "blas-limit")
            _Limit.limits = _Limit.holder.submit(threadpool_limits, 1, "blas").result()
        _Limit.users += 1
    try:
        with threadpool_limits(1, user_api="blas"):
            yield
    finally:
        with _Limit.lock:
            _Limit.users -= 1
            if _Limit.users == 0:
                _Limit.holder.submit(_Limit.limits.restore_original_limits).result()
                _Limit.holder.shutdown()


class _Limit:
    """Limit of BLAS in the process, which applies while any solve runs; never instantiated."""

    lock = threading.Lock()
    users = 0
    holder: ThreadPoolExecutor
    limits: Any
