"""Figures with a size on paper: the mesh as an image; text, colour bar and scale bar as vectors.

A figure is made in three steps: `panel_of` finds the visible part of the mesh in a frame,
`sharpened` draws that part with the resolution of the figure, and `compose` adds the annotations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import matplotlib
import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.caption import Caption, Pin, PointLegend
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.page import (
    MM,
    POINTS,
    Box,
    Line,
    Page,
    bar_width,
    legend_width,
    text_width,
    wrapped,
)
from meshmash_viewer.app.view.picture import DrawFrame, draw_frame, straight
from meshmash_viewer.app.view.style import LIGHT, RenderTheme, scale_bar_text
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.write import check_output
from meshmash_viewer.units import check_number, round_length

if TYPE_CHECKING:  # loaded when the first figure is composed
    from matplotlib.figure import Figure

Background: TypeAlias = Literal["white", "transparent", "window"]

#: Minimum and maximum ratio of height to width of the images.
_FLATTEST, _TALLEST = 0.25, 1.5
#: Larger side, in pixels, of the picture in which the mesh is located; margin around the mesh.
_TRIAL, _AROUND = 640, 8
#: Maximum side of an image in pixels.
_LARGEST = 16_384


@dataclass(frozen=True)
class FigureOptions:
    """Size and contents of a figure."""

    #: Width on paper.
    width_mm: float = 85.0
    #: Pixels per inch of the images and of a PNG.
    dpi: int = 300
    #: Size of the text.
    font_points: float = 7.0
    #: "window" stands for the background of the render.
    background: Background = "white"
    #: Whether the figure contains the title, the colour bar, and so on.
    title: bool = True
    color_bar: bool = True
    scale_bar: bool = True
    axes: bool = True
    pins: bool = True

    def __post_init__(self) -> None:
        check_number(self.width_mm, "The width of a figure in mm", 10.0, 2000.0)
        check_number(self.dpi, "The resolution of a figure in dpi", 30, 2400)
        check_number(self.font_points, "The font size of a figure in points", 3.0, 72.0)
        if self.width_mm / MM * self.dpi > _LARGEST:
            size = f"{self.width_mm:g} mm at {self.dpi} dpi"
            fault = f"A figure of {size} is wider than {_LARGEST} pixels"
            raise InputError("picture-size", fault, "choose a smaller width or resolution")


@dataclass(frozen=True, eq=False)
class Around:
    """Contents of the annotations around a mesh."""

    #: Name of the mesh, drawn in a figure of two meshes.
    name: str
    caption: Caption | None
    pins: Sequence[Pin]
    unit: str
    #: Colours of the render.
    theme: RenderTheme
    #: Legend of the points over the mesh.
    legend: PointLegend | None

    @property
    def bar(self) -> Caption | None:
        """The caption, or None for a field without a colour bar, such as a map of labels."""
        caption = self.caption
        return caption if caption is not None and isinstance(caption.colormap, str) else None


@dataclass(frozen=True, eq=False)
class Panel:
    """The visible part of one mesh in a figure."""

    #: View centred on the visible part; `half_size` is half the width of the part.
    view: View
    #: Visible part, without a background, with premultiplied alpha; shape (height, width, 4).
    image: npt.NDArray[np.uint8]
    #: Height over width.
    shape: float
    around: Around

    def in_box(self, box: Box) -> View:
        """Return the view for a picture in a box; `half_size` is half of the box's smaller side."""
        share = min(box.width, box.height) / box.width
        return replace(self.view, half_size=self.view.half_size * share)


@dataclass(frozen=True)
class _Place:
    """Place of a panel on the page."""

    #: Part of the page, maximum area of the image, and area of the image.
    part: Box
    room: Box
    image: Box
    #: Lines of text that begin at the height `top`, in mm.
    lines: Sequence[Line]
    top: float
    #: Caption whose colour bar is drawn; None for no bar.
    bar: Caption | None


def seen_of(
    drawing: MeshRenderer, size: tuple[int, int] = (_TRIAL, _TRIAL), draw: DrawFrame = draw_frame
) -> Panel:
    """Return the visible part of the mesh of a drawing in a picture of a size in pixels.

    The drawing must not belong to a window. `draw` draws the picture.

    Raises
    ------
    InputError
        If the mesh is outside its view.
    """
    wide, high = (max(round(side * _TRIAL / max(size)), 1) for side in size)
    drawing.annotated = False
    return panel_of(drawing, draw(drawing, (wide, high), transparent=True, samples=1))


