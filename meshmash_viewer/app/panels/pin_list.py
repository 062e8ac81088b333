"""Lists of the pins: the legend of the profiles, and a table with values and positions."""

from __future__ import annotations

import html
from collections.abc import Sequence

from PySide6.QtCore import QEvent, QObject, QPoint, Qt, Signal
from PySide6.QtGui import QContextMenuEvent, QIcon
from PySide6.QtWidgets import QFrame, QHeaderView, QLabel, QScrollArea, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column
from meshmash_viewer.app.controls.make import row as side_by_side
from meshmash_viewer.app.controls.table import Index, Table
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.units import NO_BREAK, format_position

#: Largest number of pins with a line in the legend and a profile; the oldest pins are shown.
MOST_SHOWN = 40
#: Largest width of a pin's name in pixels; the default name "Vertex 1,234" is not shortened.
_WIDEST = 72


class PinLegend(QScrollArea):
    """Legend of the first `MOST_SHOWN` pins: colour, number, name, and a remove button."""

    #: Vertex of the pin under the pointer, -1 for none.
    pointed = Signal(int)
    #: Vertex of a double-clicked pin.
    activated_pin = Signal(int)
    #: Vertex of a right-clicked pin, and the position on the screen.
    menu_requested = Signal(int, QPoint)

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "pin_legend", "Pinned vertices")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # its buttons take the focus
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._document = document
        content = theme.named(QWidget(self), "panel_content")
        self._column = column(None, spacing=0, margins=(theme.GAP, 0, 0, 0))
        content.setLayout(self._column)
        self.setWidget(content)
        #: Lines by pin and text, as a repair can change the name of a vertex.
        self._rows: dict[tuple[Pin, str], QWidget] = {}
        self._short = False
        follow(document.pins.changed, self._refresh)
        self._refresh()

    def set_short(self, short: bool) -> None:
        """Set whether lines show only numbers, with names in tooltips."""
        if short != self._short:
            self._short = short
            self._refresh()

    def _refresh(self) -> None:
        pins = sorted(self._document.pins.placed[:MOST_SHOWN], key=lambda pin: pin.number)
        lines = [
            (pin, pin.name or self._document.named_vertex(pin.vertex).capitalize()) for pin in pins
        ]
        for line in [line for line in self._rows if line not in lines]:
            row = self._rows.pop(line)
            if row.property("role") == "pointed":
                self.pointed.emit(-1)
            self._column.removeWidget(row)
            row.hide()
            row.deleteLater()
        for place, line in enumerate(lines):
            if line not in self._rows:
                self._rows[line] = self._row(*line)
                self._column.insertWidget(place, self._rows[line])
            for name in self._rows[line].findChildren(QLabel, f"pin_label_{line[0].vertex}"):
                name.setVisible(not self._short)
        widest = max((row.sizeHint().width() for row in self._rows.values()), default=0)
        bar = self.verticalScrollBar().sizeHint().width()
        self.setFixedWidth(widest + theme.GAP + bar)

    def point_at(self, vertex: int) -> None:
        """Mark the line of the pin of a vertex, or no line for -1."""
        for (pin, _), row in self._rows.items():
            theme.change_role(row, "pointed" if pin.vertex == vertex else "")

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Enter, QEvent.Type.Leave):
            entered = event.type() == QEvent.Type.Enter
            for (pin, _), row in self._rows.items():
                if row is watched:
                    self.pointed.emit(pin.vertex if entered else -1)
        elif event.type() == QEvent.Type.MouseButtonDblClick:
            self.activated_pin.emit(self._vertex_of(watched))
        elif isinstance(event, QContextMenuEvent):
            self.menu_requested.emit(self._vertex_of(watched), event.globalPos())
            return True
        return super().eventFilter(watched, event)

    def _vertex_of(self, watched: QObject) -> int:
        rows = self._rows.items()
        return next((pin.vertex for (pin, _), row in rows if row is watched), -1)

    def _row(self, pin: Pin, called: str) -> QWidget:
        row = theme.named(QWidget(), f"pin_row_{pin.vertex}")
        row.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        row.installEventFilter(self)
        swatch = QLabel()
        swatch.setFixedSize(12, 12)
        swatch.setStyleSheet(f"background: {pin.color}; border-radius: 6px;")
        number = make.label(f"pin_number_{pin.vertex}", text=f"<b>{pin.number}</b>")
        name = make.label(f"pin_label_{pin.vertex}", textFormat=Qt.TextFormat.PlainText)
        row.setToolTip(html.escape(called))
        if pin.name:
            end = Qt.TextElideMode.ElideRight
            called = name.fontMetrics().elidedText(called, end, _WIDEST)
        name.setText(called)
        take = f"Unpin {pin.name or self._document.named_vertex(pin.vertex)}"
        cross = make.icon_button(
            f"unpin_button_{pin.vertex}",
            take,
            lambda: self._document.pins.toggle(pin.vertex),
            tip=take,
        )
        cross.setText("×")
        cross.setAutoRaise(True)
        row.setLayout(side_by_side(swatch, number, name, None, cross, spacing=6))
        return row


