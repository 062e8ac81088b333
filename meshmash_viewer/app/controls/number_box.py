"""Number fields whose limits come from the mesh: quantities of any size, and counts."""

from __future__ import annotations

import math

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QValidator
from PySide6.QtWidgets import QDoubleSpinBox

from meshmash_viewer.app.controls.facts import show_quietly
from meshmash_viewer.app.controls.number_field import read_number
from meshmash_viewer.units import format_number

__all__ = ["CountBox", "QuantityBox", "dress"]

#: What a number can be written with.
_CHARACTERS = set("0123456789.,eE+-−")


class QuantityBox(QDoubleSpinBox):
    """A positive number written with four digits, stepped by a factor; takes "1.2e-8".

    ``setSuffix`` gives the unit, ``setPrefix("≈ ")`` marks an estimate.
    """

    #: A number was given that is out of bounds; the one before is shown again.
    refused = Signal(float)

    def __init__(self) -> None:
        #: Bounds of what can be typed; those of Qt hold for what is shown, too.
        self.bounds = (1e-150, 1e150)
        self._before = 1.0
        self._refused = False
        super().__init__()
        self.editingFinished.connect(self._remember)
        self.setDecimals(300)
        self.setRange(1e-150, 1e150)
        self.setSpecialValueText("–")
        self.setCorrectionMode(self.CorrectionMode.CorrectToPreviousValue)

    def show_quantity(self, value: float) -> None:
        """Show a number without saying that it was changed."""
        if math.isfinite(value) and value > 0.0:
            show_quietly(self, value)

    def show_nothing(self) -> None:
        """Show a dash."""
        show_quietly(self, self.minimum())

    def textFromValue(self, value: float) -> str:
        """Write with four digits, whatever the size."""
        return format_number(value)

    def valueFromText(self, text: str) -> float:
        """Read what was typed, with or without prefix and unit."""
        number = read_number(_bare(self, text))
        return self.value() if number is None else number

    def validate(self, text: str, position: int) -> tuple[QValidator.State, str, int]:
        """Let a number be typed digit by digit, with its exponent last."""
        number = read_number(_bare(self, text))
        if number is not None and self._is_allowed(number):
            return QValidator.State.Acceptable, text, position
        possible = set(_bare(self, text)) <= _CHARACTERS
        state = QValidator.State.Intermediate if possible else QValidator.State.Invalid
        return state, text, position

    def fixup(self, text: str) -> str:
        """Go back to the number before, and say so if what was typed is out of bounds."""
        number = read_number(_bare(self, text))
        if number is not None:
            self._refuse(number)
        return f"{self.prefix()}{self._before!r}{self.suffix()}"

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Remember the number: parts of the one that is typed may be numbers, too."""
        super().focusInEvent(event)
        self._remember()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass Return on once the number is taken; what is refused stays here to be mended."""
        self._refused = False
        super().keyPressEvent(event)
        if self._refused:
            event.accept()

    def _refuse(self, number: float) -> None:
        self._refused = True
        self.refused.emit(number)

    def _remember(self) -> None:
        self._before = self.value()

    def stepBy(self, steps: int) -> None:
        """One step is a quarter of a factor of two, ten steps a factor of six."""
        low, high = self.bounds
        self.setValue(min(max(self.value() * 2.0 ** (steps / 4.0), low), high))
        self.selectAll()

    def _is_allowed(self, number: float) -> bool:
        return self.bounds[0] <= number <= self.bounds[1]


class CountBox(QuantityBox):
    """A whole number; one beyond its bounds becomes the nearest within them."""

    def __init__(self) -> None:
        super().__init__()
        self.setDecimals(0)
        self.setSpecialValueText("")

    def textFromValue(self, value: float) -> str:
        """Write all digits."""
        return f"{value:.0f}"

    def stepBy(self, steps: int) -> None:
        """One step is ``singleStep``."""
        QDoubleSpinBox.stepBy(self, steps)

    def fixup(self, text: str) -> str:
        """Take the nearest number that is allowed, and say so."""
        number = read_number(_bare(self, text))
        if number is None:
            return self.textFromValue(self.value())
        self._refuse(number)
        return self.textFromValue(min(max(number, self.bounds[0]), self.bounds[1]) // 1.0)

    def _is_allowed(self, number: float) -> bool:
        return super()._is_allowed(number) and number == int(number)


def dress(box: QuantityBox, prefix: str, suffix: str) -> None:
    """Put words before and after a number, and leave what is being typed as it is.

    Qt would write it anew: of "1e9", on the way to 1e99, it makes "1e+09".
    """
    if (prefix, suffix) == (box.prefix(), box.suffix()):
        return
    edit = box.lineEdit()
    typed, place = _bare(box, edit.text()), edit.cursorPosition() - len(box.prefix())
    typing = box.hasFocus() and edit.isModified()
    with QSignalBlocker(box):
        box.setPrefix(prefix)
        box.setSuffix(suffix)
        if typing:
            edit.setText(f"{prefix}{typed}{suffix}")
            edit.setCursorPosition(place + len(prefix))
            edit.setModified(True)


def _bare(box: QuantityBox, text: str) -> str:
    return text.removeprefix(box.prefix()).removesuffix(box.suffix()).strip()
