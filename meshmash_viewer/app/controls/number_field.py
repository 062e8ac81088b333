"""A field for a number that may be 1e-8, with its unit."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent
from PySide6.QtWidgets import QLineEdit

from meshmash_viewer.app import theme
from meshmash_viewer.units import format_number, format_range

__all__ = ["NumberField", "read_number"]

#: Numbers beyond this size and its inverse are no quantities of meshes: their squares are none.
_LARGEST = 1e150


def read_number(text: str) -> float | None:
    """The number that a person wrote, with a comma or a point; None if it is none."""
    try:
        number = float(text.strip().replace("−", "-").replace(",", "."))
    except ValueError:
        return None
    return number if math.isfinite(number) else None


class NumberField(QLineEdit):
    """Takes a number in any notation, with or without its unit; speaks when it is finished.

    Qt's spin boxes count decimals, which is of no use for 1e-8.

    Attributes
    ----------
    bounds : tuple of float
        Least and largest number that is taken.
    fault : callable
        What else is wrong with a number, in one sentence; empty if it is taken.
    waits : callable
        Why a number has to wait for another one to be given too, in one sentence; it stays, as
        `value`, and `waiting` is emitted in the place of `edited`.

    Signals
    -------
    edited(float)
        A person gave a new number that is allowed.
    refused(str)
        One sentence: what was wrong with what they gave; empty once it is mended.
    waiting(str)
        One sentence: what they gave needs another number; see `waits`.
    left()
        The focus has gone elsewhere.
    """

    edited = Signal(float)
    refused = Signal(str)
    waiting = Signal(str)
    left = Signal()

    def __init__(self, name: str, accessible_name: str) -> None:
        super().__init__()
        self.bounds = -math.inf, math.inf
        self.fault: Callable[[float], str] = lambda _value: ""
        self.waits: Callable[[float], str] = lambda _value: ""
        theme.named(self, name, accessible_name)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.0000e+00") + 16)
        self._unit = ""
        self._value: float | None = None
        self._given: float | None = None
        self._quiet = True
        self._refused = False
        self.returnPressed.connect(self._commit)
        self.textEdited.connect(self._forgive)

    @property
    def value(self) -> float | None:
        """The number last shown or given."""
        return self._value

    def show_value(self, value: float | None, unit: str = "") -> None:
        """Show what the model holds, unless someone is typing."""
        self._unit = unit
        if value is not None:
            self.setToolTip(f"{self.accessibleName()}: {value:.10g} {unit}".rstrip())
        if value == self._value and self._quiet and self.text():
            return
        self._value = value
        if not (self.hasFocus() and self.isModified()):
            self._restore()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Take what was typed; if it is no number, go back to what was."""
        self._commit()
        self._write()
        super().focusOutEvent(event)
        self.left.emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Escape goes back to what was."""
        if event.key() == Qt.Key.Key_Escape:
            modified = self.isModified()
            self._restore()
            if modified:
                return
        self._refused = False
        super().keyPressEvent(event)
        if self._refused:
            event.accept()  # stays here to be mended

    def _write(self) -> None:
        self._quiet = True
        # what was typed stays as it was; what was computed is written as everywhere else
        digits = 10 if self._value == self._given else 4
        self.setText("" if self._value is None else format_number(self._value, digits))
        self.setModified(False)

    def _restore(self) -> None:
        self._write()
        self._forgive()

    def _commit(self) -> None:
        if not self.isModified():
            return
        value = read_number(self.text().strip().removesuffix(self._unit))
        if value is None:
            self._refuse(f"{self.text().strip() or 'Nothing'} is not a number: write 3.1e5.")
            return
        low, high = self.bounds
        if not low <= value <= high:
            between = format_range(low, high, self._unit, word="and", digits=1)
            self._refuse(f"{self.accessibleName()}: between about {between} on this mesh.")
            return
        if value and not 1.0 / _LARGEST <= abs(value) <= _LARGEST:
            self._refuse(f"{value:g} is no size of a mesh: write a number such as 3.1e5.")
            return
        if fault := self.fault(value):
            self._refuse(fault)
            return
        self._value = self._given = value
        self._quiet = False
        self.setModified(False)
        if sentence := self.waits(value):
            self._refused = True
            self.waiting.emit(sentence)
        else:
            self.edited.emit(value)

    def _refuse(self, sentence: str) -> None:
        """Go back to what was, and say why until something else is typed."""
        self._restore()
        self._refused = True
        self.refused.emit(sentence)

    def _forgive(self) -> None:
        self.refused.emit("")
