"""Fixtures shared by the tests of widgets."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from closed_form import part
from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import listening, theme
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.panels.field_panel import FieldPanel
from meshmash_viewer.app.run import application
from meshmash_viewer.app.view import frames
from meshmash_viewer.io import raw
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.solve import DEFAULT_TARGET
from meshmash_viewer.model.worker import Worker


@pytest.fixture(scope="session")
def qapp() -> QApplication:
    return application()


class Waiting(QtBot):
    """QtBot whose timeouts are at least two minutes, for slow and busy machines."""

    def waitUntil(self, callback: Callable[[], bool | None], *, timeout: int = 0) -> None:
        super().waitUntil(callback, timeout=max(timeout, 120_000))

    def waitSignal(self, signal: Any, *, timeout: int = 0, **given: Any) -> Any:
        return super().waitSignal(signal, timeout=max(timeout, 120_000), **given)


@pytest.fixture
def qtbot(qapp: QApplication, request: pytest.FixtureRequest) -> QtBot:
    return Waiting(request)


@pytest.fixture(scope="module", autouse=True)
def jobs_in_threads() -> Iterator[None]:
    """Run jobs and readers in threads, since starting processes takes seconds."""
    Worker.in_process = raw._watched = True
    yield
    Worker.in_process = raw._watched = False  # for tests of other folders in this process


@pytest.fixture(autouse=True)
def single_samples(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw frames without multisampling, except in tests of pixels.

    Multisampling takes a fifth of the processor time of tests with windows.
    """
    if request.node.get_closest_marker("pixels") is None:
        monkeypatch.setattr(frames, "SAMPLES", 0)


@pytest.fixture
def own_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run jobs and readers in processes, as the program does."""
    monkeypatch.setattr(Worker, "in_process", False)
    monkeypatch.setattr(raw, "_watched", False)


@pytest.fixture(scope="module")
def module_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the cache folder of a window shared by the tests of a module."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("MESHMASH_CACHE", str(folder))
        yield folder


@pytest.fixture(autouse=True)
def own_cache(
    request: pytest.FixtureRequest, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Return a cache folder for the test, or the folder of the window shared by its module."""
    if "module_cache" not in request.fixturenames:
        return own_cache
    folder: Path = request.getfixturevalue("module_cache")
    monkeypatch.setenv("MESHMASH_CACHE", str(folder))
    return folder


def bring_up(window: MainWindow, size: tuple[int, int] | None, qtbot: QtBot) -> None:
    """Show a window in front and wait for its first field, if it shows a mesh."""
    if size is not None:
        window.resize(*size)
    window.show()
    window.raise_()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    qtbot.waitUntil(lambda: window.controller.idle)


def reset_display(document: Document) -> None:
    """Reset what a document displays to the defaults, without a step of its history."""
    first = Display()
    with document.history.paused():
        document.display.put(*first.fields.values())
        for each in fields(Display):
            if each.name != "fields":
                setattr(document.display, each.name, getattr(first, each.name))


def start_afresh(window: MainWindow, shown: Document | None, qtbot: QtBot) -> None:
    """Reset a window to its defaults and show another mesh with its eigenpairs."""
    document = window.document
    document.work.cancel()
    qtbot.waitUntil(lambda: document.work.job is None and window.controller.idle)
    theme.set_mode(theme.Mode.SYSTEM)
    window.opening.end_comparison()
    window.showNormal()
    window.arrangement.reset()
    window.select_tool.mode = "brush"
    window.select_tool.through = window.select_tool.connected = False
    window.select_tool.select(False)
    reset_display(document)
    document.solve.operator, document.solve.target = OperatorOptions(), DEFAULT_TARGET
    document.solve.seconds_rate = None
    if shown is not None:
        document.accept_mesh(shown.ready)
    if shown is not None and shown.spectrum is not None:
        document.accept_spectrum(shown.spectrum)
    part(window, "pin_table_check").setChecked(False)
    window.stage.message_bar.dismiss()
    window.stage.setFocus()
    catch_up()


