"""Faults: the window reports errors and remains usable."""

from __future__ import annotations

import gc
import importlib
import json
import sys
import threading
import weakref
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import psutil
import pytest
import shapes
from psygnal import EmitLoopError
from PySide6.QtCore import QCoreApplication, QEvent, QPoint, QRunnable, Qt, QThreadPool, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QPushButton
from pytestqt.qtbot import QtBot
from tiers import slow

import meshmash_viewer
from meshmash_viewer.app import run
from meshmash_viewer.app.dialogs.series import Run, SeriesPainter
from meshmash_viewer.app.executor import shutdown
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import FaultBoundary
from meshmash_viewer.app.view import pickable
from meshmash_viewer.app.view.render_widget import RenderWidget
from meshmash_viewer.app.view.series import Shot
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.io.session import Session, write_session
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of
from meshmash_viewer.spectral.weyl import Target

PATIENCE = 60_000
LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton


def save(path: Path, mesh: Mesh) -> Path:
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory, module_cache: Path) -> Iterator[MainWindow]:
    """Return a shared window with a sphere of 642 vertices and 20 eigenpairs."""
    run.application()
    window = MainWindow(fresh=True)
    window.show()
    path = save(tmp_path_factory.mktemp("meshes") / "ball.npz", shapes.icosphere(3))
    window.open_mesh(path)
    document = window.document
    document.solve.target = Target("count", 20)
    while document.mesh is None or document.work.job is not None:
        QTest.qWait(10)
    document.solve.compute()
    while document.spectrum is None or not document.spectrum.complete:
        QTest.qWait(10)
    yield window
    window.close()
    window.deleteLater()


# -- messages ----------------------------------------------------------------------------------


def raised(fault: Exception) -> Exception:
    try:
        raise fault
    except Exception as caught:  # noqa: BLE001  raised, for a traceback
        return caught


def test_what_can_be_mended_is_said_in_its_own_words() -> None:
    assert failure_of(raised(InputError("Give a mesh."))).text == "Give a mesh."
    full = failure_of(raised(OSError(28, "No space left on device", "/disk/a.npz")))
    assert (
        full.text
        == "/disk/a.npz: No space left on device; free the disk, or choose another folder."
    )
    assert full.correctable
    assert "close other programs" in failure_of(raised(MemoryError())).text


def test_a_defect_is_called_one_and_has_details_to_copy() -> None:
    told = failure_of(raised(KeyError("a\nb" * 500)))
    assert "defect of the program (KeyError: " in told.text
    assert "\n" not in told.text
    assert len(told.text) < 400
    assert "Traceback" in told.details
    assert not told.correctable


def test_what_a_listener_of_the_model_raised_is_told_as_itself() -> None:
    document = Document()

    def listener() -> None:
        raise InputError("Give a mesh.")

    document.pins.changed.connect(listener)
    with pytest.raises(EmitLoopError) as caught:
        document.pins.put(())
    assert failure_of(caught.value).text == "Give a mesh."


# -- the fault boundary ------------------------------------------------------------------------


@pytest.fixture
def told(qapp: QApplication) -> Iterator[list[Notice]]:
    notices: list[Notice] = []
    with FaultBoundary(notices.append):
        yield notices


def test_exceptions_of_slots_and_threads_become_notices(
    qtbot: QtBot, told: list[Notice], capfd: pytest.CaptureFixture[str]
) -> None:
    def slot() -> None:
        raise ZeroDivisionError("in a slot")

    button = QPushButton()
    qtbot.addWidget(button)
    button.clicked.connect(slot)
    QTest.mouseClick(button, LEFT)
    assert not told, "it may come from the middle of painting"
    qtbot.waitUntil(lambda: len(told) == 1)

    def work() -> None:
        raise LookupError("in a thread")

    threading.Thread(target=work).start()
    qtbot.waitUntil(lambda: len(told) == 2)

    class Task(QRunnable):
        def run(self) -> None:
            raise ArithmeticError("in a pool")

    QThreadPool.globalInstance().start(Task())
    qtbot.waitUntil(lambda: len(told) == 3)

    class Ended:
        def __del__(self) -> None:
            raise AttributeError("at the end")

    Ended()
    qtbot.waitUntil(lambda: len(told) == 4)
    for notice, words in zip(
        told, ("in a slot", "in a thread", "in a pool", "at the end"), strict=True
    ):
        assert notice.severity is Severity.ERROR
        assert words in notice.text
        assert "Traceback" in notice.details
        assert "numpy" in notice.details, "versions belong to a report"
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err


def test_what_comes_at_every_frame_is_said_once(qtbot: QtBot, told: list[Notice]) -> None:
    timer, frames = QTimer(interval=1), []

    def frame() -> None:
        frames.append(1)
        raise ZeroDivisionError("in a frame")

    timer.timeout.connect(frame)
    timer.start()
    qtbot.waitUntil(lambda: len(frames) > 20)
    timer.stop()
    assert len(told) == 1


