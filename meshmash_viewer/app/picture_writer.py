"""Writes pictures without keeping the window waiting."""

from __future__ import annotations

import ctypes
import sys
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QThreadPool, Signal

from meshmash_viewer.app.listening import catch_up, later

if TYPE_CHECKING:
    from meshmash_viewer.app.picture import RawPicture
    from meshmash_viewer.app.render.drawing import Drawing

__all__ = ["PictureWriter"]


class PictureWriter(QObject):
    """Makes one picture after the other: drawn in a turn of its own, finished in a thread.

    Signals
    -------
    written(Path)
        A picture is there.
    failed(str)
        One sentence: why it is not.
    """

    written = Signal(object)
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._waiting: deque[tuple[Path, Drawing, tuple[int, int], bool]] = deque()

    def write(
        self, path: Path, drawing: Drawing, size: tuple[int, int], transparent: bool = False
    ) -> None:
        """Write a picture as soon as those before are written.

        Parameters
        ----------
        path : Path
        drawing : Drawing
            Nobody else's (`Drawing.twin`).
        size : (int, int)
            Width and height in pixels.
        transparent : bool
            Leave the background out.
        """
        self._waiting.append((path, drawing, size, transparent))
        later(self._draw_next)

    def _draw_next(self) -> None:
        from meshmash_viewer.app.picture import draw_raw

        path, drawing, size, transparent = self._waiting.popleft()
        if self._waiting:
            later(self._draw_next)
        raw = draw_raw(drawing, size, transparent)
        self._pool.start(lambda: self._write(path, raw))

    def wait(self) -> None:
        """Wait until all are written (before closing, and in tests)."""
        catch_up()
        self._pool.waitForDone()

    def _write(self, path: Path, picture: RawPicture) -> None:
        from meshmash_viewer.errors import InputError
        from meshmash_viewer.io.write import write_picture

        try:
            write_picture(path, picture.rgba())
        except (InputError, OSError) as fault:
            self.failed.emit(str(fault))
        else:
            self.written.emit(path)
        _give_back()


def _give_back() -> None:
    """Return to the system what drawing took; glibc keeps it, 0.6 GB after a million vertices."""
    if sys.platform.startswith("linux"):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none, and no need of it
        if trim is not None:
            trim(0)
