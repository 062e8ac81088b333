"""Dialog that exports the pins as a table, with columns of features and distances."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QCheckBox, QWidget

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.app.dialogs.files import SaveDialog
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import PinExportJob
from meshmash_viewer.units import counted


class PinExportDialog(SaveDialog):
    """Asks for the columns of a `PinExportJob`; `job` returns it. The document has pins."""

    def __init__(self, document: Document, folder: Path, parent: QWidget | None = None) -> None:
        mesh, known = document.mesh, document.known
        assert mesh is not None and known is not None  # noqa: PT018  pins are on a mesh
        self._document, self._mesh, self._spectrum = document, mesh, known.exact
        self._part = document.part_mesh
        path = folder / f"{mesh.name or 'mesh'}_pins.csv"
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
        chosen = QWidget()
        chosen.setLayout(column(*parts, spacing=6))
        self._arrange_rows(("Columns", chosen))
        self.setMinimumWidth(560)
        self._refresh_contents()
        self._refresh_remark()

    def job(self) -> PinExportJob:
        """The chosen export."""
        return PinExportJob(
            self._mesh,
            self._spectrum.operator or self._document.solve.operator,
            self.path,
            self._document.pins.placed,
            tuple(family for check, (family, _) in self._checks.items() if check.isChecked()),
            len(self._spectrum),
            self._part,
        )

    def _prepared(self, kind: type[Family]) -> tuple[Family, tuple[str, ...], str]:
        """A family with the parameters of the window, its columns, if any, and what they are."""
        fields = self._document.display.fields
        family = fields.get(kind.name) or kind()
        family = family.measured_from([pin.vertex for pin in self._document.pins.placed])
        if family.needs_pairs and not len(self._spectrum):
            return family, (), ""
        try:
            family = family.resolved(self._spectrum, fields)
            return family, *family.exported_columns(self._spectrum, self._mesh.unit)
        except InputError:  # such as a range without nonzero eigenvalues
            return family, (), ""

    def _refresh_contents(self) -> None:
        count = sum(n for check, (_, n) in self._checks.items() if check.isChecked())
        self.contents_label.setText(f"{counted(count, 'column')} of features and distances.")
