"""A path with a button to choose it."""

from __future__ import annotations

import os
from pathlib import Path

from PySide6.QtCore import QMimeDatabase, Signal
from PySide6.QtWidgets import QFileDialog, QLineEdit, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.write import check_output
from meshmash_viewer.model.failure import failure_of


class FileRow(QWidget):
    """Where a file with an `ending` is written; `pattern` is one of Qt: "PNG picture (*.png)"."""

    changed = Signal()

    def __init__(self, path: Path, pattern: str, ending: str) -> None:
        super().__init__()
        self._pattern = pattern
        self._ending = ending
        self.edit = theme.named(QLineEdit(str(path)), "file_edit", "File")
        self.edit.setMinimumWidth(260)
        self.edit.textChanged.connect(self.changed)
        browse = QPushButton("Browse…", autoDefault=False)
        self.browse_button = theme.named(browse, "browse_button", "Choose the file")
        self.browse_button.clicked.connect(self._browse)
        self.setLayout(row((self.edit,), self.browse_button))

    @property
    def named(self) -> bool:
        """Whether there is a name to write to: a folder alone, or nothing, is none."""
        text = self.edit.text().strip()
        return bool(Path(text).name) and not text.endswith(("/", os.sep))

    @property
    def path(self) -> Path:
        """The file, with an ending; what was typed, where it names no file."""
        # unlike Path.expanduser it takes "~r" on the way to "~root" as it is
        path = Path(os.path.expanduser(self.edit.text().strip()))
        # "bun.jpg" means what it says, though it cannot be had; "t=0.5" has no ending yet
        ended = path.name.lower().endswith(self._ending)
        if self.named and not ended and not QMimeDatabase().suffixForFileName(path.name):
            path = path.parent / (path.name + self._ending)
        return path

    @property
    def remark(self) -> str:
        """What writing there would replace; empty if nothing."""
        there = os.path.isfile(self.path)  # unlike Path.is_file of a name that is too long, too
        return f"{self.path.name} exists and will be replaced." if there else ""

    def fault(self, kind: str) -> str:
        """Why nothing of a kind (`check_output`) can be written there; empty if it can."""
        try:
            check_output(self.path, kind)
        except (InputError, OSError) as fault:
            return failure_of(fault).text
        return ""

    def set_ending(self, ending: str, pattern: str) -> None:
        """Change the ending of the file."""
        path, before, typed = self.path, self._ending, self.edit.text().strip().lower()
        self._ending, self._pattern = ending, pattern
        if self.named and not typed.endswith(ending):
            stem = path.name.removesuffix(before)
            self.edit.setText(str(path.parent / (stem + ending)))

    def _browse(self) -> None:
        here, quietly = str(self.path), QFileDialog.Option.DontConfirmOverwrite
        chosen, _ = QFileDialog.getSaveFileName(
            self, "Save as", here, self._pattern, options=quietly
        )
        if chosen:
            self.edit.setText(chosen)
