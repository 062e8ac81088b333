"""Clicks on the render: next to a vertex, and double ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from closed_form import rectangle_document
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def window(open_window: Callable[..., MainWindow], qtbot: QtBot) -> MainWindow:
    window = open_window(rectangle_document(), (1440, 900))
    qtbot.waitUntil(lambda: window.scene.can_pick, timeout=60_000)
    return window


def double_click(window: MainWindow, at: QPoint) -> None:
    canvas = window.scene.plotter
    QTest.mouseClick(canvas, LEFT, pos=at)
    QTest.mouseDClick(canvas, LEFT, pos=at)  # the second press alone
    QTest.mouseRelease(canvas, LEFT, pos=at)


def test_it_centres_the_vertex_a_little_closer_and_pins_nothing(window: MainWindow) -> None:
    scene, document = window.scene, window.document
    document.pins.toggle(3)
    pins, before = document.pins.placed, scene.camera()
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
