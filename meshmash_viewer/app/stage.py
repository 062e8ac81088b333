"""The middle of the window: the welcome or the render, with the message bar over it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from PySide6.QtWidgets import QSplitter, QStackedLayout, QWidget

from meshmash_viewer.app.controls.message_bar import MessageBar
from meshmash_viewer.app.screen import has_opengl
from meshmash_viewer.app.welcome import Welcome

__all__ = ["Stage"]


class Stage(QWidget):
    """Shows one of two pages; the message bar floats over either."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("stage")
        self.setMinimumSize(280, 240)
        # A window without anything of OpenGL would be made again, and blink, when the render comes;
        # one with it stays black where there is none.
        if has_opengl():
            QOpenGLWidget(self).hide()
        self._pages = QStackedLayout(self)
        self.welcome = Welcome()
        self._pages.addWidget(self.welcome)
        self._scene: QSplitter | None = None
        self.message_bar = MessageBar(self)

    def set_scene(self, scene: QWidget) -> None:
        """Take the render as the second page."""
        self._scene = QSplitter(Qt.Orientation.Horizontal)
        self._scene.setChildrenCollapsible(False)
        self._scene.addWidget(scene)
        self._pages.addWidget(self._scene)
        self.message_bar.raise_()

    def put_beside(self, other: QWidget) -> None:
        """Put something beside the render, as wide."""
        assert self._scene is not None
        self._scene.addWidget(other)
        self._scene.setSizes([1000, 1000])

    def show_scene(self, shown: bool) -> None:
        """Show the render, or the welcome."""
        page = self._scene if shown and self._scene is not None else self.welcome
        if self._pages.currentWidget() is not page:
            self._pages.setCurrentWidget(page)
        if self.message_bar.isVisible():
            self.message_bar.raise_()
