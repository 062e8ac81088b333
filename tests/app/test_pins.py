"""Pins by mouse and keys: menus, names, the table, dragging and removing."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from closed_form import part, rectangle_document
from faults import raises
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction, QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QColorDialog,
    QFileDialog,
    QInputDialog,
    QLineEdit,
    QMenu,
    QWidget,
)
from pytestqt.qtbot import QtBot
from shapes import icosphere

from meshmash_viewer.app.dialogs.pin_dialog import PinExportDialog, nearest_vertex
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.pins import pin_at
from meshmash_viewer.quantities import parse_number
from meshmash_viewer.units import NO_BREAK
from meshmash_viewer.vertex_map import Label, VertexMap

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow], qtbot: QtBot) -> MainWindow:
    window = reopen_window(rectangle_document(), (1440, 900))
    qtbot.waitUntil(lambda: window.scene.can_pick, timeout=60_000)
    return window


def menu_at(window: MainWindow, at: QPoint, qtbot: QtBot) -> dict[str, QAction]:
    """Right-click on the render; return the entries of the menu by name."""
    QTest.mouseClick(window.scene.plotter, RIGHT, pos=at)
    return open_menu(qtbot)


def open_menu(qtbot: QtBot) -> dict[str, QAction]:
    qtbot.waitUntil(lambda: isinstance(QApplication.activePopupWidget(), QMenu), timeout=5000)
    menu = QApplication.activePopupWidget()
    assert isinstance(menu, QMenu)
    return {each.objectName(): each for each in menu.actions() if each.objectName()}


def choose(entries: dict[str, QAction], name: str, qtbot: QtBot) -> None:
    menu = QApplication.activePopupWidget()
    assert isinstance(menu, QMenu)
    QTest.mouseClick(menu, LEFT, pos=menu.actionGeometry(entries[name]).center())
    qtbot.waitUntil(lambda: QApplication.activePopupWidget() is None, timeout=5000)


def dialog_of(window: MainWindow, kind: type[QWidget], qtbot: QtBot) -> QWidget:
    qtbot.waitUntil(lambda: bool(window.findChildren(kind)), timeout=5000)
    return window.findChildren(kind)[-1]


def pinned(window: MainWindow) -> list[int]:
    return [pin.vertex for pin in window.document.pins.placed]


def test_a_right_click_pins_copies_and_unpins(window: MainWindow, qtbot: QtBot) -> None:
    scene, document = window.scene, window.document
    field, mesh = window.controller.field, document.mesh
    assert field is not None
    assert mesh is not None
    at = scene.display_point(200)
    vertex = scene.vertex_at(at.x(), at.y())
    copied = {}
    for name in ("menu_copy_value", "menu_copy_coordinates", "menu_copy_index"):
        choose(menu_at(window, at, qtbot), name, qtbot)
        copied[name] = QApplication.clipboard().text()
    value = parse_number(copied["menu_copy_value"], field.unit)
    assert value == pytest.approx(field.values[vertex], rel=1e-6)
    place = [float(each) for each in copied["menu_copy_coordinates"].split(", ")]
    assert nearest_vertex(mesh, *place)[0] == vertex
    assert copied["menu_copy_index"] == str(vertex)
    choose(menu_at(window, at, qtbot), "menu_pin", qtbot)
    assert pinned(window) == [vertex]
    before = scene.camera()
    choose(menu_at(window, at, qtbot), "menu_centre", qtbot)
    assert scene.camera()["focus"] != before["focus"]
    at = scene.display_point(vertex)
    entries = menu_at(window, at, qtbot)
    shown = QApplication.activePopupWidget()
    assert isinstance(shown, QMenu)
    assert shown.actions()[0].text().startswith("Pin 1, vertex ")
    choose(entries, "menu_unpin", qtbot)
    assert pinned(window) == []


def test_a_right_click_next_to_the_mesh_offers_the_view(window: MainWindow, qtbot: QtBot) -> None:
    scene = window.scene
    before = scene.camera()
    window.scene.set_camera({**before, "half_size": 3.0 * before["half_size"]})
    entries = menu_at(window, QPoint(scene.width() // 2, scene.height() - 8), qtbot)
    assert "copy_picture" in entries
    choose(entries, "reset_camera", qtbot)
    assert scene.camera()["half_size"] == pytest.approx(before["half_size"], rel=0.1)


@pytest.mark.slow
def test_a_right_drag_pans_and_opens_no_menu(window: MainWindow) -> None:
    scene, start = window.scene, window.scene.display_point(200)
    before = scene.camera()
    QTest.mousePress(scene.plotter, RIGHT, pos=start)
    for step in (10, 20, 40):
        QTest.mouseMove(scene.plotter, start + QPoint(step, 0))
    QTest.mouseRelease(scene.plotter, RIGHT, pos=start + QPoint(40, 0))
    QTest.qWait(50)
    assert QApplication.activePopupWidget() is None
    assert scene.camera()["focus"] != before["focus"]
    assert scene.camera()["axes"] == before["axes"]


def test_a_menu_closes_when_another_mesh_is_shown(window: MainWindow, qtbot: QtBot) -> None:
    document, scene = window.document, window.scene
    menu_at(window, scene.display_point(200), qtbot)
    document.take_mesh(icosphere(1))
    qtbot.waitUntil(lambda: document.mesh.n_vertices == 42, timeout=5000)
    assert QApplication.activePopupWidget() is None


@pytest.mark.slow
def test_names_and_colours_are_given_by_the_menu(window: MainWindow, qtbot: QtBot) -> None:
    document, scene = window.document, window.scene
    document.pins.toggle(200)
    document.pins.toggle(310)
    for vertex, text, name in ((200, "soma", "soma"), (310, "soma", "soma 2")):
        choose(menu_at(window, scene.display_point(vertex), qtbot), "menu_rename", qtbot)
        dialog = dialog_of(window, QInputDialog, qtbot)
        edit = dialog.findChild(QLineEdit)
        edit.selectAll()
        QTest.keyClicks(edit, text)
        QTest.keyClick(edit, Qt.Key.Key_Return)
        qtbot.waitUntil(lambda: not window.findChildren(QInputDialog), timeout=5000)
        assert pin_at(document.pins.placed, vertex).name == name
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.text == "There is a pin called soma already: this one is soma 2."
    choose(menu_at(window, scene.display_point(200), qtbot), "menu_recolor", qtbot)
    colors = dialog_of(window, QColorDialog, qtbot)
    colors.setCurrentColor(QColor("#123456"))
    colors.accept()
    assert pin_at(document.pins.placed, 200).color == "#123456"
    for label in ("colour of a pin", "name of a pin", "name of a pin"):
        assert document.history.undo_label == label
        document.history.undo()
    assert [pin.name for pin in document.pins.placed] == ["", ""]


def test_a_click_within_the_disc_of_a_pin_unpins_it(window: MainWindow) -> None:
    scene, camera = window.scene, window.scene.camera()
    scene.set_camera({**camera, "half_size": 8.0 * camera["half_size"]})
    window.document.pins.toggle(200)
    at = scene.display_point(200) + QPoint(4, 4)
    assert scene.vertex_at(at.x(), at.y()) != 200, "another vertex is there"
    QTest.mouseMove(window.scene.plotter, at - QPoint(1, 0))
    QTest.mouseMove(window.scene.plotter, at)
    text = window.hover_label.text()
    assert text.startswith("Vertex 200")
    assert "click to unpin pin 1" in text
    QTest.mouseClick(window.scene.plotter, LEFT, pos=at)
    assert pinned(window) == []


def test_delete_removes_the_pin_that_is_hovered_or_chosen(window: MainWindow, qtbot: QtBot) -> None:
    document, scene = window.document, window.scene
    for vertex in (200, 310, 300):
        document.pins.toggle(vertex)
    QTest.mouseMove(scene.plotter, scene.display_point(310) + QPoint(1, 0))
    QTest.mouseMove(scene.plotter, scene.display_point(310))
    QTest.keyClick(window, Qt.Key.Key_Delete)
    assert pinned(window) == [200, 300]
    QTest.mouseMove(window, QPoint(3, 3))
    scene.plotter._point_at(None)
    QTest.mouseClick(part(window, "pin_table_check"), LEFT)
    table = part(window, "pin_table")
    qtbot.waitUntil(table.isVisible, timeout=5000)
    QTest.mouseClick(table.viewport(), LEFT, pos=row_of(table, 1))
    QTest.keyClick(table, Qt.Key.Key_Delete)
    assert pinned(window) == [200]
    document.history.undo()
    document.history.undo()
    assert pinned(window) == [200, 310, 300]


def row_of(table: QWidget, row: int, column: int = 2) -> QPoint:
    return table.visualRect(table.model().index(row, column)).center()


def test_the_table_lists_renames_and_flies(window: MainWindow, qtbot: QtBot) -> None:
    document, scene, mesh = window.document, window.scene, window.document.mesh
    assert mesh is not None
    document.pins.toggle(200)
    document.pins.toggle(310)
    qtbot.waitUntil(part(window, "pin_table_check").isVisible, timeout=5000)
    QTest.mouseClick(part(window, "pin_table_check"), LEFT)
    table = part(window, "pin_table")
    qtbot.waitUntil(table.isVisible, timeout=5000)
    texts = [table.model().index(1, column).data() for column in range(5)]
    field = window.controller.field
    assert field is not None
    assert texts[:3] == ["2", "", "310"]
    assert f"{texts[3]}{NO_BREAK}{field.written_unit}" == field.value_text(310)
    assert [float(each) for each in texts[4].split(", ")] == pytest.approx(
        mesh.vertices[310], rel=1e-5
    )
    assert table.model().headerData(4, Qt.Orientation.Horizontal) == "x, y, z in nm"
    QTest.mouseClick(table.viewport(), LEFT, pos=row_of(table, 1))
    QTest.mouseDClick(table.viewport(), LEFT, pos=row_of(table, 1))
    assert scene.camera()["focus"] == pytest.approx(mesh.vertices[310].tolist())
    QTest.mouseClick(table.viewport(), LEFT, pos=row_of(table, 1))
    QTest.keyClick(table, Qt.Key.Key_F2)
    edit = table.findChild(QLineEdit)
    QTest.keyClicks(edit, "spine 12")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: document.pins.placed[1].name == "spine 12", timeout=5000)
    QTest.keyClick(window, Qt.Key.Key_S)
    window.wait()
    assert scene.renderer.caption.quantity == "from spine 12 · bright is alike"
    document.history.undo()
    window.wait()
    assert scene.renderer.caption.quantity.startswith("from vertex 310 ")
    document.history.redo()
    QTest.keyClick(window, Qt.Key.Key_1)
    window.commands.step(1)
    window.wait()
    assert window.controller.field.value_text(310).startswith(table.model().index(1, 3).data())


@pytest.mark.slow
def test_a_pin_is_dragged_along_the_surface_in_one_step(window: MainWindow) -> None:
    document, scene = window.document, window.scene
    document.pins.toggle(200)
    document.pins.change("name of a pin", 200, name="soma")
    camera, start, end = scene.camera(), scene.display_point(200), scene.display_point(310)
    QTest.mousePress(scene.plotter, LEFT, pos=start)
    for share in (0.2, 0.5, 0.8, 1.0):
        QTest.mouseMove(scene.plotter, start + share * (end - start))
        QTest.qWait(20)
    QTest.mouseRelease(scene.plotter, LEFT, pos=end)
    assert pinned(window) == [scene.vertex_at(end.x(), end.y())]
    assert document.pins.placed[0].name == "soma"
    assert scene.camera() == camera
    moved = document.pins.placed
    document.history.undo()
    assert pinned(window) == [200]
    assert document.history.undo_label == "name of a pin"
    document.history.redo()
    assert document.pins.placed == moved


def test_a_table_is_imported_in_one_step_and_faults_are_said(
    window: MainWindow, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, path = window.document, tmp_path / "spines.csv"
    document.pins.toggle(200)
    path.write_text("index,name,color\n310,spine 12,#123456\n99999,far,\n", encoding="utf-8")
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(path), ""))
    window.actions_["import_pins"].trigger()
    window.wait()
    assert [(pin.vertex, pin.name) for pin in document.pins.placed] == [
        (200, ""),
        (310, "spine 12"),
    ]
    assert document.pins.placed[1].color == "#123456"
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.text == (
        "1 pin imported from spines.csv. Left out is row 2: There is no vertex 99999: give a"
        " whole number from 0 to 359."
    )
    document.history.undo()
    assert pinned(window) == [200]
    window.opening.open_path(path)  # like a dropped file
    window.wait()
    assert pinned(window) == [200, 310]
    document.history.undo()
    path.write_text("a,b\n1,2\n", encoding="utf-8")
    window.actions_["import_pins"].trigger()
    window.wait()
    assert "it needs a column index, or x, y and z" in window.stage.message_bar.notice.text
    assert pinned(window) == [200]


@pytest.mark.slow
def test_pins_are_exported_with_features_and_distances(
    window: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    document, path = window.document, tmp_path / "pins.csv"
    assert document.mesh is not None
    window.add_map("height", np.arange(document.mesh.n_vertices))
    sides = np.full(document.mesh.n_vertices, 11)
    sides[310] = 0
    side = VertexMap("side", sides, (Label(11, "left", "#4477aa"),))
    document.maps.add(document.mesh, [side])
    window.add_pins([200, 310], names=["soma", ""], colors=["", "#123456"])
    window.wait()
    window.actions_["export_pins"].trigger()
    dialog = dialog_of(window, PinExportDialog, qtbot)
    assert part(dialog, "pins_distance_check").isChecked()
    for check in dialog.findChildren(QCheckBox):
        check.setChecked(check.objectName() == "pins_distance_check")  # no pairs are stored here
    edit = part(dialog, "file_edit")
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    QTest.mouseClick(part(dialog, "pins_save_button"), LEFT)
    qtbot.waitUntil(path.exists, timeout=60_000)
    window.wait()
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["index"] for row in rows] == ["200", "310"]
    assert [row["name"] for row in rows] == ["soma", ""]
    assert rows[1]["color"] == "#123456"
    assert [float(row["height"]) for row in rows] == [200.0, 310.0]
    assert [(row["side"], row["side name"]) for row in rows] == [("11", "left"), ("0", "")]
    place = [float(rows[0][axis]) for axis in "xyz"]
    assert place == document.mesh.vertices[200].tolist()
    length = np.linalg.norm(np.subtract(*document.mesh.vertices[[200, 310]]))
    assert float(rows[1]["geodesic_from_200"]) == pytest.approx(length, rel=0.1)
    assert float(rows[0]["geodesic_from_200"]) == pytest.approx(0.0, abs=1e-6)


def test_scripts_add_maps_and_pins_or_get_an_error(window: MainWindow) -> None:
    document = window.document
    mesh = document.mesh
    assert mesh is not None
    window.add_pins(mesh.vertices[[7, 30]] + 0.01, names=["a", "b"])
    assert [(pin.vertex, pin.name) for pin in document.pins.placed] == [(7, "a"), (30, "b")]
    with raises("vertex-out-of-range", "There is no vertex 99999"):
        window.add_pins([8, 99999])
    with raises("far-from-mesh", "No pin was set, as row 1:"):
        window.add_pins([[1e12, 0.0, 0.0]])
    assert len(document.pins.placed) == 2
    document.history.undo()
    assert document.pins.placed == ()
    window.add_map("height", mesh.vertices[:, 2], unit="nm")
    assert document.mesh.map_named("height").unit == "nm"
    window.wait()
    assert window.controller.field.title == "height"
    with raises("other-mesh", "has 3 values and the mesh 360 vertices"):
        window.add_map("short", [1.0, 2.0, 3.0])


def test_coordinates_are_copied_in_voxels_as_well(window: MainWindow, qtbot: QtBot) -> None:
    ball = icosphere(3, radius=100_000.0)
    mesh = Mesh(ball.vertices + 5e6, ball.faces).in_voxels((4.0, 4.0, 40.0), "nm")
    window.document.take_mesh(mesh)
    window.wait()
    for vertex in (7, 300):
        for name in ("menu_copy_voxels", "menu_copy_coordinates"):
            window.commands.pins.show_menu(vertex, window.mapToGlobal(QPoint(400, 300)))
            choose(open_menu(qtbot), name, qtbot)
            place = map(float, QApplication.clipboard().text().split(", "))
            assert nearest_vertex(mesh, *place)[0] == vertex
