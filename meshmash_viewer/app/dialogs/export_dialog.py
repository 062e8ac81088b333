"""Exporting features or eigenpairs: what, in which format, where, and what will be in the file."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFrame,
    QGridLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QSpinBox,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.kinds import KINDS
from meshmash_viewer.features.truncation import missing_sentence
from meshmash_viewer.io.write import EIGENPAIR_WRITERS, check_output
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import export_bank
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.jobs import ExportJob
from meshmash_viewer.model.ranges import band_range, hks_range, missing_shares
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.units import format_quantity, power_unit

__all__ = ["FORMATS", "ExportDialog", "Format"]


@dataclass(frozen=True)
class Format:
    """A format as people choose it; `number` and `place` are bytes a value and a vertex."""

    name: str
    ending: str
    holds: str
    number: float
    place: float


#: The formats of features, most complete first.
FORMATS = (
    Format("NumPy archive", ".npz", "features, names, λ, mesh, how it was made", 8, 72),
    Format("NumPy array", ".npy", "the bare numbers; .json beside it", 8, 0),
    Format("CSV", ".csv", "a table for any program; .json beside it", 18, 6),
    Format("Parquet", ".parquet", "a table for pandas, Polars and R", 8, 0),
    Format("VTK PolyData", ".vtp", "the mesh with its columns, for ParaView", 8, 80),
    Format("PLY", ".ply", "the mesh with one property a column", 4, 50),
    Format("GIFTI functional", ".func.gii", "maps for neuroimaging tools", 5, 0),
)
_KIND_OF_FIELD = {FieldKind.HKS: "hks", FieldKind.BAND: "geometry-vectors"}


class ExportDialog(QDialog):
    """Asks for all that an `ExportJob` needs; `job` answers.

    Parameters
    ----------
    document : Document
        With a mesh and at least one eigenpair.
    folder : Path
        Where to suggest a file.
    """

    def __init__(self, document: Document, folder: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("export_dialog")
        self.setWindowTitle("Export")
        self._document = document
        self._mesh = document.mesh
        self._spectrum = document.spectrum.exact
        self._possible = True
        self._missing = ""

        self.kind_combo = QComboBox(objectName="export_kind_combo")
        self.kind_combo.setAccessibleName("What to export")
        for kind, text in KINDS.items():
            self.kind_combo.addItem(text, kind)
        self.pairs_spin = QSpinBox(objectName="export_pairs_spin")
        self.pairs_spin.setAccessibleName("Number of eigenpairs to use")
        self.pairs_spin.setRange(1, len(self._spectrum))
        self.pairs_spin.setValue(len(self._spectrum))
        self.pairs_spin.setSuffix(f" of {len(self._spectrum):,} eigenpairs")
        self.energies_spin = QSpinBox(objectName="export_energies_spin")
        self.energies_spin.setAccessibleName("Number of energies of the wave kernel signature")
        self.energies_spin.setRange(1, 1000)
        self.energies_spin.setValue(32)
        self._build_table()
        self.contents_label = self._label("export_contents_label", "What the file will contain")
        self.columns_label = self._label("export_columns_label", "Columns")
        self.remark_label = theme.with_role(
            QLabel(objectName="export_remark_label", wordWrap=True), "warning"
        )
        self.remark_label.setAccessibleName("Remark")
        name = self._mesh.name or "mesh"
        self.file_row = FileRow(folder / f"{name}_hks.npz", *self._file_kind(FORMATS[0]))

        grid = QGridLayout()
        grid.setHorizontalSpacing(16)
        grid.setVerticalSpacing(10)
        grid.setColumnStretch(1, 1)
        top = Qt.AlignmentFlag.AlignTop
        for at, (text, widget) in enumerate(
            (
                ("What", self.kind_combo),
                ("Made from", self.pairs_spin),
                ("Energies", self.energies_spin),
                ("Format", self.table),
                ("Contains", self.contents_label),
                ("Columns", self.columns_label),
                ("File", self.file_row),
            )
        ):
            label = theme.with_role(QLabel(text), "muted")
            label.setContentsMargins(0, 4, 0, 0)
            grid.addWidget(label, at, 0, top)
            grid.addWidget(widget, at, 1)
            if widget is self.energies_spin:
                self._energies_row = (label, widget)
        grid.addWidget(self.remark_label, grid.rowCount(), 1)

        buttons = QDialogButtonBox()
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.export_button = theme.with_role(
            QPushButton("Export", objectName="export_button"), "primary"
        )
        self.export_button.setDefault(True)
        buttons.addButton(self.export_button, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.accepted.connect(self._accept)
        buttons.rejected.connect(self.reject)
        column = QVBoxLayout(self)
        column.setContentsMargins(20, 18, 20, 16)
        column.setSpacing(14)
        column.addLayout(grid)
        column.addWidget(theme.with_role(QFrame(), "line"))
        column.addWidget(buttons)
        theme.pad_numbers(self)
        self.setMinimumWidth(700)

        self.kind_combo.currentIndexChanged.connect(self._change_kind)
        self.pairs_spin.valueChanged.connect(self._refresh)
        self.energies_spin.valueChanged.connect(self._refresh)
        self.table.itemSelectionChanged.connect(self._change_format)
        self.file_row.changed.connect(self._refresh_remark)
        kind = _KIND_OF_FIELD.get(document.display.kind, "hks")
        self.kind_combo.setCurrentIndex(self.kind_combo.findData(kind))
        self._change_kind()

    # -- what was chosen ------------------------------------------------------------------

    @property
    def kind(self) -> str:
        """Key of `KINDS`."""
        return self.kind_combo.currentData()

    @property
    def format(self) -> Format:
        """The format chosen in the table."""
        return FORMATS[max(self.table.currentRow(), 0)]

    @property
    def path(self) -> Path:
        """Where to write."""
        return self.file_row.path

    def job(self) -> ExportJob:
        """All of it, as the work to be done."""
        return ExportJob(
            self._mesh,
            self._spectrum.operator or self._document.operator,
            self.path,
            self.kind,
            self.pairs_spin.value(),
            self._parameters(),
        )

    def _parameters(self) -> dict[str, float]:
        """Ranges in force for as many pairs as are used, so that the screen and the file agree."""
        display, used = self._document.display, self._used()
        if self.kind == "hks":
            t_min, t_max = hks_range(used, display)
            return {"t_min": t_min, "t_max": t_max, "n_scales": display.hks_scales}
        if self.kind == "geometry-vectors":
            e_min, e_max = band_range(used, display)
            return {"e_min": e_min, "e_max": e_max, "n_bands": display.band_count}
        if self.kind == "wks":
            return {"n_energies": self.energies_spin.value()}
        return {}

    def _used(self) -> Spectrum:
        spectrum, count = self._spectrum, self.pairs_spin.value()
        return replace(
            spectrum,
            eigenvalues=spectrum.eigenvalues[:count],
            residuals=spectrum.residuals[:count],
            known_to=spectrum.known_to if count == len(spectrum) else 0.0,
        )

    # -- building and refreshing ----------------------------------------------------------

    def _label(self, name: str, accessible: str) -> QLabel:
        label = QLabel(objectName=name, wordWrap=True)
        label.setAccessibleName(accessible)
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        return label

    def _build_table(self) -> None:
        table = QTableWidget(len(FORMATS), 4, objectName="export_format_table")
        table.setAccessibleName("Format")
        table.setHorizontalHeaderLabels(["Format", "Ending", "About", "Holds"])
        table.verticalHeader().hide()
        table.setShowGrid(False)
        table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        table.setTabKeyNavigation(False)
        for row, each in enumerate(FORMATS):
            for at, text in enumerate((each.name, each.ending, "", each.holds)):
                item = QTableWidgetItem(text)
                if at == 2:
                    item.setTextAlignment(
                        Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
                    )
                table.setItem(row, at, item)
            table.setRowHeight(row, 26)
        header = table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setStretchLastSection(True)
        header.setHighlightSections(False)
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        table.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        table.setFixedHeight(26 * len(FORMATS) + 32)
        table.selectRow(0)
        self.table = table

    @staticmethod
    def _file_kind(chosen: Format) -> tuple[str, str]:
        return f"{chosen.name} (*{chosen.ending})", chosen.ending

    def _change_kind(self) -> None:
        """Only two of the formats can hold eigenpairs."""
        pairs = self.kind == "eigenpairs"
        for widget in self._energies_row:
            widget.setVisible(self.kind == "wks")
        for row, each in enumerate(FORMATS):
            possible = not pairs or each.ending in EIGENPAIR_WRITERS
            for at in range(self.table.columnCount()):
                item = self.table.item(row, at)
                flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
                item.setFlags(flags if possible else Qt.ItemFlag.NoItemFlags)
        if pairs and self.format.ending not in EIGENPAIR_WRITERS:
            self.table.selectRow(0)
        path, stem = self.path, self.path.name.removesuffix(self.format.ending)
        for kind in KINDS:
            if stem.endswith(f"_{kind}"):
                stem = f"{stem.removesuffix(kind)}{self.kind}"
                self.file_row.edit.setText(str(path.with_name(stem + self.format.ending)))
                break
        self._refresh()

    def _change_format(self) -> None:
        pattern, ending = self._file_kind(self.format)
        self.file_row.set_ending(ending, pattern)
        self._refresh()

    def _refresh(self) -> None:
        n, unit = self._mesh.n_vertices, self._mesh.unit
        try:
            columns, about = self._columns()
        except InputError as fault:
            columns, about = [], str(fault)
        self._possible = bool(columns)
        for row, each in enumerate(FORMATS):
            size = n * (each.number * len(columns) + each.place)
            possible = columns and self.table.item(row, 0).flags() != Qt.ItemFlag.NoItemFlags
            self.table.item(row, 2).setText(written_bytes(size) if possible else "–")
        kind = "float32" if self.format.number < 8 and self.format.ending != ".csv" else "float64"
        self.contents_label.setText(
            f"{n:,} rows (vertices) × {len(columns):,} columns, {kind}.\n{about}"
            if columns
            else about
        )
        shown = columns if len(columns) <= 4 else [*columns[:3], "…", columns[-1]]
        measured = "" if unit else "  (no unit: set one in the Mesh panel)"
        self.columns_label.setText(",  ".join(shown) + measured)
        self._refresh_remark()

    def _columns(self) -> tuple[list[str], str]:
        """Names of the columns as they will be written, and a sentence on them."""
        used, unit = self._used(), self._mesh.unit
        self._missing = ""
        per_area = power_unit(unit, -2)
        density = f" Values in {per_area}." if per_area else ""
        if self.kind == "eigenpairs":
            about = f"Eigenvalues up to {format_quantity(float(used.eigenvalues[-1]), unit, -2)}"
            values = power_unit(unit, -1)
            about += f", eigenvectors in {values}, M-orthonormal." if values else "."
            return [f"eigenvector_{at}" for at in range(len(used))], about
        chosen = self._parameters()
        bank = export_bank(self.kind, used.eigenvalues, chosen)
        shares = missing_shares(used, bank, self._mesh.area)
        if sentence := missing_sentence(bank.columns, shares):
            self._missing = f"{sentence}: the file will say so."
        if self.kind == "hks":
            t_min, t_max = chosen["t_min"], chosen["t_max"]
            about = (
                f"Times from {format_quantity(t_min, unit, 2)} to "
                f"{format_quantity(t_max, unit, 2)}, lengths √t from "
                f"{format_quantity(t_min**0.5, unit)} to {format_quantity(t_max**0.5, unit)}."
            )
        elif self.kind == "geometry-vectors":
            low, high = chosen["e_min"], chosen["e_max"]
            about = f"Bands of λ from {low:.4g} to {format_quantity(high, unit, -2)}."
        else:
            low, high = bank.parameters[0], bank.parameters[-1]
            about = f"Energies λ from {low:.4g} to {format_quantity(high, unit, -2)}."
        return list(bank.columns), about + density

    def _refresh_remark(self) -> None:
        parts = [self._missing] if self._missing else []
        spectrum = self._spectrum
        if not spectrum.complete:
            parts.append("The decomposition is not complete: the file will say so.")
        if os.path.isfile(self.path):  # unlike Path.is_file of a name that is too long, too
            parts.append(f"{self.path.name} exists and will be replaced.")
        self.remark_label.setText(" ".join(parts))
        self.remark_label.setVisible(bool(parts))
        self.export_button.setEnabled(self._possible and self.file_row.named)

    def _accept(self) -> None:
        kind = "eigenpairs" if self.kind == "eigenpairs" else "features"
        try:
            check_output(self.path, kind)
        except (InputError, OSError) as fault:
            self.remark_label.setText(failure_of(fault).text)
            self.remark_label.setVisible(True)
            return
        self.accept()
