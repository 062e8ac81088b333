"""Annotations of the render: title, colour bar, scale bar, axes and pins, painted over the mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingContextOpenGL2
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectf
from vtkmodules.vtkCommonTransforms import vtkTransform2D
from vtkmodules.vtkPythonContext2D import vtkPythonItem
from vtkmodules.vtkRenderingContext2D import vtkContext2D, vtkContextActor, vtkPen

from meshmash_viewer.app.view.camera import Margins, View
from meshmash_viewer.app.view.style import (
    LIGHT,
    NAN_COLOR,
    ColorMap,
    RenderTheme,
    bar_labels,
    color_table,
    fitted,
    rgb,
    scale_bar_text,
    set_style,
    text_size,
)
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.limits import Limits
from meshmash_viewer.units import round_length

# All sizes are in points. VTK converts those of fonts to pixels by the resolution of its window,
# `_Painter` converts the others.
#: Distance of text from the edge of the picture.
EDGE = 16
#: Width of the colour bar with its labels, its distance from the right edge, its own width, the
#: gap to its labels, and their smallest distance from the edge.
BAR_SPACE, _BAR_EDGE, BAR, _GAP, _PAD = 108, 88, 14, 6, 4
_MAX_LABELS = 7
#: Distance of the labels at the ends of the colour bar from the next ones.
_APART = 17
#: Number of characters of a label that there is room for.
_LONGEST = 9
#: Font sizes of title, quantity, scale bar and labels.
TITLE, QUANTITY, _SCALE, _LABEL = 15, 12, 12, 11
#: Height of the line of the formula, and of the lowest picture that has it.
_FORMULA, _FORMULA_FROM = 18, 360
#: Distance of the origin of the axes from the corner, and length of an axis.
_ORIGIN, _AXIS = 46, 26
#: Colours of the x, y and z axis, which differ in brightness too.
AXIS_COLORS = ("#d1495b", "#3f9b5c", "#3b76c4")
#: Rim of a pin, and background of its number.
_DARK = "#14181d"
#: Width in points at which the name of a pin is truncated.
_LONGEST_LABEL = 160.0
#: Height of the lowest row of a legend of points, and of each.
_LEGEND, _ROW = 104.0, 17.0
#: Justification of text in VTK: its left or lower edge, its middle, or its upper edge.
_LOW, _MIDDLE, _TOP = 0, 1, 2


@dataclass(frozen=True)
class Caption:
    """Title, unit, limits and colours of the displayed field."""

    title: str
    #: Second line, such as an eigenvalue or a time with its unit.
    quantity: str
    #: Unit of the values.
    unit: str
    low: float
    high: float
    colormap: ColorMap
    #: Whether some vertices have no value.
    missing: bool = False
    #: Whether colours follow the logarithm of the values.
    logarithmic: bool = False
    #: Whether there are values below the lower limit, and above the upper one.
    beyond: tuple[bool, bool] = (False, False)
    #: What the values are, as a short formula.
    formula: str = ""
    #: Spacing of lines; 0 for zero lines alone, None for no lines.
    lines: float | None = None

    @property
    def table(self) -> npt.NDArray[np.uint8]:
        """Colours from the lower end to the upper, shape (256, 4)."""
        return color_table(self.colormap)


def caption_of(field: Field, limits: Limits, colormap: ColorMap, *, lined: bool) -> Caption:
    """The caption of a field, with lines or without."""
    return Caption(
        field.title,
        field.description(lined),
        field.unit,
        float(limits.low),
        float(limits.high),
        colormap,
        logarithmic=limits.logarithmic,
        beyond=field.beyond(limits),
        formula=field.formula,
        lines=field.line_spacing if lined else None,
    )


@dataclass(frozen=True)
class PointLegend:
    """Colours "#rrggbb" of points with what they mean, from above; shades if `graded`."""

    title: str
    rows: tuple[tuple[str, str], ...]
    graded: bool = False


@dataclass(frozen=True)
class Pin:
    """A marked vertex, its position in mesh coordinates, colour, label, whether it is hidden."""

    vertex: int
    position: tuple[float, float, float]
    color: str
    label: str
    hidden: bool


@dataclass(frozen=True)
class Page:
    """Size of the picture in pixels, pixels per point (`scale`), and colours of annotations.

    With `plates`, text has a translucent background, which is visible in front of the mesh.
    """

    theme: RenderTheme
    width: int
    height: int
    scale: float
    plates: bool = True


def margins(captioned: bool, width: int, height: int, scale: float) -> Margins:
    """Margins that annotations take of a picture, for fitting the mesh between them."""
    if width < 260 * scale or height < 200 * scale:
        return Margins(*(8.0 * scale,) * 4)
    return Margins(
        left=28 * scale,
        right=(BAR_SPACE if captioned else 28) * scale,
        # includes the number of a pin below the title
        top=(76 + (_FORMULA if height > _FORMULA_FROM * scale else 0) if captioned else 28) * scale,
        bottom=58 * scale,
    )


class BarPlace(NamedTuple):
    """Left and lower end of the colour bar, and its height, in points from the lower left."""

    left: float
    below: float
    tall: float


def bar_place(caption: Caption, page: Page) -> BarPlace | None:
    """Return where the colour bar is; None in a small picture, and of the colours of labels."""
    width, height = page.width / page.scale, page.height / page.scale
    tall = min(300.0, 0.5 * height, height - 150.0)
    if tall < 70.0 or width < 220.0 or not isinstance(caption.colormap, str):
        return None
    return BarPlace(width - _BAR_EDGE, (height - tall) / 2 - 15, tall)


def title_size(caption: Caption, height: float = math.inf) -> tuple[int, int]:
    """Width and height in points of title, formula and quantity, in a picture of this height."""
    lines = (
        (caption.title, TITLE, True),
        (caption.quantity, QUANTITY, False),
        (caption.formula, _LABEL, False),
    )
    wide = max(text_size(text, size, bold)[0] for text, size, bold in lines)
    tall = bool(caption.formula) and height > _FORMULA_FROM
    return wide + 3 * EDGE, 40 + (_FORMULA if tall else 0) + 2 * EDGE


class Annotations:
    """Paints what `show` was given last; VTK calls `Paint` in each frame."""

    def __init__(self) -> None:
        self._page = Page(LIGHT, 1, 1, 1.0)
        self._view: View | None = None
        self._caption: Caption | None = None
        self._unit = ""
        self._pins: Sequence[Pin] = ()
        #: Shares of the colour bar at which it has handles; None for none.
        self.bar_range: tuple[float, float] | None = None
        self._legend: PointLegend | None = None

    def new_actor(self) -> vtkContextActor:
        """An actor that paints these annotations over a renderer."""
        # not an attribute: VTK cannot free a cycle through Python
        item, actor = vtkPythonItem(), vtkContextActor()
        item.SetPythonObject(self)
        actor.GetScene().AddItem(item)
        return actor

    def show(
        self,
        page: Page,
        view: View | None,
        caption: Caption | None,
        unit: str,
        pins: Sequence[Pin],
        legend: PointLegend | None = None,
    ) -> None:
        """Set what the next frames have; without a view there are no annotations."""
        self._page, self._view, self._caption = page, view, caption
        self._unit, self._pins, self._legend = unit, pins, legend

    def Initialize(self, _item: vtkPythonItem) -> bool:
        return True

    def Paint(self, _item: vtkPythonItem, context: vtkContext2D) -> bool:
        if self._view is not None:
            painter = _Painter(context, self._page)
            if self._caption is not None:
                painter.title(self._caption)
                painter.color_bar(self._caption)
                if self.bar_range is not None:
                    painter.bar_range(self._caption, self.bar_range)
            painter.scale_bar(self._view, self._unit)
            painter.axes(self._view)
            if self._legend is not None:
                painter.legend(self._legend)
            for pin in self._pins:
                painter.pin(pin, self._view)
        return True


class _Painter:
    """Paints annotations; positions and sizes are in points, from the lower left."""

    def __init__(self, context: vtkContext2D, page: Page) -> None:
        self._context, self._page, self._theme = context, page, page.theme
        self._width, self._height = page.width / page.scale, page.height / page.scale
        context.GetPen().SetLineType(vtkPen.NO_PEN)
        # VTK stretches the range from 0.5 to the size minus 0.5 over the picture
        pixels = vtkTransform2D()
        pixels.Translate(0.5, 0.5)
        pixels.Scale(1.0 - 1.0 / page.width, 1.0 - 1.0 / page.height)
        context.SetTransform(pixels)

    def title(self, caption: Caption) -> None:
        """Paint title, formula and quantity at the upper left; not all in a low picture."""
        top, theme = self._height - EDGE, self._theme
        self._text(caption.title, TITLE, theme.ink, EDGE, top, along=_TOP, bold=True)
        top -= 24
        if caption.formula and self._height > _FORMULA_FROM:
            self._text(caption.formula, _LABEL, theme.faint_ink, EDGE, top, along=_TOP)
            top -= _FORMULA
        if self._height > 160:
            self._text(caption.quantity, QUANTITY, theme.faint_ink, EDGE, top, along=_TOP)

    def color_bar(self, caption: Caption) -> None:
        """Paint the colour bar at the right, below the title, which may be as wide as the picture.

        The colours of labels have none: their names are in the panel.
        """
        place = bar_place(caption, self._page)
        if place is None:
            return
        left, below, tall = place
        next_to, theme = left + BAR + _GAP, self._theme
        self._strip(caption.table, left, below, tall)
        count = min(max(int(tall / 34), 2), _MAX_LABELS)
        named = partial(
            bar_labels, caption.low, caption.high, caption.unit, caption.logarithmic,
            gap=_APART / tall,
        )  # fmt: skip
        labels, heading = named(count)
        while count > 2 and max((len(label) for _, label in labels), default=0) > _LONGEST:
            count -= 1  # fewer labels have fewer digits
            labels, heading = named(count)
        self._text(heading, _LABEL, theme.faint_ink, left, below + tall + 12, edge=_PAD)
        for share, label in labels:
            up = below + tall * share
            self._text(label, _LABEL, theme.ink, next_to, up, along=_MIDDLE, edge=_PAD)
        # arrows say that there are values beyond the limits, in the colours of these
        for end, side, up, tip in ((0, 0, below + 1, -9), (-1, 1, below + tall - 1, 9)):
            if caption.beyond[side]:
                self._brush("#" + bytes(caption.table[end, :3]).hex())
                corners = left, up, left + BAR, up, left + BAR / 2, up + tip
                self._context.DrawPolygon([self._page.scale * each for each in corners], 3)
        if caption.missing:
            grey = np.rint([[*(255.0 * np.array(rgb(NAN_COLOR))), 255.0]]).astype(np.uint8)
            self._strip(grey, left, below - 24, 10)
            up = below - 19
            self._text("no value", _LABEL, theme.faint_ink, next_to, up, along=_MIDDLE, edge=_PAD)

    def bar_range(self, caption: Caption, ends: tuple[float, float]) -> None:
        """Paint handles at two shares of the colour bar, and cover what is not between them."""
        place = bar_place(caption, self._page)
        if place is None:
            return
        left, below, tall = place
        ground = "#{:02x}{:02x}{:02x}".format(*(round(255 * c) for c in self._theme.ground(0.5)))
        for low, high in ((0.0, ends[0]), (ends[1], 1.0)):
            if high > low:
                self._rectangle(ground, left, below + tall * low, BAR, tall * (high - low), 0.75)
        for share, side in zip(ends, (-1.0, 1.0), strict=True):
            up = below + tall * share
            self._rectangle(self._theme.ink, left - 3.0, up - 1.0, BAR + 5.0, 2.0)
            corners = left - 2.0, up, left - 12.0, up, left - 12.0, up + 9.0 * side
            self._brush(self._theme.ink)
            self._context.DrawPolygon([self._page.scale * each for each in corners], 3)

    def scale_bar(self, view: View, unit: str) -> None:
        """Paint a round length at the lower right."""
        if self._width < 220 or self._height < 120:
            return
        point = view.length_per_pixel(self._page.width, self._page.height) * self._page.scale
        length = round_length(min(150.0, 0.25 * self._width) * point)
        left, right, up = self._width - EDGE - length / point, self._width - EDGE, 34.0
        for x, y, wide, tall in (
            (left, up - 1, right - left, 2), (left, up - 5, 2, 5), (right - 2, up - 5, 2, 5)
        ):  # fmt: skip
            self._rectangle(self._theme.ink, x, y, wide, tall)
        x, text = (left + right) / 2, scale_bar_text(length, unit)
        self._text(text, _SCALE, self._theme.ink, x, up - 13, _MIDDLE, _TOP)

    def axes(self, view: View) -> None:
        """Paint arrows along the axes of the mesh at the lower left, the nearest on top."""
        if self._height < 160:
            return
        for axis in np.argsort(view.axes[2]):
            x, y = view.axes[:2, axis]
            self._arrow(AXIS_COLORS[axis], _ORIGIN, _ORIGIN, _AXIS * x, _AXIS * y)
            if np.hypot(x, y) > 0.25:  # otherwise the label would cover the others
                x, y = _ORIGIN + 1.3 * _AXIS * x, _ORIGIN + 1.3 * _AXIS * y
                ink = self._theme.ink
                self._text("xyz"[axis], _LABEL, ink, x, y, _MIDDLE, _MIDDLE, plated=False)

    def legend(self, legend: PointLegend) -> None:
        """Paint what the colours of points mean, at the left above the axes."""
        rows = legend.rows
        if self._height < _LEGEND + _ROW * (len(rows) + 6):  # with the title of the field
            return
        up = _LEGEND + _ROW * len(rows)
        self._text(legend.title, _LABEL, self._theme.ink, EDGE, up, along=_MIDDLE, bold=True)
        for color, text in rows:
            up -= _ROW
            if legend.graded:
                self._rectangle(color, EDGE, up - _ROW / 2, 12.0, _ROW)
            else:
                self._disc(_DARK, EDGE + 6.0, up, 5.0)
                self._disc(color, EDGE + 6.0, up, 4.2)
            text = fitted(text, _LONGEST_LABEL, lambda part: text_size(part, _LABEL, False)[0])
            self._text(text, _LABEL, self._theme.ink, EDGE + 19.0, up, along=_MIDDLE)

    def pin(self, pin: Pin, view: View) -> None:
        """Paint discs with a number or a name, fainter for a pin behind the mesh."""
        size = self._page.width, self._page.height
        x, y = view.to_pixels(np.array(pin.position), *size)[0, :2] / self._page.scale
        discs = [(7.5, _DARK, 0.5), (6.6, self._theme.halo, 1.0), (4.9, pin.color, 1.0)]
        if pin.hidden:
            discs = [(5.6, _DARK, 0.35), (4.6, pin.color, 0.7)]
        for radius, color, opacity in discs:
            self._disc(color, x, y, radius, opacity)
        if pin.label:
            opacity = 0.8 if pin.hidden else 1.0
            x, y = x + 13.0, y + 12.0
            free = max(min(_LONGEST_LABEL, self._width - x - 6.0), 12.0)
            label = fitted(pin.label, free, lambda part: text_size(part, 10, True)[0])
            half = text_size(label, 10, True)[0] / 2.0 + 5.0
            if half <= 12.0:
                self._disc(_DARK, x, y, 8.0, 0.75 * opacity)
            else:
                x += half - 10.0
                self._rectangle(_DARK, x - half, y - 8.0, 2.0 * half, 16.0, 0.75 * opacity)
            self._text(
                label, 10, "#ffffff", x, y, _MIDDLE, _MIDDLE, bold=True, plated=False,
                opacity=opacity,
            )  # fmt: skip

    # -- shapes -----------------------------------------------------------------------------

    def _pixels(self, *points: float) -> list[int]:
        return [round(self._page.scale * each) for each in points]

    def _text(
        self,
        text: str,
        size: int,
        ink: str,
        x: float,
        y: float,
        across: int = _LOW,
        along: int = _LOW,
        *,
        bold: bool = False,
        plated: bool = True,
        opacity: float = 1.0,
        edge: float = EDGE,
    ) -> None:
        """Write a line, truncated at `edge` from the right edge if it begins at x."""
        if across == _LOW:
            free = self._width - x - edge
            text = fitted(text, free, lambda part: text_size(part, size, bold)[0])
        if not text:
            return
        look = self._context.GetTextProp()
        set_style(look, size, ink, bold)
        look.SetOpacity(opacity)
        look.SetJustification(across)
        look.SetVerticalJustification(along)
        # in invisible steps: VTK opens the font again for each colour beyond 30
        look.SetBackgroundColor(*self._theme.ground(round(8.0 * (y - 6.0) / self._height) / 8.0))
        look.SetBackgroundOpacity(0.6 if plated and self._page.plates else 0.0)
        left, up = self._pixels(x, y)
        self._context.DrawString(left, up, text)

    def _brush(self, color: str, opacity: float = 1.0) -> None:
        self._context.GetBrush().SetColorF(*rgb(color), opacity)

    def _rectangle(
        self, color: str, x: float, y: float, wide: float, tall: float, opacity: float = 1.0
    ) -> None:
        self._brush(color, opacity)
        self._context.DrawRect(*self._pixels(x, y, wide, tall))

    def _disc(self, color: str, x: float, y: float, radius: float, opacity: float = 1.0) -> None:
        self._brush(color, opacity)
        self._context.DrawEllipse(*(self._page.scale * each for each in (x, y, radius, radius)))

    def _arrow(self, color: str, x: float, y: float, along: float, up: float) -> None:
        """Paint a shaft and a head from a position; towards the eye, the head is a disc."""
        length = max(float(np.hypot(along, up)), 1e-9)
        forward, left = np.array([along, up]) / length, np.array([-up, along]) / length
        share = min(length / _AXIS, 1.0)
        start = np.array([x, y])
        neck, tip = start + (length - 7.0 * share) * forward, start + length * forward
        self._brush(color)
        for corners in (
            (start - 1.2 * left, start + 1.2 * left, neck + 1.2 * left, neck - 1.2 * left),
            (neck - 3.2 * left, neck + 3.2 * left, tip),
        ):
            flat = (self._page.scale * np.array(corners)).ravel().tolist()
            self._context.DrawPolygon(flat, len(corners))
        if share < 0.5:
            self._disc(color, neck[0], neck[1], 3.2)

    def _strip(self, colors: npt.NDArray[np.uint8], x: float, y: float, tall: float) -> None:
        """Paint a vertical strip of colours, from the lowest to the highest."""
        image = vtkImageData()
        image.SetDimensions(1, len(colors), 1)
        image.GetPointData().SetScalars(numpy_to_vtk(colors, deep=True))
        self._brush("#ffffff")
        self._context.DrawImage(vtkRectf(*self._pixels(x, y, BAR, tall)), image)
