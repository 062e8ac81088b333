"""Sliders that move one step per wheel notch, jump to a clicked position, and have marks."""

from __future__ import annotations

import math
from typing import NamedTuple

from PySide6.QtCore import QEvent, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QBrush, QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QSlider

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.make import show_quietly
from meshmash_viewer.units import engineering, power_text


class Mark(NamedTuple):
    """A labelled position along a range; `share` is 0 at its low end and 1 at its high end."""

    share: float
    text: str


def log_share(value: float, low: float, high: float) -> float:
    """Return the share of a logarithmic range below a value; 0 for a range of one number."""
    return math.log(value / low) / math.log(high / low) if high > low else 0.0


def decade_marks(low: float, high: float) -> tuple[Mark, ...]:
    """Return marks at the powers of ten in a range, and between them if the range is short."""
    if not (0.0 < low < high):
        return ()
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = math.log10(high / low)
    factors = (1,) if decades > 2.5 else (1, 3) if decades > 1.6 else (1, 2, 5)
    stride = max(1, round(decades / 6))
    return tuple(
        Mark(log_share(factor * 10.0**exponent, low, high), power_text(exponent, factor))
        for exponent in range(first, last + 1)
        for factor in factors
        if low <= factor * 10.0**exponent <= high and exponent % stride == 0
    )


#: A notch of the wheel in eighths of a degree.
_NOTCH = 120
#: Distance in pixels from an end of the widget to an end of the range: half a handle.
_EDGE = 8.0
#: Height of the groove with its handle.
_ROW = 26
#: Number of positions of a `LogSlider`, finer than a pixel.
_POSITIONS = 1000
_KEYS = (
    Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End,
)  # fmt: skip


class StepSlider(QSlider):
    """Horizontal slider that moves one step per notch and jumps to a clicked position.

    A QSlider moves three steps per notch, and one page per click. With `own_keys`, arrow and page
    keys move the slider while it has the focus; otherwise these keys are commands of the window.
    """

    def __init__(self, own_keys: bool = False) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setPageStep(10)
        self._marks: tuple[Mark, ...] = ()
        self._hatched: tuple[float, float] | None = None
        self._turned = 0
        self._own_keys = own_keys

    def set_marks(self, marks: tuple[Mark, ...]) -> None:
        if marks != self._marks:
            grown = bool(marks) != bool(self._marks)
            self._marks = marks
            if grown:
                self.setStyleSheet(f"padding-bottom: {self._room}px;" if marks else "")
                self.updateGeometry()
            self.update()

    @property
    def hatched(self) -> tuple[float, float] | None:
        """The hatched, unreliable part of the range: its ends, as shares of the range."""
        return self._hatched

    def set_hatched(self, hatched: tuple[float, float] | None) -> None:
        if hatched != self._hatched:
            self._hatched = hatched
            self.update()

    def sizeHint(self) -> QSize:
        return QSize(180, _ROW + (self._room if self._marks else 0))

    def minimumSizeHint(self) -> QSize:
        return QSize(90, self.sizeHint().height())

    @property
    def _room(self) -> int:
        return self.fontMetrics().height() + 1

    def _x(self, share: float) -> float:
        return _EDGE + share * max(self.width() - 2.0 * _EDGE, 1.0)

    def value_x(self, value: int) -> int:
        """Return the x coordinate of a value in pixels."""
        return round(self._x((value - self.minimum()) / max(self.maximum() - self.minimum(), 1)))

    def event(self, event: QEvent) -> bool:
        """Accept the shortcut override of the slider's own keys."""
        override = event.type() == QEvent.Type.ShortcutOverride and self._own_keys
        if override and isinstance(event, QKeyEvent) and event.key() in _KEYS:
            event.accept()
            return True
        return super().event(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Jump to the pointer; QSlider then starts a drag."""
        if event.button() == Qt.MouseButton.LeftButton:
            self.setSliderDown(True)  # the jump belongs to the drag
            share = (event.position().x() - _EDGE) / (self._x(1.0) - _EDGE)
            span = self.maximum() - self.minimum()
            self.setSliderPosition(self.minimum() + round(min(max(share, 0.0), 1.0) * span))
        super().mousePressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Move one step per notch, or one page with Ctrl or Shift; small turns are added up."""
        delta = event.angleDelta()
        self._turned += delta.y() or delta.x()
        notches = int(self._turned / _NOTCH)
        self._turned -= notches * _NOTCH
        wide = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
        size = self.pageStep() if event.modifiers() & wide else self.singleStep()
        # turning the wheel towards the user increases the value, as scrolling down does
        self.setValue(self.value() - notches * size)
        event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Increase the value on PgDn, as the command of this key does; QSlider decreases it."""
        if event.key() == Qt.Key.Key_PageDown:
            self.triggerAction(self.SliderAction.SliderPageStepAdd)
        elif event.key() == Qt.Key.Key_PageUp:
            self.triggerAction(self.SliderAction.SliderPageStepSub)
        else:
            super().keyPressEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the hatched part and the marks, then groove and handle by the style sheet."""
        colors, middle = theme.palette(), _ROW / 2.0
        painter = QPainter(self)
        if self._hatched is not None:
            left, right = (self._x(share) for share in self._hatched)
            doubt = QBrush(QColor(colors.hatch), Qt.BrushStyle.BDiagPattern)
            painter.fillRect(QRectF(left, middle - 6.0, right - left, 12.0), doubt)
        metrics = self.fontMetrics()
        painter.setPen(QColor(colors.muted if self.isEnabled() else colors.disabled))
        free = 0.0
        for mark in self._marks:
            x, width = self._x(mark.share), metrics.horizontalAdvance(mark.text)
            left = min(max(x - width / 2.0, 0.0), self.width() - width)
            painter.drawLine(round(x), round(middle + 5), round(x), round(middle + 8))
            if left >= free:  # labels do not overlap
                painter.drawText(round(left), _ROW + metrics.ascent() - 2, mark.text)
                free = left + width + 6
        painter.end()
        super().paintEvent(event)


class LogSlider(StepSlider):
    """Slider for a positive number, in log scale, with marks at powers of ten."""

    #: Number that the user chose.
    given = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self._ends = 1.0, 1.0
        self.setRange(0, _POSITIONS)
        self.set_steps(100)
        self.valueChanged.connect(self._give)

    def set_steps(self, count: int) -> None:
        """Divide the range into this number of steps."""
        one = max(round(_POSITIONS / max(count, 1)), 1)
        self.setSingleStep(one)
        self.setPageStep(min(10 * one, _POSITIONS))

    def show_number(self, value: float, ends: tuple[float, float], unit: str | None = None) -> None:
        """Show a number in a range without emitting `given`.

        Marks are in the multiple of the unit that suits the middle of the range; without a unit
        there are no marks.
        """
        self._ends = ends
        share = log_share(value, *ends) if value > 0.0 else 0.0
        show_quietly(self, round(min(max(share, 0.0), 1.0) * _POSITIONS))
        marks: tuple[Mark, ...] = ()
        if unit is not None:
            exponent, _ = engineering(math.sqrt(ends[0]) * math.sqrt(ends[1]), unit)
            marks = decade_marks(*(end * 10.0**exponent for end in ends))
        self.set_marks(marks)

    def _give(self, position: int) -> None:
        low, high = self._ends
        self.given.emit(low * (high / low) ** (position / _POSITIONS))
