"""Series of pictures of one mesh, and contact sheets; without Qt."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from meshmash_viewer.app.view.annotations import margins
from meshmash_viewer.app.view.camera import Margins, View, fitted_view
from meshmash_viewer.app.view.caption import Caption, caption_of
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import OffScreen, text_scale
from meshmash_viewer.app.view.style import DARK, LIGHT, fitted, font_file
from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import Field, FieldRequest, LiveFeatures, compute_field
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.units import counted, format_range


@dataclass(frozen=True, eq=False)
class Shot:
    """Field and view of one picture; None keeps the field or the view of the drawing."""

    request: FieldRequest | None = None
    view: View | None = None


def shots_of(
    families: Sequence[Family],
    spectrum: Eigenpairs,
    mesh: Mesh,
    sample: IntArray,
    chosen: Mapping[str, Family],
    hidden: Mask | None = None,
    names: Mapping[int, str] | None = None,
) -> list[Shot]:
    """Return a shot of each family, with its open parameters resolved.

    Limits are computed from the vertices `sample` (`Mesh.area_sample`) that are not `hidden`.
    `chosen` contains all families by name, because a family may depend on another family. `names`
    contains the names of pinned vertices, by vertex.
    """
    resolved = (each.resolved(spectrum, chosen) for each in families)
    return [
        Shot(
            FieldRequest(
                spectrum, mesh.unit, each, sample, hidden,
                pin=(names or {}).get(getattr(each, "vertex", -1), ""),
            )
        )
        for each in resolved
    ]  # fmt: skip


def compute_shot(
    shot: Shot, display: Display, live: LiveFeatures, picked: IntArray | None = None
) -> Field | None:
    """Compute the field of a shot; may run in any thread.

    `picked` are the vertices of the mesh that the drawing contains, None for all vertices.
    """
    if shot.request is None:
        return None
    found = compute_field(shot.request, live)
    if found is None:
        live.prepare(shot.request)
        found = compute_field(shot.request, live)
    assert found is not None, "its table has been prepared"
    return found if picked is None else found.carried(picked)


def show_shot(drawing: MeshRenderer, shot: Shot, field: Field | None, display: Display) -> None:
    """Set view and field of a drawing to those of a shot, with colours and lines of a display."""
    if shot.view is not None:
        drawing.view = shot.view
    if field is not None:
        caption = caption_of(field, *field.colors(display), lined=display.nodal_lines)
        drawing.set_field(field.values, caption)


def draw_series(
    drawing: MeshRenderer,
    size: tuple[int, int],
    shots: Sequence[Shot],
    display: Display,
    transparent: bool = False,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Yield pictures of one size in pixels, see `OffScreen.draw`."""
    live = LiveFeatures()
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        for shot in shots:
            show_shot(drawing, shot, compute_shot(shot, display, live), display)
            yield window.draw()


def series_view(
    drawing: MeshRenderer,
    size: tuple[int, int],
    seen: tuple[int, int] | None = None,
    *,
    turning: bool = False,
) -> View:
    """Return the common view of pictures of a given size, with the axes of the drawing's view.

    If the drawing's view shows only a part of the mesh in a picture of size `seen`, the pictures
    show the same part. Otherwise the whole mesh fills the pictures. With `turning`, the mesh also
    stays within the pictures while it rotates about the vertical axis of the view.
    """
    width, height = size
    view, points = drawing.view, drawing.sample
    if view is not None and seen is not None and not _shows_all(view, points, seen):
        pixel = view.length_per_pixel(*seen) * max(seen[0] / width, seen[1] / height)
        return replace(view, half_size=pixel * min(size) / 2)
    axes = drawing.axes if view is None else view.axes
    if turning:
        points = _cylinder(points, axes)
    space = Margins(*(0.04 * min(size),) * 4)
    if drawing.annotated:
        space = margins(drawing.caption is not None, width, height, text_scale(size))
    return fitted_view(points, axes, width, height, space)


def turntable(drawing: MeshRenderer, view: View, count: int) -> list[View]:
    """Return `count` views of one turn of the mesh about the vertical axis through its centre."""
    middle = _middle(drawing.sample, view.axes)
    offset = view.axes @ (view.focus - middle)
    views = []
    for frame in range(count):
        turned = view.turned(2.0 * np.pi * frame / count, 0.0)
        views.append(replace(turned, focus=middle + offset @ turned.axes))
    return views


def aspect(drawing: MeshRenderer) -> float:
    """Return width over height of the mesh in its view."""
    axes = drawing.axes if drawing.view is None else drawing.view.axes
    wide, high = np.ptp(axes[:2] @ drawing.sample.T, axis=1)
    return float(np.clip(wide / max(high, 1e-300), 0.25, 4.0))


def _shows_all(view: View, points: FloatArray, size: tuple[int, int]) -> bool:
    places = view.to_pixels(points, *size)[:, :2]
    return bool((places >= -1.0).all() and (places <= np.array(size) + 1.0).all())


def _middle(points: FloatArray, axes: FloatArray) -> FloatArray:
    seen = axes @ points.T
    return np.asarray((seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes)


def _cylinder(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Return the corners, shape (4, 3), of the rectangle swept by points during a turn."""
    middle = _middle(points, axes)
    seen = axes @ (points - middle).T
    reach = float(np.hypot(seen[0], seen[2]).max())
    corners = [
        (side * reach, end, 0.0) for side in (-1.0, 1.0) for end in (seen[1].min(), seen[1].max())
    ]
    return np.asarray(middle + np.array(corners) @ axes)


#: Minimum width and height of a picture in pixels.
_LEAST = 24
#: Heights of a caption and of a colour bar with its limits, in lines of text.
_CAPTION, _STRIP = 1.5, 1.5


@dataclass(frozen=True)
class _Layout:
    """Number of columns, and sizes in pixels, of a contact sheet."""

    columns: int
    #: Height of the title.
    head: int
    cell: tuple[int, int]
    picture: tuple[int, int]
    #: Height of the text of a cell.
    text: float


class ContactSheet:
    """A sheet of pictures with captions.

    `size` is the size of the sheet in pixels, `aspect` the ratio of width to height of the mesh.
    Pictures have the size `picture_size` and no background. `ground` is the background colour, by
    default the colour of the render. `InputError` is raised if the sheet is too small.
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
        # the layout in which a mesh of this aspect ratio is widest
        self._layout = max(layouts, key=lambda each: min(each.picture[0], each.picture[1] * aspect))
        self.picture_size = self._layout.picture
        if min(self.picture_size) < _LEAST:
            fault = (
                f"{size[0]} × {size[1]} pixels are too few for {counted(len(captions), 'picture')}"
            )
            raise InputError("picture-size", fault, "choose more, or fewer columns")
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
        """Add picture number `at`, RGBA of `picture_size`, with its caption and colour bar."""
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
        """Draw a colour bar between the texts of its limits, centred at `middle`."""
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
        """Return the sheet as RGBA, shape (height, width, 4)."""
        return np.asarray(self._sheet)


def _layout(columns: int, count: int, size: tuple[int, int]) -> _Layout:
    rows = math.ceil(count / columns)
    head = round(max(0.045 * min(size), 16.0))
    edge = round(0.4 * head)
    wide = (size[0] - 2 * edge) // columns
    tall = (size[1] - head - edge) // rows
    # text in which the caption of an eigenfunction fits, not larger than the title
    text = min(max(wide / 15.0, 7.0), 0.36 * head, 0.2 * tall)
    picture = round(0.96 * wide), int(tall - (_CAPTION + _STRIP) * text)
    return _Layout(columns, head, (wide, tall), picture, text)
