"""Folders of the user that this program writes into unasked: stored eigenpairs, and its log."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["CACHE_VARIABLE", "cache_folder", "log_folder"]

#: The environment variable that names one folder for all of it, on every operating system.
CACHE_VARIABLE = "MESHMASH_CACHE"


def cache_folder() -> Path:
    """The folder that `CACHE_VARIABLE` names, or else the cache folder of the operating system."""
    import platformdirs

    return _named() or Path(platformdirs.user_cache_dir("meshmash-viewer", appauthor=False))


def log_folder() -> Path:
    """A folder below the one that `CACHE_VARIABLE` names, or else that of the operating system."""
    import platformdirs

    named = _named()
    if named is not None:
        return named / "log"
    return Path(platformdirs.user_log_path("meshmash-viewer", appauthor=False))


def _named() -> Path | None:
    text = os.environ.get(CACHE_VARIABLE, "").strip()
    return Path(text).expanduser().absolute() if text else None
