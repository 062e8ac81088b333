"""Table of the defects of a mesh, and the buttons that repair them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapes
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QLabel, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.mesh import Mesh


def chunked_balls() -> Mesh:
    """Return two balls that touch at a vertex, each in two chunks, with some faces reversed."""
    ball = shapes.icosphere(2)
    half = ball.vertices[ball.faces].mean(axis=1)[:, 0] > 0.0
    vertices, faces = [], []
    for shift in (0.0, 2.0):
        for part in (half, ~half):
            faces.append(ball.faces[part] + len(vertices) * ball.n_vertices)
            vertices.append(ball.vertices + shift * ball.vertices[0])
    faces[0][:7] = faces[0][:7, ::-1]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


@pytest.mark.slow
def test_seams_are_merged_and_faces_turned_by_a_click_each(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    window = open_window()
    document, panel = window.document, window.mesh_panel
    document.take_mesh(chunked_balls())
    qtbot.waitUntil(lambda: document.work.job is None and document.mesh is not None, timeout=60_000)
    catch_up()

    def counts() -> list[str]:
        names = ("n_components", "disagreeing_edges", "seam_vertices")
        return [panel.findChild(QLabel, f"health_{name}").text() for name in names]

    assert counts()[0] == "4"
    for name in ("merge_seams", "orient_faces"):
        button = panel.findChild(QAbstractButton, name)
        assert button.isVisible()
        done = len(document.repairs)
        QTest.mouseClick(button, Qt.MouseButton.LeftButton)
        qtbot.waitUntil(
            lambda done=done: len(document.repairs) > done and document.work.job is None,
            timeout=60_000,
        )
        catch_up()
        assert not button.isVisible()
    # the two balls are whole again
    assert counts() == ["2", "0", "0"]
    assert document.ready.health.boundary_edges == 0
    assert panel.findChild(QAbstractButton, "merge_coincident_vertices").isVisible()


def pink_pixels(window: MainWindow) -> int:
    drawn = np.asarray(window.scene.plotter.screenshot(return_img=True)).astype(int)
    red, green, blue = np.moveaxis(drawn[..., :3], -1, 0)
    return int(((red - green > 40) & (blue - green > 20)).sum())


@pytest.mark.slow
def test_debris_within_the_mesh_is_marked_through_it(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    window, ball = open_window(), shapes.icosphere(2)
    inside = 0.001 * ball.vertices[ball.faces[0]]
    faces = np.concatenate([ball.faces, [ball.n_vertices + np.arange(3)]])
    window.document.take_mesh(Mesh(np.concatenate([ball.vertices, inside]), faces))
    qtbot.waitUntil(lambda: window.document.mesh is not None, timeout=60_000)
    window.wait(60.0)
    catch_up()
    before = pink_pixels(window)  # the edges of the axes have this colour, too
    row = window.mesh_panel.findChild(QWidget, "show_n_components")
    assert row.isEnabled()
    QTest.mouseClick(row, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: pink_pixels(window) > before + 8, timeout=60_000)


@pytest.mark.slow
def test_a_row_shows_what_it_counts_and_what_its_repair_would_change(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    window = open_window()
    document, scene = window.document, window.scene
    document.take_mesh(chunked_balls())
    qtbot.waitUntil(lambda: document.work.job is None and document.mesh is not None, timeout=60_000)
    window.wait(60.0)
    catch_up()

    def part(name: str) -> QWidget:
        found = window.mesh_panel.findChild(QWidget, name)
        assert found is not None, name
        return found

    def place() -> str:
        return part("health_place_label").text()

    def click(name: str) -> None:
        QTest.mouseClick(part(name), Qt.MouseButton.LeftButton)

    assert not part("show_degenerate_faces").isEnabled(), "there are none"
    before, alone = scene.camera(), scene.picture((200, 200))
    click("show_disagreeing_edges")
    qtbot.waitUntil(lambda: place().endswith(("place", "places")), timeout=60_000)
    faces = document.ready.health.reversed_faces
    assert part("health_effect_label").text() == f"Turn faces: turns {faces} faces."
    n_places = int(place().split()[0])
    click("health_next")
    assert place().startswith(f"1 of {n_places}: ")
    qtbot.waitUntil(lambda: scene.camera()["half_size"] < 0.8 * before["half_size"], timeout=60_000)
    click("health_previous")
    assert place().startswith(f"{n_places} of {n_places}: ")
    scene.set_camera(before)
    qtbot.waitUntil(lambda: scene.at_rest, timeout=60_000)  # the camera has stopped moving
    assert scene.camera() == before
    np.testing.assert_array_equal(scene.picture((200, 200)), alone, "pictures have no marks")
    window.wait(60.0)
    assert pink_pixels(window) > 20
    QTest.keyClick(window, Qt.Key.Key_Escape)
    assert part("health_place_label").isHidden() or not part("health_place_label").isVisible()
    assert not part("show_disagreeing_edges").isChecked()
    for _ in range(2):
        click("show_seam_vertices")
    assert not part("health_place_label").isVisible()
    click("show_n_components")
    qtbot.waitUntil(lambda: "merges 2 of 4 comp" in part("health_effect_label").text())
    assert part("keep_largest_component").text() == "Merge", "each ball is in two chunks"
    document.repair("merge_seams")
    qtbot.waitUntil(lambda: document.repairs == ("merge_seams",), timeout=60_000)
    assert not part("health_place_label").isVisible(), "another mesh"
