"""The widget that VTK draws into: a plotter of pyvista's, with its mouse told as signals."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QEvent, QPoint, QPointF, QSize, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QEnterEvent,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QNativeGestureEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QApplication, QWidget
from pyvistaqt import QtInteractor
from vtkmodules.vtkRenderingCore import vtkRenderWindow

__all__ = ["RenderWidget", "Ring"]


class RenderWidget(QtInteractor):
    """A `pyvista.Plotter` in Qt, whose interactor gets no event: the window has manners of its own.

    Nothing is drawn but when Qt paints: `frame_due` asks for a frame then, once for any number of
    `render` calls, and `draw` makes it. When the screen has only lost what it showed, the last
    frame is shown again. Places are in this widget's coordinates.
    """

    frame_due = Signal()
    resized = Signal()
    #: How ("turn", "shift" or "roll"), and by how many pixels of the window to the right and up.
    dragged = Signal(str, float, float)
    drag_ended = Signal()
    #: Notches away from the user, and where.
    wheeled = Signal(float, QPointF)
    #: By which factor two fingers on a trackpad were moved apart, and where.
    pinched = Signal(float, QPointF)
    #: Whole notches with Ctrl: +1 for each towards the user.
    stepped = Signal(int)
    #: Pressed and released at one place with the left, or with the middle button.
    clicked = Signal(QPointF)
    middle_clicked = Signal(QPointF)
    pointer_moved = Signal()

    def __init__(self, parent: QWidget) -> None:
        self._drawing, self._stale = False, True
        # Lights are those of `MeshRenderer`; nothing is drawn by a timer.
        super().__init__(parent, auto_update=False, lighting="none", multi_samples=4)
        # Frames come from `draw` alone, whatever VTK's interactor thinks.
        self.window_of_vtk.GetInteractor().EnableRenderOff()
        # Otherwise pyvista would look at the first mesh that somebody adds.
        self.camera_set = True
        self.setAcceptDrops(False)
        self.setObjectName("scene_canvas")
        self.setAccessibleName("Mesh in three dimensions")
        self.setMinimumSize(QSize(160, 120))
        self.dragging = False
        #: Where the pointer is, None outside.
        self.pointer: QPointF | None = None
        self._pressed: QPointF | None = None
        self._last = QPointF()
        self._button = Qt.MouseButton.NoButton
        self._step_rest = 0

    @property
    def window_of_vtk(self) -> vtkRenderWindow:
        """What frames are drawn into."""
        window: vtkRenderWindow | None = self.ren_win
        assert window is not None, "the render has been closed"
        return window

    def sizeHint(self) -> QSize:
        """A good size for a first look."""
        return QSize(800, 600)

    def pixels(self) -> tuple[int, int, float]:
        """Width and height in pixels of the screen, and how many of them make one of Qt's."""
        ratio = self.devicePixelRatioF()
        return round(self.width() * ratio), round(self.height() * ratio), ratio

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """The middle of Qt's pixel (x, y), in pixels of the screen from the lower left."""
        ratio = self.devicePixelRatioF()
        return (x + 0.5) * ratio, (self.height() - y - 0.5) * ratio

    # -- what Qt tells ----------------------------------------------------------------------

    def render(self, *_: Any, **__: Any) -> None:
        """Have a new frame drawn soon: what pyvista calls after each change."""
        self._stale = True
        super().update()

    Render = render

    def update(self, *_: Any, **__: Any) -> None:
        """Show the last frame again; VTK calls this after each frame, too, when it is shown."""
        if not self._drawing:
            super().update()

    def paintGL(self) -> None:
        """Ask for a frame if there is to be a new one, and show it."""
        window: Any = self.window_of_vtk
        if self._stale and window.GetReadyForRendering():
            self._stale = False
            self._drawing = True
            try:
                self.frame_due.emit()
            finally:
                self._drawing = False
        super().paintGL()  # type: ignore[no-untyped-call]

    def draw(self) -> None:
        """Make a frame now; only while `frame_due` is emitted there is somewhere to draw it to."""
        (width, height, ratio), window = self.pixels(), self.window_of_vtk
        if window.GetSize() != (width, height):
            window.SetSize(width, height)
        window.SetDPI(round(72 * ratio))
        window.Render()

    @property
    def image(self) -> npt.NDArray[np.uint8]:  # type: ignore[override]
        """The frame as it is now, shape (height, width, 3): what pyvista's `screenshot` saves."""
        grabbed = self.grabFramebuffer().convertToFormat(QImage.Format.Format_RGB888)
        width, height, stride = grabbed.width(), grabbed.height(), grabbed.bytesPerLine()
        rows = np.frombuffer(grabbed.constBits(), dtype=np.uint8).reshape(height, stride)
        return rows[:, : 3 * width].reshape(height, width, 3).copy()

    def event(self, event: QEvent) -> bool:
        """Zoom by a pinch, and follow the window to a screen of another scale."""
        if isinstance(event, QNativeGestureEvent) and self._pinch(event):
            return True
        done = super().event(event)
        if event.type() == QEvent.Type.DevicePixelRatioChange:
            self.resized.emit()
            self.render()
        return done

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Have a frame of the new size."""
        super().resizeEvent(event)
        self.resized.emit()
        self.render()

    def enterEvent(self, event: QEnterEvent) -> None:
        """Note the pointer."""
        self._point_at(event.position())

    def leaveEvent(self, event: QEvent) -> None:
        """Forget the pointer."""
        self._point_at(None)

    def _point_at(self, at: QPointF | None) -> None:
        self.pointer = at
        self.pointer_moved.emit()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin a click or a drag; a second button takes no part in it."""
        event.accept()
        if self._pressed is not None and event.buttons() & self._button:
            return
        self._end_drag()
        self._pressed = self._last = event.position()
        self._button = event.button()

    mouseDoubleClickEvent = mousePressEvent

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Drag, or point."""
        at = event.position()
        if self._pressed is None:
            self._point_at(at)
            return
        self.pointer = at
        if not self.dragging:
            moved = (at - self._pressed).manhattanLength()
            if moved < QApplication.startDragDistance() / 2:
                return
            self.dragging = True
            self.pointer_moved.emit()
        delta, self._last = at - self._last, at
        modifiers = event.modifiers()
        if (
            self._button != Qt.MouseButton.LeftButton
            or modifiers & Qt.KeyboardModifier.ShiftModifier
        ):
            how = "shift"
        elif modifiers & Qt.KeyboardModifier.ControlModifier:
            how = "roll"
        else:
            how = "turn"
        self.dragged.emit(how, delta.x(), -delta.y())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """End a drag, or click."""
        if event.button() != self._button or self._pressed is None:
            return
        pressed, self._pressed = self._pressed, None
        if self.dragging:
            self._end_drag()
        elif self._button == Qt.MouseButton.LeftButton:
            self.clicked.emit(pressed)
        elif self._button == Qt.MouseButton.MiddleButton:
            self.middle_clicked.emit(pressed)

    def _end_drag(self) -> None:
        if self.dragging:
            self.dragging = False
            self.drag_ended.emit()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom, or step with Ctrl."""
        # Alt (on some systems) and Shift turn the wheel's direction.
        angle = event.angleDelta().y() or event.angleDelta().x()
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            self._step_rest -= angle
            steps = int(self._step_rest / 120)
            self._step_rest -= 120 * steps
            if steps:
                self.stepped.emit(steps)
        else:
            self.wheeled.emit(angle / 120, event.position())
        event.accept()

    def _pinch(self, event: QNativeGestureEvent) -> bool:
        # many come in the course of a pinch, each with a factor close to 1, less 1
        zooms = event.gestureType() == Qt.NativeGestureType.ZoomNativeGesture
        if zooms and event.value() > -1.0:
            self.pinched.emit(1.0 + event.value(), event.position())
            event.accept()
        return zooms

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Leave keys to the window."""
        event.ignore()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        """Leave keys to the window."""
        event.ignore()


class Ring(QWidget):
    """Marks the vertex under the pointer without drawing the render again."""

    OUTER, INNER = 8, 5

    def __init__(self, canvas: RenderWidget) -> None:
        super().__init__(canvas)
        self.setObjectName("hover_ring")
        self.setAccessibleName("Vertex under the pointer")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        size = 2 * self.OUTER + 3
        self.resize(size, size)
        self.hide()

    def show_at(self, place: QPoint) -> None:
        """Put its middle at a place of the canvas."""
        self.move(place - self.rect().center())
        self.show()

    def paintEvent(self, event: QPaintEvent) -> None:
        """White, with a dark edge on both sides."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle, radius = QPointF(self.rect().center()) + QPointF(0.5, 0.5), self.OUTER - 1.5
        for color, width in (("#14181d", self.OUTER - self.INNER + 1.0), ("#ffffff", 1.5)):
            painter.setPen(QPen(QColor(color), width))
            painter.drawEllipse(middle, radius, radius)
