"""Annotations of the render: title, colour bar, scale bar, axes, legend and pins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import vtkmodules.vtkRenderingContextOpenGL2
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkCommonTransforms import vtkTransform2D
from vtkmodules.vtkPythonContext2D import vtkPythonItem
from vtkmodules.vtkRenderingContext2D import vtkContext2D, vtkContextActor, vtkPen
from vtkmodules.vtkRenderingCore import vtkProp, vtkRenderer, vtkTextActor

from meshmash_viewer.app.view.camera import Margins, View
from meshmash_viewer.app.view.caption import Caption, Pin, PointLegend
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
from meshmash_viewer.units import round_length

# All sizes are in points. VTK converts font sizes to pixels by the resolution of its window;
# `_Layout` converts all other sizes.
#: Distance of text from the edge of the picture.
EDGE = 16
#: Width of the colour bar with its labels, distance of the bar from the right edge, width of the
#: bar, gap between bar and labels, and minimum distance of labels from the edge.
BAR_SPACE, _BAR_EDGE, BAR, _GAP, _PAD = 108, 88, 14, 6, 4
_MAX_LABELS = 7
#: Minimum distance between the label at an end of the colour bar and the next label.
_APART = 17
#: Maximum number of characters of a label next to the colour bar.
_LONGEST = 9
#: Font sizes of title, quantity, scale bar and labels.
TITLE, QUANTITY, _SCALE, _LABEL = 15, 12, 12, 11
#: Height of the line of the formula, and minimum height of a picture with a formula.
_FORMULA, _FORMULA_FROM = 18, 360
#: Distance of the origin of the axes from the corner, and length of an axis.
_ORIGIN, _AXIS = 46, 26
#: Colours of the x, y and z axis; they differ in brightness as well.
AXIS_COLORS = ("#d1495b", "#3f9b5c", "#3b76c4")
#: Colour of the rim of a pin, and of the background of its number.
_DARK = "#14181d"
#: Maximum width of the name of a pin and of a row of the legend; longer texts are truncated.
_LONGEST_LABEL = 160.0
#: Distance of the legend from the lower edge of the picture, and height of a row.
_LEGEND, _ROW = 104.0, 17.0
#: Justification of text in VTK: the anchor is at the left or lower edge, the middle, or the top.
_LOW, _MIDDLE, _TOP = 0, 1, 2


@dataclass(frozen=True)
class Page:
    """Size of a picture, and appearance of its annotations."""

    theme: RenderTheme
    #: Size in pixels.
    width: int
    height: int
    #: Pixels per point.
    scale: float
    #: Whether text has a translucent background.
    plates: bool = True


def margins(captioned: bool, width: int, height: int, scale: float) -> Margins:
    """Return the margins of the picture, in pixels, kept free of the mesh for the annotations."""
    if width < 260 * scale or height < 200 * scale:
        return Margins(*(8.0 * scale,) * 4)
    return Margins(
        left=28 * scale,
        right=(BAR_SPACE if captioned else 28) * scale,
        # leaves space, below the title, for the number of a pin at the top of the mesh
        top=(76 + (_FORMULA if height > _FORMULA_FROM * scale else 0) if captioned else 28) * scale,
        bottom=58 * scale,
    )


class BarPlace(NamedTuple):
    """Left edge, lower end and height of the colour bar, in points; the origin is lower left."""

    left: float
    below: float
    tall: float


def bar_place(caption: Caption, page: Page) -> BarPlace | None:
    """Return the place of the colour bar; None in a small picture, and for a map of labels."""
    width, height = page.width / page.scale, page.height / page.scale
    tall = min(300.0, 0.5 * height, height - 150.0)
    if tall < 70.0 or width < 220.0 or not isinstance(caption.colormap, str):
        return None
    return BarPlace(width - _BAR_EDGE, (height - tall) / 2 - 15, tall)


def title_size(caption: Caption, height: float = math.inf) -> tuple[int, int]:
    """Return width and height, in points, of the block of title, formula and quantity.

    `height` is the height of the picture in points.
    """
    lines = (
        (caption.title, TITLE, True),
        (caption.quantity, QUANTITY, False),
        (caption.formula, _LABEL, False),
    )
    wide = max(text_size(text, size, bold)[0] for text, size, bold in lines)
    tall = bool(caption.formula) and height > _FORMULA_FROM
    return wide + 3 * EDGE, 40 + (_FORMULA if tall else 0) + 2 * EDGE


class Text(NamedTuple):
    """A line of text; (x, y) is its anchor in pixels from the lower left of the picture."""

    text: str
    x: int
    y: int
    size: int
    ink: str
    bold: bool
    #: Horizontal and vertical justification: `_LOW`, `_MIDDLE` or `_TOP`.
    across: int
    along: int
    opacity: float
    #: Colour and opacity of the background.
    ground: tuple[float, ...]
    plate: float


class Shape(NamedTuple):
    """A filled shape."""

    #: Name of a method of `vtkContext2D`, and its arguments in pixels.
    draw: str
    arguments: tuple[Any, ...]
    color: str
    opacity: float = 1.0


class _Shapes:
    """Shapes drawn by `Paint`, which VTK calls at each frame."""

    def __init__(self) -> None:
        self.page = Page(LIGHT, 1, 1, 1.0)
        self.shapes: Sequence[Shape] = ()

    def Initialize(self, _item: vtkPythonItem) -> bool:
        return True

    def Paint(self, _item: vtkPythonItem, context: vtkContext2D) -> bool:
        context.GetPen().SetLineType(vtkPen.NO_PEN)
        # VTK maps the range from 0.5 to the size minus 0.5 to the picture
        pixels = vtkTransform2D()
        pixels.Translate(0.5, 0.5)
        pixels.Scale(1.0 - 1.0 / self.page.width, 1.0 - 1.0 / self.page.height)
        context.SetTransform(pixels)
        for draw, arguments, color, opacity in self.shapes:
            context.GetBrush().SetColorF(*rgb(color), opacity)
            getattr(context, draw)(*arguments)
        return True


class Annotations:
    """Shapes and texts drawn over a renderer, set by `show`.

    Each line of text is a separate actor, whose text VTK rasterizes only after a change.
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self._renderer, self._shapes = renderer, _Shapes()
        item, actor = vtkPythonItem(), vtkContextActor()
        # not `self`: VTK could not free a reference cycle through Python objects
        item.SetPythonObject(self._shapes)
        actor.GetScene().AddItem(item)
        renderer.AddViewProp(actor)
        #: All actors of the annotations.
        self.props: list[vtkProp] = [actor]
        self._lines: list[vtkTextActor] = []
        #: The displayed texts.
        self.texts: list[Text] = []
        #: Positions of the handles at the colour bar, from 0 to 1; None for no handles.
        self.bar_range: tuple[float, float] | None = None

    @property
    def shapes(self) -> Sequence[Shape]:
        """The displayed shapes."""
        return self._shapes.shapes

    def show(
        self,
        page: Page,
        view: View | None,
        caption: Caption | None,
        unit: str,
        pins: Sequence[Pin],
        legend: PointLegend | None = None,
    ) -> None:
        """Set the annotations of the next frames; without a view, frames have no annotations."""
        layouts = []
        if view is not None:
            if caption is not None:
                layouts.append(_caption_layout(page, caption, self.bar_range))
            layouts.append(_view_layout(page, view, unit, tuple(pins), legend))
        self._shapes.page = page
        self._shapes.shapes = [shape for layout in layouts for shape in layout.shapes]
        self._write([text for layout in layouts for text in layout.texts])

    def _write(self, texts: list[Text]) -> None:
        """Update the actors whose text or appearance has changed, and hide unused actors."""
        for _ in texts[len(self._lines) :]:
            self._lines.append(line := vtkTextActor())
            self.props.append(line)
            self._renderer.AddViewProp(line)
        for line, text, before in zip_longest(self._lines, texts, self.texts):
            if text == before:
                continue
            line.SetVisibility(text is not None)
            if text is not None:
                line.SetInput(text.text)
                line.SetPosition(text.x, text.y)
                look = line.GetTextProperty()
                set_style(look, text.size, text.ink, text.bold)
                look.SetOpacity(text.opacity)
                look.SetJustification(text.across)
                look.SetVerticalJustification(text.along)
                look.SetBackgroundColor(*text.ground)
                look.SetBackgroundOpacity(text.plate)
        self.texts = texts


