"""Dialogs for a vertex to pin, and for the columns of an exported table of pins."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PySide6.QtWidgets import (
    QCheckBox,
    QDialog,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, holder, reserved_note
from meshmash_viewer.app.dialogs.files import (
    FileRow,
    SaveDialog,
    button_box,
    configured,
    suggested_path,
)
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.family import Family
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import PinExport
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.quantities import parse_number, parse_whole
from meshmash_viewer.units import NO_VOXEL, counted, format_position, format_quantity

_NUMBER = r"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"
_BETWEEN = r"(?:\s*[,;]\s*|\s+)"
#: Three numbers, optionally in brackets, with names of axes and a unit, as from Neuroglancer.
_POSITION = re.compile(
    rf"[\[(]?\s*(?:x\s*)?{_NUMBER}{_BETWEEN}(?:y\s*)?{_NUMBER}{_BETWEEN}(?:z\s*)?{_NUMBER}"
    r"\s*[\])]?\s*([^\W\d_]*)"
)
#: One number with separators, "1,234,567" or "1 234 567", not a position.
_GROUPED = re.compile(r"\d{1,3}(?:[, ]\d{3}){2}(?:\.\d*)?")


class PinDialog(QDialog):
    """Dialog for a vertex, by its index in the mesh file, a position, or the name of a pin.

    The dialog stays open until the text is valid. After acceptance, `vertex` is the index in the
    mesh, and `remark` is a sentence about its distance from a typed position.
    """

    def __init__(self, mesh: Mesh, parent: QWidget | None = None, pins: Iterable[Pin] = ()) -> None:
        super().__init__(parent)
        theme.named(self, "pin_dialog").setWindowTitle("Pin vertex")
        self.vertex, self.remark = -1, ""
        self._mesh = mesh
        self._pins = {pin.name.casefold(): pin.vertex for pin in pins if pin.name}
        where = f" in {mesh.unit}" if mesh.unit else ""
        where += " or voxels" if mesh.voxel != NO_VOXEL else ""
        named = ", the name of a pin" if self._pins else ""
        last = f"{mesh.n_file_vertices - 1:,}"
        label = QLabel(f"Index of the vertex, 0 to {last}{named}, or a position x, y, z{where}")
        self.edit = theme.named(QLineEdit(), "pin_index_edit", "Index of the vertex, or position")
        label.setBuddy(self.edit)
        self.fault = reserved_note("pin_fault_label", 3)
        self.pin_button = theme.named(QPushButton("Pin"), "pin_button", role="primary")
        buttons = button_box(self, self.pin_button, self._accept)
        self.setLayout(column(label, self.edit, self.fault, buttons, margins=(20, 16, 20, 16)))
        self.setMinimumWidth(360)
        self.edit.textEdited.connect(self.fault.clear)

    def _accept(self) -> None:
        text, last = self.edit.text().strip(), self._mesh.n_file_vertices - 1
        found = None if _GROUPED.fullmatch(text) else _POSITION.fullmatch(text)
        try:
            if text.casefold() in self._pins:
                self.vertex = self._pins[text.casefold()]
            elif found is not None:
                *numbers, unit = found.groups()
                at = (parse_number(f"{each} {unit}", self._mesh.unit) for each in numbers)
                self.vertex, self.remark = nearest_vertex(self._mesh, *at, voxels=not unit)
            else:
                index = parse_whole(text, 0, last, "The index")
                self.vertex = self._mesh.vertex_of(index)
        except InputError as fault:
            several = found is None and re.search(r"\d[,;\s]+[-+\d]", text)
            self.fault.setText(f"{fault}{' A position is written x, y, z.' if several else ''}")
            self.edit.setFocus()
            self.edit.selectAll()
        else:
            self.accept()


def nearest_vertex(
    mesh: Mesh, x: float, y: float, z: float, *, voxels: bool = True
) -> tuple[int, str]:
    """Find the vertex nearest to a position; return its index and a sentence on the distance.

    The position is in the unit of the mesh. With `voxels`, and if the mesh has a voxel size,
    the position may also be in voxels: the reading nearer to the mesh is chosen, and the sentence
    names it.

    Raises
    ------
    InputError
        If the position is farther from the mesh than the diagonal of its bounding box.
    """
    position, used = np.array([x, y, z]), np.flatnonzero(mesh.referenced)
    places = mesh.vertices[used]
    readings = {"": position}
    if voxels and mesh.voxel != NO_VOXEL:
        readings = {f", read in {mesh.unit}": position, ", read in voxels": position * mesh.voxel}
    found = []
    for reading, at in readings.items():
        squared = ((places - at) ** 2).sum(axis=1)
        found.append((float(squared.min()), int(used[squared.argmin()]), reading))
    squared_distance, vertex, reading = min(found)
    distance = math.sqrt(squared_distance)
    if not distance <= float(np.linalg.norm(np.ptp(places, axis=0))):
        low, high = (format_position(each, 7) for each in (places.min(axis=0), places.max(axis=0)))
        between = f"{low} and {high} {mesh.unit}".rstrip()
        fault = f"The position is far from the mesh, which lies between {between}"
        raise InputError("far-from-mesh", fault, "check its unit")
    name = mesh.named_vertex(vertex).capitalize()
    return vertex, f"{name} is {format_quantity(distance, mesh.unit)} from that position{reading}."


class PinExportDialog(SaveDialog):
    """Dialog for the columns and the file of a `PinExport`, which `export` returns.

    The document must have pins.
    """

    def __init__(self, document: Document, folder: Path, parent: QWidget | None = None) -> None:
        mesh, known = document.mesh, document.known
        assert mesh is not None and known is not None  # noqa: PT018  pins are on a mesh
        self._document, self._mesh, self._spectrum = document, mesh, known.exact
        self._part = document.part_mesh
        path = suggested_path(document, "pins.csv", folder)
        super().__init__("pins", "Export pins", FileRow(path, "Table (*.csv)", ".csv"), parent)
        maps = f", {counted(len(mesh.maps), 'own map')}" if mesh.maps else ""
        count = counted(len(document.pins.placed), "pin")
        contents = f"{count} with index, x, y, z, unit, name, colour{maps}, and the columns of:"
        self.contents_label = make.label("pins_contents_label", role="muted")
        shown = document.display.family.name
        self._checks: dict[QCheckBox, tuple[Family, int]] = {}
        for kind, each in EXPORTS.items():
            if not each.makes_features():
                continue
            family, columns, about = self._prepared(each)
            between_pins, n_columns = family.measured_from(()) != family, len(columns)
            text = each.export_label or each.label
            if between_pins and about:
                text = about.rstrip(".")
            check = make.check(text, f"pins_{kind}_check", text, self._refresh_contents)
            check.setEnabled(n_columns > 0)
            check.setToolTip("" if n_columns else "Compute eigenpairs first")
            self._checks[check] = family, n_columns
            check.setChecked(n_columns > 0 and (between_pins or family.name == shown))
        parts = make.label("pins_rows_label", text=contents), *self._checks, self.contents_label
        chosen = holder(column(*parts, spacing=6))
        self._arrange(("Columns", chosen))
        self._refresh_contents()

    def export(self) -> PinExport:
        return PinExport(
            self._mesh,
            self._spectrum.operator or self._document.solve.operator,
            self.path,
            self._document.pins.placed,
            tuple(family for check, (family, _) in self._checks.items() if check.isChecked()),
            len(self._spectrum),
            self._part,
            self._spectrum.target,
        )

    def _prepared(self, kind: type[Family]) -> tuple[Family, tuple[str, ...], str]:
        """Return a family with its parameters in the window, its columns, and their description."""
        family = configured(self._document, kind)
        if family.needs_pairs and not len(self._spectrum):
            return family, (), ""
        try:
            family = family.resolved(self._spectrum, self._document.display.fields)
            return family, *family.exported_columns(self._spectrum, self._mesh.unit)
        except InputError:  # such as a range without nonzero eigenvalues
            return family, (), ""

    def _refresh_contents(self) -> None:
        count = sum(n for check, (_, n) in self._checks.items() if check.isChecked())
        self.contents_label.setText(f"{counted(count, 'column')} of features and distances.")
