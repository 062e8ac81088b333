"""Saving the mesh with its field as a scene: format and place."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QComboBox, QLabel, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import grid
from meshmash_viewer.app.dialogs.saving import SaveDialog
from meshmash_viewer.app.view.scene import missing_pages
from meshmash_viewer.io.write import SCENE_ENDINGS

__all__ = ["SceneDialog"]

_NAMES = {
    ".gltf": "glTF, for Blender, PowerPoint and viewers",
    ".html": "HTML page, for any browser",
}


class SceneDialog(SaveDialog):
    """Asks in which format, and where.

    Parameters
    ----------
    path : Path
        Suggested file.
    """

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        ending = SCENE_ENDINGS[0]
        super().__init__("scene", "Save scene", FileRow(path, _pattern(ending), ending), parent)
        self.format_combo = theme.named(QComboBox(), "scene_format_combo", "Format")
        model = self.format_combo.model()
        assert isinstance(model, QStandardItemModel)
        self._missing = missing_pages()
        for at, each in enumerate(SCENE_ENDINGS):
            missing = self._missing if each == ".html" else ""
            text = f"{_NAMES[each]}{' – needs trame' if missing else ''}"
            self.format_combo.addItem(text, each)
            self.format_combo.setItemData(at, missing, Qt.ItemDataRole.ToolTipRole)
            model.item(at).setEnabled(not missing)
        self.accept_button = theme.named(QPushButton("Save"), "scene_save_button", role="primary")
        self._arrange(
            grid(
                (QLabel("Format"), self.format_combo),
                (QLabel("File"), self.file_row),
                (None, self.remark_label),
                spacing=(theme.MARGIN, theme.GAP),
            )
        )
        self.setMinimumWidth(520)
        self.format_combo.currentIndexChanged.connect(self._change_format)
        self.file_row.edit.textChanged.connect(self._follow_name)
        self._refresh_remark()

    def _change_format(self) -> None:
        ending = self.format_combo.currentData()
        self.file_row.set_ending(ending, _pattern(ending))
        self._refresh_remark()

    def _follow_name(self) -> None:
        """Take the format whose ending was typed."""
        at = self.format_combo.findData(Path(self.file_row.edit.text().strip()).suffix.lower())
        if at >= 0:
            self.format_combo.setCurrentIndex(at)

    def _refresh_remark(self) -> None:
        super()._refresh_remark()
        page = self.path.suffix.lower() == ".html"
        if self._missing and (page or not self.remark_label.text()):
            self.remark_label.setText(self._missing)
        self.accept_button.setEnabled(self.file_row.named and not (page and self._missing))


def _pattern(ending: str) -> str:
    return f"{_NAMES[ending].partition(',')[0]} (*{ending})"
