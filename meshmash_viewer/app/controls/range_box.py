"""The two ends of a range, automatic until someone edits one."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QHBoxLayout, QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import note, show_note
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

    def __init__(
        self,
        names: tuple[str, str, str],
        texts: tuple[str, str, str],
        noun: str,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._unit = ""
        self._disorder = f"The {texts[1].lower()} {noun} has to be below the {texts[2].lower()}."
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(theme.GAP)
        grid.setVerticalSpacing(theme.GAP // 2)
        grid.setColumnStretch(1, 1)
        self.check = theme.named(
            QCheckBox(texts[0], self), names[0], f"Range of {noun}s: automatic"
        )
        self.check.toggled.connect(self.automatic_chosen)
        grid.addWidget(self.check, 0, 0, 1, 2)
        self.low = NumberField(names[1], f"{texts[1]} {noun}", self)
        self.high = NumberField(names[2], f"{texts[2]} {noun}", self)
        # A whole new range is typed in either order: an end beyond the other waits for it.
        self.low.waits = lambda low: self._fault(low, self.high.value)
        self.high.waits = lambda high: self._fault(self.low.value, high)
        self.low.waiting.connect(lambda sentence: self._wait(sentence, self.high))
        self.high.waiting.connect(lambda sentence: self._wait(sentence, self.low))
        self._between: tuple[float | None, float | None] = None, None
        self._units: list[QLabel] = []
        for row, (text, field) in enumerate(((texts[1], self.low), (texts[2], self.high)), 1):
            name, unit = (theme.with_role(QLabel(part, self), "muted") for part in (text, ""))
            name.setBuddy(field)
            self._units.append(unit)
            # in a row of their own: a column that is empty would keep its distance
            line = QHBoxLayout()
            line.setSpacing(theme.GAP)
            line.addWidget(field, 1)
            line.addWidget(unit)
            grid.addWidget(name, row, 0)
            grid.addLayout(line, row, 1)
            field.edited.connect(self._give)
            field.refused.connect(self._complain)
            field.left.connect(self._settle)
        self.fault = note(f"{names[1]}_fault", "warning", self)
        grid.addWidget(self.fault, 3, 0, 1, 2)

    def show_range(
        self, between: tuple[float, float] | None, unit: str, *, automatic: bool
    ) -> None:
        """Show what the model holds; None while there is no range."""
        with QSignalBlocker(self.check):
            self.check.setChecked(automatic)
        for label in self._units:
            label.setText(unit)
            label.setVisible(bool(unit))
        self._between = between if between is not None else (None, None)
        self._unit = unit
        if not self._is_waiting():
            self._show()

    def set_bounds(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        """Say what the mesh can have: the least and the largest for each end."""
        self.low.bounds, self.high.bounds = low, high

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
