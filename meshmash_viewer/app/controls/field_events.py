"""Wheel and keys over fields: which a field takes, and which are left to panel and commands."""

from __future__ import annotations

import shiboken6
from PySide6.QtCore import QElapsedTimer, QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence, QWheelEvent
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QScrollArea,
    QScrollBar,
    QTabBar,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.number_field import DecimalField, NumberField, WholeField

_WATCHED = (QAbstractButton, QComboBox, QTabBar, QLineEdit, QAbstractSpinBox)
_ARROWS = (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Home, Qt.Key.Key_End)


class FocusKeys(QObject):
    """Keeps Space from being a command while a button or a list has the focus, and so on.

    The other way round, a field in which nothing is typed leaves Undo and Redo to the commands:
    Qt's fields take those keys even where they have nothing to undo.

    It watches the one widget that has the focus: to watch the whole application would call
    Python for each of its events, some fifty at every tick of a slider.
    """

    def __init__(self, application: QApplication, parent: QObject) -> None:
        super().__init__(parent)
        self._application = application
        self._watched: QWidget | None = None
        #: Since a character was typed into a list, which searches for what follows soon.
        self._typed = QElapsedTimer()
        application.focusChanged.connect(self._follow)
        self._follow(None, application.focusWidget())

    def stop(self) -> None:
        self._application.focusChanged.disconnect(self._follow)
        self._follow(None, None)

    def _follow(self, _before: QWidget | None, now: QWidget | None) -> None:
        if self._watched is not None and shiboken6.isValid(self._watched):
            self._watched.removeEventFilter(self)
            self._watched.destroyed.disconnect(self._forget)
        self._typed.invalidate()
        self._watched = now if isinstance(now, _WATCHED) else None
        if self._watched is not None:
            self._watched.installEventFilter(self)
            self._watched.destroyed.connect(self._forget)

    def _forget(self) -> None:
        self._watched = None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Leave Space, arrows and a search to the control, Undo and Redo to the command."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            self._typed.start()
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.ShortcutOverride:
            edit = watched if isinstance(watched, QLineEdit) else watched.findChild(QLineEdit)
            keys = QKeySequence.StandardKey
            undo = event.matches(keys.Undo) and not (edit and edit.isUndoAvailable())
            redo = event.matches(keys.Redo) and not (edit and edit.isRedoAvailable())
            if undo or redo:
                event.ignore()
                return True
            if isinstance(watched, (QLineEdit, QAbstractSpinBox)):
                return False
            taken = _ARROWS if isinstance(watched, QTabBar) else (Qt.Key.Key_Space,)
            interval = self._application.keyboardInputInterval()
            searches = isinstance(watched, QComboBox) and self._typed.isValid()
            searches = searches and self._typed.elapsed() < interval and event.text().isprintable()
            if event.key() in taken or (searches and event.text()):
                event.accept()
                return True
        return False


def settle_typing() -> bool:
    """Take what is being typed, so that a command finds it; whether it was not refused."""
    field = QApplication.focusWidget()
    if isinstance(field, (NumberField, WholeField, DecimalField)):
        return field.commit()
    edit = field.lineEdit() if isinstance(field, QComboBox) else field
    if isinstance(edit, QLineEdit) and edit.isModified():
        edit.editingFinished.emit()
    return True


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


def bring_into_view(widget: QWidget) -> None:
    """Scroll the panel of a widget, which may just have been shown, until it is seen."""
    area, layout = scroll_area(widget), widget.window().layout()
    if layout is not None:
        layout.activate()
    if isinstance(area, QScrollArea):
        area.ensureWidgetVisible(widget, 0, theme.GAP)
