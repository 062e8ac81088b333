"""A path with a button to choose it."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLineEdit, QPushButton, QWidget

from meshmash_viewer.app import theme

__all__ = ["FileRow"]


class FileRow(QWidget):
    """Where something will be written.

    Parameters
    ----------
    path : Path
        Suggested file.
    pattern : str
        Of the file dialog: "PNG picture (*.png)".
    ending : str
        That the file will have.
    """

    changed = Signal()

    def __init__(
        self, path: Path, pattern: str, ending: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._pattern = pattern
        self._ending = ending
        self.edit = QLineEdit(str(path), objectName="file_edit")
        self.edit.setAccessibleName("File")
        self.edit.setMinimumWidth(260)
        self.edit.textChanged.connect(self.changed)
        self.browse_button = QPushButton("Browse…", objectName="browse_button")
        self.browse_button.setAccessibleName("Choose the file")
        self.browse_button.setAutoDefault(False)
        self.browse_button.clicked.connect(self._browse)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(theme.GAP)
        row.addWidget(self.edit, 1)
        row.addWidget(self.browse_button)

    @property
    def path(self) -> Path:
        """The file, with its ending."""
        text = self.edit.text().strip()
        path = Path(text).expanduser()
        if text and not path.name.lower().endswith(self._ending):
            path = path.with_name(path.name + self._ending)
        return path

    def set_ending(self, ending: str, pattern: str) -> None:
        """Change the ending of the file."""
        path = self.path
        stem = path.name.removesuffix(self._ending)
        self._ending, self._pattern = ending, pattern
        self.edit.setText(str(path.with_name(stem + ending)))

    def _browse(self) -> None:
        chosen, _ = QFileDialog.getSaveFileName(
            self,
            "Save as",
            str(self.path),
            self._pattern,
            options=QFileDialog.Option.DontConfirmOverwrite,
        )
        if chosen:
            self.edit.setText(chosen)
