"""The dialog of Ctrl+G, which pins a vertex by its index or position."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from closed_form import part, rectangle_document
from faults import raises
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog
from pytestqt.qtbot import QtBot
from shapes import icosphere

from meshmash_viewer.app.dialogs.pin_dialog import PinDialog, nearest_vertex
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.mesh import Mesh

CONTROL = Qt.KeyboardModifier.ControlModifier


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window(rectangle_document())


def ask(qtbot: QtBot, window: MainWindow) -> None:
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    QTest.keyClick(window, Qt.Key.Key_G, CONTROL)
    qtbot.waitUntil(lambda: QApplication.activeModalWidget() is not None)
    qtbot.waitUntil(lambda: part(window, "pin_index_edit").hasFocus())


def pinned(window: MainWindow) -> list[int]:
    return [pin.vertex for pin in window.document.pins.placed]


@pytest.mark.slow
def test_what_is_no_index_is_refused_with_the_range(qtbot: QtBot, window: MainWindow) -> None:
    last = window.document.mesh.n_vertices - 1
    ask(qtbot, window)
    edit, fault = part(window, "pin_index_edit"), part(window, "pin_fault_label")
    texts = f"{last + 1}", "1.5", "", "vertex", "1,234,567"
    for text in texts:
        edit.selectAll()
        QTest.keyClicks(edit, text) if text else QTest.keyClick(edit, Qt.Key.Key_Delete)
        QTest.keyClick(edit, Qt.Key.Key_Return)
        assert fault.text().startswith(f"The index is a whole number from 0 to {last:,}"), text
        assert pinned(window) == [], text
        assert edit.hasFocus()
        assert edit.selectedText() == text
    assert fault.text().endswith("A position is written x, y, z.")
    QTest.keyClicks(edit, "3")
    assert fault.text() == ""
    QTest.keyClick(edit, Qt.Key.Key_Escape)
    assert pinned(window) == []


@pytest.mark.slow
def test_an_index_is_pinned(qtbot: QtBot, window: MainWindow) -> None:
    last = window.document.mesh.n_vertices - 1
    wanted = {"0": 0, " 12 ": 12, f"{last}": last, "1e2": 100, "15.0": 15, "0012": 12}
    for text, vertex in wanted.items():
        before = set(pinned(window))
        ask(qtbot, window)
        QTest.keyClicks(part(window, "pin_index_edit"), text)
        QTest.keyClick(part(window, "pin_index_edit"), Qt.Key.Key_Return)
        qtbot.waitUntil(lambda: QApplication.activeModalWidget() is None)
        assert set(pinned(window)) == before | {vertex}, text
        qtbot.waitUntil(lambda: not window.findChildren(QDialog, "pin_dialog"))
    assert "Vertex 12 is pinned already" in window.stage.message_bar.notice.text


def test_the_index_is_that_of_the_file(qtbot: QtBot) -> None:
    corners = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0]]
    mesh = repair_mesh((corners, [[1, 2, 3]]), "drop_unreferenced_vertices")
    dialog = PinDialog(mesh)
    qtbot.addWidget(dialog)
    for text, vertex, says in (
        ("0", -1, "removed by a repair"),
        ("4", -1, "0 to 3"),
        ("3", 2, ""),
    ):
        dialog.fault.setText("")
        dialog.edit.setText(text)
        dialog.pin_button.click()
        assert dialog.vertex == vertex
        assert says in dialog.fault.text()


@pytest.mark.slow
def test_a_position_pins_the_nearest_vertex_and_goes_there(
    qtbot: QtBot, window: MainWindow
) -> None:
    mesh = window.document.mesh
    place = mesh.vertices[123] + (3.0, -4.0, 0.0)
    for form in (
        "{}, {}, {}", "[{}, {}, {}]", "({},{},{})", "{}; {}; {}", "{},{},{}", "{} {} {}",
        "x {} y {} z {}", "{}, {}, {} nm",
    ):  # fmt: skip
        window.document.pins.clear()
        window.scene.reset_camera()
        window.stage.message_bar.dismiss()
        ask(qtbot, window)
        edit = part(window, "pin_index_edit")
        QTest.keyClicks(edit, form.format(*(f"{each:.3f}" for each in place)))
        QTest.keyClick(edit, Qt.Key.Key_Return)
        assert pinned(window) == [123], form
        assert (
            "Vertex 123 is 5\N{NO-BREAK SPACE}nm from that position"
            in window.stage.message_bar.notice.text
        ), form
        np.testing.assert_allclose(window.scene.camera()["focus"], mesh.vertices[123])


@pytest.mark.slow
def test_the_name_of_a_pin_goes_there(qtbot: QtBot, window: MainWindow) -> None:
    document = window.document
    document.pins.toggle(123)
    document.pins.change("name of a pin", 123, name="Soma")
    document.pins.toggle(7)
    ask(qtbot, window)
    edit = part(window, "pin_index_edit")
    QTest.keyClicks(edit, "soma")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert pinned(window) == [123, 7]
    np.testing.assert_allclose(window.scene.camera()["focus"], document.mesh.vertices[123])


def test_positions_in_voxels_and_far_away() -> None:
    mesh = icosphere(3, radius=100.0)
    voxels = Mesh(mesh.vertices, mesh.faces).in_voxels((4.0, 4.0, 40.0), "nm")
    for at in (7, 300):
        assert nearest_vertex(voxels, *mesh.vertices[at])[0] == at
        assert nearest_vertex(voxels, *voxels.vertices[at])[0] == at
    # a position with a unit is never read in voxels
    at = voxels.vertices[7] / voxels.voxel
    vertex, remark = nearest_vertex(voxels, *at)
    assert vertex == 7
    assert remark.endswith("from that position, read in voxels.")
    assert nearest_vertex(voxels, *voxels.vertices[7])[1].endswith(", read in nm.")
    remark = nearest_vertex(voxels, *at, voxels=False)[1]
    assert "is 0" not in remark
    assert remark.endswith("from that position.")
    with raises("far-from-mesh", "which lies between"):
        nearest_vertex(voxels, 1e9, 0.0, 0.0)
