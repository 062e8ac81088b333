"""Undo of controls, by real events: a step each, named, and nothing lost."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot
from solved import spectrum_of

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.model.display import Shape
from meshmash_viewer.vertex_map import Label, VertexMap

LEFT, CONTROL = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ControlModifier
PATIENCE = 60_000
BALL = shapes.icosphere(2)


@pytest.fixture
def ball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mesh file, whose sessions are shared between windows."""
    made = Settings.__init__

    def begin(settings: Settings, fresh: bool = False) -> None:
        made(settings, fresh)
        settings.close()
        settings.sessions = tmp_path / "sessions"
        settings._fresh = False

    monkeypatch.setattr(Settings, "__init__", begin)
    np.savez(tmp_path / "ball.npz", vertices=BALL.vertices, faces=BALL.faces, unit="nm")
    return tmp_path / "ball.npz"


def opened(window: MainWindow, path: Path, qtbot: QtBot) -> MainWindow:
    document = window.document
    window.open_mesh(path)
    qtbot.waitUntil(lambda: document.path == path and document.work.job is None, timeout=PATIENCE)
    window.wait()
    return window


def undo(window: MainWindow) -> None:
    window.stage.setFocus()
    QTest.keyClick(window, Qt.Key.Key_Z, CONTROL)
    catch_up()


def test_a_drag_of_the_time_is_one_step(
    open_window: Callable[..., MainWindow], ball: Path, qtbot: QtBot
) -> None:
    window = opened(open_window(), ball, qtbot)
    document = window.document
    assert (document.display.shape, document.history.past) == (Shape(), ()), "no control has acted"
    document.accept_spectrum(spectrum_of(document.mesh, 30))
    document.set_unit("µm")
    document.display.kind = HeatKernelSignature.name
    catch_up()
    slider = part(window, "hks_time_slider")
    y, before = slider.height() // 4, document.display[HeatKernelSignature]
    QTest.mousePress(slider, LEFT, pos=QPoint(slider.value_x(300), y))
    for at in (400, 500, 600):
        QTest.qWait(400 if at < 600 else 800)  # longer than two changes of the wheel may be apart
        QTest.mouseMove(slider, QPoint(slider.value_x(at), y))
    QTest.mouseRelease(slider, LEFT, pos=QPoint(slider.value_x(600), y))
    catch_up()
    after = document.display[HeatKernelSignature]
    assert after.time != before.time
    assert window.actions_["undo"].text() == "Undo HKS time"
    undo(window)
    assert document.display[HeatKernelSignature] == before
    assert document.unit == "µm"
    assert window.actions_["undo"].text() == "Undo change of unit"
    QTest.keyClick(window, Qt.Key.Key_Z, CONTROL | Qt.KeyboardModifier.ShiftModifier)
    assert document.display[HeatKernelSignature] == after


def test_the_displayed_labels_are_chosen_measured_and_edited(
    open_window: Callable[..., MainWindow], ball: Path, qtbot: QtBot
) -> None:
    window = opened(open_window(), ball, qtbot)
    document, mesh = window.document, window.document.mesh
    document.labels.new_set()
    sides = Label(1, "low", "#aa0000"), Label(2, "high", "#00aa00")
    values = np.where(mesh.vertices[:, 2] > 0.0, 2, 1)
    document.maps.add(mesh, [VertexMap("class", values, sides)])  # as a prediction is called
    catch_up()
    window.arrangement.docks["label"].raise_()
    assert part(window, "label_set_combo").currentText() == "class"
    QTest.mouseClick(part(window, "region_measure_button"), LEFT)
    qtbot.waitUntil(lambda: document.labels.regions is not None, timeout=PATIENCE)
    assert document.labels.regions_of.name == "class"
    document.selection.set(mesh.vertices[:, 0] > 0.5)
    document.labels.assign(1)
    catch_up()
    assert part(window, "label_set_combo").currentText() == "class, edited"
    assert document.maps.displayed == "class, edited"
    undo(window)
    assert document.labels.current.name == "class"
    np.testing.assert_array_equal(document.labels.current.values, values)


