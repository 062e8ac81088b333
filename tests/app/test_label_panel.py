"""Labels panel by mouse and keys: each action can be undone and redone."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from closed_form import part
from nibabel.gifti import GiftiDataArray, GiftiImage
from PySide6.QtCore import QCoreApplication, QEvent, QPoint, Qt
from PySide6.QtGui import QContextMenuEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QColorDialog, QFileDialog, QLineEdit, QMenu, QTableView
from pytestqt.qtbot import QtBot
from tiers import slow, slow_but

import meshmash_viewer as mv
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.health import mesh_health
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.surface.edges import border_edges

LEFT = Qt.MouseButton.LeftButton
MESH = shapes.icosphere(3, radius=50.0).in_unit("nm")
UP = MESH.vertices[:, 2] > 5.0
COLOR, NAME, VERTICES, AREA, SHOWN, LOCK = range(6)


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    document = Document()
    document.accept_mesh(MeshReady(MESH, mesh_health(MESH), MESH.vertex_normals))
    window = reopen_window(document)
    window.arrangement.docks["label"].raise_()
    return window


@pytest.fixture
def labelled(window: MainWindow, qtbot: QtBot) -> MainWindow:
    """Return a window with two labels; the first label covers the upper part."""
    document = window.document
    document.labels.new_set()
    document.labels.new_label()
    document.selection.set(UP)
    document.labels.assign(1)
    rest(window, qtbot)
    return window


def rest(window: MainWindow, qtbot: QtBot) -> None:
    catch_up()
    window.wait()
    QTest.qWait(1)
    catch_up()


def press(window: MainWindow, name: str) -> None:
    QTest.mouseClick(part(window, name), LEFT)
    catch_up()


def table(window: MainWindow) -> QTableView:
    return part(window, "label_table")


def texts(window: MainWindow) -> list[list[str]]:
    model = table(window).model()
    return [
        [str(model.index(row, column).data()) for column in (COLOR, NAME, VERTICES, AREA)]
        for row in range(model.rowCount())
    ]


def middle(window: MainWindow, row: int, column: int) -> QPoint:
    shown = table(window)
    return shown.visualRect(shown.model().index(row, column)).center()


def click(
    window: MainWindow, row: int, column: int, keys: Qt.KeyboardModifier | None = None
) -> None:
    given = keys or Qt.KeyboardModifier.NoModifier
    QTest.mouseClick(table(window).viewport(), LEFT, given, middle(window, row, column))
    catch_up()


def values(window: MainWindow) -> np.ndarray:
    known = window.document.labels.current
    assert known is not None
    return known.values


def test_from_nothing_to_labels_with_keys_alone(window: MainWindow, qtbot: QtBot) -> None:
    document = window.document
    assert part(window, "label_hint").text().startswith("Press New set, select vertices")
    assert not part(window, "label_set_combo").isEnabled()
    press(window, "label_new_set_button")
    press(window, "label_new_button")
    rest(window, qtbot)
    assert (document.display.kind, document.display[OwnMaps].chosen) == ("map", "labels")
    assert texts(window) == [["1", "label 1", "0", "–"], ["2", "label 2", "0", "–"]]
    assert table(window).chosen == [2], "the new label"
    document.selection.set(UP)
    catch_up()
    assert part(window, "label_hint").text().startswith(f"{UP.sum()} vertices selected")
    table(window).setFocus()
    QTest.keyClick(table(window), Qt.Key.Key_2)
    rest(window, qtbot)
    np.testing.assert_array_equal(values(window), np.where(UP, 2, 0))
    assert document.display.kind == "map", "the digit was no command"
    part(window, "label_new_button").setFocus()
    QTest.keyClick(part(window, "label_new_button"), Qt.Key.Key_1)
    np.testing.assert_array_equal(values(window), np.where(UP, 1, 0))
    window.stage.setFocus()
    QTest.keyClick(window.stage, Qt.Key.Key_1)
    np.testing.assert_array_equal(values(window), np.where(UP, 1, 0))
    assert document.display.kind == "eigenfunction", "outside the panel it is"


def test_digits_are_of_labels_while_the_select_tool_is_on(labelled: MainWindow) -> None:
    document, kind = labelled.document, labelled.document.display.kind
    labelled.stage.setFocus()
    QTest.keyClick(labelled.stage, Qt.Key.Key_W)
    assert labelled.select_tool.on
    QTest.keyClick(labelled.stage, Qt.Key.Key_2)
    np.testing.assert_array_equal(values(labelled), np.where(UP, 2, 0))
    assert document.display.kind == kind
    QTest.keyClick(labelled.stage, Qt.Key.Key_7)
    assert labelled.stage.message_bar.notice.text.startswith("There is no label 7, as there are 2")
    document.history.undo()
    np.testing.assert_array_equal(values(labelled), np.where(UP, 1, 0))
    QTest.keyClick(labelled.stage, Qt.Key.Key_W)
    QTest.keyClick(labelled.stage, Qt.Key.Key_1)
    assert document.display.kind == "eigenfunction"


@pytest.mark.slow
def test_a_digit_says_what_it_gives_to_a_set_that_is_not_displayed(
    labelled: MainWindow, qtbot: QtBot
) -> None:
    hint, other = part(labelled, "label_hint"), "The render shows another field, not this set."
    catch_up()
    assert other not in hint.text()
    labelled.add_map("thickness", MESH.vertices[:, 2])
    rest(labelled, qtbot)
    assert hint.text().endswith(other)
    table(labelled).setFocus()
    QTest.keyClick(table(labelled), Qt.Key.Key_2)
    np.testing.assert_array_equal(values(labelled), np.where(UP, 2, 0))
    said = labelled.stage.message_bar.notice
    assert said.text == f"{UP.sum()} vertices given to label 2 of labels."
    assert (said.severity, said.holds) == ("information", None)
    labelled.document.labels.choose("labels")
    rest(labelled, qtbot)
    assert other not in hint.text()


@pytest.mark.slow
def test_sizes_follow_the_labels(labelled: MainWindow, qtbot: QtBot) -> None:
    document = labelled.document
    assert texts(labelled)[0][2] == f"{UP.sum():,}"
    header = table(labelled).model().headerData(AREA, Qt.Orientation.Horizontal)
    assert header == "Area, µm²"
    area = float(MESH.vertex_areas[UP].sum())
    assert float(texts(labelled)[0][3]) == pytest.approx(1e-6 * area, rel=5e-3)
    document.history.undo()
    rest(labelled, qtbot)
    assert texts(labelled)[0][2:] == ["0", "–"]


@pytest.mark.slow
def test_names_have_the_room_in_a_narrow_panel(labelled: MainWindow, qtbot: QtBot) -> None:
    (table,) = labelled.findChildren(QTableView, "label_table")
    dock = labelled.arrangement.docks["label"]
    for width, shown in ((290, False), (420, True)):
        labelled.resizeDocks([dock], [width], Qt.Orientation.Horizontal)
        qtbot.waitUntil(lambda at=shown: table.isColumnHidden(VERTICES) is not at, timeout=10_000)
        assert table.columnWidth(NAME) >= 80
    tip = table.model().index(0, NAME).data(Qt.ItemDataRole.ToolTipRole)
    assert tip.endswith(f": {UP.sum()} vertices")


@pytest.mark.slow
def test_a_name_is_edited_in_its_place(labelled: MainWindow) -> None:
    shown = table(labelled)
    click(labelled, 1, NAME)
    QTest.mouseDClick(shown.viewport(), LEFT, pos=middle(labelled, 1, NAME))
    edit = shown.findChild(QLineEdit)
    assert edit is not None
    QTest.keyClicks(edit, "spine 3")  # a digit in a name is text, not a command
    QTest.keyClick(edit, Qt.Key.Key_Return)
    QTest.qWait(1)  # Qt commits the name in the event loop
    catch_up()
    assert [each.name for each in labelled.document.labels.current.labels] == ["label 1", "spine 3"]
    labelled.document.history.undo()
    catch_up()
    assert texts(labelled)[1][1] == "label 2"
    labelled.document.history.redo()
    catch_up()
    assert texts(labelled)[1][1] == "spine 3"


@pytest.mark.slow
def test_a_colour_is_chosen_at_its_square(labelled: MainWindow, qtbot: QtBot) -> None:
    click(labelled, 0, COLOR)
    dialog = labelled.findChild(QColorDialog, "label_color_dialog")
    assert dialog is not None
    dialog.setCurrentColor("#123456")
    dialog.accept()
    rest(labelled, qtbot)
    assert labelled.document.labels.current.labels[0].color == "#123456".upper()
    field = labelled.controller.field
    assert field is not None
    assert field.colors(labelled.document.display)[1][0] == "#123456"
    labelled.document.history.undo()
    assert labelled.document.labels.current.labels[0].color != "#123456"


@pytest.mark.slow
def test_a_locked_label_keeps_its_vertices(labelled: MainWindow) -> None:
    click(labelled, 0, LOCK)
    assert labelled.document.labels.current.labels[0].locked
    labelled.document.selection.set(np.ones(MESH.n_vertices, dtype=bool))
    QTest.keyClick(table(labelled), Qt.Key.Key_2)
    np.testing.assert_array_equal(values(labelled), np.where(UP, 1, 2))
    click(labelled, 0, LOCK)
    QTest.keyClick(table(labelled), Qt.Key.Key_2)
    assert set(values(labelled).tolist()) == {2}


@pytest.mark.slow
def test_a_label_is_hidden_and_shown(labelled: MainWindow, qtbot: QtBot) -> None:
    document = labelled.document
    document.selection.set(~UP)
    document.labels.assign(2)
    document.display.label_borders = True
    rest(labelled, qtbot)
    click(labelled, 0, SHOWN)
    rest(labelled, qtbot)
    np.testing.assert_array_equal(document.hiding.mask, UP)
    shown = table(labelled).model().index(0, SHOWN)
    assert shown.data(Qt.ItemDataRole.AccessibleTextRole).startswith("Hidden")
    assert "borders" not in labelled.scene.renderer.overlays, "no edge is between two shown faces"
    click(labelled, 0, SHOWN)
    rest(labelled, qtbot)
    assert document.hiding.mask is None
    assert shown.data(Qt.ItemDataRole.AccessibleTextRole).startswith("Shown")
    assert "borders" in labelled.scene.renderer.overlays
    document.set_unit("µm")
    rest(labelled, qtbot)
    assert "borders" in labelled.scene.renderer.overlays, "drawn anew with the mesh"
    document.history.undo()
    document.history.undo()
    np.testing.assert_array_equal(document.hiding.mask, UP)


@pytest.mark.slow
def test_labels_are_joined_deleted_and_selected(labelled: MainWindow) -> None:
    document = labelled.document
    click(labelled, 0, NAME)
    assert not part(labelled, "label_join_button").isEnabled()
    press(labelled, "label_select_button")
    np.testing.assert_array_equal(document.selection.mask, UP)
    document.selection.set(~UP)
    click(labelled, 1, NAME)
    press(labelled, "label_assign_button")
    np.testing.assert_array_equal(values(labelled), np.where(UP, 1, 2))
    press(labelled, "label_clear_button")
    np.testing.assert_array_equal(values(labelled), np.where(UP, 1, 0))
    document.history.undo()
    catch_up()
    click(labelled, 0, NAME, Qt.KeyboardModifier.ControlModifier)
    press(labelled, "label_join_button")
    assert set(values(labelled).tolist()) == {1}
    document.history.undo()
    catch_up()
    assert set(values(labelled).tolist()) == {1, 2}
    click(labelled, 0, NAME)
    QTest.keyClick(table(labelled), Qt.Key.Key_Delete)
    catch_up()
    assert [row[1] for row in texts(labelled)] == ["label 2"]
    press(labelled, "label_remove_set_button")
    assert document.labels.sets == ()
    assert part(labelled, "label_table").isHidden() or not table(labelled).isVisible()
    document.history.undo()
    document.history.undo()
    catch_up()
    assert [row[1] for row in texts(labelled)] == ["label 1", "label 2"]


def test_the_menu_of_the_chosen_labels(labelled: MainWindow) -> None:
    click(labelled, 0, NAME)

    def names() -> list[str]:
        shown, place = table(labelled), middle(labelled, 0, NAME)
        event = QContextMenuEvent(QContextMenuEvent.Reason.Mouse, place, shown.mapToGlobal(place))
        QApplication.sendEvent(shown.viewport(), event)
        menu = labelled.findChild(QMenu, "label_menu")
        found = [each.objectName().removeprefix("label_menu_") for each in menu.actions()]
        QTest.mouseClick(
            menu, LEFT, pos=menu.actionGeometry(menu.actions()[found.index("lock")]).center()
        )
        QCoreApplication.sendPostedEvents(menu, QEvent.Type.DeferredDelete)
        catch_up()
        return found

    assert names() == ["assign", "select", "isolate", "rename", "recolor", "lock", "delete"]
    assert labelled.document.labels.current.labels[0].locked
    table(labelled).selectAll()
    assert names() == ["select", "isolate", "lock", "join", "delete"]
    assert all(each.locked for each in labelled.document.labels.current.labels)


@pytest.mark.slow
def test_another_set_is_chosen_and_displayed(labelled: MainWindow, qtbot: QtBot) -> None:
    press(labelled, "label_new_set_button")
    combo = part(labelled, "label_set_combo")
    assert (combo.count(), combo.currentText()) == (2, "labels 2")
    labelled.document.labels.new_label()
    catch_up()
    table(labelled).selectRow(0)
    combo.setFocus()
    QTest.keyClick(combo, Qt.Key.Key_Up)
    rest(labelled, qtbot)
    assert labelled.document.labels.current.name == "labels"
    assert labelled.controller.field.title == "labels"
    assert not table(labelled).selectionModel().hasSelection()
    assert texts(labelled)[0][2] == f"{UP.sum():,}"


@pytest.mark.slow
def test_borders_are_drawn_over_another_field(labelled: MainWindow, qtbot: QtBot) -> None:
    document, scene = labelled.document, labelled.scene
    document.selection.clear()
    document.display.show(OwnMaps(chosen="Mean curvature"))
    rest(labelled, qtbot)
    before = scene.picture((300, 300))
    press(labelled, "label_borders_check")
    rest(labelled, qtbot)
    drawn = scene.picture((300, 300))
    assert 50 < (np.abs(drawn.astype(int) - before).max(axis=2) > 60).sum() < 3000
    assert labelled.actions_["label_borders"].isChecked()
    document.labels.delete([1, 2])
    rest(labelled, qtbot)
    np.testing.assert_array_equal(scene.picture((300, 300)), before)
    document.history.undo()
    rest(labelled, qtbot)
    np.testing.assert_array_equal(scene.picture((300, 300)), drawn)
    labelled.stage.setFocus()
    QTest.keyClick(labelled.stage, Qt.Key.Key_B)
    rest(labelled, qtbot)
    np.testing.assert_array_equal(scene.picture((300, 300)), before)


@pytest.mark.slow
def test_the_graph_of_labels_is_drawn_over_any_field(labelled: MainWindow, qtbot: QtBot) -> None:
    document, scene, action = labelled.document, labelled.scene, labelled.actions_["label_graph"]
    z = MESH.vertices[:, 2]
    document.labels.new_label()
    for number, inside in ((2, ~UP & (z > -0.4)), (1, UP | (z < -0.4))):
        document.selection.set(inside)
        document.labels.assign(number)
    document.selection.clear()
    rest(labelled, qtbot)
    before = scene.picture((300, 300))
    action.trigger()
    rest(labelled, qtbot)
    assert action.isChecked()
    drawn = scene.picture((300, 300))
    # two lines from the band, one to each end, each with a light edge
    assert 100 < (np.abs(drawn.astype(int) - before).max(axis=2) > 60).sum() < 4000
    assert (drawn[..., :3].max(axis=2) < 60).sum() > 20
    document.labels.delete([1, 2])
    rest(labelled, qtbot)
    document.history.undo()
    rest(labelled, qtbot)
    np.testing.assert_array_equal(scene.picture((300, 300)), drawn)
    action.trigger()
    rest(labelled, qtbot)
    np.testing.assert_array_equal(scene.picture((300, 300)), before)


def test_borders_are_the_edges_between_faces_of_different_labels() -> None:
    for mesh in (MESH, shapes.blob(2)):
        labels = np.random.default_rng(2).integers(0, 3, mesh.n_vertices)
        of_face, sides = labels[mesh.faces[:, 2]], {}
        for face, value in zip(mesh.faces.tolist(), of_face.tolist(), strict=True):
            for at in range(3):
                edge = tuple(sorted((face[at], face[at - 1])))
                sides.setdefault(edge, set()).add(value)
        expected = sorted(edge for edge, seen in sides.items() if len(seen) > 1)
        assert border_edges(mesh.faces, labels).tolist() == [list(edge) for edge in expected]
    assert border_edges(MESH.faces, np.zeros(MESH.n_vertices)).shape == (0, 2)


@pytest.mark.slow
def test_regions_are_measured_looked_at_and_exported(
    labelled: MainWindow, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, scene = labelled.document, labelled.scene
    document.labels.select([1])
    document.labels.assign(1)
    document.selection.set(MESH.vertices[:, 2] < -40.0)
    document.labels.assign(2)
    document.selection.set(MESH.vertices[:, 2] > 48.0)  # a second component of the label
    document.labels.assign(2)
    document.display.show(OwnMaps(chosen="Mean curvature"))
    rest(labelled, qtbot)
    shown = part(labelled, "region_table")
    assert part(labelled, "region_hint").text().startswith("Press Measure")
    assert not shown.isVisible()
    assert not part(labelled, "region_export_button").isEnabled()
    press(labelled, "region_measure_button")
    qtbot.waitUntil(lambda: document.labels.regions is not None, timeout=60_000)
    rest(labelled, qtbot)
    model = shown.model()
    titles = [model.headerData(at, Qt.Orientation.Horizontal) for at in range(model.columnCount())]
    assert titles[:2] == ["Region", "Area, µm²"]
    assert {"Vertices", "Neck, nm", "Mean, µm⁻¹"} <= set(titles)
    rows = [model.index(row, 0).data() for row in range(model.rowCount())]
    assert rows == ["label 1", "label 2 (1)", "label 2 (2)"]
    known = document.labels.current
    assert known is not None
    expected = mv.regions(MESH, known)
    for row in range(3):
        assert float(model.index(row, 1).data()) == pytest.approx(
            1e-6 * expected["area"][row], rel=5e-3
        )
    # a click moves the camera to the region
    QTest.mouseClick(shown.viewport(), LEFT, pos=shown.visualRect(model.index(1, 0)).center())
    below = expected.mask(1)
    qtbot.waitUntil(lambda: scene.at_rest, timeout=60_000)
    assert scene.renderer.view.focus[2] < -40.0
    assert below[scene.vertex_at(scene.width() / 2, scene.height() / 2)]
    QTest.mouseDClick(shown.viewport(), LEFT, pos=shown.visualRect(model.index(1, 0)).center())
    np.testing.assert_array_equal(document.hiding.mask, ~below)
    document.history.undo()
    assert document.hiding.mask is None
    # in a sorted table, a click refers to the row shown
    shown.sortByColumn(1, Qt.SortOrder.AscendingOrder)
    smallest = model.index(0, 0).data()
    assert smallest == "label 2 (2)"
    file = tmp_path / "out.csv"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_, **__: (str(file), ""))
    press(labelled, "region_export_button")
    qtbot.waitUntil(lambda: labelled.background_io.idle and file.exists(), timeout=60_000)
    assert file.read_text().splitlines()[1].startswith('"label 1",1,')
    # whole labels have no neck
    QTest.mouseClick(part(labelled, "region_whole_check"), LEFT)
    press(labelled, "region_measure_button")
    qtbot.waitUntil(lambda: model.rowCount() == 2, timeout=60_000)
    titles = [model.headerData(at, Qt.Orientation.Horizontal) for at in range(model.columnCount())]
    assert not [title for title in titles if title.startswith("Neck")]
    # a change since the measurement is reported
    document.labels.delete([2])
    catch_up()
    assert part(labelled, "region_hint").text().startswith("The table is of other labels")
    document.history.undo()
    catch_up()
    assert part(labelled, "region_hint").isHidden()
    # counts of points that come while the set is undone keep the colours of its labels

    def colors() -> list[str]:
        icons = [model.index(row, 0).data(Qt.ItemDataRole.DecorationRole) for row in range(2)]
        return [icon.pixmap(12).toImage().pixelColor(6, 6).name() for icon in icons]

    before, measured = colors(), document.labels.measured
    assert "#808080" not in before
    while document.history.past:
        document.history.undo()
    counted = measured.with_points(mv.project_points(MESH, MESH.vertices[:5]))
    document.labels.accept_counts(measured, counted)
    catch_up()
    assert colors() == before


@pytest.mark.parametrize(
    "name",
    slow_but(["a.annot"], ["a.label.gii", "a.annot", "a.label", "a.csv", "a.npz", "a.ply"]),
)
def test_a_set_is_saved_and_opened_again(
    name: str, labelled: MainWindow, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, file = labelled.document, tmp_path / name
    document.labels.rename(1, "top")
    document.selection.set(~UP)
    document.labels.assign(2)
    catch_up()
    click(labelled, 0, NAME)  # formats for one label save the selected label
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_, **__: (str(file), ""))
    press(labelled, "label_save_button")
    qtbot.waitUntil(lambda: labelled.background_io.idle and file.exists(), timeout=60_000)
    assert labelled.stage.message_bar.notice.text == f"Labels written to {file}."
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_, **__: ([str(file)], ""))
    press(labelled, "label_open_button")
    qtbot.waitUntil(lambda: len(document.labels.sets) == 2, timeout=60_000)
    catch_up()
    found = document.labels.sets[1]
    assert document.labels.current is found
    if name == "a.label":
        np.testing.assert_array_equal(np.isfinite(found.shown), UP)
    else:
        assert [each.name for each in found.labels] == ["top", "label 2"]
        np.testing.assert_array_equal(found.shown, np.where(UP, 0, 1))
    document.history.undo()
    assert len(document.labels.sets) == 1


def open_labels(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, *files: Path
) -> str:
    """Open files with the button of the panel and return the message."""
    chosen = [str(each) for each in files]
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_, **__: (chosen, ""))
    before = window.document.mesh.maps
    press(window, "label_open_button")
    qtbot.waitUntil(lambda: window.document.mesh.maps is not before, timeout=60_000)
    qtbot.waitUntil(lambda: window.background_io.idle, timeout=60_000)
    rest(window, qtbot)
    return window.stage.message_bar.notice.text


def write_numbers(path: Path, numbers: np.ndarray) -> Path:
    if path.suffix == ".gii":
        array = GiftiDataArray(numbers.astype(np.int32), intent="NIFTI_INTENT_LABEL")
        path.write_bytes(GiftiImage(darrays=[array]).to_bytes())
    elif path.suffix == ".csv":
        path.write_text("\n".join(["parts", *map(str, numbers.tolist())]))
    else:
        np.save(path, numbers)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.label.gii", "a.csv", "a.npy"])
def test_numbers_without_names_are_opened_as_a_label_set(
    name: str, labelled: MainWindow, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = labelled.document
    wanted = np.where(UP, 2, 1)
    file = write_numbers(tmp_path / name, wanted)
    shown = "parts" if name == "a.csv" else name
    said = open_labels(labelled, qtbot, monkeypatch, file)
    assert said == f"Added 1 map: {shown}."
    known = document.labels.current
    assert (known.name, part(labelled, "label_set_combo").currentText()) == (shown, shown)
    assert document.maps.displayed == shown
    assert [row[1] for row in texts(labelled)] == ["1", "2"]
    np.testing.assert_array_equal(known.values, wanted)
    kept = known in document.maps.unsaved.maps
    assert kept == (name != "a.label.gii"), "a session has the set, whose file has none"
    document.history.undo()
    assert [each.name for each in document.labels.sets] == ["labels"]
    document.maps.open([file])
    qtbot.waitUntil(lambda: len(document.mesh.maps) == 2, timeout=60_000)
    assert bool(document.mesh.maps[1].labels) == (name == "a.label.gii")


@pytest.mark.slow
def test_the_set_opened_last_is_the_chosen_one(
    labelled: MainWindow, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = write_numbers(tmp_path / "a.label.gii", np.where(UP, 2, 1))
    second = write_numbers(tmp_path / "b.npy", np.where(UP, 5, 0))
    height = tmp_path / "height.npy"
    np.save(height, MESH.vertices[:, 2])
    open_labels(labelled, qtbot, monkeypatch, first, second, height)
    document = labelled.document
    assert [each.name for each in document.labels.sets] == ["labels", "a.label.gii", "b.npy"]
    assert document.labels.current.name == document.maps.displayed == "b.npy"


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        slow(MESH.vertices[:, 2], "has values that are no whole numbers"),
        slow(np.arange(MESH.n_vertices), "641 labels, more than 512 colours"),
        (np.zeros(MESH.n_vertices), "has no vertex with a label"),
    ],
    ids=["shares", "many", "none"],
)
def test_what_is_no_label_set_is_opened_as_numbers_and_said(
    numbers: np.ndarray,
    why: str,
    labelled: MainWindow,
    qtbot: QtBot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = write_numbers(tmp_path / "a.npy", numbers)
    said = open_labels(labelled, qtbot, monkeypatch, file)
    assert said.startswith("Added 1 map: a.npy. There is no label set in it: ")
    assert why in said
    assert labelled.stage.message_bar.notice.severity == "warning"
    assert [each.name for each in labelled.document.labels.sets] == ["labels"]
    assert labelled.document.maps.displayed == "a.npy"


def test_rows_of_a_table_are_copied_with_titles_and_all_digits(
    labelled: MainWindow, qtbot: QtBot
) -> None:
    document, areas = labelled.document, MESH.vertex_areas
    document.labels.rename(1, 'cap "up"')
    document.maps.add(MESH, [mv.VertexMap("height", MESH.vertices[:, 2])])
    document.pins.set("pins", (Pin(3, 1, "soma"), Pin(40, 2)))
    part(labelled, "pin_table_check").setChecked(True)
    before = document.labels.regions  # of another test
    press(labelled, "region_measure_button")
    qtbot.waitUntil(lambda: document.labels.regions is not before, timeout=60_000)
    rest(labelled, qtbot)
    document.display.kind = "map"
    document.maps.show("height")
    rest(labelled, qtbot)

    def copied(name: str) -> list[list[str]]:
        shown = part(labelled, name)
        QTest.keyClick(shown, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
        lines = io.StringIO(QApplication.clipboard().text())
        return list(csv.reader(lines, "excel-tab"))

    titles, cap, other = copied("label_table")
    assert titles == ["Number", "Label", "Colour", "Vertices", "Area, nm²"]
    assert cap[:2] == ["1", 'cap "up"']
    assert int(cap[3]) == UP.sum()
    assert float(cap[4]) == pytest.approx(areas[UP].sum(), rel=1e-13)
    assert other[3:] == ["0", "0.0"]

    regions = document.labels.regions
    titles, *rows = copied("region_table")
    assert titles[:4] == ["label", "part", "vertices", "area, nm²"]
    for at, name in enumerate(regions.columns):
        if name != "label":
            found = [float(row[at] or "nan") for row in rows]
            np.testing.assert_array_equal(found, regions[name])

    titles, first, second = copied("pin_table")
    assert titles == ["Pin", "Name", "Index", "Value", "x in nm", "y in nm", "z in nm"]
    assert first[:3] == ["1", "soma", "3"]
    assert list(map(float, second[4:])) == MESH.vertices[40].tolist()
    assert float(first[3]) == pytest.approx(MESH.vertices[3, 2], rel=1e-7)
    # selected rows alone
    pins = part(labelled, "pin_table")
    QTest.mouseClick(pins.viewport(), LEFT, pos=pins.visualRect(pins.rows.index(1, 1)).center())
    assert [row[0] for row in copied("pin_table")] == ["Pin", "2"]
    QTest.keyClick(pins, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    assert [row[0] for row in copied("pin_table")] == ["Pin", "1", "2"]
