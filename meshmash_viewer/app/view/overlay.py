"""What lies over the mesh: title, colour bar, scale bar, axes and pins."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import Margins, View
from meshmash_viewer.app.view.colors import NAN_COLOR, RenderTheme, rgb
from meshmash_viewer.app.view.painter import (
    BOTTOM,
    CENTRE,
    LEFT,
    MIDDLE,
    RIGHT,
    TOP,
    Painter,
)
from meshmash_viewer.app.view.text_layer import text_size
from meshmash_viewer.app.view.ticks import exponent_text, round_length, scale_bar_text, ticks

__all__ = [
    "BAR_SPACE",
    "PARTS",
    "Caption",
    "ColorBar",
    "Mark",
    "margins",
    "paint_axes",
    "paint_marks",
    "paint_scale",
    "paint_title",
    "title_size",
]

#: The parts of the overlay, in the order in which they cover one another.
PARTS = ("marks", "axes", "scale", "title", "bar", "labels")
#: In points: from the picture's edge to what is written, width of the colour bar, size of labels.
_EDGE, _BAR, _LABEL = 16, 14, 11
#: In points: what the colour bar with its labels takes of the right.
BAR_SPACE = 108
#: Sizes of the title of a field and of its quantity, in points.
_TITLE, _QUANTITY = 15, 12
#: Red, green and blue of the x, y and z axis, apart in brightness too.
_AXIS_COLORS = ("#d1495b", "#3f9b5c", "#3b76c4")


@dataclass(frozen=True, eq=False)
class Caption:
    """What is written about the field.

    Parameters
    ----------
    title : str
        Name of the field.
    quantity : str
        Second line, such as an eigenvalue or a time with its unit.
    unit : str
        Unit of the values on the colour bar.
    low, high : float
        Ends of the colour bar.
    table : ndarray of uint8, shape (m, 4)
        Its colours.
    missing : bool
        Whether some vertices have no value.
    """

    title: str
    quantity: str
    unit: str
    low: float
    high: float
    table: npt.NDArray[np.uint8] = field(repr=False)
    missing: bool = False


@dataclass(frozen=True, eq=False)
class Mark:
    """A pinned vertex on the picture."""

    position: npt.NDArray[np.float64]
    color: str
    label: str
    hidden: bool


def margins(captioned: bool, width: int, height: int, scale: float) -> Margins:
    """What the overlay takes of a picture, for fitting the mesh beside it."""
    if width < 260 * scale or height < 200 * scale:
        return Margins(*(8.0 * scale,) * 4)
    return Margins(
        left=28 * scale,
        right=(BAR_SPACE if captioned else 28) * scale,
        top=(66 if captioned else 28) * scale,
        bottom=58 * scale,
    )


def _parts(sheet: Sheet) -> tuple[Painter, RenderTheme, int, int, float]:
    return sheet.painter, sheet.theme, sheet.width, sheet.height, sheet.scale


def _fitted(painter: Painter, text: str, size: float, bold: bool, width: float) -> str:
    """The text, or as much of it as fits with an ellipsis."""
    if painter.text_size(text, size, bold)[0] <= width:
        return text
    while text and painter.text_size(text + "…", size, bold)[0] > width:
        text = text[:-1].rstrip()
    return text + "…" if text else ""


@dataclass(frozen=True)
class Sheet:
    """What is painted on: a size in pixels, pixels to a point, and colours.

    Parameters
    ----------
    painter : Painter
    theme : RenderTheme
    width, height : int
    scale : float
    plates : bool
        Whether text has a plate of the background's colour behind it, seen where the mesh is.
    """

    painter: Painter
    theme: RenderTheme
    width: int
    height: int
    scale: float
    plates: bool = True

    def plate(self, x: float, y: float, width: float, height: float) -> None:
        """Put a plate behind what is about to be painted in a box."""
        if self.plates:
            pad = 7 * self.scale
            x, y, width, height = x - pad, y - pad, width + 2 * pad, height + 2 * pad
            # In the colours that the background has there: a plate is only seen over the mesh.
            ends = self._ground(y), self._ground(y + height)
            self.painter.plate(x, y, width, height, 6 * self.scale, ends, 0.75)

    def _ground(self, y: float) -> tuple[float, ...]:
        """Red, green and blue of the background at a height."""
        share = min(max(y / self.height, 0.0), 1.0)
        lower, upper = rgb(self.theme.background_bottom), rgb(self.theme.background_top)
        return tuple(low + share * (high - low) for low, high in zip(lower, upper, strict=True))


def title_size(caption: Caption) -> tuple[int, int]:
    """Width and height in points that title and quantity take with a margin on all sides."""
    lines = ((caption.title, _TITLE, True), (caption.quantity, _QUANTITY, False))
    wide = max(text_size(text, size, bold)[0] for text, size, bold in lines)
    return wide + 3 * _EDGE, 40 + 2 * _EDGE


def paint_title(sheet: Sheet, caption: Caption) -> None:
    """Title and quantity at the upper left."""
    painter, theme, width, height, scale = _parts(sheet)
    edge = _EDGE * scale
    top = height - edge
    free = width - 2 * edge
    title = _fitted(painter, caption.title, _TITLE * scale, True, free)
    quantity = _fitted(painter, caption.quantity, _QUANTITY * scale, False, free)
    two_lines = bool(quantity) and height > 160 * scale
    wide = painter.text_size(title, _TITLE * scale, bold=True)[0]
    if two_lines:
        wide = max(wide, painter.text_size(quantity, _QUANTITY * scale)[0])
    tall = (40 if two_lines else 17) * scale
    if title or quantity:
        # Rounded up, so that it does not tremble as numbers change.
        grain = 24 * scale
        sheet.plate(edge, top - tall, min(np.ceil(wide / grain) * grain, free), tall)
    painter.text(title, edge, top, _TITLE * scale, theme.ink, LEFT, TOP, bold=True)
    if two_lines:
        painter.text(
            quantity, edge, top - 24 * scale, _QUANTITY * scale, theme.faint_ink, LEFT, TOP
        )


@dataclass(frozen=True, eq=False)
class ColorBar:
    """The colour bar at the right, in two parts: for most fields only its labels are new.

    Parameters
    ----------
    caption : Caption
    x, y, height : float
        Lower left corner of the colours, and how tall they are.
    left, above, below : float
        How far the whole goes to the left, and beyond the colours.
    labels : tuple of (float, str)
        Values, and how they are written.
    heading : str
        What they all are to be multiplied by.
    """

    caption: Caption
    x: float
    y: float
    height: float
    left: float
    above: float
    below: float
    labels: tuple[tuple[float, str], ...]
    heading: str

    @classmethod
    def on(cls, sheet: Sheet, caption: Caption) -> ColorBar | None:
        """The bar as it fits on a sheet; None where there is no room for it."""
        painter, _, width, height, scale = _parts(sheet)
        tall = min(300 * scale, 0.5 * height)
        if tall < 70 * scale or width < 220 * scale:
            return None
        size, right = _LABEL * scale, width - _EDGE * scale
        values, texts, exponent = ticks(
            caption.low, caption.high, min(max(int(tall / (34 * scale)), 2), 7)
        )
        labels = max((painter.text_size(text, size)[0] for text in texts), default=0)
        x = right - labels - 7 * scale - _BAR * scale
        heading = " ".join(part for part in (exponent_text(exponent), caption.unit) if part)
        left = min(x, right - painter.text_size(heading, size)[0]) if heading else x
        above, below = (26 if heading else 6) * scale, (28 if caption.missing else 6) * scale
        return cls(
            caption,
            x,
            (height - tall) / 2,
            tall,
            left,
            above,
            below,
            tuple(zip(values, texts, strict=True)),
            heading,
        )

    @property
    def key(self) -> Hashable:
        """All that `paint` depends on beside the sheet."""
        colors = self.caption.table.tobytes(), self.caption.missing
        return self.x, self.y, self.height, self.left, self.above, self.below, colors

    def paint(self, sheet: Sheet) -> None:
        """The plate, the colours, and the one that stands for no value."""
        painter, theme, width, _, scale = _parts(sheet)
        hair, wide = max(1.0, round(scale)), _BAR * scale
        tall = self.height + self.above + self.below
        sheet.plate(self.left, self.y - self.below, width - _EDGE * scale - self.left, tall)
        painter.rectangle(
            self.x - hair,
            self.y - hair,
            wide + 2 * hair,
            self.height + 2 * hair,
            theme.faint_ink,
            0.55,
        )
        painter.column(self.x, self.y, wide, self.height, self.caption.table)
        if self.caption.missing:
            below, size = self.y - 28 * scale, _LABEL * scale
            painter.rectangle(self.x, below, wide, 12 * scale, NAN_COLOR)
            beside, middle = self.x - 6 * scale, below + 6 * scale
            painter.text("no value", beside, middle, size, theme.faint_ink, RIGHT, MIDDLE)

    def paint_labels(self, sheet: Sheet) -> None:
        """Marks beside the colours, their values, and the heading."""
        painter, theme, width, _, scale = _parts(sheet)
        hair, size, right = max(1.0, round(scale)), _LABEL * scale, width - _EDGE * scale
        low, high = self.caption.low, self.caption.high
        for value, text in self.labels:
            at = self.y + self.height * (value - low) / (high - low)
            beside = self.x + _BAR * scale
            painter.block(beside, at - hair / 2, 4 * scale, hair, theme.faint_ink)
            painter.text(text, right, at, size, theme.ink, RIGHT, MIDDLE)
        if self.heading:
            above = self.y + self.height + 10 * scale
            painter.text(self.heading, right, above, size, theme.faint_ink, RIGHT, BOTTOM)


def paint_scale(sheet: Sheet, view: View, unit: str) -> None:
    """A scale bar of round length at the lower right."""
    painter, theme, width, height, scale = _parts(sheet)
    if width < 220 * scale or height < 120 * scale:
        return
    pixel = view.length_per_pixel(width, height)
    length = round_length(min(150 * scale, 0.25 * width) * pixel)
    long = length / pixel
    edge, thick = 16 * scale, max(2.0, round(2.5 * scale))
    x, y = width - edge - long, edge
    text = scale_bar_text(length, unit)
    wide = max(long, painter.text_size(text, 12 * scale)[0])
    sheet.plate(x + (long - wide) / 2, y, wide, 24 * scale)
    painter.rectangle(x, y, long, thick, theme.ink)
    for end in (x, x + long - max(1.0, round(1.5 * scale))):
        painter.rectangle(end, y - 2 * scale, max(1.0, round(1.5 * scale)), 7 * scale, theme.ink)
    painter.text(
        text,
        x + long / 2,
        y + 9 * scale,
        12 * scale,
        theme.ink,
        CENTRE,
        BOTTOM,
    )


def paint_axes(sheet: Sheet, view: View) -> None:
    """The directions of x, y and z at the lower left, the nearest last."""
    painter, theme, _, height, scale = _parts(sheet)
    if height < 160 * scale:
        return
    arm = 26 * scale
    origin = np.array([16 * scale + arm + 6 * scale, 16 * scale + arm + 4 * scale])
    sheet.plate(*(origin - arm - 4 * scale), 2 * arm + 8 * scale, 2 * arm + 8 * scale)
    directions = view.axes.T  # row k: axis k as seen (right, up, towards the eye)
    for k in np.argsort(directions[:, 2]):
        tip = origin + arm * directions[k, :2]
        painter.line(origin, tip, 2.2 * scale, _AXIS_COLORS[k])
        painter.disc(*tip, 2.6 * scale, _AXIS_COLORS[k])
        at = origin + (arm + 9 * scale) * directions[k, :2]
        if np.hypot(*directions[k, :2]) > 0.25:
            painter.text("xyz"[k], *at, 11 * scale, theme.ink, CENTRE, MIDDLE)
    painter.disc(*origin, 2.2 * scale, theme.faint_ink)


def paint_marks(sheet: Sheet, marks: Sequence[Mark], view: View) -> None:
    """Pins as discs with numbers; those behind the mesh are fainter."""
    painter, theme, width, height, scale = _parts(sheet)
    for mark in marks:
        x, y, _ = view.to_pixels(mark.position, width, height)[0]
        opacity = 0.55 if mark.hidden else 1.0
        if mark.hidden:
            painter.disc(x, y, 5.6 * scale, "#14181d", 0.35)
            painter.disc(x, y, 4.6 * scale, mark.color, 0.7)
        else:
            painter.disc(x, y, 7.5 * scale, "#14181d", 0.5)
            painter.disc(x, y, 6.6 * scale, theme.halo)
            painter.disc(x, y, 4.9 * scale, mark.color)
        if mark.label:
            painter.disc(x + 13 * scale, y + 12 * scale, 8 * scale, "#14181d", 0.75 * opacity)
            painter.text(
                mark.label,
                x + 13 * scale,
                y + 12 * scale,
                10 * scale,
                "#ffffff",
                CENTRE,
                MIDDLE,
                bold=True,
                opacity=opacity,
            )
