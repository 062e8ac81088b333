"""Saving the render as a picture: size, background, place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.file_row import FileRow

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


class PictureDialog(QDialog):
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
        super().__init__(parent)
        self.setObjectName("picture_dialog")
        self.setWindowTitle("Save picture")
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
        self.file_row = FileRow(path, "PNG picture (*.png)", ".png")
        self.remark_label = reserved_note("picture_remark_label", 2)
        self.preset_combo.currentIndexChanged.connect(self._take_preset)
        for spin in (self.width_spin, self.height_spin):
            spin.valueChanged.connect(self._note_custom)

        size_row = QHBoxLayout()
        size_row.setSpacing(theme.GAP)
        size_row.addWidget(self.width_spin)
        size_row.addWidget(QLabel("×"))
        size_row.addWidget(self.height_spin)
        size_row.addStretch(1)
        grid = QGridLayout()
        grid.setHorizontalSpacing(theme.MARGIN)
        grid.setVerticalSpacing(theme.GAP)
        grid.setColumnStretch(1, 1)
        grid.addWidget(QLabel("Size"), 0, 0)
        grid.addWidget(self.preset_combo, 0, 1)
        grid.addLayout(size_row, 1, 1)
        grid.addWidget(self.transparent_check, 2, 1)
        grid.addWidget(QLabel("File"), 3, 0)
        grid.addWidget(self.file_row, 3, 1)
        grid.addWidget(self.remark_label, 4, 1)
        buttons = QDialogButtonBox()
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.save_button = theme.named(QPushButton("Save"), "picture_save_button", role="primary")
        self.save_button.setDefault(True)
        self.file_row.changed.connect(self._refresh_file)
        buttons.addButton(self.save_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        column = QVBoxLayout(self)
        column.setContentsMargins(20, 16, 20, 16)
        column.setSpacing(theme.MARGIN)
        column.addLayout(grid)
        column.addWidget(buttons)
        theme.pad_fields(self)
        if before is not None:
            self._take_up(before)
        self._refresh_file()

    @property
    def choice(self) -> PictureChoice:
        """All of it, to be suggested the next time."""
        preset = self.preset_combo.currentIndex()
        return PictureChoice(self.path, self.size_, preset, self.transparent)

    @property
    def path(self) -> Path:
        """Where to save."""
        return self.file_row.path

    @property
    def size_(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width_spin.value(), self.height_spin.value()

    @property
    def transparent(self) -> bool:
        """Whether the background is left out."""
        return self.transparent_check.isChecked()

    def _spin(self, name: str, text: str, value: int) -> QSpinBox:
        spin = theme.named(QSpinBox(), name, f"{text} in pixels")
        spin.setRange(16, _LARGEST)
        spin.setSuffix(" px")
        spin.setValue(value)
        return spin

    def _take_up(self, before: PictureChoice) -> None:
        self.preset_combo.setCurrentIndex(before.preset)
        if before.preset >= len(self._sizes):
            self.width_spin.setValue(before.size[0])
            self.height_spin.setValue(before.size[1])
        self.transparent_check.setChecked(before.transparent)

    def _refresh_file(self) -> None:
        self.save_button.setEnabled(self.file_row.named)
        self.remark_label.setText(self.file_row.remark)

    def _accept(self) -> None:
        fault = self.file_row.fault("picture")
        if fault:
            self.remark_label.setText(fault)
        else:
            self.accept()

    def _take_preset(self, at: int) -> None:
        if at < len(self._sizes):
            for spin, length in zip(
                (self.width_spin, self.height_spin), self._sizes[at], strict=True
            ):
                with QSignalBlocker(spin):
                    spin.setValue(length)

    def _note_custom(self) -> None:
        self.preset_combo.setCurrentIndex(self.preset_combo.count() - 1)
