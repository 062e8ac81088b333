"""Points on the render: opened, coloured, hovered, counted, stored, drawn in pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import numpy as np
import pandas
import pytest
import shapes
from closed_form import part
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog
from pytestqt.qtbot import QtBot

import meshmash_viewer as mv
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.app.view.figure import FigureOptions, compose_figure, seen_of
from meshmash_viewer.app.view.points import point_colors
from meshmash_viewer.features.points import Points, ProjectedPoints
from meshmash_viewer.model.document import Document

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
COPY = Qt.DropAction.CopyAction
PATIENCE = 60_000
BALL = shapes.icosphere(3, radius=4000.0)
AWAY = np.array([4e5, 8e5, 4e6])
#: Number of points, enough for some to face the default camera.
N = 300


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Files of a mesh far from the origin, of points in nm and in voxels, and of a map."""
    made = Settings.__init__

    def begin(settings: Settings, fresh: bool = False) -> None:
        made(settings, fresh)
        settings.close()
        settings.sessions = tmp_path / "sessions"
        settings._fresh = False

    monkeypatch.setattr(Settings, "__init__", begin)
    vertices = BALL.vertices + AWAY
    np.savez(tmp_path / "ball.npz", vertices=vertices, faces=BALL.faces, unit="nm")
    at = vertices[:N]
    table = pandas.DataFrame(
        {"id": 10**17 + np.arange(N), **dict(zip("xyz", at.T, strict=True)), "size": np.arange(N)}
    )
    table["type"] = np.where(BALL.vertices[:N, 0] > 0.0, "excitatory", "inhibitory")
    table.to_parquet(tmp_path / "synapses.parquet")
    table[["x", "y", "z"]] /= [4.0, 4.0, 40.0]
    table.to_csv(tmp_path / "voxels.csv", index=False)
    table.rename(columns={axis: f"pre_{axis}" for axis in "xyz"}).assign(
        **{f"post_{axis}": at[:, place] for place, axis in enumerate("xyz")}
    ).to_csv(tmp_path / "both.csv", index=False)
    whole = dict(zip("xyz", vertices.T, strict=True))
    pandas.DataFrame({**whole, "height": vertices[:, 2]}).to_csv(tmp_path / "map.csv", index=False)
    return tmp_path


@pytest.fixture
def opened(files: Path, reopen_window: Callable[..., MainWindow], qtbot: QtBot) -> MainWindow:
    return ball_in(reopen_window(), files, qtbot)


def ball_in(window: MainWindow, files: Path, qtbot: QtBot) -> MainWindow:
    document, path = window.document, files / "ball.npz"
    window.open_mesh(path, "nm")
    qtbot.waitUntil(lambda: document.path == path and document.work.job is None, timeout=PATIENCE)
    window.arrangement.docks["label"].raise_()
    rest(window, qtbot)
    return window


def rest(window: MainWindow, qtbot: QtBot) -> None:
    catch_up()
    window.wait(60.0)
    qtbot.waitUntil(lambda: window.scene.can_pick and window.scene.at_rest, timeout=PATIENCE)
    catch_up()


def drop(window: MainWindow, path: Path, qtbot: QtBot) -> None:
    data, place = QMimeData(), QPoint(200, 200)
    data.setUrls([QUrl.fromLocalFile(str(path))])
    QApplication.sendEvent(window, QDragEnterEvent(place, COPY, data, LEFT, NONE))
    QApplication.sendEvent(window, QDropEvent(QPointF(place), COPY, data, LEFT, NONE))
    rest(window, qtbot)


def said(window: MainWindow) -> str:
    notice = window.stage.message_bar.notice
    return "" if notice is None else notice.text.replace("\N{NO-BREAK SPACE}", " ")


def color_by(window: MainWindow, column: str, qtbot: QtBot) -> None:
    combo = part(window, "points_column_combo")
    combo.setFocus()
    combo.setCurrentIndex(combo.findData(column))
    combo.activated.emit(combo.currentIndex())
    rest(window, qtbot)


