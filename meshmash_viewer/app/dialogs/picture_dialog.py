"""Saving the render as a picture: size, background, place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtWidgets import QCheckBox, QComboBox, QLabel, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import show_quietly
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.app.controls.spin import WholeField
from meshmash_viewer.app.dialogs.saving import SaveDialog

__all__ = ["PictureChoice", "PictureDialog"]

_LARGEST = 16_384
_PRESETS = (
    ("Presentation, 1920 × 1080", (1920, 1080)),
    ("4K, 3840 × 2160", (3840, 2160)),
    ("Column of a paper, 85 mm at 600 dpi", (2008, 1506)),
    ("Page of a paper, 180 mm at 600 dpi", (4252, 3189)),
)


@dataclass(frozen=True)
class PictureChoice:
    """What was asked for: width and height in pixels, and the row of the list that says so."""

    path: Path
    size: tuple[int, int]
    preset: int
    transparent: bool


class PictureDialog(SaveDialog):
    """Asks how large, on what background, and where.

    Parameters
    ----------
    screen : (int, int)
        Width and height of the render in pixels.
    path : Path
        Suggested file.
    before : PictureChoice, optional
        What was chosen the last time; the path aside, it is suggested again.
    """

    def __init__(
        self,
        screen: tuple[int, int],
        path: Path,
        parent: QWidget | None = None,
        before: PictureChoice | None = None,
    ) -> None:
        file_row = FileRow(path, "PNG picture (*.png)", ".png")
        super().__init__("picture", "Save picture", file_row, parent)
        self.setMinimumWidth(460)
        self._sizes = [screen, (2 * screen[0], 2 * screen[1]), *(size for _, size in _PRESETS)]
        texts = [f"As on screen, {screen[0]} × {screen[1]}", "Twice the screen"]
        texts += [text for text, _ in _PRESETS]
        self.preset_combo = theme.named(QComboBox(), "picture_preset_combo", "Size of the picture")
        self.preset_combo.addItems([*texts, "Custom"])
        self.width_spin = self._spin("picture_width_spin", "Width", screen[0])
        self.height_spin = self._spin("picture_height_spin", "Height", screen[1])
        self.transparent_check = theme.named(
            QCheckBox("Transparent background"), "picture_transparent_check"
        )
        self.preset_combo.currentIndexChanged.connect(self._take_preset)
        self.accept_button = theme.named(QPushButton("Save"), "picture_save_button", role="primary")
        size_row = row(self.width_spin, QLabel("×"), self.height_spin, None)
        self._arrange(
            grid(
                (QLabel("Size"), self.preset_combo),
                (None, size_row),
                (None, self.transparent_check),
                (QLabel("File"), file_row),
                (None, self.remark_label),
                spacing=(theme.MARGIN, theme.GAP),
            )
        )
        if before is not None:
            self.preset_combo.setCurrentIndex(before.preset)
            if before.preset >= len(self._sizes):
                self._show_size(before.size)
            self.transparent_check.setChecked(before.transparent)
        self._refresh_remark()

    @property
    def choice(self) -> PictureChoice:
        """All of it, to be suggested the next time."""
        size, preset = (self.width_spin.value(), self.height_spin.value()), self.preset_combo
        transparent = self.transparent_check.isChecked()
        return PictureChoice(self.path, size, preset.currentIndex(), transparent)

    def _spin(self, name: str, text: str, value: int) -> WholeField:
        spin = WholeField(minimum=16, maximum=_LARGEST, suffix=" px", value=value)
        spin.valueChanged.connect(self._note_custom)
        return theme.named(spin, name, f"{text} in pixels")

    def _take_preset(self, at: int) -> None:
        if at < len(self._sizes):
            self._show_size(self._sizes[at])

    def _show_size(self, size: tuple[int, int]) -> None:
        for spin, length in zip((self.width_spin, self.height_spin), size, strict=True):
            show_quietly(spin, length)

    def _note_custom(self) -> None:
        self.preset_combo.setCurrentIndex(self.preset_combo.count() - 1)
