"""Lines of text over the render, and marks beside them, all in one texture.

An actor of VTK's for each line would cost a tenth of a millisecond whenever its text or its place
changes, and beside a new field nearly all of them do.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingFreeType
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_FONT_FILE, vtkFloatArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkPolyDataMapper2D,
    vtkRenderer,
    vtkTextProperty,
    vtkTextRenderer,
    vtkTexture,
    vtkTexturedActor2D,
)

from meshmash_viewer.app.view.colors import rgb

__all__ = ["Block", "Text", "TextLayer", "text_size"]

#: The texture's sides are multiples of this, so that its size hardly ever changes.
_STEP = 64
#: Lines share its rows up to this width; the whole of it goes to the card whenever one changes.
_WIDTH = 512
#: Corners of what an item fills, in the order in which they are joined.
_UNIT_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)


class Text(NamedTuple):
    """A line of text.

    Parameters
    ----------
    text : str
    x, y : int
        Anchor, in pixels from the lower left.
    size : int
        Of the font.
    color : str
    across, along : int
        Where the anchor is in the line: 0 left or bottom, 1 middle, 2 right or top.
    bold : bool
    opacity : float
    """

    text: str
    x: int
    y: int
    size: int
    color: str
    across: int
    along: int
    bold: bool
    opacity: float


class Block(NamedTuple):
    """A rectangle in one colour, such as the mark that a line of text belongs to.

    Parameters
    ----------
    x, y : int
        Lower left corner, in pixels from that of the renderer.
    width, height : int
    color : str
    """

    x: int
    y: int
    width: int
    height: int
    color: str


class TextLayer:
    """Shows lines of text and small blocks on a renderer.

    Parameters
    ----------
    renderer : vtkRenderer
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self._image = vtkImageData()
        texture = vtkTexture()
        texture.SetInputData(self._image)
        texture.InterpolateOff()
        self._points = vtkPoints()
        self._data = vtkPolyData()
        self._data.SetPoints(self._points)
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._data)
        self._actor = vtkTexturedActor2D()
        self._actor.SetMapper(mapper)
        self._actor.SetTexture(texture)
        self._actor.SetLayerNumber(1)
        self._actor.VisibilityOff()
        self._shown: list[Text | Block] = []
        self._sheet = np.zeros((0, 0, 4), dtype=np.uint8)
        self._places, self._on_sheet = np.zeros((2, 0, 4, 2), dtype=np.float32)
        #: VTK's arrays of these three.
        self._memory = [vtkFloatArray() for _ in range(3)]
        renderer.AddViewProp(self._actor)

    def show(self, items: Sequence[Text | Block]) -> None:
        """Show these and no others."""
        items = [item for item in items if isinstance(item, Block) or item.text]
        if items == self._shown:
            return
        self._shown = items
        self._actor.SetVisibility(bool(items))
        if not items:
            return
        images, lowest = zip(*map(_drawn, items), strict=True)
        places, width, height = _packed([image.shape[:2] for image in images])
        self._make_room(len(items), width, height)
        self._sheet[:] = 0
        rows = []
        for image, at, (row, column) in zip(images, lowest, places, strict=True):
            tall, wide = image.shape[:2]
            self._sheet[row : row + tall, column : column + wide] = image
            rows.append((*at, column, row, wide, tall))
        boxes = np.array(rows, dtype=np.float32)[:, None]
        corners = _UNIT_SQUARE * boxes[..., 4:]
        self._places[: len(boxes), :, :2] = boxes[..., :2] + corners
        self._places[len(boxes) :] = 0.0  # quadrilaterals that are not needed have no size
        self._on_sheet[: len(boxes)] = (boxes[..., 2:4] + corners) / self._sheet.shape[1::-1]
        for changed in self._memory:
            changed.Modified()
        self._image.Modified()
        self._data.Modified()

    def _make_room(self, count: int, width: int, height: int) -> None:
        """Have memory for at least so many items, and a sheet at least that large.

        It only grows: new arrays for VTK take longer than all else here.
        """
        needed = (height, width)
        height, width = (
            max(-(-side // _STEP) * _STEP, known)
            for side, known in zip(needed, self._sheet.shape[:2], strict=True)
        )
        if self._sheet.shape[:2] != (height, width):
            self._sheet = np.zeros((height, width, 4), dtype=np.uint8)
            pixels = self._memory[0] = numpy_to_vtk(self._sheet.reshape(-1, 4))
            self._image.SetDimensions(width, height, 1)
            self._image.GetPointData().SetScalars(pixels)
        if len(self._places) < count:
            self._places = np.zeros((count, 4, 3), dtype=np.float32)
            self._on_sheet = np.zeros((count, 4, 2), dtype=np.float32)
            self._memory[1:] = (
                numpy_to_vtk(self._places.reshape(-1, 3)),
                numpy_to_vtk(self._on_sheet.reshape(-1, 2)),
            )
            self._points.SetData(self._memory[1])
            self._data.GetPointData().SetTCoords(self._memory[2])
            cells = vtkCellArray()
            cells.SetData(
                numpy_to_vtk(np.arange(0, 4 * count + 1, 4, dtype=np.int32)),
                numpy_to_vtk(np.arange(4 * count, dtype=np.int32)),
            )
            self._data.SetPolys(cells)


def _packed(sizes: list[tuple[int, int]]) -> tuple[list[tuple[int, int]], int, int]:
    """Where images go on a sheet, and its width and height: side by side while they fit.

    Parameters
    ----------
    sizes : list of (int, int)
        Height and width of each.

    Returns
    -------
    places : list of (int, int)
        First row and first column of each.
    width, height : int
    """
    places = []
    row = column = tall = widest = 0
    for height, width in sizes:
        if column and column + width > _WIDTH:
            row, column, tall = row + tall, 0, 0
        places.append((row, column))
        column, tall = column + width, max(tall, height)
        widest = max(widest, column)
    return places, widest, row + tall


def text_size(text: str, size: int, bold: bool) -> tuple[int, int]:
    """Width and height of a line of text in pixels."""
    left, right, bottom, top = _box(text, size, bold, 0, 0)
    return right - left + 1, top - bottom + 1


@lru_cache(maxsize=2)
def _font_file(bold: bool) -> str:
    """DejaVu Sans as matplotlib brings it: VTK's own fonts lack Greek letters and superscripts."""
    spec = find_spec("matplotlib")
    folder = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
    return str(folder / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"))


@lru_cache(maxsize=64)
def _property(
    size: int, bold: bool, across: int, along: int, color: str = "#ffffff", opacity: float = 1.0
) -> vtkTextProperty:
    properties = vtkTextProperty()
    properties.SetFontFamily(VTK_FONT_FILE)
    properties.SetFontFile(_font_file(bold))
    properties.SetFontSize(size)
    properties.SetColor(*rgb(color))
    properties.SetOpacity(opacity)
    properties.SetJustification(across)
    properties.SetVerticalJustification(along)
    return properties


@lru_cache(maxsize=512)
def _box(text: str, size: int, bold: bool, across: int, along: int) -> tuple[int, int, int, int]:
    """Pixels that a text covers around its anchor: left, right, bottom, top."""
    box = [0, 0, 0, 0]
    properties = _property(size, bold, across, along)
    vtkTextRenderer.GetInstance().GetBoundingBox(properties, text, box, 72)
    return tuple(box)


def _drawn(item: Text | Block) -> tuple[npt.NDArray[np.uint8], tuple[int, int]]:
    """An item as RGBA of shape (height, width, 4), and where its lower left corner goes."""
    if isinstance(item, Block):
        return _block(item.width, item.height, item.color), (item.x, item.y)
    text, size, bold = item.text, item.size, item.bold
    left, _, bottom, _ = _box(text, size, bold, item.across, item.along)
    return _image(text, size, bold, item.color, item.opacity), (item.x + left, item.y + bottom)


@lru_cache(maxsize=16)
def _block(width: int, height: int, color: str) -> npt.NDArray[np.uint8]:
    pixel = [round(255 * part) for part in (*rgb(color), 1.0)]
    return np.full((height, width, 4), pixel, dtype=np.uint8)


@cache
def _scratch() -> vtkImageData:
    """Where VTK draws one text after the other: a new image takes longer than the text."""
    return vtkImageData()


@lru_cache(maxsize=256)
def _image(text: str, size: int, bold: bool, color: str, opacity: float) -> npt.NDArray[np.uint8]:
    """A text as RGBA of shape (height, width, 4), lowest row first."""
    image, size_of_text = _scratch(), [0, 0]
    properties = _property(size, bold, 0, 0, color, opacity)
    vtkTextRenderer.GetInstance().RenderString(properties, text, image, size_of_text, 72)
    width, height, _ = image.GetDimensions()
    pixels = np.frombuffer(image.GetPointData().GetScalars(), np.uint8).reshape(height, width, 4)
    return pixels[: size_of_text[1], : size_of_text[0]].copy()
