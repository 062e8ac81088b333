"""Event filters that choose between field, panel and command for a key or the wheel."""

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
from meshmash_viewer.app.controls.number_field import NumberField, WholeField

_WATCHED = (QAbstractButton, QComboBox, QTabBar, QLineEdit, QAbstractSpinBox)
_ARROWS = (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Home, Qt.Key.Key_End)


class FocusKeys(QObject):
    """Event filter of the focused widget, for keys that are also shortcuts of commands.

    Space presses the focused button or opens the focused list. Undo and Redo are commands while
    the focused field has nothing to undo; Qt's fields would accept the keys without effect.

    Only the focused widget is filtered: a filter of the application would call Python for each
    event, about fifty times per step of a slider.
    """

    def __init__(self, application: QApplication, parent: QObject) -> None:
        super().__init__(parent)
        self._application = application
        self._watched: QWidget | None = None
        #: Time since a character was typed in a list, to search its entries.
        self._searched = QElapsedTimer()
        application.focusChanged.connect(self._follow)
        self._follow(None, application.focusWidget())

    def stop(self) -> None:
        self._application.focusChanged.disconnect(self._follow)
        self._follow(None, None)

    def _follow(self, _before: QWidget | None, now: QWidget | None) -> None:
        if self._watched is not None and shiboken6.isValid(self._watched):
            self._watched.removeEventFilter(self)
            self._watched.destroyed.disconnect(self._forget)
        self._searched.invalidate()
        self._watched = now if isinstance(now, _WATCHED) else None
        if self._watched is not None:
            self._watched.installEventFilter(self)
            self._watched.destroyed.connect(self._forget)

    def _forget(self) -> None:
        self._watched = None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Accept the shortcut override of keys that the widget handles; ignore it for commands."""
        if not isinstance(event, QKeyEvent):
            return False
        character = event.text() if event.text().isprintable() else ""
        if event.type() == QEvent.Type.KeyPress and character.strip():
            self._searched.start()
        if event.type() != QEvent.Type.ShortcutOverride:
            return False
        edit = watched if isinstance(watched, QLineEdit) else watched.findChild(QLineEdit)
        keys = QKeySequence.StandardKey
        undo = event.matches(keys.Undo) and not (edit and edit.isUndoAvailable())
        redo = event.matches(keys.Redo) and not (edit and edit.isRedoAvailable())
        if undo or redo:
            event.ignore()
            return True
        if isinstance(watched, (QLineEdit, QAbstractSpinBox)):
            return False
        own = event.key() in (_ARROWS if isinstance(watched, QTabBar) else (Qt.Key.Key_Space,))
        if isinstance(watched, QComboBox) and character and self._searched.isValid():
            own |= self._searched.elapsed() < self._application.keyboardInputInterval()
        if own:
            event.accept()
        return own


def settle_typing() -> bool:
    """Commit the text of the focused field before a command; return False if it is invalid."""
    field = QApplication.focusWidget()
    if isinstance(field, (NumberField, WholeField)):
        return field.commit()
    edit = field.lineEdit() if isinstance(field, QComboBox) else field
    if isinstance(edit, QLineEdit) and edit.isModified():
        edit.editingFinished.emit()
    return True


_FIELDS = (QAbstractSpinBox, QComboBox, QAbstractSlider, QTabBar)
_NOTCH = 120  # in eighths of a degree, the unit of Qt
#: A panel is being scrolled until this many milliseconds after its last wheel event.
_TURN = 400


class FieldWheel(QObject):
    """Event filter of all fields that passes wheel events to the panel around a field.

    A field handles the wheel only if it has the focus and its panel is not being scrolled, by the
    wheel or by the momentum of a trackpad.

    Call `watch` after adding fields.
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._scrolled: QAbstractScrollArea | None = None
        self._since = QElapsedTimer()
        self._turned = 0

    def watch(self, within: QWidget) -> None:
        """Install the filter on a widget and the fields in it; repeated calls have no effect."""
        for field in (within, *within.findChildren(QWidget)):
            if field.focusPolicy() == Qt.FocusPolicy.WheelFocus:  # the wheel would give focus
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
        if not isinstance(watched, _FIELDS):  # the viewport of an area
            self._scrolled = area
            self._since.start()
            return False
        scrolling = area is not None and area is self._scrolled and self._since.elapsed() < _TURN
        if watched.hasFocus() and not scrolling:
            return self._is_partial(watched, event)
        event.ignore()
        if area is not None:
            QApplication.sendEvent(area.viewport(), event)
        return True

    def _is_partial(self, field: QWidget, event: QWheelEvent) -> bool:
        """Return whether to drop an event: momentum, or less than a notch over a combo box.

        Qt's combo boxes step at each event, however small.
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
    """Return the innermost scroll area around a widget."""
    parent = widget.parentWidget()
    while parent is not None and not isinstance(parent, QAbstractScrollArea):
        parent = parent.parentWidget()
    return parent


def bring_into_view(widget: QWidget) -> None:
    """Scroll the panel of a widget until the widget is visible, even if it was just shown."""
    area, layout = scroll_area(widget), widget.window().layout()
    if layout is not None:
        layout.activate()
    if isinstance(area, QScrollArea):
        area.ensureWidgetVisible(widget, 0, theme.GAP)
