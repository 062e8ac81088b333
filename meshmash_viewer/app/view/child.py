"""Pictures drawn in a child process, so that the window responds and drawing can be cancelled."""

from __future__ import annotations

from typing import Any, BinaryIO, cast

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import SAMPLES, OffScreen
from meshmash_viewer.app.view.serialization import serialized
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.work import Child, Wire


class PictureProcess(Child):
    """A child process that draws pictures."""

    def __init__(self) -> None:
        super().__init__(serve)
        #: Wire, arguments and values of the last picture, which the process has.
        self._known: tuple[Any, ...] | None = None
        self._values: object = None

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
        options, surface = (size, transparent, samples), drawing.surface
        values = None if surface is None else surface.values
        try:
            wire = self.connect()
            given = wire, drawing, options
            known = given == self._known
            changed = None if known and values is self._values else values
            sent = None if known else (serialized(drawing), options)
            wire.send((sent, drawing.view, changed, drawing.caption))
            answer = wire.receive()
        except (EOFError, BrokenPipeError) as fault:
            if self.closed:
                raise Cancelled from fault
            self.end()
            crash = "The process that draws pictures crashed (memory, or graphics driver)"
            raise InputError("process-crashed", crash, "choose a smaller picture") from fault
        failed = isinstance(answer, Exception)
        self._known, self._values = (None, None) if failed else (given, values)
        if failed:
            raise answer
        return cast(npt.NDArray[np.uint8], answer)


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
