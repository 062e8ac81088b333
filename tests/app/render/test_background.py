"""What is behind everything: a ground that fades from top to bottom."""

from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.app.picture import draw_picture
from meshmash_viewer.app.render.colors import DARK, LIGHT, RenderTheme, rgb
from meshmash_viewer.app.render.drawing import Drawing
from meshmash_viewer.mesh import Mesh


@pytest.mark.parametrize(("dark", "theme"), [(False, LIGHT), (True, DARK)])
def test_the_ground_fades_without_bands(qapp, dark: bool, theme: RenderTheme) -> None:
    width, height = 120, 400
    picture = draw_picture(Drawing(dark), (width, height))[..., :3].astype(float)
    ends = 255.0 * np.array([rgb(theme.background_top), rgb(theme.background_bottom)])
    share = ((np.arange(height) + 0.5) / height)[:, None]
    wanted = ends[0] + share * (ends[1] - ends[0])
    assert np.abs(picture - wanted[:, None]).max() <= 1.01
    # a mean over a row is between two colours that a screen has
    assert np.abs(picture.mean(axis=1) - wanted).max() < 0.2


def test_the_ground_is_behind_the_mesh_and_goes_with_the_theme(qapp) -> None:
    square = Mesh(
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    drawing = Drawing()
    drawing.set_mesh(square, square.vertex_normals)
    drawing.set_theme(dark=True)
    picture = draw_picture(drawing, (400, 400)).astype(int)
    middle, corner = picture[200, 200, :3], picture[0, 0, :3]
    np.testing.assert_allclose(corner, 255 * np.array(rgb(DARK.background_top)), atol=1.01)
    assert middle.min() > 100  # the surface, which is lighter than the ground
    clear = draw_picture(drawing, (400, 400), transparent=True)
    assert clear[0, 0, 3] == 0
    assert clear[200, 200, 3] == 255
