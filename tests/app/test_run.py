from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import psutil
import pytest
import pyvista
import shapes
import trimesh
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication, QMessageBox, QWidget
from pytestqt.qtbot import QtBot

import meshmash_viewer
from meshmash_viewer.app import run
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.samples import sample_path

PATIENCE = 60_000


#: Script that opens a window and prints the Qt classes defined in other threads.
_CLASSES = """
import builtins, sys, threading
from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QApplication

define, elsewhere = builtins.__build_class__, []

def noted(*given, **named):
    made = define(*given, **named)
    in_interface = threading.current_thread() is threading.main_thread()
    if isinstance(made, type) and issubclass(made, QObject) and not in_interface:
        elsewhere.append(made)
    return made

def look():
    if window.loaded:
        window.close()
        QApplication.exit()

builtins.__build_class__ = noted
from meshmash_viewer.app import run
from meshmash_viewer.app.main_window import MainWindow

app = run.application()
window = MainWindow(fresh=True, deferred=True)
window.show()
run.load_libraries(window)
timer = QTimer(interval=20)
timer.timeout.connect(look)
timer.start()
app.exec()
print(window.loaded, elsewhere)
"""


@pytest.mark.slow
def test_classes_of_qt_objects_are_defined_in_the_thread_of_the_interface() -> None:
    command = [sys.executable, "-c", _CLASSES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.split("\n")[0] == "True []"


def test_the_application_opens_a_mesh_and_ends_when_its_window_is_closed(
    qtbot: QtBot, tmp_path: Path
) -> None:
    mesh = shapes.icosphere(2)
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    seen: dict[str, object] = {}

    def look() -> None:
        windows = [w for w in QApplication.topLevelWidgets() if isinstance(w, MainWindow)]
        windows = [w for w in windows if w.isVisible()]
        if not windows:
            return
        window = windows[0]
        seen.setdefault("first", (window.loaded, window.stage.welcome.isVisible()))
        if window.loaded and window.document.mesh is not None:
            seen["mesh"] = window.document.mesh
            catch_up()
            seen["page"] = window.scene.isVisible()
            window.close()

    timer = QTimer(interval=5)
    timer.timeout.connect(look)
    timer.start()
    assert run.run_app(path, "8 nm", fresh=True) == 0
    timer.stop()
    assert seen["first"] == (False, True), "the window comes before the render is loaded"
    assert seen["page"]
    assert seen["mesh"].unit == "nm"
    assert np.ptp(seen["mesh"].vertices) == pytest.approx(8 * np.ptp(mesh.vertices))


GARBAGE = """
import sys, threading, time
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from meshmash_viewer.app import run

freed = set()

class Knot:
    def __init__(self):
        self.itself = self

    def __del__(self):
        freed.add(threading.current_thread() is threading.main_thread())

def litter():
    while True:
        [Knot() for _ in range(2000)]
        time.sleep(0.01)

def look():
    window = next(w for w in QApplication.topLevelWidgets() if w.objectName() == "main_window")
    if window.loaded and not started:
        freed.clear()
        started.append(threading.Thread(target=litter, daemon=True))
        started[0].start()
    elif started and freed:
        window.close()

started = []
run.application()
timer = QTimer(interval=20)
timer.timeout.connect(look)
timer.start()
assert run.run_app(fresh=True) == 0
assert freed == {True}, "another thread has collected garbage"
print("ended")
"""


@pytest.mark.slow
def test_garbage_is_collected_in_the_interface_thread(tmp_path: Path) -> None:
    script = tmp_path / "littering.py"
    script.write_text(GARBAGE)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.stdout == "ended\n", done.stderr


CLOSED_AT_ONCE = """
import os
import shutil
from collections import namedtuple
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from meshmash_viewer.app import run

shutil.disk_usage = lambda place: namedtuple("Usage", "free")(FREE)
run.application()
print(os.environ.get("MESA_SHADER_CACHE_DISABLE"))
QTimer.singleShot(20, QApplication.closeAllWindows)
assert run.run_app(fresh=True) == 0
"""


_LARGE_AMONG_SMALL = """
import sys
import numpy as np
import psutil
from meshmash_viewer.app.run import application

if sys.argv[1] == "ours":
    application()
np.ones(3 << 20)  # 24 MB, after which glibc would keep what is smaller
before, blocks, held = psutil.Process().memory_info().rss, [], []
for _ in range(20):
    blocks.append(np.ones(1 << 20))
    held.append(np.ones(10_000))
blocks.clear()
print((psutil.Process().memory_info().rss - before) / 1e6)
"""


def test_without_a_console_a_box_says_why_there_is_no_window(qtbot: QtBot) -> None:
    seen: list[str] = []

    def look() -> None:
        box = QApplication.activeModalWidget()
        if isinstance(box, QMessageBox):
            seen.append(box.text())
            box.accept()

    timer = QTimer(interval=5)
    timer.timeout.connect(look)
    timer.start()
    run.show_message("No file matches *.ply.")
    timer.stop()
    assert seen == ["No file matches *.ply."]


@pytest.mark.slow
@pytest.mark.skipif(
    not sys.platform.startswith("linux") or not hasattr(ctypes.CDLL(None), "mallopt"),
    reason="about glibc",
)
def test_what_large_blocks_took_goes_back_to_the_system() -> None:
    def megabytes(whose: str) -> float:
        program = [sys.executable, "-c", _LARGE_AMONG_SMALL, whose]
        return float(subprocess.run(program, capture_output=True, text=True, check=True).stdout)

    assert megabytes("nobody's") > 100.0
    assert megabytes("ours") < 20.0


@pytest.mark.slow
@pytest.mark.parametrize(("free", "disabled"), [(1e6, "true"), (1e12, None)])
def test_a_window_closed_while_it_loads_ends_without_a_word(
    tmp_path: Path, free: float, disabled: str | None
) -> None:
    script = tmp_path / "closed.py"
    script.write_text(CLOSED_AT_ONCE.replace("FREE", str(free)))
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.stderr == ""
    assert done.returncode == 0
    # The shader cache of Mesa is disabled if the disk is nearly full.
    assert done.stdout == f"{disabled}\n"


ENDED_BEFORE_IT_RUNS = """
import os
import signal
from meshmash_viewer.app import main_window, run

class Window(main_window.MainWindow):
    def show(self):
        super().show()
        os.kill(os.getpid(), signal.SIGNAL)

main_window.MainWindow = Window
assert run.run_app(fresh=True) == 0
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.skipif(sys.platform == "win32", reason="ends a process there")
def test_a_window_that_is_to_end_before_its_loop_runs_ends_all_the_same(
    tmp_path: Path, name: str
) -> None:
    script = tmp_path / "ended.py"
    script.write_text(ENDED_BEFORE_IT_RUNS.replace("SIGNAL", name))
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=300, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_mesh_in_memory_is_viewed_from_a_script(qtbot: QtBot) -> None:
    ball = shapes.icosphere(2)
    window = meshmash_viewer.view((ball.vertices, ball.faces), unit="µm", name="ball", block=False)
    qtbot.waitUntil(lambda: window.document.mesh is not None, timeout=PATIENCE)
    assert window.isVisible()
    assert (window.document.mesh.name, window.document.mesh.unit) == ("ball", "µm")
    assert window in run._windows.values()
    window.close()
    assert window not in run._windows.values()


def test_the_function_that_views_is_no_folder() -> None:
    from meshmash_viewer.app.view import camera  # noqa: F401  defines the module `app.view`

    vars(meshmash_viewer).pop("view", None)
    assert meshmash_viewer.view is run.view


@pytest.mark.slow
def test_a_script_that_ends_leaves_no_process(tmp_path: Path) -> None:
    script = textwrap.dedent("""
        import numpy as np
        import meshmash_viewer
        points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
        window = meshmash_viewer.view((points, faces), block=False)
        from PySide6.QtTest import QTest
        while window.document.mesh is None:
            QTest.qWait(10)
        print(window.jobs.worker.process_id, window.jobs.worker.folder)
    """)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    pid, folder = done.stdout.split()
    assert not psutil.pid_exists(int(pid))
    assert not Path(folder).exists()


GUEST = """
import sys
from PySide6.QtCore import QTimer
from PySide6.QtGui import QFont, QPalette
from PySide6.QtWidgets import QApplication, QLabel
from threadpoolctl import threadpool_info
app = QApplication([])
host = QLabel("somebody else's window")
host.setStyleSheet("color: red")
app.setFont(QFont("Sans", 13))
host.show()
import numpy
import meshmash_viewer

def looks():
    blas = {one["filepath"]: one["num_threads"] for one in threadpool_info()}
    return (
        app.styleSheet(), app.palette().color(QPalette.ColorRole.Window).name(),
        app.palette().color(QPalette.ColorRole.WindowText).name(), app.font().toString(),
        app.style().name(), app.applicationName(), app.windowIcon().isNull(),
        sys.getswitchinterval(), sys.excepthook, host.grab().toImage(),
    ), blas

def inside():
    before, blas = looks()
    points = numpy.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = numpy.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    window = meshmash_viewer.view((points, faces))
    def wait():
        if window.document.spectrum is None and window.document.work.job is None:
            window.document.solve.compute()
        if window.controller.field is None or not window.controller.idle:
            return QTimer.singleShot(20, wait)
        for mode in ("theme_dark", "theme_light"):
            window.actions_[mode].trigger()
            after, blas_after = looks()
            changed = [pair for pair in zip(before, after) if pair[0] != pair[1]]
            print(changed, {path: blas_after[path] for path in blas} == blas)
        window.close()
        print(host.isVisible())
        app.quit()
    wait()

QTimer.singleShot(0, inside)
app.exec()
"""


@pytest.mark.slow
def test_in_somebody_elses_application_nothing_outside_the_window_changes(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", GUEST],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "MESHMASH_CACHE": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["[] True", "[] True", "True"]
    assert done.stderr == ""


@pytest.mark.slow
def test_a_script_waits_for_its_own_window_only(qtbot: QtBot) -> None:
    ball, other = shapes.icosphere(2), QWidget()
    qtbot.addWidget(other)
    other.show()

    def close() -> None:
        windows = [w for w in QApplication.topLevelWidgets() if isinstance(w, MainWindow)]
        for window in windows:
            if window.isVisible():
                window.close()

    QTimer.singleShot(100, close)
    window = meshmash_viewer.view(ball, block=True)
    assert not window.isVisible()
    assert other.isVisible()


def test_the_window_gives_its_plotter_and_what_it_shows(qtbot: QtBot) -> None:
    ball = shapes.icosphere(2)
    window = meshmash_viewer.view(ball, name="ball", block=False)
    qtbot.waitUntil(lambda: window.document.ready is not None, timeout=PATIENCE)
    assert isinstance(window.plotter, pyvista.BasePlotter)
    surface = window.to_pyvista()
    np.testing.assert_array_equal(surface.points, ball.vertices)
    np.testing.assert_array_equal(surface.regular_faces, ball.faces)
    window.close()


@pytest.mark.slow
def test_the_script_of_the_notebook_page(
    qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The script adds an actor, steps, takes pictures, and exports scenes."""
    page = Path(__file__).parents[2] / "docs" / "how_to" / "notebook.md"
    script = page.read_text(encoding="utf-8").split("```py\n")[1].split("```")[0]
    monkeypatch.chdir(tmp_path)
    exec(compile(script, page.name, "exec"), {})
    pictures = [pyvista.read(tmp_path / f"eigenfunction_{i}.png") for i in (2, 3, 4)]
    assert all(np.ptp(picture.active_scalars) > 100 for picture in pictures)
    assert len({picture.active_scalars.tobytes() for picture in pictures}) == 3
    scene = trimesh.load(tmp_path / "dendrite.gltf")
    expected = len(read_mesh(sample_path("dendrite")).faces)
    assert sum(len(mesh.faces) for mesh in scene.geometry.values()) == expected
    assert "<html" in (tmp_path / "dendrite.html").read_text(encoding="utf-8")