@pytest.mark.slow
def test_dropped_points_are_drawn_coloured_undone_and_removed(
    opened: MainWindow, files: Path, qtbot: QtBot
) -> None:
    window, scene = opened, opened.scene
    before = scene.picture((400, 300))
    drop(window, files / "synapses.parquet", qtbot)
    assert said(window) == "300 points in nm from synapses.parquet, 300 within 1.19 µm of a vertex."
    found = window.document.points.projected
    assert found is not None
    np.testing.assert_array_equal(found.vertices, np.arange(N))
    drawn = scene.picture((400, 300))
    assert (drawn != before).any(axis=2).mean() > 0.01
    assert part(window, "points_note").text() == (
        "300 points from synapses.parquet, 300 of them near the mesh."
    )
    color_by(window, "type", qtbot)
    colored = scene.picture((400, 300))
    legend = scene.renderer.points.legend
    assert [text for _, text in legend.rows] == ["excitatory", "inhibitory"] or len(
        legend.rows
    ) == 2
    assert (colored != drawn).any()
    color_by(window, "size", qtbot)
    legend = scene.renderer.points.legend
    assert (legend.graded, legend.title) == (True, "size")
    assert [text for _, text in legend.rows][::5] == ["299", "0"]
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    rest(window, qtbot)
    np.testing.assert_array_equal(scene.picture((400, 300)), colored)
    QTest.mouseClick(part(window, "points_remove_button"), LEFT)
    rest(window, qtbot)
    np.testing.assert_array_equal(scene.picture((400, 300)), before)
    window.document.history.undo()
    rest(window, qtbot)
    np.testing.assert_array_equal(scene.picture((400, 300)), colored)


@pytest.mark.slow
def test_hidden_parts_hide_their_points(opened: MainWindow, files: Path, qtbot: QtBot) -> None:
    drop(opened, files / "synapses.parquet", qtbot)
    document = opened.document
    document.hiding.set(np.arange(BALL.n_vertices) < N)
    rest(opened, qtbot)
    shown = opened.scene.picture((400, 300))
    document.points.set(None)
    rest(opened, qtbot)
    np.testing.assert_array_equal(opened.scene.picture((400, 300)), shown)


@pytest.mark.slow
def test_hovering_says_what_a_point_is_and_a_click_takes_its_vertex(
    opened: MainWindow, files: Path, qtbot: QtBot
) -> None:
    window, scene = opened, opened.scene
    drop(window, files / "synapses.parquet", qtbot)
    color_by(window, "type", qtbot)
    eye = scene.renderer.view.axes[2]
    vertex = int((BALL.vertices[:N] @ eye).argmax())
    place = scene.display_point(vertex)
    QTest.mouseMove(scene.plotter, place + QPoint(60, 60))
    QTest.mouseMove(scene.plotter, place)
    text = part(window, "hover_label").text
    qtbot.waitUntil(lambda: f"id {10**17 + vertex}, 0" in text(), timeout=5000)
    kind = "excitatory" if BALL.vertices[vertex, 0] > 0.0 else "inhibitory"
    assert f"type {kind}" in text()
    assert f"Vertex {vertex:,}" in text()
    QTest.mouseClick(scene.plotter, LEFT, pos=place)
    assert [pin.vertex for pin in window.document.pins.placed] == [vertex]


@pytest.mark.slow
def test_points_in_voxels_are_asked_about(opened: MainWindow, files: Path, qtbot: QtBot) -> None:
    drop(opened, files / "voxels.csv", qtbot)
    dialog = part(opened, "points_dialog")
    assert "300 of 300 points lie outside the box of the mesh" in dialog.labelText()
    assert dialog.textValue() == "4 × 4 × 40 nm"
    QTest.keyClick(dialog, Qt.Key.Key_Return)
    rest(opened, qtbot)
    assert said(opened).startswith("300 points in 4 × 4 × 40 nm from voxels.csv, 300 within")


@pytest.mark.slow
def test_several_positions_are_asked_about(
    opened: MainWindow, files: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = str(files / "both.csv"), ""
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: chosen)
    QTest.mouseClick(part(opened, "points_open_button"), LEFT)
    rest(opened, qtbot)
    dialog = part(opened, "points_dialog")
    assert dialog.comboBoxItems() == ["pre", "post"]
    dialog.setTextValue("post")
    dialog.accept()
    rest(opened, qtbot)
    assert said(opened).startswith("300 points in nm from both.csv")


