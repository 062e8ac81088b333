"""The window while no vertex is visible: no errors, empty pictures, and undo shows all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part, rectangle_spectrum, turn_wheel
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog, QListWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Cut
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.model.open_mesh import MeshReady

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 120_000


class Hand:
    """Mouse and keys on a window with a decomposed mesh of two balls, one of them small."""

    def __init__(self, window: MainWindow, qtbot: QtBot) -> None:
        self.window, self.qtbot, self.document = window, qtbot, window.document
        self.canvas, self.middle = window.scene.plotter, window.scene.plotter.rect().center()
        self.errors: list[str] = []
        self.document.notices.shown.connect(self._hear)
        self.rest()

    def _hear(self, notice: Notice | None) -> None:
        if notice is not None and notice.severity is Severity.ERROR:
            self.errors.append(notice.text)

    def rest(self) -> None:
        catch_up()
        self.window.wait(60.0)
        self.qtbot.waitUntil(lambda: self.window.scene.can_pick, timeout=PATIENCE)
        catch_up()

    def command(self, *names: str) -> None:
        for name in names:
            assert self.window.actions_[name].isEnabled(), name
            self.window.actions_[name].trigger()
            self.rest()

    def save(self, command: str, kind: str, path: Path, **texts: str) -> None:
        """Save by a dialog after typing texts into its fields."""
        self.command(command)
        dialog = self.window.findChildren(QDialog, f"{kind}_dialog")[-1]
        for name, text in {"file_edit": str(path), **texts}.items():
            edit = part(dialog, name)
            edit.selectAll()
            QTest.keyClicks(edit, text)
            QTest.keyClick(edit, Qt.Key.Key_Tab)
        pressed = part(dialog, f"{kind}_save_button")
        self.qtbot.waitUntil(pressed.isEnabled, timeout=PATIENCE)
        QTest.mouseClick(pressed, LEFT)
        self.qtbot.waitUntil(lambda: path.exists() or bool(self.errors), timeout=PATIENCE)
        self.rest()


@pytest.fixture
def hand(open_window: Callable[..., MainWindow], qtbot: QtBot) -> Hand:
    ball = shapes.icosphere(2, radius=6000.0)
    vertices = np.concatenate([ball.vertices, 0.01 * ball.vertices + [9000.0, 0.0, 0.0]])
    faces = np.concatenate([ball.faces, ball.faces + ball.n_vertices])
    mesh, document = Mesh(vertices, faces, unit="nm", name="ball"), Document()
    small = np.arange(mesh.n_vertices) >= ball.n_vertices
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals, small=small))
    document.accept_spectrum(rectangle_spectrum(mesh, 12))
    return Hand(open_window(document, (1100, 750)), qtbot)


def drawn(hand: Hand) -> bool:
    """Return whether the mesh covers pixels in the middle, which has no annotations."""
    picture = hand.window.scene.picture((600, 400), transparent=True)
    return bool((picture[150:250, 250:350, 3] > 0).any())


def by_selection(hand: Hand) -> None:
    hand.command("invert_selection", "hide_selection")


def by_isolation(hand: Hand) -> None:
    hand.command("invert_selection", "hide_selection", "show_all", "isolate_selection")
    hand.command("hide_selection")


def by_label(hand: Hand) -> None:
    labels = hand.document.labels
    labels.new_set()
    labels.new_label()
    hand.command("invert_selection")
    labels.assign(1)
    hand.command("label_borders", "label_graph")
    hand.document.display.kind = "eigenfunction"
    hand.document.hiding.hide(labels.current.values == 1)


def by_small_components(hand: Hand) -> None:
    hand.document.selection.set(~hand.document.ready.small)
    hand.rest()
    hand.command("hide_selection", "hide_small")


def by_cut(hand: Hand) -> None:
    hand.document.display.cut = Cut(True, (1.0, 0.0, 0.0), 1.0)


WAYS = [by_selection, by_isolation, by_label, by_small_components, by_cut]


@pytest.mark.slow
@pytest.mark.parametrize("hide", WAYS)
def test_the_window_works_on(
    hand: Hand, hide: Callable[[Hand], None], qtbot: QtBot, tmp_path: Path
) -> None:
    window, document = hand.window, hand.document
    steps = len(document.history.past)
    hide(hand)
    hand.rest()
    assert not drawn(hand)
    hand.command("reset_camera", "view_dorsal", "last", "first", "nodal_lines", "copy_picture")
    QTest.mouseMove(hand.canvas, hand.middle)
    QTest.mouseMove(hand.canvas, hand.middle + QPoint(9, 9))
    for click in (QTest.mouseClick, QTest.mouseDClick):
        click(hand.canvas, LEFT, Qt.KeyboardModifier.NoModifier, hand.middle)
    assert not document.pins.placed
    turn_wheel(hand.canvas, 3)
    window.resize(900, 600)
    hand.rest()
    hand.command("select", "select_connected")
    QTest.mouseClick(hand.canvas, LEFT, pos=hand.middle)
    hand.command("select", "reset_camera")
    assert not hand.errors
    hand.save("save_picture", "figure", tmp_path / "a.png")
    assert hand.errors.pop().endswith("visible: reset the camera, or show what is hidden.")
    hand.save("save_scene", "scene", tmp_path / "a.gltf")
    assert hand.errors.pop().endswith("All faces are hidden or cut away: show some first.")
    small = {"movie_width_spin": "160", "movie_height_spin": "120", "movie_last_spin": "3"}
    hand.save("save_movie", "movie", tmp_path / "a.gif", **small)
    hand.command("gallery")
    gallery = window.findChild(QDialog, "gallery_dialog")
    found = gallery.findChild(QListWidget)
    qtbot.waitUntil(lambda: found.count() > 0, timeout=PATIENCE)
    gallery.close()
    while len(document.history.past) > steps:
        hand.command("undo")
    hand.command("reset_camera")
    assert drawn(hand)
    assert not hand.errors
