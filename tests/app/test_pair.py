"""A comparison of two meshes: opened, linked, matched, saved and closed in the window."""

from __future__ import annotations

import gc
import shutil
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from closed_form import turn_wheel
from PySide6.QtCore import QMimeData, QPoint, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent, QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QFileDialog,
    QInputDialog,
    QLabel,
    QLineEdit,
    QMenu,
    QPushButton,
    QScrollArea,
    QToolButton,
    QWidget,
)

import meshmash_viewer as mv
from meshmash_viewer.app import theme
from meshmash_viewer.app.dialogs.export_dialog import ExportDialog
from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
from meshmash_viewer.app.executor import is_idle, shutdown
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.plots.plot import MatrixView
from meshmash_viewer.app.run import application
from meshmash_viewer.app.second_view import SecondView
from meshmash_viewer.app.sessions import session_of
from meshmash_viewer.app.view.mesh_view import MeshView
from meshmash_viewer.app.view.picture import displayed_surface
from meshmash_viewer.features.comparison import Comparison, compare_shapes, unit_area_spectrum
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.io.session import unpacked_mask
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.model.field import Field, FieldRequest
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.model.matching import MATCHED_IN, ComparisonRequest
from meshmash_viewer.model.script import reproduction_script
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import format_share

LEFT, SHIFT = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.ShiftModifier
PAIRS = 40
FIRST = shapes.blob(3)
COPY, PLACE = shapes.moved_copy(FIRST)
#: FIRST deformed, with the same faces; STRANGE is a copy with permuted vertices.
OTHER = mv.Mesh(
    FIRST.vertices * [1.0, 1.1, 0.95] + 0.02 * np.sin(5.0 * FIRST.vertices), FIRST.faces
)
STRANGE, _ = shapes.moved_copy(OTHER)
#: OTHER with a duplicate face, a separate triangle, and a vertex on no face.
FAULTY = mv.Mesh(
    np.concatenate([OTHER.vertices, 3.0 + np.eye(3), [[9.0, 9.0, 9.0]]]),
    np.concatenate([OTHER.faces, OTHER.faces[:1], [np.arange(3) + OTHER.n_vertices]]),
)
#: A valid mesh, with fewer eigenpairs than are computed of FIRST.
TEN = mv.Mesh(
    shapes.icosphere(0).vertices[:10] * [1.0, 1.2, 1.5],
    [face for face in shapes.icosphere(0).faces if face.max() < 10],
)


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(10)
    catch_up()


def rest(window: MainWindow) -> None:
    QTest.qWait(5)
    window.wait(60.0)
    catch_up()


def part(window: MainWindow, kind: type, name: str) -> QWidget:
    (found,) = window.findChildren(kind, name)
    return found


def text(window: MainWindow, name: str) -> str:
    return part(window, QLabel, name).text()


def library(second: mv.Mesh) -> Comparison:
    """Compare the same meshes by the library."""
    first, other = (
        mv.solve(*mv.cotangent_laplacian(mesh, robust=True), PAIRS) for mesh in (FIRST, second)
    )
    top = float(unit_area_spectrum(first)[-1]) * (1.0 + 1e-9)
    matrices = mv.cotangent_laplacian(second, robust=True)
    other = mv.solve(*matrices, max_eigenvalue=top / second.area)
    bank = mv.wave_kernel_bank(unit_area_spectrum(first), 100)
    vertices = mv.corresponding_vertices(FIRST, second)
    return compare_shapes(first, other, bank, vertices=vertices)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("meshes")
    meshes = {"first": FIRST, "copy": COPY, "other": OTHER, "strange": STRANGE, "faulty": FAULTY}
    for name, mesh in {**meshes, "ten": TEN}.items():
        np.savez(folder / f"{name}.npz", vertices=mesh.vertices, faces=mesh.faces)
    (folder / "broken.ply").write_text("ply\nnothing")
    np.savez(folder / "small.npz", vertices=np.eye(3), faces=[[0, 1, 2]])
    np.save(folder / "height.npy", OTHER.vertices[:, 2])
    np.save(folder / "short.npy", np.arange(7.0))
    return folder


@pytest.fixture(scope="module")
def one_window(folder: Path, module_cache: Path) -> Iterator[MainWindow]:
    application()
    window = MainWindow(fresh=True)
    window.resize(1300, 850)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    window.open_mesh(folder / "first.npz")
    wait_for(lambda: window.document.mesh is not None)
    rest(window)
    window.document.solve.target = Target("count", PAIRS)
    QTest.mouseClick(window.mesh_panel.compute_button, LEFT)
    wait_for(lambda: bool(window.document.spectrum and window.document.spectrum.complete))
    rest(window)
    yield window
    window.close()
    window.deleteLater()


@pytest.fixture
def window(one_window: MainWindow) -> Iterator[MainWindow]:
    """A window without a second mesh."""
    assert not one_window.actions_["end_comparison"].isEnabled()
    one_window.activateWindow()  # an earlier test may have left a menu or a dialog active
    wait_for(one_window.isActiveWindow)
    yield one_window
    one_window.opening.end_comparison()
    one_window.document.pins.clear()
    one_window.document.display.kind = "eigenfunction"
    one_window.stage.message_bar.dismiss()
    rest(one_window)


def beside(window: MainWindow, path: Path, monkeypatch: pytest.MonkeyPatch) -> SecondView:
    """Open a second mesh by the command, and wait for the comparison."""
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(path), ""))
    window.actions_["compare_with"].trigger()
    assert window.opening.second_view is not None
    wait_for(lambda: window.opening.second_view.pair.comparison is not None)
    rest(window)
    return window.opening.second_view


