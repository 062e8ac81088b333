"""The pinned vertices with their colours, as the legend of the profiles."""

from __future__ import annotations

import html

from PySide6.QtCore import QEvent, QObject, QPoint, Qt, Signal
from PySide6.QtGui import QContextMenuEvent
from PySide6.QtWidgets import QFrame, QLabel, QScrollArea, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.layout import column
from meshmash_viewer.app.controls.layout import row as side_by_side
from meshmash_viewer.app.listening import follow
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pins import Pin

#: Number of pins, the oldest, that have a line and a profile.
MOST_SHOWN = 40
#: Width of a given name in pixels; the name of a vertex ends in its index and is not shortened.
_WIDEST = 72


class PinLegend(QScrollArea):
    """One line per pin: its colour, number, name or vertex, and a button that removes it.

    Only the first pins have one; the table has all.
    """

    #: Vertex of the pin under the pointer, -1 for none.
    pointed = Signal(int)
    #: Vertex of a pin that was clicked twice.
    activated_pin = Signal(int)
    #: Vertex of a pin, and the position on the screen, of a right click.
    menu_requested = Signal(int, QPoint)

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "pin_legend", "Pinned vertices")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # it follows its buttons
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._document = document
        content = theme.named(QWidget(self), "panel_content")
        self._column = column(None, spacing=0, margins=(theme.GAP, 0, 0, 0))
        content.setLayout(self._column)
        self.setWidget(content)
        #: By pin, and what its vertex is called: after a repair another may have its index.
        self._rows: dict[tuple[Pin, str], QWidget] = {}
        self._short = False
        follow(document.pins.changed, self._refresh)
        self._refresh()

    def set_short(self, short: bool) -> None:
        """Show numbers alone, with names as tooltips, or names, too."""
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
        """Mark the line of a pin, or none."""
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
