"""Dialogs that save pictures of a given size on paper: of the gallery, or of the render."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QBrush, QColor, QImage, QPainter, QPixmap, QResizeEvent
from PySide6.QtWidgets import QLabel, QLayout, QSizePolicy, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, grid, row, show_quietly
from meshmash_viewer.app.dialogs.files import FormatDialog
from meshmash_viewer.app.executor import Slot, shutdown
from meshmash_viewer.app.view.figure import FigureOptions, Panel, compose, picture_of
from meshmash_viewer.app.view.page import MM
from meshmash_viewer.errors import InputError

_FORMATS = {
    ".png": "PNG picture, with its size on paper",
    ".pdf": "PDF, with text and bars as vectors",
    ".svg": "SVG, with text and bars as vectors",
}
#: Names of usual widths, by width in mm.
_WIDTHS = {
    "85": "One column, 85 mm",
    "114": "One and a half, 114 mm",
    "174": "Two columns, 174 mm",
    "339": "Slide, 339 mm",
    "": "Custom",
}
_RESOLUTIONS = {dpi: f"{dpi} dpi" for dpi in ("150", "300", "600", "1200")}
_BACKGROUNDS = {"white": "White", "transparent": "Transparent", "window": "As in the window"}
_PARTS = {
    "title": "Title", "color_bar": "Colour bar", "scale_bar": "Scale bar", "axes": "Axes",
    "pins": "Pins",
}  # fmt: skip
#: Smallest side of the preview, and side of the squares behind it, in pixels.
_LEAST, _SQUARE = 240, 8


class SheetDialog(FormatDialog):
    """Dialog for width, resolution, background and file of a picture.

    `path` is the suggested file without its ending, `before` are the initial options.
    """

    formats: ClassVar = {".png": _FORMATS[".png"]}

    def __init__(
        self,
        path: Path,
        parent: QWidget | None = None,
        before: FigureOptions | None = None,
    ) -> None:
        super().__init__("figure", "Save picture", path, self.formats, parent)
        before = before or FigureOptions()
        self.width_combo = make.combo(
            "figure_width_combo", "Usual widths of pictures", self._take_width, _WIDTHS
        )
        self.width_spin = make.spin(
            "figure_width_spin", "Width in mm", self._show_width, minimum=10, maximum=2000,
            suffix=" mm", value=round(before.width_mm),
        )  # fmt: skip
        self.dpi_combo = make.combo(
            "figure_dpi_combo", "Pixels an inch", self._change, _RESOLUTIONS
        )
        self.dpi_combo.setCurrentIndex(max(self.dpi_combo.findData(str(before.dpi)), 0))
        self.background_combo = make.combo(
            "figure_background_combo", "Background", self._change, _BACKGROUNDS
        )
        background = self.background_combo.findData(before.background)
        self.background_combo.setCurrentIndex(max(background, 0))
        self._build(before)
        self._show_width()

    def _build(self, _before: FigureOptions) -> None:
        self._arrange(*self._size_rows())

    def _size_rows(self) -> tuple[tuple[str, QLayout], ...]:
        return (
            ("Width", row((self.width_combo,), self.width_spin)),
            ("Resolution", row((self.dpi_combo,))),
            ("Background", row((self.background_combo,))),
        )

    @property
    def options(self) -> FigureOptions:
        """The chosen options; raises `InputError` if they are incompatible."""
        return FigureOptions(
            width_mm=float(self.width_spin.value()),
            dpi=int(self.dpi_combo.currentData()),
            background=self.background_combo.currentData(),
        )

    def _take_width(self, width: str) -> None:
        if width:
            show_quietly(self.width_spin, int(width))
            self._change()
        else:
            self.width_spin.setFocus()

    def _show_width(self) -> None:
        row = self.width_combo.findData(str(self.width_spin.value()))
        self.width_combo.setCurrentIndex(row if row >= 0 else len(_WIDTHS) - 1)
        self._change()

    def _change(self, *_: object) -> None:
        self._refresh_remark()

    def _fault(self) -> str:
        try:
            _ = self.options
        except InputError as fault:
            return str(fault)
        return super()._fault()


#: Pixels of a preview, and width and height of the figure in mm.
_Drawn: TypeAlias = tuple[npt.NDArray[np.uint8], tuple[float, float]]


def _drawn(panels: Sequence[Panel], options: FigureOptions, size: tuple[int, int]) -> _Drawn:
    """Draw a preview of at most `size` pixels."""
    figure = compose(panels, options)
    wide, high = figure.get_size_inches()
    pixels = picture_of(figure, min(size[0] / wide, size[1] / high))
    return pixels, (wide * MM, high * MM)


class FigureDialog(SheetDialog):
    """Dialog for size, contents and file of a figure, with a preview.

    `seen` returns the visible part of each mesh, or nothing while the renders cannot be drawn
    quickly. Call `look` when its result may have changed.
    """

    formats = _FORMATS

    def __init__(
        self,
        path: Path,
        seen: Callable[[], Sequence[Panel]],
        parent: QWidget | None = None,
        before: FigureOptions | None = None,
    ) -> None:
        self._seen = seen
        #: The panels of the preview; empty until the renders have been drawn.
        self.panels: Sequence[Panel] = ()
        super().__init__(path, parent, before)
        self._painter = Slot(self, "preview")

    def _build(self, before: FigureOptions) -> None:
        self.font_spin = make.spin(
            "figure_font_spin", "Size of the text in points", self._change, minimum=3,
            maximum=72, suffix=" pt", value=round(before.font_points),
        )  # fmt: skip
        self.checks = {
            name: make.check(text, f"figure_{name}_check", text, self._change)
            for name, text in _PARTS.items()
        }
        for name, check in self.checks.items():
            check.setChecked(bool(getattr(before, name)))
        self.preview = _PreviewLabel()
        self.preview.resized.connect(self._change)
        self.size_label = make.label("figure_size_label", role="muted")
        self.size_label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        title, bar, scale, axes, pins = self.checks.values()
        self._arrange(
            *self._size_rows(),
            ("Text", row((self.font_spin,))),
            ("Show", grid((title, bar), (scale, axes), (pins, None))),
            ("Format", self.format_combo),
            left=column((self.preview,), self.size_label),
        )
        self.resize(860, 440)

    @property
    def options(self) -> FigureOptions:
        shown: dict[str, Any] = {name: check.isChecked() for name, check in self.checks.items()}
        return replace(super().options, font_points=float(self.font_spin.value()), **shown)

    def look(self) -> None:
        if not self.panels and self.isVisible():
            try:
                self.panels = self._seen()
            except InputError as fault:
                self.preview.setText(str(fault))
            self._change()

    def done(self, result: int) -> None:
        shutdown(self)
        super().done(result)

    def _change(self, *_: object) -> None:
        super()._change()
        if not self.panels or not self.accept_button.isEnabled():
            return
        ratio = self.devicePixelRatioF()
        size = round(ratio * self.preview.width()), round(ratio * self.preview.height())
        panels, options = self.panels, self.options
        self._painter.submit(lambda _: _drawn(panels, options, size), self._take, self._fail)

    def _fail(self, fault: Exception) -> None:
        if not isinstance(fault, InputError):
            raise fault
        self.preview.setText(str(fault))
        self.size_label.clear()
        self.accept_button.setEnabled(False)

    def _take(self, drawn: _Drawn) -> None:
        picture, size = drawn
        self.preview.show_pixels(picture)
        dpi = self.options.dpi
        mm = " × ".join(f"{round(side, 1):g}" for side in size)
        pixels = " × ".join(f"{round(side / MM * dpi):,}" for side in size)
        self.size_label.setText(f"{mm} mm, {pixels} pixels")


class _PreviewLabel(QLabel):
    """Label with a picture on a pattern of squares, visible through transparent pixels."""

    resized = Signal()

    def __init__(self) -> None:
        super().__init__("The preview is being drawn …")
        theme.named(self, "figure_preview", "Preview", role="muted")
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setWordWrap(True)
        self.setMinimumSize(_LEAST, _LEAST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)

    def sizeHint(self) -> QSize:
        return QSize(400, 360)

    def show_pixels(self, pixels: npt.NDArray[np.uint8]) -> None:
        """Show RGBA values of screen pixels, shape (height, width, 4)."""
        high, wide, _ = pixels.shape
        form = QImage.Format.Format_RGBA8888
        image = QImage(np.ascontiguousarray(pixels).data, wide, high, 4 * wide, form)
        shown = QPixmap(wide, high)
        with QPainter(shown) as painter:
            painter.fillRect(shown.rect(), QColor("#ffffff"))
            painter.fillRect(shown.rect(), QBrush(_squares()))
            painter.drawImage(0, 0, image)
            painter.setPen(QColor(theme.palette().border_strong))
            painter.drawRect(shown.rect().adjusted(0, 0, -1, -1))
        shown.setDevicePixelRatio(self.devicePixelRatioF())
        self.setPixmap(shown)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.resized.emit()


def _squares() -> QPixmap:
    tile = QPixmap(2 * _SQUARE, 2 * _SQUARE)
    tile.fill(QColor("#ffffff"))
    with QPainter(tile) as painter:
        for x, y in ((0, 0), (_SQUARE, _SQUARE)):
            painter.fillRect(x, y, _SQUARE, _SQUARE, QColor("#d5d9de"))
    return tile
