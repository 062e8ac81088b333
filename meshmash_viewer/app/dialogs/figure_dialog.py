"""Dialog that saves a figure for a paper."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import show_quietly
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.dialogs.files import FormatDialog
from meshmash_viewer.app.view.figure import FigureOptions

_FORMATS = {
    ".pdf": "PDF, with text and bars as vectors",
    ".svg": "SVG, with text and bars as vectors",
    ".png": "PNG picture, with its size on paper",
}
#: Widths of columns in journals, in mm.
_WIDTHS = {85: "One column, 85 mm", 114: "One and a half, 114 mm", 174: "Two columns, 174 mm"}
_CUSTOM = "Custom"
_RESOLUTIONS = {300: "300 dpi", 600: "600 dpi", 1200: "1200 dpi"}
_BACKGROUNDS = {"white": "White", "transparent": "Transparent", "window": "As in the window"}
_PARTS = {
    "title": "Title", "color_bar": "Colour bar", "scale_bar": "Scale bar", "axes": "Axes",
    "pins": "Pins",
}  # fmt: skip


class FigureDialog(FormatDialog):
    """Asks for size, contents and file of a figure; `path` is suggested, without its ending."""

    def __init__(
        self, path: Path, parent: QWidget | None = None, before: FigureOptions | None = None
    ) -> None:
        super().__init__("figure", "Save figure", path, _FORMATS, lambda _: "", "nothing", parent)
        before = before or FigureOptions()
        widths = {str(width): text for width, text in _WIDTHS.items()} | {"": _CUSTOM}
        self.width_combo = make.combo(
            "figure_width_combo", "Width of the figure", self._take_width, widths
        )
        self.width_spin = make.spin(
            "figure_width_spin", "Width in mm", self._show_width, minimum=10, maximum=2000,
            suffix=" mm", value=round(before.width_mm),
        )  # fmt: skip
        resolutions = {str(dpi): text for dpi, text in _RESOLUTIONS.items()}
        self.dpi_combo = make.combo(
            "figure_dpi_combo", "Resolution of the figure", None, resolutions
        )
        self.dpi_combo.setCurrentIndex(max(self.dpi_combo.findData(str(before.dpi)), 0))
        self.font_spin = make.spin(
            "figure_font_spin", "Size of the text in points", minimum=3, maximum=72, suffix=" pt",
            value=round(before.font_points),
        )  # fmt: skip
        self.background_combo = make.combo(
            "figure_background_combo", "Background of the figure", None, _BACKGROUNDS
        )
        self.background_combo.setCurrentIndex(self.background_combo.findData(before.background))
        self.checks = {
            name: make.check(text, f"figure_{name}_check", text) for name, text in _PARTS.items()
        }
        for name, check in self.checks.items():
            check.setChecked(getattr(before, name))
        self._arrange_rows(
            ("Width", row(self.width_combo, self.width_spin, None)),
            ("Resolution", row(self.dpi_combo, QLabel("Text"), self.font_spin, None)),
            ("Background", row(self.background_combo, None)),
            ("Show", row(*self.checks.values(), None)),
            ("Format", self.format_combo),
        )
        self.setMinimumWidth(560)
        self._show_width()
        self._refresh_remark()

    @property
    def options(self) -> FigureOptions:
        """The current choices."""
        return FigureOptions(
            width_mm=float(self.width_spin.value()),
            dpi=int(self.dpi_combo.currentData()),
            font_points=float(self.font_spin.value()),
            background=self.background_combo.currentData(),
            **{name: check.isChecked() for name, check in self.checks.items()},
        )

    def _take_width(self, width: str) -> None:
        if width:
            show_quietly(self.width_spin, int(width))
        else:
            self.width_spin.setFocus()

    def _show_width(self) -> None:
        """Choose the entry of the width."""
        row = self.width_combo.findData(str(self.width_spin.value()))
        self.width_combo.setCurrentIndex(row if row >= 0 else self.width_combo.findData(""))
