"""Section of the Labels panel: points near the mesh, and their appearance."""

from __future__ import annotations

import math

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, grid, note, row, show_note
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.points import LARGEST_SIZE
from meshmash_viewer.units import counted

_HINT = "Open a table of synapses or other points; Measure then counts them in each region."


class PointSection(QWidget):
    """Controls to open and remove points, and to set their colour, size and largest distance."""

    open_requested = Signal()
    remove_requested = Signal()

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "point_section", "Points")
        self._document = document
        points = document.points
        self.open_button = make.button(
            "Open points…", "points_open_button", "Open a table of points", self.open_requested,
            tip="Synapses or other points: CSV, Parquet or Feather",
        )  # fmt: skip
        self.remove_button = make.button(
            "Remove", "points_remove_button", "Remove the points", self.remove_requested,
            tip="Their file stays, and undo brings them back",
        )  # fmt: skip
        self.column_combo = make.combo(
            "points_column_combo", "Column that colours the points", self._choose_column,
            tip="Column that colours the points",
        )  # fmt: skip
        self.size_spin = make.spin(
            "points_size_spin", "Diameter of the points",
            lambda size: points.change("size of points", size=size),
            tip="Diameter on the screen", minimum=1, maximum=LARGEST_SIZE,
        )  # fmt: skip
        self.distance_field = NumberField(
            "points_distance_field",
            "Largest distance from a vertex",
            tip="Points that are farther from every vertex are neither drawn nor counted",
        )
        self.distance_field.bounds = (0.0, math.inf)
        self.distance_field.edited.connect(
            lambda length: points.change("distance of points", max_distance=length)
        )
        self.note = note("points_note")
        self._look = make.holder(
            grid(
                (make.muted("Colour"), self.column_combo),
                (make.muted("Size"), self.size_spin),
                (make.muted("Within"), self.distance_field),
            )
        )
        buttons = row(self.open_button, self.remove_button, None)
        self.setLayout(column(make.heading("Points"), buttons, self.note, self._look))
        follow((points.changed, document.mesh_changed), self.refresh)
        self.refresh()

    def _choose_column(self, row: int) -> None:
        name = self.column_combo.itemData(row)
        self._document.points.change("colour of points", column=name)

    def refresh(self) -> None:
        """Show the points of the model."""
        points, mesh = self._document.points, self._document.mesh
        shown, found = points.shown, points.projected
        self.open_button.setEnabled(mesh is not None)
        self.remove_button.setEnabled(shown is not None)
        self._look.setVisible(shown is not None)
        if shown is None or mesh is None:
            show_note(self.note, _HINT)
            return
        names = ["", *(name for name in shown.table.columns if name != shown.table.id)]
        with QSignalBlocker(self.column_combo), QSignalBlocker(self.size_spin):
            if names != [self.column_combo.itemData(at) for at in range(self.column_combo.count())]:
                self.column_combo.clear()
                for name in names:
                    self.column_combo.addItem(name or "One colour", name)
            self.column_combo.setCurrentIndex(max(self.column_combo.findData(shown.column), 0))
            self.size_spin.setValue(shown.size)
        source = f" from {shown.table.name}" if shown.table.name else ""
        text = counted(len(shown.table), "point") + source
        if found is not None:
            self.distance_field.show_value(found.max_distance, mesh.unit, with_unit=True)
            text += f", {found.n_near:,} of them near the mesh"
        show_note(self.note, f"{text}.")
