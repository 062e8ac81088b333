"""What the dialogs that end with a file have in common."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QDialog, QDialogButtonBox, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import Part, column

__all__ = ["SaveDialog"]


class SaveDialog(QDialog):
    """Asks for a file among other things; it stays open while that cannot be written.

    Subclasses make `accept_button`, and put all they ask for in `_arrange`.

    Parameters
    ----------
    kind : str
        What is written, as `check_output` takes it; its widgets are called after it.
    title : str
    file_row : FileRow
    """

    accept_button: QPushButton

    def __init__(self, kind: str, title: str, file_row: FileRow, parent: QWidget | None) -> None:
        super().__init__(parent)
        theme.named(self, f"{kind}_dialog").setWindowTitle(title)
        self.file_row = file_row
        self.remark_label = reserved_note(f"{kind}_remark_label", 2)
        self._output = kind

    @property
    def path(self) -> Path:
        """Where to write."""
        return self.file_row.path

    def _arrange(self, *parts: Part, spacing: int = theme.MARGIN) -> None:
        """Put parts over the two buttons."""
        self.accept_button.setDefault(True)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.addButton(self.accept_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        self.setLayout(column(*parts, buttons, spacing=spacing, margins=(20, 16, 20, 16)))
        self.file_row.changed.connect(self._refresh_remark)
        theme.pad_fields(self)

    def _refresh_remark(self) -> None:
        self.accept_button.setEnabled(self.file_row.named)
        self.remark_label.setText(self.file_row.remark)

    def _accept(self) -> None:
        fault = self.file_row.fault(self._output)
        if fault:
            self.remark_label.setText(fault)
        else:
            self.accept()
