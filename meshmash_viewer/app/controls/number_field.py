"""Fields for numbers, which take what is typed whole or refuse it: with arrows, or for 1e-8.

Qt's own pass over the keys that would lead out of bounds: of "99999" a field up to 2,929 keeps 999.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QValidator, QWheelEvent
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QSpinBox, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.errors import InputError
from meshmash_viewer.quantities import parse_number, parse_quantity, parse_whole
from meshmash_viewer.units import NO_BREAK, engineering, format_number, format_range, plain_number

if TYPE_CHECKING:

    class _Spin(QAbstractSpinBox):
        def value(self) -> Any: ...
        def prefix(self) -> str: ...
        def suffix(self) -> str: ...
        def textFromValue(self, value: Any) -> str: ...

else:
    _Spin = object

#: Decimals that a number may be typed with.
_DECIMALS = 6


def show_refusal(field: QWidget, sentence: str) -> None:
    """Show why a field refuses what was typed, or, if empty, that it does so no longer.

    The innermost parent with a method `say_refusal` shows it, as windows and dialogs do.
    """
    parent = field.parentWidget()
    while parent is not None and not hasattr(parent, "say_refusal"):
        parent = parent.parentWidget()
    if parent is not None:
        parent.say_refusal(sentence)


def typed_fields(within: QWidget) -> list[WholeField | DecimalField]:
    """All fields of these two kinds within a widget."""
    return [*within.findChildren(WholeField), *within.findChildren(DecimalField)]


class _Typed(_Spin):
    """What both have in common: anything can be typed, and is read once it is finished."""

    #: Whether what was typed has been refused by the event that is being handled.
    just_refused: bool
    #: What it held before someone began to type.
    _before: Any

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.just_refused, self._before, self._fault = False, None, ""
        self.lineEdit().textEdited.connect(self._note_before)

    def validate(self, text: str, at: int) -> tuple[QValidator.State, str, int]:
        """Let anything be typed; what is no number within bounds is not taken."""
        try:
            self._read(text)
        except InputError:
            return QValidator.State.Intermediate, text, at
        return QValidator.State.Acceptable, text, at

    def valueFromText(self, text: str) -> Any:
        return self._read(text)

    def fixup(self, text: str) -> str:
        """Go back to what was and say why: Qt asks this of what is finished and not acceptable."""
        try:
            self._read(text)
        except InputError as fault:
            self.just_refused, self._fault = True, str(fault)
            QTimer.singleShot(0, self, self._say_refusal)  # once it has gone back
            before = self.value() if self._before is None else self._before
            return f"{self.prefix()}{self.textFromValue(before)}{self.suffix()}"
        return text

    def focusInEvent(self, event: QFocusEvent) -> None:
        self._before = None
        super().focusInEvent(event)

    def stepBy(self, steps: int) -> None:
        """Step from what is typed, or from what was."""
        super().stepBy(steps)
        self._before = None
        self._forget_refusal()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Keep Return here where what it finishes is refused, to be typed over."""
        super().keyPressEvent(event)
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
            self._before = None
            if self.just_refused:
                event.accept()
                self.selectAll()

    def _note_before(self) -> None:
        if self._before is None:
            self._before = self.value()  # Qt takes what is typed after this
        self._forget_refusal()

    def commit(self) -> bool:
        """Take what is typed, or say why not and go back; whether there was nothing to refuse."""
        self.interpretText()
        return not self.just_refused

    def _say_refusal(self) -> None:
        self.just_refused = False
        show_refusal(self, self._fault)

    def _forget_refusal(self) -> None:
        if self._fault and not self.just_refused:
            self._fault = ""
            show_refusal(self, "")

    def _bare(self, text: str) -> str:
        """A text without suffixes: one may be typed before the other."""
        text, suffix = text.strip().removeprefix(self.prefix()), self.suffix().strip()
        while suffix and text.endswith(suffix):
            text = text.removesuffix(suffix).rstrip()
        return text

    def _read(self, text: str) -> Any:
        raise NotImplementedError


class WholeField(_Typed, QSpinBox):
    """A whole number between bounds."""

    def _read(self, text: str) -> int:
        name = self.accessibleName() or "The number"
        return parse_whole(self._bare(text), self.minimum(), self.maximum(), name)


class DecimalField(_Typed, QDoubleSpinBox):
    """A number between bounds, written with at least so many decimals; its suffix is its unit."""

    def __init__(self, *, decimals: int, **given: Any) -> None:
        self._decimals = decimals
        super().__init__(decimals=_DECIMALS, **given)

    def textFromValue(self, value: float) -> str:
        """The number with no more zeros than it has to have."""
        whole, _, part = f"{value:.{_DECIMALS}f}".partition(".")
        return f"{whole}.{part.rstrip('0'):0<{self._decimals}}".rstrip(".")

    def _read(self, text: str) -> float:
        text, unit = self._bare(text), self.suffix().strip()
        number, low, high = parse_number(text, unit), self.minimum(), self.maximum()
        if not low <= number <= high:
            between = format_range(low, high, unit, word="and")
            name = self.accessibleName() or "The number"
            raise InputError(f"{name} is between {between}, not {text}.")
        return number


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
