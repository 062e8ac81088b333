"""Series of pictures, drawn in the background of the window."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QCoreApplication, QObject, Qt, QThreadPool, Signal, Slot

from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import Field, LiveFeatures
from meshmash_viewer.model.notices import failure_of
from meshmash_viewer.progress import Cancelled

if TYPE_CHECKING:
    from meshmash_viewer.app.view.annotations import Caption
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.picture import OffScreen
    from meshmash_viewer.app.view.series import Shot

#: See `OffScreen.draw`.
Picture: TypeAlias = npt.NDArray[np.uint8]
#: Receives the pictures one by one, with number and caption. The context is entered and left in
#: the painter's thread, by an exception if the series was stopped.
Sink: TypeAlias = AbstractContextManager["Callable[[int, Picture, Caption | None], Any]"]


@dataclass(eq=False)
class Run:
    """One series, of which one picture is in memory at a time."""

    #: In no other window (`MeshRenderer.twin`).
    drawing: MeshRenderer
    #: Of each picture, in pixels.
    size: tuple[int, int]
    shots: Sequence[Shot]
    #: Colours, limits and lines, which must not be changed afterwards.
    display: Display
    sink: Sink
    transparent: bool = False
    #: See `compute_shot`.
    picked: npt.NDArray[np.int64] | None = None
    stopped: bool = False
    #: Picture and caption that the thread waits for.
    answer: Future[tuple[Picture, Caption | None]] = field(default_factory=Future)
    window: OffScreen | None = None


class SeriesPainter(QObject):
    """Draws series one after another: fields and files in a thread, frames in the main thread."""

    #: Number of a picture, and what the sink returned for it.
    drawn = Signal(int, object)
    #: All pictures have been drawn, and the sink has been left.
    finished = Signal()
    #: `Failure` of a series that was not stopped.
    failed = Signal(object)
    _due = Signal(object, object, object)
    _took = Signal(object, int, object)
    _ended = Signal(object, object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._runs: list[Run] = []
        queued = Qt.ConnectionType.QueuedConnection
        self._due.connect(self._draw, queued)
        self._took.connect(self._say_drawn, queued)
        self._ended.connect(self._end, queued)

    @property
    def busy(self) -> bool:
        """Whether a series is being drawn."""
        return bool(self._runs)

    def start(self, run: Run) -> None:
        """Draw a series, after those requested before."""
        self._runs.append(run)
        self._pool.start(lambda: self._work(run))

    def stop(self) -> None:
        """Stop all series; the sinks leave no files."""
        for run in self._runs:
            run.stopped = True
            run.answer.cancel()
            _close(run)
        self._runs = []

    def close(self) -> None:
        """Stop all series, and wait for the thread."""
        self.stop()
        self._pool.waitForDone()

    def wait(self) -> None:
        """Wait until all series have been drawn (before closing, and in tests)."""
        while self.busy:
            QCoreApplication.sendPostedEvents(self)
            time.sleep(0.002)

    def _work(self, run: Run) -> None:
        """Draw one series, in the thread."""
        from meshmash_viewer.app.view.series import compute_shot

        live = LiveFeatures()
        fault: Exception | None = None
        try:
            if run.stopped:
                return
            with run.sink as take:
                for at, shot in enumerate(run.shots):
                    found = compute_shot(shot, run.display, live, run.picked)
                    run.answer = Future()
                    self._due.emit(run, shot, found)
                    if run.stopped:  # before there was an answer to cancel
                        raise Cancelled
                    self._took.emit(run, at, take(at, *run.answer.result()))
                    if run.stopped:  # while the sink took it
                        raise Cancelled
        except Exception as error:  # noqa: BLE001  reported
            fault = error
        self._ended.emit(run, fault)

    # -- in the interface thread --------------------------------------------------------------

    @Slot(object, object, object)
    def _draw(self, run: Run, shot: Shot, found: Field | None) -> None:
        from meshmash_viewer.app.view.picture import OffScreen
        from meshmash_viewer.app.view.series import show_shot

        if run.stopped:
            return
        try:
            show_shot(run.drawing, shot, found, run.display)
            if run.window is None:
                run.window = OffScreen(run.drawing, run.size, run.transparent)
            run.answer.set_result((run.window.draw(), run.drawing.caption))
        except Exception as fault:  # noqa: BLE001  raised again in the thread
            run.answer.set_exception(fault)

    @Slot(object, int, object)
    def _say_drawn(self, run: Run, at: int, made: object) -> None:
        if not run.stopped:
            self.drawn.emit(at, made)

    @Slot(object, object)
    def _end(self, run: Run, fault: Exception | None) -> None:
        if run.stopped:
            return
        self._runs.remove(run)
        _close(run)
        if fault is None:
            self.finished.emit()
        else:
            self.failed.emit(failure_of(fault, "Drawing pictures"))


def _close(run: Run) -> None:
    if run.window is not None:
        run.window.close()
        run.window = None
