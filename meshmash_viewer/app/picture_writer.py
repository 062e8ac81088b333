"""Writes pictures without keeping the window waiting: to compress one takes a while."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, QThreadPool, Signal

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

    def write(self, path: Path, pixels: npt.NDArray[np.uint8]) -> None:
        """Write RGBA pixels of shape (height, width, 4) as soon as those before are written."""
        self._pool.start(lambda: self._write(path, pixels))

    def wait(self) -> None:
        """Wait until all are written (before closing, and in tests)."""
        self._pool.waitForDone()

    def _write(self, path: Path, pixels: npt.NDArray[Any]) -> None:
        from meshmash_viewer.errors import InputError
        from meshmash_viewer.io.write import write_picture

        try:
            write_picture(path, pixels)
        except (InputError, OSError) as fault:
            self.failed.emit(str(fault))
        else:
            self.written.emit(path)