def test_the_hooks_are_given_back(qapp: QApplication) -> None:
    before = sys.excepthook, sys.unraisablehook, threading.excepthook
    with FaultBoundary(print):
        assert sys.excepthook is not before[0]
    assert (sys.excepthook, sys.unraisablehook, threading.excepthook) == before


def test_somebody_elses_application_keeps_its_hooks(qapp: QApplication, sphere: Mesh) -> None:
    seen = []

    def look() -> None:
        seen.append(sys.excepthook)
        next(
            w for w in qapp.topLevelWidgets() if isinstance(w, MainWindow) and w.isVisible()
        ).close()

    before = sys.excepthook
    QTimer.singleShot(0, look)
    meshmash_viewer.view(sphere, block=True)
    assert seen == [before]


def test_an_exception_in_the_window_is_in_its_bar(qtbot: QtBot, shown: MainWindow) -> None:
    bar = shown.stage.message_bar
    with FaultBoundary(shown.document.notices.show):
        QTimer.singleShot(0, lambda: [][1])
        qtbot.waitUntil(bar.isVisible, timeout=PATIENCE)
    assert "defect of the program (IndexError" in bar.notice.text
    QTest.mouseClick(bar.findChild(QPushButton, "copy_details"), LEFT)
    assert "Traceback" in QApplication.clipboard().text()
    bar.dismiss()


# -- faults of background tasks ------------------------------------------------------------------


