"""Which columns of a family: from one to another, every so many."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.controls.spin import WholeField

__all__ = ["ColumnRange"]


class ColumnRange(QWidget):
    """Three numbers; the last column is one of them, as people count.

    Parameters
    ----------
    owner : str
        Its controls are called after it.
    """

    changed = Signal()

    def __init__(self, owner: str) -> None:
        super().__init__()
        self.first_spin = self._spin(f"{owner}_first_spin", "First column")
        self.last_spin = self._spin(f"{owner}_last_spin", "Last column")
        self.step_spin = self._spin(f"{owner}_step_spin", "Every how many columns", 1)
        self.setLayout(
            row(
                self.first_spin,
                QLabel("to"),
                self.last_spin,
                QLabel("every"),
                self.step_spin,
                None,
            )
        )

    def _spin(self, name: str, accessible: str, least: int = 0) -> WholeField:
        spin = theme.named(WholeField(minimum=least), name, accessible)
        spin.valueChanged.connect(self.changed)
        return spin

    @property
    def columns(self) -> range:
        """Those that are chosen."""
        first, last = sorted((self.first_spin.value(), self.last_spin.value()))
        return range(first, last + 1, self.step_spin.value())

    @property
    def most(self) -> int:
        """How many there are."""
        return self.last_spin.maximum() + 1

    def choose(self, columns: range, most: int) -> None:
        """Show some of so many, without a word."""
        for spin, value, largest in (
            (self.first_spin, columns[0], most - 1),
            (self.last_spin, columns[-1], most - 1),
            (self.step_spin, columns.step, max(most - 1, 1)),
        ):
            with QSignalBlocker(spin):
                spin.setMaximum(largest)
                spin.setValue(value)
