from __future__ import annotations

import time

import numpy as np
import pytest
import shapes

from meshmash_viewer.app.view import picking
from meshmash_viewer.app.view.picking import Picker
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.surface.rays import RayTarget


def _picker(level: int) -> tuple[Picker, np.ndarray]:
    sphere = shapes.icosphere(level)
    return Picker(sphere.vertices.astype(np.float32), sphere.faces, 12**0.5), sphere.vertices


def test_vertices_behind_the_mesh_are_hidden_and_those_before_it_are_not() -> None:
    picker, vertices = _picker(3)
    picker.wait()
    for eye in np.array([[1.0, 0, 0], [0, -1, 0], [0.6, 0, 0.8]]):
        depth = vertices @ eye
        assert all(picker.hidden(vertex, eye) for vertex in np.flatnonzero(depth < -0.1))
        assert not any(picker.hidden(vertex, eye) for vertex in np.flatnonzero(depth > 0.1))


def test_the_vertex_next_to_the_line_of_sight_is_picked() -> None:
    picker, vertices = _picker(3)
    picker.wait()
    for vertex in range(0, len(vertices), 9):
        eye = vertices[vertex] / np.linalg.norm(vertices[vertex])
        assert picker.vertex(0.3 * eye, eye) == vertex
        aside = np.cross(eye, np.eye(3)[np.argmin(np.abs(eye))])
        assert picker.vertex(0.3 * eye + 2.0 * aside, eye) == -1


def test_nothing_is_hit_after_building_was_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def built_when_stopped(
        points: np.ndarray, faces: np.ndarray, cancel: CancelCallback
    ) -> RayTarget:
        for _ in range(2000):
            if cancel():
                break
            time.sleep(0.005)
        return RayTarget(points, faces, cancel)

    monkeypatch.setattr(picking, "RayTarget", built_when_stopped)
    picker, vertices = _picker(2)
    assert not picker.ready
    assert picker.vertex(np.zeros(3), vertices[0]) == -1
    picker.stop()
    picker.wait()
    assert picker.ready
    assert picker.vertex(np.zeros(3), vertices[0]) == -1
    assert not picker.hidden(0, -vertices[0])
