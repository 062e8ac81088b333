"""Shapes over the render: what a part no longer has is no longer drawn."""

from __future__ import annotations

import numpy as np
from vtkmodules.vtkRenderingCore import vtkRenderer

from meshmash_viewer.app.view.painter import Painter


def paint(painter: Painter, places: list[int]) -> None:
    painter.begin()

    def rectangles() -> None:
        for place in places:
            painter.rectangle(place, place, 4, 2, "#ffffff")

    painter.part("marks", tuple(places), rectangles)
    painter.end()


def areas(painter: Painter) -> np.ndarray:
    corners = painter._shapes._corners.reshape(-1, 4, 3)
    across, along = np.ptp(corners[..., 0], axis=1), np.ptp(corners[..., 1], axis=1)
    return across * along


def test_fewer_shapes_leave_none_of_those_before() -> None:
    painter = Painter(vtkRenderer(), ["marks"])
    paint(painter, [10, 20, 30, 40])
    np.testing.assert_array_equal(areas(painter), 4 * [8.0])
    paint(painter, [15, 25])
    np.testing.assert_array_equal(areas(painter), [8.0, 8.0, 0.0, 0.0])
    paint(painter, [11, 21, 31, 41, 51])
    np.testing.assert_array_equal(areas(painter), 5 * [8.0])


def test_parts_cover_one_another_in_their_order_and_come_and_go() -> None:
    painter = Painter(vtkRenderer(), ["below", "above"])
    shapes = painter._shapes

    def frame(*parts: tuple[str, int]) -> list[float]:
        painter.begin()
        for name, place in parts:
            painter.part(name, place, lambda at=place: painter.rectangle(at, 0, 4, 2, "#ffffff"))
        painter.end()
        return shapes._corners.reshape(-1, 4, 3)[:, 0, 0].tolist()

    assert frame(("above", 30), ("below", 10)) == [10, 30]
    assert frame(("below", 10), ("above", 50)) == [10, 50]
    assert frame(("below", 10))[:1] == [10]
    assert shapes._actor.GetVisibility()
    assert frame(("above", 10)) == frame(("below", 10))
    frame()
    assert not shapes._actor.GetVisibility()
