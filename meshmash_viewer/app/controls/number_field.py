"""A field for a number that may be 1e-8, with its unit."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QWheelEvent
from PySide6.QtWidgets import QAbstractSpinBox

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


class NumberField(QAbstractSpinBox):
    """Takes a number in any notation, with or without its unit; speaks when it is finished.

    Qt's own spin boxes count decimals, which is of no use for 1e-8.

    Parameters
    ----------
    name, spoken : str
    step : callable, optional
        The number that is some steps from another; without it there are no arrows.
    live : bool
        Whether each number on the way to the one that is typed is given, too.
    nearest : bool
        Whether the nearest number within bounds takes the place of one beyond them, rather than the
        one before.
    whole : bool
        Whether it counts, and is written with all its digits.
    tip : str
        Its tooltip; the number with more digits where there is none.

    Attributes
    ----------
    bounds : tuple of float
        Least and largest number that is taken.
    fault : callable
        What is wrong with a number, in one sentence; empty if it is taken.

    Signals
    -------
    edited(float)
        A person gave a number that is allowed.
    refused(str)
        One sentence: what was wrong with what they gave; empty once it is mended.
    """

    edited = Signal(float)
    refused = Signal(str)

    def __init__(
        self,
        name: str,
        spoken: str,
        *,
        step: Callable[[float, int], float] | None = None,
        live: bool = False,
        nearest: bool = False,
        whole: bool = False,
        tip: str = "",
    ) -> None:
        super().__init__()
        self.bounds = -math.inf, math.inf
        self.fault: Callable[[float], str] = lambda _number: ""
        theme.named(self, name, spoken, tip=tip)
        self._step, self._live, self._nearest, self._whole = step, live, nearest, whole
        self._tipped = bool(tip)
        self._prefix = self._suffix = self._unit = ""
        self._value: float | None = None
        self._given: float | None = None
        #: What to go back to: parts of the number that is typed may be numbers, too.
        self._before: float | None = None
        if step is None:
            theme.with_role(self, "bare")  # of no width: without any, Qt leaves no room for text
            self.lineEdit().setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.0000e+00") + 16)
        self.lineEdit().textEdited.connect(self._follow_typing)

    @property
    def value(self) -> float | None:
        """The number last shown or given."""
        return self._value

    def show_value(
        self, value: float | None, unit: str = "", prefix: str = "", *, with_unit: bool = False
    ) -> None:
        """Show what the model holds, unless someone is typing.

        `unit` may be typed behind a number, and is written there if asked for; `prefix` comes
        before it, as "≈ " before an estimate.
        """
        self._unit, self._prefix = unit, prefix
        self._suffix = f" {unit}" if with_unit and unit else ""
        if value is not None and not self._tipped:
            self.setToolTip(f"{self.accessibleName()}: {value:.10g} {unit}".rstrip())
        if not (self.hasFocus() and self.lineEdit().isModified()):
            self._value = self._before = value
            self._write()

    # -- what Qt asks of a spin box -----------------------------------------------------------

    def sizeHint(self) -> QSize:
        """As wide as a line of text."""
        return QSize(140, super().sizeHint().height())

    def stepEnabled(self) -> QAbstractSpinBox.StepEnabledFlag:
        """Both ways, where it has steps and a number to begin at."""
        flag = self.StepEnabledFlag
        can = self._step is not None and self._value is not None
        return flag.StepUpEnabled | flag.StepDownEnabled if can else flag.StepNone

    def stepBy(self, steps: int) -> None:
        """Some steps on or back, within bounds."""
        if self._step is not None and self._value is not None:
            self._take(self._within(self._step(self._value, steps)))
            self._before = self._value
            self._write()
            self.selectAll()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the panel where there are no steps."""
        if self._step is None:
            event.ignore()
        else:
            super().wheelEvent(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Take what was typed; if it is no number, go back to what was."""
        self._commit()
        self._write()
        super().focusOutEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Escape goes back to what was; Return is passed on unless there is something to mend."""
        if event.key() == Qt.Key.Key_Escape:
            typed = self.lineEdit().isModified()
            self._go_back("")
            if typed:
                return
        returned = event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
        taken = self._commit() if returned else True
        super().keyPressEvent(event)
        if returned and not (taken and self.hasFocus()):
            event.accept()

    # -- numbers ------------------------------------------------------------------------------

    def _typed(self) -> float | None:
        text = self.text().strip().removeprefix(self._prefix.strip())
        return read_number(text.removesuffix(self._unit))

    def _problem(self, number: float) -> str:
        low, high = self.bounds
        if fault := self.fault(number):
            return fault
        if not low <= number <= high:
            between = format_range(low, high, self._unit, word="and", digits=1)
            return f"{self.accessibleName()}: between about {between} on this mesh."
        if number and not 1.0 / _LARGEST <= abs(number) <= _LARGEST:
            return f"{number:g} is no size of a mesh: write a number such as 3.1e5."
        return ""

    def _within(self, number: float) -> float:
        nearest = min(max(number, self.bounds[0]), self.bounds[1])
        return nearest // 1.0 if self._whole else nearest

    def _follow_typing(self) -> None:
        number = self._typed()
        self.refused.emit("")
        if self._live and number is not None and not self._problem(number):
            self._take(number)

    def _commit(self) -> bool:
        """Take what is typed, or say why not; whether it was taken."""
        if not self.lineEdit().isModified():
            return True
        number = self._typed()
        if number is None:
            problem = f"{self.text().strip() or 'Nothing'} is not a number: write 3.1e5."
        else:
            problem = self._problem(number)
        if problem:
            if self._nearest and number is not None:
                self._before = self._within(number)
            self._go_back(problem)
            return False
        assert number is not None
        self.lineEdit().setModified(False)
        self._given = self._before = number
        if not self._live or number != self._value:
            self._take(number)
        return True

    def _go_back(self, problem: str) -> None:
        if self._before is not None and self._live and self._before != self._value:
            self._take(self._before)
        self._value = self._before
        self._write()
        if self.hasFocus():
            self.selectAll()  # to be typed over
        self.refused.emit(problem)

    def _take(self, number: float) -> None:
        self._value = number
        self.edited.emit(number)

    def _write(self) -> None:
        text = "–"
        if self._value is not None and self._whole:
            text = f"{self._value:.0f}"
        elif self._value is not None:
            # what was typed stays as it was; what was computed is written as everywhere else
            text = format_number(self._value, 10 if self._value == self._given else 4)
        text = f"{self._prefix}{text}{self._suffix}"
        if text != self.text() or self.lineEdit().isModified():
            self.lineEdit().setText(text)
