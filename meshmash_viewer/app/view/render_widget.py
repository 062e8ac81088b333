"""Qt widget of the render: a pyvista plotter that emits mouse gestures as signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QEvent, QPointF, QSize, Qt, Signal, Slot
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
    QPolygonF,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QApplication, QWidget
from pyvistaqt import QtInteractor
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.view.picture import pixels_of


class Grip(Protocol):
    """A handle dragged by the left button; positions are in pixels from the lower left."""

    def grab(self, x: float, y: float) -> bool:
        """Grab the handle if it is at a position; return whether it was grabbed."""

    def drag(self, x: float, y: float) -> None:
        """Move the handle to a position."""


class RenderWidget(QtInteractor):
    """A `pyvista.Plotter` in Qt, without VTK's interactor styles.

    A frame is drawn only when Qt paints: `render` requests a frame, `frame_due` is emitted once for
    any number of requests, and its receiver calls `draw`. If Qt paints without a request, the last
    frame is shown again. Positions are in this widget's coordinates.
    """

    frame_due = Signal()
    #: The widget has another size or pixel ratio. (Qt's own signal `resized` would double it.)
    size_changed = Signal()
    #: Gesture ("turn", "shift" or "roll"), and movement to the right and up in logical pixels.
    dragged = Signal(str, float, float)
    drag_ended = Signal()
    #: Magnification and position of a turn of the wheel or a pinch.
    zoomed = Signal(float, QPointF)
    #: Notches of the wheel with Ctrl since the last signal, positive towards the user.
    stepped = Signal(int)
    _notch_turned = Signal()
    #: A button was pressed and released at the same position.
    clicked = Signal(QPointF)
    double_clicked = Signal(QPointF)
    middle_clicked = Signal(QPointF)
    right_clicked = Signal(QPointF)
    pointer_moved = Signal()
    #: If `strokes` is set: the left button was pressed (with its modifiers), moved, and released.
    stroke_begun = Signal(QPointF, object)
    stroke_moved = Signal(QPointF)
    stroke_ended = Signal()

    def __init__(self, parent: QWidget) -> None:
        self._drawing, self._stale = False, True
        # `MeshRenderer` adds the lights; pyvistaqt's timer must not draw frames
        super().__init__(parent, auto_update=False, lighting="none", multi_samples=4)
        # VTK's interactor must not draw frames
        self.window_of_vtk.GetInteractor().EnableRenderOff()
        # prevents pyvista from moving the camera when the first mesh is added
        self.camera_set = True
        self.setAcceptDrops(False)
        self.setObjectName("scene_canvas")
        self.setAccessibleName("Mesh in three dimensions")
        self.setMinimumSize(QSize(160, 120))
        self.dragging = False
        #: Position of the pointer; None outside the widget.
        self.pointer: QPointF | None = None
        #: Position at which the held button was pressed; None if no button is held.
        self.pressed: QPointF | None = None
        self._last = QPointF()
        self._button, self._double = Qt.MouseButton.NoButton, False
        #: Whether the left button draws strokes. If True, the middle button, or Ctrl and the left
        #: button, rotates the mesh.
        self.strokes = False
        self._stroke = False
        #: Handles, which have priority over strokes, rotation and clicks of the left button.
        self.grips: list[Grip] = []
        self._grip: Grip | None = None
        #: Turns of the wheel with Ctrl, in eighths of a degree, that are not in `stepped` yet.
        self._step_rest = 0
        # queued, so that notches in quick succession make a single step
        self._notch_turned.connect(self._step, Qt.ConnectionType.QueuedConnection)

    @property
    def window_of_vtk(self) -> vtkRenderWindow:
        window: vtkRenderWindow | None = self.ren_win
        assert window is not None, "the render has been closed"
        return window

    def sizeHint(self) -> QSize:
        return QSize(800, 600)

    def pixels(self) -> tuple[int, int, float]:
        """Return width and height in screen pixels, and the screen pixels per logical pixel."""
        ratio = self.devicePixelRatioF()
        return round(self.width() * ratio), round(self.height() * ratio), ratio

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """Return the centre of the logical pixel (x, y) in screen pixels from the lower left."""
        ratio = self.devicePixelRatioF()
        return (x + 0.5) * ratio, (self.height() - y - 0.5) * ratio

    def close(self) -> None:  # type: ignore[override]
        """Release the graphics resources."""
        super().close()
        # PySide does not invalidate a `QSurface` when Qt deletes it, because it is no QObject;
        # PySide would return it in place of a new object at the same address.
        self._surface = None

    # -- frames -----------------------------------------------------------------------------

    def render(self, *_: Any, **__: Any) -> None:
        """Request a new frame; also called by pyvista after each change."""
        self._stale = True
        super().update()

    Render = render

    def update(self, *_: Any, **__: Any) -> None:
        """Show the last frame again; also called by VTK after each frame."""
        if not self._drawing:
            super().update()

    def paintGL(self) -> None:
        """Emit `frame_due` if a new frame was requested; show the last frame."""
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
        """Draw a frame; may be called only by receivers of `frame_due`."""
        (width, height, ratio), window = self.pixels(), self.window_of_vtk
        if window.GetSize() != (width, height):
            window.SetSize(width, height)
        window.SetDPI(round(72 * ratio))
        window.Render()

    def draw_aside(self) -> npt.NDArray[np.uint8] | None:
        """Return a transparent frame without displaying it; see `OffScreen.draw`.

        The result is None before the first frame. The shaders and arrays of this window are reused;
        making another window takes a tenth of a second.
        """
        window: Any = self.window_of_vtk
        if not window.GetReadyForRendering():
            return None
        self.makeCurrent()
        state = window.GetState()
        state.Reset()
        state.Push()
        self._drawing = True
        window.SetSwapBuffers(False)
        try:
            window.Render()
            return pixels_of(window, window.GetSize(), transparent=True)
        finally:
            window.SetSwapBuffers(True)
            self._drawing = False
            state.Pop()
            self.doneCurrent()

    @property
    def image(self) -> npt.NDArray[np.uint8]:
        """Displayed frame, shape (height, width, 3), used by pyvista's `screenshot`."""
        grabbed = self.grabFramebuffer().convertToFormat(QImage.Format.Format_RGB888)
        width, height, stride = grabbed.width(), grabbed.height(), grabbed.bytesPerLine()
        rows = np.frombuffer(grabbed.constBits(), dtype=np.uint8).reshape(height, stride)
        return rows[:, : 3 * width].reshape(height, width, 3).copy()

    def event(self, event: QEvent) -> bool:
        """Handle pinches, and a move to a screen with a different pixel ratio."""
        if isinstance(event, QNativeGestureEvent) and self._pinch(event):
            return True
        done = super().event(event)
        if event.type() == QEvent.Type.DevicePixelRatioChange:
            self.size_changed.emit()
            self.render()
        return done

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.size_changed.emit()
        self.render()

    def enterEvent(self, event: QEnterEvent) -> None:
        self._point_at(event.position())

    def leaveEvent(self, event: QEvent) -> None:
        self._point_at(None)

    def _point_at(self, at: QPointF | None) -> None:
        self.pointer = at
        self.pointer_moved.emit()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin a click or a drag; ignore a second button."""
        event.accept()
        if self.pressed is not None and event.buttons() & self._button:
            return
        self._end_drag()
        self.pressed = self._last = event.position()
        self._button, self._double = event.button(), False
        left = self._button == Qt.MouseButton.LeftButton
        turns = bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)
        at = self.to_pixels(self._last.x(), self._last.y())
        self._grip = next((each for each in self.grips if left and each.grab(*at)), None)
        self._stroke = self.strokes and left and not turns and self._grip is None
        if self._grip is not None:
            self.dragging = True
            self.pointer_moved.emit()
        elif self._stroke:
            self.stroke_begun.emit(event.position(), event.modifiers())

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.mousePressEvent(event)
        self._double = True

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        at = event.position()
        if self.pressed is None:
            self._point_at(at)
            return
        self.pointer = at
        if self._grip is not None:
            self._grip.drag(*self.to_pixels(at.x(), at.y()))
            return
        if self._stroke:
            self.stroke_moved.emit(at)
            return
        if not self.dragging:
            moved = (at - self.pressed).manhattanLength()
            if moved < QApplication.startDragDistance() / 2:
                return
            self.dragging = True
            self.pointer_moved.emit()
        delta, self._last = at - self._last, at
        modifiers = event.modifiers()
        turns = bool(modifiers & Qt.KeyboardModifier.ControlModifier)
        if self.strokes and (turns or self._button == Qt.MouseButton.MiddleButton):
            how = "turn"
        elif (
            self._button != Qt.MouseButton.LeftButton
            or modifiers & Qt.KeyboardModifier.ShiftModifier
        ):
            how = "shift"
        elif turns:
            how = "roll"
        else:
            how = "turn"
        self.dragged.emit(how, delta.x(), -delta.y())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if event.button() != self._button or self.pressed is None:
            return
        pressed, self.pressed = self.pressed, None
        if self._grip is not None:
            self._grip = None
            self._end_drag()
        elif self._stroke:
            self._stroke = False
            self.stroke_ended.emit()
        elif self.dragging:
            self._end_drag()
        elif self._button == Qt.MouseButton.LeftButton:
            (self.double_clicked if self._double else self.clicked).emit(pressed)
        elif self._button == Qt.MouseButton.MiddleButton:
            self.middle_clicked.emit(pressed)
        elif self._button == Qt.MouseButton.RightButton:
            self.right_clicked.emit(pressed)

    def _end_drag(self) -> None:
        if self.dragging:
            self.dragging = False
            self.drag_ended.emit()

    def wheelEvent(self, event: QWheelEvent) -> None:
        # with Shift, and on some systems with Alt, the wheel reports the x axis
        angle = event.angleDelta().y() or event.angleDelta().x()
        if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
            before = abs(self._step_rest)
            self._step_rest -= angle
            if before < 120 <= abs(self._step_rest):
                self._notch_turned.emit()
        else:
            self.zoomed.emit(1.15 ** (angle / 120), event.position())
        event.accept()

    @Slot()
    def _step(self) -> None:
        steps = int(self._step_rest / 120)
        self._step_rest -= 120 * steps
        if steps:
            self.stepped.emit(steps)

    def _pinch(self, event: QNativeGestureEvent) -> bool:
        # a pinch consists of many events; the value of each is its magnification minus 1
        zooms = event.gestureType() == Qt.NativeGestureType.ZoomNativeGesture
        if zooms and event.value() > -1.0:
            self.zoomed.emit(1.0 + event.value(), event.position())
            event.accept()
        return zooms

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Ignore keys, which are handled by the window."""
        event.ignore()

    def keyReleaseEvent(self, event: QKeyEvent) -> None:
        event.ignore()


