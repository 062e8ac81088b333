"""Style of the render: colours, fonts, and the labels of colour bars and scale bars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, floor, log10
from pathlib import Path
from typing import TypeAlias

import matplotlib
import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from matplotlib import colormaps
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer

from meshmash_viewer.errors import unknown
from meshmash_viewer.units import (
    NO_BREAK,
    engineering,
    format_number,
    format_quantity,
    minus,
    power_text,
    superscript,
)

#: Maximum distance, from 0 to 1, of two positions on a colour bar that count as equal.
_SAME = 1e-6
#: Maximum number of decimals, and of characters, of a label.
_DECIMALS, _LONGEST = 6, 9

#: Name of a colour map of matplotlib, or the colours of labels 0, 1, 2 … as "#rrggbb".
ColorMap: TypeAlias = str | tuple[str, ...]

#: Colour of vertices without a value: a grey that no colour map contains.
NAN_COLOR = "#8c8c8c"
#: Colour of the stripes over selected vertices.
SELECTION_COLOR = "#ff2bd6"


@dataclass(frozen=True)
class RenderTheme:
    """Colours of the background, of texts and of the mesh without a field, as "#rrggbb"."""

    background_top: str
    background_bottom: str
    ink: str
    faint_ink: str
    surface: str
    line: str
    #: Colour of the inner side of the surface where the mesh is cut.
    inside: str
    halo: str

    def ground(self, share: float) -> tuple[float, ...]:
        """Return RGB, 0 to 1, of the background at the height `share`, 0 (lower edge) to 1."""
        share = min(max(share, 0.0), 1.0)
        ends = zip(rgb(self.background_bottom), rgb(self.background_top), strict=True)
        return tuple(low + share * (high - low) for low, high in ends)


LIGHT = RenderTheme(
    background_top="#eef1f4",
    background_bottom="#cdd4dc",
    ink="#1d232b",
    faint_ink="#4d5762",
    surface="#b9c4d0",
    line="#14181d",
    inside="#6f7883",
    halo="#ffffff",
)
#: The contrast between background and dark end of every sequential map is at least 1.5.
DARK = RenderTheme(
    background_top="#525963",
    background_bottom="#3f444b",
    ink="#f3f5f7",
    faint_ink="#c9d0d8",
    surface="#8d9aa8",
    line="#101317",
    inside="#79828d",
    halo="#ffffff",
)


@lru_cache(maxsize=64)
def rgb(color: str) -> tuple[float, float, float]:
    """Return red, green and blue, 0 to 1, of a colour "#rrggbb"."""
    return tuple(int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5))  # type: ignore[return-value]


@lru_cache(maxsize=32)
def color_table(name: ColorMap, count: int = 256) -> npt.NDArray[np.uint8]:
    """Return a table of RGBA colours, shape (count, 4), of a colour map or of labels.

    Each label has an equal part of the table; at most `count` labels are possible.

    Raises
    ------
    InputError
        If matplotlib has no colour map of that name.
    """
    if isinstance(name, tuple):
        colors = np.array([[*rgb(each), 1.0] for each in name])
        places = np.arange(count) * len(name) // count
        # set the middle of each part exactly, because rounding may omit a narrow part
        places[((np.arange(len(name)) + 0.5) * count / len(name)).astype(int)] = range(len(name))
        labelled = np.round(255.0 * colors[places]).astype(np.uint8)
        labelled.setflags(write=False)
        return labelled
    if name not in colormaps:
        raise unknown("colour map", name, ("RdBu_r", "viridis", "magma", "others of matplotlib"))
    table = colormaps[name].resampled(count)(np.arange(count), bytes=True)
    table.setflags(write=False)  # the cache returns the same array to all callers
    return np.asarray(table)


@cache
def font_file(bold: bool) -> str:
    """Return the path of matplotlib's DejaVu Sans; VTK's fonts lack Greek and superscripts."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name)


def set_style(properties: vtkTextProperty, size: float, color: str, bold: bool = False) -> None:
    """Set font, size in points, and colour of a text property of VTK."""
    properties.SetFontFamily(VTK_FONT_FILE)
    properties.SetFontFile(font_file(bold))
    properties.SetFontSize(round(size))
    properties.SetColor(*rgb(color))


@lru_cache(maxsize=1024)
def text_size(text: str, size: float, bold: bool) -> tuple[int, int]:
    """Return width and height, in points, of a line of text."""
    properties, box = vtkTextProperty(), [0, 0, 0, 0]
    set_style(properties, size, "#000000", bold)
    vtkTextRenderer.GetInstance().GetBoundingBox(properties, text, box, 72)
    return box[1] - box[0] + 1, box[3] - box[2] + 1


def fitted(text: str, width: float, width_of: Callable[[str], float]) -> str:
    """Return the text, truncated with an ellipsis if ``width_of(text) > width``."""
    if width_of(text) <= width:
        return text
    while text and width_of(text + "…") > width:
        text = text[:-1].rstrip()
    return text + "…" if text else ""


