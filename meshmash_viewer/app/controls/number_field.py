"""Fields that validate a number when typing is finished, not at each key."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QValidator, QWheelEvent
from PySide6.QtWidgets import QAbstractSpinBox, QSpinBox, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_whole
from meshmash_viewer.units import NO_BREAK, engineering, format_number, format_range, plain_number

#: Property of a field that has rejected its text in the event being handled.
_REFUSED = "refused"


def has_refused(within: QWidget) -> bool:
    """Return whether the event being handled made a field within a widget reject its text."""
    return any(each.property(_REFUSED) for each in within.findChildren(QAbstractSpinBox))


def _refuse(field: QAbstractSpinBox) -> None:
    """Record that the event being handled, such as a click, made a field reject its text."""
    field.setProperty(_REFUSED, True)
    QTimer.singleShot(0, field, lambda: field.setProperty(_REFUSED, None))


class WholeField(QSpinBox):
    """Spin box for a whole number between bounds, parsed on Return or when the focus leaves.

    QSpinBox drops keys that would exceed the maximum, which silently changes the typed number:
    99999 becomes 999 when the maximum is 2929. The innermost parent with a method `say_refusal`, a
    dialog or the window, shows why a text is invalid.
    """

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.setKeyboardTracking(False)
        self._fault = ""
        self.lineEdit().textEdited.connect(self._withdraw)

    def validate(self, text: str, at: int) -> tuple[QValidator.State, str, int]:
        """Accept any text while typing; text that is not a number within bounds is intermediate."""
        try:
            self.valueFromText(text)
        except InputError:
            return QValidator.State.Intermediate, text, at
        return QValidator.State.Acceptable, text, at

    def valueFromText(self, text: str) -> int:
        """Return the number in a text; raise `InputError` if it is invalid or out of bounds.

        The suffix occurs twice if the user typed it, too.
        """
        text, suffix = text.strip().removeprefix(self.prefix()), self.suffix().strip()
        while suffix and text.endswith(suffix):
            text = text.removesuffix(suffix).rstrip()
        name = self.accessibleName() or "The number"
        return parse_whole(text, self.minimum(), self.maximum(), name)

    def fixup(self, text: str) -> str:
        """Return the text of the value, and report the fault, if the finished text is invalid.

        Qt calls this when typing is finished and the text is not acceptable.
        """
        try:
            self.valueFromText(text)
        except InputError as fault:
            self._fault = str(fault)
            _refuse(self)
            QTimer.singleShot(0, self, self._report)  # after the value has been restored
            return f"{self.prefix()}{self.textFromValue(self.value())}{self.suffix()}"
        return text

    def stepBy(self, steps: int) -> None:
        """Step from the typed number, or from the value if the text is invalid."""
        super().stepBy(steps)
        self._withdraw()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Keep the focus and select the text if Return was pressed and the text was invalid."""
        super().keyPressEvent(event)
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.property(_REFUSED):
            event.accept()
            self.selectAll()

    def commit(self) -> bool:
        """Parse the text. Return False, show the reason and restore the value if invalid."""
        self.interpretText()
        return not self.property(_REFUSED)

    def _report(self) -> None:
        parent = self.parentWidget()
        while parent is not None and not hasattr(parent, "say_refusal"):
            parent = parent.parentWidget()
        if parent is not None:
            parent.say_refusal(self._fault)

    def _withdraw(self) -> None:
        if self._fault and not self.property(_REFUSED):
            self._fault = ""
            self._report()


#: Largest valid magnitude, and inverse of the smallest: squares of other numbers overflow.
_LARGEST = 1e150


