"""Playing: the button, and the clock that steps the field."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QPushButton

from meshmash_viewer.app import theme
from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.stepping import advance

__all__ = ["PlayButton", "Player"]


class Player(QObject):
    """Steps the field on the render while ``display.playing`` holds, round and round."""

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._step)
        listen(document.display.events.playing, self._refresh)
        listen(document.display.events.kind, self._refresh)
        listen(document.spectrum_changed, self._refresh)

    def _refresh(self) -> None:
        display, spectrum = self._document.display, self._document.known
        interval = display.family.interval
        if display.playing and spectrum is not None and interval:
            self._timer.start(interval)
        else:
            self._timer.stop()
            display.playing = False

    def _step(self) -> None:
        advance(self._document)


class PlayButton(QPushButton):
    """Starts and stops playing."""

    def __init__(self, document: Document, name: str) -> None:
        super().__init__("Play")
        tip = "Step by itself, round and round (Space)"
        theme.named(self, name, "Play: step by itself", tip=tip)
        self.setCheckable(True)
        self._document = document
        self.toggled.connect(self._toggle)
        follow(document.display.events.playing, self._refresh)

    def _toggle(self, on: bool) -> None:
        self._document.display.playing = on

    def _refresh(self) -> None:
        playing = self._document.display.playing
        self.setChecked(playing)
        self.setText("Stop" if playing else "Play")