_NUMBER, NAME, _VERTEX, _VALUE, _PLACE = range(5)


class PinTable(Table):
    """Table of all pins of a document; F2 edits a name."""

    #: Vertex of the pin under the pointer, -1 for none.
    pointed = Signal(int)
    #: Vertex of a double-clicked pin.
    activated_pin = Signal(int)
    #: Vertex of a right-clicked pin, -1 below the rows, and the position on the screen.
    menu_requested = Signal(int, QPoint)
    #: Vertex of a pin, and the name that was typed.
    renamed = Signal(int, str)
    names = NAME

    def __init__(self, document: Document) -> None:
        super().__init__("pin_table", "Table of the pins")
        self._document = document
        #: The pins, in the order of their numbers.
        self.pins: tuple[Pin, ...] = ()
        self.field: Field | None = None
        self.setModel(self.rows)
        self.setMouseTracking(True)
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        header.setStretchLastSection(True)
        for at, width in enumerate((48, 90, 72, 118)):
            self.setColumnWidth(at, width)
        self.entered.connect(lambda index: self.pointed.emit(self._vertex_of(index)))
        self.doubleClicked.connect(lambda index: self.activated_pin.emit(self._vertex_of(index)))
        follow(document.pins.changed, self._refresh)
        follow(document.mesh_changed, self._refresh)
        self._refresh()

    @property
    def n_rows(self) -> int:
        return len(self.pins)

    @property
    def titles(self) -> tuple[str, ...]:
        of_value, of_place = self._unit, self._document.unit
        value = f"Value in {of_value}" if of_value else "Value"
        return ("Pin", "Name", "Index", value, f"x, y, z in {of_place}" if of_place else "x, y, z")

    def is_number(self, column: int) -> bool:
        return column in (_VERTEX, _VALUE)

    @property
    def _unit(self) -> str:
        return "" if self.field is None else self.field.written_unit

    def icon(self, row: int, column: int) -> QIcon | None:
        return make.dot(self.pins[row].color) if column == _NUMBER else None

    def cell_text(self, row: int, column: int) -> str:
        pin = self.pins[row]
        mesh, field = self._document.mesh, self.field
        if column == _NUMBER:
            return str(pin.number)
        if column == NAME:
            return pin.name
        if mesh is None or pin.vertex >= mesh.n_vertices:
            return ""
        if column == _VERTEX:
            return f"{mesh.file_index(pin.vertex):,}"
        if column == _PLACE:
            return format_position(mesh.vertices[pin.vertex], 6)
        if field is None or len(field.values) != mesh.n_vertices:
            return ""
        return field.value_text(pin.vertex).removesuffix(f"{NO_BREAK}{self._unit}")

    def copied(self, rows: Sequence[int]) -> dict[str, Sequence[object]]:
        mesh, field, unit = self._document.mesh, self.field, self._document.unit
        at = [self.pins[row].vertex for row in rows]
        columns: dict[str, Sequence[object]] = {
            "Pin": [self.pins[row].number for row in rows],
            "Name": [self.pins[row].name for row in rows],
        }
        if mesh is not None and max(at, default=0) < mesh.n_vertices:
            columns["Index"] = [mesh.file_index(vertex) for vertex in at]
            if field is not None and len(field.values) == mesh.n_vertices:
                numbers = [float(str(value)) for value in field.values[at]]  # float32, short
                named = [self.cell_text(row, _VALUE) for row in rows]
                columns[self.titles[_VALUE]] = named if field.labels else numbers
            for axis, places in zip("xyz", mesh.vertices[at].T.tolist(), strict=True):
                columns[f"{axis} in {unit}" if unit else axis] = places
        return columns

    def rename(self, row: int, name: str) -> None:
        self.renamed.emit(self.pins[row].vertex, name)

    @property
    def chosen(self) -> int:
        """Vertex of the chosen pin, -1 for none."""
        rows = self.selectionModel().selectedRows()
        return self._vertex_of(rows[0]) if rows else -1

    def set_field(self, field: Field | None) -> None:
        self.field = field
        if self.pins:
            last = self.rows.index(len(self.pins) - 1, _VALUE)
            self.rows.dataChanged.emit(self.rows.index(0, _VALUE), last)
        self.rows.headerDataChanged.emit(Qt.Orientation.Horizontal, _VALUE, _VALUE)

    def leaveEvent(self, event: QEvent) -> None:
        super().leaveEvent(event)
        self.pointed.emit(-1)

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        at = self.viewport().mapFromGlobal(event.globalPos())
        self.menu_requested.emit(self._vertex_of(self.indexAt(at)), event.globalPos())

    def _refresh(self) -> None:
        chosen = self.chosen
        self.rows.beginResetModel()
        self.pins = tuple(sorted(self._document.pins.placed, key=lambda pin: pin.number))
        self.rows.endResetModel()
        for row, pin in enumerate(self.pins):
            if pin.vertex == chosen:
                self.selectRow(row)

    def _vertex_of(self, index: Index) -> int:
        return self.pins[index.row()].vertex if index.isValid() else -1
