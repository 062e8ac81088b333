"""Flat shapes and text over the render, painted anew for each frame."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkPolyDataMapper2D,
    vtkRenderer,
)

from meshmash_viewer.app.view.colors import rgb
from meshmash_viewer.app.view.text_layer import Block, Text, TextLayer, text_size

__all__ = ["Painter"]

#: Horizontal place of a text's anchor, and vertical.
LEFT, CENTRE, RIGHT = 0, 1, 2
BOTTOM, MIDDLE, TOP = 0, 1, 2


@dataclass
class _Part:
    """What one part of a picture consists of."""

    key: Hashable = None
    points: list[npt.NDArray[np.float32]] = field(default_factory=list)
    sizes: list[npt.NDArray[np.int32]] = field(default_factory=list)
    colors: list[npt.NDArray[np.uint8]] = field(default_factory=list)
    texts: list[Text | Block] = field(default_factory=list)

    def join(self) -> None:
        """Make one array of many, so that this is not done for each frame."""
        if len(self.sizes) > 1:
            self.points = [np.concatenate(self.points)]
            self.sizes = [np.concatenate(self.sizes)]
            self.colors = [np.concatenate(self.colors)]

    def looks_like(self, other: _Part) -> bool:
        """Whether it has the same shapes as another one; both have some, and have been joined."""
        return self is other or (
            _equal(self.sizes[0], other.sizes[0])
            and _equal(self.points[0], other.points[0])
            and _equal(self.colors[0], other.colors[0])
        )


def _equal(one: npt.NDArray[np.generic], other: npt.NDArray[np.generic]) -> bool:
    return one is other or np.array_equal(one, other)  # a lone plate is often the very same


@lru_cache(maxsize=256)
def _colored(color: str, opacity: float, count: int) -> npt.NDArray[np.uint8]:
    """One colour for a number of corners, shape (count, 4)."""
    rgba = np.array([*(255 * part for part in rgb(color)), 255 * opacity])
    return np.tile(rgba.round().astype(np.uint8), (count, 1))


@lru_cache(maxsize=8)
def _sizes(count: int, each: int) -> npt.NDArray[np.int32]:
    """That many polygons of as many corners each."""
    return np.full(count, each, dtype=np.int32)


@lru_cache(maxsize=64)
def _plate(
    low: int,
    high: int,
    x: float,
    width: float,
    radius: float,
    ends: tuple[tuple[float, ...], ...],
    opacity: float,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    """A rectangle with round corners in slices of shape (p, 4, 2), and their colours.

    `ends` are the colours at its lower and at its upper edge.
    """
    edges = np.linspace(low, high, max(2, (high - low) // 2) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    into_corner = np.maximum(radius - np.minimum(middles - low, high - middles), 0.0)
    inset = radius - np.sqrt(np.maximum(radius**2 - into_corner**2, 0.0))
    left, right = x + inset, x + width - inset
    bottom, top = edges[:-1], edges[1:]
    corners = np.stack([left, bottom, right, bottom, right, top, left, top], axis=1)
    share = (middles - low) / (high - low)
    lower, upper = np.array(ends)
    rgba = np.full((len(share), 4, 4), 255 * opacity)
    rgba[..., :3] = 255 * (lower + share[:, None, None] * (upper - lower))
    return corners.reshape(-1, 2).astype(np.float32), rgba.round().astype(np.uint8).reshape(-1, 4)


class _Shapes:
    """The shapes of all parts, in one actor."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self._parts: list[_Part] = []
        self._ends = np.zeros(0, dtype=np.int32)
        self._corners = np.zeros((0, 3), dtype=np.float32)
        self._rgba = np.zeros((0, 4), dtype=np.uint8)
        self._points = vtkPoints()
        self._data = vtkPolyData()
        self._data.SetPoints(self._points)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._data)
        mapper.SetScalarModeToUsePointData()
        self._actor = vtkActor2D()
        self._actor.SetMapper(mapper)
        self._actor.VisibilityOff()
        renderer.AddViewProp(self._actor)

    def show(self, parts: list[_Part]) -> None:
        """Show parts whose arrays have been joined, and nothing else."""
        parts = [part for part in parts if part.sizes]
        before, self._parts = self._parts, parts
        if len(parts) == len(before) and all(map(_Part.looks_like, parts, before)):
            return
        self._actor.SetVisibility(bool(parts))
        if not parts:
            return
        flat = np.concatenate([part.points[0] for part in parts])
        sizes = np.concatenate([part.sizes[0] for part in parts])
        colors = np.concatenate([part.colors[0] for part in parts])
        ends = np.zeros(len(sizes) + 1, dtype=np.int32)
        np.cumsum(sizes, out=ends[1:])
        if not np.array_equal(ends, self._ends[: len(ends)]):
            self._make_room(ends)
        self._corners[: len(flat), :2] = flat
        self._corners[len(flat) :] = 0.0  # polygons that are not needed have no size
        self._rgba[: len(flat)] = colors
        for changed in (self._points.GetData(), self._data.GetPointData().GetScalars()):
            changed.Modified()
        self._data.Modified()

    def _make_room(self, ends: npt.NDArray[np.int32]) -> None:
        """Have memory for polygons that end there: new arrays for VTK take longest of all here."""
        self._ends, count = ends, int(ends[-1])
        self._corners = np.zeros((count, 3), dtype=np.float32)
        self._rgba = np.zeros((count, 4), dtype=np.uint8)
        self._points.SetData(numpy_to_vtk(self._corners))
        self._data.GetPointData().SetScalars(numpy_to_vtk(self._rgba))
        cells = vtkCellArray()
        cells.SetData(numpy_to_vtk(ends), numpy_to_vtk(np.arange(count, dtype=np.int32)))
        self._data.SetPolys(cells)


