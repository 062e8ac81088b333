"""Table of the regions of a label set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QModelIndex, QSortFilterProxyModel, Qt, Signal
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QAbstractItemView

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.table import Table
from meshmash_viewer.features.regions import Regions
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.units import engineering, grouped
from meshmash_viewer.vertex_map import Label

#: Titles of columns of `regions`; the default is the name of the column. The first column of the
#: table combines label and part.
_TITLES = {"neck_width": "Neck", "loops": "Loops"}
_NOT_SHOWN = ("label", "part")
_FIRST = ("area", "neck_width", "volume", "extent")
#: Largest number of visible rows, their height in pixels, and the number of rows that determine the
#: widths of the columns.
_MOST, _ROW, _LOOKED_AT = 7, 24, 100
#: Largest width of the names in pixels; the tooltip shows the whole name.
_NAME_WIDTH = 130


class RegionTable(Table):
    """Table of regions; a click on the title of a column sorts the rows."""

    #: Mask of the region that was clicked, or double-clicked.
    region_clicked = Signal(object)
    region_activated = Signal(object)

    def __init__(self) -> None:
        super().__init__("region_table", "Regions of the label set", row_height=_ROW, role="dense")
        self.table: Regions | None = None
        self._colors: dict[str, str] = {}
        self._columns: list[str] = []
        #: By column: the power of ten by which it is multiplied, and its unit.
        self._units: dict[str, tuple[int, str]] = {}
        self._sorted = QSortFilterProxyModel(self)
        self._sorted.setSortRole(Qt.ItemDataRole.UserRole)
        self._sorted.setSourceModel(self.rows)
        self.setModel(self._sorted)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.horizontalHeader().setResizeContentsPrecision(_LOOKED_AT)
        self.clicked.connect(lambda index: self.region_clicked.emit(self._mask_of(index)))
        self.doubleClicked.connect(lambda index: self.region_activated.emit(self._mask_of(index)))

    def show_regions(self, table: Regions | None, labels: tuple[Label, ...]) -> None:
        """Show regions with the colours of their labels; an empty table for None."""
        if table is self.table:
            return
        self.rows.beginResetModel()
        self.table, self._colors = table, {each.name: each.color for each in labels}
        named = [] if table is None else [each for each in table.columns if each not in _NOT_SHOWN]
        self._columns = sorted(named, key=lambda each: each not in _FIRST)
        self._units = {
            each: engineering(float(np.abs(np.nan_to_num(table[each])).max()), table.unit_of(each))
            for each in self._columns
            if table is not None
        }
        self.rows.endResetModel()
        self.resizeColumnsToContents()
        self.setColumnWidth(0, min(self.columnWidth(0), _NAME_WIDTH))
        shown, header = min(self.n_rows, _MOST), self.horizontalHeader().sizeHint()
        bar = self.horizontalScrollBar().sizeHint().height()
        self.setFixedHeight(header.height() + shown * _ROW + bar + 4)

    @property
    def n_rows(self) -> int:
        return 0 if self.table is None else len(self.table)

    @property
    def titles(self) -> list[str]:
        # "mean Mean curvature" has the title "Mean"
        short = (
            each if each.startswith("sum ") else each.partition(" ")[0] for each in self._columns
        )
        return ["Region", *map(self._title, short, self._columns)]

    def _title(self, title: str, name: str) -> str:
        unit, known = self._units[name][1], _TITLES.get(title) or title[:1].upper() + title[1:]
        return f"{known}, {unit}" if unit else known

    def title_tip(self, column: int) -> str:
        if not column:
            return ""
        name = self._columns[column - 1]
        weighted = ", weighted by area" if name.startswith("mean ") else ""
        return f"{self._title(name, name)}{weighted}"

    def is_number(self, column: int) -> bool:
        return column > 0

    def icon(self, row: int, column: int) -> QIcon | None:
        color = self._colors.get(str(self.table["label"][row]), "#808080") if self.table else ""
        return None if column else make.dot(color)

    def cell_text(self, row: int, column: int) -> str:
        if column == 0:
            return self.tip(row, column)
        name, value = self._columns[column - 1], self.sort_key(row, column)
        if not np.isfinite(value):
            return "–"
        if name in ("vertices", "loops", "points"):
            return f"{value:,.0f}"
        return grouped(value * 10.0 ** self._units[name][0], 3)

    def copied(self, rows: Sequence[int]) -> dict[str, Sequence[object]]:
        columns: dict[str, Sequence[object]] = {}
        if self.table is not None:
            for name, values in self.table.columns.items():
                unit = self.table.unit_of(name)
                columns[f"{name}, {unit}" if unit else name] = values[rows].tolist()
        return columns

    def sort_key(self, row: int, column: int) -> float:
        assert self.table is not None
        return float(self.table[self._columns[column - 1]][row]) if column else row

    def tip(self, row: int, column: int) -> str:
        """Return the name of the label, with the number of the part if there are several."""
        assert self.table is not None
        label, part = str(self.table["label"][row]), int(self.table["part"][row])
        several = part > 1 or label in self.table["label"][row + 1 : row + 2]
        return f"{label} ({part})" if several else label

    def _mask_of(self, index: QModelIndex) -> Mask:
        assert self.table is not None
        return self.table.mask(self._sorted.mapToSource(index).row())
