"""The folder of all stored spectra: how large it is, what goes when it is full."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import sys
import time
from pathlib import Path

from meshmash_viewer.folders import cache_folder
from meshmash_viewer.io.atomic import LEFT_OVER, discard
from meshmash_viewer.io.stored_spectrum import ROWS, SEALED, published_pairs

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

__all__ = [
    "DEFAULT_CAP",
    "FORMAT",
    "PROBLEM",
    "EigenpairCache",
    "FileLock",
    "default_cache_folder",
    "folder_size",
]

#: Raised whenever the files of a store or the operator change their meaning, so that old ones are
#: not found.
FORMAT = 5
#: File of a store that says what it is of; its time of change is the time of last use.
PROBLEM = "problem.json"

#: Bytes that the cache may hold: 300 pairs of eight meshes of a million vertices.
DEFAULT_CAP = 20_000_000_000

_KEY = re.compile(r"[0-9a-f]{32}")
_REMOVED = re.compile(r"removed-[0-9a-f]{32}-\d+")
#: Seconds without use after which the stores of other versions go.
_FORGOTTEN = 7 * 86_400.0


def default_cache_folder() -> Path:
    """The user's folder of stored spectra."""
    return cache_folder() / "eigenpairs"


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


class FileLock:
    """An exclusive lock on a file, held by at most one process; it ends with it, however it ends.

    Parameters
    ----------
    path : Path
        A file that exists only for this; it is made when needed and stays, empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None

    def acquire(self) -> bool:
        """Take the lock if nobody else has it; True if it is held now.

        Raises
        ------
        OSError
            If the file cannot be made.
        """
        if self._descriptor is not None:
            return True
        self.path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if sys.platform == "win32":
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            else:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            os.close(descriptor)
            return False
        except BaseException:
            os.close(descriptor)
            raise
        self._descriptor = descriptor
        return True

    def release(self) -> None:
        """Let others have it."""
        if self._descriptor is None:
            return
        descriptor, self._descriptor = self._descriptor, None
        with contextlib.suppress(OSError):
            # Windows unlocks a file that is closed only when it finds the time.
            if sys.platform == "win32":
                msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)
            else:
                fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)


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
        """Bytes on the disk."""
        return folder_size(self.root)

    def clear(self) -> int:
        """Remove everything that no process is writing; returns the bytes freed."""
        before = self.size()
        for folder in self.stores():
            self._remove(folder)
        self.tidy()
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
        excess = self.size() + room_for - self.cap
        for folder in self.stores():
            if excess <= 0:
                return
            if folder.name != keep:
                excess -= self._remove(folder)

    def touch(self, folder: Path) -> None:
        """Note that a store was used now, where that can be noted."""
        with contextlib.suppress(OSError):  # cleared in between, or not ours to write
            os.utime(folder / PROBLEM)

    def tidy(self) -> None:
        """Remove what processes that were cut off have left, and stores of other versions."""
        with contextlib.suppress(OSError):
            for entry in list(self.root.iterdir()):
                if _REMOVED.fullmatch(entry.name):
                    shutil.rmtree(entry, ignore_errors=True)
        for folder in self.stores():
            lock = FileLock(self.lock_path(folder.name))
            with contextlib.suppress(OSError):  # another user's, or cleared in between
                if not lock.acquire():
                    continue  # being written
                try:
                    useless = _tidy_store(folder)
                finally:
                    lock.release()
                if useless:
                    self._remove(folder)

    def _remove(self, folder: Path) -> int:
        lock = FileLock(self.lock_path(folder.name))
        try:
            if not lock.acquire():
                return 0  # being written
            size = folder_size(folder)
            # Renamed first, so that a half-removed store is never taken for one.
            place = self.root / f"removed-{folder.name}-{time.time_ns()}"
            folder.rename(place)
            shutil.rmtree(place, ignore_errors=True)
        except OSError:
            return 0  # another process was faster, or it is another user's
        finally:
            lock.release()
        return size


def _tidy_store(folder: Path) -> bool:
    """Remove the left-overs in a store that nobody writes; whether nothing of use remains."""
    try:
        about = json.loads((folder / PROBLEM).read_bytes())
        n_vertices, version = int(about["mesh"]["n_vertices"]), about["format"]
    except (OSError, ValueError, KeyError, TypeError):
        version = None
    if version != FORMAT:
        return time.time() - _last_used(folder) / 1e9 > _FORGOTTEN
    names = [path.name for path in folder.iterdir()]
    for name in names:
        if name.startswith(LEFT_OVER):
            discard(folder / name)
    rows, published = folder / ROWS, 8 * n_vertices * published_pairs(names)
    if rows.exists() and rows.stat().st_size > published:
        os.truncate(rows, published)  # room for pairs that did not come
    return not any(name.endswith(SEALED) for name in names)


def _last_used(folder: Path) -> int:
    for path in (folder / PROBLEM, folder):
        with contextlib.suppress(OSError):
            return path.stat().st_mtime_ns
    return 0
