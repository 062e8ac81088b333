"""Points over the surface, coloured by a column of their table, with a legend."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.caption import PointLegend
from meshmash_viewer.app.view.style import NAN_COLOR, color_table, rgb
from meshmash_viewer.app.view.surface import Overlay, overlay_actor
from meshmash_viewer.features.points import ProjectedPoints
from meshmash_viewer.model.pins import PIN_COLORS
from meshmash_viewer.units import distinct_digits, format_number

#: Maximum number of categories with a colour, and number of shades in the legend of numbers.
_CATEGORIES, _SHADES = 9, 6
_COLORS = "plasma"
#: Offset towards the camera, in units of depth, that makes points just below the surface visible.
_FRONT = -4e4
#: Minimum radius, in logical pixels, around the pointer in which a point is picked.
_NEAR = 5.0


def point_colors(
    found: ProjectedPoints, column: str
) -> tuple[npt.NDArray[np.uint8], PointLegend | None]:
    """Return the colours of the points assigned to a vertex, shape (m, 3), and their legend."""
    m = found.n_near
    values = found.points.columns.get(column)
    if values is None:
        return np.tile(_bytes(PIN_COLORS[0]), (m, 1)), None
    values = values[found.near]
    named = values.dtype.kind in "OSUb" or len(np.unique(values)) <= _CATEGORIES
    if not named and values.dtype.kind in "iuf":
        return _graded(values.astype(np.float64), column)
    return _categories(values, column)


def _graded(values: npt.NDArray[np.float64], title: str) -> tuple[Any, PointLegend]:
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    table, width = color_table(_COLORS)[:, :3], high - low or 1.0
    places = np.nan_to_num(255.0 * (values - low) / width).astype(np.int64)
    colors = np.where(np.isfinite(values)[:, None], table[places], _bytes(NAN_COLOR))
    digits = distinct_digits(low, high, 3)
    shades = np.linspace(1.0, 0.0, _SHADES)
    rows = [
        ("#" + bytes(table[round(255 * at)]).hex(), format_number(low + at * width, digits))
        for at in shades
    ]
    more = [(NAN_COLOR, "no value")] if len(known) < len(values) else []
    return colors.astype(np.uint8), PointLegend(title, (*rows, *more), graded=True)


def _categories(values: npt.NDArray[Any], title: str) -> tuple[Any, PointLegend]:
    """Return colours of the most frequent values, grey for other values, and the legend."""
    texts = np.array(["" if each is None else str(each) for each in values.tolist()])
    names, places, counts = np.unique(texts, return_inverse=True, return_counts=True)
    by_count = np.argsort(-counts, kind="stable").tolist()
    order = [at for at in by_count if names[at]][:_CATEGORIES]
    table = np.tile(_bytes(NAN_COLOR), (len(names), 1))
    for color, at in zip(PIN_COLORS, order, strict=False):
        table[at] = _bytes(color)
    rows = [(color, str(names[at])) for color, at in zip(PIN_COLORS, order, strict=False)]
    more = [(NAN_COLOR, "others")] if len(order) < len(names) else []
    return table[places], PointLegend(title, (*rows, *more))


def _bytes(color: str) -> npt.NDArray[np.uint8]:
    return np.array([round(255 * share) for share in rgb(color)], dtype=np.uint8)


class PointCloud(Overlay):
    """Overlay of the points assigned to a vertex; each point moves with its vertex."""

    def __init__(
        self,
        found: ProjectedPoints,
        colors: npt.NDArray[np.uint8],
        legend: PointLegend | None,
        size: float,
    ) -> None:
        import pyvista  # slow to import, and not needed by pictures without points

        #: Rows of the table, and vertices, of the drawn points.
        self.rows = np.flatnonzero(found.near)
        self.vertices = found.vertices[self.rows]
        self.legend, self.size = legend, size
        self._away = (found.positions[self.rows] - found.mesh.vertices[self.vertices]).astype("f4")
        self._visible = np.arange(len(self.rows))
        #: View and size of a window, and the positions of the points in it in pixels.
        self._pixels: tuple[Any, npt.NDArray[Any]] = (None, np.zeros((0, 3)))
        self._data = pyvista.PolyData(np.zeros(self._away.shape, dtype=np.float32))
        self._data["colors"] = colors
        self._make_actor()

    def _make_actor(self) -> None:
        self.actor = overlay_actor(self._data, _FRONT)
        self._mappers = [self.actor.GetMapper()]

    def move(self, drawn: npt.NDArray[np.float32]) -> None:
        self._data.points = drawn[self.vertices] + self._away
        self._pixels = None, self._pixels[1]

    def hide(self, hidden: npt.NDArray[np.bool_] | None) -> None:
        shown = np.ones(len(self.rows), dtype=bool) if hidden is None else ~hidden[self.vertices]
        self._visible = np.flatnonzero(shown)
        self._data.verts = np.insert(self._visible[:, None], 0, 1, axis=1).ravel()

    def set_scale(self, scale: float) -> None:
        self.actor.GetProperty().SetPointSize(self.size * scale)

    def near(
        self, pixel: tuple[float, float], view: View, size: tuple[int, int, float], centre: Any
    ) -> npt.NDArray[np.int64]:
        """Return the indices of the drawn points at a position in pixels, nearest first."""
        if self._pixels[0] != (view, size):
            self._pixels = (view, size), view.to_pixels(self._data.points + centre, *size[:2])
        away = np.hypot(*(self._pixels[1][:, :2] - pixel).T)[self._visible]
        found = np.flatnonzero(away <= max(self.size / 2.0, _NEAR) * size[2])
        return np.asarray(self._visible[found[away[found].argsort()]])
