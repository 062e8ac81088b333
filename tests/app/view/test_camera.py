from __future__ import annotations

import json
import time
from collections.abc import Callable

import numpy as np
import pytest
import shapes

from meshmash_viewer.app.view.camera import Margins, View, default_axes, fitted_view, view_axes
from meshmash_viewer.mesh import Mesh

AXES = np.linalg.qr(np.array([[1.0, 2.0, 0.5], [0.3, 1.0, -2.0], [1.0, 0.0, 1.0]]))[0]
VIEW = View(np.array([3.0, -2.0, 5.0]), AXES * np.sign(np.linalg.det(AXES)), 4.0)


def test_there_and_back() -> None:
    point = VIEW.from_pixels(123.0, 456.0, 800, 600)
    np.testing.assert_allclose(VIEW.to_pixels(point, 800, 600)[0], [123.0, 456.0, 0.0], atol=1e-9)


def test_zoom_keeps_what_is_under_the_pointer() -> None:
    point = VIEW.from_pixels(700.0, 100.0, 800, 600)
    zoomed = VIEW.zoomed(3.0, 700.0, 100.0, 800, 600)
    np.testing.assert_allclose(zoomed.to_pixels(point, 800, 600)[0, :2], [700.0, 100.0])
    assert zoomed.length_per_pixel(800, 600) == pytest.approx(VIEW.length_per_pixel(800, 600) / 3)


def test_shift_follows_the_pointer() -> None:
    point = np.array([[3.5, -1.0, 4.0]])
    before, after = (
        view.to_pixels(point, 800, 600)[0] for view in (VIEW, VIEW.moved(30, -20, 800, 600))
    )
    np.testing.assert_allclose(after - before, [30.0, -20.0, 0.0], atol=1e-9)


def test_turning_takes_the_near_side_along_and_stays_orthonormal() -> None:
    near = VIEW.focus + VIEW.axes[2]
    x, y, _ = VIEW.turned(0.1, 0.2).to_pixels(near, 800, 600)[0] - [400, 300, 0]
    assert x > 0
    assert y > 0
    view = VIEW
    for _ in range(2000):
        view = view.turned(0.3, -0.2, 0.1)
    np.testing.assert_allclose(view.axes @ view.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view.axes) > 0


def test_json_round_trip() -> None:
    again = View.from_json(json.loads(json.dumps(VIEW.to_json())))
    np.testing.assert_array_equal(again.axes, VIEW.axes)
    np.testing.assert_array_equal(again.focus, VIEW.focus)
    assert again.half_size == VIEW.half_size


@pytest.mark.parametrize(
    "change",
    [
        {"axes": np.ones((3, 3)).tolist()},
        {"half_size": 0.0},
        {"focus": [1.0, 2.0]},
        {"focus": None},
    ],
)
def test_what_is_no_camera_is_refused(change: dict) -> None:
    with pytest.raises(ValueError, match="camera"):
        View.from_json(VIEW.to_json() | change)
    with pytest.raises(ValueError, match="camera"):
        View.from_json({})


@pytest.mark.parametrize(("width", "height"), [(800, 600), (300, 900), (1600, 400)])
def test_fitted_points_fill_the_picture_between_the_margins(
    width: int, height: int, rng: np.random.Generator
) -> None:
    points = rng.standard_normal((500, 3)) * [1e5, 3e4, 1e3] + 1e6
    margins = Margins(20, 80, 60, 40)
    seen = fitted_view(points, VIEW.axes, width, height, margins).to_pixels(points, width, height)
    low, high = seen.min(axis=0), seen.max(axis=0)
    gaps = np.array([low[0] - 20, width - 80 - high[0], low[1] - 40, height - 60 - high[1]])
    assert gaps.min() > -1e-6
    assert max(gaps[:2]) < 1e-6 or max(gaps[2:]) < 1e-6


def test_views_of_many_points_take_about_a_pass_over_them(rng: np.random.Generator) -> None:
    """Products with three rows are used; with three columns, they took 40 times longer."""
    points, margins = rng.standard_normal((300_000, 3)), Margins(20, 80, 60, 40)

    def seconds(call: Callable[[], object]) -> float:
        found = []
        for _ in range(5):
            began = time.thread_time()
            call()
            found.append(time.thread_time() - began)
        return min(found)

    passed = seconds(lambda: np.square(points).sum(axis=1))
    assert seconds(lambda: fitted_view(points, VIEW.axes, 800, 600, margins)) < 10.0 * passed
    assert seconds(lambda: VIEW.to_pixels(points, 800, 600)) < 10.0 * passed


def test_a_neurite_lies_across_the_picture() -> None:
    sphere = shapes.icosphere(3)
    vertices = (sphere.vertices * [3.0, 90.0, 10.0]) @ VIEW.axes
    axes = default_axes(Mesh(vertices, sphere.faces, "nm"))
    extent = np.ptp(vertices @ axes.T, axis=0)
    assert extent[0] > extent[1] >= extent[2]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0


def test_a_body_stands_upright() -> None:
    sphere = shapes.icosphere(3)
    cow = Mesh(sphere.vertices * [0.5, 0.8, 1.0], sphere.faces)
    axes = default_axes(cow)
    assert axes[1, 1] > 0.9  # y up
    assert abs(axes[2, 0]) > 0.7  # seen from its long side
    brain = Mesh(sphere.vertices * [35.0, 85.0, 60.0] - [40.0, 0.0, 0.0], sphere.faces, "mm")
    axes = default_axes(brain)
    assert axes[1, 2] > 0.9  # z up
    assert axes[2, 0] < -0.7  # the left hemisphere shows its outer side
    named = Mesh(brain.vertices + 30.0, brain.faces, "mm", name="lh.pial")
    np.testing.assert_array_equal(default_axes(named), view_axes("lateral", named))


def test_one_point_is_no_trouble() -> None:
    view = fitted_view(np.ones((1, 3)), np.eye(3), 400, 300, Margins())
    assert np.isfinite(view.to_pixels(np.ones((1, 3)), 400, 300)).all()
