"""The compiler of the kernels, numba: nothing is computed without it, and it is asked for first.

Every kernel has it from here: how kernels are compiled, and where they are kept.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from meshmash_viewer.errors import InputError

_REMEDY = "install it into this environment with: python -m pip install numba"


def check_compiler() -> None:
    """Look for the compiler without importing it, which takes a third of a second.

    Raises
    ------
    InputError
        If it is not installed.
    """
    if find_spec("numba") is None:
        raise InputError(f"numba, which compiles the eigensolver, is missing; {_REMEDY}")


def import_compiler() -> Any:
    """The module `numba`.

    Raises
    ------
    InputError
        If it is not installed, or does not work with what is installed beside it.
    """
    check_compiler()
    try:
        numba = import_module("numba")
    except ImportError as fault:
        raise InputError(
            f"numba, which compiles the eigensolver, does not work here ({fault}); {_REMEDY}"
        ) from fault
    _provide_cache(numba.config)
    return numba


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
    """Give numba a folder of this process where it would find none and refuse to work.

    A system-wide installation used by an account without a home has neither of numba's two places.
    """
    import platformdirs

    places = (Path(__file__).parent / "__pycache__", Path(platformdirs.user_cache_dir("numba")))
    if settings.CACHE_DIR or any(_can_write_below(place) for place in places):
        return
    settings.CACHE_DIR = tempfile.mkdtemp(prefix="meshmash-kernels-")
    atexit.register(shutil.rmtree, settings.CACHE_DIR, ignore_errors=True)
