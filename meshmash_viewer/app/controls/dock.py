"""Docks with a title bar in the colours of the theme."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QIcon, QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QApplication, QDockWidget, QLabel, QMainWindow, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import icons, make
from meshmash_viewer.app.controls.layout import row

__all__ = ["Dock"]


class _Title(QWidget):
    """A title bar that ignores double clicks, which would let the panel float without a frame."""

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Keep it from the dock."""
        event.accept()


class Dock(QDockWidget):
    """A panel ``<name>_dock`` that can be moved, dragged out by its title, and closed."""

    def __init__(self, name: str, title: str, window: QMainWindow) -> None:
        super().__init__(title, window)
        theme.named(self, f"{name}_dock", title)
        self.setWidget(QWidget())
        bar = theme.named(_Title(), "dock_title")
        bar.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        hide = f"Hide {title}"
        self._close = make.icon_button(f"{name}_dock_close", hide, self.close, tip=hide)
        self._close.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # as Qt's own; keys go by the View menu
        bar.setLayout(row((QLabel(title),), self._close, margins=(theme.MARGIN, 4, 6, 4)))
        self.setTitleBarWidget(bar)
        theme.notifier().changed.connect(self._refresh)
        self._refresh()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass on what its panel has no use for, to the window it floats over, too."""
        super().keyPressEvent(event)
        window = self.parentWidget()
        if self.isFloating() and window is not None:
            QApplication.sendEvent(window, event)

    def _refresh(self) -> None:
        self._close.setIcon(QIcon(icons.pixmap("close", theme.palette().muted, 12)))
