"""Annotations of the render: title, colour bar, scale bar, axes and pins, as VTK actors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt
import pyvista
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.vtkFiltersSources import vtkRegularPolygonSource
from vtkmodules.vtkRenderingAnnotation import vtkAxisActor2D
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkActor2D,
    vtkCoordinate,
    vtkPolyDataMapper,
    vtkPolyDataMapper2D,
    vtkRenderer,
    vtkTextActor,
)

from meshmash_viewer.app.view.camera import Margins, View
from meshmash_viewer.app.view.colors import NAN_COLOR, ColorMap, color_table, rgb
from meshmash_viewer.app.view.text import (
    EDGE,
    Page,
    exponent_text,
    scale_bar_text,
    set_line,
    set_plate,
    set_style,
    text_size,
    ticks,
)
from meshmash_viewer.units import round_length

# All sizes are in points. VTK converts those of fonts to pixels by the resolution of its window,
# `Page.scale` converts the others.
#: Width of the colour bar with its labels, its distance from the right edge, its own width, the
#: gap to its labels, and their smallest distance from the edge.
BAR_SPACE, _BAR_EDGE, _BAR, _GAP, _PAD = 108, 88, 14, 6, 4
_MAX_LABELS = 7
#: Font sizes of title, quantity, scale bar and labels.
TITLE, QUANTITY, _SCALE, _LABEL = 15, 12, 12, 11
#: Side of the square with the axes.
_AXES = 92
#: Colours of the x, y and z axis, which differ in brightness too.
_AXIS_COLORS = ("#d1495b", "#3f9b5c", "#3b76c4")
#: Rim of a pin, and background of its number.
_DARK = "#14181d"


@dataclass(frozen=True)
class Caption:
    """Title, unit, limits and colours of the displayed field.

    Parameters
    ----------
    title : str
        Name of the field.
    quantity : str
        Second line, such as an eigenvalue or a time with its unit.
    unit : str
        Unit of the values.
    low, high : float
        Limits of the colour bar.
    colormap : ColorMap
        Name of one of matplotlib's colour maps, or the colours of labels.
    missing : bool
        Whether some vertices have no value.
    lines : float, optional
        Spacing of lines; 0 for zero lines alone, None for no lines.
    """

    title: str
    quantity: str
    unit: str
    low: float
    high: float
    colormap: ColorMap
    missing: bool = False
    lines: float | None = None

    @property
    def table(self) -> npt.NDArray[np.uint8]:
        """Colours from the lower end to the upper, shape (256, 4)."""
        return color_table(self.colormap)


@dataclass(frozen=True)
class Pin:
    """A marked vertex: position in mesh coordinates, colour, label, whether it is hidden."""

    position: tuple[float, float, float]
    color: str
    label: str
    hidden: bool


def margins(captioned: bool, width: int, height: int, scale: float) -> Margins:
    """Margins that annotations take of a picture, for fitting the mesh between them."""
    if width < 260 * scale or height < 200 * scale:
        return Margins(*(8.0 * scale,) * 4)
    return Margins(
        left=28 * scale,
        right=(BAR_SPACE if captioned else 28) * scale,
        # includes the number of a pin below the title
        top=(76 if captioned else 28) * scale,
        bottom=58 * scale,
    )


def title_size(caption: Caption) -> tuple[int, int]:
    """Width and height in points of title and quantity, with margins."""
    lines = ((caption.title, TITLE, True), (caption.quantity, QUANTITY, False))
    wide = max(text_size(text, size, bold)[0] for text, size, bold in lines)
    return wide + 3 * EDGE, 40 + 2 * EDGE


class Annotations:
    """The actors of all annotations in a renderer."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self._renderer = renderer
        self.title, self.quantity = vtkTextActor(), vtkTextActor()
        self.bar, self.no_value, self.scale = _Strip(256), _Strip(1), vtkAxisActor2D()
        self.bar_title, self.no_value_label = vtkTextActor(), vtkTextActor()
        #: Reused for every field: VTK's own bar makes new ones, which takes 2 ms.
        self.bar_labels = tuple(vtkTextActor() for _ in range(_MAX_LABELS))
        self.pins: list[vtkActor2D] = []
        #: Renderer of the axes, which share the direction of the camera, but not its position.
        self.corner = vtkRenderer()
        self._colormap: ColorMap = ""
        self._shown: tuple[Page, Caption | None] | None = None
        self._pinned: tuple[Page, Sequence[Pin]] | None = None
        for actor in self.actors:
            actor.SetLayerNumber(1)
            renderer.AddViewProp(actor)
        for text in (self.title, self.quantity):
            text.GetTextProperty().SetVerticalJustificationToTop()
        self.no_value.paint(np.array([[*(255.0 * np.array(rgb(NAN_COLOR))), 255]], dtype=np.uint8))
        self.bar_title.GetTextProperty().SetVerticalJustificationToBottom()
        for text in (*self.bar_labels, self.no_value_label):
            text.GetTextProperty().SetVerticalJustificationToCentered()
        self._begin_scale()
        self._axis_labels = [_new_axis_label(axis) for axis in range(3)]
        self.corner.SetLayer(1)
        self.corner.InteractiveOff()
        for prop in (_new_axes(), *self._axis_labels):
            self.corner.AddViewProp(prop)
        self.corner.GetActiveCamera().ParallelProjectionOn()
        self.corner.GetActiveCamera().SetParallelScale(1.75)

    @property
    def actors(self) -> tuple[vtkActor2D, ...]:
        """All actors in the renderer."""
        return (self.title, self.quantity, *self._bar_actors, self.scale, *self.pins)

    @property
    def _bar_actors(self) -> tuple[vtkActor2D, ...]:
        strips = self.bar.actor, self.no_value.actor
        return (*strips, self.bar_title, *self.bar_labels, self.no_value_label)

    def show(
        self, page: Page, view: View | None, caption: Caption | None, unit: str, pins: Sequence[Pin]
    ) -> None:
        """Update the annotations; without a view all are hidden."""
        if view is None:
            caption, pins = None, ()
        if self._shown != (page, caption):  # setting the bar takes longest
            self._shown = page, caption
            self._set_title(page, caption)
            self._set_bar(page, caption)
        self._set_scale(page, view, unit)
        self._set_axes(page, view)
        if self._pinned != (page, pins):
            self._pinned = page, pins
            self._set_pins(page, pins)

    # -- title ------------------------------------------------------------------------------

    def _set_title(self, page: Page, caption: Caption | None) -> None:
        title, quantity = ("", "") if caption is None else (caption.title, caption.quantity)
        left, top = EDGE * page.scale, page.height - EDGE * page.scale
        set_line(self.title, title, TITLE, page, page.theme.ink, (left, top), bold=True)
        if page.height <= 160 * page.scale:
            quantity = ""
        at = left, top - 24 * page.scale
        set_line(self.quantity, quantity, QUANTITY, page, page.theme.faint_ink, at)

    # -- colour bar -------------------------------------------------------------------------

    def _set_bar(self, page: Page, caption: Caption | None) -> None:
        theme, scale = page.theme, page.scale
        # below title and quantity, which may be as wide as the picture
        tall = min(300 * scale, 0.5 * page.height, page.height - 150 * scale)
        shown = caption is not None and tall >= 70 * scale and page.width >= 220 * scale
        # labels have no bar; their names are in the panel
        shown = shown and caption is not None and isinstance(caption.colormap, str)
        for actor in self._bar_actors:
            actor.SetVisibility(shown)
        if caption is None or not shown:
            return
        if self._colormap != caption.colormap:
            self._colormap = caption.colormap
            self.bar.paint(caption.table)
        left, below = page.width - _BAR_EDGE * scale, (page.height - tall) / 2 - 15 * scale
        self.bar.place(left, below, _BAR * scale, tall)
        values, form, exponent = ticks(
            caption.low, caption.high, min(max(int(tall / (34 * scale)), 2), _MAX_LABELS)
        )
        factor = " ".join(part for part in (exponent_text(exponent), caption.unit) if part)
        above = below + tall + 8 * scale
        set_line(self.bar_title, factor, _LABEL, page, theme.faint_ink, (left, above), edge=_PAD)
        label_left = left + (_BAR + _GAP) * scale
        low, high = (end / 10.0**exponent for end in (caption.low, caption.high))
        for label, value in zip_longest(self.bar_labels, values):
            at = below if value is None else below + tall * (value - low) / (high - low)
            text = "" if value is None else form % value
            set_line(label, text, _LABEL, page, theme.ink, (label_left, at), edge=_PAD)
        self.no_value.actor.SetVisibility(caption.missing)
        self.no_value.place(left, below - 19 * scale, _BAR * scale, 10 * scale)
        text, at = "no value" if caption.missing else "", below - 14 * scale
        set_line(
            self.no_value_label,
            text,
            _LABEL,
            page,
            theme.faint_ink,
            (label_left, at),
            edge=_PAD,
        )

    # -- scale bar --------------------------------------------------------------------------

    def _begin_scale(self) -> None:
        scale = self.scale
        scale.LabelVisibilityOff()
        scale.AdjustLabelsOff()
        scale.SetNumberOfLabels(2)
        scale.UseFontSizeFromPropertyOn()
        for end in (scale.GetPoint1Coordinate(), scale.GetPoint2Coordinate()):
            end.SetCoordinateSystemToViewport()

    def _set_scale(self, page: Page, view: View | None, unit: str) -> None:
        width, height, scale = page.width, page.height, page.scale
        shown = view is not None and width >= 220 * scale and height >= 120 * scale
        self.scale.SetVisibility(shown)
        if view is None or not shown:
            return
        pixel = view.length_per_pixel(width, height)
        length = round_length(min(150 * scale, 0.25 * width) * pixel)
        right, up = width - EDGE * scale, 34 * scale
        self.scale.GetPoint1Coordinate().SetValue(right - length / pixel, up)
        self.scale.GetPoint2Coordinate().SetValue(right, up)
        self.scale.SetTitle(scale_bar_text(length, unit))
        self.scale.SetTickLength(round(5 * scale))
        self.scale.GetProperty().SetLineWidth(2.0 * scale)
        self.scale.GetProperty().SetColor(*rgb(page.theme.ink))
        set_style(self.scale.GetTitleTextProperty(), _SCALE, page.theme.ink)
        set_plate(self.scale.GetTitleTextProperty(), page, 16 * scale)

    # -- axes -------------------------------------------------------------------------------

    def _set_axes(self, page: Page, view: View | None) -> None:
        shown = view is not None and page.height >= 160 * page.scale
        self.corner.SetDraw(shown)
        if view is None or not shown:
            return
        side = _AXES * page.scale
        self.corner.SetViewport(0.0, 0.0, min(side / page.width, 1.0), side / page.height)
        for label, across in zip(self._axis_labels, view.axes[:2].T, strict=True):
            set_style(label.GetTextProperty(), _LABEL, page.theme.ink)
            # the label of an axis towards the eye would cover the others
            label.SetVisibility(bool(np.hypot(*across) > 0.25))
        camera = self.corner.GetActiveCamera()
        camera.SetPosition(*(5.0 * view.axes[2]))
        camera.SetViewUp(*view.axes[1])
        camera.SetClippingRange(1.0, 9.0)

    # -- pins -------------------------------------------------------------------------------

    def _set_pins(self, page: Page, pins: Sequence[Pin]) -> None:
        for actor in self.pins:
            self._renderer.RemoveViewProp(actor)
        self.pins = [actor for pin in pins for actor in _pin_actors(pin, page)]
        for actor in self.pins:
            self._renderer.AddViewProp(actor)


