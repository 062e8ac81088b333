"""A row of buttons of which one is on: for the choice between a few views."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QButtonGroup, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.layout import row

__all__ = ["Segments"]


class Segments(QWidget):
    """A choice of one.

    Parameters
    ----------
    name, accessible_name : str
        Each button is named ``<name>_<key>``.
    choices : dict of str to str
        Key to text.

    Signals
    -------
    chosen(str)
        A person chose this key.
    """

    chosen = Signal(str)

    def __init__(self, name: str, accessible_name: str, choices: dict[str, str]) -> None:
        super().__init__()
        theme.named(self, name, accessible_name)
        group = QButtonGroup(self)
        self._buttons: dict[str, QPushButton] = {}
        for key, text in choices.items():
            button = make.button(
                text,
                f"{name}_{key}",
                f"{accessible_name}: {text}",
                lambda _on=False, key=key: self.chosen.emit(key),
                role="segment",
                checkable=True,
            )
            group.addButton(button)
            self._buttons[key] = button
        self.setLayout(row(*self._buttons.values(), spacing=4))

    def show_key(self, key: str) -> None:
        """Turn a key on without saying so."""
        self._buttons[key].setChecked(True)
