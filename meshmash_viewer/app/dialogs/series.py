"""Series of pictures drawn in the background, and the base class of their dialogs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QDialog, QLabel, QProgressBar, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import keep_room, row, show_quietly
from meshmash_viewer.app.controls.number_field import WholeField
from meshmash_viewer.app.executor import Call, Held, Slot, shutdown
from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.child import PictureProcess
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.series import Shot, compute_shot, shots_of, show_shot
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import LiveFeatures
from meshmash_viewer.model.notices import Failure, failure_of
from meshmash_viewer.progress import Cancelled

#: Pixels of a picture, see `OffScreen.draw`.
Picture: TypeAlias = npt.NDArray[np.uint8]
#: Context manager of a function that receives number, pixels and caption of each picture. It is
#: entered and left in the painter's thread, with an exception if the series was stopped.
Sink: TypeAlias = AbstractContextManager[Callable[[int, Picture, Caption | None], Any]]


@dataclass(eq=False)
class Run:
    """Series of pictures, of which only one is in memory at a time."""

    #: A renderer without a window (`MeshRenderer.twin`), used by the painter only.
    drawing: MeshRenderer
    #: Width and height of the pictures in pixels.
    size: tuple[int, int]
    shots: Sequence[Shot]
    #: Colours, limits and lines; a copy that does not change.
    display: Display
    sink: Sink
    transparent: bool = False
    #: Vertices at which fields are computed, see `compute_shot`.
    picked: npt.NDArray[np.int64] | None = None


class SeriesPainter(QObject):
    """Painter that draws one series of pictures at a time.

    Fields are computed and files written in a thread; pictures are drawn in a child process, which
    is kept for the next series.
    """

    #: Number of a picture, and the value that the sink returned for it.
    drawn = Signal(int, object)
    #: All pictures of a series have been drawn, and its sink has been left.
    finished = Signal()
    #: `Failure` of a series.
    failed = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process = PictureProcess()
        self._held = Held(self, lambda: self._process.close())
        self._slot = Slot(self, "pictures")

    @property
    def busy(self) -> bool:
        """Whether a series is being drawn."""
        return self._slot.working

    def start(self, run: Run) -> None:
        """Stop the current series, and draw another."""
        self.stop()
        self._slot.submit(partial(self._draw, run), self._take, self._fail)

    def stop(self) -> None:
        """Stop the series after the current picture; its sink deletes an unfinished file."""
        self._slot.drop()

    def cancel(self) -> None:
        """Stop the series and the current picture."""
        self.stop()
        self._process.close()
        self._process = PictureProcess()

    def _draw(self, run: Run, call: Call) -> None:
        """Draw a series; runs in a thread."""
        live, process = LiveFeatures(), self._process
        with run.sink as take:
            for at, shot in enumerate(run.shots):
                field = compute_shot(shot, run.display, live, run.picked)
                show_shot(run.drawing, shot, field, run.display)
                picture = process.draw(run.drawing, run.size, run.transparent)
                call.send((at, take(at, picture, run.drawing.caption)))
                if call.cancelled():
                    raise Cancelled

    def _take(self, picture: tuple[int, Any] | None) -> None:
        """Receive a picture, or None at the end of the series."""
        if picture is None:
            self.finished.emit()
        else:
            self.drawn.emit(*picture)

    def _fail(self, fault: Exception) -> None:
        self.failed.emit(failure_of(fault, "Drawing pictures"))


class ColumnRange(QWidget):
    """Fields for first column, last column and step, named ``<owner>_first_spin`` and so on."""

    changed = Signal()

    def __init__(self, owner: str) -> None:
        super().__init__()
        self.first_spin = self._spin(f"{owner}_first_spin", "First column", 0)
        self.last_spin = self._spin(f"{owner}_last_spin", "Last column", 0)
        self.step_spin = self._spin(f"{owner}_step_spin", "Every how many columns", 1)
        to, every = QLabel("to"), QLabel("every")
        self.setLayout(row(self.first_spin, to, self.last_spin, every, self.step_spin, None))

    def _spin(self, name: str, spoken: str, least: int) -> WholeField:
        return make.spin(name, spoken, self.changed, minimum=least)

    @property
    def columns(self) -> range:
        first, last = sorted((self.first_spin.value(), self.last_spin.value()))
        return range(first, last + 1, self.step_spin.value())

    @property
    def most(self) -> int:
        """Number of columns that can be chosen."""
        return self.last_spin.maximum() + 1

    def choose(self, columns: range, most: int) -> None:
        """Choose some of `most` columns, without emitting `changed`."""
        show_quietly(self.first_spin, columns[0], most - 1)
        show_quietly(self.last_spin, columns[-1], most - 1)
        show_quietly(self.step_spin, columns.step, max(most - 1, 1), least=1)


class SeriesDialog(QDialog):
    """Base class of dialogs that draw a series of pictures into a file on request.

    Subclasses call `_set_up`, make `remark_label`, and implement `_show_saving` and `_finish`.
    """

    #: Path of the file that has been written.
    saved = Signal(object)
    remark_label: QLabel

    def _set_up(self, document: Document, scene: MeshView, name: str) -> None:
        """Make the common widgets and the painter."""
        self._document, self._scene, self._mesh = document, scene, document.mesh
        self._state: tuple[Any, ...] = ()
        self.range = ColumnRange(name)
        self.progress_bar = theme.named(QProgressBar(), f"{name}_progress_bar", "Pictures drawn")
        self.progress_bar.setTextVisible(False)
        keep_room(self.progress_bar)
        self.progress_bar.hide()
        self._painter = SeriesPainter(self)
        self._painter.drawn.connect(self._show_progress)
        self._painter.finished.connect(self._finish)
        self._painter.failed.connect(self._show_failure)

    def _show_saving(self, saving: bool) -> None: ...
    def _finish(self) -> None: ...

    @property
    def _pixels_on_screen(self) -> tuple[int, int]:
        """Width and height of the render in pixels."""
        return self._scene.plotter.pixels()[:2]

    def _choose_range(self, n_columns: int, default: range, *, keep: bool) -> None:
        """Set the number of columns, and choose `default`, or `keep` a chosen range that fits."""
        keep = keep and self.range.columns[-1] < n_columns
        self.range.choose(self.range.columns if keep else default, n_columns)

    def _shots_of(self, families: Sequence[Family]) -> list[Shot]:
        document, ready = self._document, self._document.ready
        assert ready is not None
        assert document.spectrum is not None
        sample: npt.NDArray[np.int64]
        sample = ready.mesh.area_sample() if ready.sample is None else ready.sample
        chosen, hidden = document.display.fields, document.hidden
        names = {pin.vertex: pin.name for pin in document.pins.placed}
        return shots_of(families, document.spectrum, ready.mesh, sample, chosen, hidden, names)

    def _save_series(
        self,
        drawing: MeshRenderer,
        size: tuple[int, int],
        shots: Sequence[Shot],
        sink: Sink,
        *,
        transparent: bool = False,
    ) -> None:
        self.progress_bar.setRange(0, len(shots))
        self.progress_bar.setValue(0)
        self.remark_label.clear()
        self._show_saving(True)
        display = replace(self._document.display)
        self._painter.start(Run(drawing, size, shots, display, sink, transparent))

    def _show_progress(self, at: int, _made: object) -> None:
        self.progress_bar.setValue(at + 1)

    def _show_failure(self, failure: Failure) -> None:
        self._show_saving(False)
        self.remark_label.setText(failure.text)

    def done(self, result: int) -> None:
        shutdown(self)
        super().done(result)
