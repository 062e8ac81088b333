from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import psutil
import pytest
import shapes
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

import meshmash_viewer
from meshmash_viewer.app import run
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow

PATIENCE = 60_000


@pytest.fixture(scope="session")
def qapp() -> QApplication:
    return run.application()


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
    from meshmash_viewer.app.view import camera  # noqa: F401  which makes `app.view` a name

    vars(meshmash_viewer).pop("view", None)
    assert meshmash_viewer.view is run.view


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
        print(window.tasks.worker.process_id, window.tasks.worker.folder)
    """)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    pid, folder = done.stdout.split()
    assert not psutil.pid_exists(int(pid))
    assert not Path(folder).exists()
