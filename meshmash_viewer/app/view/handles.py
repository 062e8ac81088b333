"""Handles on the render for the clipping plane and for the selected range of the colour bar."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from vtkmodules.vtkInteractionWidgets import vtkImplicitPlaneRepresentation
from vtkmodules.vtkRenderingCore import vtkCellPicker, vtkProp, vtkPropCollection

from meshmash_viewer.app.view.annotations import BAR, BarPlace, bar_place
from meshmash_viewer.app.view.style import rgb
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.surface.rays import Plane

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer

#: Colour of the handle.
_COLOR = "#f59e0b"
#: Size of the handle in pixels of the screen.
_SIZE = 9.0
#: Index of the first actor of arrow and ball in VTK's widget, after the actors of the plane.
_ARROW = 3
#: Minimum squared length of the projected unit normal at which the ball follows the pointer.
_STEEPEST = 0.05
#: Minimum arm, in pixels, of the rotation of the arrow; a shorter arm would rotate it too fast.
_SHORTEST = 20.0
#: Distance in points from the left side of the bar, and from its other sides, at which a handle
#: can be grabbed.
_LEFT, _BEYOND = 16.0, 6.0


class CutHandle:
    """Handle of the clipping plane: a ball to move the plane, and an arrow to rotate it.

    The ball moves along the normal of the plane; the arrow points to the side that is cut away.
    Only the outline of the plane is drawn. The outline cannot be dragged, so that the mesh under it
    can be clicked, rotated and painted. VTK's widget is used for drawing and picking only, because
    it does not keep ball and arrow under the pointer during a drag.
    """

    def __init__(self, drawing: MeshRenderer) -> None:
        self._drawing = drawing
        #: Called with the plane while the handle is dragged.
        self.moved: Callable[[Plane], None] = lambda _plane: None
        made = self._widget = vtkImplicitPlaneRepresentation()
        made.SetRenderer(drawing.renderer)
        made.SetPlaceFactor(1.1)
        made.SetHandleSize(_SIZE)
        made.SetDrawOutline(False)
        made.SetDrawPlane(False)
        made.SetTubing(False)
        made.SetEdgeColor(*rgb(_COLOR))
        made.GetEdgesProperty().SetLighting(False)
        made.GetEdgesProperty().SetLineWidth(1.5)
        made.GetNormalProperty().SetColor(*rgb(_COLOR))
        made.VisibilityOff()
        drawing.handle = made
        drawing.renderer.AddViewProp(made)
        # picks ball and arrow only, not the plane and its outline
        self._picker = vtkCellPicker()
        self._picker.PickFromListOn()
        actors = vtkPropCollection()
        made.GetActors(actors)
        for at in range(_ARROW, actors.GetNumberOfItems()):
            actor = actors.GetItemAsObject(at)
            assert isinstance(actor, vtkProp)
            self._picker.AddPickList(actor)
            self._ball = actor  # the last actor is the ball
        #: Positions of ball and pointer at the start of a drag. Distance from the ball to the
        #: grabbed point of the arrow, negative behind the plane; 0 if the ball was grabbed.
        self._origin, self._start, self._arm = np.zeros(3), np.zeros(2), 0.0

    def show(self, plane: Plane | None, bounds: FloatArray) -> None:
        """Place the handle at a plane of a mesh with bounds of shape (2, 3); None hides it."""
        made = self._widget
        made.SetVisibility(plane is not None)
        if plane is None:
            return
        box = bounds.T.ravel().tolist()
        if list(made.GetWidgetBounds()) != box:
            made.SetWidgetBounds(box)
            made.PlaceWidget(box)
            made.SetOrigin(*bounds.mean(axis=0))
        made.SetNormal(*-plane.normal)
        origin = np.array(made.GetOrigin())
        made.SetOrigin(*(origin - (plane.normal @ origin - plane.level) * plane.normal))
        made.BuildRepresentation()

    def grab(self, x: float, y: float) -> bool:
        """Grab the ball or the arrow at a position in pixels; return whether one was grabbed."""
        made, view = self._widget, self._drawing.view
        if view is None or not made.GetVisibility():
            return False
        if not self._picker.Pick(x, y, 0.0, self._drawing.renderer):
            return False
        self._origin, self._start, self._arm = np.array(made.GetOrigin()), np.array([x, y]), 0.0
        if self._picker.GetActor() is not self._ball:
            arm = float((self._picker.GetPickPosition() - self._origin) @ made.GetNormal())
            shortest = _SHORTEST * view.length_per_pixel(*self._drawing.renderer.GetSize())
            self._arm = np.copysign(max(abs(arm), shortest), arm)
        return True

    def drag(self, x: float, y: float) -> None:
        """Move the ball along the normal, or rotate the arrow, to a position in pixels."""
        view, size, origin = self._drawing.view, self._drawing.renderer.GetSize(), self._origin
        if view is None:
            return
        normal = -np.array(self._widget.GetNormal())
        pixel = view.length_per_pixel(*size)
        if self._arm:
            across = (np.array([x, y]) - view.to_pixels(origin, *size)[0, :2]) * pixel / self._arm
            far = float(np.hypot(*across))
            # a pointer farther from the ball than the arrow's length rotates the arrow in the plane
            # of the screen; at a nearer pointer, the arrow stays in front of or behind that plane
            depth = np.sqrt(max(1.0 - far**2, 0.0)) * (1.0 if view.axes[2] @ normal <= 0 else -1.0)
            normal = -(np.array([*(across / max(far, 1.0)), depth]) @ view.axes)
        else:
            seen = (view.axes @ normal)[:2]
            way = float(seen @ (np.array([x, y]) - self._start))
            origin = origin + way * pixel / max(float(seen @ seen), _STEEPEST) * normal
            self._widget.SetOrigin(*origin)
        self.moved(Plane(normal, float(normal @ origin)))


class BarHandles:
    """Handles of the colour bar, which move the ends of `Annotations.bar_range`."""

    def __init__(self, drawing: MeshRenderer) -> None:
        self._drawing = drawing
        #: Called with both positions, 0 to 1, while a handle is dragged.
        self.moved: Callable[[float, float], None] = lambda _low, _high: None
        #: Whether the upper handle is being dragged.
        self._upper = False

    def _place(self) -> tuple[BarPlace, tuple[float, float]] | None:
        """Return the places of the bar and of its handles; None without handles."""
        drawing, ends = self._drawing, self._drawing.annotations.bar_range
        place = None if drawing.caption is None else bar_place(drawing.caption, drawing.page)
        return None if place is None or ends is None else (place, ends)

    def grab(self, x: float, y: float) -> bool:
        """Grab the nearer handle, and move it to a position in pixels; return False off the bar."""
        if (found := self._place()) is None:
            return False
        place, ends = found
        scale, beyond = self._drawing.page.scale, _BEYOND / place.tall
        across, share = x / scale - place.left, (y / scale - place.below) / place.tall
        if not (-_LEFT <= across <= BAR + _BEYOND and -beyond <= share <= 1.0 + beyond):
            return False
        middle = (ends[0] + ends[1]) / 2.0
        self._upper = share > middle or (ends[0] == ends[1] and middle < 0.5)
        self.drag(x, y)
        return True

    def drag(self, _x: float, y: float) -> None:
        """Move the handle to the height of a position, at most to the other handle."""
        if (found := self._place()) is not None:
            place, (low, high) = found
            share = (y / self._drawing.page.scale - place.below) / place.tall
            share = min(max(share, 0.0), 1.0)
            self.moved(*((low, max(share, low)) if self._upper else (min(share, high), high)))
