"""Base class of tables in which whole rows are selected."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

from PySide6.QtCore import (
    QAbstractProxyModel,
    QAbstractTableModel,
    QModelIndex,
    QPersistentModelIndex,
    Qt,
)
from PySide6.QtGui import QGuiApplication, QIcon, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QAbstractItemView, QTableView

from meshmash_viewer.app import theme

Index: TypeAlias = QModelIndex | QPersistentModelIndex


class Table(QTableView):
    """Table without grid lines; F2 edits the name in the selected row, Ctrl+C copies rows.

    Subclasses return the contents of the cells. Their constructors call ``setModel`` with `rows`,
    or with a proxy model of it, after they have set the attributes that the cells need.
    """

    #: Column of names, which can be edited; -1 for none.
    names: ClassVar[int] = -1

    def __init__(self, name: str, spoken: str, *, row_height: int = 26, role: str = "") -> None:
        super().__init__()
        #: The model of the cells.
        self.rows = _Rows(self)
        theme.named(self, name, spoken, role=role)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(row_height)
        self.horizontalHeader().setHighlightSections(False)

    @property
    def n_rows(self) -> int:
        raise NotImplementedError

    @property
    def titles(self) -> Sequence[str]:
        raise NotImplementedError

    def title_tip(self, column: int) -> str:
        """Return the tooltip of the title of a column; "" for none."""
        return ""

    def is_number(self, column: int) -> bool:
        """Return whether a column contains numbers, which are right-aligned."""
        raise NotImplementedError

    def cell_text(self, row: int, column: int) -> str:
        raise NotImplementedError

    def icon(self, row: int, column: int) -> QIcon | None:
        return None

    def tip(self, row: int, column: int) -> str:
        """Return the tooltip of a cell; "" for none."""
        return ""

    def spoken(self, row: int, column: int) -> str:
        """Return the text for screen readers; "" for the displayed text."""
        return ""

    def sort_key(self, row: int, column: int) -> Any:
        """Return the value by which a proxy model sorts a cell."""
        return None

    def rename(self, row: int, name: str) -> None:
        """Set the name that the user typed."""
        raise NotImplementedError

    def edit_name(self, row: int) -> None:
        """Start editing the name in a row."""
        self.setCurrentIndex(self.rows.index(row, self.names))
        self.edit(self.rows.index(row, self.names))

    def copied(self, rows: Sequence[int]) -> Mapping[str, Sequence[object]]:
        """Return the columns of some rows by their titles, with unrounded numbers."""
        raise NotImplementedError

    def copy(self) -> None:
        """Copy the selected rows, or all rows if none is selected, for a spreadsheet.

        The text has a line of titles, and cells separated by tabs; a missing number is empty.
        """
        model, selection = self.model(), self.selectionModel()
        at = [model.index(row, 0) for row in range(model.rowCount())]
        at = [index for index in at if selection.isRowSelected(index.row())] or at
        if isinstance(model, QAbstractProxyModel):
            at = [model.mapToSource(index) for index in at]
        columns, text = self.copied([index.row() for index in at]), io.StringIO()
        writer = csv.writer(text, "excel-tab", lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow("" if value != value else value for value in row)
        QGuiApplication.clipboard().setText(text.getvalue())

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Copy rows on Ctrl+C; edit the name in the selected row on F2, in any column."""
        chosen = self.selectionModel().selectedRows()
        if event.matches(QKeySequence.StandardKey.Copy):
            self.copy()
        elif event.key() == Qt.Key.Key_F2 and chosen and self.names >= 0:
            self.edit_name(chosen[0].row())
        else:
            super().keyPressEvent(event)


class _Rows(QAbstractTableModel):
    """Model of the cells of a `Table`."""

    def __init__(self, table: Table) -> None:
        super().__init__(table)
        self._table = table

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008  Qt's own default
        return self._table.n_rows

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return len(self._table.titles)

    def headerData(
        self, section: int, along: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(section)
        if role == Qt.ItemDataRole.ToolTipRole:
            return self._table.title_tip(section) or None
        horizontal = along == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole
        return self._table.titles[section] if horizontal else None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        table, roles, cell = self._table, Qt.ItemDataRole, (index.row(), index.column())
        if role in (roles.DisplayRole, roles.EditRole):
            return table.cell_text(*cell)
        if role == roles.TextAlignmentRole:
            return self._alignment(index.column())
        if role == roles.DecorationRole:
            return table.icon(*cell)
        if role in (roles.ToolTipRole, roles.AccessibleTextRole):
            return (table.tip if role == roles.ToolTipRole else table.spoken)(*cell) or None
        return table.sort_key(*cell) if role == roles.UserRole else None

    def setData(self, index: Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        self._table.rename(index.row(), str(value))
        return True

    def flags(self, index: Index) -> Qt.ItemFlag:
        flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        return flags | Qt.ItemFlag.ItemIsEditable if index.column() == self._table.names else flags

    def _alignment(self, column: int) -> Qt.AlignmentFlag:
        sides = Qt.AlignmentFlag
        side = sides.AlignRight if self._table.is_number(column) else sides.AlignLeft
        return sides.AlignVCenter | side
