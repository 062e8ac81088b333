"""What tests of widgets share."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import listening, theme
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.run import application
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.worker import Worker


@pytest.fixture(scope="session")
def qapp() -> QApplication:
    return application()


class Waiting(QtBot):
    """Waits at least two minutes for what is awaited: the machine may be slow and busy."""

    def waitUntil(self, callback: Callable[[], bool | None], *, timeout: int = 0) -> None:
        """Handle events until the condition holds."""
        super().waitUntil(callback, timeout=max(timeout, 120_000))

    def waitSignal(self, signal: Any, *, timeout: int = 0, **given: Any) -> Any:
        """Handle events until the signal is emitted."""
        return super().waitSignal(signal, timeout=max(timeout, 120_000), **given)


@pytest.fixture
def qtbot(qapp: QApplication, request: pytest.FixtureRequest) -> QtBot:
    return Waiting(request)


@pytest.fixture(scope="module", autouse=True)
def jobs_in_threads() -> Iterator[None]:
    """Run jobs in a thread: a process of its own for each window takes two seconds to start."""
    Worker.in_process = True
    yield
    Worker.in_process = False  # for the tests of other folders in the same process


@pytest.fixture
def own_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run jobs in a process of their own, as the program does."""
    monkeypatch.setattr(Worker, "in_process", False)


@pytest.fixture(scope="module")
def module_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where a window that the tests of a file share keeps its eigenpairs."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("MESHMASH_CACHE", str(folder))
        yield folder


@pytest.fixture(autouse=True)
def own_cache(
    request: pytest.FixtureRequest, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A cache for each test, or that of the window which the tests of its file share."""
    if "module_cache" not in request.fixturenames:
        return own_cache
    folder: Path = request.getfixturevalue("module_cache")
    monkeypatch.setenv("MESHMASH_CACHE", str(folder))
    return folder


@pytest.fixture
def open_window(qapp: QApplication, qtbot: QtBot) -> Iterator[Callable[..., MainWindow]]:
    """Opens windows, in front and with their first field, if there is any; closes them again."""
    opened = []

    def open_one(
        document: Document | None = None, size: tuple[int, int] | None = None
    ) -> MainWindow:
        window = MainWindow(document, fresh=True)
        opened.append(window)
        if size is not None:
            window.resize(*size)
        window.show()
        window.activateWindow()
        qtbot.waitUntil(window.isActiveWindow, timeout=60_000)
        qtbot.waitUntil(lambda: window.controller.idle, timeout=60_000)
        return window

    yield open_one
    for window in opened:
        window.close()
        window.deleteLater()
    theme.set_mode(theme.Mode.SYSTEM)


@pytest.fixture
def window(open_window: Callable[..., MainWindow]) -> MainWindow:
    """A window in which nothing is open."""
    return open_window()


@pytest.fixture(scope="module", autouse=True)
def all_garbage() -> Iterator[None]:
    """Delete and collect what the tests of a file have left."""
    yield
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    gc.collect()


@pytest.fixture(autouse=True)
def garbage() -> Iterator[None]:
    """Collect it in the interface's thread: others might free widgets of the test before."""
    gc.disable()
    yield
    gc.collect(1)


@pytest.fixture
def shown_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let widgets show the model without the event loop: for tests of what they show."""
    monkeypatch.setattr(listening._Turns, "note", lambda _turns, held: listening._call(held))
