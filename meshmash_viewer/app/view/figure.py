"""Figures for a paper: renders as images, with text, colour bar and scale bar as vectors."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.colors import LIGHT, NAN_COLOR, color_table
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import OffScreen, straight
from meshmash_viewer.app.view.text import bar_labels, exponent_text, scale_bar_text
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.io.write import check_output
from meshmash_viewer.units import round_length

Background: TypeAlias = Literal["white", "transparent", "window"]

#: Millimetres and points of an inch.
_MM, _POINTS = 25.4, 72.0
#: Height over width of the images, at least and at most, where the meshes decide.
_FLATTEST, _TALLEST = 0.25, 1.5
#: Pixels of the trial that finds the mesh in its picture, and the image's size over the mesh's.
_TRIAL, _ROOM = 400, 1.04
#: Largest side of an image in pixels.
_LARGEST = 16_384
#: Width of the colour bar and of its labels, in font sizes.
_BAR, _LABELS = 1.2, 5.5
_AXIS_COLORS = ("#d1495b", "#3f9b5c", "#3b76c4")
_CELLS = 128


@dataclass(frozen=True)
class FigureOptions:
    """Size and contents of a figure.

    Parameters
    ----------
    width_mm : float
        Width on paper.
    dpi : int
        Pixels of the images per inch, and of a PNG.
    font_points : float
        Size of the text.
    background : {"white", "transparent", "window"}
        "window" is the background of the render.
    title, color_bar, scale_bar, axes, pins : bool
        What is drawn around the mesh.
    """

    width_mm: float = 85.0
    dpi: int = 300
    font_points: float = 7.0
    background: Background = "white"
    title: bool = True
    color_bar: bool = True
    scale_bar: bool = True
    axes: bool = True
    pins: bool = True

    def __post_init__(self) -> None:
        if not 10.0 <= self.width_mm <= 2000.0:
            raise InputError("The width of a figure must be between 10 and 2000 mm.")
        if not 30 <= self.dpi <= 2400:
            raise InputError("The resolution of a figure must be between 30 and 2400 dpi.")
        if not 3.0 <= self.font_points <= 72.0:
            raise InputError("The font size of a figure must be between 3 and 72 points.")
        if self.width_mm / _MM * self.dpi > _LARGEST:
            raise InputError(
                f"A figure of {self.width_mm:g} mm at {self.dpi} dpi is wider than {_LARGEST}"
                " pixels: choose a smaller width or resolution."
            )


@dataclass(frozen=True)
class _Box:
    """A rectangle of the figure in mm from its lower left corner."""

    left: float
    below: float
    width: float
    height: float


def compose_figure(drawings: Sequence[MeshRenderer], options: FigureOptions) -> Figure:
    """Draw meshes side by side, each with its caption, colour bar and scale bar.

    Parameters
    ----------
    drawings : sequence of MeshRenderer
        One or two, in no window (`MeshRenderer.twin`). Each is drawn along its view, zoomed to
        what that view shows of the mesh.
    options : FigureOptions

    Returns
    -------
    matplotlib.figure.Figure
        Of the width asked for; its height follows from the meshes.

    Raises
    ------
    InputError
        If the mesh is outside its view.
    """
    font = options.font_points / _POINTS * _MM
    captions = [drawing.shown_caption for drawing in drawings]
    barred = options.color_bar and any(
        caption is not None and isinstance(caption.colormap, str) for caption in captions
    )
    panel = options.width_mm / len(drawings)
    wide = panel - font * (0.8 + (_BAR + _LABELS if barred else 0.0))
    if wide < 5.0:
        raise InputError("The text leaves no room for the mesh: choose a wider figure.")
    titled = options.title and any(caption is not None for caption in captions)
    top = font * (3.9 if titled else 0.5)
    foot = font * (4.2 if options.axes else 2.6 if options.scale_bar else 0.5)
    seen = [_extent(drawing) for drawing in drawings]
    shape = max(view.half_size * tall for view, tall in seen) / max(v.half_size for v, _ in seen)
    tall = wide * min(max(shape, _FLATTEST), _TALLEST)
    high = top + tall + foot
    figure = Figure(figsize=(options.width_mm / _MM, high / _MM), dpi=options.dpi)
    ink = drawings[0].theme.ink if options.background == "window" else LIGHT.ink
    page = _Page(figure, options.width_mm, high, font, ink)
    if options.background == "window":
        page.fill(drawings[0])
    for at, (drawing, (view, shape)) in enumerate(zip(drawings, seen, strict=True)):
        box = _Box(at * panel + 0.4 * font, foot, wide, tall)
        _draw_panel(page, drawing, _fitted(view, shape, box), box, options, titled)
    figure.patch.set_alpha(0.0 if options.background == "transparent" else 1.0)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, PDF or SVG, by the ending; text of PDF and SVG stays text.

    Raises
    ------
    InputError
        If the ending is unknown or the file cannot be written.
    """
    path = Path(path)
    check_output(path, "figure")
    fonts: Any = {"pdf.fonttype": 42, "svg.fonttype": "none"}
    with writing_errors(path), written_whole(path) as part, matplotlib.rc_context(fonts):
        figure.savefig(part, dpi=figure.dpi, format=path.suffix[1:].lower())


