"""Pictures drawn in a child process, so that the window responds and drawing can be cancelled."""

from __future__ import annotations

import threading
from subprocess import Popen
from typing import Any, BinaryIO, cast

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import SAMPLES, OffScreen
from meshmash_viewer.app.view.serialization import serialized
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.work import ProcessTree, Wire, start_child


class PictureProcess:
    """A child process that draws pictures, started by the first picture."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._child: Popen[bytes] | None = None
        self._wire: Wire | None = None
        #: Arguments and values of the last picture, which the process has.
        self._given: tuple[Any, ...] | None = None
        self._values: object = None
        #: Whether `close` has been called.
        self.closed = False

    def draw(
        self,
        drawing: MeshRenderer,
        size: tuple[int, int],
        transparent: bool = False,
        samples: int = SAMPLES,
    ) -> npt.NDArray[np.uint8]:
        """Draw a picture, see `picture.draw_frame`; may be called in any thread.

        A series of pictures of one drawing transfers its mesh once; only view and field may change.

        Raises
        ------
        Cancelled
            If `close` is or was called.
        InputError
            If the process crashed.
        """
        given, surface = (drawing, (size, transparent, samples)), drawing.surface
        values = None if surface is None else surface.values
        try:
            wire = self._connected()
            known = given == self._given
            changed = None if known and values is self._values else values
            sent = None if known else (serialized(drawing), given[1])
            wire.send((sent, drawing.view, changed, drawing.caption))
            answer = wire.receive()
        except (EOFError, BrokenPipeError) as fault:
            if self.closed:
                raise Cancelled from fault
            self._end()
            crash = "The process that draws pictures crashed (memory, or graphics driver)"
            raise InputError("process-crashed", crash, "choose a smaller picture") from fault
        failed = isinstance(answer, Exception)
        self._given, self._values = (None, None) if failed else (given, values)
        if failed:
            raise answer
        return cast(npt.NDArray[np.uint8], answer)

    def close(self) -> None:
        """End the process; a picture that is being drawn in another thread is cancelled."""
        self.closed = True
        self._end()

    def _connected(self) -> Wire:
        with self._lock:
            if self.closed:
                raise Cancelled
            if self._wire is None:
                child = self._child = start_child(serve)
                self._wire = Wire(cast(BinaryIO, child.stdout), cast(BinaryIO, child.stdin))
            return self._wire

    def _end(self) -> None:
        with self._lock:
            child, wire = self._child, self._wire
            self._child = self._wire = self._given = None
        if child is not None and wire is not None:
            ProcessTree(child.pid).end()
            child.wait()
            wire.close()


def serve(source: BinaryIO, sink: BinaryIO) -> None:
    """Draw pictures until the pipe is closed; the main function of the process."""
    wire, window = Wire(source, sink), None
    while True:
        try:
            given, view, values, caption = wire.receive()
        except (EOFError, BrokenPipeError):
            return
        answer: object
        try:
            if given is not None:
                if window is not None:
                    window.close()
                described, options = given
                window = OffScreen(described.drawing(), *options)
            assert window is not None
            window.drawing.view = view
            if values is not None:
                window.drawing.show_values(values, caption)
            answer = window.draw()
        except Exception as fault:  # noqa: BLE001  raised in the parent
            answer = fault
        wire.send(answer)
