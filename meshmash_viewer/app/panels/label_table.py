"""Table of the labels of a set: colour, name, size, visibility and lock."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QItemSelectionModel, QModelIndex, Qt, Signal
from PySide6.QtGui import QContextMenuEvent, QIcon, QKeyEvent, QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.table import Table
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.labels import Labels, LabelSizes
from meshmash_viewer.units import counted, engineering, grouped, power_unit
from meshmash_viewer.vertex_map import Label, VertexMap

COLOR, NAME, VERTICES, AREA, SHOWN, LOCK = range(6)
#: Widths of the columns in pixels; the column of names takes the remaining width.
_WIDTHS = {COLOR: 34, VERTICES: 64, AREA: 74, SHOWN: 23, LOCK: 23}
#: Width of the column of names in pixels below which the column of vertices is hidden.
_NAME_WIDTH = 110
#: Least and largest number of visible rows.
_LEAST, _MOST = 3, 9
#: Number of labels that have a key.
KEYS = 9


def given_to_label(event: QEvent, labels: Labels) -> bool:
    """Assign the selection to the label of a digit key; return False for other events."""
    kinds = QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress
    if not isinstance(event, QKeyEvent) or event.type() not in kinds:
        return False
    number, keypad = event.key() - Qt.Key.Key_0, Qt.KeyboardModifier.KeypadModifier
    if event.modifiers() & ~keypad or not 1 <= number <= KEYS:
        return False
    event.accept()
    if event.type() == QEvent.Type.KeyPress:
        labels.assign_nth(number)
    return True


class LabelTable(Table):
    """Table of the labels of the current set; a double click or F2 edits a name."""

    #: Number of the label whose colour was clicked.
    color_requested = Signal(int)
    #: Position on the screen of a right click or the menu key.
    menu_requested = Signal(object)
    names = NAME

    def __init__(self, document: Document) -> None:
        super().__init__("label_table", "Labels of the set", role="dense")
        self._document = document
        #: The shown labels, their sizes if measured, and the name of their set.
        self.labels: tuple[Label, ...] = ()
        self._sizes: LabelSizes | None = None
        self._set_name = ""
        self.setModel(self.rows)
        triggers = QAbstractItemView.EditTrigger
        self.setEditTriggers(triggers.EditKeyPressed | triggers.DoubleClicked)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        header = self.horizontalHeader()
        header.setMinimumSectionSize(20)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header.setSectionResizeMode(NAME, QHeaderView.ResizeMode.Stretch)
        for column, width in _WIDTHS.items():
            self.setColumnWidth(column, width)
        self.clicked.connect(self._act)
        theme.notifier().changed.connect(self.viewport().update)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Hide the number of vertices in a narrow table."""
        room = self.viewport().width() - sum(_WIDTHS.values())
        self.setColumnHidden(VERTICES, room < _NAME_WIDTH)
        super().resizeEvent(event)

    @property
    def chosen(self) -> list[int]:
        """Numbers of the chosen labels, in the order of the list."""
        rows = sorted(index.row() for index in self.selectionModel().selectedRows())
        return [self.labels[row].key for row in rows]

    def show_labels(self, known: VertexMap | None) -> None:
        """Show the labels of a set; in the same set, keep the chosen rows or choose a new label."""
        name, labels = ("", ()) if known is None else (known.name, known.labels)
        if (name, labels) == (self._set_name, self.labels):
            return
        before, chosen = {each.key for each in self.labels}, set(self.chosen)
        if name != self._set_name:
            before, chosen, self._set_name = set(), set(), name
        self.rows.beginResetModel()
        self.labels, self._sizes = labels, None
        self.rows.endResetModel()
        if before and len(new := {each.key for each in labels} - before) == 1:
            chosen = new
        selection, flags = self.selectionModel(), QItemSelectionModel.SelectionFlag
        for row, label in enumerate(labels):
            if label.key in chosen:
                place = self.rows.index(row, NAME)
                selection.select(place, flags.Select | flags.Rows)
                selection.setCurrentIndex(place, flags.NoUpdate)
        shown = min(max(len(labels), _LEAST), _MOST)
        row_height = self.verticalHeader().defaultSectionSize()
        self.setFixedHeight(self.horizontalHeader().sizeHint().height() + shown * row_height + 4)

    def show_sizes(self, known: VertexMap, sizes: LabelSizes) -> None:
        """Show a set with the number of vertices and the area of each label."""
        self.show_labels(known)
        self._sizes = sizes
        last = self.rows.index(len(self.labels) - 1, SHOWN)
        self.rows.dataChanged.emit(self.rows.index(0, VERTICES), last)
        self.rows.headerDataChanged.emit(Qt.Orientation.Horizontal, AREA, AREA)

    @property
    def n_rows(self) -> int:
        return len(self.labels)

    @property
    def titles(self) -> tuple[str, ...]:
        unit = self._area_unit[1]
        return ("", "Label", "Vertices", f"Area, {unit}" if unit else "Area", "", "")

    def is_number(self, column: int) -> bool:
        return column in (VERTICES, AREA)

    @property
    def _area_unit(self) -> tuple[int, str]:
        """Power of ten by which areas are multiplied, and their unit, for the largest area."""
        largest = 0.0 if self._sizes is None else float(self._sizes.areas.max())
        return engineering(largest, power_unit(self._document.unit, 2))

    def icon(self, row: int, column: int) -> QIcon | None:
        label, colors = self.labels[row], theme.palette()
        if column == COLOR:
            return make.dot(label.color)
        if column not in (SHOWN, LOCK):
            return None
        eye = ("closed eye", False) if self.is_hidden(row) else ("eye", True)
        name, on = ("lock", label.locked) if column == LOCK else eye
        return make.untinted(theme.pixmap(name, colors.text if on else colors.border_strong, 16))

    def is_hidden(self, row: int) -> bool:
        return self._sizes is not None and bool(self._sizes.hidden[row])

    def cell_text(self, row: int, column: int) -> str:
        label = self.labels[row]
        if column == COLOR:
            return str(row + 1) if row < KEYS else ""
        if column == NAME:
            return label.name or str(label.key)
        if column > AREA or self._sizes is None:
            return ""
        counts, areas, _ = self._sizes
        if column == VERTICES:
            return f"{counts[row]:,}"
        return grouped(areas[row] * 10.0 ** self._area_unit[0]) if counts[row] else "–"

    def copied(self, rows: Sequence[int]) -> dict[str, Sequence[object]]:
        labels, unit = [self.labels[row] for row in rows], power_unit(self._document.unit, 2)
        columns: dict[str, Sequence[object]] = {
            "Number": [label.key for label in labels],
            "Label": [label.name for label in labels],
            "Colour": [label.color for label in labels],
        }
        if self._sizes is not None:
            columns["Vertices"] = self._sizes.counts[rows].tolist()
            columns[f"Area, {unit}" if unit else "Area"] = self._sizes.areas[rows].tolist()
        return columns

    def tip(self, row: int, column: int) -> str:
        label = self.labels[row]
        if column == COLOR:
            key = f"; key {row + 1} assigns the selection to the label" if row < KEYS else ""
            return f"Colour {label.color}: click to change it{key}"
        if column == SHOWN:
            return "Hidden: click to show it" if self.is_hidden(row) else "Shown: click to hide it"
        if column == LOCK:
            text = "Locked: its vertices cannot be assigned to another label"
            return text if label.locked else "Not locked: click to lock its vertices"
        text = self.cell_text(row, column)
        if column == NAME and self._sizes is not None:
            return f"{text}: {counted(int(self._sizes.counts[row]), 'vertex')}"
        return text

    spoken = tip

    def rename(self, row: int, name: str) -> None:
        self._document.labels.rename(self.labels[row].key, name)

    def _act(self, index: QModelIndex) -> None:
        label = self.labels[index.row()]
        if index.column() == COLOR:
            self.color_requested.emit(label.key)
        elif index.column() == SHOWN:
            self._document.labels.show([label.key], self.is_hidden(index.row()))
        elif index.column() == LOCK:
            self._document.labels.lock(label.key, not label.locked)

    def event(self, event: QEvent) -> bool:
        """Handle the Delete key in the table, not as a shortcut of the window."""
        deletes = isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_Delete
        if deletes and event.type() == QEvent.Type.ShortcutOverride:
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Delete the chosen labels, and pass digits to the panel."""
        if event.key() == Qt.Key.Key_Delete:
            self._document.labels.delete(self.chosen)
        elif event.text().isdigit():
            event.ignore()
        else:
            super().keyPressEvent(event)

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Request the menu of the chosen labels."""
        self.menu_requested.emit(event.globalPos())
