"""A number field for quantities that span many powers of ten, with their unit."""

from __future__ import annotations

import math

from PySide6.QtGui import QValidator
from PySide6.QtWidgets import QDoubleSpinBox, QWidget

__all__ = ["QuantityBox"]


class QuantityBox(QDoubleSpinBox):
    """A positive number written with four digits, stepped by a factor; takes "1.2e-8".

    ``setSuffix`` gives the unit, ``setPrefix("≈ ")`` marks an estimate.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setDecimals(300)
        self.setRange(1e-250, 1e250)
        self.setSpecialValueText("–")
        self.setCorrectionMode(self.CorrectionMode.CorrectToPreviousValue)

    def quantity(self) -> float:
        """The number."""
        return self.value()

    def show_quantity(self, value: float) -> None:
        """Show a number without saying that it was changed."""
        if not (math.isfinite(value) and value > 0.0):
            return
        self._set_quietly(value)

    def show_nothing(self) -> None:
        """Show a dash."""
        self._set_quietly(self.minimum())

    def _set_quietly(self, value: float) -> None:
        blocked = self.blockSignals(True)
        self.setValue(value)
        self.blockSignals(blocked)

    def textFromValue(self, value: float) -> str:
        """Write with four digits, whatever the size."""
        return f"{value:.4g}"

    def valueFromText(self, text: str) -> float:
        """Read what was typed, with or without prefix and unit."""
        number = self._number(text)
        return self.value() if number is None else number

    def validate(self, text: str, position: int) -> tuple[QValidator.State, str, int]:
        """Let a number be typed digit by digit, with its exponent last."""
        number = self._number(text)
        if number is not None and self.minimum() <= number <= self.maximum():
            return QValidator.State.Acceptable, text, position
        bare = self._bare(text)
        allowed = set("0123456789.,eE+-")
        state = QValidator.State.Intermediate if set(bare) <= allowed else QValidator.State.Invalid
        return state, text, position

    def stepBy(self, steps: int) -> None:
        """One step is a quarter of a factor of two, ten steps a factor of six."""
        self.setValue(self.value() * 2.0 ** (steps / 4.0))
        self.selectAll()

    def _bare(self, text: str) -> str:
        return text.removeprefix(self.prefix()).removesuffix(self.suffix()).strip()

    def _number(self, text: str) -> float | None:
        try:
            number = float(self._bare(text).replace(",", "."))
        except ValueError:
            return None
        return number if math.isfinite(number) else None
