"""Widget with the render of a mesh that finds the vertices, pins and points at a position."""

from __future__ import annotations

from functools import partial
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QPoint, Qt, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from meshmash_viewer.app.executor import Call, Slot
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.masks import Mask, Projection
from meshmash_viewer.surface.rays import RayTarget

#: Displayed vertices relative to the centre of the mesh, faces, and mask of hidden vertices.
_Places: TypeAlias = tuple[npt.NDArray[np.float32], npt.NDArray[np.integer], Mask | None]
#: Distance in logical pixels within which a vertex is picked, and maximum number of vertices
#: tested for visibility.
_NEAR, _TRIED = 8.0, 50


class PickableRender(QWidget):
    """Base class of `MeshView`; positions are in logical pixels of this widget."""

    #: The search structure for picking is ready.
    picking_ready = Signal()

    def __init__(self, parent: QWidget | None) -> None:
        super().__init__(parent)
        self.plotter = RenderWidget(self)
        self.plotter.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # not by Tab: it handles no keys
        self.renderer = MeshRenderer(renderer=self.plotter.renderer)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.plotter)
        self._picking = Slot(self, "picking")

    @property
    def mesh(self) -> Mesh | None:
        return self.renderer.mesh

    # -- search structure ---------------------------------------------------------------------

    @property
    def can_pick(self) -> bool:
        """Whether the search structure for picking has been computed."""
        return self.renderer.picker is not None

    def _prepare_picking(self) -> None:
        """Request the search structure for the current positions of the vertices."""
        assert self.mesh is not None
        places = self.renderer.drawn[0], self.mesh.faces, self.renderer.hidden
        self._picking.submit(partial(_ray_target, places), partial(self._take_picker, places))

    def _take_picker(self, request: _Places, made: RayTarget) -> None:
        now = self.renderer
        if now.mesh is None or now.drawn[0] is not request[0] or now.hidden is not request[2]:
            return  # computed for other positions or other hidden vertices
        self.renderer.picker = made
        self.plotter.render()  # now draws pins behind the mesh fainter
        self.picking_ready.emit()

    # -- positions ----------------------------------------------------------------------------

    @property
    def unit_per_pixel(self) -> float:
        """Width of a logical pixel in the mesh's unit; 0 without a mesh."""
        (width, height, ratio), view = self.plotter.pixels(), self.renderer.view
        return 0.0 if view is None else ratio * view.length_per_pixel(width, height)

    def display_point(self, vertex: int) -> QPoint:
        """Return the position of a vertex on this widget."""
        (width, height, ratio), view = self.plotter.pixels(), self.renderer.view
        if self.mesh is None or view is None:
            raise ValueError("No mesh is shown: open one first.")
        x, y, _ = view.to_pixels(self.renderer.place(vertex), width, height)[0]
        return QPoint(round(x / ratio - 0.5), round((height - y) / ratio - 0.5))

    def projection(self) -> Projection | None:
        """Return the projection of the displayed vertices; None without a mesh."""
        drawing, view = self.renderer, self.renderer.view
        if drawing.mesh is None or view is None:
            return None
        width, height, _ = self.plotter.pixels()
        return Projection(
            *drawing.drawn,
            view.axes,
            view.focus - drawing.centre,
            view.length_per_pixel(width, height),
            (width / 2.0, height / 2.0),
        )

    def _through(self, x: float, y: float) -> FloatArray:
        """Return the point of the focal plane, in mesh coordinates, at a position."""
        (width, height, _), view = self.plotter.pixels(), self.renderer.view
        assert view is not None
        return view.from_pixels(*self.plotter.to_pixels(x, y), width, height)

    # -- what is at a position ----------------------------------------------------------------

    def vertex_at(self, x: float, y: float) -> int:
        """Return the vertex displayed at a position, -1 for none."""
        drawing, view = self.renderer, self.renderer.view
        if drawing.picker is None or view is None:
            return -1
        through = self._through(x, y) - drawing.centre
        return drawing.picker.seen_vertex(through, view.axes[2], drawing.local_cut)

    def pin_at(self, x: float, y: float) -> int:
        """Return the vertex of the nearest visible pin within a few pixels, -1 for none."""
        (width, height, ratio), view = self.plotter.pixels(), self.renderer.view
        pins = [pin for pin in self.renderer.placed_pins() if not pin.hidden]
        if not pins or view is None:
            return -1
        places = view.to_pixels(np.array([pin.position for pin in pins]), width, height)
        far = np.hypot(*(places[:, :2] - self.plotter.to_pixels(x, y)).T)
        return pins[int(far.argmin())].vertex if far.min() <= _NEAR * ratio else -1

    def drawn_point_at(self, x: float, y: float) -> tuple[int, int]:
        """Return the row in the table and the vertex of the visible point at a position, or -1."""
        drawing, cloud = self.renderer, self.renderer.points
        if cloud is None or drawing.view is None or drawing.picker is None:
            return -1, -1
        size = self.plotter.pixels()
        near = cloud.near(self.plotter.to_pixels(x, y), drawing.view, size, drawing.centre)
        at = self._first_visible(cloud.vertices[near])
        return (-1, -1) if at < 0 else (int(cloud.rows[near[at]]), int(cloud.vertices[near[at]]))

    def pinned_or_at(self, x: float, y: float) -> int:
        """Return the vertex of the pin or point at a position, else the displayed vertex, or -1."""
        vertex = self.pin_at(x, y)
        if vertex < 0:
            _, vertex = self.drawn_point_at(x, y)
        return self.vertex_at(x, y) if vertex < 0 else vertex

    def vertex_near(self, x: float, y: float) -> int:
        """Return the vertex of the pin at a position, else the displayed vertex, else the nearest.

        The nearest vertex is the nearest visible vertex within a few pixels; -1 if there is none.
        """
        vertex, drawing = self.pinned_or_at(x, y), self.renderer
        if vertex >= 0 or drawing.picker is None or drawing.view is None:
            return vertex
        through, axes = self._through(x, y) - drawing.centre, drawing.view.axes[:2]
        near = drawing.picker.corners_near(through, axes, _NEAR * self.unit_per_pixel)
        if drawing.cut is not None and (away := drawing.away()) is not None:
            near = near[~away[near]]
        at = self._first_visible(near)
        return -1 if at < 0 else int(near[at])

    def _first_visible(self, vertices: npt.NDArray[np.integer]) -> int:
        """Return the index of the first visible vertex in an array; -1 if none of 50 is."""
        tested = enumerate(vertices[:_TRIED].tolist())
        return next((at for at, vertex in tested if not self.renderer.is_covered(vertex)), -1)


def _ray_target(places: _Places, call: Call) -> RayTarget:
    points, faces, hidden = places
    shown = faces if hidden is None else faces[~hidden[faces].any(axis=1)]
    return RayTarget(points, shown, call.cancelled)