def _extent(drawing: MeshRenderer) -> tuple[View, float]:
    """Find what a view shows of the mesh.

    Returns
    -------
    view : View
        Centred on it, `half_size` half its width.
    float
        Its height over its width.
    """
    drawing.annotated = False
    with closing(OffScreen(drawing, (_TRIAL, _TRIAL), transparent=True)) as window:
        opaque = window.draw()[::-1, :, 3] > 0
    view = drawing.view
    across, along = (np.flatnonzero(opaque.any(axis=axis)) for axis in (0, 1))
    if view is None or not len(across):
        raise InputError("No part of the mesh is in the view: reset the camera.")
    left, right, low, up = across[0], across[-1] + 1, along[0], along[-1] + 1
    focus = view.from_pixels((left + right) / 2, (low + up) / 2, _TRIAL, _TRIAL)
    pixel = view.length_per_pixel(_TRIAL, _TRIAL)
    half = 0.5 * pixel * (right - left)
    return replace(view, focus=focus, half_size=half), float((up - low) / (right - left))


def _fitted(view: View, shape: float, box: _Box) -> View:
    """Zoom a view from `_extent` to fill a box."""
    pixel = _ROOM * 2.0 * view.half_size * max(1.0 / box.width, shape / box.height)
    return replace(view, half_size=0.5 * pixel * min(box.width, box.height))


class _Page:
    """A figure to which text, lines and images are added at positions in mm."""

    def __init__(self, figure: Figure, width: float, height: float, font: float, ink: str) -> None:
        self.figure, self.width, self.height = figure, width, height
        self.font, self.ink = font, ink

    def axes(self, box: _Box) -> Axes:
        """Add axes without frame."""
        rectangle = (
            box.left / self.width,
            box.below / self.height,
            box.width / self.width,
            box.height / self.height,
        )
        axes = self.figure.add_axes(rectangle)
        axes.set_axis_off()
        return axes

    def text(self, x: float, y: float, text: str, size: float = 1.0, **style: Any) -> None:
        """Write a line; `size` in font sizes."""
        points = size * self.font / _MM * _POINTS
        style = {"color": self.ink, "va": "center", **style}
        self.figure.text(x / self.width, y / self.height, text, fontsize=points, **style)

    def line(self, points: Sequence[tuple[float, float]], color: str, width: float) -> None:
        """Draw a line through points, `width` in font sizes."""
        axes = self.axes(_Box(0.0, 0.0, self.width, self.height))
        axes.set(xlim=(0.0, self.width), ylim=(0.0, self.height))
        axes.plot(*zip(*points, strict=True), color=color, lw=width * self.font / _MM * _POINTS)

    def fill(self, drawing: MeshRenderer) -> None:
        """Fill the page with the background of the render."""
        axes = self.axes(_Box(0.0, 0.0, self.width, self.height))
        shades = [[drawing.theme.ground(share)] for share in np.linspace(1.0, 0.0, 64)]
        axes.imshow(shades, aspect="auto", interpolation="bilinear")


def _draw_panel(
    page: _Page,
    drawing: MeshRenderer,
    view: View,
    box: _Box,
    options: FigureOptions,
    titled: bool,
) -> None:
    """Draw a mesh into a box, with its annotations."""
    drawing.view = view
    size = tuple(round(side / _MM * options.dpi) for side in (box.width, box.height))
    with closing(OffScreen(drawing, (size[0], size[1]), transparent=True)) as window:
        pixels = straight(window.draw())
    page.axes(box).imshow(pixels, aspect="auto", interpolation="none")
    font, caption = page.font, drawing.shown_caption
    over = box.below + box.height
    if titled and caption is not None:
        page.text(box.left, over + 2.9 * font, caption.title, 1.2, weight="bold")
        page.text(box.left, over + 1.3 * font, caption.quantity)
    if options.color_bar and caption is not None and isinstance(caption.colormap, str):
        _draw_bar(page, drawing, _Box(box.left + box.width, box.below, 0.0, box.height))
    if options.pins:
        _draw_pins(page, drawing, view, box)
    if options.axes:
        _draw_axes(page, view.axes, (box.left + 1.8 * font, 1.6 * font))
    if options.scale_bar and drawing.mesh is not None:
        millimetre = view.length_per_pixel(1, 1) / min(box.width, box.height)
        length = round_length(0.25 * box.width * millimetre)
        right, up = box.left + box.width, 0.8 * font
        page.line([(right - length / millimetre, up), (right, up)], page.ink, 0.2)
        middle = right - 0.5 * length / millimetre
        text = scale_bar_text(length, drawing.mesh.unit)
        page.text(middle, up + 0.9 * font, text, ha="center")


