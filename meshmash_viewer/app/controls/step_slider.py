"""A slider that goes one step a wheel notch, jumps where it is clicked, and can mark its range."""

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
    """A labelled place along a range; `share` is how far along it is, 0 to 1."""

    share: float
    text: str


def log_share(value: float, low: float, high: float) -> float:
    """How far along a range in log scale a value lies; 0 where the range is a single number."""
    return math.log(value / low) / math.log(high / low) if high > low else 0.0


def decade_marks(low: float, high: float) -> tuple[Mark, ...]:
    """Marks at the powers of ten of a range in log scale; at 2 and 5 too where it is short."""
    if not (0.0 < low < high):
        return ()
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = math.log10(high / low)
    factors = (1,) if decades > 2.5 else (1, 3) if decades > 1.6 else (1, 2, 5)
    stride = max(1, round(decades / 6))
    marks = []
    for exponent in range(first, last + 1):
        for factor in factors:
            value = factor * 10.0**exponent
            if low <= value <= high and exponent % stride == 0:
                marks.append(Mark(log_share(value, low, high), power_text(exponent, factor)))
    return tuple(marks)


_NOTCH = 120  # eighths of a degree, as Qt counts
#: Where the range begins, from either end of the widget: half a handle of the style sheet.
_EDGE = 8.0
_ROW = 26
#: Positions in log scale: finer than a pixel.
_POSITIONS = 1000
_KEYS = (
    Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End,
)  # fmt: skip


class StepSlider(QSlider):
    """A horizontal slider.

    Qt's own moves three steps a notch, and pages where it is clicked. With `own_keys`, arrows and
    pages are its own while it has the focus, not commands for the field.
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
        """The part of the range, as two shares of it, that is marked as in doubt."""
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
        """Where along the widget a value is, in pixels."""
        return round(self._x((value - self.minimum()) / max(self.maximum() - self.minimum(), 1)))

    def event(self, event: QEvent) -> bool:
        """Keep keys from being commands, if they are its own."""
        override = event.type() == QEvent.Type.ShortcutOverride and self._own_keys
        if override and isinstance(event, QKeyEvent) and event.key() in _KEYS:
            event.accept()
            return True
        return super().event(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Jump to the place under the pointer; Qt's own drags on from there."""
        if event.button() == Qt.MouseButton.LeftButton:
            share = (event.position().x() - _EDGE) / (self._x(1.0) - _EDGE)
            span = self.maximum() - self.minimum()
            self.setSliderPosition(self.minimum() + round(min(max(share, 0.0), 1.0) * span))
        super().mousePressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """One step a notch, a page with Ctrl or Shift; fine wheels add up to notches."""
        delta = event.angleDelta()
        self._turned += delta.y() or delta.x()
        notches = int(self._turned / _NOTCH)
        self._turned -= notches * _NOTCH
        wide = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
        size = self.pageStep() if event.modifiers() & wide else self.singleStep()
        # towards the user is on, as a page scrolls
        self.setValue(self.value() - notches * size)
        event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """The keys of the table of commands: of Qt's, only the pages go the other way."""
        pages = {
            Qt.Key.Key_PageDown: self.SliderAction.SliderPageStepAdd,
            Qt.Key.Key_PageUp: self.SliderAction.SliderPageStepSub,
        }
        if (page := pages.get(Qt.Key(event.key()))) is not None:
            self.triggerAction(page)
        else:
            super().keyPressEvent(event)

    def paintEvent(self, event: QPaintEvent) -> None:
        """What is in doubt, and labels; over them groove and handle, as the style sheet says."""
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
            if left >= free:  # no label over another
                painter.drawText(round(left), _ROW + metrics.ascent() - 2, mark.text)
                free = left + width + 6
        painter.end()
        super().paintEvent(event)


class LogSlider(StepSlider):
    """A slider for a positive number, in log scale, with marks at powers of ten."""

    #: The user moved it to this number.
    given = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self._ends = 1.0, 1.0
        self.setRange(0, _POSITIONS)
        self.set_steps(100)
        self.valueChanged.connect(self._give)

    def set_steps(self, count: int) -> None:
        one = max(round(_POSITIONS / max(count, 1)), 1)
        self.setSingleStep(one)
        self.setPageStep(min(10 * one, _POSITIONS))

    def show_number(self, value: float, ends: tuple[float, float], unit: str | None = None) -> None:
        """Show a number in a range, and say nothing.

        Marks are in a multiple of the unit that suits the middle of the range; None for no marks.
        """
        self._ends = ends
        share = log_share(value, *ends) if value > 0.0 else 0.0
        show_quietly(self, round(min(max(share, 0.0), 1.0) * _POSITIONS))
        if unit is None:
            self.set_marks(())
        else:
            exponent, _ = engineering(math.sqrt(ends[0]) * math.sqrt(ends[1]), unit)
            self.set_marks(decade_marks(*(end * 10.0**exponent for end in ends)))

    def _give(self, position: int) -> None:
        low, high = self._ends
        self.given.emit(low * (high / low) ** (position / _POSITIONS))