class Outline(QWidget):
    """Widget that shows a line or a circle over the canvas without a new frame."""

    def __init__(self, canvas: RenderWidget, name: str, spoken: str) -> None:
        super().__init__(canvas)
        self.setObjectName(name)
        self.setAccessibleName(spoken)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._canvas, self._shape = canvas, QPolygonF()
        self.hide()

    def show_line(self, points: Sequence[QPointF]) -> None:
        """Draw a closed line through positions on the canvas; hide the widget without points."""
        self._shape = QPolygonF(points)
        around = self._shape.boundingRect().toAlignedRect().adjusted(-3, -3, 3, 3)
        self.setGeometry(around & self._canvas.rect())
        self.setVisible(bool(points))
        super().update()

    def show_circle(self, middle: QPointF | None, radius: float = 0.0) -> None:
        """Draw a circle around a position; None hides the widget."""
        if middle is None:
            self.show_line([])
            return
        around = 2.0 * np.pi * np.arange(48) / 48.0
        x, y = middle.x() + radius * np.cos(around), middle.y() + radius * np.sin(around)
        self.show_line([QPointF(*each) for each in np.stack([x, y], axis=1).tolist()])

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.translate(-self.pos())
        for color, width in (("#14181d", 3.5), ("#ffffff", 1.5)):
            painter.setPen(QPen(QColor(color), width))
            painter.drawPolygon(self._shape)
