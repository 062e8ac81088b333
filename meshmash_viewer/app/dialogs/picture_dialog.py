"""Dialogs that save the render, as a picture or as a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import show_quietly
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.controls.spin import WholeField
from meshmash_viewer.app.dialogs.files import FormatDialog, SaveDialog
from meshmash_viewer.app.view.scene import missing_pages

_LARGEST = 16_384
_PRESETS = (
    ("Presentation, 1920 × 1080", (1920, 1080)),
    ("4K, 3840 × 2160", (3840, 2160)),
    ("Column of a paper, 85 mm at 600 dpi", (2008, 1506)),
    ("Page of a paper, 180 mm at 600 dpi", (4252, 3189)),
)
_SCENES = {
    ".gltf": "glTF, for Blender, PowerPoint and viewers",
    ".html": "HTML page, for any browser",
}


@dataclass(frozen=True)
class PictureChoice:
    """Choices of the dialog: file, width and height in pixels, row of the list of sizes."""

    path: Path
    size: tuple[int, int]
    preset: int
    transparent: bool


class PictureDialog(SaveDialog):
    """Asks for the size, the background and the file of a picture.

    `screen` is the size of the render in pixels, `path` the suggested file; the other choices of
    `before` are suggested again.
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
        self.preset_combo = make.combo("picture_preset_combo", "Size of the picture")
        self.preset_combo.addItems([*texts, "Custom"])
        self.width_spin = self._spin("picture_width_spin", "Width", screen[0])
        self.height_spin = self._spin("picture_height_spin", "Height", screen[1])
        self.transparent_check = make.check(
            "Transparent background", "picture_transparent_check", ""
        )
        self.preset_combo.currentIndexChanged.connect(self._take_preset)
        size_row = row(self.width_spin, QLabel("×"), self.height_spin, None)
        self._arrange_rows(
            ("Size", self.preset_combo), ("", size_row), ("", self.transparent_check)
        )
        if before is not None:
            self.preset_combo.setCurrentIndex(before.preset)
            if before.preset >= len(self._sizes):
                self._show_size(before.size)
            self.transparent_check.setChecked(before.transparent)
        self._refresh_remark()

    @property
    def choice(self) -> PictureChoice:
        """The current choices."""
        size, preset = (self.width_spin.value(), self.height_spin.value()), self.preset_combo
        transparent = self.transparent_check.isChecked()
        return PictureChoice(self.path, size, preset.currentIndex(), transparent)

    def _spin(self, name: str, text: str, value: int) -> WholeField:
        return make.spin(
            name, f"{text} in pixels", self._note_custom, minimum=16, maximum=_LARGEST,
            suffix=" px", value=value, keyboardTracking=True,
        )  # fmt: skip

    def _take_preset(self, at: int) -> None:
        if at < len(self._sizes):
            self._show_size(self._sizes[at])

    def _show_size(self, size: tuple[int, int]) -> None:
        for spin, length in zip((self.width_spin, self.height_spin), size, strict=True):
            show_quietly(spin, length)

    def _note_custom(self) -> None:
        self.preset_combo.setCurrentIndex(self.preset_combo.count() - 1)


class SceneDialog(FormatDialog):
    """Asks for the format and the file of a scene; `path` is suggested, without its ending."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__("scene", "Save scene", path, _SCENES, _missing_for, "trame", parent)
        self._arrange_rows(("Format", self.format_combo))
        self.setMinimumWidth(520)
        self._refresh_remark()


def _missing_for(ending: str) -> str:
    return missing_pages() if ending == ".html" else ""
