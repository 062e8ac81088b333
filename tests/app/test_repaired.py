"""Repairs by mouse and keys: vertex indices of the file, and repairs repeated on opening."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QPoint, QSettings, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QLabel, QScrollArea
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import run, settings
from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.weyl import Target

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 60_000
DROP, LARGEST = "drop_unreferenced_vertices", "keep_largest_component"


@pytest.fixture
def remembered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Store settings and sessions in files of the test."""
    path = tmp_path / "settings.ini"

    def stored(*_: str) -> QSettings:
        return QSettings(str(path), QSettings.Format.IniFormat)

    monkeypatch.setattr(settings, "QSettings", stored)
    monkeypatch.setattr(settings, "session_folder", lambda: path.with_name("sessions"))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file of a ball of 42 vertices, two vertices on no face, and a ball of 162."""
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    vertices = np.concatenate([0.3 * small.vertices + 1.5, [[0.0] * 3] * 2, large.vertices])
    faces = np.concatenate([small.faces, large.faces + 44])
    return save(Mesh(vertices, faces), tmp_path / "balls.npz")


def save(mesh: Mesh, path: Path) -> Path:
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


@pytest.fixture
def start(qapp: QApplication, qtbot: QtBot, remembered: Path) -> Iterator[Callable[[], MainWindow]]:
    """Function that closes the last window and opens another."""
    opened: list[MainWindow] = []

    def begin() -> MainWindow:
        for window in opened:
            window.close()
        window = MainWindow()
        opened.append(window)
        window.resize(1400, 900)
        window.show()
        window.activateWindow()
        qtbot.waitUntil(window.isActiveWindow, timeout=PATIENCE)
        return window

    yield begin
    for window in opened:
        window.close()


def read(qtbot: QtBot, window: MainWindow, path: Path) -> None:
    window.opening.open_path(path)
    qtbot.waitUntil(lambda: window.document.path == path, timeout=PATIENCE)
    rest(qtbot, window)


def rest(qtbot: QtBot, window: MainWindow) -> None:
    qtbot.waitUntil(lambda: window.document.work.job is None, timeout=PATIENCE)
    window.wait(PATIENCE / 1000)
    catch_up()


def click_repair(qtbot: QtBot, window: MainWindow, name: str) -> None:
    button = part(window, name)
    qtbot.waitUntil(button.isVisible, timeout=PATIENCE)
    area = button.parentWidget()
    while not isinstance(area, QScrollArea):
        area = area.parentWidget()
    area.ensureWidgetVisible(button)
    QTest.mouseClick(button, LEFT)
    qtbot.waitUntil(lambda: window.document.repairs[-1:] == (name,), timeout=PATIENCE)
    rest(qtbot, window)


def said(window: MainWindow) -> str:
    notice = window.stage.message_bar.notice
    return "" if notice is None else notice.text


@pytest.mark.slow
def test_the_largest_component_is_kept_and_computed_by_one_click(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path
) -> None:
    window = start()
    read(qtbot, window, path)
    button = part(window, "keep_largest_and_compute")
    assert not button.isVisible(), "2 of 100 pairs are zero"
    window.document.solve.target = Target("count", 10)
    catch_up()
    assert button.isVisible()
    assert button.toolTip().startswith("Drops 1 component with 42 vertices")
    QTest.mouseClick(button, LEFT)
    qtbot.waitUntil(lambda: window.document.solve.is_computed, timeout=PATIENCE)
    rest(qtbot, window)
    assert window.document.repairs == (LARGEST,)
    assert not button.isVisible()
    window.document.history.undo()
    rest(qtbot, window)
    assert window.document.repairs == ()


@pytest.mark.slow
def test_keys_pressed_while_a_repair_is_undone_are_not_lost(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path
) -> None:
    window = start()
    read(qtbot, window, path)
    for name in (DROP, LARGEST):
        click_repair(qtbot, window, name)
    window = start()
    read(qtbot, window, path)
    document, history = window.document, window.document.history
    assert document.repairs == (DROP, LARGEST), "made again while the file was read"
    document.pins.toggle(20)
    assert len(history.past) == 3
    shift = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
    for keys, past, repairs in (
        (Qt.KeyboardModifier.ControlModifier, 0, ()),
        (shift, 3, (DROP, LARGEST)),
    ):
        window.setFocus()
        for _ in range(4):
            QTest.keyClick(window, Qt.Key.Key_Z, keys)
        qtbot.waitUntil(lambda past=past: len(history.past) == past, timeout=PATIENCE)
        rest(qtbot, window)
        assert (len(history.past), len(history.future)) == (past, 3 - past)
        assert document.repairs == repairs
    assert [pin.vertex for pin in document.pins.placed] == [20]


@pytest.mark.slow
def test_what_is_shown_and_written_counts_as_the_file(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path, tmp_path: Path
) -> None:
    window = start()
    document = window.document
    read(qtbot, window, path)
    for vertex in (7, 60):
        document.pins.toggle(vertex)
    document.display.kind = "distance"

    def megabytes() -> float:
        found = re.search(r"([\d.]+)\sMB of memory", part(window, "cost_label").text())
        assert found
        return float(found[1])

    before = megabytes()
    click_repair(qtbot, window, LARGEST)
    assert part(window, "mesh_vertices_label").text() == "162 of 206 in the file"
    assert megabytes() < before, "fewer vertices"
    assert said(window).startswith("1 pin went with a vertex that the repair left out or merged.")
    assert part(window, "distance_label").text() == "Distance from vertex\N{NO-BREAK SPACE}60"
    assert part(window, "distance_vertex_combo").currentText() == "2 · Vertex 60"

    # the index in the file is shown under the pointer and for the clicked pin
    canvas, scene = window.scene.findChild(RenderWidget), window.scene
    qtbot.waitUntil(lambda: scene.can_pick, timeout=PATIENCE)
    at = next(
        (vertex, place)
        for vertex in range(162)
        if canvas.rect().contains(place := scene.display_point(vertex))
        and scene.vertex_at(place.x(), place.y()) == vertex
    )
    QTest.mouseMove(canvas, at[1] + QPoint(1, 0))
    QTest.mouseMove(canvas, at[1])
    index = at[0] + 44
    qtbot.waitUntil(
        lambda: window.hover_label.text().startswith(f"Vertex {index}  ·"), timeout=PATIENCE
    )
    QTest.mouseClick(canvas, LEFT, pos=at[1])
    catch_up()
    named = [
        label.text()
        for label in window.findChildren(QLabel)
        if label.objectName().startswith("pin_label_")
    ]
    assert sorted(named) == sorted(["Vertex 60", f"Vertex {index}"])

    # an export at all vertices of the file
    document.display.kind = "eigenfunction"
    QTest.mouseClick(part(window, "compute_button"), LEFT)
    qtbot.waitUntil(
        lambda: document.spectrum is not None and document.spectrum.complete, timeout=PATIENCE
    )
    rest(qtbot, window)
    window.commands.export()
    dialog = window.findChild(ExportDialog)
    qtbot.waitUntil(dialog.isVisible, timeout=PATIENCE)
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("hks"))
    assert dialog.repairs_label.text().startswith("Keep the largest component.")
    assert "162 rows" in dialog.contents_label.text()
    QTest.mouseClick(dialog.whole_check, LEFT, pos=QPoint(8, dialog.whole_check.height() // 2))
    assert "206 rows" in dialog.contents_label.text()
    out = tmp_path / "out.csv"
    dialog.file_row.edit.selectAll()
    QTest.keyClicks(dialog.file_row.edit, str(out))
    QTest.mouseClick(dialog.accept_button, LEFT)
    qtbot.waitUntil(out.exists, timeout=PATIENCE)
    rest(qtbot, window)
    assert "at all 206 vertices of the mesh file" in said(window)
    assert said(window).endswith("Repaired before: Keep the largest component.")
    table = pyarrow.csv.read_csv(out).to_pydict()
    assert table["vertex"] == list(range(206))
    values = np.array(table[list(table)[1]], dtype=float)
    np.testing.assert_array_equal(np.isfinite(values), np.arange(206) >= 44)

    # the link undoes the repair and the later pin; a key undoes one step
    link = part(window, "undo_repair_button")
    qtbot.waitUntil(lambda: link.text() == "Undo repair and 1 more", timeout=PATIENCE)
    assert link.toolTip() == "Undo the last repair and 1 later change"
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: link.text() == "Undo repair", timeout=PATIENCE)
    QTest.keyClick(
        window,
        Qt.Key.Key_Z,
        Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier,
    )
    qtbot.waitUntil(lambda: link.text() == "Undo repair and 1 more", timeout=PATIENCE)
    QTest.mouseClick(link, LEFT)
    qtbot.waitUntil(lambda: document.repairs == (), timeout=PATIENCE)
    rest(qtbot, window)
    assert {pin.number: pin.vertex for pin in document.pins.placed} == {1: 7, 2: 60}


@pytest.mark.slow
def test_repairs_are_made_again_and_undone_one_by_one(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path, tmp_path: Path
) -> None:
    window, other = start(), save(shapes.icosphere(1), tmp_path / "ball.npz")
    read(qtbot, window, path)
    for name in (DROP, LARGEST):
        click_repair(qtbot, window, name)

    window = start()
    document, shown = window.document, list[int]()
    document.mesh_changed.connect(lambda: shown.append(document.mesh.n_vertices))
    read(qtbot, window, path)
    assert document.repairs == (DROP, LARGEST)
    assert shown == [162], "it does not come first as it was read"
    assert said(window) == (
        "Repaired as before: Drop unreferenced vertices, Keep the largest component."
    )
    assert path in window.settings.recent
    QTest.mouseClick(part(window, "message_action"), LEFT)
    qtbot.waitUntil(lambda: document.repairs == (DROP,), timeout=PATIENCE)
    rest(qtbot, window)
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(lambda: document.repairs == (), timeout=PATIENCE)
    rest(qtbot, window)
    assert (document.mesh.n_vertices, document.undo_repair_steps) == (206, 0)

    # each file has its own repairs
    read(qtbot, window, other)
    read(qtbot, window, path)
    assert (document.repairs, said(window)) == ((), "")
    click_repair(qtbot, window, LARGEST)
    read(qtbot, window, other)
    assert document.repairs == ()
    read(qtbot, window, path)
    assert document.repairs == (LARGEST,)

    # a file of the same name with other content
    mesh = document.file_mesh
    assert mesh is not None
    read(qtbot, window, other)
    save(Mesh(1.5 * mesh.vertices, mesh.faces), path)
    read(qtbot, window, path)
    assert document.repairs == ()
    assert said(window).startswith("balls.npz has changed since it was repaired")
    read(qtbot, window, other)
    window.stage.message_bar.dismiss()
    read(qtbot, window, path)
    assert said(window) == "", "once"


@pytest.mark.slow
def test_the_second_mesh_is_repaired_as_it_was(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path, tmp_path: Path
) -> None:
    window = start()
    read(qtbot, window, save(shapes.icosphere(2), tmp_path / "ball.npz"))

    def second() -> MainWindow:
        window.opening.open_second(path)
        beside = window.opening.second_view
        qtbot.waitUntil(lambda: beside.document.path == path, timeout=PATIENCE)
        qtbot.waitUntil(lambda: beside.document.work.job is None, timeout=PATIENCE)
        return beside

    beside = second()
    beside.document.repair(LARGEST)
    qtbot.waitUntil(lambda: beside.document.repairs == (LARGEST,), timeout=PATIENCE)
    beside.document.set_unit("mm")
    window.opening.end_comparison()
    beside = second()
    assert (beside.document.repairs, beside.document.unit_text) == ((LARGEST,), "mm")
    assert beside.document.mesh.file_index(0) == 44


def stored_unit(window: MainWindow, path: Path) -> str:
    """Return the unit stored for a mesh file, or "" if there is none."""
    session = window.opening.last_session.stored(path)
    return "" if session is None else session.unit


@pytest.mark.slow
def test_a_unit_of_the_command_line_is_remembered_for_its_file(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path
) -> None:
    unit = "8 nm"
    seen: list[str] = []

    def look() -> None:
        shown = [w for w in QApplication.topLevelWidgets() if isinstance(w, MainWindow)]
        for window in shown:
            if window.isVisible() and window.loaded and window.document.mesh is not None:
                seen.append(window.document.unit_text)
                window.close()

    timer = QTimer(interval=5)
    timer.timeout.connect(look)
    timer.start()
    assert run.run_app(path, unit) == 0
    timer.stop()
    assert seen[0] == unit

    window = start()
    read(qtbot, window, path)
    assert window.document.unit_text == unit
    assert stored_unit(window, path) == unit
    # "none" is stored too; the unit of an unreadable file is not
    absent = path.with_name("absent.npz")
    window.open_mesh(absent, "m")
    rest(qtbot, window)
    window.open_mesh(path, "none")
    qtbot.waitUntil(lambda: window.document.unit_text == "none", timeout=PATIENCE)
    rest(qtbot, window)
    window.opening.last_session.save()
    assert [stored_unit(window, each) for each in (path, absent)] == ["none", ""]


@pytest.mark.slow
def test_pins_come_back_with_a_session_by_their_number_in_the_file(
    qtbot: QtBot, start: Callable[[], MainWindow], path: Path, tmp_path: Path
) -> None:
    window = start()
    read(qtbot, window, path)
    click_repair(qtbot, window, LARGEST)
    document = window.document
    document.pins.toggle(document.mesh.vertex_of(60))
    document.pins.toggle(document.mesh.vertex_of(50))
    document.display.kind = "distance"
    document.display.change(type(document.display.family), vertex=document.mesh.vertex_of(60))
    session = tmp_path / "now.meshmash.json"
    window.opening.store_session(session)
    content = json.loads(session.read_text())["meshes"][0]
    assert (content["pins"], content["n_vertices"]) == ([60, 50], 206)

    read(qtbot, window, save(shapes.icosphere(1), tmp_path / "ball.npz"))
    window.opening.restore_session(session)
    qtbot.waitUntil(lambda: len(document.pins.placed) == 2, timeout=PATIENCE)
    rest(qtbot, window)
    assert document.repairs == (LARGEST,)
    assert [document.mesh.file_index(pin.vertex) for pin in document.pins.placed] == [60, 50]
    assert document.mesh.file_index(document.display.family.vertex) == 60
    assert isinstance(part(window, "undo_repair_button"), QAbstractButton)
    assert part(window, "undo_repair_button").isVisible()

    # a session of version 2 has indices of the repaired mesh
    content |= {
        "format": "meshmash-viewer session",
        "version": 2,
        "pins": [16, 6],
        "n_vertices": 162,
    }
    content["display"]["fields"]["distance"]["vertex"] = 16
    session.write_text(json.dumps(content))
    document.pins.clear()
    window.opening.restore_session(session)
    qtbot.waitUntil(lambda: len(document.pins.placed) == 2, timeout=PATIENCE)
    rest(qtbot, window)
    assert [document.mesh.file_index(pin.vertex) for pin in document.pins.placed] == [60, 50]
    assert document.mesh.file_index(document.display.family.vertex) == 60
