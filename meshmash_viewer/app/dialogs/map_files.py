"""Asking for files of maps."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QWidget

from meshmash_viewer.io.maps import MAP_ENDINGS
from meshmash_viewer.io.read import READERS

__all__ = ["ask_for_maps"]


def ask_for_maps(parent: QWidget, folder: Path) -> list[Path]:
    """Let the person choose files with values per vertex; none where the dialog is left."""
    patterns = " ".join(
        [*(f"*{ending}" for ending in MAP_ENDINGS), "*.npz", "*.gii", "lh.*", "rh.*"]
    )
    meshes = " ".join(f"*{ending}" for ending in READERS)
    chosen, _ = QFileDialog.getOpenFileNames(
        parent,
        "Add maps",
        str(folder),
        f"Values per vertex ({patterns});;Meshes with such values ({meshes});;All files (*)",
    )
    return [Path(name) for name in chosen]
