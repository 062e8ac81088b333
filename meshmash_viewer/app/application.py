"""The application object, which handles files opened from the desktop."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QEvent
from PySide6.QtGui import QFileOpenEvent
from PySide6.QtWidgets import QApplication


class Application(QApplication):
    """Opens files from macOS: double clicks, and files dropped on the icon in the Dock.

    They come as events while the program runs, not as arguments when it starts.
    """

    def event(self, event: QEvent) -> bool:
        """Open a file in the active window, or else in the newest."""
        if isinstance(event, QFileOpenEvent) and event.file():
            from meshmash_viewer.app.main_window import MainWindow

            windows = [each for each in self.topLevelWidgets() if isinstance(each, MainWindow)]
            windows = [each for each in windows if each.isVisible()]
            active = [each for each in windows if each.isActiveWindow()]
            if windows:
                (active or windows)[-1].commands.open_path(Path(event.file()))
                return True
        return super().event(event)
