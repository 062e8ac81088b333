"""Folders of the user for stored eigenpairs, sessions and logs, and of the pages."""

from __future__ import annotations

import os
import sysconfig
from pathlib import Path

#: Environment variable that names one folder for all, on every operating system.
CACHE_VARIABLE = "MESHMASH_CACHE"


def cache_folder() -> Path:
    """Return the folder in `CACHE_VARIABLE`, or else the cache folder of the operating system."""
    import platformdirs

    return _named() or Path(platformdirs.user_cache_dir("meshmash-viewer", appauthor=False))


def session_folder() -> Path:
    """Return a folder below that in `CACHE_VARIABLE`, or else that of the operating system."""
    import platformdirs

    named = _named()
    if named is not None:
        return named / "sessions"
    return Path(platformdirs.user_data_dir("meshmash-viewer", appauthor=False)) / "sessions"


def link_folder() -> Path:
    """Return the folder of links to meshes, next to that of the sessions."""
    return session_folder().parent / "links"


def log_folder() -> Path:
    """Return a folder below that in `CACHE_VARIABLE`, or else that of the operating system."""
    import platformdirs

    named = _named()
    if named is not None:
        return named / "log"
    return Path(platformdirs.user_log_path("meshmash-viewer", appauthor=False))


def page_file(name: str) -> Path | None:
    """Return a page on an algorithm, of the checkout or installed with the package; else None."""
    checkout = Path(__file__).parents[1] / "docs" / "algorithms"
    installed = Path(sysconfig.get_path("data"), "share", "doc", "meshmash-viewer")
    files = (folder / f"{name}.md" for folder in (checkout, installed))
    return next((file for file in files if file.is_file()), None)


def _named() -> Path | None:
    text = os.environ.get(CACHE_VARIABLE, "").strip()
    return Path(text).expanduser().absolute() if text else None