class _Strip:
    """A vertical strip of `count` coloured cells, as an actor."""

    def __init__(self, count: int) -> None:
        self._unit = pyvista.Plane(center=(0.5, 0.5, 0.0), i_resolution=1, j_resolution=count)
        self._drawn = self._unit.copy()
        self._size = 1, 1, 0
        mapper, self.actor = vtkPolyDataMapper2D(), vtkActor2D()
        mapper.SetInputData(self._drawn)
        self.actor.SetMapper(mapper)

    def paint(self, colors: npt.NDArray[np.uint8]) -> None:
        """Set the colours from the lowest cell to the highest, shape (count, 4)."""
        shades: Any = colors  # the types of pyvista lack arrays of integers
        self._drawn.cell_data.set_scalars(shades, "colors")

    def place(self, left: float, below: float, wide: float, tall: float) -> None:
        """Set position and size, in pixels from the lower left of the picture."""
        self.actor.SetPosition(round(left), round(below))
        size = round(wide), round(tall), 0
        if size != self._size:
            self._size = size
            self._drawn.points = self._unit.points * size


def _new_axes() -> vtkActor:
    """Three arrows in one actor; VTK's own axes are made anew for each frame, in 1 ms."""
    arrows = []
    for direction, color in zip(((1, 0, 0), (0, 1, 0), (0, 0, 1)), _AXIS_COLORS, strict=True):
        arrow = pyvista.Arrow(
            direction=direction, tip_length=0.22, tip_radius=0.09, shaft_radius=0.045
        )
        shade: Any = np.rint(255.0 * np.array(rgb(color))).astype(np.uint8)
        arrow.point_data.set_scalars(np.tile(shade, (arrow.n_points, 1)), "colors")
        arrows.append(arrow)
    mapper, axes = vtkPolyDataMapper(), vtkActor()
    mapper.SetInputData(arrows[0].append_polydata(*arrows[1:]))
    axes.SetMapper(mapper)
    axes.GetProperty().SetAmbient(0.7)
    axes.GetProperty().SetDiffuse(0.35)
    return axes


