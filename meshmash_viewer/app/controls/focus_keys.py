"""Keys of the field with the focus: which it keeps from commands, and what a command does to it."""

from __future__ import annotations

import shiboken6
from PySide6.QtCore import QElapsedTimer, QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QTabBar,
    QWidget,
)

from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.spin import DecimalField, WholeField

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
        """Watch nothing any more."""
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
