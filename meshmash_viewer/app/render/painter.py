"""Flat shapes and text over the render, painted anew for each frame."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_FONT_FILE, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper2D,
    vtkRenderer,
    vtkTextActor,
    vtkTextProperty,
    vtkTextRenderer,
)

from meshmash_viewer.app.render.colors import rgb

__all__ = ["Painter"]

#: Horizontal place of a text's anchor, and vertical.
LEFT, CENTRE, RIGHT = 0, 1, 2
BOTTOM, MIDDLE, TOP = 0, 1, 2


@lru_cache(maxsize=2)
def _font_file(bold: bool) -> str:
    """DejaVu Sans as matplotlib brings it: VTK's own fonts lack Greek letters and superscripts."""
    spec = find_spec("matplotlib")
    folder = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
    return str(folder / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"))


def _text_property(size: int, bold: bool) -> vtkTextProperty:
    properties = vtkTextProperty()
    properties.SetFontFamily(VTK_FONT_FILE)
    properties.SetFontFile(_font_file(bold))
    properties.SetFontSize(size)
    return properties


@lru_cache(maxsize=512)
def _text_size(text: str, size: int, bold: bool) -> tuple[int, int]:
    box = [0, 0, 0, 0]
    vtkTextRenderer.GetInstance().GetBoundingBox(_text_property(size, bold), text, box, 72)
    return box[1] - box[0] + 1, box[3] - box[2] + 1


@dataclass
class _Part:
    """What one part of a picture consists of."""

    key: Hashable = None
    points: list[npt.NDArray[np.float64]] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    colors: list[npt.NDArray[np.uint8]] = field(default_factory=list)
    texts: list[tuple[Any, ...]] = field(default_factory=list)


def _is(one: object, other: object) -> bool:
    return one is other


class Painter:
    """Shapes and text in pixels from the lower left of a renderer.

    `begin`, then parts in the order they cover one another, then `end`; text lies over shapes.
    A part whose key has not changed is not painted again. All shapes of a frame are one actor,
    and text actors are used again, so that a frame costs less than a millisecond.

    Parameters
    ----------
    renderer : vtkRenderer
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self._renderer = renderer
        self._texts: list[vtkTextActor] = []
        self._shown: list[tuple[Any, ...] | None] = []
        self._parts: dict[str, _Part] = {}
        self._part = _Part()
        self._now: list[_Part] = []
        self._before: list[_Part] = []
        self._shapes = vtkPolyData()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._shapes)
        mapper.SetScalarModeToUsePointData()
        self._actor = vtkActor2D()
        self._actor.SetMapper(mapper)
        renderer.AddViewProp(self._actor)

    def begin(self) -> None:
        """Start a frame."""
        self._part = _Part()
        self._now = [self._part]

    def part(self, name: str, key: Hashable, paint: Callable[[], None]) -> None:
        """Paint a part of the picture, or show it as it was if its key is the same.

        Parameters
        ----------
        name : str
        key : hashable
            All that it depends on; objects without an equality of their own by identity.
        paint : callable
            Paints it.
        """
        known = self._parts.get(name)
        if known is None or known.key != key:
            self._part = self._parts[name] = known = _Part(key)
            paint()
        self._now.append(known)
        self._part = _Part()
        self._now.append(self._part)

    def end(self) -> None:
        """Show what was painted since `begin`."""
        parts = [part for part in self._now if part.sizes or part.texts]
        same = len(parts) == len(self._before) and all(map(_is, parts, self._before))
        if same:
            return
        self._before = parts
        texts = [text for part in parts for text in part.texts]
        for number, text in enumerate(texts):
            self._show_text(number, *text)
        for number in range(len(texts), len(self._texts)):
            self._texts[number].SetVisibility(False)
            self._shown[number] = None
        sizes = [size for part in parts for size in part.sizes]
        self._actor.SetVisibility(bool(sizes))
        if not sizes:
            return
        flat = np.concatenate([points for part in parts for points in part.points])
        points = vtkPoints()
        places = np.zeros((len(flat), 3), dtype=np.float32)
        places[:, :2] = flat
        points.SetData(numpy_to_vtk(places))
        cells = vtkCellArray()
        ends = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        cells.SetData(numpy_to_vtk(ends), numpy_to_vtk(np.arange(len(flat)), deep=True))
        self._shapes.SetPoints(points)
        self._shapes.SetPolys(cells)
        self._shapes.GetPointData().SetScalars(
            numpy_to_vtk(np.concatenate([colors for part in parts for colors in part.colors]))
        )

    def _add(self, corners: npt.NDArray[np.float64], rgba: npt.NDArray[np.float64]) -> None:
        """Add polygons of shape (p, m, 2) in colours of shape (p, m, 4), 0 to 255."""
        self._part.points.append(corners.reshape(-1, 2))
        self._part.sizes.extend([corners.shape[1]] * len(corners))
        self._part.colors.append(rgba.round().astype(np.uint8).reshape(-1, 4))

    def polygon(self, points: npt.ArrayLike, color: str, opacity: float = 1.0) -> None:
        """A filled convex polygon with corners of shape (m, 2)."""
        corners = np.asarray(points, dtype=np.float64)
        rgba = np.array([*(255 * part for part in rgb(color)), 255 * opacity])
        self._add(corners[None], np.broadcast_to(rgba, (1, len(corners), 4)))

    def _soften(
        self,
        inner: npt.NDArray[np.float64],
        outer: npt.NDArray[np.float64],
        color: str,
        opacity: float,
    ) -> None:
        """Fade from one outline of shape (m, 2) to the next, in quadrilaterals.

        Edges are smooth this way where the renderer does not smooth them.
        """
        corners = np.concatenate([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
        rgba = np.array([*(255 * part for part in rgb(color)), 255 * opacity])
        colors = np.tile(rgba, (len(corners), 4, 1))
        colors[:, 2:, 3] = 0.0
        self._add(corners.reshape(-1, 4, 2), colors)

    def rectangle(
        self, x: float, y: float, width: float, height: float, color: str, opacity: float = 1.0
    ) -> None:
        """A filled rectangle, on whole pixels so that its edges are sharp."""
        x0, y0, x1, y1 = round(x), round(y), round(x + width), round(y + height)
        self.polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], color, opacity)

    def plate(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        radius: float,
        colors: npt.NDArray[np.float64],
        opacity: float,
    ) -> None:
        """A rectangle with round corners in a vertical gradient.

        Parameters
        ----------
        colors : ndarray, shape (2, 3)
            Red, green and blue from 0 to 1 at its lower and at its upper edge.
        """
        low, high = round(y), round(y + height)
        edges = np.linspace(low, high, max(2, (high - low) // 2) + 1)
        middles = (edges[:-1] + edges[1:]) / 2
        into_corner = np.maximum(radius - np.minimum(middles - low, high - middles), 0.0)
        inset = radius - np.sqrt(np.maximum(radius**2 - into_corner**2, 0.0))
        left, right = x + inset, x + width - inset
        bottom, top = edges[:-1], edges[1:]
        corners = np.stack([left, bottom, right, bottom, right, top, left, top], axis=1)
        share = ((middles - low) / (high - low))[:, None]
        rgba = np.full((len(middles), 4), 255 * opacity)
        rgba[:, :3] = 255 * (colors[0] + share * (colors[1] - colors[0]))
        self._add(corners.reshape(-1, 4, 2), np.repeat(rgba[:, None], 4, axis=1))

    def line(
        self, start: npt.ArrayLike, end: npt.ArrayLike, width: float, color: str, opacity: float = 1
    ) -> None:
        """A straight line of any width."""
        a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        length = float(np.hypot(*(b - a)))
        if length > 0.0:
            side = np.array([a[1] - b[1], b[0] - a[0]]) / length
            core, edge = side * (width - 1) / 2, side * (width + 1) / 2
            self.polygon([a - core, b - core, b + core, a + core], color, opacity)
            for sign in (-1, 1):
                inner, outer = (np.array([a, b]) + sign * way for way in (core, edge))
                self._soften(inner, outer, color, opacity)

    def disc(self, x: float, y: float, radius: float, color: str, opacity: float = 1.0) -> None:
        """A filled circle."""
        angles = np.linspace(0.0, 2 * np.pi, 41)
        circle, middle = np.c_[np.cos(angles), np.sin(angles)], np.array([x, y])
        inner = middle + (radius - 0.5) * circle
        self.polygon(inner[:-1], color, opacity)
        self._soften(inner, middle + (radius + 0.5) * circle, color, opacity)

    def column(
        self, x: float, y: float, width: float, height: float, table: npt.NDArray[np.uint8]
    ) -> None:
        """A rectangle filled from below with the colours of a table of shape (m, 4)."""
        edges = np.linspace(round(y), round(y + height), len(table) + 1)
        low, high = edges[:-1, None], edges[1:, None]
        left, right = np.full_like(low, round(x)), np.full_like(low, round(x + width))
        corners = np.concatenate([left, low, right, low, right, high, left, high], axis=1)
        rgba = np.repeat(table[:, None].astype(np.float64), 4, axis=1)
        self._add(corners.reshape(-1, 4, 2), rgba)

    def text_size(self, text: str, size: float, bold: bool = False) -> tuple[int, int]:
        """Width and height of a text in pixels."""
        return _text_size(text, round(size), bold)

    def text(
        self,
        text: str,
        x: float,
        y: float,
        size: float,
        color: str,
        across: int = LEFT,
        along: int = BOTTOM,
        bold: bool = False,
        opacity: float = 1.0,
    ) -> None:
        """A line of text anchored at (x, y)."""
        place = round(x), round(y)
        self._part.texts.append((text, *place, round(size), color, across, along, bold, opacity))

    def _show_text(
        self,
        number: int,
        text: str,
        x: int,
        y: int,
        size: int,
        color: str,
        across: int,
        along: int,
        bold: bool,
        opacity: float,
    ) -> None:
        """Show a line of text by the actor of a number, unless it shows just that."""
        if number == len(self._texts):
            self._texts.append(vtkTextActor())
            self._shown.append(None)
            self._texts[-1].SetLayerNumber(1)
            self._renderer.AddViewProp(self._texts[-1])
        actor = self._texts[number]
        wanted = (text, x, y, size, color, across, along, bold, opacity)
        if self._shown[number] == wanted:
            return
        self._shown[number] = wanted
        properties = actor.GetTextProperty()
        properties.SetFontFamily(VTK_FONT_FILE)
        properties.SetFontFile(_font_file(bold))
        properties.SetFontSize(size)
        properties.SetColor(*rgb(color))
        properties.SetOpacity(opacity)
        properties.SetJustification(across)
        properties.SetVerticalJustification(along)
        actor.SetInput(text)
        actor.SetPosition(x, y)
        actor.SetVisibility(True)
