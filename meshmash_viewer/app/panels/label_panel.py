"""The Labels panel: label sets, labels of the current set, classes, regions and points."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QPoint, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QColorDialog, QMenu, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import PANEL, column, note, row, show_note, show_quietly
from meshmash_viewer.app.dialogs.files import ask_for_maps, ask_to_save, save_labels
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.app.opening import ask
from meshmash_viewer.app.panels.class_section import ClassSection
from meshmash_viewer.app.panels.label_table import LabelTable, given_to_label
from meshmash_viewer.app.panels.point_section import PointSection
from meshmash_viewer.app.panels.region_table import RegionTable
from meshmash_viewer.io.links import folder_of
from meshmash_viewer.io.write_labels import write_regions
from meshmash_viewer.io.writers import SPECTRUM_WRITERS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pins import PIN_COLORS
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView


class LabelPanel(QWidget):
    """Controls of the label sets; keys 1 to 9 assign the selected vertices to a label."""

    #: Path of a file, a function that writes the file, and a noun for its content.
    write_requested = Signal(object, object, str)

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "label_panel", "Labels")
        #: The render; None until it is loaded.
        self.scene: MeshView | None = None
        #: The displayed field, whose means are measured in regions.
        self.field: Field | None = None
        self._document = document
        self._build()
        changes = (
            document.labels.changed, document.spectrum_changed, document.mesh_changed,
            document.selection.changed, document.hiding.changed,
            document.display.events.label_borders,
        )  # fmt: skip
        follow(changes, self.refresh)
        events = document.display.events
        follow((events.kind, events.fields), self._refresh_hint)
        self.refresh()

    def _build(self) -> None:
        labels = self._document.labels
        self.table = table = LabelTable(self._document)
        self._buttons = {
            name: make.button(text, f"{name}_button", spoken, act, role=role, tip=tip)
            for name, text, spoken, act, role, tip in (
                ("label_new_set", "New set", "New label set", labels.new_set, "segment", ""),
                ("label_open", "Open…", "Add label sets from files", self._open, "segment",
                 "GIFTI and FreeSurfer labels, tables, NPZ and others"),
                ("label_save", "Save…", "Save the label set in a file", self._save, "segment", ""),
                ("label_remove_set", "Remove", "Remove the label set from the mesh",
                 labels.remove_set, "segment", "Its file stays, and undo brings the set back"),
                ("label_new", "New label", "New label in the set", labels.new_label, "", ""),
                ("label_join", "Join", "Join the chosen labels", lambda: labels.join(table.chosen),
                 "", "The first of the chosen labels gets the vertices of the others"),
                ("label_delete", "Delete", "Delete the chosen labels",
                 lambda: labels.delete(table.chosen), "", "Their vertices will have no label"),
                ("label_assign", "Assign", "Assign the selection to the chosen label",
                 lambda: labels.assign(table.chosen[0]), "",
                 "The selected vertices get the chosen label; so do keys 1 to 9"),
                ("label_clear", "Clear", "Remove the labels of the selected vertices",
                 lambda: labels.assign(None), "", ""),
                ("label_select", "Select", "Select the vertices of the chosen labels",
                 lambda: labels.select(table.chosen), "", ""),
                ("region_measure", "Measure", "Measure the regions of the labels", self._measure,
                 "", "Area, volume, extent and neck of each connected part, and the displayed"
                 " field"),
                ("region_export", "Export…", "Export the table of regions", self._export, "", ""),
            )
        }  # fmt: skip
        table.color_requested.connect(self._ask_for_color)
        table.menu_requested.connect(self._show_menu)
        table.selectionModel().selectionChanged.connect(lambda: later(self._refresh_buttons))
        self.combo = make.combo(
            "label_set_combo", "Label set", lambda row: labels.choose(self.combo.itemText(row))
        )
        self.borders_check = make.check(
            "Borders over every field", "label_borders_check", "Draw the borders between labels",
            lambda on: setattr(self._document.display, "label_borders", on),
        )  # fmt: skip
        self.classes = ClassSection(self._document)
        self.hint = note("label_hint")
        self.whole_check = make.check(
            "Whole labels", "region_whole_check", "Measure whole labels, not their connected parts",
            tip="One row for each label, without neck, which only connected parts have",
        )  # fmt: skip
        self.regions = RegionTable()
        self.regions.region_clicked.connect(self._fly_to)
        self.regions.region_activated.connect(self._document.hiding.isolate)
        self.region_hint = note("region_hint")
        new_set, *files, new, join, delete, assign, clear, select, measure, export = (
            self._buttons.values()
        )
        self._of_set = make.holder(
            column(
                self.table,
                row(new, join, delete, None),
                row(assign, clear, select, None),
                self.borders_check,
                make.line(),
                self.classes,
                make.line(),
                make.heading("Regions"),
                row(self.whole_check, None),
                row(measure, export, None),
                self.region_hint,
                self.regions,
            )
        )
        self.points = PointSection(self._document)
        self.combo.setPlaceholderText("No label set")
        rows = row((self.combo,), new_set), row(*files, None)
        parts = *rows, self.hint, self._of_set, make.line(), self.points, None
        area = make.scroll(make.holder(column(*parts, margins=PANEL)))
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setLayout(column(area))

    # -- from the user ------------------------------------------------------------------------

    def _open(self) -> None:
        paths = ask_for_maps(self, folder_of(self._document.path), "labels")
        self._document.maps.open(paths, labels=True)

    def _save(self) -> None:
        save_labels(self, self._document, self.write_requested.emit, self.table.chosen)

    def _measure(self) -> None:
        field = self.field
        maps = () if field is None or field.labels or field.draft else (field.as_map(),)
        self._document.labels.measure_regions(maps, whole=self.whole_check.isChecked())

    def _export(self) -> None:
        table = self._document.labels.regions
        if table is not None:
            options = "regions", "regions.csv", "Tables", SPECTRUM_WRITERS
            path = ask_to_save(self, self._document, *options)
            if path is not None:
                self.write_requested.emit(path, partial(write_regions, path, table), "Regions")

    def _fly_to(self, region: Mask) -> None:
        """Move the camera to a region."""
        if self.scene is not None:
            self.scene.look_at(np.flatnonzero(region))

    def _ask_for_color(self, key: int) -> None:
        label = next(each for each in self.table.labels if each.key == key)
        dialog = theme.named(QColorDialog(QColor(label.color), self), "label_color_dialog")
        dialog.setWindowTitle(f"Colour of {label.name}")
        for at, color in enumerate(PIN_COLORS):
            dialog.setCustomColor(at, QColor(color))
        recolor = self._document.labels.recolor
        ask(dialog, lambda: recolor(key, dialog.selectedColor().name()))

    def _show_menu(self, place: QPoint) -> None:
        labels, chosen = self._document.labels, self.table.chosen
        shown = [each for each in self.table.labels if each.key in chosen]
        if not shown:
            return
        first, locked = shown[0], all(each.locked for each in shown)
        row, lock = self.table.labels.index(first), "Unlock" if locked else "Lock"
        menu = theme.named(QMenu(self), "label_menu", "Menu of the chosen labels")
        for name, text, act, alone in (
            ("assign", "Assign the selection", lambda: labels.assign(first.key), True),
            ("select", "Select its vertices", lambda: labels.select(chosen), False),
            ("isolate", "Isolate", lambda: labels.isolate(chosen), False),
            ("rename", "Rename", lambda: self.table.edit_name(row), True),
            ("recolor", "Colour…", lambda: self._ask_for_color(first.key), True),
            ("lock", lock, lambda: [labels.lock(each.key, not locked) for each in shown], False),
            ("join", "Join", lambda: labels.join(chosen), False),
            ("delete", "Delete", lambda: labels.delete(chosen), False),
        ):
            if (alone and len(shown) > 1) or (name == "join" and len(shown) < 2):
                continue
            menu.addAction(text, act).setObjectName(f"label_menu_{name}")
        menu.aboutToHide.connect(menu.deleteLater)
        menu.popup(place)

    def event(self, event: QEvent) -> bool:
        """Handle digit keys while a control of the panel has the focus."""
        return given_to_label(event, self._document.labels) or super().event(event)

    # -- from the model -----------------------------------------------------------------------

    def refresh(self) -> None:
        """Show the state of the model."""
        labels, mesh = self._document.labels, self._document.mesh
        known, names = labels.current, [each.name for each in labels.sets]
        with QSignalBlocker(self.combo):
            if names != [self.combo.itemText(at) for at in range(self.combo.count())]:
                self.combo.clear()
                self.combo.addItems(names)
            self.combo.setCurrentIndex(-1 if known is None else names.index(known.name))
        self.combo.setEnabled(known is not None)
        self._of_set.setVisible(known is not None)
        self._enable(mesh is not None, "label_new_set", "label_open")
        self._enable(known is not None, "label_save", "label_remove_set")
        self.table.show_labels(known)
        show_quietly(self.borders_check, self._document.display.label_borders)
        self._refresh_regions(known)
        self._refresh_hint()
        self._refresh_buttons()

    def _refresh_regions(self, known: VertexMap | None) -> None:
        labels, there = self._document.labels, self._document.labels.regions is not None
        measured = labels.regions_of.labels if labels.regions_of is not None else ()
        self.regions.show_regions(labels.regions, measured)
        self.regions.setVisible(there)
        self._enable(there, "region_export")
        text = ""
        if not there:
            text = "Press Measure for a table of the connected parts of each label."
        elif known is not labels.regions_of:
            text = "The table is of other labels than the current ones: press Measure."
        show_note(self.region_hint, text)
        theme.change_role(self.region_hint, "warning" if there else "muted")

    def _refresh_hint(self) -> None:
        labels, mask = self._document.labels, self._document.selection.mask
        # the last two texts have equally many lines, so that the controls below do not move
        if self._document.mesh is None:
            text = "Open a mesh to label its parts."
        elif labels.current is None:
            text = (
                "Press New set, select vertices on the mesh, and assign them to a label with its"
                " key; or open a file with labels."
            )
        elif mask is None:
            text = "Select vertices, then press the key of a label."
        else:
            count = counted(int(np.count_nonzero(mask)), "vertex")
            text = f"{count} selected: press a label's key."
        if labels.current is not None and not labels.current_is_displayed:
            text += " The render shows another field, not this set."
        show_note(self.hint, text)

    def _refresh_buttons(self) -> None:
        n_chosen, selected = len(self.table.chosen), self._document.selection.mask is not None
        self._enable(n_chosen > 1, "label_join")
        self._enable(n_chosen > 0, "label_delete", "label_select")
        self._enable(n_chosen == 1 and selected, "label_assign")
        self._enable(selected, "label_clear")

    def _enable(self, on: bool, *names: str) -> None:
        for name in names:
            self._buttons[name].setEnabled(on)
