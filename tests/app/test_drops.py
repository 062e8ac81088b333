"""Files dropped on the window, panels brought to the front, and progress in the status bar."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapes
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDragLeaveEvent, QDragMoveEvent, QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDockWidget, QLabel, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.pieces import aggregate_features, write_condensed_features
from meshmash_viewer.spectral.weyl import Target

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
COPY = Qt.DropAction.CopyAction
PATIENCE = 60_000


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    found = {}
    for name, level in (("ball", 2), ("other", 2)):
        mesh = shapes.icosphere(level)
        found[name] = tmp_path / f"{name}.npz"
        np.savez(found[name], vertices=mesh.vertices, faces=mesh.faces)
    found["map"] = tmp_path / "lh.depth.npy"
    np.save(found["map"], np.arange(mesh.n_vertices, dtype=float))
    found["session"] = tmp_path / "work.meshmash.json"
    return found


def data_of(*paths: Path) -> QMimeData:
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    return data


def drag(window: MainWindow, *paths: Path, share: float) -> tuple[QPoint, QMimeData]:
    """Send the events of a drag over the window; return its place and its data."""
    place, data = QPoint(round(share * window.width()), window.height() // 2), data_of(*paths)
    QApplication.sendEvent(window, QDragEnterEvent(place, COPY, data, LEFT, NONE))
    QApplication.sendEvent(window, QDragMoveEvent(place, COPY, data, LEFT, NONE))
    return place, data


def drop(window: MainWindow, *paths: Path, share: float) -> None:
    place, data = drag(window, *paths, share=share)
    QApplication.sendEvent(window, QDropEvent(QPointF(place), COPY, data, LEFT, NONE))


def areas(window: MainWindow) -> str:
    shown = window.findChild(QWidget, "drop_areas")
    assert isinstance(shown, QWidget)
    return shown.accessibleName() if shown.isVisible() else ""


def test_condensed_features_become_maps_and_labels(
    qtbot: QtBot, window: MainWindow, files: dict, tmp_path: Path
) -> None:
    drop(window, files["ball"], share=0.5)
    opened(qtbot, window, files["ball"])
    mesh = shapes.icosphere(2)
    labels = np.digitize(mesh.vertices[:, 2], [-0.3, 0.3])
    labels[mesh.vertices[:, 0] > 0.9] = -1
    features = aggregate_features(mesh.vertices, labels).rename(columns="hks_{}".format)
    write_condensed_features(tmp_path / "condensed.npz", features, labels)
    drop(window, tmp_path / "condensed.npz", share=0.5)
    document = window.document
    qtbot.waitUntil(lambda: document.labels.current is not None, timeout=PATIENCE)
    known = document.labels.current
    np.testing.assert_array_equal(known.values, labels + 1)
    assert [each.name for each in known.labels] == ["domain 0", "domain 1", "domain 2"]
    assert [each.name for each in document.mesh.maps] == ["hks_0", "hks_1", "hks_2", "domains"]
    values = document.mesh.map_named("hks_2").values
    assert len(np.unique(values[labels >= 0])) == 3
    document.history.undo()
    assert not document.mesh.maps


def opened(qtbot: QtBot, window: MainWindow, path: Path) -> None:
    qtbot.waitUntil(
        lambda: window.document.path == path and window.document.work.job is None, timeout=PATIENCE
    )


def test_a_drag_shows_what_a_drop_does(qtbot: QtBot, window: MainWindow, files: dict) -> None:
    drag(window, files["ball"], share=0.9)
    assert areas(window) == "Open\nball.npz", "there is nothing to compare with"
    QApplication.sendEvent(window, QDragLeaveEvent())
    assert areas(window) == ""
    drop(window, files["ball"], share=0.9)
    assert areas(window) == ""
    opened(qtbot, window, files["ball"])
    drag(window, files["other"], files["map"], share=0.2)
    with_map = "other.npz\nwith lh.depth.npy"
    assert areas(window) == f"Open\n{with_map}, Compare\nball\nwith {with_map}"
    drag(window, files["map"], share=0.2)
    assert areas(window) == "Add lh.depth.npy\nto ball"
    drag(window, files["session"], share=0.2)
    assert areas(window) == "Open the session\nwork.meshmash.json"
    QApplication.sendEvent(window, QDragLeaveEvent())


@pytest.mark.slow
def test_the_right_half_opens_the_second_mesh(
    qtbot: QtBot, window: MainWindow, files: dict
) -> None:
    drop(window, files["ball"], share=0.1)
    opened(qtbot, window, files["ball"])
    drop(window, files["other"], share=0.9)
    qtbot.waitUntil(
        lambda: window.opening.pair is not None and window.opening.pair.second.mesh is not None,
        timeout=PATIENCE,
    )
    assert window.document.path == files["ball"]
    drag(window, files["map"], share=0.9)
    assert areas(window) == "Add lh.depth.npy\nto ball, Add lh.depth.npy\nto other"
    drop(window, files["map"], share=0.9)
    second = window.opening.pair.second
    qtbot.waitUntil(lambda: len(second.mesh.maps) == 1, timeout=PATIENCE)
    assert not window.document.mesh.maps


def test_each_file_that_is_left_out_is_named(
    qtbot: QtBot, window: MainWindow, files: dict, tmp_path: Path
) -> None:
    bad = [tmp_path / name for name in ("one.npy", "two.csv", "three.npy", "four.csv")]
    for path in bad:
        path.write_text("depth\n1\n2\n")
        if path.suffix == ".npy":
            np.save(path, np.arange(7.0))

    def shown() -> str:
        return window.stage.message_bar.notice.text if window.stage.message_bar.notice else ""

    drop(window, *bad, share=0.5)
    assert "There is no mesh to put one.npy, two.csv, three.npy, four.csv on" in shown()
    broken, unread = tmp_path / "broken.ply", tmp_path / "unread.ply"
    for path in (broken, unread):
        path.write_text("ply\nnothing\n")
    drop(window, broken, files["map"], bad[0], share=0.5)
    text = "Not opened either: lh.depth.npy, one.npy."
    qtbot.waitUntil(lambda: text in shown(), timeout=PATIENCE)
    assert f"{broken} has a header without an end" in shown()
    drop(window, broken, files["ball"], files["map"], share=0.5)
    text = "Not opened either: ball.npz, lh.depth.npy."
    qtbot.waitUntil(lambda: text in shown(), timeout=PATIENCE)
    drop(window, files["ball"], files["other"], unread, share=0.2)
    qtbot.waitUntil(lambda: "Opening ball.npz without other.npz, unread.ply" in shown())
    opened(qtbot, window, files["ball"])
    drop(window, bad[0], files["map"], *bad[1:], share=0.5)
    qtbot.waitUntil(lambda: bool(window.document.mesh.maps), timeout=PATIENCE)
    qtbot.waitUntil(lambda: all(str(path) in shown() for path in bad), timeout=PATIENCE)
    assert [each.name for each in window.document.mesh.maps] == ["lh.depth.npy"]
    window.opening.store_session(files["session"])
    window.document.open_mesh(files["other"])
    opened(qtbot, window, files["other"])
    np.save(further := tmp_path / "further.npy", np.arange(162.0))
    drop(window, files["session"], further, unread, share=0.5)
    assert "Opening work.meshmash.json without unread.ply: open two meshes, or one" in shown()
    opened(qtbot, window, files["ball"])
    qtbot.waitUntil(lambda: len(window.document.mesh.maps) == 2, timeout=PATIENCE)
    assert {each.name for each in window.document.mesh.maps} == {"lh.depth.npy", "further.npy"}


@pytest.mark.slow
def test_two_meshes_are_compared_each_with_its_maps(
    qtbot: QtBot, window: MainWindow, files: dict, tmp_path: Path
) -> None:
    names = "lh.pial.npz", "rh.pial.npz", "lh.depth.npy", "rh.depth.npy"
    paths = [tmp_path / name for name in names]
    for path in paths:
        if path != files["map"]:
            shutil.copy(files["map" if path.suffix == ".npy" else "ball"], path)
    drag(window, *paths, share=0.2)
    assert areas(window) == "Open\nlh.pial.npz and rh.pial.npz\nwith 2 maps"
    drop(window, *paths, share=0.2)
    qtbot.waitUntil(lambda: window.opening.pair is not None, timeout=PATIENCE)
    documents = window.document, window.opening.pair.second
    for document, path, values in zip(documents, paths[:2], paths[2:], strict=True):
        qtbot.waitUntil(lambda at=document: bool(at.mesh and at.mesh.maps), timeout=PATIENCE)
        assert document.path == path
        assert [each.name for each in document.mesh.maps] == [values.name]
    drop(window, paths[3], share=0.2)
    qtbot.waitUntil(lambda: len(window.document.mesh.maps) == 2, timeout=PATIENCE)
    said = window.stage.message_bar.notice.text
    assert said.endswith("rh.depth.npy is of the other hemisphere than lh.pial: by its name.")


@pytest.mark.slow
def test_two_renders_have_one_height_and_are_no_smaller_than_compare(
    qtbot: QtBot, window: MainWindow, files: dict
) -> None:
    window.resize(900, 600)
    docks = {name: window.findChild(QDockWidget, f"{name}_dock") for name in ("pair", "field")}
    drop(window, files["ball"], share=0.1)
    opened(qtbot, window, files["ball"])
    drop(window, files["other"], share=0.9)
    qtbot.waitUntil(lambda: window.opening.second_view is not None, timeout=PATIENCE)
    first, second = window.opening.scenes
    qtbot.waitUntil(lambda: abs(first.width() - second.width()) <= 1, timeout=PATIENCE)
    assert first.height() == second.height()
    assert first.mapTo(window, QPoint()).y() == second.mapTo(window, QPoint()).y()
    label = window.findChild(QLabel, "first_label")
    assert label.isVisible()
    assert label.text().startswith("ball")
    state = window.findChild(QLabel, "second_label")
    qtbot.waitUntil(lambda: "press Compute" in state.text(), timeout=PATIENCE)
    state.grab()  # painted: a text that does not fit ends in dots and becomes the tooltip
    assert state.toolTip() == state.text()
    assert window.stage.width() >= 1.5 * docks["pair"].width()
    window.opening.end_comparison()
    qtbot.waitUntil(lambda: not label.isVisible(), timeout=PATIENCE)
    window.resize(1440, 900)
    qtbot.waitUntil(
        lambda: docks["field"].mapTo(window, QPoint()).x() > window.width() // 2, timeout=PATIENCE
    )


@pytest.mark.slow
def test_the_colours_leave_no_empty_room_where_the_rest_scrolls(
    qtbot: QtBot, window: MainWindow
) -> None:
    window.resize(900, 600)
    qtbot.wait(50)
    colors = window.field_panel.colors
    left = colors.height() - colors.low.geometry().bottom()
    assert left <= 16
    assert window.menus["Field"].menuAction().text() == "Fiel&d"


@pytest.mark.slow
def test_opening_brings_the_mesh_panel_to_the_front(
    qtbot: QtBot, window: MainWindow, files: dict
) -> None:
    docks = {name: window.findChild(QDockWidget, f"{name}_dock") for name in ("mesh", "shape")}
    docks["shape"].raise_()
    qtbot.waitUntil(lambda: docks["mesh"].visibleRegion().isEmpty(), timeout=PATIENCE)
    drop(window, files["ball"], share=0.1)
    opened(qtbot, window, files["ball"])
    qtbot.waitUntil(lambda: not docks["mesh"].visibleRegion().isEmpty(), timeout=PATIENCE)
    docks["shape"].raise_()
    qtbot.waitUntil(lambda: docks["mesh"].visibleRegion().isEmpty(), timeout=PATIENCE)
    window.document.set_unit("nm")
    QTest.qWait(50)
    assert docks["mesh"].visibleRegion().isEmpty()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["behind", "closed"])
def test_progress_and_cancel_are_in_the_status_bar_where_the_panel_is_hidden(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, how: str
) -> None:
    mesh, path = shapes.icosphere(5), tmp_path / "large.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    window.open_mesh(path)
    opened(qtbot, window, path)
    status = window.findChild(QWidget, "status_progress")
    window.document.solve.target = Target("count", 2000)
    button = window.findChild(QPushButton, "compute_button")
    qtbot.waitUntil(button.isEnabled, timeout=PATIENCE)
    QTest.mouseClick(button, LEFT)
    qtbot.waitUntil(lambda: window.document.work.job is not None, timeout=PATIENCE)
    assert not status.isVisible(), "the panel shows it"
    if how == "closed":
        window.findChild(QDockWidget, "mesh_dock").close()
    else:
        window.findChild(QDockWidget, "shape_dock").raise_()
    qtbot.waitUntil(status.isVisible, timeout=PATIENCE)
    QTest.mouseClick(window.findChild(QPushButton, "status_cancel_button"), LEFT)
    qtbot.waitUntil(lambda: window.document.work.job is None, timeout=PATIENCE)
    qtbot.waitUntil(lambda: not status.isVisible(), timeout=PATIENCE)