def test_a_library_that_cannot_be_loaded_is_said(
    qtbot: QtBot, qapp: QApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = importlib.import_module

    def missing(name: str) -> object:
        if name.endswith("view.mesh_view"):
            raise ImportError("libGL.so.1: cannot open shared object file")
        return real(name)

    monkeypatch.setattr(run.importlib, "import_module", missing)
    window = MainWindow(fresh=True, deferred=True)
    qtbot.addWidget(window)
    window.show()
    run.load_libraries(window)
    bar = window.stage.message_bar
    qtbot.waitUntil(bar.isVisible, timeout=PATIENCE)
    assert "libGL.so.1" in bar.notice.text
    assert "install" in bar.notice.text
    assert "Loading" not in window.stage.welcome.loading_label.text()
    window.close()


@pytest.mark.slow
def test_a_picture_that_cannot_be_drawn_is_said_and_the_next_one_is_drawn(
    qtbot: QtBot, shown: MainWindow
) -> None:
    failures: list[Failure] = []
    drawn: list[int] = []
    twin = shown.scene.renderer.twin()
    twin.view = "none"
    painter = SeriesPainter(shown)
    painter.failed.connect(failures.append)
    painter.drawn.connect(lambda at, _: drawn.append(at))
    display = shown.document.display
    for drawing in (twin, shown.scene.renderer.twin()):
        painter.start(Run(drawing, (64, 48), [Shot()], display, nullcontext(lambda *_: None)))
        qtbot.waitUntil(lambda: not painter.busy, timeout=PATIENCE)
    assert len(failures) == 1
    assert "AttributeError" in failures[0].text
    assert drawn == [0]
    shutdown(painter)


@pytest.mark.slow
def test_a_crash_of_a_driver_is_said_and_the_next_picture_is_drawn(
    qtbot: QtBot, shown: MainWindow
) -> None:
    failures: list[Failure] = []
    painter, before = SeriesPainter(shown), psutil.Process().children()
    painter.failed.connect(failures.append)
    display, done = shown.document.display, []
    painter.finished.connect(lambda: done.append(True))
    for crashing in (True, False):
        drawing = shown.scene.renderer.twin()
        sink = nullcontext(lambda *_: None)
        painter.start(Run(drawing, (640, 480), [Shot()] * 3, display, sink))
        if crashing:
            qtbot.waitUntil(lambda: len(psutil.Process().children()) > len(before))
            (child,) = set(psutil.Process().children()) - set(before)
            child.kill()
        qtbot.waitUntil(lambda: not painter.busy, timeout=PATIENCE)
    assert "graphics driver" in failures[0].text
    assert (len(failures), done) == (1, [True])
    shutdown(painter)


def test_a_task_of_the_render_that_fails_is_waited_for_no_longer(
    qtbot: QtBot, shown: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = shown.scene
    notices: list[Notice] = []
    monkeypatch.setattr(pickable, "RayTarget", lambda *_: 1 / 0)
    with FaultBoundary(notices.append):
        scene.set_mesh(scene.mesh)
        qtbot.waitUntil(lambda: bool(notices), timeout=PATIENCE)
    assert "ZeroDivisionError" in notices[0].text
    qtbot.waitUntil(lambda: scene.at_rest, timeout=PATIENCE)


def test_a_closed_window_is_let_go(qtbot: QtBot, qapp: QApplication, sphere: Mesh) -> None:
    window = meshmash_viewer.view(sphere, block=False)
    while window.document.mesh is None:
        QTest.qWait(10)
    held = weakref.ref(window.document), weakref.ref(window)
    window.close()
    del window

    def let_go() -> bool:
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        gc.collect()
        return [each() for each in held] == [None, None]

    qtbot.waitUntil(let_go)


# -- the mouse -----------------------------------------------------------------------------------


def test_a_second_button_ends_no_drag_and_leaves_none_on(shown: MainWindow) -> None:
    canvas = shown.findChild(RenderWidget)
    clicked: list[object] = []
    canvas.clicked.connect(clicked.append)
    middle = canvas.rect().center()
    QTest.mousePress(canvas, LEFT, pos=middle)
    QTest.mouseMove(canvas, middle + QPoint(40, 0))
    QTest.qWait(20)
    assert canvas.dragging
    QTest.mousePress(canvas, RIGHT, pos=middle + QPoint(40, 0))
    QTest.mouseRelease(canvas, LEFT, pos=middle + QPoint(40, 0))
    QTest.mouseRelease(canvas, RIGHT, pos=middle + QPoint(40, 0))
    assert not canvas.dragging
    QTest.mouseClick(canvas, LEFT, pos=middle)
    assert len(clicked) == 1


# -- dialogs -------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["export", slow("save_picture"), "help", slow("about")])
def test_dialogs_are_gone_when_they_have_been_answered(
    qtbot: QtBot, shown: MainWindow, command: str
) -> None:
    qtbot.waitUntil(lambda: shown.actions_[command].isEnabled(), timeout=PATIENCE)
    before = len(QApplication.allWidgets())
    for _ in range(3):
        shown.actions_[command].trigger()
        dialog = shown.findChild(QDialog)
        assert dialog.isVisible()
        QTest.keyClick(dialog, Qt.Key.Key_Escape)
        QTest.qWait(1)
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert shown.findChild(QDialog) is None
    assert len(QApplication.allWidgets()) <= before


# -- sessions ------------------------------------------------------------------------------------


def spoil(session: Path, bad: Path, entry: str, value: object) -> None:
    """Write a session with another entry."""
    content = json.loads(session.read_text())
    (content["window"] if entry == "camera" else content["meshes"][0])[entry] = value
    bad.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("entry", "value", "clause"),
    [
        ("display", {"sequential_colormap": "nonsense"}, "display.sequential_colormap"),
        ("camera", {"focus": [0, 0, 0]}, "camera"),
        ("mesh_path", "", "mesh_path"),
    ],
)
def test_a_bad_session_is_one_sentence_and_changes_nothing(
    shown: MainWindow, tmp_path: Path, entry: str, value: object, clause: str
) -> None:
    document = shown.document
    good = Session(
        mesh_path=str(document.path),
        target=Target("wavelength", 0.5),
        operator=OperatorOptions(False),
        display={"fields": {"band": {"count": 7}}},
    )
    path = tmp_path / "bad.meshmash.json"
    write_session(path, good)
    spoil(path, path, entry, value)
    before = document.ready, document.spectrum, document.solve.target, document.solve.operator
    shown.opening.open_path(path)
    notice = shown.stage.message_bar.notice
    assert notice.severity is Severity.ERROR
    assert notice.text.startswith("bad.meshmash.json has ")
    assert clause in notice.text
    assert document.work.job is None
    assert before == (
        document.ready,
        document.spectrum,
        document.solve.target,
        document.solve.operator,
    )
    assert document.display[GeometryVectors].count == 32
    shown.stage.message_bar.dismiss()


@pytest.mark.slow
def test_the_good_session_can_be_opened_after_a_bad_one(
    qtbot: QtBot, qapp: QApplication, tmp_path: Path, sphere: Mesh
) -> None:
    window = MainWindow(fresh=True)
    window.show()
    document = window.document
    mesh = save(tmp_path / "ball.npz", sphere)
    good = Session(
        mesh_path=str(mesh),
        pins=[3, 600],
        n_vertices=642,
        target=Target("count", 7),
        display={
            "kind": "band",
            "fields": {"band": {"count": 7}},
            "policies": {"band": {"policy": "MinMaxLimits"}},
        },
    )
    path, bad = tmp_path / "good.meshmash.json", tmp_path / "bad.meshmash.json"
    write_session(path, good)
    spoil(path, bad, "pins", [10**9])
    for each in (bad, path):
        window.opening.open_path(each)
    qtbot.waitUntil(lambda: len(document.pins.placed) == 2, timeout=PATIENCE)
    assert document.display[GeometryVectors].count == 7
    assert document.solve.target == Target("count", 7)
    # a session whose mesh file is missing changes nothing
    absent = tmp_path / "absent.meshmash.json"
    other = Session(mesh_path=str(tmp_path / "absent.ply"), target=Target("count", 9))
    write_session(absent, other)
    before = document.ready
    window.opening.open_path(absent)
    qtbot.waitUntil(window.stage.message_bar.isVisible, timeout=PATIENCE)
    qtbot.waitUntil(lambda: document.work.job is None, timeout=PATIENCE)
    assert document.ready is before
    assert document.solve.target == Target("count", 7)
    assert len(document.pins.placed) == 2
    window.close()
    window.deleteLater()