class _Layout:
    """Converter of annotations to shapes and texts.

    Positions passed to the methods are in points from the lower left of the picture.
    """

    def __init__(self, page: Page) -> None:
        self._page, self._theme = page, page.theme
        self._width, self._height = page.width / page.scale, page.height / page.scale
        self.shapes: list[Shape] = []
        self.texts: list[Text] = []

    def title(self, caption: Caption) -> None:
        """Add title, formula and quantity at the upper left; omit lines in a picture too low."""
        top, theme = self._height - EDGE, self._theme
        self._text(caption.title, TITLE, theme.ink, EDGE, top, along=_TOP, bold=True)
        top -= 24
        if caption.formula and self._height > _FORMULA_FROM:
            self._text(caption.formula, _LABEL, theme.faint_ink, EDGE, top, along=_TOP)
            top -= _FORMULA
        if self._height > 160:
            self._text(caption.quantity, QUANTITY, theme.faint_ink, EDGE, top, along=_TOP)

    def color_bar(self, caption: Caption) -> None:
        """Add the colour bar at the right, below the title, which may be as wide as the picture."""
        place = bar_place(caption, self._page)
        if place is None:
            return
        left, below, tall = place
        next_to, theme = left + BAR + _GAP, self._theme
        x, y, *size = self._pixels(left, below, BAR, tall)
        image = _bar_image(caption.colormap, *size)
        self.shapes.append(Shape("DrawImage", (x, y, image), "#ffffff"))
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
        # triangles at the ends indicate values beyond the limits
        for end, side, up, tip in ((0, 0, below + 1, -9), (-1, 1, below + tall - 1, 9)):
            if caption.beyond[side]:
                color = "#" + bytes(caption.table[end, :3]).hex()
                self._polygon(color, left, up, left + BAR, up, left + BAR / 2, up + tip)
        if caption.missing:
            self._rectangle(NAN_COLOR, left, below - 24, BAR, 10)
            up = below - 19
            self._text("no value", _LABEL, theme.faint_ink, next_to, up, along=_MIDDLE, edge=_PAD)

    def bar_range(self, caption: Caption, ends: tuple[float, float]) -> None:
        """Add handles at two positions, 0 to 1, of the colour bar; fade the bar beyond them."""
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
            self._polygon(self._theme.ink, *corners)

    def scale_bar(self, view: View, unit: str) -> None:
        """Add a bar of a round length at the lower right."""
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
        """Add arrows along the axes of the mesh at the lower left, the nearest on top."""
        if self._height < 160:
            return
        for axis in np.argsort(view.axes[2]):
            x, y = view.axes[:2, axis]
            self._arrow(AXIS_COLORS[axis], _ORIGIN, _ORIGIN, _AXIS * x, _AXIS * y)
            if np.hypot(x, y) > 0.25:  # an axis seen end-on has no label, which would cover others
                x, y = _ORIGIN + 1.3 * _AXIS * x, _ORIGIN + 1.3 * _AXIS * y
                ink = self._theme.ink
                self._text("xyz"[axis], _LABEL, ink, x, y, _MIDDLE, _MIDDLE, plated=False)

    def legend(self, legend: PointLegend) -> None:
        """Add the legend of points at the left above the axes."""
        rows = legend.rows
        if self._height < _LEGEND + _ROW * (len(rows) + 6):  # 6 rows for the title of the field
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
        """Add a disc with a number or a name, fainter if the mesh hides the pin."""
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
        """Add a line of text, truncated `edge` points from the right edge if left-justified."""
        free = self._width - x - edge
        # letters that are not bold are, with rare exceptions, at most as wide as the font size
        if across == _LOW and (bold or len(text) * size > free):
            text = fitted(text, free, lambda part: text_size(part, size, bold)[0])
        if not text:
            return
        # rounded to a few backgrounds: VTK opens the font again for each text style beyond 30
        ground = self._theme.ground(round(8.0 * (y - 6.0) / self._height) / 8.0)
        plate = 0.6 if plated and self._page.plates else 0.0
        left, up = self._pixels(x, y)
        self.texts.append(
            Text(text, left, up, size, ink, bold, across, along, opacity, ground, plate)
        )

    def _rectangle(
        self, color: str, x: float, y: float, wide: float, tall: float, opacity: float = 1.0
    ) -> None:
        place = self._pixels(x, y, wide, tall)
        self.shapes.append(Shape("DrawRect", tuple(place), color, opacity))

    def _disc(self, color: str, x: float, y: float, radius: float, opacity: float = 1.0) -> None:
        place = tuple(self._page.scale * each for each in (x, y, radius, radius))
        self.shapes.append(Shape("DrawEllipse", place, color, opacity))

    def _polygon(self, color: str, *corners: float) -> None:
        pixels = [self._page.scale * each for each in corners]
        self.shapes.append(Shape("DrawPolygon", (pixels, len(corners) // 2), color))

    def _arrow(self, color: str, x: float, y: float, along: float, up: float) -> None:
        """Add an arrow that begins at (x, y); an arrow seen almost end-on has a disc as head."""
        length = max(float(np.hypot(along, up)), 1e-9)
        forward, left = np.array([along, up]) / length, np.array([-up, along]) / length
        share = min(length / _AXIS, 1.0)
        start = np.array([x, y])
        neck, tip = start + (length - 7.0 * share) * forward, start + length * forward
        for corners in (
            (start - 1.2 * left, start + 1.2 * left, neck + 1.2 * left, neck - 1.2 * left),
            (neck - 3.2 * left, neck + 3.2 * left, tip),
        ):
            self._polygon(color, *np.ravel(corners).tolist())
        if share < 0.5:
            self._disc(color, neck[0], neck[1], 3.2)


@lru_cache(maxsize=8)
def _bar_image(colormap: ColorMap, width: int, height: int) -> vtkImageData:
    """Return the image of a colour bar; width and height are in pixels.

    The image is cached, because VTK uploads each new image object to the graphics card.
    """
    colors = color_table(colormap)[np.arange(height) * 256 // height]
    image = vtkImageData()
    image.SetDimensions(width, height, 1)
    image.GetPointData().SetScalars(numpy_to_vtk(np.repeat(colors, width, axis=0), deep=True))
    return image


@lru_cache(maxsize=4)
def _caption_layout(page: Page, caption: Caption, bar_range: tuple[float, float] | None) -> _Layout:
    """Return the annotations that depend on the field."""
    layout = _Layout(page)
    layout.title(caption)
    layout.color_bar(caption)
    if bar_range is not None:
        layout.bar_range(caption, bar_range)
    return layout


@lru_cache(maxsize=4)
def _view_layout(
    page: Page, view: View, unit: str, pins: tuple[Pin, ...], legend: PointLegend | None
) -> _Layout:
    """Return the annotations that depend on the camera and the mesh."""
    layout = _Layout(page)
    layout.scale_bar(view, unit)
    layout.axes(view)
    if legend is not None:
        layout.legend(legend)
    for pin in pins:
        layout.pin(pin, view)
    return layout
