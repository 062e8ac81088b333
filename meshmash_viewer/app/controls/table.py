"""Tables of a panel: a model of rows with texts, icons and tips, and a view of whole rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TypeAlias

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QIcon, QKeyEvent
from PySide6.QtWidgets import QAbstractItemView, QTableView

from meshmash_viewer.app import theme

Index: TypeAlias = QModelIndex | QPersistentModelIndex


class Rows(QAbstractTableModel):
    """A model of which subclasses have the rows."""

    #: The column of names, which are edited; -1 for none.
    names: ClassVar[int] = -1

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        raise NotImplementedError

    @property
    def titles(self) -> Sequence[str]:
        """Titles of the columns."""
        raise NotImplementedError

    def is_number(self, column: int) -> bool:
        """Whether a column has numbers, which are on the right."""
        raise NotImplementedError

    def text(self, row: int, column: int) -> str:
        """What an entry shows."""
        raise NotImplementedError

    def icon(self, row: int, column: int) -> QIcon | None:
        """What is before the text of an entry."""
        return None

    def tip(self, row: int, column: int) -> str:
        """What an entry means; "" for nothing."""
        return ""

    def spoken(self, row: int, column: int) -> str:
        """What screen readers say in place of the text; "" for that."""
        return ""

    def sort_key(self, row: int, column: int) -> Any:
        """What rows are sorted by."""
        return None

    def rename(self, row: int, name: str) -> None:
        """Take the name that was typed in a row."""
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
            said = self.tip if role == roles.ToolTipRole else self.spoken
            return said(row, column) or None
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
    """A view of whole rows, without grid; F2 edits the name of the chosen one."""

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
        """Begin to edit the name in a row."""
        rows = self.model()
        if isinstance(rows, Rows) and row >= 0:
            self.setCurrentIndex(rows.index(row, rows.names))
            self.edit(rows.index(row, rows.names))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Edit the name in any column."""
        chosen = self.selectionModel().selectedRows()
        if event.key() == Qt.Key.Key_F2 and chosen:
            self.edit_name(chosen[0].row())
        else:
            super().keyPressEvent(event)