def panel_of(drawing: MeshRenderer, picture: npt.NDArray[np.uint8]) -> Panel:
    """Return the visible part of the mesh in the last frame of a drawing.

    `picture` is the frame without background and annotations, with premultiplied alpha (see
    `OffScreen.draw`), shape (height, width, 4).

    Raises
    ------
    InputError
        If no part of the mesh is visible.
    """
    mesh, view = drawing.mesh, drawing.view
    assert mesh is not None and view is not None  # noqa: PT018  a frame has been drawn
    caption, pins = drawing.shown_caption, drawing.placed_pins()
    around = Around(mesh.name, caption, pins, mesh.unit, drawing.theme, drawing.legend)
    high, wide, _ = picture.shape
    opaque = picture[..., 3] > 0
    if not opaque.any():
        remedy = "reset the camera, or show what is hidden"
        raise InputError("nothing-visible", "No part of the mesh is visible", remedy)
    picture = np.pad(picture, ((_AROUND, _AROUND), (_AROUND, _AROUND), (0, 0)))
    across, along = (np.flatnonzero(opaque.any(axis=axis)) for axis in (0, 1))
    # bounds, with the margin, in the padded picture
    left, right, top, foot = across[0], across[-1] + 1, along[0], along[-1] + 1
    right, foot = right + 2 * _AROUND, foot + 2 * _AROUND
    middle = (left + right) / 2 - _AROUND, high - ((top + foot) / 2 - _AROUND)
    half = 0.5 * view.length_per_pixel(wide, high) * (right - left)
    return Panel(
        replace(view, focus=view.from_pixels(*middle, wide, high), half_size=half),
        picture[top:foot, left:right],
        float((foot - top) / (right - left)),
        around,
    )


def sharpened(
    drawings: Sequence[MeshRenderer],
    panels: Sequence[Panel],
    options: FigureOptions,
    draw: DrawFrame = draw_frame,
) -> list[Panel]:
    """Return the panels with images drawn, by `draw`, at the resolution of the figure."""
    made = []
    for drawing, panel, place in zip(drawings, panels, _placed(panels, options), strict=True):
        drawing.annotated, drawing.view = False, panel.in_box(place.image)
        sides = (round(side / MM * options.dpi) for side in (place.image.width, place.image.height))
        wide, high = (max(side, 1) for side in sides)
        made.append(replace(panel, image=draw(drawing, (wide, high), transparent=True)))
    return made


def compose_figure(drawings: Sequence[MeshRenderer], options: FigureOptions) -> Figure:
    """Return a figure of one or two meshes side by side, with their annotations.

    The drawings must not belong to a window (see `MeshRenderer.twin`). The visible part of each
    mesh fills its image. The height of the figure follows from the shapes of the visible parts.

    Raises
    ------
    InputError
        If a mesh is outside its view, or the text leaves no room for the mesh.
    """
    panels = [seen_of(drawing) for drawing in drawings]
    return compose(sharpened(drawings, panels, options), options)


def compose(panels: Sequence[Panel], options: FigureOptions) -> Figure:
    """Return a figure of panels side by side (see `compose_figure`); may run in any thread."""
    from matplotlib.figure import Figure

    places = _placed(panels, options)
    high = places[0].part.height
    figure = Figure(figsize=(options.width_mm / MM, high / MM), dpi=options.dpi)
    themed = options.background == "window"
    theme, font = panels[0].around.theme, options.font_points / POINTS * MM
    ink, ground = (theme.ink, theme.background_top) if themed else (LIGHT.ink, "#ffffff")
    page = Page(figure, options.width_mm, high, font, ink, ground)
    if themed:
        page.fill(theme)
    for panel, place in zip(panels, places, strict=True):
        _draw_panel(page, panel, place, options)
    figure.patch.set_alpha(0.0 if options.background == "transparent" else 1.0)
    return figure


def picture_of(figure: Figure, dpi: float) -> npt.NDArray[np.uint8]:
    """Draw a figure with `dpi` pixels per inch; RGBA, shape (height, width, 4), top row first."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.dpi = dpi
    canvas: Any = FigureCanvasAgg(figure)  # matplotlib's types are incomplete
    canvas.draw()
    return np.array(canvas.buffer_rgba())


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, PDF or SVG, by the ending; PDF and SVG store text as text.

    Raises
    ------
    InputError
        If the ending is unknown or the file cannot be written.
    """
    path = Path(path)
    check_output(path, "figure")
    if path.suffix.lower() == ".png":  # matplotlib truncates the size to whole pixels
        pixels = np.rint(figure.get_size_inches() * figure.dpi)
        figure.set_size_inches(*(pixels + 1e-3) / figure.dpi)
    fonts: Any = {"pdf.fonttype": 42, "svg.fonttype": "none"}
    with writing_errors(path), written_whole(path) as part, matplotlib.rc_context(fonts):
        figure.savefig(part, dpi=figure.dpi, format=path.suffix[1:].lower())


