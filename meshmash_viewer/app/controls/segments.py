"""A row of buttons of which one is on: for the choice between a few views."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QButtonGroup, QHBoxLayout, QPushButton, QWidget

from meshmash_viewer.app import theme

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

    def __init__(
        self, name: str, accessible_name: str, choices: dict[str, str], parent: QWidget | None
    ) -> None:
        super().__init__(parent)
        theme.named(self, name, accessible_name)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(4)
        self._group = QButtonGroup(self)
        self._buttons: dict[str, QPushButton] = {}
        for key, text in choices.items():
            button = theme.named(
                QPushButton(text, self), f"{name}_{key}", f"{accessible_name}: {text}"
            )
            button.setProperty("role", "segment")
            button.setCheckable(True)
            button.clicked.connect(lambda _on=False, key=key: self.chosen.emit(key))
            self._group.addButton(button)
            self._buttons[key] = button
            row.addWidget(button)

    @property
    def key(self) -> str:
        """The key that is on."""
        return next((key for key, button in self._buttons.items() if button.isChecked()), "")

    def show_key(self, key: str) -> None:
        """Turn a key on without saying so."""
        self._buttons[key].setChecked(True)
