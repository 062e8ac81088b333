"""The native window that VTK draws into, with its mouse told as signals."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QPoint, QPointF, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QCursor, QPainter, QRegion
from PySide6.QtWidgets import QApplication, QWidget
from vtkmodules.qt.QVTKRenderWindowInteractor import QVTKRenderWindowInteractor
from vtkmodules.vtkRenderingCore import vtkRenderWindow

__all__ = ["Canvas", "Ring"]


class Canvas(QVTKRenderWindowInteractor):
    """A widget with a render window of its own; VTK's interactor gets no event.

    Nothing is drawn here: `frame_due` asks for a frame, once for any number of `update` calls.
    When the screen has only lost what it showed, the last frame is shown again. Places are in
    this widget's coordinates.
    """

    frame_due = Signal()
    resized = Signal()
    #: How ("turn", "shift" or "roll"), and by how many pixels of the window to the right and up.
    dragged = Signal(str, float, float)
    drag_ended = Signal()
    #: Notches away from the user, and where.
    wheeled = Signal(float, QPointF)
    #: Whole notches with Ctrl: +1 for each towards the user.
    stepped = Signal(int)
    #: Pressed and released at one place with the left, or with the middle button.
    clicked = Signal(QPointF)
    middle_clicked = Signal(QPointF)
    pointer_moved = Signal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("scene_canvas")
        self.setAccessibleName("Mesh in three dimensions")
        self.setMinimumSize(QSize(160, 120))
        self.window = self.GetRenderWindow()
        self.window.SetMultiSamples(4)
        self.window.SetDPI(72)
        self.dragging = False
        #: Where the pointer is, None outside.
        self.pointer: QPointF | None = None
        self._pressed: QPointF | None = None
        self._last = QPointF()
        self._button = Qt.MouseButton.NoButton
        self._step_rest = 0
        self._stale = True
        self._again = QTimer(self, interval=8, singleShot=True)
        self._again.timeout.connect(self._show_again)

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

    def update(self) -> None:
        """Have a new frame drawn soon."""
        self._stale = True
        super().update()

    def paintEvent(self, event: QEvent) -> None:
        """Ask for a frame, or show the last one again."""
        if self._stale:
            self._stale = False
            self.frame_due.emit()
        elif not self._again.isActive():
            self._again.start()

    def _show_again(self) -> None:
        # The ring has moved, or another window: a frame can take a second, this does not.
        if not self._stale:
            self.window.Frame()

    def resizeEvent(self, event: QEvent) -> None:
        """Give the render window the size in pixels of the screen."""
        width, height, _ = self.pixels()
        # The base class' method, as VTK's own widget does: the window is already that large.
        vtkRenderWindow.SetSize(self.window, width, height)
        self.resized.emit()
        self.update()

    def enterEvent(self, event: QEvent) -> None:
        """Note the pointer."""
        self._point_at(event.position())

    def leaveEvent(self, event: QEvent) -> None:
        """Forget the pointer, unless it has only gone over the ring."""
        if not self.rect().contains(self.mapFromGlobal(QCursor.pos())):
            self._point_at(None)

    def _point_at(self, at: QPointF | None) -> None:
        self.pointer = at
        self.pointer_moved.emit()

    def mousePressEvent(self, event: QEvent) -> None:
        """Begin a click or a drag; a second button takes no part in it."""
        event.accept()
        if self._pressed is not None and event.buttons() & self._button:
            return
        self._end_drag()
        self._pressed = self._last = event.position()
        self._button = event.button()

    mouseDoubleClickEvent = mousePressEvent

    def mouseMoveEvent(self, event: QEvent) -> None:
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

    def mouseReleaseEvent(self, event: QEvent) -> None:
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

    def wheelEvent(self, event: QEvent) -> None:
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

    def keyPressEvent(self, event: QEvent) -> None:
        """Leave keys to the window."""
        event.ignore()

    def keyReleaseEvent(self, event: QEvent) -> None:
        """Leave keys to the window."""
        event.ignore()

    def closeEvent(self, event: QEvent) -> None:
        """Free what the graphics card holds."""
        self._again.stop()
        self.window.Finalize()


class Ring(QWidget):
    """Marks the vertex under the pointer without drawing the render again.

    It is a native window with the shape of a ring, so that it lies over the render and lets the
    pointer through its middle; what reaches it is passed on to the canvas.
    """

    OUTER, INNER = 8, 5

    def __init__(self, canvas: Canvas) -> None:
        super().__init__(canvas)
        self.setObjectName("hover_ring")
        self.setAccessibleName("Vertex under the pointer")
        self.setAttribute(Qt.WidgetAttribute.WA_NativeWindow)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        size = 2 * self.OUTER + 1
        self.resize(size, size)
        inset = self.OUTER - self.INNER
        whole = QRegion(0, 0, size, size, QRegion.RegionType.Ellipse)
        hole = QRegion(inset, inset, size - 2 * inset, size - 2 * inset, QRegion.RegionType.Ellipse)
        self.setMask(whole.subtracted(hole))
        self.hide()

    def show_at(self, place: QPoint) -> None:
        """Put its middle at a place of the canvas."""
        self.move(place - QPoint(self.OUTER, self.OUTER))
        self.show()

    def paintEvent(self, event: QEvent) -> None:
        """White, with a dark edge on both sides."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor("#14181d"))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QColor("#ffffff"))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        middle = (self.OUTER + self.INNER) / 2
        painter.drawEllipse(QPointF(self.OUTER + 0.5, self.OUTER + 0.5), middle, middle)
