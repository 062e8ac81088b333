"""Dialog that saves the render as a scene."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QWidget

from meshmash_viewer.app.dialogs.files import FormatDialog
from meshmash_viewer.app.view.scene import missing_pages

_SCENES = {
    ".gltf": "glTF, for Blender, PowerPoint and viewers",
    ".html": "HTML page, for any browser",
}


class SceneDialog(FormatDialog):
    """Asks for the format and the file of a scene; `path` is suggested, without its ending."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__("scene", "Save scene", path, _SCENES, _missing_for, "trame", parent)
        self.lay_out()


def _missing_for(ending: str) -> str:
    return missing_pages() if ending == ".html" else ""
