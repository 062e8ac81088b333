"""A field for a number that may be 1e-8, with its unit."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QWheelEvent
from PySide6.QtWidgets import QAbstractSpinBox, QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import grid, row
from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_quantity
from meshmash_viewer.units import NO_BREAK, engineering, format_number, format_range, plain_number

#: Numbers beyond this size and its inverse are no quantities of meshes: their squares are none.
_LARGEST = 1e150


class NumberField(QAbstractSpinBox):
    """Takes a number as people write one, in any unit of its kind, once it is finished.

    Qt's own spin boxes count decimals, which is of no use for 1e-8. `quantities` says what is read.

    `step` returns the number that is some steps from another; without it there are no arrows. If
    `live`, each number on the way to the one that is typed is emitted, too. `nearest` takes the
    nearest number within bounds for one beyond them, rather than the previous one. `whole` counts,
    and writes all digits; `share` reads percent, too. `tip` is the tooltip, by default the number
    with more digits.
    """

    #: The user gave a number that is allowed.
    edited = Signal(float)
    #: What is wrong with the text, in one sentence; empty once it is corrected.
    refused = Signal(str)
    #: The user begins to type; numbers of a live field may be withdrawn from now on.
    begun = Signal()
    #: The numbers emitted since `begun` are void.
    withdrawn = Signal()

    def __init__(
        self,
        name: str,
        spoken: str,
        *,
        step: Callable[[float, int], float] | None = None,
        live: bool = False,
        nearest: bool = False,
        whole: bool = False,
        share: bool = False,
        tip: str = "",
    ) -> None:
        super().__init__()
        #: Smallest and largest number that is taken.
        self.bounds = -math.inf, math.inf
        #: What is wrong with a number, in one sentence; empty if it is taken.
        self.fault: Callable[[float], str] = lambda _number: ""
        #: A unit of length, and the number that a length in it means; None if it means none.
        self.from_length: tuple[str, Callable[[float], float]] | None = None
        #: Whether the event that is being handled, such as the press of a button, has led to a
        #: refusal.
        self.just_refused = False
        theme.named(self, name, spoken, tip=tip)
        self._step, self._live, self._nearest = step, live, nearest
        self._whole, self._share = whole, share
        self._tipped = bool(tip)
        #: What `show_value` was given last.
        self._shown: tuple[object, ...] = ()
        self._prefix = self._suffix = self._unit = ""
        #: Unit of the number that is written, and the power of ten by which it is multiplied.
        self._written, self._exponent = "", 0
        self._digits = 4
        self._value: float | None = None
        self._given: float | None = None
        #: What to go back to: parts of the number that is typed may be numbers, too.
        self._before: float | None = None
        self._typing = False
        #: Number, unit and bounds at the last refusal, until `refused` withdraws that.
        self._refused_at: tuple[object, ...] = ()
        if step is None:
            theme.with_role(self, "bare")  # of no width: without any, Qt leaves no room for text
            self.lineEdit().setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.0000e+00") + 16)
        self.lineEdit().textEdited.connect(self._follow_typing)

    @property
    def value(self) -> float | None:
        """The number last shown or given."""
        return self._value

    @property
    def written_unit(self) -> str:
        """The unit in which the number is written, and a number alone is read."""
        return self._written

    @property
    def is_typed(self) -> bool:
        """Whether someone is typing."""
        return self.hasFocus() and self.lineEdit().isModified()

    def show_value(
        self,
        value: float | None,
        unit: str = "",
        prefix: str = "",
        *,
        with_unit: bool = False,
        like: float | None = None,
        digits: int = 4,
    ) -> None:
        """Show what the model holds, unless someone is typing.

        `unit` may be typed behind a number, and is written there if asked for; `prefix` comes
        before it, as "≈ " before an estimate. With `like`, the number is written, and read, in a
        unit of this size, as numbers on the render are.
        """
        shown = value, unit, prefix, with_unit, like, digits
        same = shown == self._shown and value == self._value and not self._refused_at
        if same and not self.lineEdit().isModified():
            return
        self._shown = shown
        self._unit, self._prefix = unit, prefix
        if not self.is_typed:
            self._exponent, self._written = (0, unit) if like is None else engineering(like, unit)
            self._digits = digits
        self._suffix = f"{NO_BREAK}{self._written}" if with_unit and unit else ""
        if value is not None and not self._tipped:
            written = f"{plain_number(value, 10)}{NO_BREAK}{unit}"
            self.setToolTip(f"{self.accessibleName()}: {written}".rstrip())
        if not self.is_typed:
            self._value = self._before = value
            self._write()
            if self._refused_at and self._refused_at != (value, unit, self.bounds):
                self._refused_at = ()
                self.refused.emit("")

    # -- what Qt asks of a spin box -----------------------------------------------------------

    def sizeHint(self) -> QSize:
        return QSize(140, super().sizeHint().height())

    def stepEnabled(self) -> QAbstractSpinBox.StepEnabledFlag:
        flag = self.StepEnabledFlag
        can = self._step is not None and self._value is not None
        return flag.StepUpEnabled | flag.StepDownEnabled if can else flag.StepNone

    def stepBy(self, steps: int) -> None:
        if self._step is not None and self._value is not None:
            self._take(self._within(self._step(self._value, steps)))
            self._before = self._value
            self._typing = False
            self._write()
            self.selectAll()

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self._step is None:
            event.ignore()
        else:
            super().wheelEvent(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Take what was typed; if it is no number, go back to what was."""
        self.commit()
        self._write()
        super().focusOutEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Restore the value on Escape; pass Return on unless the text was refused."""
        if event.key() == Qt.Key.Key_Escape:
            typed = self.lineEdit().isModified()
            self._go_back("")
            if typed:
                return
        returned = event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
        taken = self.commit() if returned else True
        super().keyPressEvent(event)
        if returned and not (taken and self.hasFocus()):
            event.accept()

    # -- numbers ------------------------------------------------------------------------------

    def _typed(self) -> float:
        """The number that is typed; `InputError` says why it is none."""
        try:
            number = parse_number(self.text(), self._written, share=self._share, whole=self._whole)
        except InputError:
            if self.from_length is None:
                raise
            unit, number_of = self.from_length
            return number_of(parse_quantity(self.text()).in_unit(unit))
        return float(f"{number * 10.0**-self._exponent:.15g}") if self._exponent else number

    def _problem(self, number: float) -> str:
        low, high = self.bounds
        if fault := self.fault(number):
            return fault
        if not low <= number <= high:
            between = format_range(low, high, self._unit, word="and", digits=1)
            return f"{self.accessibleName()}: between about {between} on this mesh."
        if number and not 1.0 / _LARGEST <= abs(number) <= _LARGEST:
            return f"{format_number(number)} is no size of a mesh: write a number such as 3.1e5."
        return ""

    def _within(self, number: float) -> float:
        nearest = min(max(number, self.bounds[0]), self.bounds[1])
        return nearest // 1.0 if self._whole else nearest

    def _follow_typing(self) -> None:
        self.refused.emit("")
        if not self._typing:
            self._typing = True
            self.begun.emit()
        if not self._live:
            return
        try:
            number = self._typed()
        except InputError:
            self._withdraw()
            return
        if self._problem(number):
            self._withdraw()
        elif number != self._value:
            self._take(number)

    def _withdraw(self) -> None:
        if self._value != self._before:
            self._value = self._before
            self.withdrawn.emit()

    def commit(self) -> bool:
        """Take what is typed, or say why not and go back; whether there was nothing to refuse."""
        if not self.lineEdit().isModified():
            return True
        number: float | None = None
        try:
            number = self._typed()
            problem = self._problem(number)
        except InputError as fault:
            problem = str(fault)
        if problem:
            if self._nearest and number is not None:
                self._before = self._within(number)
                self._take(self._before)
            self._go_back(problem)
            return False
        assert number is not None
        self._typing = False
        self.lineEdit().setModified(False)
        self._given = self._before = number
        if not self._live or number != self._value:
            self._take(number)
        return True

    def _go_back(self, problem: str) -> None:
        self._withdraw()
        self._typing = False
        self._write()
        if self.hasFocus():
            self.selectAll()  # to be typed over
        self._refused_at = (self._value, self._unit, self.bounds) if problem else ()
        if problem:
            self.just_refused = True
            QTimer.singleShot(0, self, self._forget_refusal)
        self.refused.emit(problem)

    def _forget_refusal(self) -> None:
        self.just_refused = False

    def _take(self, number: float) -> None:
        self._value = number
        self.edited.emit(number)

    def _write(self) -> None:
        text = "–"
        if self._value is not None and self._whole:
            text = f"{self._value:.0f}"
        elif self._value is not None:
            # what was typed stays as it was; what was computed is written as everywhere else
            digits = 10 if self._value == self._given else self._digits
            text = plain_number(self._value * 10.0**self._exponent, digits)
        text = f"{self._prefix}{text}{self._suffix}"
        if text != self.text() or self.lineEdit().isModified():
            self.lineEdit().setText(text)


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