def scale_bar_text(length: float, unit: str) -> str:
    """Format a length; the word "units" replaces an unknown unit."""
    return format_quantity(length, unit or ("unit" if length == 1.0 else "units"))


def exponent_text(exponent: int) -> str:
    """Format a power of ten as a factor such as "×10⁻⁵"; empty for 0."""
    return f"×10{superscript(exponent)}" if exponent else ""


def bar_labels(
    low: float,
    high: float,
    unit: str,
    logarithmic: bool = False,
    most: int = 6,
    gap: float = 0.06,
) -> tuple[list[tuple[float, str]], str]:
    """Return the labels of a colour bar: its ends and at most `most` round values.

    The prefix of the unit is chosen for the values. A logarithmic bar has labels at powers of ten;
    if it contains fewer than two, also at 2 and 5 times powers of ten. Round values closer than
    `gap`, from 0 to 1, to an end are omitted.

    Returns
    -------
    labels : list of (float, str)
        Position, from 0 at the lower end to 1 at the upper end, and text.
    heading : str
        Power of ten and unit.
    """
    size = (low * high) ** 0.5 if logarithmic else max(abs(low), abs(high))
    shift, unit = engineering(size, unit)
    low, high = low * 10.0**shift, high * 10.0**shift
    values, form, exponent = ticks(low, high, most)
    scale = 10.0**exponent
    decades = _decades(low, high, most) if logarithmic else []
    if decades:
        marks, exponent = decades, 0
        ends = [_written_alone(each) for each in (low, high)]
    else:
        marks = [(value * scale, minus(form % value)) for value in values]
        ends = [_written_within(each / scale, (high - low) / scale) for each in (low, high)]
    place = _log_place if logarithmic else _place
    labels = [(place(value, low, high), text) for value, text in marks]
    for end, text in enumerate(ends):
        at_end = [label for label in labels if abs(label[0] - end) < _SAME]
        labels = [label for label in labels if abs(label[0] - end) >= gap]
        labels.append((float(end), at_end[0][1] if at_end else text))
    heading = NO_BREAK.join(part for part in (exponent_text(exponent), unit) if part)
    return sorted(labels), heading


def _place(value: float, low: float, high: float) -> float:
    return (value - low) / (high - low)


def _log_place(value: float, low: float, high: float) -> float:
    return log10(value / low) / log10(high / low)


def _decades(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Return values and texts of the powers of ten from `low` to `high`.

    If there are fewer than two powers, 2 and 5 times powers of ten are included; if there are still
    fewer than two values, the list is empty.
    """
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    for factors in (1,), (1, 2, 5):
        found = [(k * 10.0**power, power_text(power, k)) for power in powers for k in factors]
        found = [each for each in found if low <= 1.000000001 * each[0] <= 1.000000002 * high]
        if len(found) > 1:
            return found[:: ceil(len(found) / most)]
    return []


def _written_alone(value: float) -> str:
    """Format a value with three digits, or with two digits and a power of ten."""
    text = format_number(value, 3)
    return format_number(value, 2) if "×" in text else text


def _written_within(value: float, span: float) -> str:
    """Format an end of a range to 1/100 of `span` or finer; -0 becomes 0."""
    decimals = 2 - floor(log10(span))
    if value:  # show two digits of a small value, with at most two more decimals
        decimals = max(decimals, min(1 - floor(log10(abs(value))), decimals + 2))
    texts = [f"{value:.{max(decimals, 0)}f}"]
    if decimals > _DECIMALS:
        texts = [f"{value:.{digits}g}" for digits in (9, 8, 7, 6)]
    text = next((each for each in texts if len(each) <= _LONGEST), texts[-1])
    return minus(text) if float(text) else "0"


def ticks(low: float, high: float, most: int = 6) -> tuple[list[float], str, int]:
    """Return at most `most` (2 or more) round values within ``[low, high]``.

    The result is a tuple of the values divided by ``10**exponent``, the format of their labels for
    the operator ``%``, and the exponent, which is 0 if the values are short without an exponent.
    """
    largest = max(abs(low), abs(high))
    exponent = floor(log10(largest)) if largest > 0.0 else 0
    if -3 < exponent < 4:
        exponent = 0
    # 10.0**-320 is subnormal, but the quotients are still accurate enough
    low, high = low / 10.0**exponent, high / 10.0**exponent
    # find the smallest round step that gives at most `most` ticks
    power = 10.0 ** floor(log10((high - low) / (most + 1)))
    # if only one multiple of the step is within the range, a step of 4 may give more
    for factors in ((1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0), (4.0, 40.0)):
        for step in (factor * power for factor in factors):
            first, last = ceil(low / step - 1e-6), floor(high / step + 1e-6)
            if last - first < most:
                break
        if first < last or most < 3:
            break
    decimals = max(0, -floor(log10(step) + 1e-9))
    # values in a narrow range far from zero require all digits
    form = f"%.{decimals}f" if decimals <= _DECIMALS else "%.9g"
    return [k * step for k in range(first, last + 1)], form, exponent