class NumberField(QAbstractSpinBox):
    """Field for a number of any size, and with any unit of its kind, such as 1e-8 or 0.5 µm.

    Qt's spin boxes have a fixed number of decimals, too few for 1e-8. `quantities` parses the text.

    `limits` are fixed bounds; without them `bounds` depend on the mesh. `step(number, n)` returns
    the number n steps away; without `step` there are no arrows. A `live` field emits each valid
    number while typing. `whole` numbers are written with all digits. With `share`, percent can be
    typed. `tip` replaces the default tooltip, the number with more digits.
    """

    #: The user typed a valid number, or stepped to one.
    edited = Signal(float)
    #: Why the text is invalid, in one sentence; "" once it is corrected.
    refused = Signal(str)
    #: The user has begun to type. Numbers that a live field emits from now on may be withdrawn.
    begun = Signal()
    #: The numbers emitted since `begun` are void.
    withdrawn = Signal()

    def __init__(
        self,
        name: str,
        spoken: str,
        *,
        limits: tuple[float, float] | None = None,
        step: Callable[[float, int], float] | None = None,
        live: bool = False,
        whole: bool = False,
        share: bool = False,
        tip: str = "",
    ) -> None:
        super().__init__()
        #: Smallest and largest valid number.
        self.bounds = limits or (-math.inf, math.inf)
        self._limits = limits
        #: Returns why a number is invalid, in one sentence; "" if it is valid.
        self.fault: Callable[[float], str] = lambda _number: ""
        #: For fields in which a length can be typed instead of the number: a unit of length, and
        #: a function from a length in this unit to the number.
        self.from_length: tuple[str, Callable[[float], float]] | None = None
        theme.named(self, name, spoken, tip=tip)
        self._step, self._live, self._has_tip = step, live, bool(tip)
        self._whole, self._share = whole, share
        self._prefix = self._suffix = self._unit = ""
        #: Unit of the written number, and the power of ten by which the value is multiplied.
        self._written, self._exponent = "", 0
        self._digits = 4
        self._value: float | None = None
        #: The number typed last.
        self._typed: float | None = None
        #: The value before typing began, which is restored if the text is invalid.
        self._before: float | None = None
        self._typing = False
        #: Value, unit and bounds at the last refusal, until `refused` withdraws it.
        self._refused_at: tuple[object, ...] = ()
        if step is None:
            theme.with_role(self, "bare")  # arrows of zero width: without them Qt clips the text
            self.lineEdit().setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.0000e+00") + 16)
        self.lineEdit().textEdited.connect(self._follow_typing)

    @property
    def value(self) -> float | None:
        """The number last shown or typed."""
        return self._value

    @property
    def written_unit(self) -> str:
        """The unit of the written number, and of a number typed without a unit."""
        return self._written

    @property
    def is_typed(self) -> bool:
        """Whether the user is typing."""
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
        """Show a value of the model, unless the user is typing.

        `unit` can be typed after a number, and is written if `with_unit`; `prefix` is written
        before the number, such as "≈ " before an estimate. With `like`, the unit is scaled so that
        the number `like` has few digits, as on the render.
        """
        self._unit, self._prefix = unit, prefix
        typing = self.is_typed
        if not typing:
            self._exponent, self._written = (0, unit) if like is None else engineering(like, unit)
            self._digits = digits
        self._suffix = f"{NO_BREAK}{self._written}" if with_unit and unit else ""
        if value is not None and not self._has_tip:
            written = f"{plain_number(value, 10)}{NO_BREAK}{unit}"
            self.setToolTip(f"{self.accessibleName()}: {written}".rstrip())
        if typing:
            return
        self._value = self._before = value
        self._write()
        if self._refused_at and self._refused_at != (value, unit, self.bounds):
            self._refused_at = ()
            self.refused.emit("")

    # -- methods of QAbstractSpinBox ----------------------------------------------------------

    def sizeHint(self) -> QSize:
        return QSize(140, super().sizeHint().height())

    def stepEnabled(self) -> QAbstractSpinBox.StepEnabledFlag:
        flag = self.StepEnabledFlag
        can = self._step is not None and self._value is not None
        return flag.StepUpEnabled | flag.StepDownEnabled if can else flag.StepNone

    def stepBy(self, steps: int) -> None:
        if self._step is not None and self._value is not None:
            low, high = self.bounds
            self._emit(min(max(self._step(self._value, steps), low), high))
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
        self.commit()
        self._write()
        super().focusOutEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Restore the value on Escape; pass Return on unless the text was invalid."""
        if event.key() == Qt.Key.Key_Escape:
            typed = self.lineEdit().isModified()
            self._restore()
            if typed:
                return
        returned = event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
        valid = self.commit() if returned else True
        super().keyPressEvent(event)
        if returned and not (valid and self.hasFocus()):
            event.accept()

    # -- parsing and writing ------------------------------------------------------------------

    def _parse(self) -> float:
        """Return the number in the text; raise `InputError` if the text is invalid."""
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
            digits = 4 if self._limits else 1
            between = format_range(low, high, self._unit, word="and", digits=digits)
            if not self._limits:
                between = f"about {between} on this mesh"
            return f"{self.accessibleName()}: between {between}."
        if number and not 1.0 / _LARGEST <= abs(number) <= _LARGEST:
            return f"{format_number(number)} is out of range: write a number such as 3.1e5."
        return ""

    def _follow_typing(self) -> None:
        self.refused.emit("")
        if not self._typing:
            self._typing = True
            self.begun.emit()
        if not self._live:
            return
        try:
            number = self._parse()
            valid = not self._problem(number)
        except InputError:
            valid = False
        if not valid:
            self._withdraw()
        elif number != self._value:
            self._emit(number)

    def _withdraw(self) -> None:
        if self._value != self._before:
            self._value = self._before
            self.withdrawn.emit()

    def commit(self) -> bool:
        """Parse the text. Return False, show the reason and restore the old value if invalid."""
        if not self.lineEdit().isModified():
            return True
        try:
            number = self._parse()
            problem = self._problem(number)
        except InputError as fault:
            problem = str(fault)
        if problem:
            self._restore(problem)
            return False
        self._typing = False
        self.lineEdit().setModified(False)
        self._typed = self._before = number
        if not self._live or number != self._value:
            self._emit(number)
        return True

    def _restore(self, problem: str = "") -> None:
        """Restore the value before typing began, and emit why the text is invalid."""
        self._withdraw()
        self._typing = False
        self._write()
        if self.hasFocus():
            self.selectAll()  # the next key replaces the text
        self._refused_at = (self._value, self._unit, self.bounds) if problem else ()
        if problem:
            _refuse(self)
        self.refused.emit(problem)

    def _emit(self, number: float) -> None:
        self._value = number
        self.edited.emit(number)

    def _write(self) -> None:
        text = "–"
        if self._value is not None and self._whole:
            text = f"{self._value:.0f}"
        elif self._value is not None:
            # a typed number keeps its digits; a computed number is rounded
            digits = 10 if self._value == self._typed else self._digits
            text = plain_number(self._value * 10.0**self._exponent, digits)
        text = f"{self._prefix}{text}{self._suffix}"
        if text != self.text() or self.lineEdit().isModified():
            self.lineEdit().setText(text)