@pytest.mark.slow
def test_a_table_for_each_vertex_is_a_map(opened: MainWindow, files: Path, qtbot: QtBot) -> None:
    drop(opened, files / "map.csv", qtbot)
    assert [each.name for each in opened.document.mesh.maps] == ["x", "y", "z", "height"]
    assert opened.document.points.shown is None


@pytest.mark.slow
def test_regions_count_the_points_in_a_thread(
    opened: MainWindow, files: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    document, threads, sums = opened.document, [], ProjectedPoints.sums

    def noted(found: ProjectedPoints, *given: Any) -> Any:
        threads.append(current_thread())
        return sums(found, *given)

    monkeypatch.setattr(ProjectedPoints, "sums", noted)
    drop(opened, files / "synapses.parquet", qtbot)
    document.labels.new_set()
    up = BALL.vertices[:, 2] > 500.0
    document.selection.set(up)
    document.labels.assign(1)
    rest(opened, qtbot)
    QTest.mouseClick(part(opened, "region_measure_button"), LEFT)
    wait_for_points(document, True, qtbot)
    table = document.labels.regions
    inside = (table.rows >= 0)[:N]
    assert table["points"].tolist() == [np.count_nonzero(inside)]
    assert table["sum size"].tolist() == [int(np.flatnonzero(inside).sum())]
    assert all(thread is not main_thread() for thread in threads)
    assert len(threads) == 1
    QTest.mouseClick(part(opened, "points_remove_button"), LEFT)
    wait_for_points(document, False, qtbot)
    document.history.undo()
    wait_for_points(document, True, qtbot)


def wait_for_points(document: Document, counted: bool, qtbot: QtBot) -> None:
    """Wait until the table of regions has columns of points, or has none."""

    def shown() -> bool:
        regions = document.labels.regions
        return regions is not None and ("points" in regions.columns) is counted

    qtbot.waitUntil(shown, timeout=PATIENCE)


@pytest.mark.slow
def test_points_are_there_again_and_follow_a_repair(
    files: Path, open_window: Callable[..., MainWindow], qtbot: QtBot
) -> None:
    first = ball_in(open_window(), files, qtbot)
    drop(first, files / "voxels.csv", qtbot)
    part(first, "points_dialog").accept()
    rest(first, qtbot)
    color_by(first, "type", qtbot)
    first.document.points.change("size of points", size=11)
    first.close()
    again = ball_in(open_window(), files, qtbot)
    qtbot.waitUntil(lambda: again.document.points.projected is not None, timeout=PATIENCE)
    shown = again.document.points.shown
    assert (shown.table.unit, shown.column, shown.size) == ("4 × 4 × 40 nm", "type", 11)
    assert "table of points" in said(again)
    np.testing.assert_array_equal(again.document.points.projected.vertices, np.arange(N))
    again.document.repair("orient_faces")
    qtbot.waitUntil(lambda: again.document.work.job is None, timeout=PATIENCE)
    rest(again, qtbot)
    found = again.document.points.projected
    assert found.mesh.vertices is again.document.mesh.vertices


@pytest.mark.slow
def test_pictures_have_the_points_and_their_legend(
    opened: MainWindow, files: Path, qtbot: QtBot
) -> None:
    drop(opened, files / "synapses.parquet", qtbot)
    color_by(opened, "type", qtbot)
    drawing = opened.scene.renderer.twin()
    panel = seen_of(drawing)
    assert panel.around.legend is not None
    figure = compose_figure([drawing], FigureOptions())
    texts = [each.get_text() for each in figure.texts]
    assert {"type", "excitatory", "inhibitory"} <= set(texts)


def test_a_hundred_thousand_points_are_coloured() -> None:
    rng = np.random.default_rng(0)
    places = rng.normal(size=(100_000, 3))
    places *= 4000.0 / np.linalg.norm(places, axis=1)[:, None]
    mesh = mv.Mesh(BALL.vertices, BALL.faces, "nm")
    table = Points(places, {"size": rng.uniform(size=100_000)})
    found = mv.project_points(mesh, table)
    colors, legend = point_colors(found, "size")
    assert colors.shape == (found.n_near, 3)
    assert legend is not None
