"""Saving scenes, by mouse and keys."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part, rectangle_document
from faults import raises
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view import picture
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.mesh import mesh_to_poly

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 120_000


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window(rectangle_document(12))


def opened(qtbot: QtBot, window: MainWindow, path: Path) -> QDialog:
    window.actions_["save_scene"].trigger()
    qtbot.waitUntil(lambda: bool(window.findChildren(QDialog, "scene_dialog")), timeout=PATIENCE)
    dialog = window.findChildren(QDialog, "scene_dialog")[-1]
    edit = part(dialog, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    return dialog


@pytest.mark.slow
def test_a_scene_is_the_mesh_in_the_colours_of_its_field(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    mesh = window.document.mesh
    assert mesh is not None
    flat = tmp_path / "plate.gltf"
    dialog = opened(qtbot, window, flat)
    QTest.mouseClick(part(dialog, "scene_save_button"), LEFT)
    qtbot.waitUntil(flat.exists, timeout=PATIENCE)
    text = part(window, "message_text")
    qtbot.waitUntil(lambda: f"Scene saved to {flat}" in text.text(), timeout=PATIENCE)
    again = read_mesh(flat)
    assert again.n_faces == mesh.n_faces
    np.testing.assert_allclose(again.bounds, mesh.bounds, rtol=1e-5)
    content = json.loads(flat.read_text(encoding="utf-8"))
    assert content["textures"] or content["images"], "the colours of the field"
    page = tmp_path / "plate.html"
    dialog = opened(qtbot, window, page)
    assert part(dialog, "scene_format_combo").currentData() == ".html"
    QTest.mouseClick(part(dialog, "scene_save_button"), LEFT)
    qtbot.waitUntil(page.exists, timeout=PATIENCE)
    assert page.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html>")
    assert sorted(tmp_path.iterdir()) == [flat, page]


def test_a_page_without_trame_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "_PAGES", (*picture._PAGES[:2], "no_such_library"))
    assert 'pip install "meshmash-viewer[html]"' in picture.missing_pages()
    with raises("package-missing", "no_such_library"):
        picture.write_scene(mesh_to_poly(shapes.icosphere(0)), tmp_path / "ball.html")


@pytest.mark.slow
def test_the_dialog_says_what_a_page_needs(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "_PAGES", (*picture._PAGES[:2], "no_such_library"))
    dialog = opened(qtbot, window, tmp_path / "plate.html")
    formats = part(dialog, "scene_format_combo")
    assert not formats.model().item(formats.findData(".html")).isEnabled()
    assert part(dialog, "scene_remark_label").text() == picture.missing_pages()
    assert not part(dialog, "scene_save_button").isEnabled()


@pytest.mark.slow
def test_closing_ends_what_is_being_written(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    dialog = opened(qtbot, window, tmp_path / "plate.gltf")
    QTest.mouseClick(part(dialog, "scene_save_button"), LEFT)
    qtbot.wait(50)
    window.close()
    assert not list(tmp_path.iterdir())
