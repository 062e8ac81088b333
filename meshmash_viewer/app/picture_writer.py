"""Writes pictures without keeping the window waiting: to finish and compress one takes a while."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QThreadPool, Signal

if TYPE_CHECKING:
    from meshmash_viewer.app.picture import RawPicture

__all__ = ["PictureWriter"]


class PictureWriter(QObject):
    """Writes one picture after the other in a thread.

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

    def write(self, path: Path, picture: RawPicture) -> None:
        """Write a picture as soon as those before are written."""
        self._pool.start(lambda: self._write(path, picture))

    def wait(self) -> None:
        """Wait until all are written (before closing, and in tests)."""
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
