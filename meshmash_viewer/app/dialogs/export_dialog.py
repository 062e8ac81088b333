"""Exporting features or eigenpairs: what, in which format, where, and what will be in the file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from PySide6.QtCore import QSignalBlocker, Qt
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
from meshmash_viewer.app.controls.facts import reserved_note
from meshmash_viewer.app.controls.file_row import FileRow
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.truncation import missing_sentence
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.family import MOST_COUNT, Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.io.write import EIGENPAIR_WRITERS
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import ExportJob
from meshmash_viewer.units import counted

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


class ExportDialog(QDialog):
    """Asks for all that an `ExportJob` needs; `job` answers.

    Parameters
    ----------
    document : Document
        With a mesh and at least one eigenpair.
    folder : Path
        Where to suggest a file.
    ending : str
        Of the format to begin with, if what is exported can be written in it.
    """

    def __init__(
        self, document: Document, folder: Path, parent: QWidget | None = None, ending: str = ""
    ) -> None:
        super().__init__(parent)
        self.setObjectName("export_dialog")
        self.setWindowTitle("Export")
        self._document = document
        assert document.mesh is not None
        assert document.spectrum is not None
        self._mesh, self._spectrum = document.mesh, document.spectrum.exact
        self._possible = True
        self._missing = ""

        self.kind_combo = theme.named(QComboBox(), "export_kind_combo")
        self.kind_combo.setAccessibleName("What to export")
        for kind, family in EXPORTS.items():
            self.kind_combo.addItem(family.export_label or family.label, kind)
        self.pairs_spin = theme.named(QSpinBox(), "export_pairs_spin")
        self.pairs_spin.setAccessibleName("Number of eigenpairs to use")
        self.pairs_spin.setRange(1, len(self._spectrum))
        self.pairs_spin.setValue(len(self._spectrum))
        self.pairs_spin.setSuffix(f" of {len(self._spectrum):,} eigenpairs")
        self.count_spin = theme.named(QSpinBox(), "export_count_spin")
        self.count_spin.setAccessibleName("Number of columns")
        self.count_spin.setRange(1, MOST_COUNT)
        self._build_table()
        self.contents_label = self._label("export_contents_label", "What the file will contain", 3)
        self.columns_label = self._label("export_columns_label", "Columns", 2)
        self.remark_label = reserved_note("export_remark_label", 2)
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
                ("Columns", self.count_spin),
                ("Format", self.table),
                ("Contains", self.contents_label),
                ("Named", self.columns_label),
                ("File", self.file_row),
            )
        ):
            label = theme.with_role(QLabel(text), "muted")
            label.setContentsMargins(0, 4, 0, 0)
            grid.addWidget(label, at, 0, top)
            grid.addWidget(widget, at, 1)
            if widget is self.count_spin:
                self._count_row = (label, widget)
        grid.addWidget(self.remark_label, grid.rowCount(), 1)

        buttons = QDialogButtonBox()
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.export_button = theme.with_role(
            theme.named(QPushButton("Export"), "export_button"), "primary"
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
        theme.pad_fields(self)
        self.setMinimumWidth(700)

        self.kind_combo.currentIndexChanged.connect(self._change_kind)
        self.pairs_spin.valueChanged.connect(self._refresh)
        self.count_spin.valueChanged.connect(self._refresh)
        self.table.itemSelectionChanged.connect(self._change_format)
        self.file_row.changed.connect(self._follow_name)
        shown = document.display.family.behind(document.display.fields)
        self.kind_combo.setCurrentIndex(max(self.kind_combo.findData(shown.export), 0))
        self._change_kind()
        self._choose_ending(ending)

    # -- what was chosen ------------------------------------------------------------------

    @property
    def kind(self) -> str:
        """Key of `EXPORTS`."""
        return str(self.kind_combo.currentData())

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
            self._family(self._used()),
            self.pairs_spin.value(),
            self._document.target,
            self._document.repairs,
        )

    def _chosen(self) -> Family:
        """The family to export, as the window has it."""
        family = EXPORTS[self.kind]
        return self._document.display.fields.get(family.name) or family()

    def _family(self, used: Spectrum) -> Family:
        """With ranges for as many pairs as are used, so that the screen and the file agree."""
        chosen = self._chosen()
        if chosen.counted:
            chosen = replace(chosen, **{chosen.counted: self.count_spin.value()})
        return chosen.resolved(used, self._document.display.fields)

    def _used(self) -> Spectrum:
        spectrum, count = self._spectrum, self.pairs_spin.value()
        return replace(
            spectrum,
            eigenvalues=spectrum.eigenvalues[:count],
            residuals=spectrum.residuals[:count],
            known_to=spectrum.known_to if count == len(spectrum) else 0.0,
        )

    # -- building and refreshing ----------------------------------------------------------

    def _label(self, name: str, accessible: str, lines: int) -> QLabel:
        label = reserved_note(name, lines, "", accessible)
        label.setContentsMargins(0, 4, 0, 0)
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        return label

    def _build_table(self) -> None:
        table = theme.named(QTableWidget(len(FORMATS), 4), "export_format_table")
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

    def _item(self, row: int, column: int) -> QTableWidgetItem:
        item = self.table.item(row, column)
        assert item is not None
        return item

    @staticmethod
    def _file_kind(chosen: Format) -> tuple[str, str]:
        return f"{chosen.name} (*{chosen.ending})", chosen.ending

    def _change_kind(self) -> None:
        """Only two of the formats can hold eigenpairs."""
        chosen = self._chosen()
        pairs = not chosen.counted
        for widget in self._count_row:
            widget.setVisible(not pairs)
        if not pairs:
            with QSignalBlocker(self.count_spin):
                self.count_spin.setValue(getattr(chosen, chosen.counted))
        for row, each in enumerate(FORMATS):
            possible = not pairs or each.ending in EIGENPAIR_WRITERS
            for at in range(self.table.columnCount()):
                item = self._item(row, at)
                flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
                item.setFlags(flags if possible else Qt.ItemFlag.NoItemFlags)
        if pairs and self.format.ending not in EIGENPAIR_WRITERS:
            self.table.selectRow(0)
        path, stem = self.path, self.path.name.removesuffix(self.format.ending)
        for kind in EXPORTS:
            if stem.endswith(f"_{kind}"):
                stem = f"{stem.removesuffix(kind)}{self.kind}"
                self.file_row.edit.setText(str(path.with_name(stem + self.format.ending)))
                break
        self._refresh()

    def _change_format(self) -> None:
        pattern, ending = self._file_kind(self.format)
        self.file_row.set_ending(ending, pattern)
        self._refresh()

    def _follow_name(self) -> None:
        """Take the format whose ending was typed."""
        name = self.file_row.edit.text().strip().lower()
        if not name.endswith(self.format.ending):
            self._choose_ending(next((e.ending for e in FORMATS if name.endswith(e.ending)), ""))
        self._refresh_remark()

    def _choose_ending(self, ending: str) -> None:
        for row, each in enumerate(FORMATS):
            if each.ending == ending and self._item(row, 0).flags() != Qt.ItemFlag.NoItemFlags:
                self.table.selectRow(row)

    def _refresh(self) -> None:
        n, unit = self._mesh.n_vertices, self._mesh.unit
        try:
            columns, about = self._columns()
        except InputError as fault:
            columns, about = [], str(fault)
        self._possible = bool(columns)
        for row, each in enumerate(FORMATS):
            size = n * (each.number * len(columns) + each.place)
            possible = columns and self._item(row, 0).flags() != Qt.ItemFlag.NoItemFlags
            self._item(row, 2).setText(written_bytes(size) if possible else "–")
        kind = "float32" if self.format.number < 8 and self.format.ending != ".csv" else "float64"
        self.contents_label.setText(
            f"{counted(n, 'row')} (vertices) × {counted(len(columns), 'column')}, {kind}.\n{about}"
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
        family = self._family(used)
        about = family.contents(used, unit)
        if not family.counted:
            return [f"eigenvector_{at}" for at in range(len(used))], about
        bank = family.bank(used.eigenvalues)
        shares = used.missing_shares(bank, self._mesh.area)
        if sentence := missing_sentence(bank.columns, shares):
            self._missing = f"{sentence}: the file will say so."
        values = family.unit(unit)
        return list(bank.columns), f"{about} Values in {values}." if values else about

    def _refresh_remark(self) -> None:
        parts = [self._missing] if self._missing else []
        spectrum = self._spectrum
        if not spectrum.complete:
            parts.append("The decomposition is not complete: the file will say so.")
        parts.append(self.file_row.remark)
        self.remark_label.setText(" ".join(filter(None, parts)))
        self.export_button.setEnabled(self._possible and self.file_row.named)

    def _accept(self) -> None:
        fault = self.file_row.fault("features" if self._chosen().counted else "eigenpairs")
        if fault:
            self.remark_label.setText(fault)
        else:
            self.accept()
