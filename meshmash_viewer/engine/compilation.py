"""Where compiled kernels are kept between runs; imported before the first of them is declared."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import platformdirs
from numba.core import config

__all__: list[str] = []


def _can_write_below(folder: Path) -> bool:
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK)


def _provide_cache() -> None:
    """Give numba a folder of this process where it would find none and refuse to work.

    A system-wide installation used by an account without a home has neither of numba's two places.
    """
    settings: Any = config
    places = (Path(__file__).parent / "__pycache__", Path(platformdirs.user_cache_dir("numba")))
    if settings.CACHE_DIR or any(_can_write_below(place) for place in places):
        return
    settings.CACHE_DIR = tempfile.mkdtemp(prefix="meshmash-kernels-")
    atexit.register(shutil.rmtree, settings.CACHE_DIR, ignore_errors=True)


_provide_cache()
