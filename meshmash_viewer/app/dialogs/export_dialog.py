"""Dialogs that export features, eigenpairs or maps, or compute a feature in pieces."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QLabel,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, holder, reserved_note, row, show_quietly
from meshmash_viewer.app.dialogs.files import FileRow, SaveDialog, configured, suggested_path
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.truncation import missing_sentence
from meshmash_viewer.fields import EXPORTS, FEATURES
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.fields.family import MOST_COUNT, Family
from meshmash_viewer.health import listed_repairs
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import Export
from meshmash_viewer.model.pieces import LEAST, Pieces, in_pieces, usual_pieces
from meshmash_viewer.plug_ins import known_plug_ins
from meshmash_viewer.spectral.cost import written_bytes
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted, format_quantity
from meshmash_viewer.vertex_map import VertexMap, named_apart


@dataclass(frozen=True)
class Format:
    """A row of the table of formats; `number` and `place` are bytes per value and per vertex."""

    name: str
    ending: str
    holds: str
    number: float
    place: float

    @property
    def pattern(self) -> str:
        return f"{self.name} (*{self.ending})"


#: Formats of features, in the order of the table.
FORMATS = (
    Format("NumPy archive", ".npz", "features, names, λ, mesh, provenance", 8, 72),
    Format("NumPy array", ".npy", "the bare numbers; details in a .json file", 8, 0),
    Format("CSV", ".csv", "a table for any program; details in a .json file", 18, 6),
    Format("Parquet", ".parquet", "a table for pandas, Polars and R", 8, 0),
    Format("VTK PolyData", ".vtp", "the mesh with its columns, for ParaView", 8, 80),
    Format("PLY", ".ply", "the mesh with one property per column", 4, 50),
    Format("GIFTI functional", ".func.gii", "maps for neuroimaging tools", 5, 0),
    Format("GIFTI shape", ".shape.gii", "maps of the shape, such as curvature", 5, 0),
    *(
        Format(each.package, each.name, "the format of the plug-in", 8, 0)
        for each in known_plug_ins()
        if each.group == "writers" and not each.fault
    ),
)


#: Kind of an export without features or eigenpairs.
_MAPS = "maps"
#: Note on the rows of a mesh from which vertices were removed.
_ROWS = " Rows contain the index of their vertex in the file."


class ExportDialog(SaveDialog):
    """Dialog for the parameters of an `Export`, which `export` returns.

    The document must have a mesh. The suggested file is in `folder`, with the format `ending` if
    this format can hold the columns. `shown` is the displayed field, to be exported as a map.
    """

    def __init__(
        self,
        document: Document,
        folder: Path,
        parent: QWidget | None = None,
        ending: str = "",
        shown: VertexMap | None = None,
    ) -> None:
        mesh, known = document.mesh, document.known
        assert mesh is not None and known is not None  # noqa: PT018  the command needs them
        self._document, self._mesh, self._spectrum = document, mesh, known.exact
        named = {each.name: each for each in mesh.maps}
        # an own map is exported with the values of its file, not with the drawn values
        self._shown = named.get(shown.name, shown) if shown is not None else None
        self._possible, self._missing = True, ""
        suggested = suggested_path(document, "hks.npz", folder)
        file_row = FileRow(suggested, FORMATS[0].pattern, FORMATS[0].ending)
        super().__init__("export", "Export", file_row, parent, ("Export", "export_button"))
        labels = {
            kind: family.export_label or family.label
            for kind, family in EXPORTS.items()
            if len(self._spectrum) or not configured(document, family).of_pairs
        }
        labels[_MAPS] = "Maps: the displayed field, and own maps"
        self.kind_combo = make.combo("export_kind_combo", "What to export", entries=labels)
        most = len(self._spectrum)
        self.pairs_spin = make.spin(
            "export_pairs_spin", "Number of eigenpairs to use", self._refresh, minimum=1,
            maximum=max(most, 1), value=most, suffix=f" of {counted(most, 'eigenpair')}",
        )  # fmt: skip
        self.count_spin = make.spin(
            "export_count_spin", "Number of columns", self._refresh, minimum=1,
            maximum=MOST_COUNT,
        )  # fmt: skip
        self.maps_check = make.check(
            "", "export_maps_check", "Own maps as more columns", self._refresh
        )
        self._part, self._whole = document.part_mesh, document.file_mesh
        if self._whole is not None and self._whole.n_vertices == mesh.n_vertices:
            self._whole = None
        repairs = listed_repairs(document.repairs)
        self.repairs_label = self._label("export_repairs_label", "Repairs made on the mesh", 2)
        self.repairs_label.setText(f"{repairs}.{_ROWS if mesh.numbering else ''}")
        self.whole_check = make.check(
            f"At all {counted(mesh.n_file_vertices, 'vertex')} of the file,"
            " NaN where nothing was computed",
            "export_whole_check",
            "Write results at all vertices of the mesh file",
            self._refresh,
        )
        repaired = holder(column(self.repairs_label, self.whole_check, spacing=4))
        self._columns_row = holder(row(self.count_spin, (self.maps_check,), spacing=12))
        self._build_table()
        self.contents_label = self._label("export_contents_label", "Contents of the file", 3)
        self.columns_label = self._label("export_columns_label", "Columns", 2)
        self._arrange(
            ("What", self.kind_combo),
            ("Made from", self.pairs_spin),
            ("After repairs", repaired),
            ("Columns", self._columns_row),
            ("Format", self.table),
            ("Contains", self.contents_label),
            ("Named", self.columns_label),
            width=700,
        )
        self._form.setRowVisible(repaired, bool(document.repairs))
        self.kind_combo.currentIndexChanged.connect(self._change_kind)
        self.whole_check.setVisible(self._whole is not None)
        self.table.itemSelectionChanged.connect(self._change_format)
        self.file_row.edit.textChanged.connect(self._follow_name)
        family = document.display.family
        kind = family.export or document.display.profile_family.export
        if family.own or self.kind_combo.findData(kind) < 0:
            kind = _MAPS
        self.kind_combo.setCurrentIndex(self.kind_combo.findData(kind))
        self._change_kind()
        self._choose_ending(ending)

    # -- choices ------------------------------------------------------------------

    @property
    def kind(self) -> str:
        """Key of `EXPORTS`, or "maps"."""
        return str(self.kind_combo.currentData())

    @property
    def format(self) -> Format:
        return FORMATS[max(self.table.currentRow(), 0)]

    def export(self) -> Export:
        mesh, family = self._mesh, self._family(self._used())
        if family is None:
            mesh = mesh.with_only_maps(*self._chosen_maps())
        return Export(
            mesh,
            self._spectrum.operator or self._document.solve.operator,
            self.path,
            family,
            min(self.pairs_spin.value(), len(self._spectrum)),
            self._document.solve.stated(self._spectrum),
            self._document.repairs,
            self.maps_check.isChecked(),
            self._whole if self.whole_check.isChecked() else None,
            self._part,
        )

    def _chosen_maps(self) -> tuple[VertexMap, ...]:
        """Return the maps to export without features."""
        others = (each for each in self._mesh.maps if each is not self._shown)
        shown = () if self._shown is None else (self._shown,)
        return named_apart((*shown, *(others if self.maps_check.isChecked() else ())))

    def _chosen(self) -> Family | None:
        """Return the family to export, with its parameters in the window; None for maps."""
        return None if self.kind == _MAPS else configured(self._document, EXPORTS[self.kind])

    def _family(self, used: Eigenpairs) -> Family | None:
        """Return the family with its ranges resolved for the chosen number of eigenpairs."""
        chosen = self._chosen()
        if chosen is None:
            return None
        if chosen.counted:
            chosen = replace(chosen, **{chosen.counted: self.count_spin.value()})
        return chosen.resolved(used, self._document.display.fields)

    def _used(self) -> Eigenpairs:
        return self._spectrum.first(self.pairs_spin.value())

    # -- building and refreshing ----------------------------------------------------------

    def _label(self, name: str, accessible: str, lines: int) -> QLabel:
        label = reserved_note(name, lines, "", accessible)
        label.setContentsMargins(0, 4, 0, 0)
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        return label

    def _build_table(self) -> None:
        self.table = table = QTableWidget(len(FORMATS), 4)
        theme.named(table, "export_format_table", "Format")
        table.setHorizontalHeaderLabels(["Format", "Ending", "About", "Holds"])
        table.verticalHeader().hide()
        table.setShowGrid(False)
        table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        table.setTabKeyNavigation(False)
        middle = Qt.AlignmentFlag.AlignVCenter
        self._items = [
            [QTableWidgetItem(text) for text in (each.name, each.ending, "", each.holds)]
            for each in FORMATS
        ]
        for at, items in enumerate(self._items):
            items[2].setTextAlignment(Qt.AlignmentFlag.AlignRight | middle)
            for place, item in enumerate(items):
                table.setItem(at, place, item)
            table.setRowHeight(at, 26)
        header = table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setStretchLastSection(True)
        header.setHighlightSections(False)
        header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | middle)
        table.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        table.setFixedHeight(26 * len(FORMATS) + 32)
        table.selectRow(0)

    def _change_kind(self) -> None:
        chosen = self._chosen()
        features = chosen is None or chosen.makes_features()
        counted_by = "" if chosen is None else chosen.counted
        self._output = "features" if features else "eigenpairs"
        self.count_spin.setVisible(bool(counted_by))
        others = [each for each in self._mesh.maps if chosen is not None or each is not self._shown]
        names = ", ".join(each.name for each in others)
        self.maps_check.setText(f"and {counted(len(others), 'own map')}: {names}")
        self.maps_check.setVisible(bool(others))
        # by default, a displayed map is exported without the other maps
        self.maps_check.setChecked(bool(others) and (chosen is not None or self._shown is None))
        has_columns = bool(counted_by) or (features and bool(others))
        self._form.setRowVisible(self._columns_row, has_columns)
        self._form.setRowVisible(self.pairs_spin, chosen is not None and chosen.of_pairs)
        if counted_by:
            show_quietly(self.count_spin, getattr(chosen, counted_by))
        path, stem = self.path, self.path.name.removesuffix(self.format.ending)
        for kind in (*EXPORTS, _MAPS):
            if stem.endswith(f"_{kind}"):
                stem = f"{stem.removesuffix(kind)}{self.kind}"
                self.file_row.edit.setText(str(path.with_name(stem + self.format.ending)))
                break
        self._refresh()

    def _change_format(self) -> None:
        self.file_row.set_ending(self.format.ending, self.format.pattern)
        self._refresh()

    def _follow_name(self) -> None:
        name = self.file_row.edit.text().strip().lower()
        if not name.endswith(self.format.ending):
            self._choose_ending(next((e.ending for e in FORMATS if name.endswith(e.ending)), ""))

    def _choose_ending(self, ending: str) -> None:
        for at, each in enumerate(FORMATS):
            if each.ending == ending:
                self.table.selectRow(at)

    def _refresh(self) -> None:
        mesh, unit = self._mesh, self._mesh.unit
        n = mesh.n_file_vertices if self.whole_check.isChecked() else mesh.n_vertices
        try:
            columns, about = self._columns()
        except InputError as fault:
            columns, about = [], str(fault)
        self._possible = bool(columns)
        for each, items in zip(FORMATS, self._items, strict=True):
            size = n * (each.number * len(columns) + each.place)
            items[2].setText(written_bytes(size) if columns else "–")
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
        """Return the names of the columns in the file, and a sentence about them."""
        self._missing = ""
        used, unit = self._used(), self._mesh.unit
        family = self._family(used)
        if family is None:
            maps = [each.name for each in self._chosen_maps()]
            about = "The field is still being computed, or approximate: wait for the exact field."
            return maps, "" if maps else about
        columns, about = family.exported_columns(used, unit)
        names = list(columns)
        if not family.makes_features():
            return names, about
        if isinstance(family, BankFamily):
            shares = used.missing_shares(
                family.bank(used.eigenvalues), (self._part or self._mesh).area
            )
            if sentence := missing_sentence(tuple(names), shares):
                self._missing = f"{sentence}: the file will say so."
        values = family.describe(used, unit).unit(unit)
        if self.maps_check.isChecked():
            names += [each.name for each in named_apart(self._mesh.maps, names)]
        return names, f"{about} Values in {values}.".lstrip() if values else about

    def _remark(self) -> str:
        chosen, partial = self._chosen(), ""
        if chosen is not None and chosen.of_pairs and not self._spectrum.complete:
            partial = "The decomposition is not complete: the file will say so."
        return " ".join(filter(None, (self._missing, partial, super()._remark())))

    def _refresh_remark(self) -> None:
        super()._refresh_remark()
        self.accept_button.setEnabled(self._possible and self.file_row.named)


class PiecesDialog(SaveDialog):
    """Dialog for a feature, the number of pieces and a file.

    The feature has the parameters of its tab; parameters that depend on the spectrum of the mesh
    are estimated by Weyl's law. The spectrum of each piece is computed up to the target of the
    Mesh panel.
    """

    def __init__(self, document: Document, folder: Path, parent: QWidget | None = None) -> None:
        mesh = document.mesh
        assert mesh is not None
        self._document, self._mesh = document, mesh
        self._families: dict[str, Family] = {}
        for name in FEATURES:
            with suppress(InputError):  # raised if a family needs the spectrum of the whole mesh
                shown = self._as_shown(name)
                self._families[name] = in_pieces(shown, mesh, document.solve.target)
        patterns = " ".join(f"*{ending}" for ending in WRITERS)
        path = suggested_path(document, "pieces.npz", folder)
        row = FileRow(path, f"Tables ({patterns})", ".npz")
        accept = "Compute", "pieces_compute_button"
        super().__init__("features", "Compute in pieces", row, parent, accept)
        theme.named(self, "pieces_dialog")
        labels = {name: family.label for name, family in self._families.items()}
        self.family_combo = make.combo("pieces_family_combo", "Feature", entries=labels)
        row_of_kind = self.family_combo.findData(document.display.kind)
        self.family_combo.setCurrentIndex(max(row_of_kind, 0))
        n = mesh.n_vertices - len(mesh.unreferenced)
        self.count_spin = make.spin(
            "pieces_count_spin", "Number of pieces", self._show_size, minimum=1,
            maximum=max(n // LEAST, 1), value=usual_pieces(n),
        )  # fmt: skip
        self.size_label = make.label("pieces_size_label", wordWrap=True, role="muted")
        self._arrange(
            ("Feature", self.family_combo), ("Pieces", self.count_spin), ("", self.size_label)
        )
        self._show_size()

    def _as_shown(self, name: str) -> Family:
        """Return a family with the parameters and the position that its tab shows."""
        fields, spectrum = self._document.display.fields, self._document.scaled_spectrum
        chosen = fields[name]
        if spectrum is None:
            return chosen
        known = chosen.resolved(spectrum, fields)
        return replace(chosen, **{each: getattr(known, each) for each in chosen.position})

    def _show_size(self) -> None:
        document = self._document
        size = round(self._mesh.n_vertices / self.count_spin.value())
        top, _ = document.solve.translation().eigenvalue(document.solve.target)
        self.size_label.setText(
            f"About {counted(size, 'vertex')} each, plus the overlap, up to"
            f" λ = {format_quantity(top, document.unit, -2)}, the target of the Mesh panel."
        )

    def pieces(self) -> Pieces:
        document = self._document
        family = self._families[self.family_combo.currentData()]
        return Pieces(
            self._mesh, self.path, family, self.count_spin.value(), document.solve.target,
            document.solve.operator, document.repairs,
        )  # fmt: skip
