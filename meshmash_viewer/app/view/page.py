"""Page of a figure: text, lines, colour bars and images at positions in mm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.annotations import AXIS_COLORS
from meshmash_viewer.app.view.camera import View
from meshmash_viewer.app.view.caption import Caption, Pin, PointLegend
from meshmash_viewer.app.view.style import NAN_COLOR, RenderTheme, bar_labels, color_table

if TYPE_CHECKING:  # loaded when the first figure is composed
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Millimetres and points per inch.
MM, POINTS = 25.4, 72.0
#: Width of a colour bar, gap to its labels, and space around bar and labels, in font sizes.
_BAR, _GAP, _AROUND = 1.2, 0.5, 1.2
#: Maximum height of a colour bar in font sizes.
_TALLEST = 20.0
#: Maximum number of labels of a colour bar, and minimum distance between labels in font sizes.
_MOST, _APART = 7, 1.3
#: Number of rectangles that make up a colour bar.
_CELLS = 128
#: Coordinates x and y of the corners of a whole box, from 0 to 1.
_SQUARE = (0, 1, 1, 0), (0, 0, 1, 1)


@dataclass(frozen=True)
class Box:
    """A rectangle of the page in mm from its lower left corner."""

    left: float
    below: float
    width: float
    height: float


@dataclass(frozen=True)
class Line:
    """A line of text."""

    text: str
    #: Font size, and distance to the next line, in mm.
    size: float
    space: float
    bold: bool = False


def text_width(text: str, bold: bool = False) -> float:
    """Return the width of a text in font sizes."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=100.0, weight="bold" if bold else "normal")
    return float(text_to_path.get_text_width_height_descent(text, font, ismath=False)[0]) / 100.0


def wrapped(line: Line, width: float) -> list[Line]:
    """Break a line at spaces into lines of at most `width` mm; longer words have a smaller font."""
    lines, begun = list[str](), ""
    for word in line.text.split(" "):  # a no-break space joins a number and its unit
        longer = f"{begun} {word}".lstrip()
        if begun and line.size * text_width(longer, line.bold) > width:
            lines.append(begun)
            longer = word
        begun = longer
    lines += [begun] if begun else []
    sizes = (min(line.size, width / text_width(text, line.bold)) for text in lines)
    return [
        Line(text, size, line.space, line.bold) for text, size in zip(lines, sizes, strict=True)
    ]


def _bar_texts(caption: Caption, size: float) -> tuple[str, dict[float, str]]:
    """Return the heading of a colour bar, and its labels by position, 0 to 1.

    `size` is the height of the bar in font sizes.
    """
    ends = caption.low, caption.high
    most, gap = min(max(int(size / _APART), 3), _MOST), _APART / size
    labels, heading = bar_labels(*ends, caption.unit, caption.logarithmic, most, gap)
    return heading, dict(labels)


def bar_width(caption: Caption) -> float:
    """Return the width of a colour bar with its text and surrounding space, in font sizes."""
    factor, labels = _bar_texts(caption, _TALLEST)
    texts = [*labels.values(), "no value" if caption.missing else ""]
    return _AROUND + max(text_width(factor), _BAR + _GAP + max(map(text_width, texts)))


def legend_width(legend: PointLegend) -> float:
    """Return the width of a legend of points with surrounding space, in font sizes."""
    texts = max(text_width(text) for _, text in legend.rows)
    return _AROUND + max(text_width(legend.title, True), _BAR + _GAP + texts)


