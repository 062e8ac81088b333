"""Base classes of tables: a model of rows, and a view in which whole rows are selected."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TypeAlias

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QIcon, QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QTableView

from meshmash_viewer.app import theme

Index: TypeAlias = QModelIndex | QPersistentModelIndex


class Rows(QAbstractTableModel):
    """Base class of table models; subclasses return the contents of the cells."""

    #: Column of names, which can be edited; -1 for none.
    names: ClassVar[int] = -1

    @property
    def n_rows(self) -> int:
        raise NotImplementedError

    @property
    def titles(self) -> Sequence[str]:
        raise NotImplementedError

    def is_number(self, column: int) -> bool:
        """Return whether a column contains numbers, which are right-aligned."""
        raise NotImplementedError

    def text(self, row: int, column: int) -> str:
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

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008  Qt's own default
        return self.n_rows

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return len(self.titles)

    def headerData(
        self, section: int, along: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return self._alignment(section)
        horizontal = along == Qt.Orientation.Horizontal
        return self.titles[section] if horizontal and role == Qt.ItemDataRole.DisplayRole else None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row, column, roles = index.row(), index.column(), Qt.ItemDataRole
        if role in (roles.DisplayRole, roles.EditRole):
            return self.text(row, column)
        if role == roles.TextAlignmentRole:
            return self._alignment(column)
        if role == roles.DecorationRole:
            return self.icon(row, column)
        if role in (roles.ToolTipRole, roles.AccessibleTextRole):
            text = self.tip if role == roles.ToolTipRole else self.spoken
            return text(row, column) or None
        return self.sort_key(row, column) if role == roles.UserRole else None

    def setData(self, index: Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        self.rename(index.row(), str(value))
        return True

    def flags(self, index: Index) -> Qt.ItemFlag:
        flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
        return flags | Qt.ItemFlag.ItemIsEditable if index.column() == self.names else flags

    def _alignment(self, column: int) -> Qt.AlignmentFlag:
        sides = Qt.AlignmentFlag
        return sides.AlignVCenter | (
            sides.AlignRight if self.is_number(column) else sides.AlignLeft
        )


class Table(QTableView):
    """Table without grid lines, in which F2 edits the name in the selected row."""

    def __init__(self, name: str, spoken: str, *, row_height: int = 26, role: str = "") -> None:
        super().__init__()
        theme.named(self, name, spoken, role=role)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setEditTriggers(QAbstractItemView.EditTrigger.EditKeyPressed)
        self.setShowGrid(False)
        self.setTabKeyNavigation(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(row_height)
        self.horizontalHeader().setHighlightSections(False)

    def edit_name(self, row: int) -> None:
        """Start editing the name in a row."""
        rows = self.model()
        if isinstance(rows, Rows) and row >= 0:
            self.setCurrentIndex(rows.index(row, rows.names))
            self.edit(rows.index(row, rows.names))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Edit the name in the selected row on F2, in any column."""
        chosen = self.selectionModel().selectedRows()
        if event.key() == Qt.Key.Key_F2 and chosen:
            self.edit_name(chosen[0].row())
        else:
            super().keyPressEvent(event)
