"""Classes in the window: learned from painted labels, predicted as maps, undone and redone."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable

import numpy as np
import pytest
import shapes
from closed_form import give, part
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot
from solved import spectrum_of

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model import classes
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.vertex_map import VertexMap

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 60_000
POINTS, AROUND = 90, 18
OUTDATED = "The labels or the options have changed since: press Classify."
MADE = ["class", "probability of label 1", "probability of label 2", "uncertainty"]


def spiny() -> tuple[Mesh, np.ndarray]:
    """Return a shaft with 14 spines, and a mask of the vertices on spines."""
    random = np.random.default_rng(4)
    along, spoke = np.arange(POINTS), np.arange(AROUND)
    line = np.linspace(0.0, 9000.0, POINTS)
    bump = np.zeros((POINTS, AROUND))
    for ring in np.linspace(5, POINTS - 6, 14).round():
        turn = (spoke - random.integers(AROUND) + AROUND / 2) % AROUND - AROUND / 2
        bump += np.exp(-((along[:, None] - ring) ** 2 + turn**2) / 3.0)
    path = np.stack([line, 0.0 * line, 0.0 * line], axis=1)
    vertices, faces = shapes.tube(path, 250.0 + 600.0 * bump, AROUND)
    return Mesh(vertices, faces, "nm", "spiny"), np.append(bump.ravel() > 0.3, [False, False])


MESH, SPINE = spiny()


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow], qtbot: QtBot) -> MainWindow:
    """Return a window with 80 eigenpairs, two empty labels and HKS, a quick feature."""
    shown = Document()
    shown.accept_mesh(MeshReady(MESH, mesh_health(MESH), MESH.vertex_normals))
    shown.accept_spectrum(spectrum_of(MESH, 80))
    window = reopen_window(shown)
    document = window.document
    window.arrangement.docks["label"].raise_()
    document.labels.new_set()
    document.labels.new_label()
    rest(window, qtbot)
    assert document.classes.options.kinds == ("curvature",)
    press(window, "class_hks_check")
    press(window, "class_curvature_check")
    return window


@pytest.fixture
def painted(window: MainWindow, qtbot: QtBot) -> MainWindow:
    """Label strokes on some spines, and on the shaft at several places."""
    spines = between(300, 1300) | between(4000, 4900) | between(7000, 7900)
    rings = between(700, 1000) | between(2600, 2800) | between(4400, 4600) | between(7400, 7700)
    paint(window, qtbot, SPINE & spines, Qt.Key.Key_1)
    paint(window, qtbot, ~SPINE & rings, Qt.Key.Key_2)
    return window


def between(low: float, high: float) -> np.ndarray:
    return (MESH.vertices[:, 0] >= low) & (MESH.vertices[:, 0] <= high)


def rest(window: MainWindow, qtbot: QtBot) -> None:
    catch_up()
    window.wait()
    QTest.qWait(1)
    catch_up()


def paint(window: MainWindow, qtbot: QtBot, mask: np.ndarray, key: Qt.Key) -> None:
    window.document.selection.set(mask)
    catch_up()
    table = part(window, "label_table")
    table.setFocus()
    QTest.keyClick(table, key)
    rest(window, qtbot)


def press(window: MainWindow, name: str) -> None:
    QTest.mouseClick(part(window, name), LEFT)
    catch_up()


def names(window: MainWindow) -> list[str]:
    return [each.name for each in window.document.mesh.maps]


def predicted(window: MainWindow) -> VertexMap:
    return window.document.mesh.map_named("class")


def agreement(window: MainWindow) -> float:
    """Return the share of the area whose class is right."""
    right = predicted(window).values == np.where(SPINE, 1, 2)
    return float(MESH.vertex_areas[right].sum() / MESH.area)


def note(window: MainWindow) -> str:
    return str(part(window, "class_note").text())


@pytest.mark.slow
def test_painted_labels_become_classes_of_all(painted: MainWindow, qtbot: QtBot) -> None:
    document = painted.document
    press(painted, "class_classify_button")
    rest(painted, qtbot)
    assert names(painted) == ["labels", *MADE]
    assert agreement(painted) > 0.88, "and 0.77 of the area is shaft"
    assert [each.name for each in predicted(painted).labels] == ["label 1", "label 2"]
    assert painted.controller.field.title == "class"
    assert document.labels.current.name == "class"
    assert note(painted).startswith("F1 on strokes left out: label 1 ")
    press(painted, "class_uncertainty_button")
    rest(painted, qtbot)
    assert painted.controller.field.title == "uncertainty"
    assert 0.0 <= np.nanmin(painted.controller.field.values) < 0.1

    first = predicted(painted)
    part(painted, "class_classifier_combo").setFocus()
    QTest.keyClick(part(painted, "class_classifier_combo"), Qt.Key.Key_Down)
    press(painted, "class_curvature_check")
    give(part(painted, "class_smoothing_field").lineEdit(), "0.1 µm")
    assert document.classes.options.smoothing == pytest.approx(100.0)
    press(painted, "class_classify_button")
    rest(painted, qtbot)
    assert names(painted) == ["labels", *MADE], "they are replaced"
    assert predicted(painted) is not first
    assert document.display[OwnMaps].chosen == "uncertainty", "what was displayed still is"

    document.history.undo()
    catch_up()
    assert predicted(painted) is first
    assert note(painted).endswith(OUTDATED), "the first prediction had other options"
    while document.history.undo_label == "options of the classes":
        document.history.undo()
    catch_up()
    scores = note(painted)
    assert scores.startswith("F1 on strokes left out")
    assert not scores.endswith(OUTDATED)
    document.history.undo()
    rest(painted, qtbot)
    assert names(painted) == ["labels"]
    assert not part(painted, "class_uncertainty_button").isEnabled()
    document.history.redo()
    rest(painted, qtbot)
    assert predicted(painted) is first
    assert note(painted) == scores
    document.labels.choose("class")
    paint(painted, qtbot, SPINE & between(5000, 6900), Qt.Key.Key_1)
    assert predicted(painted) is first
    assert painted.controller.field.title == "labels", "the next labels go where they went"


@pytest.mark.slow
def test_live_classes_follow_the_labels_through_undo(painted: MainWindow, qtbot: QtBot) -> None:
    document, history = painted.document, painted.document.history
    press(painted, "class_live_check")
    rest(painted, qtbot)
    before, steps = predicted(painted), len(history.past)
    assert painted.controller.field.title == "labels", "the display stays"
    paint(painted, qtbot, SPINE & between(5000, 6900), Qt.Key.Key_1)
    after = predicted(painted)
    assert after is not before
    assert len(history.past) == steps + 2, "the selection, and the label with its classes"
    history.undo()
    rest(painted, qtbot)
    assert predicted(painted) is before
    history.redo()
    rest(painted, qtbot)
    assert predicted(painted) is after
    press(painted, "class_live_check")
    paint(painted, qtbot, between(0, 9000), Qt.Key.Key_2)
    assert predicted(painted) is after
    assert not document.classes.live
    assert note(painted).endswith(OUTDATED)
    assert document.classes.plain()["outdated"]
    history.undo()
    rest(painted, qtbot)
    assert not note(painted).endswith(OUTDATED), "the prediction is that of the labels again"


@pytest.mark.slow
def test_the_newest_request_wins_and_cancel_leaves_all(
    painted: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, run, begun = painted.document, classes.classify, []

    def slow(*given: object) -> object:
        *_, options, _, channel = given
        begun.append(options)
        while len(begun) == 1 or document.classes.options.kinds == ("wks",):
            time.sleep(0.01)
            channel.report(Progress("training"))
            if channel.cancelled():
                break
        return run(*given)

    monkeypatch.setattr(classes, "classify", slow)
    press(painted, "class_classify_button")
    qtbot.waitUntil(lambda: len(begun) == 1, timeout=PATIENCE)
    assert part(painted, "status_progress").isVisible()
    assert note(painted) == "Classifying …"
    give(part(painted, "class_smoothing_field").lineEdit(), "50")
    press(painted, "class_classify_button")
    rest(painted, qtbot)
    assert [options.smoothing for options in begun] == [0.0, 50.0]
    assert [step.label for step in document.history.past].count("classes") == 1
    assert "Cancelled" not in document.notices.last.text

    first = predicted(painted)
    press(painted, "class_wks_check")
    press(painted, "class_hks_check")
    press(painted, "class_classify_button")
    qtbot.waitUntil(lambda: len(begun) == 3, timeout=PATIENCE)
    press(painted, "status_cancel_button")
    rest(painted, qtbot)
    assert predicted(painted) is first
    assert document.notices.last.text == "Cancelled: Classifying spiny."


def test_what_is_missing_is_said(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = window.document

    def refusal() -> str:
        press(window, "class_classify_button")
        rest(window, qtbot)
        assert names(window) == ["labels"]
        assert document.notices.last.text == note(window)
        return note(window)

    assert refusal() == "No vertex is labelled: label some of at least two classes."
    paint(window, qtbot, SPINE & between(0, 2600), Qt.Key.Key_1)
    assert note(window).startswith("Press Classify for classes"), "it was said of other labels"
    assert refusal().startswith("All labelled vertices are 'label 1': label some of at least two")
    two = np.zeros(MESH.n_vertices, dtype=bool)
    two[np.flatnonzero(~SPINE)[:2]] = True
    paint(window, qtbot, two, Qt.Key.Key_2)
    assert refusal() == "Class 'label 2' has 2 vertices on the surface: label at least 5."
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda _name: None)
        assert 'pip install "meshmash-viewer[learn]"' in refusal()
    press(window, "class_hks_check")
    assert note(window).startswith("No features are chosen")
    assert not part(window, "class_classify_button").isEnabled()


@pytest.mark.slow
def test_without_eigenpairs_nothing_is_learned_and_computing_goes_first(
    open_window: Callable[..., MainWindow], qtbot: QtBot
) -> None:
    window = open_window(Document())
    document = window.document
    document.take_mesh(MESH)
    qtbot.waitUntil(lambda: document.mesh is not None, timeout=PATIENCE)
    window.arrangement.docks["label"].raise_()
    press(window, "label_new_set_button")
    press(window, "label_new_button")
    press(window, "class_live_check")
    paint(window, qtbot, SPINE & between(0, 2600), Qt.Key.Key_1)
    paint(window, qtbot, ~SPINE & between(0, 2600), Qt.Key.Key_2)
    assert note(window).startswith("Classes are learned from eigenpairs: compute them")
    assert not part(window, "class_classify_button").isEnabled()
    document.solve.target = Target("count", 60)
    document.solve.compute()
    qtbot.waitUntil(lambda: document.labels.predicted is not None, timeout=PATIENCE)
    rest(window, qtbot)
    assert [each.name for each in predicted(window).labels] == ["label 1", "label 2"]
    document.labels.choose("class")
    catch_up()
    assert part(window, "class_classify_button").isEnabled(), "from the labels it was learned from"
