"""The render in the window: draws the document's field, turns with the mouse, picks vertices."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pyvista
from PySide6.QtCore import QPoint, QPointF, QSize, Qt, QThreadPool, QTimer, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app import heap
from meshmash_viewer.app.listening import frame_drawn
from meshmash_viewer.app.view.annotations import BAR_SPACE, title_size
from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.colors import ColorMap
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import draw_picture
from meshmash_viewer.app.view.render_widget import RenderWidget, Ring
from meshmash_viewer.app.view.stand_in import StandIn
from meshmash_viewer.mesh import Mesh, mesh_to_poly
from meshmash_viewer.surface.nodal_lines import nodal_segments

__all__ = ["MeshView"]

#: Values at the vertices, and the levels at which lines are drawn.
_Lines: TypeAlias = tuple[npt.NDArray[np.floating], tuple[float, ...]]

#: How long (ms) nothing must move before the full mesh is drawn again.
REST = 220
#: The same (ms) after a mesh has come for which a stand-in is being made.
FIRST_REST = 3000
#: How long (ms) the full mesh must have been looked at before its driver's memory is given back.
GIVE_BACK = 400


class MeshView(QWidget):
    """The render, its pointer and its camera.

    Drag turns, with Shift or the right button it shifts, with Ctrl it rolls; the wheel zooms to
    the pointer, and with Ctrl it steps; a click picks, a click of the middle button puts what is
    under the pointer in the middle. There are no keys here.

    Parameters
    ----------
    document : meshmash_viewer.model.document.Document
    parent : QWidget or None
    """

    #: Vertex under the pointer, -1 for none.
    vertex_hovered = Signal(int)
    #: Vertex that was clicked (not dragged from).
    vertex_clicked = Signal(int)
    #: Ctrl and the wheel: one step forward or back in whatever is being scrolled.
    stepped = Signal(int)
    #: Looked at from elsewhere, by whoever it was.
    camera_changed = Signal()
    #: The first frame is on the screen.
    first_frame = Signal()
    #: The search structure for picking is there.
    picking_ready = Signal()

    _computed = Signal(object, object, object)

    def __init__(self, document: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("scene")
        self.setAccessibleName("Render of the mesh")
        self.document = document
        self.plotter = RenderWidget(self)
        self.plotter.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # it has no keys of its own
        self.renderer = MeshRenderer(renderer=self.plotter.renderer)
        self.renderer.add_to(self.plotter.window_of_vtk)
        self._stand_in = StandIn(self.renderer)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.plotter)
        self._ring = Ring(self.plotter)
        self._user_moved_camera = False
        self._closed = False
        self._first = True
        self._quantity = self._awaited = ""
        self._lines: _Lines | None = None
        #: A field that waits for its nodal lines, and the one to come after it with their values.
        self._held: tuple[Any, tuple[float, float], ColorMap] | None = None
        self._next: tuple[Any, tuple[float, float], ColorMap] | None = None
        self._next_lines: _Lines | None = None
        self._hovered = self._told = -1
        #: Whether the vertices stay where they are drawn for a while.
        self._shape_rests = True
        self._generation = 0
        # One thread for what takes longer than a frame; the newest request counts.
        self._pool = QThreadPool(self)
        self._pool.setMaxThreadCount(1)
        self._computed.connect(self._take_computed)
        self._rest = self._timer(REST, self._come_to_rest)
        self._give_back = self._timer(GIVE_BACK, lambda: self._pool.start(heap.give_back))
        self._line_delay = self._timer(90, self._compute_lines)
        self._hover_delay = self._timer(15, self._hover)
        self._connect_canvas()
        self._picking_poll = QTimer(self, interval=30)
        self._picking_poll.timeout.connect(self._poll_picking)

    def _connect_canvas(self) -> None:
        canvas = self.plotter
        canvas.frame_due.connect(self._draw_frame)
        canvas.resized.connect(self._resized)
        canvas.dragged.connect(self._dragged)
        canvas.drag_ended.connect(self._come_to_rest)
        canvas.wheeled.connect(self._wheeled)
        canvas.stepped.connect(self.stepped)
        canvas.clicked.connect(self._clicked)
        canvas.middle_clicked.connect(self._centre_on)
        canvas.pointer_moved.connect(self._pointed)

    def _timer(self, interval: int, slot: Any) -> QTimer:
        timer = QTimer(self, interval=interval, singleShot=True)
        timer.timeout.connect(slot)
        return timer

    # -- what is drawn ----------------------------------------------------------------------

    @property
    def mesh(self) -> Mesh | None:
        """The mesh that is drawn."""
        return self.renderer.mesh

    def set_mesh(self, mesh: Mesh | None, normals: npt.NDArray[np.float32] | None = None) -> None:
        """Draw a mesh with vertex normals of shape (n, 3), or nothing."""
        self._generation += 1
        self._stand_in.forget()
        self._lines = self._held = self._next = None
        self._line_delay.stop()
        self._rest.stop()
        self.renderer.set_mesh(mesh, normals, picking=True)
        self._begin_with_stand_in()
        self._told = -1
        self._set_hovered(-1)
        if mesh is not None:
            self._picking_poll.start()
            self.reset_camera()
        self.plotter.render()

    def set_field(
        self,
        field: Any | None,
        limits: tuple[float, float] = (-1.0, 1.0),
        colormap: ColorMap = "RdBu_r",
    ) -> None:
        """Colour the mesh by a field (`meshmash_viewer.model.field.Field`), or by none.

        One write into the displayed array and one frame, however often it is called meanwhile.
        While a film with nodal lines is played, each picture waits for its lines.
        """
        chosen = field, limits, colormap
        if field is None or self._lines is None or not self.document.display.playing:
            self._held = self._next = None
            self._put_field(*chosen)
        elif self._held is None:
            self._held = chosen
        else:
            self._next = chosen

    def set_shape(
        self,
        points: npt.NDArray[np.float32] | None,
        normals: npt.NDArray[np.float32] | None = None,
        *,
        rests: bool = True,
    ) -> None:
        """Draw the vertices elsewhere, or where the mesh has them.

        While they move, nothing is picked and there are no nodal lines.

        Parameters
        ----------
        points : ndarray of float32, shape (n, 3), or None
            Relative to `renderer.centre`; None for where the mesh has them.
        normals : ndarray of float32, shape (n, 3), optional
            Those of before, if none are given.
        rests : bool
            Whether they stay there for a while.
        """
        if points is None and self.renderer.moved is None:
            return
        self.renderer.move(points, normals)
        self._set_hovered(-1)
        if rests:
            self.renderer.pick_moved()
            self._picking_poll.start()
        self._shape_rests = rests
        if self._lines is None or not rests:
            self._line_delay.stop()
        else:
            self._line_delay.start()
        self._moves()

    def _show_held(self) -> None:
        """Show the field that waited for its nodal lines."""
        if self._held is not None:
            held, self._held = self._held, None
            self._put_field(*held)

    def _put_field(
        self, field: Any | None, limits: tuple[float, float], colormap: ColorMap
    ) -> None:
        mesh = self.renderer.mesh
        if mesh is None:
            return
        had_caption = self.renderer.caption is not None
        lined = self.document.display.nodal_lines
        self._quantity = "" if field is None else field.told(lined)
        if field is None:
            self.renderer.set_field(None, limits, colormap)
        else:
            values = mesh.on_surface(field.values)
            words = field.title, self._awaited or self._quantity, field.unit
            self.renderer.set_field(values, limits, colormap, *words, complete=field.complete)
        if self._lines is not None:
            # The lines of another field would be wrong; new ones follow `set_nodal_lines`.
            self.renderer.set_segments(None)
            self._line_delay.stop()
        if had_caption != (field is not None) and not self._user_moved_camera:
            self.reset_camera()
        self._moves()

    def set_awaited(self, title: str) -> None:
        """Say that another field than the one drawn is being computed; "" when it has come."""
        before, self._awaited = self._awaited, title and f"{title} is being computed …"
        caption = self.renderer.caption
        if caption is not None and self._awaited != before:
            self.renderer.caption = replace(caption, quantity=self._awaited or self._quantity)
            self.plotter.render()

    @property
    def title_size(self) -> QSize:
        """What title and quantity take of the upper left corner; empty where there are none."""
        caption = self.renderer.caption
        if caption is None:
            return QSize(0, 0)
        wide, tall = title_size(caption)
        # rounded up, so that what keeps clear of it does not tremble as numbers change
        return QSize(-(-wide // 40) * 40, tall)

    @property
    def bar_width(self) -> int:
        """What the colour bar takes of the right edge; 0 where there is none."""
        return 0 if self.renderer.caption is None else BAR_SPACE

    def set_pins(self, pins: Iterable[Any]) -> None:
        """Mark vertices: objects with `vertex` and `color`."""
        self.renderer.set_pins([(pin.vertex, pin.color, str(pin.number)) for pin in pins])
        self.plotter.render()

    def set_nodal_lines(
        self, values: npt.NDArray[np.floating] | None, levels: tuple[float, ...] = (0.0,)
    ) -> None:
        """Draw where values of shape (n,) are at a level, as soon as they rest; or no lines."""
        before = self._lines
        lines = None if values is None else (values, levels)
        if lines is not None and before is not None and before[0] is values and before[1] == levels:
            lines = before
        if self._next is not None:
            if lines is not None:
                self._next_lines = lines
                return
            self._held, self._next = self._next, None
        self._lines = lines
        if self.renderer.mesh is None or (lines is None and before is None):
            return
        if lines is not None and self._held is not None:
            self._compute_lines()
        elif lines is None:
            self._show_held()
            self._line_delay.stop()
            self.renderer.set_segments(None)
            self.plotter.render()
        elif self._shape_rests:
            self._line_delay.start()

    def set_theme(self, dark: bool) -> None:
        """Light or dark."""
        self.renderer.set_theme(dark)
        self.plotter.render()

    # -- the camera -------------------------------------------------------------------------

    def reset_camera(self) -> None:
        """Show the whole mesh from its best side."""
        self.renderer.reset_view(*self.plotter.pixels())
        self._user_moved_camera = False
        self.plotter.render()
        self.camera_changed.emit()

    def camera(self) -> dict[str, Any] | None:
        """The camera as plain numbers for a session, None without a mesh."""
        return self.renderer.camera_state()

    def set_camera(self, state: dict[str, Any]) -> None:
        """Look from where `camera` was taken; ValueError if that is not a camera."""
        self.renderer.view = View.from_json(state)
        self._user_moved_camera = True
        self.plotter.render()
        self.camera_changed.emit()

    @property
    def turned_by_hand(self) -> bool:
        """Whether it is looked at otherwise than as it fits best."""
        return self._user_moved_camera

    def look_like(self, other: MeshView) -> None:
        """Look from where another view looks at its mesh, each mesh as large as the other."""
        view, mine, theirs = other.renderer.view, self.mesh, other.mesh
        if view is None or mine is None or theirs is None:
            return
        ratio = np.linalg.norm(np.ptp(mine.bounds, axis=0)) / np.linalg.norm(
            np.ptp(theirs.bounds, axis=0)
        )
        offset = view.focus - theirs.bounds.mean(axis=0)
        focus = mine.bounds.mean(axis=0) + ratio * offset
        self._set_view(View(focus, view.axes, float(ratio * view.half_size)))
        self._user_moved_camera = other._user_moved_camera

    def _set_view(self, view: View) -> None:
        self.renderer.view = view
        self._user_moved_camera = True
        self._moves()
        self.camera_changed.emit()

    # -- pictures and places ----------------------------------------------------------------

    def picture(
        self, size: tuple[int, int] | None = None, transparent: bool = False
    ) -> npt.NDArray[np.uint8]:
        """What is on the screen as RGBA of shape (height, width, 4), at any size."""
        return draw_picture(self.twin(), size or self.plotter.pixels()[:2], transparent)

    def twin(self) -> MeshRenderer:
        """What is on the screen, to be drawn elsewhere."""
        twin = self.renderer.twin()
        if twin.caption is not None:
            twin.caption = replace(twin.caption, quantity=self._quantity)
        return twin

    def to_pyvista(self) -> pyvista.PolyData:
        """The mesh as it is drawn, in its own coordinates, with the displayed field.

        Returns
        -------
        pyvista.PolyData
            A new one. The field is its active scalars, under its title, NaN where there is no
            value; ``user_dict`` has its ``"quantity"``, ``"unit"``, ``"colormap"`` (of labels the
            colours) and ``"limits"``.

        Raises
        ------
        ValueError
            If no mesh is shown.
        """
        if self.mesh is None:
            raise ValueError("No mesh is shown: open one first.")
        surface: pyvista.PolyData = mesh_to_poly(self.mesh)
        if self.renderer.moved is not None:
            surface.points = self.renderer.drawn_vertices
        caption, drawn = self.renderer.caption, self.renderer.surface
        if caption is not None and drawn is not None:
            surface.point_data[caption.title] = drawn.shown_values()
            surface.set_active_scalars(caption.title)
            named = caption.colormap
            surface.user_dict = {
                "quantity": self._quantity,
                "unit": caption.unit,
                "colormap": named if isinstance(named, str) else list(named),
                "limits": [caption.low, caption.high],
            }
        return surface

    def display_point(self, vertex: int) -> QPoint:
        """Where a vertex is on this widget."""
        (width, height, ratio), view = self.plotter.pixels(), self.renderer.view
        if self.mesh is None or view is None:
            raise ValueError("No mesh is shown: open one first.")
        x, y, _ = view.to_pixels(self.renderer.place(vertex), width, height)[0]
        return QPoint(round(x / ratio - 0.5), round((height - y) / ratio - 0.5))

    def vertex_at(self, x: float, y: float) -> int:
        """Vertex that is drawn at a place of this widget, -1 for none."""
        drawing = self.renderer
        if drawing.picker is None or drawing.view is None:
            return -1
        width, height, _ = self.plotter.pixels()
        through = drawing.view.from_pixels(*self.plotter.to_pixels(x, y), width, height)
        return drawing.picker.vertex(through - drawing.centre, drawing.view.axes[2])

    @property
    def can_pick(self) -> bool:
        """Whether the search structure for picking is there."""
        return self.renderer.picker is not None and self.renderer.picker.ready

    def _poll_picking(self) -> None:
        if self.can_pick:
            self._picking_poll.stop()
            self.plotter.render()  # pins know now whether they are hidden
            self.picking_ready.emit()

    # -- frames -----------------------------------------------------------------------------

    def _moves(self) -> None:
        """Something moves: a frame is due, and one in full when it has come to rest."""
        self._give_back.stop()
        if self._stand_in.software or self._stand_in.slow:
            self._rest.start(FIRST_REST if self._stand_in.awaited else REST)
            self._set_hovered(-1)
        self.plotter.render()

    def _come_to_rest(self) -> None:
        if self.plotter.dragging:
            self._rest.start(REST)
        else:
            self.plotter.render()

    @property
    def at_rest(self) -> bool:
        """Whether the mesh is drawn in full and nothing is being made for it, or given back."""
        waiting = self._rest.isActive() or self._give_back.isActive()
        return not waiting and self._pool.activeThreadCount() == 0

    @property
    def shows_stand_in(self) -> bool:
        """Whether the last frame had the stand-in in it."""
        return self.renderer.shows_coarse and not self._stand_in.awaited

    def _begin_with_stand_in(self) -> None:
        """Draw it before the first frame in full, if that is slow without a doubt."""
        if self._stand_in.begin(self.plotter.pixels()[2]):
            self._run("coarse", self._stand_in.task())
            self._rest.start(FIRST_REST)

    def _draw_frame(self) -> None:
        """Draw now; only the canvas calls it, when Qt says that a frame is due."""
        if self._closed:
            return
        drawing, window = self.renderer, self.plotter.window_of_vtk
        if self._first:
            # Not before: a window tells what draws it when it is on the screen.
            self._stand_in.software = _draws_by_software(window)
            self._begin_with_stand_in()
        stand_in, at_rest = self._stand_in, not self._rest.isActive()
        coarse = not at_rest and stand_in.slow and stand_in.asked
        drawing.show_coarse(coarse)
        # Several samples a pixel cost a processor as much again for each frame: they wait for
        # rest, and where frames are very slow, edges are smoothed afterwards instead.
        quickly = stand_in.software and (stand_in.very_slow or not at_rest)
        window.SetMultiSamples(0 if quickly else 4)
        drawing.smooth_afterwards(quickly and at_rest)
        started = perf_counter()
        view = drawing.view
        drawing.prepare(*self.plotter.pixels())
        self._user_moved_camera |= view is not None and drawing.view is not view
        self.plotter.draw()
        if stand_in.measuring:
            window.WaitForCompletion()  # a graphics card would otherwise look fast and be late
        took = perf_counter() - started
        frame_drawn()
        if stand_in.slow and stand_in.software and not coarse:
            # The driver kept lists of all triangles, which the C library keeps when it is done.
            self._give_back.start()
        if self._first:
            self._first = False
            self.first_frame.emit()
        elif drawing.surface is not None and not coarse and stand_in.measure(took):
            self._run("coarse", stand_in.task())

    def _compute_lines(self) -> None:
        mesh, lines, centre = self.renderer.mesh, self._lines, self.renderer.centre
        if mesh is None or lines is None:
            return
        values, levels = lines

        moved = self.renderer.moved

        def compute() -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
            if moved is not None:
                return nodal_segments(moved[0], mesh.faces, values, np.zeros(3), levels)
            return nodal_segments(mesh.vertices, mesh.faces, values, centre, levels)

        self._run("lines", compute, (lines, moved))

    def _run(self, what: str, compute: Any, key: Any = None) -> None:
        """Compute in the pool; `_take_computed` gets the result on this thread."""
        generation, computed = self._generation, self._computed

        def work() -> None:
            try:
                result = compute()
            except Exception as fault:  # noqa: BLE001  raised again where it is waited for
                result = fault
            computed.emit((what, generation), key, result)

        self._pool.start(work)

    def _take_computed(self, what: tuple[str, int], key: Any, result: Any) -> None:
        if self._closed or what[1] != self._generation:
            return
        if isinstance(result, Exception):
            if what[0] == "coarse":
                self._stand_in.give_up()
                self._rest.start(REST)
            raise result
        if what[0] == "coarse":
            self._stand_in.take(result)
            if self._rest.isActive():
                self._rest.start(REST)
                self.plotter.render()
        elif key[0] is self._lines:
            self._show_held()
            if key[1] is self.renderer.moved:
                self.renderer.set_segments(*result)
            if self._next is not None:
                self._held, self._next = self._next, None
                self._lines = self._next_lines
                self._compute_lines()
            self.plotter.render()

    # -- the mouse --------------------------------------------------------------------------

    def _dragged(self, how: str, dx: float, dy: float) -> None:
        view = self.renderer.view
        if view is None:
            return
        width, height, ratio = self.plotter.pixels()
        angle = np.pi * ratio / min(width, height)
        if how == "shift":
            self._set_view(view.moved(ratio * dx, ratio * dy, width, height))
        elif how == "roll":
            self._set_view(view.turned(0.0, 0.0, angle * dx))
        else:
            self._set_view(view.turned(angle * dx, angle * dy))

    def _wheeled(self, notches: float, at: QPointF) -> None:
        view = self.renderer.view
        if view is not None:
            width, height, _ = self.plotter.pixels()
            x, y = self.plotter.to_pixels(at.x(), at.y())
            self._set_view(view.zoomed(1.15**notches, x, y, width, height))

    def _pointed(self) -> None:
        # At a steady rate: starting the timer anew at each move would wait for the last one.
        if not self._hover_delay.isActive():
            self._hover_delay.start()

    def _hover(self) -> None:
        inside = self.plotter.pointer
        if inside is None or self.plotter.dragging:
            self._set_hovered(-1)
        else:
            self._set_hovered(self.vertex_at(inside.x(), inside.y()))

    def point_at(self, vertex: int) -> None:
        """Put the ring around a vertex while none is under the pointer, or take it away (-1)."""
        self._told = vertex
        self._place_ring()

    def _place_ring(self) -> None:
        vertex = self._hovered if self._hovered >= 0 else self._told
        if vertex >= 0:
            self._ring.show_at(self.display_point(vertex))
        else:
            self._ring.hide()

    def _set_hovered(self, vertex: int) -> None:
        before, self._hovered = self._hovered, vertex
        self._place_ring()
        if vertex != before:
            self.vertex_hovered.emit(vertex)

    def _clicked(self, at: QPointF) -> None:
        vertex = self.vertex_at(at.x(), at.y())
        if vertex >= 0:
            self.vertex_clicked.emit(vertex)

    def _centre_on(self, at: QPointF) -> None:
        vertex, view = self.vertex_at(at.x(), at.y()), self.renderer.view
        if vertex >= 0 and self.mesh is not None and view is not None:
            self._set_view(View(self.renderer.place(vertex), view.axes, view.half_size))

    def _resized(self) -> None:
        if self.renderer.view is not None and not self._user_moved_camera:
            self.renderer.fit_view(self.renderer.view.axes, *self.plotter.pixels())
            self.camera_changed.emit()
        self._set_hovered(-1)

    # -- the end ----------------------------------------------------------------------------

    def closeEvent(self, event: QCloseEvent) -> None:
        """Let go of the graphics, once; nothing is drawn afterwards."""
        self.release()
        super().closeEvent(event)

    def release(self) -> None:
        """Wait for the threads and free what the graphics card holds."""
        if self._closed:
            return
        self._closed = True
        timers = self._rest, self._give_back, self._line_delay, self._hover_delay
        for timer in (*timers, self._picking_poll):
            timer.stop()
        self._ring.hide()
        self._pool.waitForDone()
        self.renderer.set_mesh(None, None)
        self.renderer.remove_from(self.plotter.window_of_vtk)
        self.plotter.close()


def _draws_by_software(window: vtkRenderWindow) -> bool:
    """Whether OpenGL runs on the processor."""
    told = window.ReportCapabilities().lower()
    return any(name in told for name in ("llvmpipe", "softpipe", "swrast", "swiftshader"))