@pytest.mark.slow
def test_a_failed_comparison_is_stated_in_the_panel(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> Comparison:
        raise mv.InputError("The meshes have too few eigenpairs.")

    monkeypatch.setattr(ComparisonRequest, "answered", failing)
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(folder / "other.npz"), ""))
    window.actions_["compare_with"].trigger()
    assert text(window, "pair_hint") == "The meshes are being compared …"
    wait_for(lambda: text(window, "pair_hint").startswith("The comparison failed"))
    assert "too few eigenpairs" in window.stage.message_bar.notice.text


@pytest.mark.slow
def test_the_colours_of_the_first_are_kept_on_the_second(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = beside(window, folder / "other.npz", monkeypatch).pair
    field = window.controller.field
    QTest.mouseClick(part(window, QPushButton, "pair_keep_button"), LEFT)
    rest(window)
    (kept,) = pair.second.mesh.maps
    np.testing.assert_array_equal(kept.values, field.values[pair.comparison.back.indices])
    assert kept.name.startswith(field.title)


@pytest.mark.slow
def test_the_close_button_of_the_second_follows_the_theme(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside(window, folder / "copy.npz", monkeypatch)
    names = ("second_close_button", "mesh_dock_close")
    buttons = [part(window, QToolButton, name) for name in names]
    seen = []
    for mode in (theme.Mode.DARK, theme.Mode.LIGHT):
        theme.set_mode(mode)
        icon, of_dock = (button.icon().pixmap(12).toImage() for button in buttons)
        assert icon == of_dock
        seen.append(icon)
    assert seen[0] != seen[1]
    theme.set_mode(theme.Mode.SYSTEM)


@pytest.mark.slow
@pytest.mark.pixels
def test_both_meshes_are_in_a_picture_and_in_a_copy(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    window.actions_["copy_picture"].trigger()
    wait_for(lambda: window.background_io.idle)
    scenes = window.scene, opened.scene
    wide = sum(scene.plotter.pixels()[0] for scene in scenes)
    assert QGuiApplication.clipboard().image().width() == wide
    window.actions_["save_picture"].trigger()
    dialog = window.findChild(FigureDialog)
    wait_for(lambda: len(dialog.panels) == 2 and is_idle(dialog))
    dialog.file_row.edit.setText(str(tmp_path / "both.svg"))
    QTest.mouseClick(dialog.accept_button, LEFT)
    wait_for((tmp_path / "both.svg").exists)
    svg = (tmp_path / "both.svg").read_text(encoding="utf-8")
    assert svg.count("<image") == 2
    assert svg.count(">Eigenfunction ") == 2


@pytest.mark.parametrize(
    ("name", "mesh"),
    [("other", OTHER), pytest.param("strange", STRANGE, marks=pytest.mark.slow)],
)
def test_figures_are_the_librarys(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, mesh: mv.Mesh
) -> None:
    opened, wanted = beside(window, folder / f"{name}.npz", monkeypatch), library(mesh)
    found = opened.pair.comparison
    np.testing.assert_allclose(found.spectra, wanted.spectra, rtol=1e-6)
    assert found.distance == pytest.approx(wanted.distance, rel=1e-6)
    np.testing.assert_array_equal(found.forth.indices, wanted.forth.indices)
    np.testing.assert_allclose(found.forth.scores, wanted.forth.scores, rtol=1e-6, atol=1e-9)
    assert text(window, "pair_distance_label").startswith(
        f"{wanted.distance:.4g}: norm of the difference"
    )
    missing = int((~wanted.functions.determined).sum())
    assert text(window, "pair_functions_label") == (
        f"{missing} of {len(wanted.functions.indices)} cannot be matched"
        if missing
        else f"all {len(wanted.functions.indices)} are matched"
    )
    np.testing.assert_array_equal(found.functions.indices, wanted.functions.indices)
    told = text(window, "pair_match_label")
    if name == "other":
        assert told == "by index: same faces"
        assert found.functions.determined[:10].all()
    else:
        assert told == f"by features, {format_share(wanted.mutual_share)} mutual"
    assert "complete" in text(window, "second_label")


def bars(window: MainWindow, opened: SecondView) -> list[tuple[float, float]]:
    """Return the limits of both colour bars."""
    scenes = (window.scene, opened.scene)
    return [tuple(displayed_surface(scene.renderer).user_dict["limits"]) for scene in scenes]


@pytest.mark.slow
def test_both_colour_bars_say_the_same_numbers(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    display = window.document.display
    display.change(Eigenfunctions, index=2)
    pairs = [mv.solve(*mv.cotangent_laplacian(each, robust=True), PAIRS) for each in (FIRST, OTHER)]
    scale = np.sqrt(OTHER.area / FIRST.area)
    combo = part(window, QComboBox, "limits_combo")
    for step in range(3):
        QTest.keyClick(window, Qt.Key.Key_Right)
        rest(window)
        index = display[Eigenfunctions].index
        assert index == 3 + step
        there = opened.document.display[Eigenfunctions].index
        largest = max(
            np.abs(pairs[0].eigenvectors[:, index]).max(),
            scale * np.abs(pairs[1].eigenvectors[:, there]).max(),
        )
        for bar in bars(window, opened):
            np.testing.assert_allclose(bar, (-largest, largest), rtol=1e-6)
    # choose another policy by keys
    combo.setFocus()
    QTest.keyClick(combo, Qt.Key.Key_Down)
    QTest.keyClick(combo, Qt.Key.Key_Down)
    rest(window)
    assert combo.currentText() == "Minimum to maximum"
    both = bars(window, opened)
    assert both[0] == both[1]
    assert both[0][0] != -both[0][1]
    field = part(window, QWidget, "limit_low_field")
    assert field.value == pytest.approx(both[0][0], rel=1e-6)
    own = window.controller.field.colors(display)[0][:2]
    QTest.mouseClick(part(window, QCheckBox, "pair_link_colors"), LEFT, pos=QPoint(8, 8))
    rest(window)
    assert bars(window, opened)[0] == pytest.approx(own)
    assert bars(window, opened)[0] != bars(window, opened)[1]
    QTest.mouseClick(part(window, QCheckBox, "pair_link_colors"), LEFT, pos=QPoint(8, 8))
    rest(window)
    np.testing.assert_allclose(bars(window, opened), both, rtol=1e-6)
    window.opening.end_comparison()
    rest(window)
    assert tuple(window.to_pyvista().user_dict["limits"]) == pytest.approx(own)
    display.set_limits(None)


@pytest.mark.slow
def test_both_are_drawn_once_a_step(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    window.document.display.change(Eigenfunctions, index=2)
    rest(window)
    for controller in (window.controller, opened.controller):
        monkeypatch.setattr(controller._patience, "start", lambda: None)  # no field is late
    drawn: list[tuple[str, str]] = []
    draw = MeshView.set_field

    def noted(scene: MeshView, field: Field, *others: Any) -> None:
        drawn.append((scene.objectName(), field.title))
        draw(scene, field, *others)

    monkeypatch.setattr(MeshView, "set_field", noted)
    for index in (5, 6, 7):
        drawn.clear()
        window.document.display.change(Eigenfunctions, index=index)
        rest(window)
        there = f"Eigenfunction {opened.document.display[Eigenfunctions].index}"
        assert sorted(drawn) == [
            ("scene", f"Eigenfunction {index}"), ("second_scene", there)
        ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("late", ["first", "second"])
@pytest.mark.parametrize("fails", [False, True])
def test_a_field_does_not_wait_for_one_that_takes_long_or_fails(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch, late: str, fails: bool
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    window.document.display.change(Eigenfunctions, index=2)
    rest(window)
    source, document, scene = window.controller, opened.document, opened.scene
    if late == "second":
        source, document, scene = opened.controller, window.document, window.scene
    compute, go_on = source.live.compute, threading.Event()

    def slow(request: FieldRequest) -> Any:
        if fails:
            time.sleep(0.05)
            raise mv.InputError("No.")
        go_on.wait(60.0)
        return compute(request)

    monkeypatch.setattr(source.live, "compute", slow)
    window.document.display.change(Eigenfunctions, index=9)
    title = f"Eigenfunction {document.display[Eigenfunctions].index}"
    wait_for(lambda: displayed_surface(scene.renderer).active_scalars_name == title)
    assert source.comes
    go_on.set()
    monkeypatch.undo()
    window.document.display.change(Eigenfunctions, index=3)
    rest(window)
    assert not source.comes


@pytest.mark.slow
def test_a_copy_shows_the_same_and_is_looked_at_alike(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "copy.npz", monkeypatch)
    window.document.display.change(Eigenfunctions, index=3)
    QTest.keyClick(window, Qt.Key.Key_Right)
    rest(window)
    mine, other = window.controller.field, opened.controller.field
    assert mine.family.index == 4
    assert np.corrcoef(mine.values, other.values[PLACE])[0, 1] > 0.999
    assert "4 is 4" in text(window, "pair_function_label")
    QTest.keyClick(window, Qt.Key.Key_2)
    rest(window)
    mine, other = window.controller.field, opened.controller.field
    assert other.family.name == "hks"
    np.testing.assert_allclose(other.values[PLACE] * 2.5**2, mine.values, rtol=1e-3)
    drawn = displayed_surface(opened.scene.renderer).active_scalars
    np.testing.assert_allclose(drawn[PLACE], mine.values, rtol=1e-3)
    np.testing.assert_allclose(*bars(window, opened), rtol=1e-6)
    # a drag in one view turns the other view too
    canvas = window.scene.plotter
    before = np.array(opened.scene.camera()["axes"])
    QTest.mousePress(canvas, LEFT, pos=QPoint(60, 60))
    for step in range(1, 5):
        QTest.mouseMove(canvas, QPoint(60 + 20 * step, 60))
    QTest.mouseRelease(canvas, LEFT, pos=QPoint(140, 60))
    catch_up()
    after = np.array(opened.scene.camera()["axes"])
    assert not np.allclose(before, after)
    np.testing.assert_allclose(after, window.scene.camera()["axes"])
    QTest.mouseClick(part(window, QPushButton, "pair_link_free"), LEFT)
    QTest.keyClick(window, Qt.Key.Key_R)
    catch_up()
    np.testing.assert_allclose(opened.scene.camera()["axes"], after)


@pytest.mark.slow
def test_hemispheres_are_seen_from_the_same_side_of_the_brain(
    qapp: QApplication, tmp_path: Path
) -> None:
    points, faces = shapes.icosphere(2)
    paths = [tmp_path / f"{side}.surf.gii" for side in ("one", "other")]
    for path, side in zip(paths, (-1.0, 1.0), strict=True):
        vertices = [30.0, 70.0, 50.0] * points + [side * 40.0, 0.0, 0.0]
        structure = "CortexLeft" if side < 0.0 else "CortexRight"
        write_mesh(path, mv.Mesh(vertices, faces, unit="mm", structure=structure))
    window = MainWindow(fresh=True)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    window.open_mesh(paths[0])
    wait_for(lambda: window.scene is not None and window.scene.mesh is not None)
    QTest.keyClick(window, Qt.Key.Key_9)
    wait_for(lambda: window.controller.field is not None)
    QTest.keyClick(window, Qt.Key.Key_X)
    catch_up()
    whole = window.scene.camera()
    window.opening.open_second(paths[1])
    second = window.opening.second_view
    wait_for(lambda: second.scene.mesh is not None)
    rest(window)
    assert second.pair.cameras == "mirror"
    # the camera keeps its side, and zooms out to fit half of the width
    assert window.scene.camera()["axes"] == whole["axes"]
    assert window.scene.camera()["half_size"] > 1.2 * whole["half_size"]
    # a new unit redraws the second mesh and moves no camera
    cameras = [scene.camera()["focus"] for scene in window.opening.scenes]
    second.document.set_unit("µm")
    rest(window)
    assert [scene.camera()["focus"] for scene in window.opening.scenes] == cameras
    second.document.set_unit("mm")
    QTest.keyClick(window, Qt.Key.Key_1)  # without a field, no colour bar takes room
    wait_for(lambda: all(scene.renderer.caption is None for scene in window.opening.scenes))
    rest(window)
    assert window.actions_["view_lateral"].text() == "Lateral"

    def looks() -> list[list[list[float]]]:
        catch_up()
        return [scene.camera()["axes"] for scene in window.opening.scenes]

    # the left mesh is seen along +x, the right mesh along -x, both with z up
    QTest.keyClick(window, Qt.Key.Key_X)
    expected = [[0, -1, 0], [0, 0, 1], [-1, 0, 0]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    np.testing.assert_array_equal(looks(), expected)
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ShiftModifier)
    np.testing.assert_array_equal(looks()[0], [[-1, 0, 0], [0, 1, 0], [0, 0, -1]])
    # drags in the second view turn and move the camera of the first as a mirror image
    canvas = second.scene.plotter
    for button in (LEFT, Qt.MouseButton.RightButton):
        QTest.mousePress(canvas, button, pos=QPoint(60, 60))
        QTest.mouseMove(canvas, QPoint(90, 75))
        QTest.mouseRelease(canvas, button, pos=QPoint(90, 75))
    one, other = looks()
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(one, other * flip * flip[:, np.newaxis], atol=1e-12)
    focus = [np.array(scene.camera()["focus"]) for scene in window.opening.scenes]
    np.testing.assert_allclose(focus[0], focus[1] * flip, atol=1e-9)
    # cameras linked, then free
    QTest.mouseClick(part(window, QPushButton, "pair_link_camera"), LEFT)
    one, other = looks()
    np.testing.assert_allclose(one, other)
    QTest.mouseClick(part(window, QPushButton, "pair_link_free"), LEFT)
    QTest.keyClick(window, Qt.Key.Key_Y)
    assert looks()[0] != one
    assert looks()[1] == other
    # a session restores the choice of cameras
    path = tmp_path / "both.meshmash.json"
    window.opening.store_session(path)
    window.opening.end_comparison()
    window.opening.restore_session(path)
    wait_for(lambda: window.opening.second_view is not None)
    rest(window)
    assert window.opening.second_view.pair.cameras == "free"
    window.close()
    window.deleteLater()


@pytest.mark.slow
def test_a_right_click_on_the_second_pins_and_names_a_vertex(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = beside(window, folder / "copy.npz", monkeypatch)
    wait_for(lambda: second.scene.can_pick)
    at, canvas = second.scene.rect().center(), second.scene.plotter
    QTest.mouseClick(canvas, LEFT, pos=at)
    assert len(second.document.pins.placed) == 1
    QTest.mouseDClick(canvas, LEFT, pos=at)  # the second press centres both views and unpins
    QTest.mouseRelease(canvas, LEFT, pos=at)
    assert second.document.pins.placed == ()
    window.document.pins.toggle(3)
    assert window.document.history.redo_label == ""

    def choose(name: str) -> None:
        QTest.mouseClick(second.scene.plotter, Qt.MouseButton.RightButton, pos=at)
        wait_for(lambda: isinstance(QApplication.activePopupWidget(), QMenu))
        menu = QApplication.activePopupWidget()
        entry = next(each for each in menu.actions() if each.objectName() == f"menu_{name}")
        QTest.mouseClick(menu, LEFT, pos=menu.actionGeometry(entry).center())
        wait_for(lambda: QApplication.activePopupWidget() is None)

    vertex = second.scene.vertex_at(at.x(), at.y())
    choose("pin")
    assert [pin.vertex for pin in second.document.pins.placed] == [vertex]
    choose("rename")
    wait_for(lambda: bool(window.findChildren(QInputDialog)))
    (dialog,) = window.findChildren(QInputDialog)
    QTest.keyClicks(dialog.findChild(QLineEdit), "soma")
    QTest.keyClick(dialog.findChild(QLineEdit), Qt.Key.Key_Return)
    for document in (window.document, second.document):
        assert [pin.name for pin in document.pins.placed] == ["soma"]
    choose("copy_index")
    assert QGuiApplication.clipboard().text() == str(vertex)
    choose("unpin")
    assert second.document.pins.placed == ()


@pytest.mark.slow
def test_both_are_cut_and_the_handle_of_either_is_dragged(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = beside(window, folder / "copy.npz", monkeypatch)
    QTest.keyClick(window, Qt.Key.Key_Z)
    window.actions_["cut_x"].trigger()
    rest(window)
    scenes, other = window.opening.scenes, second.scene

    def planes() -> list[tuple[list[float], float]]:
        catch_up()
        cuts = [scene.renderer.cut for scene in scenes]
        return [(cut.normal.tolist(), cut.level) for cut in cuts if cut is not None]

    before = planes()
    middle = COPY.bounds.mean(axis=0)
    assert [normal for normal, _ in before] == [[1.0, 0.0, 0.0]] * 2
    assert before[1][1] == pytest.approx(middle[0])
    faces = displayed_surface(other.renderer).regular_faces
    assert 0.3 < len(faces) / COPY.n_faces < 0.6
    assert COPY.vertices[faces, 0].min() >= middle[0]
    size = other.renderer.renderer.GetSize()
    assert other.renderer.view is not None
    x, up = other.renderer.view.to_pixels(middle, *size)[0, :2]
    ball = QPoint(round(x), round(size[1] - up))
    QTest.mousePress(other.plotter, LEFT, pos=ball)
    QTest.mouseMove(other.plotter, ball + QPoint(20, 0))
    QTest.mouseRelease(other.plotter, LEFT, pos=ball + QPoint(20, 0))
    moved = [after - level for (_, after), (_, level) in zip(planes(), before, strict=True)]
    assert min(moved) > 0.0
    extents = [np.linalg.norm(np.ptp(mesh.bounds, axis=0)) for mesh in (FIRST, COPY)]
    np.testing.assert_allclose(moved[0] / moved[1], extents[0] / extents[1])
    window.actions_["undo"].trigger()
    assert planes() == before
    QTest.mouseClick(part(window, QPushButton, "pair_link_mirror"), LEFT)
    assert [normal for normal, _ in planes()] == [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    window.actions_["cut"].trigger()
    assert planes() == []


@pytest.mark.slow
def test_a_stroke_on_the_second_says_that_the_first_is_selected_on(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = beside(window, folder / "copy.npz", monkeypatch)
    wait_for(lambda: second.scene.can_pick)
    window.actions_["select"].trigger()
    window.wait(60.0)  # the mesh is fitted again, as the tool bar takes room
    camera, at = second.scene.camera(), second.scene.rect().center()
    QTest.mousePress(second.scene.plotter, LEFT, pos=at)
    QTest.mouseMove(second.scene.plotter, at + QPoint(40, 0))
    QTest.mouseRelease(second.scene.plotter, LEFT, pos=at + QPoint(40, 0))
    notice = window.stage.message_bar.notice
    assert notice is not None
    assert notice.text.startswith("Vertices are selected on the first mesh")
    assert second.scene.camera() == camera
    assert second.document.pins.placed == ()
    window.actions_["select"].trigger()
    QTest.mouseClick(second.scene.plotter, LEFT, pos=at)
    assert len(second.document.pins.placed) == 1


@pytest.mark.slow
def test_maps_are_carried_by_a_functional_map_and_exported_of_the_second(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, first = beside(window, folder / "copy.npz", monkeypatch), window.document
    matrix = part(window, MatrixView, "pair_matrix_plot")
    assert not matrix.isVisible()
    height = FIRST.vertices[:, 2]
    parts = (mv.Label(1, "upper", "#aa0000"), mv.Label(2, "lower", "#00aa00"))
    halves = mv.VertexMap("halves", np.where(height > 0.0, 1, 2), parts)
    given = [each.name for each in opened.document.mesh.maps]
    first.maps.add(first.mesh, [mv.VertexMap("height", height, unit="mm"), halves])
    rest(window)
    carry = part(window, QPushButton, "carry_to_second_button")
    QTest.mouseClick(carry, LEFT)
    rest(window)
    QTest.mouseClick(part(window, QCheckBox, "pair_refine_check"), LEFT, pos=QPoint(8, 8))
    catch_up()
    assert not carry.isEnabled()  # the refined match is not computed yet
    wait_for(lambda: opened.pair.comparison.functional is not None)
    rest(window)
    found, mesh = opened.pair.comparison, opened.document.mesh
    np.testing.assert_array_equal(matrix.matrix, found.functional.matrix)
    whole = matrix.viewRange()
    turn_wheel(matrix.viewport(), 3)
    assert matrix.viewRange() == whole  # the wheel scrolls the panel
    assert not matrix.isHidden()
    before = [each.name for each in mesh.maps]
    QTest.mouseClick(carry, LEFT)  # carry again, by the functional map
    rest(window)
    score, carried, labels = opened.document.mesh.maps[len(given) :]
    np.testing.assert_array_equal(score.values, found.back.scores)
    np.testing.assert_array_equal(carried.values, height[found.back.indices])
    np.testing.assert_array_equal(labels.values, halves.values[found.back.indices])
    assert (carried.name, carried.unit, labels.labels) == ("height", "mm", parts)
    assert opened.controller.field.title == window.controller.field.title == "halves"
    QTest.mouseClick(part(window, QPushButton, "carry_to_first_button"), LEFT)
    assert "has no map that first" in window.stage.message_bar.notice.text
    QTest.mouseClick(part(window, QPushButton, "second_export_button"), LEFT)
    dialog = window.findChild(ExportDialog)
    dialog.file_row.edit.setText(str(tmp_path / "halves.csv"))
    QTest.mouseClick(dialog.accept_button, LEFT)
    wait_for((tmp_path / "halves.csv").exists)
    rest(window)
    (written,) = (m for m in mv.read_maps(tmp_path / "halves.csv", mesh) if m.name == "halves")
    np.testing.assert_array_equal(written.values, labels.values)
    assert written.labels == parts
    window.stage.setFocus()
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert [each.name for each in opened.document.mesh.maps] == before
    for name in ("height", "halves"):
        first.maps.remove(name)


@pytest.mark.slow
def test_own_maps_show_the_carried_map_on_both_under_its_new_name(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, first = beside(window, folder / "copy.npz", monkeypatch), window.document
    x, y, _ = FIRST.vertices.T
    first.maps.add(first.mesh, [mv.VertexMap("x", x), mv.VertexMap("y", y)])
    first.maps.show("x")
    first.display.kind = "eigenfunction"
    rest(window)
    QTest.mouseClick(part(window, QPushButton, "carry_to_second_button"), LEFT)
    rest(window)

    def titles() -> list[str]:
        return [each.field.title for each in (window.controller, opened.controller)]

    assert titles() == ["x", "x"]
    first.display.set_limits(LockedLimits(-0.5, 0.5))
    first.maps.rename("x", "across")
    rest(window)
    assert titles() == ["across", "across"]
    assert [each.name for each in opened.document.mesh.maps][-2:] == ["y", "across"]
    assert opened.document.display.limits == LockedLimits(-0.5, 0.5)
    assert "map:x" not in opened.document.display.policies
    for key, expected in ((Qt.KeyboardModifier.NoModifier, "x"), (SHIFT, "across")):
        window.stage.setFocus()
        QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | key)
        rest(window)
        assert opened.document.mesh.maps[-1].name == expected
        assert first.mesh.maps[-2].name == expected
        assert titles()[1] == titles()[0]
    for name in ("across", "y"):
        first.maps.remove(name)


@pytest.mark.slow
def test_a_map_of_the_second_follows_the_name_of_its_copy_on_the_first_and_its_labels_are_saved(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = shutil.copy(folder / "copy.npz", tmp_path / "own.npz")  # without labels of other tests
    opened, first = beside(window, own, monkeypatch), window.document
    second, count = opened.document, len(first.mesh.maps)
    save = part(window, QPushButton, "second_save_labels_button")
    assert not save.isEnabled()
    above = (FIRST.vertices[:, 2] > 0).astype(int)
    halves = mv.VertexMap("halves", above, (mv.Label(1, "north", "#4477aa"),))
    second.maps.add(second.mesh, [halves, mv.VertexMap("z", FIRST.vertices[:, 2])])
    second.maps.show("z")
    rest(window)
    path = tmp_path / "second.annot"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    QTest.mouseClick(save, LEFT)
    wait_for(path.exists)
    rest(window)
    assert [label.name for label in mv.read_labels(path, second.mesh).labels] == ["north"]
    QTest.mouseClick(part(window, QPushButton, "carry_to_first_button"), LEFT)
    rest(window)
    first.maps.rename("z", "height")
    rest(window)
    assert [each.field.title for each in (window.controller, opened.controller)] == ["height"] * 2
    assert "height" in [each.name for each in second.mesh.maps]
    window.stage.setFocus()
    QTest.keyClick(window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    rest(window)
    for document in (first, second):
        assert "z" in [each.name for each in document.mesh.maps]
    for each in first.mesh.maps[count:]:
        first.maps.remove(each.name)


@pytest.mark.slow
def test_what_is_made_on_the_second_is_undone_and_redone_in_its_place(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = beside(window, folder / "other.npz", monkeypatch)
    wait_for(lambda: second.scene.can_pick)
    at, canvas = second.scene.rect().center(), second.scene.plotter
    QTest.mouseClick(canvas, LEFT, pos=at)
    (clicked,) = second.document.pins.placed
    assert clicked.vertex == second.scene.vertex_at(at.x(), at.y())
    rest(window)
    at = second.scene.display_point(clicked.vertex)
    QTest.mousePress(canvas, LEFT, pos=at)
    for step in (10, 20, 30):
        QTest.mouseMove(canvas, at + QPoint(step, step // 2))
        QTest.qWait(20)
    QTest.mouseRelease(canvas, LEFT, pos=at + QPoint(30, 15))
    (dragged,) = second.document.pins.placed
    assert dragged.vertex != clicked.vertex
    before = len(second.document.mesh.maps)
    QTest.mouseClick(part(window, QPushButton, "pair_keep_button"), LEFT)
    rest(window)

    def state() -> tuple[object, ...]:
        mesh, pins = second.document.mesh, second.document.pins.placed
        return len(mesh.maps) - before, [pin.vertex for pin in pins]

    states = [(1, [dragged.vertex]), (0, [dragged.vertex]), (0, [clicked.vertex]), (0, [])]
    assert state() == states[0]
    assert window.actions_["undo"].text() == "Undo new map of the second mesh"
    window.stage.setFocus()
    control = Qt.KeyboardModifier.ControlModifier
    for expected in states[1:]:
        QTest.keyClick(window, Qt.Key.Key_Z, control)
        assert state() == expected
        catch_up()
    for expected in reversed(states[:-1]):
        QTest.keyClick(window, Qt.Key.Key_Z, control | Qt.KeyboardModifier.ShiftModifier)
        assert state() == expected
        catch_up()
    window.opening.end_comparison()
    left = [part for step in window.document.history.past for part in step.state]
    assert left
    assert not any(part.startswith("second/") for part in left)


def test_a_pin_has_its_match_and_colours_are_carried(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "copy.npz", monkeypatch)
    window.document.pins.toggle(100)
    catch_up()
    assert text(window, "pair_best_label").startswith(f"vertex {PLACE[100]:,} ")
    assert text(window, "pair_next_label").count("vertex") == 3
    assert "of its WKS from that of pin 1" in text(window, "pair_match_note")
    combo = part(window, QComboBox, "pair_feature_combo")
    combo.setFocus()
    QTest.keyClick(combo, Qt.Key.Key_Up)
    wait_for(lambda: opened.pair.matched_in != "wks" and opened.pair.comparison is not None)
    rest(window)
    assert text(window, "pair_best_label").startswith(f"vertex {PLACE[100]:,} ")
    refine = part(window, QCheckBox, "pair_refine_check")
    QTest.mouseClick(refine, LEFT, pos=QPoint(8, 8))
    wait_for(lambda: opened.pair.comparison is not None)
    rest(window)
    assert text(window, "pair_match_label") == "as a moved copy, 100\N{NO-BREAK SPACE}% mutual"
    assert text(window, "pair_best_label").startswith(f"vertex {PLACE[100]:,} ")
    assert "the one by ZoomOut; the next are the nearest by" in text(window, "pair_match_note")
    check = part(window, QCheckBox, "pair_carry_check")
    QTest.mouseClick(check, LEFT, pos=QPoint(8, 8))
    catch_up()
    surface = displayed_surface(opened.scene.renderer)
    mine = window.controller.field.values
    np.testing.assert_allclose(surface.active_scalars[PLACE], mine, rtol=1e-6)


def test_the_match_is_saved(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "copy.npz", monkeypatch)
    path = tmp_path / "match.npz"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    QTest.mouseClick(part(window, QPushButton, "pair_save_button"), LEFT)
    wait_for(path.exists)
    bar = window.stage.message_bar
    wait_for(lambda: bar.notice is not None and str(path) in bar.notice.text)
    with np.load(path) as file:
        np.testing.assert_array_equal(file["features"][:, 0], opened.pair.comparison.forth.indices)


@pytest.mark.slow
def test_the_second_is_computed_on_a_mask_of_its_own(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = beside(window, folder / "other.npz", monkeypatch).pair
    second = pair.second
    button = part(window, QPushButton, "second_mask_button")
    inside = second.mesh.vertices[:, 2] > -0.3
    QTest.mouseClick(button, LEFT)
    assert "Display a map of the second mesh first" in window.stage.message_bar.notice.text
    second.maps.add(second.mesh, [mv.VertexMap("inside", inside.astype(float))])
    second.maps.show("inside")
    QTest.mouseClick(button, LEFT)
    wait_for(lambda: second.part_mesh is not None and second.spectrum is not None)
    rest(window)
    expected = second.mesh.masked(inside).referenced
    np.testing.assert_array_equal(second.part_mesh.referenced, expected)
    assert window.document.part_mesh is None, "the mask is of the second mesh only"
    wait_for(lambda: not pair.comparing and pair.comparison is not None)
    stored = session_of(window.document, {}, pair)
    np.testing.assert_array_equal(unpacked_mask(stored.second.part, len(inside)), expected)
    assert stored.part == ""
    window.actions_["undo"].trigger()
    wait_for(lambda: second.part_mesh is None)
    window.actions_["redo"].trigger()
    wait_for(lambda: second.part_mesh is not None)
    rest(window)
    QTest.mouseClick(button, LEFT)
    wait_for(lambda: second.part_mesh is None)


def drop(window: MainWindow, *paths: Path, share: float = 0.75) -> None:
    """Drop files on the views, at a share of their width from the left."""
    stage = window.stage
    place = stage.mapTo(window, QPoint(round(share * stage.width()), stage.height() // 2))
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    copy, none = Qt.DropAction.CopyAction, Qt.KeyboardModifier.NoModifier
    window.dropEvent(QDropEvent(QPointF(place), copy, data, LEFT, none))


def test_a_mesh_dropped_on_the_right_half_is_the_second(window: MainWindow, folder: Path) -> None:
    drop(window, folder / "other.npz")
    wait_for(lambda: window.opening.second_view is not None)
    wait_for(lambda: window.opening.second_view.pair.comparison is not None)
    assert window.document.path == folder / "first.npz"
    QTest.mouseClick(part(window, QPushButton, "pair_close_button"), LEFT)
    assert window.opening.second_view is None
    rest(window)
    assert window.document.mesh is not None


@pytest.mark.slow
def test_the_unit_of_the_second_is_given_where_it_is_said_that_it_has_none(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, bar = beside(window, folder / "copy.npz", monkeypatch), window.stage.message_bar
    window.document.set_unit("nm")
    catch_up()
    assert "in nm and no unit" in text(window, "pair_remark")
    combo = part(window, QComboBox, "second_unit_combo")
    turn_wheel(combo, 1)
    assert combo.currentText() == "none", "without the focus, the wheel scrolls the panel"
    edit = combo.lineEdit()
    edit.setFocus()
    edit.selectAll()
    QTest.keyClicks(edit, "frog")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert bar.notice.text.startswith("Second mesh: ")
    edit.setFocus()
    edit.selectAll()
    QTest.keyClicks(edit, "nm")
    assert bar.notice is None, "another text is typed"
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert opened.document.unit == "nm"
    rest(window)
    assert text(window, "pair_remark") == ""
    window.document.set_unit("none")


@pytest.mark.slow
def test_the_second_is_repaired_by_a_click_which_can_be_undone(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "faulty.npz", monkeypatch)
    document = opened.document
    assert "2 components" in text(window, "pair_remark")
    assert part(window, QPushButton, "pair_keep_largest_button").isVisible()
    assert text(window, "second_health_duplicate_faces") == "1"
    button = part(window, QPushButton, "second_keep_largest_component")
    assert button.accessibleName().endswith("of the second mesh")
    button.setFocus()
    QTest.keyClick(button, Qt.Key.Key_Space)
    wait_for(lambda: document.repairs == ("keep_largest_component",))
    rest(window)
    assert document.mesh.n_components == 1
    assert "component" not in text(window, "pair_remark")
    assert window.document.repairs == ()
    wanted = library(document.mesh)
    assert opened.pair.comparison.distance == pytest.approx(wanted.distance, rel=1e-6)
    # a session restores the repair and the map
    drop(window, folder / "height.npy")
    wait_for(lambda: bool(document.mesh.maps))
    path = tmp_path / "repaired.meshmash.json"
    window.opening.store_session(path)
    window.opening.end_comparison()
    window.opening.restore_session(path)
    wait_for(lambda: window.opening.second_view is not None)
    wait_for(lambda: bool(window.opening.second_view.document.repairs))
    rest(window)
    document = window.opening.second_view.document
    assert [each.name for each in document.mesh.maps] == ["height.npy"]
    script = reproduction_script(window.document, window.opening.second_view.pair)
    made: dict[str, Any] = {}
    monkeypatch.chdir(tmp_path)
    exec(script, made)
    assert made["other"].n_vertices == document.mesh.n_vertices
    assert made["comparison"].distance == pytest.approx(wanted.distance, rel=1e-6)
    undo = part(window, QPushButton, "second_undo_repair_button")
    undo.setFocus()
    QTest.keyClick(undo, Qt.Key.Key_Space)
    wait_for(lambda: document.repairs == ())
    rest(window)
    assert document.mesh.n_vertices == FAULTY.n_vertices


@pytest.mark.slow
def test_a_map_dropped_on_the_second_is_shown_on_it(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    drop(window, folder / "height.npy")
    wait_for(lambda: bool(opened.document.mesh.maps))
    rest(window)
    assert window.document.mesh.maps == ()
    assert window.document.display.kind == "map"
    np.testing.assert_allclose(
        displayed_surface(opened.scene.renderer).active_scalars, OTHER.vertices[:, 2], rtol=1e-6
    )
    # a map of another length is refused, and the displayed map stays
    bar = window.stage.message_bar
    drop(window, folder / "short.npy")
    wait_for(lambda: bar.notice is not None and "short.npy" in bar.notice.text)
    assert bar.notice.text.startswith("Second mesh: ")
    assert "Traceback" not in bar.notice.text
    assert opened.document.mesh.maps[-1].name == "height.npy"
    assert sum(each.name == "height.npy" for each in opened.document.mesh.maps) == 1
    assert opened.controller.field.title == "height.npy"
    # a drop adds the map to the first mesh, the button to the second
    drop(window, folder / "height.npy", share=0.25)
    wait_for(lambda: bool(window.document.mesh.maps))
    window.document.maps.remove("height.npy")
    opened.document.maps.remove("height.npy")
    ask = "meshmash_viewer.app.dialogs.files.ask_for_maps"
    monkeypatch.setattr(ask, lambda *_: [folder / "height.npy"])
    button = part(window, QPushButton, "second_map_button")
    button.setFocus()
    QTest.keyClick(button, Qt.Key.Key_Space)
    wait_for(lambda: bool(opened.document.mesh.maps))
    rest(window)
    assert opened.controller.field.title == "height.npy"


@pytest.mark.slow
def test_a_second_mesh_of_ten_vertices_is_compared(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "ten.npz", monkeypatch)
    assert len(opened.pair.comparison.spectra[0]) <= 10
    assert text(window, "pair_match_label").startswith("by features")


@pytest.mark.slow
def test_a_session_and_a_script_have_both(
    window: MainWindow, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = beside(window, folder / "other.npz", monkeypatch)
    for name in MATCHED_IN:
        opened.pair.match_by(name)
        rest(window)
        made: dict[str, Any] = {}
        monkeypatch.chdir(tmp_path)
        exec(reproduction_script(window.document, opened.pair), made)
        found, wanted = made["comparison"], opened.pair.comparison
        assert found.distance == pytest.approx(wanted.distance, rel=1e-6)
        assert np.mean(found.forth.indices == wanted.forth.indices) > 0.99
    opened.pair.link("position", False)
    opened.pair.match_by(refined=True)
    opened.pair.carry(True)
    made = mv.VertexMap("carried", np.arange(opened.document.mesh.n_vertices), unit="mm")
    opened.document.maps.add(opened.document.mesh, [made])
    opened.document.pins.toggle(5)  # of the second mesh alone
    opened.document.pins.change("name of a pin", 5, name="apex", own_color="#123456")
    pins = opened.document.pins.placed
    rest(window)
    path = tmp_path / "both.meshmash.json"
    window.opening.store_session(path)
    window.opening.end_comparison()
    last_session = window.opening.last_session
    last_session.save()
    shutdown(last_session)
    last_session.path(folder / "other.npz").unlink()  # as on another computer
    window.opening.restore_session(path)
    wait_for(lambda: window.opening.second_view is not None)
    rest(window)
    again = window.opening.second_view
    assert again.document.path == folder / "other.npz"
    assert again.pair.links == {"camera", "kind", "colors"}
    assert again.document.pins.placed == pins
    (kept,) = (each for each in again.document.mesh.maps if each.name.startswith("carried"))
    assert (kept.name, kept.unit, kept.values.tolist()) == ("carried", "mm", made.values.tolist())
    assert again.pair.matched_in == name
    assert (again.pair.refined, again.pair.carries) == (True, True)
    assert again.pair.comparison.distance == pytest.approx(wanted.distance, rel=1e-6)


@pytest.mark.slow
def test_a_closed_second_mesh_is_let_go(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = weakref.ref(beside(window, folder / "other.npz", monkeypatch).document)
    window.actions_["end_comparison"].trigger()
    assert window.opening.second_view is None

    def let_go() -> bool:
        gc.collect()
        return held() is None

    # a pending result of a thread refers to the document until it is delivered
    wait_for(let_go)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("broken.ply", "broken.ply"),
        ("small.npz", "too few for a comparison"),
    ],
)
def test_what_cannot_be_compared_costs_a_sentence(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, said: str
) -> None:
    shown = window.controller.field
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(folder / name), ""))
    window.actions_["compare_with"].trigger()
    bar = window.stage.message_bar
    wait_for(lambda: bar.notice is not None and said in bar.notice.text)
    assert "Traceback" not in bar.notice.text
    if name.startswith("broken"):
        wait_for(lambda: window.opening.second_view is None)
    assert window.controller.field is shown


def test_the_panel_is_no_wider_than_its_place(
    window: MainWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside(window, folder / "other.npz", monkeypatch)
    window.pair_panel.raise_()
    rest(window)
    (area,) = window.pair_panel.findChildren(QScrollArea)
    assert area.widget().minimumSizeHint().width() <= area.viewport().width()