@pytest.fixture(scope="module")
def kept_document() -> Document:
    """Return the document of the panel of `reopen_panel`."""
    return Document()


@pytest.fixture(scope="module")
def kept_panel(qapp: QApplication, kept_document: Document) -> Iterator[FieldPanel]:
    """Return a field panel shared by the tests of a module."""
    panel = FieldPanel(kept_document)
    panel.resize(340, 760)
    panel.show()
    yield panel
    panel.close()
    panel.deleteLater()


@pytest.fixture
def reopen_panel(
    kept_panel: FieldPanel, kept_document: Document
) -> Iterator[Callable[[Document], FieldPanel]]:
    """Return a function that shows the mesh and the eigenpairs of a document in a shared panel.

    A new panel takes 0.4 s. Letters typed into lists by two tests are not one word.
    """
    interval = QApplication.keyboardInputInterval()
    QApplication.setKeyboardInputInterval(0)

    def reopen(shown: Document) -> FieldPanel:
        reset_display(kept_document)
        kept_document.accept_mesh(shown.ready)
        kept_document.accept_spectrum(shown.spectrum)
        kept_document.solve.operator = OperatorOptions()
        kept_document.solve.target = DEFAULT_TARGET
        kept_panel.activateWindow()
        catch_up()
        return kept_panel

    yield reopen
    QApplication.setKeyboardInputInterval(interval)


@pytest.fixture(scope="module")
def kept_windows(qapp: QApplication) -> Iterator[list[MainWindow]]:
    """Return a list for the window of `reopen_window`; close this window at the end."""
    kept: list[MainWindow] = []
    yield kept
    for window in kept:
        window.close()
        window.deleteLater()


@pytest.fixture
def reopen_window(
    kept_windows: list[MainWindow], qtbot: QtBot
) -> Iterator[Callable[..., MainWindow]]:
    """Return a function that shows the mesh of a document in a window shared by a module.

    The window is reset by `start_afresh`, which takes a second. Without a document, the previous
    mesh stays, for tests that open a file.
    """

    def reopen(shown: Document | None = None, size: tuple[int, int] = (1440, 900)) -> MainWindow:
        if kept_windows:
            start_afresh(kept_windows[0], shown, qtbot)
        else:
            kept_windows.append(MainWindow(shown, fresh=True))
        bring_up(kept_windows[0], size, qtbot)
        return kept_windows[0]

    yield reopen
    for widget in QApplication.topLevelWidgets():
        if widget.isVisible() and widget not in kept_windows:
            widget.close()  # a menu or a dialog


@pytest.fixture
def open_window(qapp: QApplication, qtbot: QtBot) -> Iterator[Callable[..., MainWindow]]:
    """Return a function that opens a window in front; close all its windows at the end."""
    opened = []

    def open_one(
        document: Document | None = None, size: tuple[int, int] | None = None
    ) -> MainWindow:
        window = MainWindow(document, fresh=True)
        opened.append(window)
        bring_up(window, size, qtbot)
        return window

    yield open_one
    for window in opened:
        window.close()
        window.deleteLater()
    theme.set_mode(theme.Mode.SYSTEM)


@pytest.fixture
def window(open_window: Callable[..., MainWindow]) -> MainWindow:
    """Return a window without a mesh."""
    return open_window()


@pytest.fixture(scope="module", autouse=True)
def all_garbage() -> Iterator[None]:
    """Delete the widgets and collect the garbage that the tests of a module leave."""
    yield
    for widget in QApplication.topLevelWidgets():
        if isinstance(widget, MainWindow):  # a change of theme takes a second for each window
            widget.deleteLater()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    gc.collect()
    gc.freeze()  # later collections skip the remaining objects, such as modules


@pytest.fixture(autouse=True)
def garbage() -> Iterator[None]:
    """Collect garbage in the GUI thread only, as other threads must not free widgets."""
    gc.disable()
    yield
    gc.collect(1)


@pytest.fixture
def shown_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Update widgets as soon as the model changes, without the event loop."""
    monkeypatch.setattr(listening._Turns, "note", lambda _turns, held: listening._call(held))
