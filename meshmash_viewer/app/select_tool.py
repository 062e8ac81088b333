"""The *Select* tool: selection of vertices by strokes on the render and by ranges of values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QObject, QPointF, Qt, QTimer, Signal

from meshmash_viewer.app.actions import SELECT_MODES
from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.selection import How
from meshmash_viewer.surface.geodesics import GeodesicSolver
from meshmash_viewer.surface.masks import (
    Mask,
    between,
    component,
    filled,
    lasso,
    prepared,
    same_label,
)

if TYPE_CHECKING:
    from meshmash_viewer.app.controller import Controller
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Modes in which a drag with the left button is a stroke; in other modes it rotates the mesh.
_STROKES = ("brush", "lasso", "connected")
#: Initial radius of the brush, as a share of the diagonal of the mesh.
_BRUSH = 0.01
#: The range of all values.
_ALL = (-np.inf, np.inf)
#: Maximum number of discs selected between two positions of the pointer.
_BETWEEN = 6
#: Milliseconds without a new range after which the previous ranges become one undo step.
_REST = 500

_ONLY_FIRST = (
    "Vertices are selected on the first mesh only: to select on this one, open it as the first"
    " mesh, and compare it with the other."
)


@dataclass(frozen=True, eq=False)
class _Step:
    """A mask to compute in the thread, and its effect on the selection."""

    work: Callable[[], Mask]
    how: How
    label: str
    #: Message shown if the mask is empty; if not "", an empty mask leaves the selection unchanged.
    nothing: str = ""
    #: Whether the step belongs to the drag of a range, and replaces the selection. A newer step
    #: replaces a waiting step of the same drag, and all steps of a drag are one undo step.
    live: bool = False


class SelectTool(QObject):
    """Tool that selects vertices of the first mesh in one of the `SELECT_MODES`.

    The vertices replace the selection, are added to it with Shift, or removed from it with Alt.
    Masks that take more than a few milliseconds are computed in a thread, in the order requested.
    """

    #: The tool was switched on or off, or its mode, radius or range has changed.
    changed = Signal()

    def __init__(
        self, document: Document, scene: MeshView, controller: Controller, parent: QObject
    ) -> None:
        super().__init__(parent)
        self._document, self._scene, self._controller = document, scene, controller
        self._second: MeshView | None = None
        self.on = False
        self.mode = next(iter(SELECT_MODES))
        #: Radius of the brush, in the mesh's unit.
        self.radius = 0.0
        #: Whether a lasso also selects covered vertices.
        self.through = False
        #: Whether `alike` selects only vertices that are connected with the pinned vertex.
        self.connected = False
        #: Selected range of values; infinite where a handle is at the end of the colour bar.
        self.range = _ALL
        #: Name of the family, and unit, of the field to which `range` refers.
        self._ranged: tuple[str, str] | None = None
        self._geodesics: tuple[Mesh, GeodesicSolver] | None = None
        self._how: How = "replace"
        #: Positions of the pointer during a stroke: all positions for a lasso, the last position
        #: for the brush, the first position in other modes. Empty without a stroke.
        self._line: list[QPointF] = []
        #: The current selection during a stroke of the brush.
        self._stroke: Mask | None = None
        #: Vertices that the brush can reach: drawn vertices that face the eye.
        self._front: Mask | None = None
        #: Distances from the centres of the discs of a stroke, see `GeodesicSolver.within`.
        self._distances: FloatArray | None = None
        #: The last requested step.
        self._step: _Step | None = None
        self._preparing, self._masks = Slot(self, "brush"), Slot(self, "masks")
        self._rest = QTimer(self, singleShot=True, interval=_REST)
        self._rest.timeout.connect(document.selection.finish)
        canvas = scene.plotter
        canvas.stroke_begun.connect(self._begin)
        canvas.stroke_moved.connect(self._move)
        canvas.stroke_ended.connect(self._end)
        canvas.pointer_moved.connect(self._show_circle)
        scene.bar_handles.moved = self._drag_range
        controller.drawn.connect(self._follow_field)
        listen(document.mesh_changed, self._on_mesh_changed)
        self._on_mesh_changed()

    @property
    def prepared(self) -> bool:
        """Whether vertex areas and the geodesics of the brush have been computed."""
        mesh, known = self._document.mesh, self._geodesics
        return mesh is not None and known is not None and known[0].vertices is mesh.vertices

    @property
    def field(self) -> Field | None:
        """The displayed field, to whose values `range` applies."""
        return self._controller.field

    @property
    def strokes(self) -> bool:
        """Whether the left button selects; otherwise a drag rotates the mesh, and a click pins."""
        return self.on and self.mode in _STROKES

    # -- choices ------------------------------------------------------------------------------

    def select(self, on: bool) -> None:
        """Switch the tool on or off."""
        self.on = on
        self._document.selection.finish()
        for scene in filter(None, (self._scene, self._second)):
            scene.take_strokes(self.strokes)
        self._prepare()
        self._show_handles()
        self.changed.emit()

    def set_second(self, scene: MeshView | None) -> None:
        """Set the render of the second mesh, or None; a stroke on it only shows a message."""
        self._second = scene
        if scene is not None:
            scene.plotter.stroke_begun.connect(lambda *_: self._say(_ONLY_FIRST))
            scene.take_strokes(self.strokes)

    def select_with(self, mode: str) -> None:
        """Set the mode, and switch the tool on."""
        self.mode, self.range = mode, _ALL
        self.select(True)
        if mode == "alike" and self._document.display.family.required != "vertex":
            if self._document.pins.placed and self._document.spectrum is not None:
                self._document.similar()
            else:
                self._say("To select similar vertices, compute eigenpairs and pin a vertex.")

    def set_radius(self, radius: float) -> None:
        """Set the radius of the brush."""
        self.radius, self._distances = radius, None
        self.changed.emit()

    def set_range(self, low: float, high: float) -> None:
        """Select the vertices with values from `low` to `high`."""
        self.range = low, high
        self._show_handles()
        field = self._controller.field
        if field is None or self._document.mesh is None:
            self._say("There is no field to select values of: choose one first.")
            return
        vertex = getattr(field.family, "vertex", None) if self.mode == "alike" else None
        if self.mode == "alike" and vertex is None:
            self._say("To select similar vertices, pin a vertex and choose Similar.")
            return
        joined = vertex if self.connected else None
        work = partial(between, self._document.mesh, field.values, *self.range, joined)
        self._run(_Step(work, "replace", "selection by value", live=True))
        self._rest.start()
        self.changed.emit()

    def set_connected(self, connected: bool) -> None:
        """Set whether `alike` selects only vertices connected with the pinned vertex."""
        self.connected = connected
        if self.range != _ALL:
            self.set_range(*self.range)

    @property
    def _limits(self) -> Limits | None:
        """Limits of the colour bar; None without a colour bar."""
        caption = self._scene.renderer.caption
        if caption is None:
            return None
        return Limits(caption.low, caption.high, caption.logarithmic)

    def _drag_range(self, low: float, high: float) -> None:
        """Select a range, given the positions of its ends on the colour bar, from 0 to 1."""
        if (limits := self._limits) is not None:
            self.set_range(limits.at(low), limits.at(high))

    def _follow_field(self) -> None:
        """Reset the range if the family or the unit of the field has changed."""
        field = self.field
        ranged = None if field is None else (field.family.name, field.unit)
        if ranged != self._ranged:
            self._ranged, self.range = ranged, _ALL
            self.changed.emit()
        self._show_handles()

    def _show_handles(self) -> None:
        """Show handles at the colour bar in the modes that select a range."""
        limits, shares = self._limits, None
        if limits is not None and self.on and self.mode in ("value", "alike"):
            low, high = self.range
            shares = limits.share_of(low), limits.share_of(high)
        self._scene.set_bar_range(shares)

    def fill_selection(self) -> None:
        """Add the parts of the surface enclosed by the selection."""
        mesh, mask = self._document.mesh, self._document.selection.mask
        if mesh is not None and mask is not None:
            self._run(_Step(partial(filled, mesh, mask), "replace", "filling of holes"))

    # -- strokes ------------------------------------------------------------------------------

    def _begin(self, at: QPointF, modifiers: Qt.KeyboardModifier) -> None:
        """Begin a stroke, which adds vertices with Shift and removes vertices with Alt."""
        mesh = self._document.mesh
        if mesh is None or not self._document.is_shown(self._scene.mesh):
            return
        shift = modifiers & Qt.KeyboardModifier.ShiftModifier
        alt = modifiers & Qt.KeyboardModifier.AltModifier
        self._how = "add" if shift else "remove" if alt else "replace"
        self._line, self._stroke = [at], None
        if self.mode == "brush":
            projection, away = self._scene.projection(), self._scene.renderer.away()
            if projection is not None and self._ready():
                self._front = projection.facing > 0.0
                if away is not None:
                    self._front &= ~away
                kept = None if self._how == "replace" else self._document.selection.mask
                self._stroke = np.zeros(mesh.n_vertices, np.bool_) if kept is None else kept.copy()
                assert self._geodesics is not None
                self._distances = self._geodesics[1].unreached()
                self._brush(at)

    def _move(self, at: QPointF) -> None:
        if not self._line:
            return
        if self.mode == "brush":
            self._brush(at)
            self._line = [at]
            self._show_circle()
        elif self.mode == "lasso":
            self._line.append(at)
            self._scene.outline.show_line(self._line)

    def _end(self) -> None:
        if not self._line:
            return
        if self.mode == "brush":
            self._document.selection.finish()
        elif self.mode == "lasso":
            self._scene.outline.show_line([])
            self._lasso()
        else:
            self._click(self._line[0])
        self._line = []

    def _brush(self, at: QPointF) -> None:
        """Select discs around the vertices on the line from the last pointer position to `at`."""
        if self._stroke is None or self._geodesics is None:
            return
        start = self._line[-1]
        way = at - start
        step = max(self.radius / max(self._scene.unit_per_pixel, 1e-300), 2.0)
        count = min(int(np.hypot(way.x(), way.y()) / step) + 1, _BETWEEN)
        places = [start + way * (k / count) for k in range(1, count + 1)]
        under = {self._scene.vertex_at(place.x(), place.y()) for place in places} - {-1}
        if under:
            sources = np.array(sorted(under))
            reached, _ = self._geodesics[1].within(
                sources, self.radius, self._front, self._distances
            )
            self._stroke[reached] = self._how != "remove"
            self._document.selection.draw(self._stroke, "brush")

    def _lasso(self) -> None:
        """Select the vertices in the polygon of the stroke."""
        projection, mesh = self._scene.projection(), self._document.mesh
        if projection is None or mesh is None:
            return
        polygon = np.array([self._scene.plotter.to_pixels(at.x(), at.y()) for at in self._line])
        away, picker = self._scene.renderer.away(), self._scene.renderer.picker
        work = partial(lasso, mesh, projection, polygon, away, self.through, picker)
        noun = "vertex" if self.through else "visible vertex"
        nothing = f"There is no {noun} in the lasso. The selection stays as it is."
        self._run(_Step(work, self._how, "lasso", nothing))

    def _click(self, at: QPointF) -> None:
        """Select the clicked connected part of a displayed label, otherwise of the mesh."""
        mesh, vertex = self._document.mesh, self._scene.vertex_near(at.x(), at.y())
        if mesh is None or vertex < 0:
            return
        field = self.field
        if field is not None and field.labels and np.isfinite(field.values[vertex]):
            work = partial(same_label, mesh, field.values, vertex)
            self._run(_Step(work, self._how, "part of a label"))
        else:
            self._run(_Step(partial(component, mesh, vertex), self._how, "component"))

    def _ready(self) -> bool:
        """Return `prepared`, and show a message if it is False."""
        if self.prepared:
            return True
        text = "The brush is being prepared for this mesh: try again in a moment."
        self._document.notices.show(Notice(text, holds=lambda: not self.prepared))
        return False

    def _show_circle(self) -> None:
        """Show the circle of the brush around the pointer."""
        if self.on and self.mode == "brush" and self.prepared:
            pixel = self._scene.unit_per_pixel
            radius = self.radius / pixel if pixel else 0.0
            self._scene.outline.show_circle(self._scene.plotter.pointer, radius)

    # -- threads ------------------------------------------------------------------------------

    def _prepare(self) -> None:
        mesh = self._document.mesh
        if self.on and mesh is not None and not self.prepared:
            self._preparing.submit(lambda _: prepared(mesh), partial(self._take_prepared, mesh))
            if self.mode == "brush":
                self._scene.plotter.setCursor(Qt.CursorShape.BusyCursor)

    def _take_prepared(self, mesh: Mesh, made: GeodesicSolver) -> None:
        if self._document.is_shown(mesh):
            self._geodesics = mesh, made
            self._scene.take_strokes(self.strokes)
            self._show_circle()
            self._document.notices.review()
            self.changed.emit()

    def _run(self, step: _Step) -> None:
        """Compute a step in a thread after the waiting steps, or instead of one of its drag."""
        replaces = step.live and self._step is not None and self._step.live
        self._step = step
        self._masks.submit(lambda _: step.work(), partial(self._take, step), queued=not replaces)

    def _take(self, step: _Step, mask: Mask) -> None:
        selection = self._document.selection
        if step.nothing and not mask.any():
            self._say(step.nothing)
        elif step.live:
            selection.draw(mask, step.label)
        else:
            selection.take(mask, step.how, step.label)

    def _on_mesh_changed(self) -> None:
        """Prepare the brush for a new mesh, with a radius in proportion to its size."""
        mesh, known = self._document.mesh, self._geodesics
        if mesh is not None and known is not None and self._document.is_shown(known[0]):
            return
        self._masks.drop()
        self._step = None
        if mesh is None:
            return
        self._line, self._stroke, self._geodesics = [], None, None
        self.radius = _BRUSH * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
        self._prepare()
        self.changed.emit()

    def _say(self, text: str) -> None:
        self._document.notices.say(text, Severity.INFORMATION)
