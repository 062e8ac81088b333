"""Base class of the dialogs that draw many pictures of the render: gallery and movie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QDialog, QLabel, QProgressBar, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import keep_room, show_quietly
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.controls.spin import WholeField
from meshmash_viewer.app.listening import stop_listening
from meshmash_viewer.app.series_painter import Run, SeriesPainter, Sink
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.series import Shot, shots_of
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Failure


class ColumnRange(QWidget):
    """First and last column and the step, as controls named ``<owner>_first_spin`` and so on."""

    changed = Signal()

    def __init__(self, owner: str) -> None:
        super().__init__()
        self.first_spin = self._spin(f"{owner}_first_spin", "First column", 0)
        self.last_spin = self._spin(f"{owner}_last_spin", "Last column", 0)
        self.step_spin = self._spin(f"{owner}_step_spin", "Every how many columns", 1)
        to, every = QLabel("to"), QLabel("every")
        self.setLayout(row(self.first_spin, to, self.last_spin, every, self.step_spin, None))

    def _spin(self, name: str, spoken: str, least: int) -> WholeField:
        return make.spin(name, spoken, self.changed, minimum=least, keyboardTracking=True)

    @property
    def columns(self) -> range:
        """The chosen columns."""
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
    """Draws a draft once the choices have stopped changing, and a file on request.

    Subclasses call `_set_up`, make `remark_label`, and implement `_draw_draft`, `_show_draft`,
    `_show_saving` and `_finish`.
    """

    #: Path of the file that has been written.
    saved = Signal(object)
    remark_label: QLabel

    def _set_up(self, document: Document, scene: MeshView, name: str, delay: int) -> None:
        """Make what both dialogs have; drafts are drawn `delay` milliseconds after a change."""
        self._document, self._scene, self._mesh = document, scene, document.mesh
        self._state: tuple[Any, ...] = ()
        self.range = ColumnRange(name)
        self.progress_bar = theme.named(QProgressBar(), f"{name}_progress_bar", "Pictures drawn")
        self.progress_bar.setTextVisible(False)
        keep_room(self.progress_bar)
        self.progress_bar.hide()
        self._painter, self._draft_painter = SeriesPainter(self), SeriesPainter(self)
        self._painter.drawn.connect(self._show_progress)
        self._painter.finished.connect(self._finish)
        self._painter.failed.connect(self._show_failure)
        self._draft_painter.drawn.connect(self._show_draft)
        self._draft_painter.failed.connect(self._show_failure)
        self._delay = QTimer(self, singleShot=True, interval=delay)
        self._delay.timeout.connect(self._draw_draft)
        scene.frames.stand_in_made.connect(self._draw_draft)

    def _draw_draft(self) -> None:
        raise NotImplementedError

    def _show_draft(self, at: int, made: object) -> None:
        raise NotImplementedError

    def _show_saving(self, saving: bool) -> None:
        raise NotImplementedError

    def _finish(self) -> None:
        raise NotImplementedError

    @property
    def _pixels_on_screen(self) -> tuple[int, int]:
        """Width and height of the render."""
        return self._scene.plotter.pixels()[:2]

    def _choose_range(self, n_columns: int, default: range, *, keep: bool) -> None:
        """Offer the columns of a family; `keep` those chosen if they still exist."""
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
        """Draw the pictures into a file, with the progress shown."""
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
        stop_listening(self)
        self._delay.stop()
        for painter in (self._painter, self._draft_painter):
            painter.close()
        self._scene.frames.stand_in_made.disconnect(self._draw_draft)
        super().done(result)
