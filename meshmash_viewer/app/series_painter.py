"""Draws series of pictures without keeping the window waiting."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from PySide6.QtCore import QObject, Qt, QThreadPool, Signal, Slot

from meshmash_viewer.app import heap
from meshmash_viewer.app.listening import later
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.field import LiveFeatures
from meshmash_viewer.progress import Cancelled

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from meshmash_viewer.app.view.annotations import Caption
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
    from meshmash_viewer.app.view.picture import OffScreen, RawPicture
    from meshmash_viewer.app.view.series import Dress, Look, Shot

__all__ = ["SeriesPainter", "Sink"]

#: What takes the pictures, one by one with their number and caption, and is told when there are no
#: more: entered and left, by an exception if the series was stopped, in the thread that feeds it.
Sink: TypeAlias = AbstractContextManager["Callable[[int, RawPicture, Caption | None], Any]"]


@dataclass(eq=False)
class _Run:
    """One series on its way: what is held of it is one picture, however many there are."""

    drawing: MeshRenderer
    size: tuple[int, int]
    shots: Sequence[Shot]
    look: Look
    sink: Sink
    transparent: bool
    picked: npt.NDArray[np.int64] | None
    at: int = 0
    stopped: bool = False
    live: LiveFeatures = field(default_factory=LiveFeatures)
    stack: ExitStack = field(default_factory=ExitStack)
    take: Callable[[int, RawPicture, Caption | None], Any] | None = None
    window: OffScreen | None = None
    steps: Generator[None, None, RawPicture] | None = None


class SeriesPainter(QObject):
    """Makes one picture after the other: fields and files in a thread, frames in between events.

    Signals
    -------
    drawn(int, object)
        A picture was taken; what the sink made of it.
    finished()
        All were, and the sink has been left.
    failed(Failure)
        Why they were not; a series that is stopped says nothing.
    """

    drawn = Signal(int, object)
    finished = Signal()
    failed = Signal(object)
    _dressed = Signal(object, object)
    _took = Signal(object, int, object)
    _ended = Signal(object, object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._run: _Run | None = None
        queued = Qt.ConnectionType.QueuedConnection
        self._dressed.connect(self._put_on, queued)
        self._took.connect(self._say_drawn, queued)
        self._ended.connect(self._end, queued)

    @property
    def busy(self) -> bool:
        """Whether a series is on its way."""
        return self._run is not None

    def start(
        self,
        drawing: MeshRenderer,
        size: tuple[int, int],
        shots: Sequence[Shot],
        look: Look,
        sink: Sink,
        *,
        transparent: bool = False,
        picked: npt.NDArray[np.int64] | None = None,
    ) -> None:
        """Draw a series in the place of the one that is on its way.

        Parameters
        ----------
        drawing : MeshRenderer
            Nobody else's (`MeshRenderer.twin`).
        size : (int, int)
            Of each picture in pixels.
        shots : sequence of Shot
        look : Look
        sink : Sink
        transparent : bool
            Leave the background out.
        picked : ndarray of int64, optional
            See `dressed`.
        """
        self.stop()
        self._run = run = _Run(drawing, size, shots, look, sink, transparent, picked)
        self._pool.start(lambda: self._begin(run))

    def stop(self) -> None:
        """Give up the series that is on its way; its sink undoes what it has done."""
        run, self._run = self._run, None
        if run is None:
            return
        run.stopped = True
        _close(run)
        self._pool.start(lambda: _leave(run, Cancelled()))

    def close(self) -> None:
        """Give up, and wait until nothing is left of it."""
        self.stop()
        self._pool.waitForDone()

    # -- in the thread ------------------------------------------------------------------------

    def _begin(self, run: _Run) -> None:
        try:
            if not run.stopped:
                run.take = run.stack.enter_context(run.sink)
        except Exception as fault:  # noqa: BLE001  said to the person
            self._ended.emit(run, _leave(run, fault))
        else:
            self._dress(run)

    def _dress(self, run: _Run) -> None:
        from meshmash_viewer.app.view.series import dressed

        if run.stopped:
            return
        try:
            dress = dressed(run.shots[run.at], run.look, run.live, run.drawing, run.picked)
        except Exception as fault:  # noqa: BLE001  as above
            self._ended.emit(run, _leave(run, fault))
        else:
            self._dressed.emit(run, dress)

    def _take(self, run: _Run, raw: RawPicture, caption: Caption | None) -> None:
        if run.stopped:
            return
        assert run.take is not None
        try:
            made = run.take(run.at, raw, caption)
        except Exception as fault:  # noqa: BLE001  as above
            self._ended.emit(run, _leave(run, fault))
            return
        self._took.emit(run, run.at, made)
        run.at += 1
        if run.at < len(run.shots):
            self._dress(run)
        else:
            self._ended.emit(run, _leave(run, None))

    # -- in the interface thread --------------------------------------------------------------

    @Slot(object, object)
    def _put_on(self, run: _Run, dress: Dress) -> None:
        from meshmash_viewer.app.view.picture import OffScreen

        if run is not self._run:
            return
        try:
            dress.put_on(run.drawing)
            if run.window is None:
                run.window = OffScreen(run.drawing, run.size, run.transparent)
            run.steps = run.window.draw()
        except Exception as fault:  # noqa: BLE001  as above
            self._give_up(run, fault)
        else:
            later(self._draw_on)

    def _draw_on(self) -> None:
        """Take the next step of the picture that is being drawn."""
        run = self._run
        if run is None or run.steps is None:
            return
        try:
            next(run.steps)
        except StopIteration as end:
            raw, caption, run.steps = end.value, run.drawing.caption, None
            self._pool.start(lambda: self._take(run, raw, caption))
        except Exception as fault:  # noqa: BLE001  as above
            self._give_up(run, fault)
        else:
            later(self._draw_on)

    def _give_up(self, run: _Run, fault: Exception) -> None:
        run.steps = None
        self._pool.start(lambda: self._ended.emit(run, _leave(run, fault)))

    @Slot(object, int, object)
    def _say_drawn(self, run: _Run, at: int, made: object) -> None:
        if run is self._run:
            self.drawn.emit(at, made)

    @Slot(object, object)
    def _end(self, run: _Run, fault: Exception | None) -> None:
        if run is not self._run:
            return
        self._run = None
        _close(run)
        if fault is None:
            self.finished.emit()
        else:
            self.failed.emit(failure_of(fault, "Drawing pictures"))


def _close(run: _Run) -> None:
    run.steps = None
    if run.window is not None:
        run.window.close()
        run.window = None


def _leave(run: _Run, fault: Exception | None) -> Exception | None:
    """Leave the sink, and say what is wrong then."""
    try:
        run.stack.__exit__(None if fault is None else type(fault), fault, None)
    except Exception as left:  # noqa: BLE001  what the sink made of it is what is said
        return left
    finally:
        heap.give_back()
    return fault
