"""Dialog that pins a vertex by its index."""

from __future__ import annotations

from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLabel, QLineEdit, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.quantities import parse_whole


class PinDialog(QDialog):
    """Asks for an index in the file of a mesh; it stays open until a valid one is typed.

    `vertex` is the index in the mesh, once the dialog is accepted.
    """

    def __init__(self, mesh: Mesh, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        theme.named(self, "pin_dialog").setWindowTitle("Pin vertex")
        self.vertex = -1
        self._mesh = mesh
        label = QLabel(f"Index of the vertex, 0 to {mesh.n_file_vertices - 1:,}")
        self.edit = theme.named(QLineEdit(), "pin_index_edit", "Index of the vertex")
        label.setBuddy(self.edit)
        self.fault = reserved_note("pin_fault_label", 2)
        self.pin_button = theme.named(QPushButton("Pin"), "pin_button", role="primary")
        self.pin_button.setDefault(True)
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Cancel)
        buttons.addButton(self.pin_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        self.setLayout(column(label, self.edit, self.fault, buttons, margins=(20, 16, 20, 16)))
        self.setMinimumWidth(360)
        self.edit.textEdited.connect(self.fault.clear)

    def _accept(self) -> None:
        try:
            last = self._mesh.n_file_vertices - 1
            index = parse_whole(self.edit.text(), 0, last, "The index")
            self.vertex = self._mesh.vertex_of(index)
        except InputError as fault:
            self.fault.setText(str(fault))
            self.edit.setFocus()
            self.edit.selectAll()
        else:
            self.accept()