def _placed(panels: Sequence[Panel], options: FigureOptions) -> list[_Place]:
    """Place the panels; images are as large as the text allows.

    Raises
    ------
    InputError
        If the text leaves no room for the meshes.
    """
    font = options.font_points / POINTS * MM
    edge = 0.4 * font
    around = [panel.around for panel in panels]
    bars = _bars(around) if options.color_bar else [None] * len(panels)
    barred = [bar for bar in bars if bar is not None]
    legends = [each.legend for each in around if each.legend is not None and options.color_bar]
    aside = font * max((*map(bar_width, barred), *map(legend_width, legends)), default=0.0)
    # a single bar for all panels is next to the last panel, so its width is subtracted once
    once = aside if len(panels) > 1 and barred == bars[-1:] and not legends else 0.0
    across = (options.width_mm - once) / len(panels)
    wide = across - 2.0 * edge - aside + once
    if wide < 5.0:
        remedy = "choose a wider figure"
        raise InputError("picture-size", "The text leaves no room for the mesh", remedy)
    named = len(panels) > 1
    lines = [_lines(each, font, across - 2.0 * edge, options, named=named) for each in around]
    above = 0.5 * font + max(sum(line.space for line in each) for each in lines)
    foot = font * (4.2 if options.axes else 2.6 if options.scale_bar else 0.5)
    widths = [2.0 * panel.view.half_size for panel in panels]
    shape = max(w * panel.shape for w, panel in zip(widths, panels, strict=True)) / max(widths)
    tall = wide * min(max(shape, _FLATTEST), _TALLEST)
    high, places = foot + tall + above, []
    for at, (panel, some) in enumerate(zip(panels, lines, strict=True)):
        width = min(wide, tall / panel.shape)
        height = width * panel.shape
        left = at * across + edge + 0.5 * (wide - width)
        image = Box(left, foot + 0.5 * (tall - height), width, height)
        last = once if at + 1 == len(panels) else 0.0
        part = Box(at * across + edge, 0.0, across - 2.0 * edge + last, high)
        room = Box(part.left, foot, wide, tall)
        places.append(_Place(part, room, image, some, high - edge, bars[at]))
    return places


def _bars(around: Sequence[Around]) -> list[Caption | None]:
    """Return the colour bar of each panel; if all are equal, only the last panel has a bar."""
    bars = [each.bar for each in around]
    plain = {bar and replace(bar, title="", quantity="", formula="", lines=None) for bar in bars}
    return bars if len(plain) > 1 else [*(None for _ in bars[1:]), bars[-1]]


def _lines(
    around: Around, font: float, width: float, options: FigureOptions, *, named: bool
) -> list[Line]:
    """Return the lines of name, title, formula and quantity, wrapped at `width` mm."""
    caption = around.caption
    if caption is None or not options.title:
        return []
    name = Line(around.name if named else "", font, 1.4 * font)
    title = Line(caption.title, 1.2 * font, 1.7 * font, bold=True)
    formula = Line(caption.formula, 0.9 * font, 1.4 * font)
    lines = name, title, formula, Line(caption.quantity, font, 1.5 * font)
    return [part for line in lines if line.text for part in wrapped(line, width)]


def _draw_panel(page: Page, panel: Panel, place: _Place, options: FigureOptions) -> None:
    """Draw a panel with its annotations."""
    image, part, font, around = place.image, place.part, page.font, panel.around
    view, right = panel.in_box(image), part.left + part.width
    # the resolution of a preview's image differs from the resolution of the page
    seen = straight(panel.image)
    page.axes(image).imshow(seen, aspect="auto", interpolation="antialiased")
    page.lines(place.lines, part.left, place.top)
    room, legend = place.room, around.legend if options.color_bar else None
    if legend is not None:
        low = page.legend(legend, right - font * legend_width(legend), room.below)
        room = Box(room.left, low, room.width, max(room.below + room.height - low, 8.0 * font))
    if place.bar is not None:
        page.bar(place.bar, right - font * bar_width(place.bar), room)
    if options.pins:
        page.pins(around.pins, view, image)
    if options.axes:
        page.directions(view.axes, (part.left, 0.4 * font))
    if options.scale_bar:
        millimetre = 2.0 * panel.view.half_size / image.width
        length = round_length(0.3 * place.room.width * millimetre)
        long, up = length / millimetre, 0.8 * font
        page.line([(right - long, up), (right, up)], page.ink, 0.2)
        text = scale_bar_text(length, around.unit)
        # text longer than the bar is moved to the left, so that the text ends within the page
        middle = min(right - 0.5 * long, right - 0.5 * font * text_width(text))
        page.text(middle, up + 0.9 * font, text, ha="center")
