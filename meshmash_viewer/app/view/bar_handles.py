"""Two handles at the colour bar, between which values are selected."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from meshmash_viewer.app.view.annotations import BAR, bar_place

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_renderer import MeshRenderer

#: Points at which a handle is taken hold of to the left of the bar, and beyond its other sides.
_LEFT, _BEYOND = 16.0, 6.0


class BarHandles:
    """Moves the ends of `MeshRenderer.bar_range`, shares of the colour bar."""

    def __init__(self, drawing: MeshRenderer) -> None:
        self._drawing = drawing
        #: Called with both shares while one is dragged.
        self.moved: Callable[[float, float], None] = lambda _low, _high: None
        #: Whether the upper one is held.
        self._upper = False

    def grab(self, x: float, y: float) -> bool:
        """Take hold of the nearer handle, and move it to a position in pixels at the bar."""
        page, caption = self._drawing.page, self._drawing.caption
        place = None if caption is None else bar_place(caption, page)
        ends = self._drawing.bar_range
        if place is None or ends is None:
            return False
        across, share = x / page.scale - place.left, (y / page.scale - place.below) / place.tall
        beyond = _BEYOND / place.tall
        if not (-_LEFT <= across <= BAR + _BEYOND and -beyond <= share <= 1.0 + beyond):
            return False
        middle = (ends[0] + ends[1]) / 2.0
        self._upper = share > middle or (ends[0] == ends[1] and middle < 0.5)
        self.drag(x, y)
        return True

    def drag(self, _x: float, y: float) -> None:
        """Move the handle, as far as the other one."""
        page, caption, ends = self._drawing.page, self._drawing.caption, self._drawing.bar_range
        place = None if caption is None else bar_place(caption, page)
        if place is None or ends is None:
            return
        share = min(max((y / page.scale - place.below) / place.tall, 0.0), 1.0)
        low, high = ends
        self.moved(*((low, max(share, low)) if self._upper else (min(share, high), high)))

    def release(self) -> None:
        """Let go of the handle."""
