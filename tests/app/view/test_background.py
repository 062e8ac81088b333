"""Background of the render: a gradient from top to bottom."""

from __future__ import annotations

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import vtkRenderWindow

from meshmash_viewer.app.panels.field_panel import DIVERGING, SEQUENTIAL
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import draw_picture
from meshmash_viewer.app.view.style import DARK, LIGHT, RenderTheme, color_table, rgb
from meshmash_viewer.mesh import Mesh

pytestmark = pytest.mark.pixels


@pytest.mark.parametrize(("dark", "theme"), [(False, LIGHT), (True, DARK)])
def test_the_ground_fades_without_bands(qapp, dark: bool, theme: RenderTheme) -> None:
    width, height = 120, 400
    picture = draw_picture(MeshRenderer(dark), (width, height))[..., :3].astype(float)
    ends = 255.0 * np.array([rgb(theme.background_top), rgb(theme.background_bottom)])
    share = ((np.arange(height) + 0.5) / height)[:, None]
    wanted = ends[0] + share * (ends[1] - ends[0])
    assert np.abs(picture - wanted[:, None]).max() <= 1.01
    # the mean of a row is more exact than one pixel, which has 256 levels
    assert np.abs(picture.mean(axis=1) - wanted).max() < 0.2


def test_the_ground_is_behind_the_mesh_and_goes_with_the_theme(qapp) -> None:
    square = Mesh(
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    drawing = MeshRenderer()
    drawing.set_mesh(square, square.vertex_normals)
    drawing.set_theme(dark=True)
    picture = draw_picture(drawing, (400, 400)).astype(int)
    middle, corner = picture[200, 200, :3], picture[0, 0, :3]
    np.testing.assert_allclose(corner, 255 * np.array(rgb(DARK.background_top)), atol=1.01)
    assert middle.min() > 100  # the surface is lighter than the background
    clear = draw_picture(drawing, (400, 400), transparent=True)
    assert clear[0, 0, 3] == 0
    assert clear[200, 200, 3] == 255


@pytest.mark.parametrize("samples", [0, 4])
def test_edges_blend_into_the_ground(qapp, samples: int) -> None:
    ways = np.linspace(0.0, 2 * np.pi, 7)[:6] + 0.2
    corners = np.stack([np.cos(ways), np.sin(ways), 0 * ways], axis=1)
    plate = Mesh(
        np.vstack([np.zeros(3), corners]), np.array([[0, k, k % 6 + 1] for k in range(1, 7)])
    )
    drawing, window = MeshRenderer(), vtkRenderWindow()
    drawing.set_mesh(plate, plate.vertex_normals)
    drawing.surface.actor.GetProperty().SetColor(0.5, 0.5, 0.5)
    drawing.renderer.SetUseFXAA(samples == 0)
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(samples)
    window.SetSize(300, 300)
    window.AddRenderer(drawing.renderer)
    drawing.annotated = False
    drawing.prepare(300, 300, 1.0)
    window.Render()
    pixels = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, 299, 299, 1, pixels, 0)
    picture = vtk_to_numpy(pixels).reshape(300, 300, 3)[::-1].astype(int)
    window.Finalize()
    ground, surface = picture[:, :1], picture[150, 150]
    assert (surface < ground - 50).all()
    # the edge is between the two colours, and no pixel is darker than the surface
    assert (picture >= surface - 3).all()
    between = (picture > surface + 10) & (picture < ground - 10)
    assert np.count_nonzero(between.all(axis=2)) > 350


def luminance(color: tuple[float, ...]) -> float:
    """Return the relative luminance of a colour, as defined by WCAG."""
    linear = [part / 12.92 if part <= 0.04 else ((part + 0.055) / 1.055) ** 2.4 for part in color]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


@pytest.mark.parametrize("name", SEQUENTIAL)
def test_the_dark_end_of_a_map_stands_out_from_the_dark_ground(name: str) -> None:
    dark = min(luminance(tuple(color[:3] / 255.0)) for color in color_table(name))
    for share in (0.0, 0.5, 1.0):
        assert (luminance(DARK.ground(share)) + 0.05) / (dark + 0.05) >= 1.5


def lab(color: np.ndarray) -> np.ndarray:
    """Return the CIELAB coordinates of an sRGB colour, for illuminant D65."""
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(to_xyz @ linear / [0.9505, 1.0, 1.089])
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("name", [*SEQUENTIAL, *DIVERGING])
def test_the_ends_of_a_map_have_another_colour_than_the_ground(name: str) -> None:
    """The colour difference exceeds 20 (CIE 1976); a difference of 2.3 is just noticeable."""
    for end in color_table(name)[[0, -1], :3] / 255.0:
        for share in (0.0, 0.5, 1.0):
            ground = np.array(DARK.ground(share))
            assert np.linalg.norm(lab(end) - lab(ground)) > 20.0