class Page:
    """A figure to which text, lines and images are added at positions in mm.

    `width`, `height` and the font size `font` are in mm. Text has the colour `ink`; text over the
    mesh has a background of the colour `ground`.
    """

    def __init__(
        self, figure: Figure, width: float, height: float, font: float, ink: str, ground: str
    ) -> None:
        self.figure, self.width, self.height = figure, width, height
        self.font, self.ink, self.ground = font, ink, ground

    def axes(self, box: Box) -> Axes:
        """Add matplotlib axes without a frame in a box."""
        rectangle = (
            box.left / self.width,
            box.below / self.height,
            box.width / self.width,
            box.height / self.height,
        )
        axes = self.figure.add_axes(rectangle)
        axes.set_axis_off()
        return axes

    def patch(self, box: Box, color: Any, x: Sequence[float], y: Sequence[float]) -> None:
        """Fill a polygon; the coordinates `x` and `y` of its corners are from 0 to 1 in a box."""
        axes = self.axes(box)
        axes.fill(x, y, color=color)
        axes.set(xlim=(0, 1), ylim=(0, 1))

    def text(self, x: float, y: float, text: str, size: float = 1.0, **style: Any) -> None:
        """Add a line of text; `size` is a multiple of the page's font size."""
        points = size * self.font / MM * POINTS
        style = {"color": self.ink, "va": "center", "parse_math": False, **style}
        self.figure.text(x / self.width, y / self.height, text, fontsize=points, **style)

    def line(self, points: Sequence[tuple[float, float]], color: str, width: float) -> None:
        """Draw a line through points in mm; `width` is a multiple of the page's font size."""
        axes = self.axes(Box(0.0, 0.0, self.width, self.height))
        axes.set(xlim=(0.0, self.width), ylim=(0.0, self.height))
        axes.plot(*zip(*points, strict=True), color=color, lw=width * self.font / MM * POINTS)

    def fill(self, theme: RenderTheme) -> None:
        """Fill the page with the background of the render."""
        axes = self.axes(Box(0.0, 0.0, self.width, self.height))
        shades = [[theme.ground(share)] for share in np.linspace(1.0, 0.0, 64)]
        axes.imshow(shades, aspect="auto", interpolation="bilinear")

    def lines(self, lines: Sequence[Line], left: float, top: float) -> None:
        for line in lines:
            size, weight = line.size / self.font, "bold" if line.bold else "normal"
            self.text(left, top - 0.5 * line.space, line.text, size, weight=weight)
            top -= line.space

    def bar(self, caption: Caption, left: float, box: Box) -> None:
        """Draw the colour bar of a field at `left`, centred along the height of a box."""
        from matplotlib.collections import PolyCollection

        font = self.font
        left, tall = left + 0.5 * _AROUND * font, min(0.6 * box.height, _TALLEST * font)
        below = box.below + 0.5 * (box.height - tall)
        axes = self.axes(Box(left, below, _BAR * font, tall))
        colors = color_table(caption.colormap, _CELLS) / 255.0
        edges = np.linspace(0.0, 1.0, _CELLS + 1)
        # Rectangles, so that the bar consists of vectors in PDF and SVG. Each rectangle overlaps
        # the next, because viewers smooth edges and would show the page between rectangles.
        ends = np.append(edges[2:], 1.0)
        corners = [
            [(0.0, low), (1.0, low), (1.0, high), (0.0, high)]
            for low, high in zip(edges, ends, strict=False)
        ]
        axes.add_collection(PolyCollection(corners, facecolors=colors, linewidth=0.0))
        axes.set(xlim=(0, 1), ylim=(0, 1))
        factor, labels = _bar_texts(caption, tall / font)
        right = left + (_BAR + _GAP) * font
        for place, text in labels.items():
            self.text(right, below + place * tall, text)
        for end, side, up, tip in ((0, 0, 0.0, -0.7), (-1, 1, tall, 0.7)):
            if caption.beyond[side]:
                place = below + up + min(tip, 0.0) * font
                base, point = (0.0, 1.0) if tip > 0.0 else (1.0, 0.0)
                triangle = Box(left, place, _BAR * font, 0.7 * font)
                self.patch(triangle, colors[end], [0.0, 1.0, 0.5], [base, base, point])
        self.text(left, below + tall + 1.4 * font, factor)
        if caption.missing:
            self.patch(Box(left, below - 1.8 * font, _BAR * font, 0.9 * font), NAN_COLOR, *_SQUARE)
            self.text(right, below - 1.35 * font, "no value")

    def legend(self, legend: PointLegend, left: float, below: float) -> float:
        """Draw the legend of points above `below`; return its upper end in mm."""
        font = self.font
        left, step = left + 0.5 * _AROUND * font, 1.4 * font
        up = below + step * (len(legend.rows) - 0.5)
        self.text(left, up + step, legend.title, weight="bold")
        for color, text in legend.rows:
            if legend.graded:
                self.patch(Box(left, up - 0.5 * step, _BAR * font, step), color, *_SQUARE)
            else:
                axes = self.axes(Box(left, up - 0.6 * font, _BAR * font, _BAR * font))
                size = 0.75 * font / MM * POINTS
                axes.plot(0.5, 0.5, "o", ms=size, mfc=color, mec=self.ink, mew=0.06 * size)
                axes.set(xlim=(0, 1), ylim=(0, 1))
            self.text(left + (_BAR + _GAP) * font, up, text)
            up -= step
        return below + step * (len(legend.rows) + 1.5)

    def pins(self, pins: Sequence[Pin], view: View, box: Box) -> None:
        """Draw pins as discs with labels, fainter if the mesh hides them."""
        if not pins:
            return
        # `to_pixels` with pixels of a hundredth of a millimetre
        size = round(100.0 * box.width), round(100.0 * box.height)
        places = view.to_pixels(np.array([pin.position for pin in pins]), *size) / 100.0
        axes = self.axes(box)
        axes.set(xlim=(0.0, box.width), ylim=(0.0, box.height))
        points = self.font / MM * POINTS
        for pin, (x, y, _) in zip(pins, places, strict=True):
            alpha = 0.55 if pin.hidden else 1.0
            axes.plot(
                x, y, "o", ms=0.8 * points, mfc=pin.color, mec="#ffffff", mew=0.12 * points,
                alpha=alpha, clip_on=False,
            )  # fmt: skip
            axes.annotate(
                pin.label, (x, y), (0.7 * points, 0.7 * points), textcoords="offset points",
                fontsize=points, color=self.ink, alpha=alpha, parse_math=False,
                bbox={"boxstyle": "round,pad=0.15", "fc": self.ground, "ec": "none", "alpha": 0.6},
            )  # fmt: skip

    def directions(self, axes: npt.NDArray[np.float64], corner: tuple[float, float]) -> None:
        """Draw the directions of x, y and z above and right of `corner`, the nearest on top."""
        length = 1.6 * self.font
        # leave space for axes that point left or down, and for half a letter at their ends
        least = 1.35 * length * np.minimum(axes[:2].min(axis=1), 0.0)
        at = np.asarray(corner) - least + 0.45 * self.font
        for axis in np.argsort(axes[2]):
            across, along = length * axes[:2, axis]
            self.line([at, (at[0] + across, at[1] + along)], AXIS_COLORS[axis], 0.18)
            if np.hypot(across, along) > 0.25 * length:
                end = at[0] + 1.35 * across, at[1] + 1.35 * along
                self.text(*end, "xyz"[axis], 0.9, ha="center")