class Painter:
    """Shapes and text in pixels from the lower left of a renderer.

    `begin`, then parts, then `end`. A part whose key has not changed is not painted again, and
    shapes stay on the graphics card while none of them changes; all of them are one actor, because
    actors take longer to draw than shapes, and so are all texts with their blocks.

    Parameters
    ----------
    renderer : vtkRenderer
    names : sequence of str
        Of all parts, in the order in which they cover one another; text covers them all.
    """

    def __init__(self, renderer: vtkRenderer, names: Sequence[str]) -> None:
        self._names = names
        self._parts: dict[str, _Part] = {}
        self._shapes = _Shapes(renderer)
        self._part = _Part()
        self._now: list[str] = []
        self._texts = TextLayer(renderer)

    def begin(self) -> None:
        """Start a frame."""
        self._now = []

    def part(self, name: str, key: Hashable, paint: Callable[[], None]) -> None:
        """Paint a part of the picture, or show it as it was if its key is the same.

        Parameters
        ----------
        name : str
            One of those that the painter was made with.
        key : hashable
            All that it depends on; objects without an equality of their own by identity.
        paint : callable
            Paints it.
        """
        known = self._parts.get(name)
        if known is None or known.key != key:
            self._part = self._parts[name] = known = _Part(key)
            paint()
            known.join()
        self._now.append(name)

    def end(self) -> None:
        """Show what was painted since `begin`."""
        self._shapes.show([self._parts[name] for name in self._names if name in self._now])
        self._texts.show([text for name in self._now for text in self._parts[name].texts])

    def _add(self, corners: npt.NDArray[np.floating], rgba: npt.NDArray[np.floating]) -> None:
        """Add polygons of shape (p, m, 2) in colours of shape (p, m, 4), 0 to 255."""
        self._part.points.append(corners.reshape(-1, 2).astype(np.float32))
        self._part.sizes.append(_sizes(*corners.shape[:2]))
        self._part.colors.append(rgba.round().astype(np.uint8).reshape(-1, 4))

    def polygon(self, points: npt.ArrayLike, color: str, opacity: float = 1.0) -> None:
        """A filled convex polygon with corners of shape (m, 2)."""
        corners = np.array(points, dtype=np.float32)
        self._part.points.append(corners)
        self._part.sizes.append(_sizes(1, len(corners)))
        self._part.colors.append(_colored(color, opacity, len(corners)))

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

    def block(self, x: float, y: float, width: float, height: float, color: str) -> None:
        """A small filled rectangle that is drawn with the text: cheap where it often changes."""
        sides = round(x), round(y), max(round(width), 1), max(round(height), 1)
        self._part.texts.append(Block(*sides, color))

    def plate(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        radius: float,
        ends: tuple[tuple[float, ...], ...],
        opacity: float,
    ) -> None:
        """A rectangle with round corners in a vertical gradient.

        Parameters
        ----------
        ends : pair of (float, float, float)
            Red, green and blue from 0 to 1 at its lower and at its upper edge.
        """
        corners, rgba = _plate(round(y), round(y + height), x, width, radius, ends, opacity)
        self._part.points.append(corners)
        self._part.sizes.append(_sizes(len(corners) // 4, 4))
        self._part.colors.append(rgba)

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
        corners = np.empty((len(table), 4, 2), dtype=np.float32)
        corners[:, 0::3, 0], corners[:, 1:3, 0] = round(x), round(x + width)
        corners[:, :2, 1], corners[:, 2:, 1] = edges[:-1, None], edges[1:, None]
        self._part.points.append(corners.reshape(-1, 2))
        self._part.sizes.append(_sizes(len(table), 4))
        self._part.colors.append(np.repeat(table, 4, axis=0))

    def text_size(self, text: str, size: float, bold: bool = False) -> tuple[int, int]:
        """Width and height of a text in pixels."""
        return text_size(text, round(size), bold)

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
        self._part.texts.append(
            Text(text, round(x), round(y), round(size), color, across, along, bold, opacity)
        )
