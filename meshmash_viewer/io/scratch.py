"""Temporary folders that outlive their process no longer than until the next one starts."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from pathlib import Path

from meshmash_viewer.io.lock import FileLock

__all__ = ["ScratchFolder", "remove_abandoned"]

_PREFIX = "meshmash-viewer-"
_LOCK = "held.lock"
#: Seconds after which a folder that nobody has locked yet is not about to be.
_FORGOTTEN = 86_400.0


class ScratchFolder:
    """A new temporary folder, locked until it is removed or its process ends.

    Attributes
    ----------
    path : Path
    """

    def __init__(self) -> None:
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
            self._lock = FileLock(self.path / _LOCK)
            if self._lock.acquire():  # unless whoever clears up was here between the two
                return

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.remove()

    def remove(self) -> None:
        """Delete it with all that is in it."""
        self._lock.release()
        shutil.rmtree(self.path, ignore_errors=True)


def remove_abandoned() -> None:
    """Delete the folders of processes that were killed before they could."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):  # another user's, or just gone
            lock = FileLock(folder / _LOCK)
            if lock.path.is_file():
                abandoned = lock.acquire()
                lock.release()
            else:
                abandoned = time.time() - folder.stat().st_mtime > _FORGOTTEN
            if abandoned:
                shutil.rmtree(folder, ignore_errors=True)