def _draw_bar(page: _Page, drawing: MeshRenderer, box: _Box) -> None:
    """Draw the colour bar of a field to the right of a box, half as high."""
    caption, font = drawing.shown_caption, page.font
    assert caption is not None
    left, tall = box.left + 0.8 * font, min(0.6 * box.height, 20.0 * font)
    below = box.below + 0.5 * (box.height - tall)
    axes = page.axes(_Box(left, below, _BAR * font, tall))
    colors = color_table(caption.colormap, _CELLS)[:, None, :] / 255.0
    edges = np.linspace(0.0, 1.0, _CELLS + 1)
    # quadrilaterals, so that the bar is no image in PDF and SVG
    axes.pcolormesh([0.0, 1.0], edges, colors, edgecolors="face", linewidth=0.1)
    most = min(max(int(tall / (2.5 * font)), 3), 7)
    labels, exponent = bar_labels(caption.low, caption.high, caption.logarithmic, most)
    right = left + (_BAR + 0.5) * font
    for share, label in labels:
        page.text(right, below + tall * share, label.replace("-", "−"))
    for end, side, up, tip in ((0, 0, 0.0, -0.7), (-1, 1, tall, 0.7)):
        if caption.beyond[side]:
            axes = page.axes(_Box(left, below + up + min(tip, 0.0) * font, _BAR * font, 0.7 * font))
            base, point = (0.0, 1.0) if tip > 0.0 else (1.0, 0.0)
            axes.fill([0.0, 1.0, 0.5], [base, base, point], color=colors[end, 0])
            axes.set(xlim=(0, 1), ylim=(0, 1))
    factor = " ".join(part for part in (exponent_text(exponent), caption.unit) if part)
    page.text(left, below + tall + 1.4 * font, factor)
    if caption.missing:
        axes = page.axes(_Box(left, below - 1.8 * font, _BAR * font, 0.9 * font))
        axes.fill([0, 1, 1, 0], [0, 0, 1, 1], color=NAN_COLOR)
        axes.set(xlim=(0, 1), ylim=(0, 1))
        page.text(right, below - 1.35 * font, "no value")


def _draw_pins(page: _Page, drawing: MeshRenderer, view: View, box: _Box) -> None:
    """Draw the pins as discs with their labels; fainter where the mesh hides them."""
    pins = drawing.placed_pins()
    if not pins:
        return
    # millimetres as pixels
    places = view.to_pixels(np.array([pin.position for pin in pins]), *_millimetres(box))
    scale = box.width / _millimetres(box)[0]
    axes = page.axes(box)
    axes.set(xlim=(0.0, box.width), ylim=(0.0, box.height))
    points = page.font / _MM * _POINTS
    for pin, (x, y, _) in zip(pins, places * scale, strict=True):
        alpha = 0.55 if pin.hidden else 1.0
        axes.plot(
            x, y, "o", ms=0.8 * points, mfc=pin.color, mec="#ffffff", mew=0.12 * points, alpha=alpha
        )
        axes.annotate(
            pin.label, (x, y), (0.7 * points, 0.7 * points), textcoords="offset points",
            fontsize=points, color=page.ink, alpha=alpha,
        )  # fmt: skip


def _millimetres(box: _Box) -> tuple[int, int]:
    """Size of a box in hundredths of a millimetre, as whole numbers."""
    return round(100.0 * box.width), round(100.0 * box.height)


def _draw_axes(page: _Page, axes: npt.NDArray[np.float64], at: tuple[float, float]) -> None:
    """Draw the directions of x, y and z from a point, those away from the eye first."""
    length = 1.6 * page.font
    for axis in np.argsort(axes[2]):
        across, along = length * axes[:2, axis]
        color = _AXIS_COLORS[axis]
        page.line([at, (at[0] + across, at[1] + along)], color, 0.18)
        if np.hypot(across, along) > 0.25 * length:
            page.text(at[0] + 1.35 * across, at[1] + 1.35 * along, "xyz"[axis], 0.9, ha="center")
