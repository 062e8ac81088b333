"""Contact sheet: small pictures with captions and colour bars in one image, by Pillow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from meshmash_viewer.app.view.annotations import Caption
from meshmash_viewer.app.view.style import DARK, LIGHT, fitted, font_file
from meshmash_viewer.errors import InputError
from meshmash_viewer.units import format_range

#: Smallest width and height in pixels of a picture.
_LEAST = 24
#: Heights of a caption and of a colour bar with its limits, in lines of text.
_CAPTION, _STRIP = 1.5, 1.5


@dataclass(frozen=True)
class _Layout:
    """Sizes in pixels of the title, of a cell, of the picture in it and of its text."""

    columns: int
    head: int
    cell: tuple[int, int]
    picture: tuple[int, int]
    text: float


class ContactSheet:
    """A sheet to which pictures are added one by one; InputError if it is too small.

    `size` is that of the sheet in pixels, `aspect` the width over height of the mesh in the
    pictures. They are to be drawn in `picture_size` without a background. `ground` is the colour
    behind them, by default that of the render, and "" for none.
    """

    def __init__(
        self,
        captions: list[str],
        size: tuple[int, int],
        aspect: float,
        title: str,
        *,
        dark: bool = False,
        ground: str | None = None,
    ) -> None:
        self._captions, self._theme = captions, DARK if dark else LIGHT
        count = len(captions)
        layouts = (_layout(columns, count, size) for columns in range(1, count + 1))
        # the one in which a mesh of this aspect ratio is drawn widest
        self._layout = max(layouts, key=lambda each: min(each.picture[0], each.picture[1] * aspect))
        self.picture_size = self._layout.picture
        if min(self.picture_size) < _LEAST:
            raise InputError(
                f"{len(captions)} pictures on a sheet of {size[0]} × {size[1]} pixels are too"
                " small to show anything: make it larger, or choose fewer columns."
            )
        ground = self._theme.background_top if ground is None else ground
        self._sheet = Image.new("RGBA", size, ground or (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._sheet)
        widest = max((self._font(1.0).getlength(text) for text in captions), default=1.0)
        free = 0.94 * self._layout.cell[0]
        self._caption_font = self._font(min(1.0, max(free / max(widest, 1.0), 0.7)))
        head = self._font(1.25, bold=True, height=self._layout.head / 2.6)
        edge = self._layout.head * 0.4
        self._draw.text(
            (edge, self._layout.head / 2),
            fitted(title, size[0] - 2 * edge, head.getlength),
            fill=self._theme.ink,
            font=head,
            anchor="lm",
        )

    def _font(
        self, share: float, *, bold: bool = False, height: float = 0.0
    ) -> ImageFont.FreeTypeFont:
        return ImageFont.truetype(font_file(bold), max(share * (height or self._layout.text), 6.0))

    def put(self, at: int, picture: npt.NDArray[np.uint8], caption: Caption) -> None:
        """Add a picture, RGBA of `picture_size`, with its colour bar."""
        layout, text = self._layout, self._layout.text
        row, column = divmod(at, layout.columns)
        unused = self._sheet.width - layout.columns * layout.cell[0]
        left = unused // 2 + column * layout.cell[0]
        top = layout.head + row * layout.cell[1]
        place = left + (layout.cell[0] - layout.picture[0]) // 2, top
        self._sheet.alpha_composite(Image.fromarray(picture), place)
        middle = left + layout.cell[0] / 2
        below = top + layout.picture[1]
        self._draw.text(
            (middle, below + 0.5 * _CAPTION * text),
            fitted(self._captions[at], 0.96 * layout.cell[0], self._caption_font.getlength),
            fill=self._theme.ink,
            font=self._caption_font,
            anchor="mm",
        )
        self._draw_strip(middle, below + (_CAPTION + 0.35 * _STRIP) * text, caption)

    def _draw_strip(self, middle: float, at: float, caption: Caption) -> None:
        """Draw the colour bar between its limits, centred in a cell."""
        font, gap = self._font(0.72), 0.4 * self._layout.text
        low, high = format_range(caption.low, caption.high, caption.unit, digits=2).split(" – ")
        high += ", log scale" if caption.logarithmic else ""
        free = 0.94 * self._layout.cell[0] - 2 * gap
        strip = free - font.getlength(low) - font.getlength(high)
        if strip < 2.0 * self._layout.text:
            low = high = ""
            strip = 0.6 * free
        strip = min(strip, 9.0 * self._layout.text)
        wide = font.getlength(low) + strip + font.getlength(high) + 2 * gap
        left = middle - wide / 2
        start = left + font.getlength(low) + gap
        tall = max(round(0.4 * self._layout.text), 2)
        colors = Image.fromarray(np.ascontiguousarray(caption.table[None]))
        bar = colors.resize((max(round(strip), 2), tall))
        self._sheet.paste(bar, (round(start), round(at - tall / 2)))
        for text, place in ((low, left), (high, start + strip + gap)):
            self._draw.text((place, at), text, fill=self._theme.faint_ink, font=font, anchor="lm")

    def pixels(self) -> npt.NDArray[np.uint8]:
        """The sheet, RGBA, shape (height, width, 4)."""
        return np.asarray(self._sheet)


def _layout(columns: int, count: int, size: tuple[int, int]) -> _Layout:
    rows = math.ceil(count / columns)
    head = round(max(0.045 * min(size), 16.0))
    edge = round(0.4 * head)
    wide = (size[0] - 2 * edge) // columns
    tall = (size[1] - head - edge) // rows
    # as large as the caption of an eigenfunction allows, and no larger than the title
    text = min(max(wide / 15.0, 7.0), 0.36 * head, 0.2 * tall)
    picture = round(0.96 * wide), int(tall - (_CAPTION + _STRIP) * text)
    return _Layout(columns, head, (wide, tall), picture, text)
