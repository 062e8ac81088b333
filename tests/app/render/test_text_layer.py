from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the window)
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkTextActor

from meshmash_viewer.app.view.colors import rgb
from meshmash_viewer.app.view.drawing import read_pixels
from meshmash_viewer.app.view.text_layer import Block, Text, TextLayer, _font_file, text_size

WIDTH, HEIGHT = 400, 240
LINES = [
    Text("Eigenfunction 5", 16, 224, 15, "#14181d", 0, 2, True, 1.0),
    Text("λ₅ = 1.2×10⁻⁸ nm⁻²", 16, 200, 12, "#5b6673", 0, 2, False, 1.0),
    Text("−0.5", 384, 120, 11, "#14181d", 2, 1, False, 1.0),
    Text("50 µm", 200, 30, 17, "#3b76c4", 1, 0, False, 0.55),
    Text("x", 60, 60, 11, "#d1495b", 1, 1, False, 1.0),
]


@pytest.fixture
def canvas(qapp) -> Iterator[tuple[vtkRenderer, Callable[[], np.ndarray]]]:
    renderer, window = vtkRenderer(), vtkRenderWindow()
    renderer.SetBackground(0.9, 0.92, 0.95)
    window.SetOffScreenRendering(True)
    window.SetSize(WIDTH, HEIGHT)
    window.AddRenderer(renderer)

    def frame() -> np.ndarray:
        window.Render()
        return read_pixels(window, False, 0, HEIGHT).astype(int)

    yield renderer, frame
    window.Finalize()


def actor(line: Text) -> vtkTextActor:
    """The same line as VTK shows it."""
    actor = vtkTextActor()
    properties = actor.GetTextProperty()
    properties.SetFontFamily(VTK_FONT_FILE)
    properties.SetFontFile(_font_file(line.bold))
    properties.SetFontSize(line.size)
    properties.SetColor(*rgb(line.color))
    properties.SetOpacity(line.opacity)
    properties.SetJustification(line.across)
    properties.SetVerticalJustification(line.along)
    actor.SetInput(line.text)
    actor.SetPosition(line.x, line.y)
    return actor


def test_lines_look_as_vtk_shows_them(canvas) -> None:
    renderer, frame = canvas
    empty = frame()
    layer = TextLayer(renderer)
    layer.show(LINES)
    ours = frame()
    layer.show([])
    np.testing.assert_array_equal(frame(), empty)
    for line in LINES:
        renderer.AddViewProp(actor(line))
    assert (ours != empty).any()
    np.testing.assert_array_equal(ours, frame())


def test_other_lines_take_the_place_of_those_before(canvas) -> None:
    renderer, frame = canvas
    fresh = TextLayer(renderer)
    fresh.show(LINES[2:])
    wanted = frame()
    fresh.show([])
    layer = TextLayer(renderer)
    for lines in (LINES, LINES[:1], LINES[1:4], LINES[2:]):
        layer.show(lines)
        frame()
    np.testing.assert_array_equal(frame(), wanted)


def test_wide_and_empty_lines(canvas) -> None:
    renderer, frame = canvas
    layer = TextLayer(renderer)
    empty = frame()
    layer.show([Text("", 10, 10, 12, "#000000", 0, 0, False, 1.0)])
    np.testing.assert_array_equal(frame(), empty)
    layer.show([Text("m" * 300, 10, 10, 12, "#000000", 0, 0, False, 1.0)])
    assert (frame() != empty).any()
    assert text_size("m" * 300, 12, False)[0] > 20 * text_size("mmm", 12, False)[0]


def test_blocks_fill_their_pixels_and_no_others(canvas) -> None:
    renderer, frame = canvas
    wanted = frame()
    layer = TextLayer(renderer)
    layer.show([LINES[0], Block(40, 30, 4, 1, "#123456"), Block(100, 60, 20, 10, "#d1495b")])
    layer.show([Block(40, 30, 4, 1, "#123456"), Block(100, 60, 20, 10, "#d1495b")])
    wanted[HEIGHT - 31 : HEIGHT - 30, 40:44] = (0x12, 0x34, 0x56)
    wanted[HEIGHT - 70 : HEIGHT - 60, 100:120] = (0xD1, 0x49, 0x5B)
    np.testing.assert_array_equal(frame(), wanted)
