"""Table of the regions of a label set."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from PySide6.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QPersistentModelIndex,
    QSortFilterProxyModel,
    Qt,
    Signal,
)
from PySide6.QtWidgets import QAbstractItemView, QTableView

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.features.regions import Regions
from meshmash_viewer.units import engineering, grouped
from meshmash_viewer.vertex_map import Label

_Index: TypeAlias = QModelIndex | QPersistentModelIndex
#: Titles of columns of the library; the others have their own names. The first of the table is the
#: label with the number of the part.
_TITLES = {"neck_width": "Neck", "lambda2": "λ₂", "loops": "Loops"}
_NOT_SHOWN = ("label", "part")
_FIRST = ("area", "neck_width", "volume", "extent")
#: Most rows in view, their height, and the rows that the widths of columns suit.
_MOST, _ROW, _LOOKED_AT = 7, 24, 100
#: Largest width of the names; longer ones are in the tip.
_NAME_WIDTH = 130


class _Rows(QAbstractTableModel):
    """One row a region."""

    def __init__(self) -> None:
        super().__init__()
        self.table: Regions | None = None
        self._colors: dict[str, str] = {}
        self._columns: list[str] = []
        #: Power of ten that a column is multiplied by, and its unit.
        self._units: dict[str, tuple[int, str]] = {}

    def show_regions(self, table: Regions | None, labels: tuple[Label, ...]) -> None:
        """Show other regions."""
        self.beginResetModel()
        self.table, self._colors = table, {each.name: each.color for each in labels}
        named = [] if table is None else [each for each in table.columns if each not in _NOT_SHOWN]
        self._columns = sorted(named, key=lambda each: each not in _FIRST)
        self._units = {
            each: engineering(_largest(table[each]), table.unit_of(each))
            for each in self._columns
            if table is not None
        }
        self.endResetModel()

    def rowCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008  Qt's own default
        return 0 if self.table is None else len(self.table)

    def columnCount(self, parent: _Index = QModelIndex()) -> int:  # noqa: B008
        return 1 + len(self._columns)

    def headerData(
        self, section: int, along: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return _alignment(section)
        roles = Qt.ItemDataRole
        if along != Qt.Orientation.Horizontal or role not in (roles.DisplayRole, roles.ToolTipRole):
            return None
        if section == 0:
            return "Region"
        name = self._columns[section - 1]
        unit = self._units[name][1]
        title = _TITLES.get(name) or name[:1].upper() + name[1:]
        if role == roles.DisplayRole and not name.startswith("sum "):
            # "Mean" of "mean Mean curvature"
            title = title.partition(" ")[0]
        return f"{title}, {unit}" if unit else title

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        table, row, column = self.table, index.row(), index.column()
        roles = Qt.ItemDataRole
        if table is None or role not in (
            roles.DisplayRole, roles.UserRole, roles.TextAlignmentRole, roles.DecorationRole,
            roles.ToolTipRole,
        ):  # fmt: skip
            return None
        if role == roles.ToolTipRole:
            return self._name(row)
        if role == roles.TextAlignmentRole:
            return _alignment(column)
        label = str(table["label"][row])
        if role == roles.DecorationRole:
            return make.dot(self._colors.get(label, "#808080")) if column == 0 else None
        if column == 0:
            return row if role == roles.UserRole else self._name(row)
        name = self._columns[column - 1]
        value = float(table[name][row])
        if role == roles.UserRole:
            return value
        if not np.isfinite(value):
            return "–"
        if name in ("vertices", "loops", "points"):
            return f"{value:,.0f}"
        return grouped(value * 10.0 ** self._units[name][0], 3)

    def _name(self, row: int) -> str:
        """Name of the label, with the number of the part where there are several."""
        assert self.table is not None
        label, part = str(self.table["label"][row]), int(self.table["part"][row])
        several = part > 1 or label in self.table["label"][row + 1 : row + 2]
        return f"{label} ({part})" if several else label


def _largest(values: np.ndarray[Any, Any]) -> float:
    """Return the largest finite magnitude; 0 for none."""
    return float(np.abs(values, where=np.isfinite(values), out=np.zeros(len(values))).max())


def _alignment(column: int) -> Qt.AlignmentFlag:
    side = Qt.AlignmentFlag.AlignRight if column else Qt.AlignmentFlag.AlignLeft
    return side | Qt.AlignmentFlag.AlignVCenter


class RegionTable(QTableView):
    """The regions, sorted by a click on the title of a column."""

    #: Row of the region that was clicked, or clicked twice.
    region_clicked = Signal(int)
    region_activated = Signal(int)

    def __init__(self) -> None:
        super().__init__()
        theme.named(self, "region_table", "Regions of the label set", role="dense")
        self._rows = _Rows()
        self._sorted = QSortFilterProxyModel(self)
        self._sorted.setSortRole(Qt.ItemDataRole.UserRole)
        self._sorted.setSourceModel(self._rows)
        self.setModel(self._sorted)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(_ROW)
        self.horizontalHeader().setHighlightSections(False)
        self.horizontalHeader().setResizeContentsPrecision(_LOOKED_AT)
        self.clicked.connect(lambda index: self.region_clicked.emit(self._row_of(index)))
        self.doubleClicked.connect(lambda index: self.region_activated.emit(self._row_of(index)))

    def show_regions(self, table: Regions | None, labels: tuple[Label, ...]) -> None:
        """Show regions with the colours of their labels, or none."""
        if table is self._rows.table:
            return
        self._rows.show_regions(table, labels)
        self.resizeColumnsToContents()
        self.setColumnWidth(0, min(self.columnWidth(0), _NAME_WIDTH))
        shown, header = min(self._rows.rowCount(), _MOST), self.horizontalHeader().sizeHint()
        bar = self.horizontalScrollBar().sizeHint().height()
        self.setFixedHeight(header.height() + shown * _ROW + bar + 4)

    def _row_of(self, index: QModelIndex) -> int:
        return self._sorted.mapToSource(index).row()
