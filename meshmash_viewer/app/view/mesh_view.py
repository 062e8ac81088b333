"""Interactive render of a document's mesh: contents, camera and mouse gestures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QEasingCurve, QPoint, QPointF, QSize, Qt, QVariantAnimation, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QWidget
from scipy.spatial.transform import Rotation

from meshmash_viewer.app.executor import Held, shutdown
from meshmash_viewer.app.view.annotations import BAR_SPACE, margins, title_size
from meshmash_viewer.app.view.camera import View, view_axes
from meshmash_viewer.app.view.caption import Caption, caption_of
from meshmash_viewer.app.view.frames import Frames
from meshmash_viewer.app.view.handles import BarHandles, CutHandle
from meshmash_viewer.app.view.pickable import PickableRender
from meshmash_viewer.app.view.picture import draw_picture
from meshmash_viewer.app.view.points import PointCloud
from meshmash_viewer.app.view.render_widget import Outline
from meshmash_viewer.app.view.style import ColorMap
from meshmash_viewer.app.view.surface import Marks
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.surface.rays import Plane

#: `View.half_size` set by `look_at`, as a fraction of the diagonal of the vertices, and minimum of
#: `half_size` as a fraction of the diagonal of the mesh.
_AROUND, _SMALLEST = 0.8, 0.03
#: Cosine between normal and eye direction above which `look_at` keeps the direction of the view.
_SEEN = 0.3
#: Magnification of a double click.
_CLOSER = 1.4
#: Radius, in logical pixels, of the circle around the vertex under the pointer.
_RING = 6.5
#: Duration of a camera movement in milliseconds.
_FLIGHT = 300


class MeshView(PickableRender):
    """Render of a `Document`, with its camera and mouse gestures.

    - A drag rotates the mesh; with Shift or the right button it pans, with Ctrl it rolls. A drag
      that begins on a pin moves the pin along the surface.
    - The wheel and a pinch zoom towards the pointer; Ctrl and the wheel emit `stepped`.
    - A click picks a vertex, a click of the middle button centres on a vertex, a click of the right
      button requests a menu.

    Keys are handled by the window.
    """

    #: Vertex under the pointer, -1 for none.
    vertex_hovered = Signal(int)
    #: Row, in the table of points, of the point under the pointer, -1 for none.
    point_hovered = Signal(int)
    #: The clicked vertex.
    vertex_clicked = Signal(int)
    #: The last click was the first of a double click; its effect must be undone.
    click_revoked = Signal()
    #: A right click: the vertex (-1 for none) and the position on the screen.
    menu_requested = Signal(int, QPoint)
    #: A turn of the wheel with Ctrl: number of steps forward, negative for backward.
    stepped = Signal(int)
    camera_changed = Signal()

    def __init__(self, document: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("scene")
        self.setAccessibleName("Render of the mesh")
        self.document = document
        self._ring = Outline(self.plotter, "hover_ring", "Vertex under the pointer")
        #: Line of a lasso, or circle of a brush.
        self.outline = Outline(self.plotter, "stroke_outline", "Outline of the stroke")
        #: Whether the camera has been moved since `reset_camera`.
        self.turned_by_hand = False
        self._flight = QVariantAnimation(self, duration=_FLIGHT, startValue=0.0, endValue=1.0)
        self._flight.setEasingCurve(QEasingCurve.Type.InOutQuad)
        self._flight.valueChanged.connect(self._fly)
        self._flown: View | None = None
        #: Vertex of the dragged pin: -1 during a drag that rotates the mesh, None without a drag.
        self._dragged_pin: int | None = None
        self._closed = False
        self._held = Held(self, lambda: None, self._release)
        self._hovered = self._pointed = self._last_clicked = self._hovered_point = -1
        self.cut_handle = CutHandle(self.renderer)
        self.bar_handles = BarHandles(self.renderer)
        self.plotter.grips += [self.bar_handles, self.cut_handle]
        self.frames = Frames(self.renderer, self.plotter, self)
        self.frames.camera_moved.connect(self._note_camera)
        canvas = self.plotter
        canvas.size_changed.connect(self._resized)
        canvas.dragged.connect(self._dragged)
        canvas.drag_ended.connect(self._end_drag)
        canvas.right_clicked.connect(self._request_menu)
        canvas.zoomed.connect(self._zoom)
        canvas.stepped.connect(self.stepped)
        canvas.clicked.connect(self._clicked)
        canvas.double_clicked.connect(self._double_clicked)
        canvas.middle_clicked.connect(self._centre_at)
        canvas.pointer_moved.connect(self._hover)

    # -- contents ---------------------------------------------------------------------------

    def set_mesh(
        self,
        mesh: Mesh | None,
        normals: npt.NDArray[np.float32] | None = None,
        hidden: Mask | None = None,
    ) -> None:
        """Draw a mesh with vertex normals of shape (n, 3), or nothing for None."""
        self._picking.drop()
        self.renderer.set_mesh(mesh, normals)
        self.renderer.set_hidden(hidden)
        self.frames.begin()
        self._pointed = -1
        self._set_hovered(-1)
        if mesh is not None:
            self._prepare_picking()
            self.reset_camera()
        self.plotter.render()

    def set_field(
        self,
        field: Any | None,
        limits: Limits | tuple[float, float] = (-1.0, 1.0),
        colormap: ColorMap = "RdBu_r",
        caption: Caption | None = None,
    ) -> None:
        """Colour the mesh by a `meshmash_viewer.model.field.Field`; None removes the field.

        The default caption has level lines if `nodal_lines` is set in the document's display.
        """
        if self.mesh is None:
            return
        had_caption = self.renderer.caption is not None
        if field is not None and caption is None:
            lined = self.document.display.nodal_lines
            caption = caption_of(field, Limits(*limits), colormap, lined=lined)
        self.renderer.set_field(None if field is None else field.values, caption)
        if had_caption != (field is not None) and not self.turned_by_hand:
            self._fit()
        self._moves()

    def set_shape(
        self,
        points: npt.NDArray[np.float32] | None,
        normals: npt.NDArray[np.float32] | None = None,
        *,
        rests: bool = True,
        text: str = "",
    ) -> None:
        """Draw the vertices at other positions, see `MeshRenderer.move`.

        `rests` means that the shape will not change soon; otherwise vertices cannot be picked.
        `text` is added below the title.
        """
        self.renderer.shape_text = text
        if points is None and not self.renderer.moved:
            return
        self.renderer.move(points, normals)
        self._set_hovered(-1)
        if rests:
            self._prepare_picking()
        self._moves()

    def set_hidden(self, hidden: Mask | None) -> None:
        """Hide vertices, a mask of shape (n,), and the faces around them; None shows all faces."""
        if self.mesh is None:
            return
        self.renderer.set_hidden(hidden)
        self.renderer.picker = None
        self._prepare_picking()
        if not self.turned_by_hand:
            self._fit()
        self.plotter.render()

    def set_awaited(self, title: str) -> None:
        """Show that a field with this title is being computed; "" removes the text."""
        before = self.renderer.awaited
        self.renderer.awaited = title and f"{title} is being computed …"
        if self.renderer.awaited != before:
            self.plotter.render()

    @property
    def title_size(self) -> QSize:
        """Size of title, formula and quantity in the upper left corner; (0, 0) without a field."""
        caption = self.renderer.shown_caption
        if caption is None:
            return QSize(0, 0)
        wide, tall = title_size(caption, self.height())
        # rounded up, so that widgets next to the title do not move with every digit
        return QSize(-(-wide // 40) * 40, tall)

    @property
    def bar_width(self) -> int:
        """Width of the colour bar at the right edge; 0 without a colour bar."""
        return 0 if self.renderer.caption is None else BAR_SPACE

    def set_pins(self, pins: Iterable[Any]) -> None:
        self.renderer.set_pins([(pin.vertex, pin.color, pin.label) for pin in pins])
        self.plotter.render()

    def set_marks(self, marks: Marks | None, of: str = "faults") -> None:
        """Draw marks over the surface in place of the marks of the same name; None removes them."""
        self.renderer.set_overlay(marks, of)
        self.plotter.render()

    def set_points(self, points: PointCloud | None) -> None:
        self.renderer.set_overlay(points, "points")
        self.plotter.render()

    def set_selected(self, selected: Mask | None) -> None:
        """Draw vertices, a mask of shape (n,), as selected; None deselects all vertices."""
        if self.mesh is not None:
            self.renderer.set_selected(selected)
            self._moves()

    def set_cut(self, plane: Plane | None) -> None:
        """Cut the mesh at a plane in mesh coordinates, with a handle; None draws the whole mesh."""
        if self.mesh is not None:
            self.renderer.set_cut(plane)
            self.cut_handle.show(plane, self.mesh.bounds)
            self._set_hovered(-1)
            self._moves()

    def set_bar_range(self, ends: tuple[float, float] | None) -> None:
        """Draw handles at two positions, 0 to 1, of the colour bar; None removes them."""
        if ends != self.renderer.annotations.bar_range:
            self.renderer.annotations.bar_range = ends
            self._moves()

    def set_theme(self, dark: bool) -> None:
        self.renderer.set_theme(dark)
        self.plotter.render()

    # -- the camera -------------------------------------------------------------------------

    def reset_camera(self) -> None:
        """Show the whole mesh from the default direction."""
        self._fit(self.renderer.axes)
        self.plotter.render()

    def camera(self) -> dict[str, Any] | None:
        """Return the camera as numbers for a session; None without a mesh."""
        return None if self.renderer.view is None else self.renderer.view.to_json()

    def set_camera(self, state: dict[str, Any], *, fitted: bool = False) -> None:
        """Restore a camera returned by `camera`; raise ValueError if it is invalid.

        If `fitted`, the whole mesh is fitted again whenever the render is resized.
        """
        self.renderer.view = View.from_json(state)
        self.turned_by_hand = not fitted
        self.plotter.render()
        self.camera_changed.emit()

    def look_from(self, name: str) -> None:
        """Show the whole mesh from a direction, a key of `camera.DIRECTIONS`."""
        if self.mesh is not None:
            self._fit(view_axes(name, self.mesh))
            self._moves()

    def _fit(self, axes: FloatArray | None = None) -> None:
        """Show the whole mesh with given axes, by default the axes of the current view."""
        view = self.renderer.view
        if axes is None and view is not None:
            axes = view.axes
        if self.mesh is not None:
            self.renderer.fit_view(*self.plotter.pixels(), axes)
        self.turned_by_hand = False
        self.camera_changed.emit()

    def look_like(self, other: MeshView, *, mirrored: bool = False) -> None:
        """Copy the camera of another view, scaled so that both meshes appear equally large.

        If `mirrored`, the camera is reflected in x.
        """
        view, mine, theirs = other.renderer.view, self.mesh, other.mesh
        if view is None or mine is None or theirs is None:
            return
        ratio = np.linalg.norm(np.ptp(mine.bounds, axis=0)) / np.linalg.norm(
            np.ptp(theirs.bounds, axis=0)
        )
        centre = theirs.bounds.mean(axis=0)
        if mirrored:
            view = view.mirrored(centre)
            width, height, scale = other.plotter.pixels()
            # Shift the mesh to stay left of the colour bar, which is not mirrored. The shift is the
            # same for both views, even without a field: mirroring twice must restore the view.
            barred = any(view.renderer.caption is not None for view in (self, other))
            free = margins(barred, width, height, scale)
            view = view.moved(free.left - free.right, 0.0, width, height)
        offset = view.focus - centre
        focus = mine.bounds.mean(axis=0) + ratio * offset
        self._set_view(View(focus, view.axes, float(ratio * view.half_size)))
        self.turned_by_hand = other.turned_by_hand

    def _set_view(self, view: View) -> None:
        self.renderer.view = view
        self.turned_by_hand = True
        self._moves()
        self.camera_changed.emit()

    def picture(
        self, size: tuple[int, int] | None = None, transparent: bool = False
    ) -> npt.NDArray[np.uint8]:
        """Return a picture of a given size in pixels; RGBA, shape (height, width, 4)."""
        return draw_picture(self.renderer.twin(), size or self.plotter.pixels()[:2], transparent)

    @property
    def at_rest(self) -> bool:
        """Whether the full mesh is drawn and nothing is being computed for the render."""
        flying = self._flight.state() == QVariantAnimation.State.Running
        return self.frames.at_rest and not self._picking.working and not flying

    def _moves(self) -> None:
        """Request a frame while the picture is changing."""
        if self.frames.slow:
            self._set_hovered(-1)
        self.frames.move()

    def _note_camera(self) -> None:
        self.turned_by_hand = True

    # -- strokes ----------------------------------------------------------------------------

    def take_strokes(self, taken: bool) -> None:
        """Set whether the left button draws strokes (see `RenderWidget.strokes`) or rotates."""
        self.plotter.strokes = taken
        self.plotter.setCursor(Qt.CursorShape.CrossCursor if taken else Qt.CursorShape.ArrowCursor)
        self.outline.show_line([])

    # -- the mouse --------------------------------------------------------------------------

    def _dragged(self, how: str, dx: float, dy: float) -> None:
        view = self.renderer.view
        if view is None:
            return
        if self._dragged_pin is None:
            at = self.plotter.pressed if how == "turn" else None
            self._dragged_pin = -1 if at is None else self.pin_at(at.x(), at.y())
        if self._dragged_pin >= 0:
            self._drag_pin(self._dragged_pin)
            return
        width, height, ratio = self.plotter.pixels()
        angle = np.pi * ratio / min(width, height)
        if how == "shift":
            self._set_view(view.moved(ratio * dx, ratio * dy, width, height))
        elif how == "roll":
            self._set_view(view.turned(0.0, 0.0, angle * dx))
        else:
            self._set_view(view.turned(angle * dx, angle * dy))

    def _drag_pin(self, pinned: int) -> None:
        """Move a pin to the vertex under the pointer, unless the vertex is pinned."""
        at = self.plotter.pointer
        vertex = -1 if at is None else self.vertex_at(at.x(), at.y())
        if vertex >= 0 and all(pin.vertex != vertex for pin in self.document.pins.placed):
            self._dragged_pin = vertex
            self.document.pins.drag(pinned, vertex)

    def _end_drag(self) -> None:
        self._dragged_pin = None
        self.document.pins.drop()

    def _request_menu(self, at: QPointF) -> None:
        place = self.plotter.mapToGlobal(at.toPoint())
        self.menu_requested.emit(self.vertex_near(at.x(), at.y()), place)

    def _zoom(self, factor: float, at: QPointF) -> None:
        view = self.renderer.view
        if view is not None:
            width, height, _ = self.plotter.pixels()
            x, y = self.plotter.to_pixels(at.x(), at.y())
            self._set_view(view.zoomed(factor, x, y, width, height))

    def _hover(self) -> None:
        at, vertex, point = self.plotter.pointer, -1, -1
        if at is not None and not self.plotter.dragging:
            vertex = self.pinned_or_at(at.x(), at.y())
            point, _ = self.drawn_point_at(at.x(), at.y())
        self._set_hovered(vertex)
        if point != self._hovered_point:
            self._hovered_point = point
            self.point_hovered.emit(point)

    def point_at(self, vertex: int) -> None:
        """Show the ring around a vertex while no vertex is under the pointer; -1 hides the ring."""
        self._pointed = vertex
        self._place_ring()

    def _place_ring(self) -> None:
        vertex = self._hovered if self._hovered >= 0 else self._pointed
        if vertex >= 0 and not self.plotter.strokes:  # the brush shows a circle instead
            middle = QPointF(self.display_point(vertex)) + QPointF(0.5, 0.5)
            self._ring.show_circle(middle, _RING)
        else:
            self._ring.hide()

    def _set_hovered(self, vertex: int) -> None:
        before, self._hovered = self._hovered, vertex
        self._place_ring()
        if vertex != before:
            self.vertex_hovered.emit(vertex)

    def _clicked(self, at: QPointF) -> None:
        self._last_clicked = self.vertex_near(at.x(), at.y())
        if self._last_clicked >= 0:
            self.vertex_clicked.emit(self._last_clicked)

    def _double_clicked(self, at: QPointF) -> None:
        """Centre on the vertex under the pointer, and magnify the view slightly."""
        if self._last_clicked >= 0:
            self.click_revoked.emit()
        self._centre_at(at, _CLOSER)

    def _centre_at(self, at: QPointF, closer: float = 1.0) -> None:
        vertex = self.vertex_near(at.x(), at.y())
        if vertex >= 0:
            self.centre_on(vertex, closer)

    def centre_on(self, vertex: int, closer: float = 1.0) -> None:
        """Centre on a vertex, and magnify the view by a factor."""
        view = self.renderer.view
        if view is not None:
            self._set_view(View(self.renderer.place(vertex), view.axes, view.half_size / closer))

    def look_at(self, vertices: npt.NDArray[np.integer]) -> None:
        """Zoom in on given vertices, from a direction that their normals face."""
        view, drawing = self.renderer.view, self.renderer
        if view is None or self.mesh is None:
            return
        points, normals = (each[vertices] for each in drawing.drawn)
        low, high = points.min(axis=0), points.max(axis=0)
        whole = float(np.linalg.norm(np.ptp(self.mesh.bounds, axis=0)))
        size = max(_AROUND * float(np.linalg.norm(high - low)), _SMALLEST * whole)
        outwards = np.asarray(normals.mean(axis=0), dtype=np.float64)
        axes = view.axes
        if outwards @ axes[2] < _SEEN * np.linalg.norm(outwards):
            axes = _facing(outwards, axes)
        focus = (low.astype(np.float64) + high) / 2.0 + drawing.centre
        self._fly_to(View(focus, axes, size))

    def _fly_to(self, end: View) -> None:
        """Move the camera in an animation, or at once if frames are slow."""
        self._flight.stop()
        self._flown = start = self.renderer.view
        if start is None or self.frames.slow:
            self._set_view(end)
            return
        self._way = start, end
        self._flight.start()

    def _fly(self, share: float) -> None:
        start, end = self._way
        if self.renderer.view is not self._flown:  # the user or a script moved the camera
            self._flight.stop()
            return
        self._flown = start.towards(end, share) if share < 1.0 else end
        self._set_view(self._flown)

    def _resized(self) -> None:
        if self.renderer.view is not None and not self.turned_by_hand:
            self._fit()
        self._set_hovered(-1)

    # -- the end ----------------------------------------------------------------------------

    def closeEvent(self, event: QCloseEvent) -> None:
        """Stop background work, and release the graphics resources."""
        super().closeEvent(event)
        shutdown(self)

    def _release(self) -> None:
        if self._closed:
            return
        self._closed = True
        self._ring.hide()
        self.frames.close()
        self.renderer.set_mesh(None, None)
        self.plotter.window_of_vtk.RemoveRenderer(self.renderer.renderer)
        self.plotter.close()


def _facing(outwards: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the axes rotated by the smallest angle that makes `outwards` point at the eye."""
    eye = outwards / np.linalg.norm(outwards)
    turn, _ = Rotation.align_vectors(eye[np.newaxis], axes[2][np.newaxis])
    return np.asarray(turn.apply(axes))
