"""A slider that goes one step a wheel notch, jumps where it is clicked, and can mark its range."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import QEvent, QRectF, QSize, Qt
from PySide6.QtGui import QBrush, QColor, QKeyEvent, QMouseEvent, QPainter, QPen, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QSlider

from meshmash_viewer.app import theme

__all__ = ["Mark", "StepSlider"]

_NOTCH = 120  # eighths of a degree, as Qt counts
_RADIUS = 7.5
#: Where the range begins, from either end of the widget.
_EDGE = _RADIUS + 1.0
_GROOVE = 4.0
_ROW = 26
_KEYS = (
    Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End,
)  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """A labelled tick under the groove; `share` is its place along it, 0 to 1."""

    share: float
    text: str


class StepSlider(QSlider):
    """A horizontal slider.

    Qt's own moves three steps a notch, pages where it is clicked, and cannot say that a part of
    its range is in doubt: `set_hatched` does that, `set_marks` labels places along it.

    Parameters
    ----------
    own_keys : bool
        Whether arrows and pages are its own while it has the focus, not commands for the field.
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
        """Label places along the groove."""
        if marks != self._marks:
            grown = bool(marks) != bool(self._marks)
            self._marks = marks
            if grown:
                self.updateGeometry()
            self.update()

    @property
    def hatched(self) -> tuple[float, float] | None:
        """The part of the range, as two shares of it, that is marked as in doubt."""
        return self._hatched

    def set_hatched(self, hatched: tuple[float, float] | None) -> None:
        """Mark a part of the range as in doubt."""
        if hatched != self._hatched:
            self._hatched = hatched
            self.update()

    # -- geometry ---------------------------------------------------------------------------

    def sizeHint(self) -> QSize:
        """Room for the groove and, under it, the labels."""
        below = self.fontMetrics().height() + 1 if self._marks else 0
        return QSize(180, _ROW + below)

    def minimumSizeHint(self) -> QSize:
        """Narrow, but never cut."""
        return QSize(90, self.sizeHint().height())

    def _x(self, share: float) -> float:
        return _EDGE + share * max(self.width() - 2.0 * _EDGE, 1.0)

    def _x_of(self, value: int) -> float:
        return self._x((value - self.minimum()) / max(self.maximum() - self.minimum(), 1))

    def value_x(self, value: int) -> int:
        """Where along the widget a value is, in pixels."""
        return round(self._x_of(value))

    # -- events -----------------------------------------------------------------------------

    def event(self, event: QEvent) -> bool:
        """Keep keys from being commands, if they are its own."""
        override = event.type() == QEvent.Type.ShortcutOverride and self._own_keys
        if override and isinstance(event, QKeyEvent) and event.key() in _KEYS:
            event.accept()
            return True
        return super().event(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Jump to the place under the pointer, and drag on from there."""
        if event.button() != Qt.MouseButton.LeftButton:
            event.ignore()
            return
        self.setSliderDown(True)
        self._follow(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag."""
        if self.isSliderDown():
            self._follow(event)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End the drag."""
        if event.button() == Qt.MouseButton.LeftButton and self.isSliderDown():
            self.setSliderDown(False)
        event.accept()

    def _follow(self, event: QMouseEvent) -> None:
        share = (event.position().x() - _EDGE) / (self._x(1.0) - _EDGE)
        span = self.maximum() - self.minimum()
        self.setSliderPosition(self.minimum() + round(min(max(share, 0.0), 1.0) * span))
        event.accept()

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

    # -- painting ---------------------------------------------------------------------------

    def paintEvent(self, _event: object) -> None:
        """Groove, its part up to the handle, what is in doubt, labels, handle."""
        colors, plot = theme.palette(), theme.plot_colors()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = _ROW / 2.0
        enabled = self.isEnabled()
        groove = QRectF(self._x(0.0), middle - _GROOVE / 2.0, self._x(1.0) - self._x(0.0), _GROOVE)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(colors.border if not enabled else colors.border_strong))
        painter.drawRoundedRect(groove, 2.0, 2.0)
        at = self._x_of(self.sliderPosition())
        if enabled:
            painter.setBrush(QColor(colors.accent))
            painter.drawRoundedRect(
                QRectF(groove.left(), groove.top(), at - groove.left(), _GROOVE), 2.0, 2.0
            )
        if self._hatched is not None:
            left, right = (self._x(share) for share in self._hatched)
            strip = QRectF(left, middle - 6.0, right - left, 12.0)
            painter.setBrush(QBrush(QColor(plot.hatch), Qt.BrushStyle.BDiagPattern))
            painter.drawRect(strip)
        self._paint_marks(painter, middle)
        handle = QRectF(at - _RADIUS, middle - _RADIUS, 2.0 * _RADIUS, 2.0 * _RADIUS)
        edge = colors.accent if enabled else colors.border_strong
        painter.setPen(QPen(QColor(edge), 2.0 if enabled else 1.0))
        painter.setBrush(QColor(colors.accent if self.isSliderDown() else colors.raised))
        painter.drawEllipse(handle.adjusted(1.0, 1.0, -1.0, -1.0))
        if self.hasFocus() and enabled:
            ring = QColor(colors.accent)
            ring.setAlpha(110)
            painter.setPen(QPen(ring, 2.0))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawEllipse(handle.adjusted(-1.5, -1.5, 1.5, 1.5))

    def _paint_marks(self, painter: QPainter, middle: float) -> None:
        metrics = self.fontMetrics()
        colors = theme.palette()
        painter.setPen(QColor(colors.muted if self.isEnabled() else colors.disabled))
        free = 0.0
        for mark in self._marks:
            x, width = self._x(mark.share), metrics.horizontalAdvance(mark.text)
            left = min(max(x - width / 2.0, 0.0), self.width() - width)
            painter.drawLine(round(x), round(middle + 5), round(x), round(middle + 8))
            if left >= free:  # no label over another
                baseline = _ROW + metrics.ascent() - 2
                painter.drawText(round(left), baseline, mark.text)
                free = left + width + 6
