"""Clicks on the render: next to a vertex, double clicks, and clicks on hidden components."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapes
from closed_form import rectangle_document
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.limits import MinMaxLimits
from meshmash_viewer.vertex_map import VertexMap

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow], qtbot: QtBot) -> MainWindow:
    window = reopen_window(rectangle_document(), (1440, 900))
    qtbot.waitUntil(lambda: window.scene.can_pick, timeout=60_000)
    return window


def double_click(window: MainWindow, at: QPoint) -> None:
    canvas = window.scene.plotter
    QTest.mouseClick(canvas, LEFT, pos=at)
    QTest.mouseDClick(canvas, LEFT, pos=at)  # sends the second press only
    QTest.mouseRelease(canvas, LEFT, pos=at)


def test_it_centres_the_vertex_a_little_closer_and_pins_nothing(window: MainWindow) -> None:
    scene, document = window.scene, window.document
    document.pins.toggle(3)
    pins, before = document.pins.placed, scene.camera()
    document.pins.toggle(5)
    document.history.undo()
    at = scene.display_point(200)
    vertex = scene.vertex_at(at.x(), at.y())
    assert document.mesh is not None
    double_click(window, at)
    assert document.pins.placed == pins
    after = scene.camera()
    np.testing.assert_allclose(after["focus"], document.mesh.vertices[vertex], atol=1e-6)
    assert 1.1 < before["half_size"] / after["half_size"] < 2.0
    double_click(window, scene.rect().center())
    assert document.pins.placed == pins
    document.history.redo()  # the pin undone above, not the pins of the double clicks
    assert [pin.vertex for pin in document.pins.placed] == [3, 5]


def test_on_the_background_nothing_happens(window: MainWindow) -> None:
    scene, document = window.scene, window.document
    document.pins.toggle(3)
    pins, before = document.pins.placed, scene.camera()
    double_click(window, QPoint(scene.width() // 2, 8))
    assert document.pins.placed == pins
    assert scene.camera() == before


def test_a_single_click_still_pins_at_once(window: MainWindow) -> None:
    at = window.scene.display_point(200)
    QTest.mouseClick(window.scene.plotter, LEFT, pos=at)
    assert len(window.document.pins.placed) == 1


def test_a_click_next_to_the_mesh_takes_the_nearest_vertex(window: MainWindow) -> None:
    scene, mesh = window.scene, window.document.mesh
    assert mesh is not None
    corner = int(mesh.vertices.sum(axis=1).argmin())
    at = scene.display_point(corner)
    outside = next(
        at + step
        for step in (QPoint(-4, 4), QPoint(4, 4), QPoint(-4, -4), QPoint(4, -4))
        if scene.vertex_at((at + step).x(), (at + step).y()) < 0
    )
    QTest.mouseClick(scene.plotter, LEFT, pos=outside)
    assert [pin.vertex for pin in window.document.pins.placed] == [corner]
    far = outside + 4 * (outside - at)
    assert scene.vertex_near(far.x(), far.y()) == -1


@pytest.mark.slow
def test_small_components_can_be_hidden(
    open_window: Callable[..., MainWindow], qtbot: QtBot
) -> None:
    """Hidden components are not drawn, picked or in the limits; vertices keep their indices."""
    ball = shapes.icosphere(2)
    n = ball.n_vertices
    window = open_window(None, (1000, 700))
    document = window.document
    hide = window.findChild(QAction, "hide_small")
    vertices = np.concatenate([0.1 * ball.vertices + [4.0, 0.0, 0.0], ball.vertices])
    height = VertexMap("height", np.append(np.full(n, 9.0), ball.vertices[:, 2]))
    document.take_mesh(Mesh(vertices, np.concatenate([ball.faces, ball.faces + n]), maps=(height,)))

    def rest() -> None:
        qtbot.waitUntil(lambda: document.mesh is not None and window.scene.can_pick, timeout=60_000)
        qtbot.waitUntil(lambda: window.controller.idle, timeout=60_000)
        QTest.qWait(50)

    rest()
    document.display.kind = "map"
    document.display.set_limits(MinMaxLimits())
    rest()
    debris = int(vertices[:, 0].argmax())
    at = window.scene.display_point(debris)
    assert window.scene.vertex_near(at.x(), at.y()) < n
    assert window.controller.field.limits(MinMaxLimits())[1] == 9.0
    hide.trigger()
    rest()
    at = window.scene.display_point(debris)
    assert window.scene.vertex_near(at.x(), at.y()) == -1
    assert window.controller.field.limits(MinMaxLimits())[1] == pytest.approx(1.0, abs=0.01)
    top = window.scene.display_point(n + int(ball.vertices[:, 2].argmax()))
    assert window.scene.vertex_near(top.x(), top.y()) >= n
    pictures = [window.scene.picture((300, 200), transparent=True)[..., 3] > 0]
    document.history.undo()
    assert not document.display.hide_small
    rest()
    assert not hide.isChecked()
    pictures.append(window.scene.picture((300, 200), transparent=True)[..., 3] > 0)
    # without the small component, the ball is larger and in the middle
    assert np.flatnonzero(pictures[0].any(axis=0)).mean() == pytest.approx(150, abs=40)
    assert pictures[0].sum() > 1.1 * pictures[1].sum()


def test_nothing_is_hidden_where_no_component_is_small(window: MainWindow) -> None:
    assert not window.findChild(QAction, "hide_small").isEnabled()
