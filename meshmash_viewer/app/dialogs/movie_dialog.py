"""Filming the render: a sweep through columns or a turn, its size, rate, length and place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QTimer, Signal
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import (
    QComboBox,
    QLabel,
    QProgressBar,
    QPushButton,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.column_range import ColumnRange
from meshmash_viewer.app.controls.facts import keep_room, show_quietly
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.app.controls.spin import DecimalField, WholeField
from meshmash_viewer.app.dialogs.saving import FormatDialog
from meshmash_viewer.app.listening import follow, stop_listening
from meshmash_viewer.app.series_painter import Picture, SeriesPainter
from meshmash_viewer.app.view.annotations import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.series import Shot, series_view, shots_of, turntable
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.sweep import film, n_columns, n_frames
from meshmash_viewer.io.movie import (
    TURN_RATE,
    TURN_SECONDS,
    check_movie,
    estimated_bytes,
    missing_encoder,
    movie_file,
)
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.failure import Failure
from meshmash_viewer.model.field import request_of, shown_family
from meshmash_viewer.units import counted

__all__ = ["MovieDialog"]

_SWEEP, _TURN = "sweep", "turn"
_NAMES = {".mp4": "MP4 (H.264)", ".gif": "GIF", ".webp": "WebP", ".apng": "APNG"}
_LARGEST = 8192
#: Frames that the size is told from, and milliseconds that a choice must rest before that.
_MEASURED, _REST = 6, 500


class MovieDialog(FormatDialog):
    """Asks for all of a film, says how long and how large it will be, and makes it.

    Parameters
    ----------
    document : Document
        With a mesh.
    scene : MeshView
        Whose camera and look the film has.
    path : Path
        Suggested file, without its ending.

    Signals
    -------
    saved(Path)
        The film is there.
    """

    saved = Signal(object)

    def __init__(
        self, document: Document, scene: MeshView, path: Path, parent: QWidget | None = None
    ) -> None:
        self._document, self._scene = document, scene
        self._mesh = document.mesh
        super().__init__("movie", "Save movie", path, _NAMES, missing_encoder, "ffmpeg", parent)
        self._about = ""
        self._shown: tuple[Any, ...] = ()
        self._painter, self._measuring = SeriesPainter(self), SeriesPainter(self)
        self._painter.drawn.connect(self._show_progress)
        self._painter.finished.connect(self._say_saved)
        self._painter.failed.connect(self._say_failed)
        self._measuring.drawn.connect(self._show_estimate)
        self._measuring.failed.connect(self._say_failed)
        scene.small_ready.connect(self._measure)
        self._rest = QTimer(self, singleShot=True, interval=_REST)
        self._rest.timeout.connect(self._measure)
        self._build()
        display = document.display
        for signal in (
            display.events.kind, display.events.fields, document.spectrum_changed,
            document.mesh_changed,
        ):  # fmt: skip
            follow(signal, self._follow_model)
        self._follow_model()

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.motion_combo = theme.named(QComboBox(), "movie_motion_combo", "What moves")
        self.motion_combo.addItem("", _SWEEP)
        self.motion_combo.addItem("Once around the mesh", _TURN)
        self.range = ColumnRange("movie")
        self.range_label = QLabel("Columns")
        self.width_spin = self._pixels("movie_width_spin", "Width", 1280)
        self.height_spin = self._pixels("movie_height_spin", "Height", 720)
        self.rate_spin = DecimalField(
            minimum=0.5, maximum=120.0, decimals=1, suffix=" frames/s", value=TURN_RATE
        )
        theme.named(self.rate_spin, "movie_rate_spin", "Frames a second")
        self.seconds_spin = DecimalField(
            minimum=0.05, maximum=3600.0, decimals=2, suffix=" s", value=TURN_SECONDS
        )
        theme.named(self.seconds_spin, "movie_seconds_spin", "Length in seconds")
        self.length_label = theme.named(QLabel(), "movie_length_label", "Length", role="value")
        self.progress_bar = theme.named(QProgressBar(), "movie_progress_bar", "Frames drawn")
        self.progress_bar.setTextVisible(False)
        keep_room(self.progress_bar)
        self.progress_bar.hide()
        self.accept_button = theme.named(QPushButton("Save"), "movie_save_button", role="primary")
        self._asked = (
            self.motion_combo, self.range, self.width_spin, self.height_spin, self.rate_spin,
            self.seconds_spin, self.format_combo, self.file_row,
        )  # fmt: skip
        self._arrange(
            grid(
                (QLabel("Motion"), self.motion_combo),
                (self.range_label, self.range),
                (QLabel("Size"), row(self.width_spin, QLabel("×"), self.height_spin, None)),
                (QLabel("Speed"), row(self.rate_spin, QLabel("for"), self.seconds_spin, None)),
                (QLabel("Format"), self.format_combo),
                (QLabel("File"), self.file_row),
                (None, self.length_label),
                (None, self.remark_label),
                (None, self.progress_bar),
                spacing=(theme.MARGIN, theme.GAP),
            )
        )
        self.setMinimumWidth(520)
        self.motion_combo.currentIndexChanged.connect(self._suggest_length)
        self.range.changed.connect(self._suggest_length)
        for spin in (self.width_spin, self.height_spin, self.rate_spin, self.seconds_spin):
            spin.valueChanged.connect(self._refresh)
        self.format_combo.currentIndexChanged.connect(self._refresh)

    def _pixels(self, name: str, text: str, value: int) -> WholeField:
        # even, as MP4 must be; odd ones can be typed
        spin = WholeField(minimum=16, maximum=_LARGEST, suffix=" px", value=value, singleStep=2)
        return theme.named(spin, name, f"{text} in pixels")

    # -- what was chosen ----------------------------------------------------------------------

    @property
    def frame_size(self) -> tuple[int, int]:
        """Width and height of the film in pixels."""
        return self.width_spin.value(), self.height_spin.value()

    @property
    def turns(self) -> bool:
        """Whether the mesh turns, rather than that columns go by."""
        return bool(self.motion_combo.currentData() == _TURN)

    def _frames(self) -> tuple[list[Family], int, float]:
        """What each frame shows, nothing for a turn; how many there are, and how many a second.

        Raises
        ------
        InputError
            If there is no such film.
        """
        spectrum, display = self._document.spectrum, self._document.display
        rate, seconds = self.rate_spin.value(), self.seconds_spin.value()
        check_movie(f"movie{self.ending}", self.frame_size, rate)
        if self.turns or not spectrum:
            return [], n_frames(rate, seconds), rate
        families, rate = film(shown_family(display), spectrum, self.range.columns, rate, seconds)
        return families, len(families), rate

    def _shots(self, drawing: MeshRenderer, *, dressed: bool) -> tuple[list[Shot], float]:
        """All frames, and how many of them a second show; the drawing gets its view.

        `dressed` says that the drawing has its field already, if that stays.
        """
        document, ready = self._document, self._document.ready
        assert ready is not None
        families, count, rate = self._frames()
        seen = self._scene.plotter.pixels()[:2]
        drawing.view = series_view(drawing, self.frame_size, seen, turning=not families)
        if not families or document.spectrum is None:
            request = None if dressed else request_of(document)
            return [Shot(request, each) for each in turntable(drawing, drawing.view, count)], rate
        sample = ready.mesh.area_sample() if ready.sample is None else ready.sample
        chosen = document.display.fields
        return shots_of(families, document.spectrum, ready.mesh, sample, chosen), rate

    # -- following ----------------------------------------------------------------------------

    def _follow_model(self) -> None:
        """Another family is another film; one that is being made goes on."""
        document, display = self._document, self._document.display
        if document.mesh is not self._mesh:
            self.reject_all()
            return
        family = shown_family(display)
        now = family.name, family.at_rest(), document.spectrum
        if self._painter.busy or now == self._shown:
            return
        most = n_columns(family, document.spectrum) if document.spectrum else 1
        columns = range(most)
        if self._shown[:1] == now[:1] and self.range.columns[-1] < most:
            columns = self.range.columns
        self._shown = now
        self.range.choose(columns, most)
        self.motion_combo.setItemText(0, f"Through the columns: {family.label}")
        model = self.motion_combo.model()
        assert isinstance(model, QStandardItemModel)
        model.item(0).setEnabled(most > 1)
        if most == 1:
            self.motion_combo.setCurrentIndex(self.motion_combo.findData(_TURN))
        self._suggest_length()

    def _suggest_length(self) -> None:
        """Suggest a rate and a length that suit what moves."""
        rate, seconds = TURN_RATE, TURN_SECONDS
        spectrum = self._document.spectrum
        if not self.turns and spectrum:
            family = shown_family(self._document.display)
            families, rate = film(family, spectrum, self.range.columns)
            seconds = len(families) / rate
        show_quietly(self.rate_spin, rate)
        show_quietly(self.seconds_spin, seconds)
        self._refresh()

    def _refresh(self) -> None:
        """Say how long the film will be, or why there is none."""
        self._about = ""
        self._measuring.stop()
        for widget in (self.range_label, self.range):
            widget.setEnabled(not self.turns)
        self._rest.start()
        self._refresh_remark()

    def _refresh_remark(self) -> None:
        if self._painter.busy:
            return
        text, fault = "", ""
        try:
            _, count, rate = self._frames()
            text = f"{counted(count, 'frame')}, {count / rate:.4g} s"
            text += f", {self._about or 'measuring the size …'}"
        except InputError as error:
            fault = str(error)
        super()._refresh_remark()
        self.length_label.setText(text)
        self.remark_label.setText(fault or self.remark_label.text())
        self.accept_button.setEnabled(self.accept_button.isEnabled() and not fault)

    # -- making -------------------------------------------------------------------------------

    def _measure(self) -> None:
        """Draw some frames to tell the size of the film: of a small mesh, so that nobody waits."""
        small = None if self._painter.busy else self._scene.small_twin()
        if small is None:
            return
        drawing, picked = small
        try:
            shots, rate = self._shots(drawing, dressed=picked is None)
        except InputError:
            return
        first, display = shots[:_MEASURED], replace(self._document.display)
        sink = _measured(self.ending, rate, len(first), len(shots))
        self._measuring.stop()
        self._measuring.start(drawing, self.frame_size, first, display, sink, picked=picked)

    def _show_estimate(self, _at: int, about: object) -> None:
        if isinstance(about, int):
            self._about = f"about {written_bytes(about)}"
            self._refresh_remark()

    def _accept(self) -> None:
        """Make the film; the dialog stays until it is there."""
        fault = self.file_row.fault(self._output)
        if fault:
            self.remark_label.setText(fault)
            return
        drawing = self._scene.renderer.twin()
        try:
            shots, rate = self._shots(drawing, dressed=True)
        except InputError as error:
            self.remark_label.setText(str(error))
            return
        self._rest.stop()
        self._measuring.stop()
        self.progress_bar.setRange(0, len(shots))
        self.progress_bar.setValue(0)
        self.remark_label.setText("")
        sink = _filmed(self.path, self.frame_size, rate, len(shots))
        display = replace(self._document.display)
        self._painter.start(drawing, self.frame_size, shots, display, sink)
        self._show_making(True)

    def _show_making(self, making: bool) -> None:
        self.progress_bar.setVisible(making)
        for widget in self._asked:
            widget.setEnabled(not making)
        self.accept_button.setEnabled(not making)
        if not making:
            self.range.setEnabled(not self.turns)

    def _show_progress(self, at: int, _made: object) -> None:
        done, frames = at + 1, self.progress_bar.maximum()
        self.progress_bar.setValue(done)
        self.length_label.setText(f"{done:,} of {counted(frames, 'frame')}")

    def _say_saved(self) -> None:
        self.saved.emit(self.path)
        self.accept()

    def _say_failed(self, failure: Failure) -> None:
        self._show_making(False)
        self._refresh_remark()
        self.remark_label.setText(failure.text)

    def reject(self) -> None:
        """Give up the film that is being made, of which nothing is left; or close."""
        if self._painter.busy:
            self._painter.close()
            self._show_making(False)
            self._refresh_remark()
        else:
            super().reject()

    def reject_all(self) -> None:
        """Give up, and close."""
        self._painter.close()
        self.reject()

    def done(self, result: int) -> None:
        """Leave nothing that draws."""
        stop_listening(self)
        self._rest.stop()
        for painter in (self._painter, self._measuring):
            painter.close()
        self._scene.small_ready.disconnect(self._measure)
        super().done(result)


@contextmanager
def _filmed(
    path: Path, size: tuple[int, int], rate: float, count: int
) -> Iterator[Callable[[int, Picture, Caption | None], None]]:
    with movie_file(path, size, rate, count) as add:
        yield lambda _at, picture, _caption: add(picture)


@contextmanager
def _measured(
    ending: str, rate: float, count: int, of: int
) -> Iterator[Callable[[int, Picture, Caption | None], int | None]]:
    """With the last picture tells about how many bytes the whole film will have."""
    frames = []

    def take(at: int, picture: Picture, _caption: Caption | None) -> int | None:
        frames.append(picture)
        return estimated_bytes(ending, frames, rate, of) if at == count - 1 else None

    yield take