def _new_axis_label(axis: int) -> vtkTextActor:
    label = vtkTextActor()
    label.SetInput("xyz"[axis])
    label.GetTextProperty().SetJustificationToCentered()
    label.GetTextProperty().SetVerticalJustificationToCentered()
    label.GetPositionCoordinate().SetCoordinateSystemToWorld()
    label.GetPositionCoordinate().SetValue(*(1.3 * np.eye(3)[axis]))
    return label


def _pin_actors(pin: Pin, page: Page) -> list[vtkActor2D]:
    """Discs with a number, fainter for a pin behind the mesh."""
    scale, opacity = page.scale, 0.55 if pin.hidden else 1.0
    if pin.hidden:
        discs = [_disc(pin, 5.6, _DARK, 0.35, scale), _disc(pin, 4.6, pin.color, 0.7, scale)]
    else:
        looks = ((7.5, _DARK, 0.5), (6.6, page.theme.halo, 1.0), (4.9, pin.color, 1.0))
        discs = [_disc(pin, *look, scale) for look in looks]
    if not pin.label:
        return discs
    offset = (13.0 * scale, 12.0 * scale)
    number = vtkTextActor()
    number.SetInput(pin.label)
    set_style(number.GetTextProperty(), 10, "#ffffff", bold=True)
    number.GetTextProperty().SetOpacity(opacity)
    number.GetTextProperty().SetJustificationToCentered()
    number.GetTextProperty().SetVerticalJustificationToCentered()
    at = number.GetPositionCoordinate()
    at.SetCoordinateSystemToViewport()
    at.SetReferenceCoordinate(_at_vertex(vtkCoordinate(), pin))
    at.SetValue(*offset)
    return [*discs, _disc(pin, 8.0, _DARK, 0.75 * opacity, scale, offset), number]


def _at_vertex(coordinate: vtkCoordinate, pin: Pin) -> vtkCoordinate:
    """Set a coordinate to the vertex, which VTK projects in each frame."""
    coordinate.SetCoordinateSystemToWorld()
    coordinate.SetValue(*pin.position)
    return coordinate


def _disc(
    pin: Pin,
    radius: float,
    color: str,
    opacity: float,
    scale: float,
    offset: tuple[float, float] = (0.0, 0.0),
) -> vtkActor2D:
    circle, mapper, disc = vtkRegularPolygonSource(), vtkPolyDataMapper2D(), vtkActor2D()
    circle.SetNumberOfSides(40)
    circle.SetRadius(radius * scale)
    circle.SetCenter(*offset, 0.0)
    circle.GeneratePolylineOff()
    mapper.SetInputConnection(circle.GetOutputPort())
    disc.SetMapper(mapper)
    disc.GetProperty().SetColor(*rgb(color))
    disc.GetProperty().SetOpacity(opacity)
    _at_vertex(disc.GetPositionCoordinate(), pin)
    return disc
