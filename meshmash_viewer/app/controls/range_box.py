"""The two ends of a range, automatic until someone edits one."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.app.controls.number_field import NumberField


class RangeBox(QWidget):
    """A check for automatic, and a field for each end, which always show the range in force.

    A whole new range is typed in either order: an end beyond the other waits for it. `names` and
    `texts` are object names and labels of the check, the low and the high end; `noun` is the
    quantity, "time".
    """

    automatic_chosen = Signal(bool)
    #: Low and high end, in this order.
    range_given = Signal(float, float)

    def __init__(self, names: tuple[str, str, str], texts: tuple[str, str, str], noun: str) -> None:
        super().__init__()
        self._unit = ""
        self._disorder = f"The {texts[1].lower()} {noun} has to be below the {texts[2].lower()}."
        self._between: tuple[float | None, float | None] = None, None
        self.check = make.check(
            texts[0], names[0], f"Range of {noun}s: automatic", self.automatic_chosen
        )
        self.low = NumberField(names[1], f"{texts[1]} {noun}")
        self.high = NumberField(names[2], f"{texts[2]} {noun}")
        self.fault = note(f"{names[1]}_fault", "warning")
        self._units: list[QLabel] = []
        rows = []
        for text, field, other in (
            (texts[1], self.low, self.high), (texts[2], self.high, self.low)
        ):  # fmt: skip
            name, unit = make.muted(text), make.muted()
            name.setBuddy(field)
            self._units.append(unit)
            # in a row of their own: a column that is empty would keep its distance
            rows.append((name, row((field,), unit)))
            field.edited.connect(lambda _number, other=other: self._give(other))
            field.refused.connect(lambda sentence: show_note(self.fault, sentence))
            field.editingFinished.connect(self._settle)
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

    def _show(self) -> None:
        for field, end in zip((self.low, self.high), self._between, strict=True):
            field.show_value(end, self._unit)

    def _is_waiting(self) -> bool:
        """Whether one end is given, beyond the other, and that one is about to be."""
        low, high = self.low.value, self.high.value
        here = self.low.hasFocus() or self.high.hasFocus()
        return here and low is not None and high is not None and low >= high

    def _settle(self) -> None:
        """Who goes elsewhere before both ends are given finds the range that is in force."""
        QTimer.singleShot(0, self, lambda: None if self._is_waiting() else self._show())

    def _give(self, other: NumberField) -> None:
        low, high = self.low.value, self.high.value
        if low is None or high is None:
            return
        show_note(self.fault, "" if low < high else self._disorder)
        if low < high:
            self.range_given.emit(low, high)
        elif not other.hasFocus():
            other.setFocus(Qt.FocusReason.OtherFocusReason)
            other.selectAll()
