"""The folder of all stored spectra: how large it is, what goes when it is full."""

from __future__ import annotations

import os
import re
import shutil
import time
from pathlib import Path

from meshmash_viewer.io.lock import FileLock

__all__ = ["DEFAULT_CAP", "EigenpairCache", "default_cache_folder", "folder_size"]

#: Bytes that the cache may hold: 300 pairs of eight meshes of a million vertices.
DEFAULT_CAP = 20_000_000_000

_KEY = re.compile(r"[0-9a-f]{32}")
_STAMP = "problem.json"  # its time of change is the time of last use


def default_cache_folder() -> Path:
    """The user's cache folder for this program, as the operating system has it."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("meshmash-viewer", appauthor=False)) / "eigenpairs"


def folder_size(folder: Path) -> int:
    """Bytes that a folder takes on the disk; holes in a file take none."""
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                status = os.stat(os.path.join(place, name))
            except FileNotFoundError:
                continue  # gone in between
            blocks = getattr(status, "st_blocks", None)
            total += status.st_size if blocks is None else min(512 * blocks, status.st_size)
    return total


class EigenpairCache:
    """All stores below one folder.

    Parameters
    ----------
    root : str or Path, optional
        The folder; None for the user's.
    cap : int
        Bytes it may hold.
    """

    def __init__(self, root: str | Path | None = None, cap: int = DEFAULT_CAP) -> None:
        self.root = default_cache_folder() if root is None else Path(root)
        self.cap = cap

    def lock_path(self, key: str) -> Path:
        """File that whoever writes into the store `key` holds locked."""
        return self.root / "locks" / f"{key}.lock"

    def stores(self) -> list[Path]:
        """Folders of all stores, least recently used first."""
        if not self.root.is_dir():
            return []
        found = [entry for entry in self.root.iterdir() if _KEY.fullmatch(entry.name)]
        return sorted(found, key=lambda folder: (_last_used(folder), folder.name))

    def size(self) -> int:
        """Bytes on the disk, damaged stores that were set aside included."""
        return folder_size(self.root)

    def clear(self) -> int:
        """Remove everything that no process is writing; returns the bytes freed."""
        before = self.size()
        self._remove_asides()
        for folder in self.stores():
            self._remove(folder)
        return before - self.size()

    def evict(self, keep: str | None = None, room_for: int = 0) -> None:
        """Remove the least recently used until the cap holds.

        Parameters
        ----------
        keep : str, optional
            Key of a store that stays whatever its age.
        room_for : int
            Bytes about to be written.
        """
        self.root.mkdir(parents=True, exist_ok=True)
        excess = self.size() + room_for - self.cap
        if excess <= 0:
            return
        excess -= self._remove_asides()
        for folder in self.stores():
            if excess <= 0:
                return
            if folder.name != keep:
                excess -= self._remove(folder)

    def touch(self, folder: Path) -> None:
        """Note that a store was used now."""
        if (folder / _STAMP).exists():
            try:
                os.utime(folder / _STAMP)
            except (FileNotFoundError, PermissionError):
                return  # cleared in between, or another user's cache: its age does not matter

    def set_aside(self, folder: Path) -> Path:
        """Move a store to where nobody looks for it; returns the new place."""
        place = self.root / "aside" / f"{folder.name}-{time.time_ns()}"
        place.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(place)
        return place

    def _remove(self, folder: Path) -> int:
        lock = FileLock(self.lock_path(folder.name))
        if not lock.acquire():
            return 0  # being written
        try:
            size = folder_size(folder)
            # Renamed first, so that a half-removed store is never taken for one.
            shutil.rmtree(self.set_aside(folder), ignore_errors=True)
        except FileNotFoundError:
            return 0  # another process was faster
        finally:
            lock.release()
        return size

    def _remove_asides(self) -> int:
        aside = self.root / "aside"
        size = folder_size(aside)
        shutil.rmtree(aside, ignore_errors=True)
        return size


def _last_used(folder: Path) -> int:
    try:
        return (folder / _STAMP).stat().st_mtime_ns
    except FileNotFoundError:
        return 0
