"""Dialog for a link to the mesh of a segment."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QComboBox, QDialog, QDialogButtonBox, QLineEdit, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.field_events import FieldWheel
from meshmash_viewer.app.controls.make import column, form, reserved_note
from meshmash_viewer.app.dialogs.files import button_box
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.links import MeshLink, layers_of, link_file, parse_link
from meshmash_viewer.io.segments import MOST_VERTICES

_LEVELS = {
    "": f"The finest, if it has at most {MOST_VERTICES / 1e6:.0f} million vertices",
    "0": "0, the finest, of any size",
    **{str(level): str(level) for level in range(1, 10)},
}


class LinkDialog(QDialog):
    """Dialog for a link to a layer and for a segment, which stays open until the link is valid.

    Segments in a URL of Neuroglancer are listed; any other id can be typed. After acceptance,
    `path` is the file of the link, and `compares` is whether to open the mesh as the second mesh,
    which is offered if `can_compare`. `source` is the initial link.
    """

    def __init__(
        self, parent: QWidget | None = None, source: str = "", *, can_compare: bool = False
    ) -> None:
        super().__init__(parent)
        theme.named(self, "link_dialog").setWindowTitle("Open link")
        self.path, self.compares = Path(), False
        self.link_edit = theme.named(QLineEdit(source), "link_edit", "Link")
        self.link_edit.setPlaceholderText("precomputed://gs://bucket/layer")
        hint = "A layer (precomputed://…, graphene://…), or a URL of Neuroglancer."
        about = make.label("link_about_label", text=hint, wordWrap=True, role="muted")
        self.segment_combo = make.combo("link_segment_combo", "Segment", editable=True)
        self.segment_combo.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        edit = self.segment_combo.lineEdit()
        assert edit is not None
        theme.named(edit, "link_segment_edit", "Id of the segment")
        edit.setPlaceholderText("Id, such as 720575940612345678")
        self.level_combo = make.combo("link_level_combo", "Level of detail", entries=_LEVELS)
        self.fault_label = reserved_note("link_fault_label", 3)
        rows = form(
            ("Link", self.link_edit),
            ("", about),
            ("Segment", self.segment_combo),
            ("Level of detail", self.level_combo),
        )
        open_button = theme.named(QPushButton("Open"), "link_open_button", role="primary")
        buttons = button_box(self, open_button, lambda: self._accept(compares=False))
        compare_button = make.button(
            "Compare",
            "link_compare_button",
            "",
            lambda: self._accept(compares=True),
            tip="Open it next to the mesh that is open",
        )
        buttons.addButton(compare_button, QDialogButtonBox.ButtonRole.ActionRole)
        compare_button.setVisible(can_compare)
        self.setLayout(column(rows, self.fault_label, buttons, margins=(20, 16, 20, 16)))
        self.setMinimumWidth(560)
        theme.pad_fields(self)
        FieldWheel(self).watch(self)
        self.link_edit.textChanged.connect(self._offer_segments)
        self.segment_combo.editTextChanged.connect(self.fault_label.clear)
        (self.segment_combo if source else self.link_edit).setFocus()

    def _offer_segments(self) -> None:
        """List the segments in the link; if there are none, keep the typed segment."""
        self.fault_label.clear()
        typed = self.segment_combo.currentText() if not self.segment_combo.count() else ""
        self.segment_combo.clear()
        try:
            layers = layers_of(self.link_edit.text())
        except InputError:  # reported on acceptance
            layers = ()
        named = len({layer.name for layer in layers}) > 1
        for layer in layers:
            for each in layer.segments:
                text = f"{each}  ({layer.name})" if named else str(each)
                self.segment_combo.addItem(text, MeshLink(layer.source, each, layer.lod))
        if not self.segment_combo.count():
            self.segment_combo.setEditText(typed)

    def _accept(self, *, compares: bool) -> None:
        text, level = self.segment_combo.currentText().strip(), self.level_combo.currentData()
        lod = int(level) if level else None
        listed = self.segment_combo.itemData(self.segment_combo.findText(text)) if text else None
        try:
            if listed is not None:
                link = MeshLink(listed.source, listed.segment, listed.lod if lod is None else lod)
            else:
                link = parse_link(self.link_edit.text(), text, lod)
            self.path, self.compares = link_file(link), compares
        except InputError as fault:
            self.fault_label.setText(str(fault))
        else:
            self.accept()
