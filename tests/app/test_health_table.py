"""The counts of what is wrong with a mesh, and the clicks that repair it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapes
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QLabel
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.mesh import Mesh


def chunked_balls() -> Mesh:
    """Two balls that touch at a vertex, each in two chunks, some faces of the first turned over."""
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
    # the balls are two, each as it was before it was cut
    assert counts() == ["2", "0", "0"]
    assert document.ready.health.boundary_edges == 0
    assert panel.findChild(QAbstractButton, "merge_coincident_vertices").isVisible()
