"""How kernels are compiled, and where they are kept; every kernel has its compiler from here."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import platformdirs

from meshmash_viewer.spectral.engine.compiler import import_compiler

__all__ = ["compiled", "numba"]

numba = import_compiler()


def compiled(signature: str, *fast: str) -> Callable[[Any], Any]:
    """Compile a function of straight lines of equal sums at once, without the interpreter lock.

    The straight-line vectoriser doubles the speed of such code; numba leaves it off unless told.

    Parameters
    ----------
    signature : str
        In numba's notation.
    *fast : str
        What the arithmetic may be rearranged by, such as "contract".
    """

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


def _provide_cache() -> None:
    """Give numba a folder of this process where it would find none and refuse to work.

    A system-wide installation used by an account without a home has neither of numba's two places.
    """
    settings = numba.config
    places = (Path(__file__).parent / "__pycache__", Path(platformdirs.user_cache_dir("numba")))
    if settings.CACHE_DIR or any(_can_write_below(place) for place in places):
        return
    settings.CACHE_DIR = tempfile.mkdtemp(prefix="meshmash-kernels-")
    atexit.register(shutil.rmtree, settings.CACHE_DIR, ignore_errors=True)


_provide_cache()
