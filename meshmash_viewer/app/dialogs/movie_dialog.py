"""Dialog that makes a movie: a sweep through columns, or a turn of the mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import row
from meshmash_viewer.app.controls.number_field import NumberField, WholeField
from meshmash_viewer.app.dialogs.files import FormatDialog
from meshmash_viewer.app.dialogs.series import Picture, SeriesDialog
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.view.caption import Caption
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.series import Shot, series_view, turntable
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.table import film, n_columns, n_frames
from meshmash_viewer.io.movie import (
    TURN_RATE,
    TURN_SECONDS,
    check_movie,
    missing_encoder,
    movie_file,
)
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import shown_family
from meshmash_viewer.units import counted

_SWEEP, _TURN = "sweep", "turn"
_NAMES = {".mp4": "MP4 (H.264)", ".gif": "GIF"}
_LARGEST = 8192


class MovieDialog(SeriesDialog, FormatDialog):
    """Dialog for the parameters of a movie, which shows its length, and makes it.

    `path` is the suggested file without its ending.
    """

    def __init__(
        self, document: Document, scene: MeshView, path: Path, parent: QWidget | None = None
    ) -> None:
        missing = {ending: str(missing_encoder(ending) or "") for ending in _NAMES}
        super().__init__("movie", "Save movie", path, _NAMES, parent, missing, "imageio-ffmpeg")
        self._set_up(document, scene, "movie")
        self._build()
        events = document.display.events
        signals = events.kind, events.fields, document.spectrum_changed, document.mesh_changed
        follow(signals, self._follow_model)
        self._follow_model()

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> None:
        self.motion_combo = make.combo("movie_motion_combo", "What moves")
        self.motion_combo.addItem("", _SWEEP)
        self.motion_combo.addItem("Once around the mesh", _TURN)
        self.width_spin = self._pixels("movie_width_spin", "Width", 1280)
        self.height_spin = self._pixels("movie_height_spin", "Height", 720)
        self.rate_spin = NumberField(
            "movie_rate_spin", "Frames per second", limits=(0.5, 120.0), step=_add, live=True
        )
        self.seconds_spin = NumberField(
            "movie_seconds_spin", "Length in seconds", limits=(0.05, 3600.0), step=_add, live=True
        )
        self._show_speed(TURN_RATE, TURN_SECONDS)
        self.length_label = make.label("movie_length_label", "Length", role="value")
        self._inputs = (
            self.motion_combo, self.range, self.width_spin, self.height_spin, self.rate_spin,
            self.seconds_spin, self.format_combo, self.file_row,
        )  # fmt: skip
        self._arrange(
            ("Motion", self.motion_combo),
            ("Columns", self.range),
            ("Size", row(self.width_spin, QLabel("×"), self.height_spin, None)),
            ("Speed", row(self.rate_spin, QLabel("for"), self.seconds_spin, None)),
            ("Format", self.format_combo),
            below=(self.length_label, self.remark_label, self.progress_bar),
        )
        self.motion_combo.currentIndexChanged.connect(self._suggest_length)
        self.range.changed.connect(self._suggest_length)
        for spin in (self.width_spin, self.height_spin):
            spin.valueChanged.connect(self._refresh)
        for field in (self.rate_spin, self.seconds_spin):
            field.edited.connect(self._refresh)
            field.withdrawn.connect(self._refresh)
            field.refused.connect(self.say_refusal)
        self.format_combo.currentIndexChanged.connect(self._refresh)

    def _pixels(self, name: str, text: str, value: int) -> WholeField:
        # the step keeps sizes even, which MP4 requires; odd sizes can be typed
        return make.spin(
            name, f"{text} in pixels", minimum=16, maximum=_LARGEST, suffix=" px", value=value,
            singleStep=2,
        )  # fmt: skip

    # -- parameters ---------------------------------------------------------------------------

    @property
    def frame_size(self) -> tuple[int, int]:
        """Width and height of the movie in pixels."""
        return self.width_spin.value(), self.height_spin.value()

    @property
    def turns(self) -> bool:
        """Whether the mesh turns; otherwise the movie goes through the columns."""
        return bool(self.motion_combo.currentData() == _TURN)

    def _frames(self) -> tuple[list[Family], int, float]:
        """Return families, number of frames, and frame rate; a turn has no families.

        Raise `InputError` if the parameters of the movie are invalid.
        """
        spectrum, display = self._document.spectrum, self._document.display
        rate, seconds = self.rate_spin.value, self.seconds_spin.value
        assert rate is not None and seconds is not None  # noqa: PT018  shown by `_suggest_length`
        check_movie(f"movie{self.ending}", self.frame_size, rate)
        if self.turns or not spectrum:
            return [], n_frames(rate, seconds), rate
        families, rate = film(shown_family(display), spectrum, self.range.columns, rate, seconds)
        return families, len(families), rate

    def _shots(self, drawing: MeshRenderer) -> tuple[list[Shot], float]:
        """Set the view of the drawing; return all frames and the frame rate."""
        families, count, rate = self._frames()
        drawing.view = series_view(
            drawing, self.frame_size, self._pixels_on_screen, turning=not families
        )
        if families:
            return self._shots_of(families), rate
        return [Shot(view=each) for each in turntable(drawing, drawing.view, count)], rate

    # -- following ----------------------------------------------------------------------------

    def _follow_model(self) -> None:
        """Offer the columns of the displayed family, unless a movie is being made."""
        document, display = self._document, self._document.display
        if document.mesh is not self._mesh:
            self._painter.cancel()
            self.reject()
            return
        family = shown_family(display)
        state = family.name, family.at_rest(), document.spectrum
        if self._painter.busy or state == self._state:
            return
        most = n_columns(family, document.spectrum) if document.spectrum else 1
        same_family = self._state[:1] == state[:1]
        self._state = state
        self._choose_range(most, range(most), keep=same_family)
        self.motion_combo.setItemText(0, f"Through the columns: {family.label}")
        model = self.motion_combo.model()
        assert isinstance(model, QStandardItemModel)
        model.item(0).setEnabled(most > 1)
        if most == 1:
            self.motion_combo.setCurrentIndex(self.motion_combo.findData(_TURN))
        self._suggest_length()

    def _suggest_length(self) -> None:
        rate, seconds = TURN_RATE, TURN_SECONDS
        spectrum = self._document.spectrum
        if not self.turns and spectrum:
            family = shown_family(self._document.display)
            families, rate = film(family, spectrum, self.range.columns)
            seconds = len(families) / rate
        self._show_speed(rate, seconds)
        self._refresh()

    def _show_speed(self, rate: float, seconds: float) -> None:
        self.rate_spin.show_value(rate, "frames/s", with_unit=True)
        self.seconds_spin.show_value(seconds, "s", with_unit=True)

    def _refresh(self) -> None:
        for widget in (self._form.labelForField(self.range), self.range):
            widget.setEnabled(not self.turns)
        self._refresh_remark()

    def _refresh_remark(self) -> None:
        if self._painter.busy:
            return
        super()._refresh_remark()
        text = ""
        with suppress(InputError):
            _, count, rate = self._frames()
            text = f"{counted(count, 'frame')}, {count / rate:.4g} s"
        self.length_label.setText(text)

    def _fault(self) -> str:
        try:
            self._frames()
        except InputError as fault:
            return str(fault)
        return super()._fault()

    # -- making -------------------------------------------------------------------------------

    def _save(self) -> None:
        """Make the movie; `_finish` closes the dialog."""
        drawing = self._scene.renderer.twin()
        try:
            shots, rate = self._shots(drawing)
        except InputError as error:
            self.remark_label.setText(str(error))
            return
        sink = _movie_sink(self.path, self.frame_size, rate)
        self._save_series(drawing, self.frame_size, shots, sink)

    def _show_saving(self, saving: bool) -> None:
        self.progress_bar.setVisible(saving)
        for widget in (*self._inputs, self.accept_button):
            widget.setEnabled(not saving)
        if not saving:
            self.range.setEnabled(not self.turns)
            self._refresh_remark()

    def _show_progress(self, at: int, made: object) -> None:
        super()._show_progress(at, made)
        frames = counted(self.progress_bar.maximum(), "frame")
        self.length_label.setText(f"{at + 1:,} of {frames}")

    def _finish(self) -> None:
        self.saved.emit(self.path)
        self.accept()

    def reject(self) -> None:
        """Stop making the movie and delete its file; close if no movie is being made."""
        if self._painter.busy:
            self._painter.cancel()
            self._show_saving(False)
        else:
            super().reject()


def _add(value: float, steps: int) -> float:
    return value + steps


@contextmanager
def _movie_sink(
    path: Path, size: tuple[int, int], rate: float
) -> Iterator[Callable[[int, Picture, Caption | None], None]]:
    with movie_file(path, size, rate) as add:
        yield lambda _at, picture, _caption: add(picture)