def test_points_come_back_before_the_render_is_made(
    open_window: Callable[..., MainWindow], ball: Path, qtbot: QtBot
) -> None:
    """The session of a mesh on the command line is restored before the render is made."""
    table = ball.with_name("points.csv")
    table.write_text("\n".join(["x,y,z", *(",".join(map(str, v)) for v in BALL.vertices[:9])]))
    window = opened(open_window(), ball, qtbot)
    window.opening.points_requested.emit(table)
    qtbot.waitUntil(lambda: window.document.points.shown is not None, timeout=PATIENCE)
    window.close()
    again = MainWindow(fresh=True, deferred=True)
    qtbot.addWidget(again)
    again.open_mesh(ball)
    document = again.document
    qtbot.waitUntil(lambda: document.path == ball and document.work.job is None, timeout=PATIENCE)
    assert not again.loaded
    again.load()
    qtbot.waitUntil(lambda: document.points.shown is not None, timeout=PATIENCE)
    assert len(document.points.shown.table) == 9


def test_a_fresh_start_with_a_second_mesh_is_one_step(
    open_window: Callable[..., MainWindow], ball: Path, qtbot: QtBot
) -> None:
    window = opened(open_window(), ball, qtbot)
    document, opening = window.document, window.opening
    document.pins.toggle(7)
    opening.open_second(ball)
    qtbot.waitUntil(lambda: opening.pair.second.mesh is not None, timeout=PATIENCE)
    window.wait()
    opening.pair.second.pins.toggle(9)
    before = len(document.history.past)
    opening.start_afresh(ball)
    qtbot.waitUntil(lambda: not document.pins.placed, timeout=PATIENCE)
    window.wait()
    assert opening.pair is None
    assert document.history.undo_label == "fresh start"
    undo(window)
    assert [pin.vertex for pin in document.pins.placed] == [7]
    qtbot.waitUntil(lambda: opening.pair is not None, timeout=PATIENCE)
    qtbot.waitUntil(lambda: bool(opening.pair.second.pins.placed), timeout=PATIENCE)
    assert [pin.vertex for pin in opening.pair.second.pins.placed] == [9]
    assert len(document.history.past) < before + 1
    window.wait()


def test_a_fresh_start_is_undone(
    open_window: Callable[..., MainWindow], ball: Path, qtbot: QtBot
) -> None:
    window = opened(open_window(), ball, qtbot)
    document, unit = window.document, window.document.unit
    document.set_unit("µm")
    document.labels.new_set()
    document.selection.set(BALL.vertices[:, 2] > 0.0)
    document.labels.assign(1)
    document.pins.toggle(7)
    drawn = document.labels.current.values
    window.close()
    window = opened(open_window(), ball, qtbot)
    document = window.document
    for times in range(4):
        qtbot.waitUntil(lambda: document.labels.current is not None, timeout=PATIENCE)
        window.opening.start_afresh(ball)
        qtbot.waitUntil(lambda: document.labels.current is None, timeout=PATIENCE)
        window.wait()
        assert (document.pins.placed, document.unit) == ((), unit)
        assert window.actions_["undo"].text() == "Undo fresh start"
        states = list((ball.parent / "sessions").glob("[!.]*-*.meshmash.json"))
        assert len(states) == min(times + 1, 3)
        undo(window)
        np.testing.assert_array_equal(document.labels.current.values, drawn)
        assert [pin.vertex for pin in document.pins.placed] == [7]
        assert document.unit == "µm"
    window.opening.restore_session(sorted(states)[0])
    window.wait()
    qtbot.waitUntil(lambda: document.labels.current is not None, timeout=PATIENCE)
    np.testing.assert_array_equal(document.labels.current.values, drawn)
