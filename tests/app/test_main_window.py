from __future__ import annotations

import gc
import json
import re
import shutil
import time
import weakref
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import shapes
from PySide6.QtCore import QMimeData, QPoint, QPointF, QRect, QSize, Qt, QUrl
from PySide6.QtGui import QDropEvent, QGuiApplication, QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QCheckBox,
    QComboBox,
    QDialog,
    QLabel,
    QLineEdit,
    QListWidget,
    QWidget,
)
from pytestqt.qtbot import QtBot
from tiers import slow

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS, MENUS
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.dialogs.export_dialog import FORMATS, ExportDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.panels.target_box import quarter_steps
from meshmash_viewer.app.run import application
from meshmash_viewer.app.view.style import text_size
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display, Shape
from meshmash_viewer.model.limits import LockedLimits
from meshmash_viewer.model.notices import Notice, Severity
from meshmash_viewer.samples import sample_path
from meshmash_viewer.spectral.weyl import Target, required_eigenvalue, weyl_eigenvalue
from meshmash_viewer.units import power_unit

LEFT = Qt.MouseButton.LeftButton
PATIENCE = 120_000


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait like ``qtbot.waitUntil``, for fixtures that outlive a test."""
    deadline = time.monotonic() + PATIENCE / 1000
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        QTest.qWait(10)
    catch_up()


def opened() -> MainWindow:
    window = MainWindow(fresh=True)
    window.show()
    window.activateWindow()
    wait_for(window.isActiveWindow)
    return window


def closed(window: MainWindow) -> None:
    window.close()
    window.deleteLater()
    theme.set_mode(theme.Mode.SYSTEM)


@pytest.fixture(scope="module")
def sphere_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = shapes.icosphere(3, radius=500.0)
    path = tmp_path_factory.mktemp("meshes") / "ball.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


def at_front(window: MainWindow) -> MainWindow:
    """Show a shared window without the message of the last test."""
    window.stage.message_bar.dismiss()
    window.resize(1440, 900)
    window.raise_()
    window.activateWindow()
    window.stage.setFocus()
    wait_for(lambda: window.isActiveWindow() and window.controller.idle)
    return window


def open_file(window: MainWindow, path: Path) -> None:
    window.open_mesh(path, "nm")
    wait_for(lambda: window.document.path == path and window.document.work.job is None)


def compute(window: MainWindow, count: int = 30) -> None:
    window.document.solve.target = Target("count", count)
    QTest.mouseClick(window.mesh_panel.compute_button, LEFT)
    document = window.document
    wait_for(
        lambda: document.work.job is None and bool(document.spectrum and document.spectrum.complete)
    )
    wait_for(lambda: window.controller.idle)


@pytest.fixture(scope="module")
def one_ball(sphere_file: Path, module_cache: Path) -> Iterator[MainWindow]:
    application()
    window = opened()
    open_file(window, sphere_file)
    compute(window)
    yield window
    closed(window)


@pytest.fixture
def ball(one_ball: MainWindow) -> MainWindow:
    """Return a window with a sphere of 642 vertices, 30 eigenpairs and default settings."""
    document, first = one_ball.document, Display()
    for each in fields(Display):
        setattr(document.display, each.name, getattr(first, each.name))
    document.pins.clear()
    document.set_unit("nm")
    document.solve.operator = OperatorOptions()
    document.solve.target = Target("count", 30)
    one_ball.stage.message_bar.dismiss()
    one_ball.resize(1440, 900)
    one_ball.arrangement.docks["mesh"].raise_()
    one_ball.activateWindow()
    one_ball.setFocus()
    wait_for(lambda: one_ball.isActiveWindow() and one_ball.controller.idle)
    return one_ball


@pytest.fixture(scope="module")
def one_empty() -> Iterator[MainWindow]:
    application()
    window = opened()
    yield window
    closed(window)


@pytest.fixture
def empty(one_empty: MainWindow) -> MainWindow:
    """Return a window without a mesh and without a message."""
    one_empty.document.solve.operator = OperatorOptions()
    return at_front(one_empty)


@pytest.fixture(scope="module")
def one_used() -> Iterator[MainWindow]:
    application()
    window = opened()
    yield window
    closed(window)


@pytest.fixture
def used(one_used: MainWindow) -> MainWindow:
    """Return a shared window for tests that open a mesh."""
    return at_front(one_used)


@pytest.fixture
def ball_file(sphere_file: Path, tmp_path: Path) -> Path:
    """Return a mesh file that has no session to restore."""
    return shutil.copy(sphere_file, tmp_path / "ball.npz")


# -- without a mesh ------------------------------------------------------------------------


def test_the_empty_window_says_what_to_do(empty: MainWindow) -> None:
    welcome = empty.stage.welcome
    assert welcome.isVisible()
    texts = " ".join(label.text() for label in empty.findChildren(QLabel) if label.isVisible())
    assert "Drop a mesh here" in texts
    assert welcome.open_button.isVisible()
    assert welcome.sample_button.text() == "Open the sample neuron"
    for name in ("export", "save_picture", "play", "nodal_lines", "compute", "cancel"):
        assert not empty.actions_[name].isEnabled(), name
    assert not empty.mesh_panel.compute_button.isEnabled()


@pytest.mark.slow
def test_the_window_is_there_before_the_render_is_loaded(qtbot: QtBot, tmp_path: Path) -> None:
    window = MainWindow(fresh=True, deferred=True)
    with qtbot.waitExposed(window):
        window.show()
    assert not window.loaded
    welcome = window.stage.welcome
    assert welcome.isVisible()
    welcome.set_loading("Loading the render …")
    window.open_mesh(tmp_path / "missing.ply")
    assert welcome.title.text() == "Reading missing.ply …"
    qtbot.waitUntil(lambda: window.document.work.job is None, timeout=PATIENCE)
    assert welcome.title.text() == "Drop a mesh here"
    window.open_mesh(sample_path("sphere"))
    assert welcome.title.text() == "Reading sphere.npz …"
    assert welcome.loading_label.text() == "Loading the render …"
    qtbot.waitUntil(lambda: window.document.work.job is None, timeout=PATIENCE)
    assert window.document.mesh is not None
    assert welcome.isVisible()
    assert welcome.title.text() != "Drop a mesh here"
    window.load()
    assert not welcome.loading_label.text()
    assert window.loaded
    assert window.findChild(QWidget, "scene") is window.scene
    window.close()
    window.deleteLater()


# -- the table of commands -------------------------------------------------------------------


def test_every_command_does_something(empty: MainWindow) -> None:
    for command in COMMANDS:
        name = command.does[0] if command.does else command.name
        assert callable(empty.commands.method(name)), name


def test_every_command_is_on_its_menu_with_its_keys(empty: MainWindow) -> None:
    for command in COMMANDS:
        assert command.menu in MENUS
        menu = empty.menus[command.submenu or command.menu]
        action = empty.actions_[command.name]
        assert action in menu.actions()
        assert [key.toString() for key in action.shortcuts()] == [
            QKeySequence(text).toString() for text in command.shortcuts
        ]


def test_no_key_means_two_things() -> None:
    keys = [QKeySequence(key).toString() for command in COMMANDS for key in command.shortcuts]
    assert len(keys) == len(set(keys))
    assert all(keys), "a key that Qt does not know"


def test_help_lists_every_command_and_finds_one(qtbot: QtBot, empty: MainWindow) -> None:
    QTest.keyClick(empty, Qt.Key.Key_F1)
    qtbot.waitUntil(lambda: empty.findChild(QDialog, "help_dialog") is not None)
    dialog = empty.findChild(QDialog, "help_dialog")

    def shown() -> set[str]:
        tops = [dialog.tree.topLevelItem(at) for at in range(dialog.tree.topLevelItemCount())]
        rows = [
            top.child(at) for top in tops if not top.isHidden() for at in range(top.childCount())
        ]
        return {row.text(0) for row in rows if not row.isHidden()}

    assert {command.text.rstrip("…") for command in COMMANDS} <= shown()
    dialog.search.setText("nodal")
    assert shown() == {"Nodal lines"}
    dialog.search.clear()
    for width in (860, 640):
        dialog.resize(width, 600)
        QTest.qWait(50)
        tree, column = dialog.tree, dialog.tree.columnWidth(2)
        assert column <= tree.viewport().width()
        for at in range(tree.topLevelItemCount()):
            for row in map(tree.topLevelItem(at).child, range(tree.topLevelItem(at).childCount())):
                tree.scrollToItem(row)
                text = tree.fontMetrics().boundingRect(
                    QRect(0, 0, column - 16, 1000), Qt.TextFlag.TextWordWrap, row.text(2)
                )
                assert tree.visualItemRect(row).height() >= text.height(), row.text(2)
    dialog.reject()


@pytest.mark.slow
def test_controls_have_names_for_scripts_and_for_screen_readers(ball: MainWindow) -> None:
    kinds = (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit)
    for kind in kinds:
        for control in ball.findChildren(kind):
            if not control.isVisible() or control.objectName().startswith("qt_"):
                continue
            if control.parent() is not None and control.parent().inherits("QMenuBar"):
                continue
            if control.metaObject().className() in ("QScrollBar", "QDockWidgetTitleButton"):
                continue
            if isinstance(control.parent(), QComboBox) or control.parent().inherits("QTabBar"):
                continue
            text = control.text() if isinstance(control, QAbstractButton) else ""
            assert control.accessibleName() or text, control
            if not control.inherits("QToolButton") or control.parent() is not ball.toolbar:
                assert control.objectName() == control.objectName().lower(), control


def test_names_that_scripts_rely_on(empty: MainWindow) -> None:
    for name in (
        "compute_button",
        "cancel_button",
        "progress_bar",
        "proof_label",
        "eigenvector_slider",
        "eigenvector_spin",
        "hks_time_slider",
        "hks_scales_spin",
        "band_count_spin",
        "band_spin",
        "spectrum_plot",
        "profile_plot",
        "field_list",
        "scene",
    ):
        assert len(empty.findChildren(QWidget, name)) == 1, name


# -- the mesh panel --------------------------------------------------------------------------


@pytest.mark.slow
def test_the_extent_fits_the_panel_with_its_unit(used: MainWindow, tmp_path: Path) -> None:
    used.resize(1000, 640)  # a scroll bar is next to the label
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    for scale, unit in (
        (1e-7, "nm"), (1.0, "nm"), (9.99e4, "nm"), (3.3e5, "µm"), (1.4e7, "µm"), (1e20, "m"),
    ):  # fmt: skip
        path = tmp_path / f"flat_{scale:g}.npz"
        np.savez(path, vertices=scale * corners, faces=[[0, 1, 2]])
        open_file(used, path)
        label = used.mesh_panel.findChild(QLabel, "mesh_extent_label")
        assert not unit or label.text().endswith("m"), scale
        QTest.qWait(50)
        assert label.fontMetrics().horizontalAdvance(label.text()) <= label.width(), scale


def test_the_mesh_panel_says_what_was_read(qtbot: QtBot, used: MainWindow, ball_file: Path) -> None:
    open_file(used, ball_file)
    panel = used.mesh_panel
    texts = {label.objectName(): label.text() for label in panel.findChildren(QLabel)}
    assert texts["mesh_vertices_label"] == "642"
    assert texts["mesh_faces_label"] == "1,280"
    assert texts["mesh_area_label"].endswith("µm²")
    assert texts["mesh_extent_label"] == "1 × 1 × 1\N{NO-BREAK SPACE}µm"
    assert panel.unit_combo.currentText() == "nm"
    assert texts["health_n_components"] == "1"
    assert "memory" in texts["cost_label"]
    assert used.windowTitle().startswith("ball")
    assert not used.stage.welcome.isVisible()


def test_faults_are_repaired_with_one_click_and_undone_with_another(
    qtbot: QtBot, used: MainWindow, tmp_path: Path
) -> None:
    mesh = shapes.icosphere(2, unit="nm")
    path = tmp_path / "dirty.npz"
    faces = np.vstack([mesh.faces, mesh.faces[:3]])
    vertices = np.vstack([mesh.vertices, [[9.0, 9.0, 9.0]]])
    np.savez(path, vertices=vertices, faces=faces)
    open_file(used, path)
    panel = used.mesh_panel
    repair = panel.findChild(QAbstractButton, "drop_duplicate_faces")
    assert repair.isVisible()
    assert not panel.findChild(QAbstractButton, "merge_coincident_vertices").isVisible()
    QTest.mouseClick(repair, LEFT)
    qtbot.waitUntil(lambda: used.document.undo_repair_steps, timeout=PATIENCE)
    qtbot.waitUntil(lambda: used.document.work.job is None, timeout=PATIENCE)
    assert used.document.mesh.n_faces == len(mesh.faces)
    catch_up()
    assert not repair.isVisible()
    focus = QApplication.focusWidget()
    assert focus is None or not panel.isAncestorOf(focus), "Space would press something else"
    QTest.keyClick(used, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert used.document.mesh.n_faces == len(mesh.faces) + 3
    catch_up()
    assert repair.isVisible()


@pytest.mark.slow
def test_as_many_pairs_as_the_shortest_time_takes(
    qtbot: QtBot, window: MainWindow, sphere_file: Path
) -> None:
    open_file(window, sphere_file)
    box, document = window.mesh_panel.target_box, window.document
    area = document.ready.health.area
    time = area / 100.0
    box.time_spin.setFocus()
    box.time_spin.selectAll()
    QTest.keyClicks(box.time_spin, f"{time:.6g}")
    catch_up()
    assert document.solve.target.kind == "time"
    assert box.eigenvalue_spin.value == pytest.approx(required_eigenvalue(time), rel=1e-4)
    assert box.count_spin.text().startswith("≈ ")
    QTest.mouseClick(window.mesh_panel.compute_button, LEFT)
    qtbot.waitUntil(
        lambda: document.work.job is None and document.spectrum is not None, timeout=PATIENCE
    )
    catch_up()
    spectrum = document.spectrum
    # the count is exact now, although the last eigenvalue is below the target
    assert box.count_spin.text() == f"{len(spectrum)}"
    assert spectrum.eigenvalues[-1] < spectrum.known_to
    assert spectrum.known_to == pytest.approx(required_eigenvalue(time), rel=1e-4)
    # a time that the mesh cannot resolve requests all its eigenpairs
    document.solve.target = Target("time", area * 1e-6)
    catch_up()
    assert box.count_spin.value == document.mesh.n_vertices
    assert "no more eigenpairs" in box.note.text()
    asked = []
    document.work.requested.disconnect()
    document.work.requested.connect(asked.append)
    document.solve.compute()
    assert asked[0].work.args[2] == Target("count", document.mesh.n_vertices)


@pytest.mark.slow
def test_the_targets_are_translated_into_each_other(
    qtbot: QtBot, used: MainWindow, ball_file: Path
) -> None:
    open_file(used, ball_file)
    box, document = used.mesh_panel.target_box, used.document
    area = document.ready.health.area
    spin = box.count_spin
    spin.setFocus()
    spin.selectAll()
    QTest.keyClicks(spin, "40")
    assert document.solve.target == Target("count", 40)
    catch_up()
    assert box.eigenvalue_spin.value == pytest.approx(weyl_eigenvalue(area, 40), rel=1e-9)
    assert box.eigenvalue_spin.text().startswith("≈ ")
    assert box.eigenvalue_spin.text().endswith("\N{NO-BREAK SPACE}nm⁻²")
    assert box.wavelength_spin.text().endswith("\N{NO-BREAK SPACE}nm")
    eigenvalue = box.eigenvalue_spin
    eigenvalue.setFocus()
    eigenvalue.selectAll()
    QTest.keyClicks(eigenvalue, "2.5e-4")
    assert document.solve.target == Target("max_eigenvalue", 2.5e-4)
    catch_up()
    assert box.count_spin.value == round(area * 2.5e-4 / (4 * np.pi))
    assert box.count_spin.text().startswith("≈ ")
    assert not box.eigenvalue_spin.text().startswith("≈")


def test_the_operator_is_chosen(empty: MainWindow) -> None:
    check = empty.mesh_panel.robust_check
    QTest.mouseClick(check, LEFT, pos=QPoint(8, check.height() // 2))
    assert not empty.document.solve.operator.robust
    catch_up()
    assert not empty.mesh_panel.mollify_spin.isEnabled()


def test_another_unit_keeps_spectrum_and_camera(qtbot: QtBot, ball: MainWindow) -> None:
    before = ball.scene.camera()
    spectrum = ball.document.spectrum
    edit = ball.mesh_panel.unit_combo.lineEdit()
    QTest.mouseClick(edit, LEFT)
    qtbot.waitUntil(lambda: edit.selectedText() == edit.text())  # typing replaces the selection
    QTest.keyClicks(edit, "mm")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert ball.document.mesh.unit == "mm"
    assert ball.document.spectrum.rows is spectrum.rows
    assert ball.scene.camera() == before
    qtbot.waitUntil(lambda: power_unit("mm", -2) in ball.controller.field.quantity)
    edit.selectAll()
    QTest.keyClicks(edit, "8 furlongs")
    QTest.keyClick(edit, Qt.Key.Key_Return)
    assert "not a length unit" in ball.stage.message_bar.notice.text
    assert ball.mesh_panel.unit_combo.currentText() == "mm"


def test_quantities_are_typed_and_stepped_at_any_scale(qtbot: QtBot) -> None:
    box = NumberField("box", "A box", step=quarter_steps, live=True)
    qtbot.addWidget(box)
    box.show_value(1.234e-8, "nm⁻²", with_unit=True)
    assert box.text() == "1.234e-08\N{NO-BREAK SPACE}nm⁻²"
    box.stepUp()
    assert box.value == pytest.approx(1.234e-8 * 2**0.25)
    box.show_value(None)
    assert box.text() == "–"
    box.selectAll()
    QTest.keyClicks(box, "3e5")
    assert box.value == 3e5
    QTest.keyClicks(box, "x")
    assert box.value is None, "nothing was meant by it"


# -- the message bar -------------------------------------------------------------------------


def test_errors_stay_until_dismissed_and_their_details_are_copied(empty: MainWindow) -> None:
    bar = empty.stage.message_bar
    empty.document.notices.show(Notice("It broke: do this.", Severity.ERROR, "Traceback of it"))
    assert bar.isVisible()
    assert bar.geometry().right() < empty.stage.width()
    copy = bar.findChild(QAbstractButton, "copy_details")
    QTest.mouseClick(copy, LEFT)
    assert QGuiApplication.clipboard().text() == "It broke: do this.\n\nTraceback of it"
    QTest.mouseClick(bar.findChild(QAbstractButton, "dismiss_message"), LEFT)
    assert not bar.isVisible()


def test_a_message_is_legible_over_a_narrow_render(empty: MainWindow) -> None:
    empty.resize(1000, 600)
    bar = empty.stage.message_bar
    text = "Picture saved to /media/disk/pictures/cow.png."
    empty.document.notices.show(Notice(text, action=lambda: None, button="Show in folder"))
    bar.keep_clear(QSize(160, 70), 90)  # the sizes of a title and a colour bar
    QApplication.processEvents()
    action = bar.findChild(QAbstractButton, "message_action")
    assert action.width() >= action.sizeHint().width()
    assert bar.findChild(QLabel, "message_text").width() >= 120
    top = bar.y()
    bar.keep_below(27)  # below the label line of two renders
    assert bar.y() == top + 27
    bar.keep_below(0)
    bar.dismiss()


def test_good_news_goes_and_what_can_be_undone_stays(
    empty: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    bar = empty.stage.message_bar
    monkeypatch.setattr("meshmash_viewer.app.controls.message_bar._STAY", 50)
    monkeypatch.setattr("meshmash_viewer.app.controls.message_bar._OFFER", 60)
    undone: list[bool] = []
    empty.document.notices.show(Notice("Unit changed.", action=lambda: undone.append(True)))
    QTest.qWait(300)
    assert bar.isVisible()
    QTest.mouseClick(bar.findChild(QAbstractButton, "message_action"), LEFT)
    assert undone
    assert not bar.isVisible()
    empty.document.notices.show(Notice("Saved."))
    assert bar.isVisible()
    qtbot.waitUntil(lambda: not bar.isVisible(), timeout=5000)
    folder = Notice("Saved.", action=lambda: None, button="Show in folder", brief=True)
    empty.document.notices.show(folder)
    assert bar.isVisible()
    assert bar.findChild(QAbstractButton, "message_action").isVisible()
    qtbot.waitUntil(lambda: not bar.isVisible(), timeout=5000)


def test_a_message_goes_with_its_cause(used: MainWindow, ball_file: Path) -> None:
    bar, document = used.stage.message_bar, used.document
    document.notices.show(Notice("Too many.", Severity.WARNING))
    document.notices.show(Notice("The last one counts.", Severity.WARNING))
    open_file(used, ball_file)
    assert bar.notice is None, "another mesh"
    document.notices.show(Notice("The disk is full.", Severity.ERROR))
    document.pins.toggle(3)
    assert bar.notice is not None, "a pin has nothing to do with it"
    compute(used, 5)
    assert bar.notice is None, "the next job"
    document.set_unit("mm")
    assert "Unit changed" in bar.notice.text
    document.pins.toggle(4)
    assert bar.notice is None, "Undo would undo the pin"
    waits = [True]
    document.notices.show(Notice("It runs.", Severity.WARNING, holds=lambda: waits[0]))
    document.pins.clear()
    assert bar.notice is not None
    waits.clear()
    waits.append(False)
    document.pins.toggle(5)
    assert bar.notice is None


@pytest.mark.parametrize("width", [slow(1440), slow(1000), 700])
def test_a_message_leaves_the_title_of_the_field_alone(ball: MainWindow, width: int) -> None:
    ball.resize(width, 800)
    document, bar = ball.document, ball.stage.message_bar
    document.pins.toggle(3)
    document.display.change(Similarity, vertex=3)
    document.notices.show(
        Notice("Something took longer than it should have: look there.", Severity.WARNING)
    )
    places = []
    for kind, index in (("eigenfunction", 5), ("similarity", 0)):
        document.display.change(Eigenfunctions, index=index)
        document.display.kind = kind
        QTest.qWait(20)
        wait_for(lambda: ball.controller.idle)
        caption = ball.scene.renderer.caption
        assert caption.title == ball.controller.field.title
        title = QRect(QPoint(0, 0), ball.scene.title_size)
        assert title.width() > text_size(caption.title, 15, True)[0] + 16
        assert title.width() > text_size(caption.quantity, 12, False)[0] + 16
        assert not bar.geometry().intersects(title)
        colours = ball.stage.rect().adjusted(ball.stage.width() - ball.scene.bar_width, 100, 0, 0)
        assert not bar.geometry().intersects(colours)
        assert ball.stage.rect().contains(bar.geometry())
        places.append(title.width())
    assert places[0] < places[1]


# -- opening ---------------------------------------------------------------------------------


def test_an_error_goes_when_the_next_try_succeeds(used: MainWindow, ball_file: Path) -> None:
    bar = used.stage.message_bar
    used.open_mesh(ball_file.with_name("no such mesh.npz"))
    wait_for(lambda: bar.notice is not None)
    open_file(used, ball_file)
    assert bar.notice is None
    used.mesh_panel.unit_combo.setCurrentText("frog")
    used.mesh_panel.unit_combo.lineEdit().editingFinished.emit()
    assert "frog" in bar.notice.text
    used.document.set_unit("mm")
    assert bar.notice.severity is Severity.INFORMATION


@pytest.mark.slow
def test_a_file_is_dropped_on_the_render_and_remembered(
    qtbot: QtBot, window: MainWindow, sphere_file: Path, tmp_path: Path
) -> None:
    ball = window
    open_file(ball, sphere_file)
    mesh = shapes.icosphere(2)
    other = tmp_path / "other.npz"
    np.savez(other, vertices=mesh.vertices, faces=mesh.faces)
    assert not any(child.acceptDrops() for child in ball.scene.findChildren(QWidget))
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(other))])
    place = QPointF(ball.stage.mapTo(ball, ball.stage.rect().center()))
    event = QDropEvent(place, Qt.DropAction.CopyAction, data, LEFT, Qt.KeyboardModifier.NoModifier)
    ball.dropEvent(event)  # Qt sends drop events only after a real drag
    qtbot.waitUntil(lambda: ball.document.path == other, timeout=PATIENCE)
    assert ball.document.spectrum is None or len(ball.document.spectrum) == 0
    assert ball.settings.recent[0] == other
    assert len(ball.settings.recent) == 2


@pytest.mark.slow
def test_a_mesh_in_memory_is_shown(qtbot: QtBot, used: MainWindow, neuron: Mesh) -> None:
    used.document.take_mesh(neuron)
    document = used.document
    qtbot.waitUntil(lambda: document.mesh is not None and document.path is None, timeout=PATIENCE)
    assert document.mesh.n_vertices == neuron.n_vertices


# -- keys --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_keys_go_through_the_eigenfunctions(qtbot: QtBot, ball: MainWindow) -> None:
    display = ball.document.display
    ball.setFocus()
    for key, index in (
        (Qt.Key.Key_Home, 0),
        (Qt.Key.Key_Right, 1),
        (Qt.Key.Key_PageDown, 11),
        (Qt.Key.Key_Left, 10),
        (Qt.Key.Key_End, 29),
        (Qt.Key.Key_PageUp, 19),
    ):
        QTest.keyClick(ball, key)
        assert display[Eigenfunctions].index == index
    qtbot.waitUntil(lambda: ball.controller.field.family.index == 19, timeout=PATIENCE)
    QTest.keyClick(ball, Qt.Key.Key_N)
    assert display.nodal_lines
    assert ball.actions_["nodal_lines"].isChecked()
    QTest.keyClick(ball, Qt.Key.Key_F)
    assert 19 in display[Eigenfunctions].flipped
    QTest.keyClick(ball, Qt.Key.Key_2)
    assert display.kind == "hks"
    QTest.keyClick(ball, Qt.Key.Key_Space)
    assert display.playing
    QTest.keyClick(ball, Qt.Key.Key_Space)
    assert not display.playing


def test_space_presses_a_focused_button_and_digits_go_into_a_field(ball: MainWindow) -> None:
    check = ball.mesh_panel.findChild(QCheckBox, "robust_check")
    check.setFocus()
    QTest.keyClick(check, Qt.Key.Key_Space)
    assert not check.isChecked()
    assert not ball.document.display.playing
    spin = ball.mesh_panel.target_box.count_spin
    spin.setFocus()
    spin.selectAll()
    QTest.keyClicks(spin, "12")
    assert spin.value == 12
    assert ball.document.display.kind == "eigenfunction"


# -- themes and layout -------------------------------------------------------------------------


@pytest.mark.slow
def test_the_theme_is_switched_from_the_menu(window: MainWindow) -> None:
    def ticked() -> list[str]:
        return [mode.value for mode in theme.Mode if window.actions_[f"theme_{mode}"].isChecked()]

    assert ticked() == ["system"], "in a fresh window, too"
    window.actions_["theme_dark"].trigger()
    assert theme.is_dark()
    assert ticked() == ["dark"]
    window.actions_["theme_dark"].trigger()
    assert ticked() == ["dark"], "chosen again it stays"
    window.actions_["theme_light"].trigger()
    assert not theme.is_dark()
    assert ticked() == ["light"]


@pytest.mark.slow
def test_lines_can_be_left_out_wherever_they_are_drawn(
    window: MainWindow, sphere_file: Path, tmp_path: Path
) -> None:
    open_file(window, sphere_file)
    compute(window)
    document, drawing = window.document, window.scene.renderer
    lines, flip = (window.actions_[name] for name in ("nodal_lines", "flip"))
    heights = document.mesh.vertices[:, 2]
    for name, values, signed in (("height.npy", heights, True), ("up.npy", heights + 500.0, False)):
        np.save(tmp_path / name, values)
        document.maps.open([tmp_path / name])
        wait_for(lambda name=name: drawing.caption.title == name)
        assert lines.isEnabled() is signed
        assert not flip.isEnabled(), "the sign of a map is not free"
        lines.trigger()
        wait_for(lambda on=signed: (drawing.caption.lines == 0.0) is on)
    document.display.kind = "eigenfunction"
    wait_for(lambda: window.controller.idle)
    assert lines.isEnabled()
    assert flip.isEnabled()
    document.display.kind = "similarity"  # without a vertex, the eigenfunction stays on the render
    catch_up()
    assert lines.isEnabled()
    assert not flip.isEnabled()


def test_play_flip_sign_and_nodal_lines_are_in_the_menus_only(ball: MainWindow) -> None:
    texts = [action.iconText() for action in ball.toolbar.actions() if not action.isSeparator()]
    assert texts == ["Open", "Export", "Picture", "Reset camera", "Select", "Help"]
    buttons = ball.field_panel.findChildren(QAbstractButton)
    assert not {"Play", "Flip sign", "Nodal lines"} & {button.text() for button in buttons}
    for menu, name in (("Field", "play"), ("Field", "flip"), ("View", "nodal_lines")):
        assert ball.actions_[name] in ball.menus[menu].actions()


@pytest.mark.parametrize("size", [(1100, 700), slow((1500, 950))])
def test_nothing_is_cut_off_at_either_size(
    qtbot: QtBot, ball: MainWindow, size: tuple[int, int]
) -> None:
    ball.resize(*size)
    qtbot.wait(50)
    ball.resize(*size)  # the plots may have changed the layout meanwhile
    qtbot.wait(100)
    assert ball.width() == size[0]
    assert ball.height() == size[1]
    for button in ball.mesh_panel.findChildren(QAbstractButton):
        if button.isVisible():
            assert button.width() >= button.minimumSizeHint().width(), button.objectName()
    scrolled = ball.mesh_panel.target_box
    room = ball.mesh_panel.width()
    assert scrolled.mapTo(ball.mesh_panel, QPoint(scrolled.width(), 0)).x() <= room
    assert ball.scene.width() >= 380
    families = ball.findChild(QListWidget, "field_list")
    for row in range(families.count()):
        rect = families.visualItemRect(families.item(row))
        assert families.viewport().rect().contains(rect), "all families are in view"
        text = families.fontMetrics().horizontalAdvance(families.item(row).text())
        assert text + families.iconSize().width() + 20 <= rect.width()


# -- pictures, exports and sessions ------------------------------------------------------------


def test_exports_say_what_they_miss_before_and_after(
    qtbot: QtBot, ball: MainWindow, tmp_path: Path
) -> None:
    document = ball.document
    display, last = document.display, float(document.spectrum.eigenvalues[-1])
    display.kind = "hks"
    dialog = ExportDialog(document, tmp_path, ball)
    assert "miss" not in dialog.remark_label.text()
    dialog.deleteLater()
    display.change(HeatKernelSignature, t_min=1 / last)
    display.change(HeatKernelSignature, t_max=1e3 / last)
    display.change(HeatKernelSignature, automatic=False)
    dialog = ExportDialog(document, tmp_path, ball)
    said = dialog.remark_label.text()
    assert re.match(r"\d+ of 32 columns miss more than 1 %.* about [34]\d\s%: the file", said)
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("eigenpairs"))
    assert "miss" not in dialog.remark_label.text()
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("hks"))
    document.work.write(dialog.path, dialog.export())
    qtbot.waitUntil(lambda: (tmp_path / "ball_hks.npz").exists(), timeout=PATIENCE)
    qtbot.waitUntil(lambda: ball.stage.message_bar.notice is not None, timeout=PATIENCE)
    notice = ball.stage.message_bar.notice
    assert notice.severity is Severity.WARNING
    assert "columns miss more than 1 %" in notice.text
    with np.load(tmp_path / "ball_hks.npz") as archive:
        truncation = json.loads(str(archive["meta"]))["options"]["truncation"]
    assert truncation["flagged"][0] == truncation["columns"][0]
    dialog.deleteLater()


def test_the_export_dialog_says_what_the_file_will_contain(
    ball: MainWindow, tmp_path: Path
) -> None:
    ball.document.display.kind = "hks"
    dialog = ExportDialog(ball.document, tmp_path, ball)
    assert [each.ending for each in FORMATS] == [
        ".npz", ".npy", ".csv", ".parquet", ".vtp", ".ply", ".func.gii", ".shape.gii",
    ]  # fmt: skip
    assert {each.ending for each in FORMATS} <= set(WRITERS)
    assert "642 rows (vertices) × 32 columns" in dialog.contents_label.text()
    assert "µm²" in dialog.contents_label.text()
    assert "hks_t=" in dialog.columns_label.text()
    dialog.table.selectRow(2)
    assert dialog.path == tmp_path / "ball_hks.csv"
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("eigenpairs"))
    assert dialog.path == tmp_path / "ball_eigenpairs.csv"
    dialog.table.selectRow(6)
    assert dialog.path == tmp_path / "ball_eigenpairs.func.gii"
    dialog.table.selectRow(0)
    assert not dialog.count_spin.isVisibleTo(dialog)
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("wks"))
    assert dialog.count_spin.isVisibleTo(dialog)
    dialog.count_spin.setValue(12)
    assert "× 12 columns" in dialog.contents_label.text()
    assert "wks_λ=" in dialog.columns_label.text()
    assert (dialog.export().family.export, dialog.export().family.count) == ("wks", 12)
    dialog.pairs_spin.setValue(2)  # two pairs, one of them constant, give no range of energies
    assert "more eigenpairs" in dialog.contents_label.text()
    assert not dialog.accept_button.isEnabled()
    dialog.kind_combo.setCurrentIndex(dialog.kind_combo.findData("eigenpairs"))
    assert dialog.accept_button.isEnabled()
    dialog.pairs_spin.setValue(10)
    assert "× 10 columns" in dialog.contents_label.text()
    job = dialog.export()
    assert job.family.export == "eigenpairs"
    assert (job.n_pairs, job.path.name) == (
        10,
        "ball_eigenpairs.npz",
    )
    dialog.file_row.edit.setText(str(tmp_path / "nowhere" / "x.npz"))
    dialog.accept_button.click()
    assert dialog.result() != QDialog.DialogCode.Accepted
    assert dialog.remark_label.text()
    dialog.deleteLater()


@pytest.mark.slow
def test_a_session_comes_back(
    qtbot: QtBot,
    ball: MainWindow,
    sphere_file: Path,
    tmp_path: Path,
) -> None:
    document = ball.document
    for vertex in (3, 17, 42, 3):
        document.pins.toggle(vertex)
    document.display.change(Eigenfunctions, index=7)
    document.display.set_limits(LockedLimits(-2.0, 3.0))
    document.display.nodal_lines = True
    document.solve.target = Target("count", 30)
    camera = ball.scene.camera()
    path = tmp_path / "now.meshmash.json"
    ball.opening.store_session(path)

    other = MainWindow(fresh=True)
    other.show()
    other.opening.restore_session(path)
    qtbot.waitUntil(lambda: len(other.document.pins.placed) == 2, timeout=PATIENCE)
    assert other.document.path == sphere_file
    assert other.document.pins.placed == document.pins.placed, (
        "the same vertices, numbers and colours"
    )
    assert [(pin.vertex, pin.number) for pin in document.pins.placed] == [(17, 2), (42, 3)]
    assert other.document.display[Eigenfunctions].index == 7
    assert other.document.display.limits == LockedLimits(-2.0, 3.0)
    assert other.document.display.nodal_lines
    assert other.document.solve.target == Target("count", 30)
    qtbot.waitUntil(lambda: other.scene.camera() == camera, timeout=PATIENCE)
    assert other.document.spectrum is not None, "its eigenpairs come from the store"
    other.close()


@pytest.mark.slow
def test_a_session_repairs_what_was_repaired_and_interrupts_what_runs(
    window: MainWindow, tmp_path: Path, neuron: Mesh
) -> None:
    document = window.document
    source = tmp_path / "neuron.npz"
    np.savez(source, vertices=neuron.vertices, faces=neuron.faces)
    window.open_mesh(source, "8 nm")
    wait_for(lambda: document.mesh is not None and document.work.job is None)
    document.repair("keep_largest_component")
    wait_for(lambda: document.ready.health.n_components == 1 and document.work.job is None)
    document.pins.toggle(42)
    path, place = tmp_path / "now.meshmash.json", document.mesh.vertices[42]
    window.opening.store_session(path)
    document.undo_repair()
    document.solve.target = Target("count", 1000)
    document.solve.compute()
    window.stage.message_bar.dismiss()
    window.opening.restore_session(path)
    wait_for(lambda: len(document.pins.placed) == 1 and document.work.job is None)
    assert document.repairs == ("keep_largest_component",)
    assert document.unit_text == "8 nm"
    np.testing.assert_array_equal(document.mesh.vertices[document.pins.placed[0].vertex], place)
    assert window.stage.message_bar.notice is None, "nothing has changed since"


def test_a_broken_session_is_one_sentence(empty: MainWindow, tmp_path: Path) -> None:
    path = tmp_path / "broken.meshmash.json"
    path.write_text("{")
    empty.opening.open_path(path)
    assert empty.stage.message_bar.notice.severity is Severity.ERROR
    assert "not a session" in empty.stage.message_bar.notice.text


def test_the_script_of_what_is_on_screen_is_python(ball: MainWindow) -> None:
    ball.actions_["copy_script"].trigger()
    text = QGuiApplication.clipboard().text()
    compile(text, "script", "exec")
    assert "meshmash_viewer" in text


@pytest.mark.parametrize("opened", [slow("empty"), "ball"])
def test_a_report_on_the_machine_is_copied(request: pytest.FixtureRequest, opened: str) -> None:
    window: MainWindow = request.getfixturevalue(opened)
    window.actions_["system_report"].trigger()
    report = QGuiApplication.clipboard().text()
    told = dict(line.strip().split(" : ", 1) for line in report.splitlines() if " : " in line)
    assert told["numpy"] == np.__version__
    assert "decompositions in" in told["Eigenpairs kept"]
    assert re.search(r"\d+\.\d+", told["Graphics"]), "the version of OpenGL"
    assert "paste it" in window.stage.message_bar.notice.text


@pytest.mark.slow
@pytest.mark.pixels
def test_a_picture_is_copied(qtbot: QtBot, ball: MainWindow) -> None:
    ball.actions_["copy_picture"].trigger()
    qtbot.waitUntil(lambda: ball.background_io.idle, timeout=60_000)
    image = QGuiApplication.clipboard().image()
    assert image.width() == pytest.approx(
        ball.scene.width() * ball.scene.devicePixelRatioF(), abs=2
    )


# -- settings ----------------------------------------------------------------------------------


def test_settings_are_kept_unless_fresh(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> None:
    from meshmash_viewer.app import settings as module

    stored: dict[str, object] = {}

    class Store:
        def __init__(self, *_: str) -> None: ...

        def value(self, key: str) -> object:
            return stored.get(key)

        def setValue(self, key: str, value: object) -> None:
            stored[key] = value

    monkeypatch.setattr(module, "QSettings", Store)
    fresh = module.Settings(fresh=True)
    fresh.theme = theme.Mode.DARK
    assert fresh.theme is theme.Mode.DARK
    assert not stored
    kept = module.Settings()
    kept.theme = theme.Mode.LIGHT
    kept.figure = "{}", ".pdf"
    kept.add_recent(Path(__file__))
    kept.add_recent(Path(__file__).with_name("not there"))
    assert module.Settings().theme is theme.Mode.LIGHT
    assert module.Settings().figure == ("{}", ".pdf")
    assert module.Settings().recent == [Path(__file__)]
    stored["recent"] = str(Path(__file__))
    assert module.Settings().recent == [Path(__file__)], "as an ini file gives a list of one back"


def test_close_while_nothing_runs_is_quick(qtbot: QtBot) -> None:
    window = MainWindow(fresh=True)
    window.show()
    folder = window.jobs.worker.folder
    window.close()
    deadline = time.monotonic() + 60
    while folder.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not folder.exists()
    assert window.jobs.worker.process_id is None


def test_a_known_mesh_opens_with_its_last_field(
    qtbot: QtBot, ball: MainWindow, tmp_path: Path
) -> None:
    display, source = ball.document.display, ball.controller
    known = ball.document.path
    display.change(Eigenfunctions, index=7)
    display.kind = "hks"
    catch_up()
    mesh, other = shapes.icosphere(2, radius=400.0), tmp_path / "other.npz"
    np.savez(other, vertices=mesh.vertices, faces=mesh.faces)
    open_file(ball, other)
    assert ball.document.spectrum is None
    display.kind = "eigenfunction"
    catch_up()
    qtbot.waitUntil(lambda: source.idle, timeout=PATIENCE)
    kinds: list[str] = []
    source.drawn.connect(lambda field, _: field is not None and kinds.append(field.family.name))
    open_file(ball, known)
    qtbot.waitUntil(lambda: source.idle and bool(kinds), timeout=PATIENCE)
    assert display[Eigenfunctions].index == 7
    assert kinds[0] == "hks", "at once: no other field comes first"


@pytest.mark.slow
def test_nothing_of_a_mesh_is_held_once_another_is_open(
    window: MainWindow, sphere_file: Path, tmp_path: Path
) -> None:
    open_file(window, sphere_file)
    compute(window)
    document, display = window.document, window.document.display
    document.pins.toggle(3)
    for kind in FAMILIES:
        display.kind = kind
        wait_for(lambda: window.controller.idle)
    display.kind, display.shape = "eigenfunction", Shape(shown=True, pairs=9)
    display.vibrating = True
    QTest.qWait(200)
    held = weakref.ref(document.mesh), weakref.ref(document.spectrum)
    mesh, other = shapes.icosphere(2, radius=400.0), tmp_path / "other.npz"
    np.savez(other, vertices=mesh.vertices, faces=mesh.faces)
    open_file(window, other)

    def let_go() -> bool:
        gc.collect()
        return [each() for each in held] == [None, None]

    # a thread holds the mesh until its last answer has arrived
    wait_for(let_go)


def test_a_shape_whose_mesh_is_gone_is_not_saved(empty: MainWindow, tmp_path: Path) -> None:
    said = list[Notice]()
    empty.document.notices.shown.connect(said.append)
    empty.shape_panel.save_requested.emit(tmp_path / "shape.ply")
    assert [each.severity for each in said] == [Severity.WARNING]
    assert not list(tmp_path.iterdir())


def test_a_mesh_that_is_about_to_go_may_still_be_pointed_at(ball: MainWindow) -> None:
    larger = shapes.icosphere(5)
    summary = ball.hover_label.text()
    ball.scene.set_mesh(larger)
    ball.scene.vertex_hovered.emit(larger.n_vertices - 1)
    assert ball.hover_label.text() == summary
