"""Writes pictures without keeping the window waiting."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QThreadPool, Signal

from meshmash_viewer.app import heap
from meshmash_viewer.app.listening import catch_up, later
from meshmash_viewer.model.failure import failure_of

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.picture import RawPicture

__all__ = ["PictureWriter"]


class PictureWriter(QObject):
    """Makes one picture after the other: drawn in turns of the event loop, finished in a thread.

    Signals
    -------
    written(Path)
        A picture is there.
    failed(Failure)
        Why it is not.
    """

    written = Signal(object)
    failed = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._waiting: deque[tuple[Path, MeshRenderer, tuple[int, int], bool]] = deque()
        self._drawn: tuple[Path, Generator[None, None, RawPicture]] | None = None

    def write(
        self, path: Path, drawing: MeshRenderer, size: tuple[int, int], transparent: bool = False
    ) -> None:
        """Write a picture as soon as those before are written.

        Parameters
        ----------
        path : Path
        drawing : MeshRenderer
            Nobody else's (`MeshRenderer.twin`).
        size : (int, int)
            Width and height in pixels.
        transparent : bool
            Leave the background out.
        """
        self._waiting.append((path, drawing, size, transparent))
        later(self._draw_on)

    def _draw_on(self) -> None:
        """Take the next step of the first picture that is not drawn yet."""
        from meshmash_viewer.app.view.picture import draw_in_steps

        if self._drawn is None and not self._waiting:
            return
        if self._drawn is None:
            path, drawing, size, transparent = self._waiting.popleft()
            self._drawn = path, draw_in_steps(drawing, size, transparent)
        later(self._draw_on)
        path, steps = self._drawn
        try:
            next(steps)
            return
        except StopIteration as end:
            raw = end.value
        except Exception as fault:  # noqa: BLE001  said to the person, and the next one is drawn
            self._drawn = None
            self.failed.emit(failure_of(fault, f"Drawing {path.name}"))
            return
        self._drawn = None
        self._pool.start(lambda: self._write(path, raw))

    def wait(self) -> None:
        """Wait until all are written (before closing, and in tests)."""
        catch_up()
        self._pool.waitForDone()

    def _write(self, path: Path, picture: RawPicture) -> None:
        from meshmash_viewer.io.write import write_picture

        try:
            write_picture(path, picture.rgba())
        except Exception as fault:  # noqa: BLE001  as above
            self.failed.emit(failure_of(fault, f"Writing {path.name}"))
        else:
            self.written.emit(path)
        heap.give_back()  # glibc keeps what drawing took, 0.6 GB after a million vertices
