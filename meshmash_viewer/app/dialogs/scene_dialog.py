"""Saving the mesh with its field as a scene: format and place."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import grid
from meshmash_viewer.app.dialogs.saving import FormatDialog
from meshmash_viewer.app.view.scene import missing_pages

__all__ = ["SceneDialog"]

_NAMES = {
    ".gltf": "glTF, for Blender, PowerPoint and viewers",
    ".html": "HTML page, for any browser",
}


class SceneDialog(FormatDialog):
    """Asks in which format, and where.

    Parameters
    ----------
    path : Path
        Suggested file, without its ending.
    """

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__("scene", "Save scene", path, _NAMES, _missing, "trame", parent)
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
        self._refresh_remark()


def _missing(ending: str) -> str:
    return missing_pages() if ending == ".html" else ""
