"""Text of annotations: fonts, lines, ticks of a colour bar, and the label of a scale bar."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache
from math import ceil, floor, log10
from pathlib import Path

import matplotlib
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkTextProperty, vtkTextRenderer

from meshmash_viewer.app.view.colors import rgb
from meshmash_viewer.units import format_quantity, superscript

#: Next larger and next smaller unit of each, with the factor between them.
_LARGER = {"nm": ("µm", 1000.0), "µm": ("mm", 1000.0), "mm": ("m", 1000.0)}
_SMALLER = {"m": ("mm", 1000.0), "mm": ("µm", 1000.0), "µm": ("nm", 1000.0)}


@cache
def font_file(bold: bool) -> str:
    """Path of matplotlib's DejaVu Sans; VTK's fonts lack Greek letters and superscripts."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name)


def set_style(properties: vtkTextProperty, size: float, color: str, bold: bool = False) -> None:
    """Set font, size in points and colour of a text."""
    properties.SetFontFamily(VTK_FONT_FILE)
    properties.SetFontFile(font_file(bold))
    properties.SetFontSize(round(size))
    properties.SetColor(*rgb(color))
    properties.BoldOff()
    properties.ItalicOff()
    properties.ShadowOff()


@lru_cache(maxsize=1024)
def text_size(text: str, size: float, bold: bool) -> tuple[int, int]:
    """Width and height in points of a line of text."""
    properties, box = vtkTextProperty(), [0, 0, 0, 0]
    set_style(properties, size, "#000000", bold)
    vtkTextRenderer.GetInstance().GetBoundingBox(properties, text, box, 72)
    return box[1] - box[0] + 1, box[3] - box[2] + 1


def fitted(text: str, width: float, width_of: Callable[[str], float]) -> str:
    """Truncate a text with an ellipsis to a width, measured by `width_of`."""
    if width_of(text) <= width:
        return text
    while text and width_of(text + "…") > width:
        text = text[:-1].rstrip()
    return text + "…" if text else ""


def scale_bar_text(length: float, unit: str) -> str:
    """Format a length in a unit of its size: 2000 nm is "2 µm"."""
    while unit in _LARGER and length >= 1000.0:
        unit, factor = _LARGER[unit]
        length /= factor
    while unit in _SMALLER and length < 0.1:
        unit, factor = _SMALLER[unit]
        length *= factor
    if not unit:
        return f"{length:g} units" if 1e-4 <= length < 1e6 else f"{length:.0e} units"
    return format_quantity(length, unit)


def exponent_text(exponent: int) -> str:
    """Format a power of ten as a factor such as "×10⁻⁵"; empty for 0."""
    return f"×10{superscript(exponent)}" if exponent else ""


def bar_labels(
    low: float, high: float, logarithmic: bool = False, most: int = 6
) -> tuple[list[tuple[float, str]], int]:
    """Return heights on a colour bar from 0 to 1 with their labels, and a common power of ten.

    A logarithmic bar has decades; where these are fewer than two, twice and five times them too.
    """
    values, form, exponent = ticks(low, high, most)
    unit = 10.0**exponent
    if not logarithmic:
        low, high = low / unit, high / unit
        return [((each - low) / (high - low), form % each) for each in values], exponent
    marks = [(each * unit, form % each) for each in values]
    powers = range(floor(log10(low)), ceil(log10(high)) + 1)
    for factors in (1,), (1, 2, 5):
        found = [(k * 10.0**power, _decade(k, power)) for power in powers for k in factors]
        found = [each for each in found if each[0] / low > 1.0 - 1e-9 and each[0] / high < 1 + 1e-9]
        if len(found) > 1:
            marks, exponent = found[:: ceil(len(found) / most)], 0
            break
    start, length = log10(low), log10(high / low)
    return [((log10(value) - start) / length, text) for value, text in marks], exponent


def _decade(factor: int, power: int) -> str:
    """Format a multiple of a power of ten: "0.2", "2·10⁻⁵"."""
    if -3 < power < 4:
        return f"{factor * 10.0**power:g}"
    return f"{f'{factor}·' if factor > 1 else ''}10{superscript(power)}"


def ticks(low: float, high: float, most: int = 6) -> tuple[list[float], str, int]:
    """Round values within ``[low, high]`` with one common power of ten, at most `most` (2 or more).

    Returns the values divided by ``10**exponent``, the format of their labels for the operator
    ``%``, and the exponent, 0 if plain numbers are short.
    """
    largest = max(abs(low), abs(high))
    exponent = floor(log10(largest)) if largest > 0.0 else 0
    if -3 < exponent < 4:
        exponent = 0
    # 10.0**-320 is subnormal, which the quotients tolerate
    low, high = low / 10.0**exponent, high / 10.0**exponent
    # the smallest round step that gives at most that many ticks
    power = 10.0 ** floor(log10((high - low) / (most + 1)))
    for step in (factor * power for factor in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)):
        first, last = ceil(low / step - 1e-6), floor(high / step + 1e-6)
        if last - first < most:
            break
    decimals = max(0, -floor(log10(step) + 1e-9))
    # a narrow range far from zero needs all digits
    form = f"%.{decimals}f" if decimals <= 6 else "%.9g"
    return [k * step for k in range(first, last + 1)], form, exponent
