"""The wheel over fields: it changes the one with the focus; over others it scrolls the panel."""

from __future__ import annotations

from PySide6.QtCore import QElapsedTimer, QEvent, QObject, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import (
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QScrollBar,
    QTabBar,
    QWidget,
)

_FIELDS = (QAbstractSpinBox, QComboBox, QAbstractSlider, QTabBar)
_NOTCH = 120  # eighths of a degree, as Qt counts
#: Milliseconds in which notches belong to one turn of the wheel.
_TURN = 400


class FieldWheel(QObject):
    """An event filter for all fields of a window.

    A field takes the wheel only while it has the focus. A panel that is being scrolled goes on
    being scrolled where such a field comes under the pointer, by the momentum of a trackpad, too.

    `watch` is called once fields have been made: Qt has no event that says so, and a filter of the
    whole application would call Python for each event of each widget.
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._scrolled: QAbstractScrollArea | None = None
        self._since = QElapsedTimer()
        self._turned = 0

    def watch(self, within: QWidget) -> None:
        """Watch the fields within a widget, however often they are watched already."""
        for field in (within, *within.findChildren(QWidget)):
            if field.focusPolicy() == Qt.FocusPolicy.WheelFocus:  # which the wheel itself gives
                field.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            if isinstance(field, _FIELDS) and not isinstance(field, QScrollBar):
                field.installEventFilter(self)
                if (area := scroll_area(field)) is not None:
                    area.viewport().installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Keep the wheel from fields without the focus."""
        if event.type() == QEvent.Type.FocusIn:
            self._scrolled, self._turned = None, 0
        if not (isinstance(event, QWheelEvent) and isinstance(watched, QWidget)):
            return False
        area = scroll_area(watched)
        if not isinstance(watched, _FIELDS):  # what the area shows, which is being scrolled
            self._scrolled = area
            self._since.start()
            return False
        if watched.hasFocus() and not self._scrolls(area):
            return self._belongs_to_no_notch(watched, event)
        event.ignore()
        if area is not None:
            QApplication.sendEvent(area.viewport(), event)
        return True

    def _scrolls(self, area: QAbstractScrollArea | None) -> bool:
        """Whether what a field is in is being scrolled."""
        return area is not None and area is self._scrolled and self._since.elapsed() < _TURN

    def _belongs_to_no_notch(self, field: QWidget, event: QWheelEvent) -> bool:
        """Whether it is momentum, which changes no field, or too little for a step of a list.

        Qt's lists step at each event, however small.
        """
        if event.phase() == Qt.ScrollPhase.ScrollMomentum:
            return True
        if not isinstance(field, QComboBox):
            return False
        self._turned += event.angleDelta().y()
        if abs(self._turned) < _NOTCH:
            return True
        self._turned -= _NOTCH if self._turned > 0 else -_NOTCH
        return False


def scroll_area(widget: QWidget) -> QAbstractScrollArea | None:
    """The innermost area that a widget scrolls in."""
    parent = widget.parentWidget()
    while parent is not None and not isinstance(parent, QAbstractScrollArea):
        parent = parent.parentWidget()
    return parent
