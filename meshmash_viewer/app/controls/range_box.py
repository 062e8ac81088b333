"""The two ends of a range, automatic until someone edits one."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.app.controls.number_field import NumberField

__all__ = ["RangeBox"]


class RangeBox(QWidget):
    """A check for automatic, and a field for each end, which always show the range in force.

    Parameters
    ----------
    names : tuple of str
        Object names of the check and of the fields for the low and the high end.
    texts : tuple of str
        What is before each of them.
    noun : str
        What is ranged over, with its article left out: "time", "eigenvalue".

    Signals
    -------
    automatic_chosen(bool)
    range_given(float, float)
        The second is above the first.
    """

    automatic_chosen = Signal(bool)
    range_given = Signal(float, float)

    def __init__(self, names: tuple[str, str, str], texts: tuple[str, str, str], noun: str) -> None:
        super().__init__()
        self._unit = ""
        self._disorder = f"The {texts[1].lower()} {noun} has to be below the {texts[2].lower()}."
        self._between: tuple[float | None, float | None] = None, None
        self.check = theme.named(QCheckBox(texts[0]), names[0], f"Range of {noun}s: automatic")
        self.check.toggled.connect(self.automatic_chosen)
        self.low = NumberField(names[1], f"{texts[1]} {noun}")
        self.high = NumberField(names[2], f"{texts[2]} {noun}")
        # A whole new range is typed in either order: an end beyond the other waits for it.
        self.low.waits = lambda low: self._fault(low, self.high.value)
        self.high.waits = lambda high: self._fault(self.low.value, high)
        self.low.waiting.connect(lambda sentence: self._wait(sentence, self.high))
        self.high.waiting.connect(lambda sentence: self._wait(sentence, self.low))
        self._units: list[QLabel] = []
        rows = []
        for text, field in ((texts[1], self.low), (texts[2], self.high)):
            name, unit = (theme.with_role(QLabel(part), "muted") for part in (text, ""))
            name.setBuddy(field)
            self._units.append(unit)
            # in a row of their own: a column that is empty would keep its distance
            rows.append((name, row((field,), unit)))
            field.edited.connect(self._give)
            field.refused.connect(self._complain)
            field.left.connect(self._settle)
        self.fault = note(f"{names[1]}_fault", "warning")
        self.setLayout(grid((self.check,), *rows, (self.fault,)))

    def show_range(
        self,
        between: tuple[float, float] | None,
        unit: str,
        bounds: tuple[float, float],
        *,
        automatic: bool,
    ) -> None:
        """Show what the model holds; None while there is no range.

        `bounds` are the least and the largest end that the mesh can have.
        """
        self.low.bounds = self.high.bounds = bounds
        show_quietly(self.check, automatic)
        for label in self._units:
            label.setText(unit)
            label.setVisible(bool(unit))
        self._between = between if between is not None else (None, None)
        self._unit = unit
        if not self._is_waiting():
            self._show()

    def _fault(self, low: float | None, high: float | None) -> str:
        return self._disorder if low is not None and high is not None and low >= high else ""

    def _show(self) -> None:
        low, high = self._between
        self.low.show_value(low, self._unit)
        self.high.show_value(high, self._unit)

    def _is_waiting(self) -> bool:
        here = self.low.hasFocus() or self.high.hasFocus()
        return here and bool(self._fault(self.low.value, self.high.value))

    def _wait(self, sentence: str, other: NumberField) -> None:
        """One end is given, beyond the other: that one is to be given next."""
        self._complain(sentence)
        if not other.hasFocus():
            other.setFocus(Qt.FocusReason.OtherFocusReason)
            other.selectAll()

    def _settle(self) -> None:
        """Who goes elsewhere before both ends are given finds the range that is in force."""
        QTimer.singleShot(0, self, lambda: None if self._is_waiting() else self._show())

    def _give(self, _value: float) -> None:
        low, high = self.low.value, self.high.value
        if low is not None and high is not None:
            self._complain("")
            self.range_given.emit(low, high)

    def _complain(self, sentence: str) -> None:
        show_note(self.fault, sentence)
