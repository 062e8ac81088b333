"""The render in the window: draws the document's field, turns with the mouse, picks vertices."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import pyvista
from PySide6.QtCore import QPoint, QPointF, QSize, Qt, QThreadPool, QTimer, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QVBoxLayout, QWidget

from meshmash_viewer.app.listening import frame_drawn
from meshmash_viewer.app.view.annotations import BAR_SPACE, title_size
from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.colors import ColorMap
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import draw_picture
from meshmash_viewer.app.view.render_widget import RenderWidget, Ring
from meshmash_viewer.app.view.stand_in import StandIn, dots_of, stand_in_of
from meshmash_viewer.mesh import Mesh, mesh_to_poly
from meshmash_viewer.surface.clustering import CoarseMesh
from meshmash_viewer.surface.rays import RayTarget

__all__ = ["MeshView"]

Result = TypeVar("Result")

#: How long (ms) nothing must move before the full mesh is drawn again.
REST = 220
#: How wide the dots are in points that are drawn until there is a stand-in.
DOT_SIZE = 6.0


class MeshView(QWidget):
    """The render, its pointer and its camera.

    Drag turns, with Shift or the right button it shifts, with Ctrl it rolls; the wheel and a pinch
    zoom to the pointer, and with Ctrl the wheel steps; a click picks, a click of the middle button
    puts what is under the pointer in the middle. There are no keys here.

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
    #: What `small_twin` needs is there.
    small_ready = Signal()

    _computed = Signal(int, object, object)

    def __init__(self, document: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("scene")
        self.setAccessibleName("Render of the mesh")
        self.document = document
        self.plotter = RenderWidget(self)
        self.plotter.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # it has no keys of its own
        self.renderer = MeshRenderer(renderer=self.plotter.renderer)
        self.renderer.add_to(self.plotter.window_of_vtk)
        self._stand_in = StandIn()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.plotter)
        self._ring = Ring(self.plotter)
        #: Whether it is looked at otherwise than as it fits best.
        self.turned_by_hand = False
        self._closed = False
        self._first = True
        self._hovered = self._told = -1
        #: Of the mesh, so that what is computed of another one is told from what is of this.
        self._generation = 0
        self._coarse: CoarseMesh | None = None
        self._pool = QThreadPool(self)
        self._computed.connect(self._take_computed)
        self._rest = QTimer(self, interval=REST, singleShot=True)
        self._rest.timeout.connect(self._come_to_rest)
        self._connect_canvas()

    def _connect_canvas(self) -> None:
        canvas = self.plotter
        canvas.frame_due.connect(self._draw_frame)
        canvas.resized.connect(self._resized)
        canvas.dragged.connect(self._dragged)
        canvas.drag_ended.connect(self._come_to_rest)
        canvas.wheeled.connect(self._wheeled)
        canvas.pinched.connect(self._zoom)
        canvas.stepped.connect(self.stepped)
        canvas.clicked.connect(self._clicked)
        canvas.middle_clicked.connect(self._centre_on)
        canvas.pointer_moved.connect(self._hover)

    # -- what is drawn ----------------------------------------------------------------------

    @property
    def mesh(self) -> Mesh | None:
        """The mesh that is drawn."""
        return self.renderer.mesh

    def set_mesh(self, mesh: Mesh | None, normals: npt.NDArray[np.float32] | None = None) -> None:
        """Draw a mesh with vertex normals of shape (n, 3), or nothing."""
        self._generation += 1
        self._coarse = None
        self._rest.stop()
        self.renderer.set_mesh(mesh, normals)
        self._begin_with_stand_in()
        self._told = -1
        self._set_hovered(-1)
        if mesh is not None:
            self._prepare_picking()
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
        Lines are drawn as the display of the document says.
        """
        mesh = self.renderer.mesh
        if mesh is None:
            return
        had_caption = self.renderer.caption is not None
        if field is None:
            self.renderer.set_field(None, limits, colormap)
        else:
            lined = self.document.display.nodal_lines
            self.renderer.show(field, limits, colormap, lined=lined)
        if had_caption != (field is not None) and not self.turned_by_hand:
            self.reset_camera()
        self._moves()

    def set_shape(
        self,
        points: npt.NDArray[np.float32] | None,
        normals: npt.NDArray[np.float32] | None = None,
        *,
        rests: bool = True,
    ) -> None:
        """Draw the vertices elsewhere, or where the mesh has them.

        While they move, nothing is picked.

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
            self._prepare_picking()
        self._moves()

    def set_awaited(self, title: str) -> None:
        """Say that another field than the one drawn is being computed; "" when it has come."""
        before = self.renderer.awaited
        self.renderer.awaited = title and f"{title} is being computed …"
        if self.renderer.awaited != before:
            self.plotter.render()

    @property
    def title_size(self) -> QSize:
        """What title and quantity take of the upper left corner; empty where there are none."""
        caption = self.renderer.said
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

    def set_theme(self, dark: bool) -> None:
        """Light or dark."""
        self.renderer.set_theme(dark)
        self.plotter.render()

    # -- the camera -------------------------------------------------------------------------

    def reset_camera(self) -> None:
        """Show the whole mesh from its best side."""
        if self.mesh is not None:
            self.renderer.fit_view(*self.plotter.pixels())
        self.turned_by_hand = False
        self.plotter.render()
        self.camera_changed.emit()

    def camera(self) -> dict[str, Any] | None:
        """The camera as plain numbers for a session, None without a mesh."""
        return None if self.renderer.view is None else self.renderer.view.to_json()

    def set_camera(self, state: dict[str, Any]) -> None:
        """Look from where `camera` was taken; ValueError if that is not a camera."""
        self.renderer.view = View.from_json(state)
        self.turned_by_hand = True
        self.plotter.render()
        self.camera_changed.emit()

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
        self.turned_by_hand = other.turned_by_hand

    def _set_view(self, view: View) -> None:
        self.renderer.view = view
        self.turned_by_hand = True
        self._moves()
        self.camera_changed.emit()

    # -- pictures and places ----------------------------------------------------------------

    def picture(
        self, size: tuple[int, int] | None = None, transparent: bool = False
    ) -> npt.NDArray[np.uint8]:
        """What is on the screen as RGBA of shape (height, width, 4), at any size."""
        return draw_picture(self.renderer.twin(), size or self.plotter.pixels()[:2], transparent)

    def small_twin(self) -> tuple[MeshRenderer, npt.NDArray[np.int64] | None] | None:
        """What is on the screen, of few vertices and without its field if there are many.

        Returns
        -------
        MeshRenderer and ndarray of int64, or None
            The vertices that are left, None for all of them; nothing before `small_ready`, which
            comes when a stand-in has been made.
        """
        mesh, coarse = self.mesh, self._coarse
        if mesh is None or not self._stand_in.large:
            return self.renderer.twin(), None
        if coarse is None:
            self._make_stand_in()
            return None
        drawing, picked = MeshRenderer(self.renderer.dark), coarse.representatives
        small = Mesh(mesh.vertices[picked], coarse.faces, unit=mesh.unit)
        drawing.set_mesh(small, self.renderer.drawn[1][picked])
        drawing.view = self.renderer.view
        return drawing, picked

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
        if self.renderer.drawn_vertices is not self.mesh.vertices:
            surface.points = self.renderer.drawn_vertices
        caption, drawn = self.renderer.caption, self.renderer.surface
        if caption is not None and drawn is not None:
            surface.point_data[caption.title] = drawn.shown_values()
            surface.set_active_scalars(caption.title)
            named = caption.colormap
            surface.user_dict = {
                "quantity": caption.quantity,
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
        return drawing.picker.seen_vertex(through - drawing.centre, drawing.view.axes[2])

    @property
    def can_pick(self) -> bool:
        """Whether the search structure for picking is there."""
        return self.renderer.picker is not None

    def _prepare_picking(self) -> None:
        """Make the search structure for where the vertices are now."""
        assert self.mesh is not None
        generation, places, faces = self._generation, self.renderer.drawn[0], self.mesh.faces

        def make() -> RayTarget:
            return RayTarget(places, faces, lambda: self._generation != generation)

        def take(made: RayTarget) -> None:
            if self.renderer.drawn[0] is places:
                self.renderer.picker = made
                self.plotter.render()  # pins know now whether they are hidden
                self.picking_ready.emit()

        self._run(make, take)

    # -- frames -----------------------------------------------------------------------------

    def _moves(self) -> None:
        """Something moves: a frame is due, and one in full when it has come to rest."""
        if self._stand_in.slow:
            self._rest.start()
            self._set_hovered(-1)
        self.plotter.render()

    def _come_to_rest(self) -> None:
        if self.plotter.dragging:
            self._rest.start()
        else:
            self.plotter.render()

    @property
    def at_rest(self) -> bool:
        """Whether the mesh is drawn in full and nothing is being made for it."""
        return not self._rest.isActive() and self._pool.activeThreadCount() == 0

    @property
    def shows_stand_in(self) -> bool:
        """Whether the last frame had the stand-in in it, and not dots in its place."""
        coarse = self.renderer.coarse
        return self.renderer.shows_coarse and coarse is not None and not coarse.dotted

    def _begin_with_stand_in(self) -> None:
        """Draw one before the first frame in full, if that is slow without a doubt."""
        self._stand_in.begin(0 if self.mesh is None else self.mesh.n_vertices)
        if self._stand_in.slow:
            self._make_stand_in()
            self._rest.start()

    def _make_stand_in(self) -> None:
        """Have one made, once, and draw dots until it is there."""
        mesh = self.mesh
        if mesh is not None and self._stand_in.large and not self._stand_in.asked:
            self._stand_in.asked = True
            self.renderer.set_coarse(dots_of(mesh), DOT_SIZE * self.plotter.pixels()[2])
            self._run(lambda: stand_in_of(mesh), self._take_stand_in)

    def _take_stand_in(self, made: CoarseMesh) -> None:
        self._coarse = made
        self.renderer.set_coarse(made)
        self.small_ready.emit()
        if self._rest.isActive():
            self.plotter.render()

    def _draw_frame(self) -> None:
        """Draw now; only the canvas calls it, when Qt says that a frame is due."""
        if self._closed:
            return
        drawing, window = self.renderer, self.plotter.window_of_vtk
        if self._first:
            # Not before: a window tells what draws it when it is on the screen.
            self._stand_in.look_at(window)
            self._begin_with_stand_in()
        pace, at_rest = self._stand_in, not self._rest.isActive()
        coarse = not at_rest and pace.slow and pace.asked
        drawing.show_coarse(coarse)
        # Several samples a pixel may cost as much again for each frame: where frames are slow they
        # wait for rest, and where they are very slow, edges are smoothed afterwards instead.
        quickly = pace.slow and (pace.very_slow or not at_rest)
        window.SetMultiSamples(0 if quickly else 4)
        drawing.smooth_afterwards(quickly and at_rest)
        started = perf_counter()
        view = drawing.view
        drawing.prepare(*self.plotter.pixels())
        self.turned_by_hand |= view is not None and drawing.view is not view
        self.plotter.draw()
        if pace.measuring:
            window.WaitForCompletion()  # a graphics card would otherwise look fast and be late
        took = perf_counter() - started
        frame_drawn()
        if self._first:
            self._first = False
            self.first_frame.emit()
        elif drawing.surface is not None and not coarse and pace.measuring:
            pace.measure(took)
            if pace.slow:
                self._make_stand_in()

    def _run(self, compute: Callable[[], Result], take: Callable[[Result], None]) -> None:
        """Compute in a thread; what comes out is taken in this one, if the mesh is the same."""
        generation, computed = self._generation, self._computed

        def work() -> None:
            try:
                result: Any = compute()
            except Exception as fault:  # noqa: BLE001  raised again where it is waited for
                result = fault
            computed.emit(generation, take, result)

        self._pool.start(work)

    def _take_computed(self, generation: int, take: Callable[[Any], None], result: Any) -> None:
        if self._closed or generation != self._generation:
            return
        if isinstance(result, Exception):
            raise result
        take(result)

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
        self._zoom(1.15**notches, at)

    def _zoom(self, factor: float, at: QPointF) -> None:
        view = self.renderer.view
        if view is not None:
            width, height, _ = self.plotter.pixels()
            x, y = self.plotter.to_pixels(at.x(), at.y())
            self._set_view(view.zoomed(factor, x, y, width, height))

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
        if self.renderer.view is not None and not self.turned_by_hand:
            self.renderer.fit_view(*self.plotter.pixels(), self.renderer.view.axes)
            self.camera_changed.emit()
        self._set_hovered(-1)

    # -- the end ----------------------------------------------------------------------------

    def closeEvent(self, event: QCloseEvent) -> None:
        """Wait for the threads and let go of the graphics, once; nothing is drawn afterwards."""
        super().closeEvent(event)
        if self._closed:
            return
        self._closed = True
        self._generation += 1
        self._rest.stop()
        self._ring.hide()
        self._pool.waitForDone()
        self.renderer.set_mesh(None, None)
        self.renderer.remove_from(self.plotter.window_of_vtk)
        self.plotter.close()
