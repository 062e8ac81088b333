"""Conventions of macOS and Windows, by the events that Qt sends there."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from PySide6.QtCore import QEvent, QPointF, Qt, QUrl
from PySide6.QtGui import QFileOpenEvent, QKeySequence, QNativeGestureEvent, QPointingDevice
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import actions
from meshmash_viewer.app.actions import COMMANDS, native_keys, native_text
from meshmash_viewer.app.dialogs.help_dialog import HelpDialog
from meshmash_viewer.app.main_window import MainWindow

PATIENCE = 60_000

#: Qt's symbols of keys on macOS.
MACOS = {"Ctrl": "⌘", "Shift": "⇧", "Alt": "⌥", "Esc": "⎋", "Return": "↩", "PgDown": "⇟"}


def as_on_macos(sequence: QKeySequence) -> str:
    parts = sequence.toString(QKeySequence.SequenceFormat.PortableText).split("+")
    return "".join(MACOS.get(part, part) for part in parts)


@pytest.fixture
def macos(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(actions, "_native", as_on_macos)


# Names of keys --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "on_macos"),
    [
        ("Ctrl + wheel", "⌘ + wheel"),
        ("Shift + drag, or right button", "⇧ + drag, or right button"),
        ("Ctrl + Shift + drag", "⌘ + ⇧ + drag"),
        ("Ctrl + wheel or PgDn: ten", "⌘ + wheel or ⇟: ten"),
        ("Shift", "Shift"),  # the action, not the key
        ("Altitude, Escher", "Altitude, Escher"),
        ("", ""),
    ],
)
def test_keys_in_texts_have_their_native_names(
    text: str, on_macos: str, monkeypatch: pytest.MonkeyPatch, qapp: QApplication
) -> None:
    assert native_text(text).replace("PgDown", "PgDn") == text
    monkeypatch.setattr(actions, "_native", as_on_macos)
    assert native_text(text) == on_macos


def test_sequences_have_their_native_names(macos: None) -> None:
    assert native_keys("Ctrl+O") == "⌘O"
    assert native_keys("Ctrl+Shift+O", QKeySequence("Esc")) == "⌘⇧O, ⎋"
    assert native_keys() == ""


def texts(widget: QWidget) -> list[str]:
    """Return all texts of a widget and its children."""
    found = []
    for each in (widget, *widget.findChildren(QWidget), *widget.actions()):
        for name in ("text", "toolTip", "statusTip", "placeholderText", "title", "whatsThis"):
            if callable(read := getattr(each, name, None)):
                found.append(str(read()))
    return found


@pytest.mark.slow
def test_nothing_in_the_window_names_keys_of_another_system(
    macos: None, open_window: Callable[..., MainWindow]
) -> None:
    window = open_window()
    help_dialog = HelpDialog(window)
    shown = texts(window) + texts(help_dialog)
    rows = [
        help_dialog.tree.topLevelItem(row) for row in range(help_dialog.tree.topLevelItemCount())
    ]
    shown += [
        group.child(row).text(column)
        for group in rows
        for row in range(group.childCount())
        for column in range(3)
    ]
    assert "Drop one on the window, or press ⌘O." in shown
    assert "Decompose the mesh (⌘↩)" in shown
    assert "⌘ + wheel" in shown
    assert [text for text in shown if re.search(r"\bCtrl\b|\bShift ?\+", text)] == []
    help_dialog.deleteLater()


# Full screen ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("qapp")
def test_full_screen_has_the_key_of_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    (command,) = (each for each in COMMANDS if each.name == "full_screen")
    standard = QKeySequence.keyBindings(QKeySequence.StandardKey.FullScreen)
    assert command.sequences()[: len(standard)] == standard
    assert QKeySequence("F11") in command.sequences()
    for found, wanted in (
        (["Ctrl+Meta+F"], ["Ctrl+Meta+F", "F11"]),  # macOS
        (["F11", "Alt+Return"], ["F11", "Alt+Return"]),  # Windows
        (["Ctrl+F11"], ["Ctrl+F11", "F11"]),  # GNOME
        ([], ["F11"]),
    ):
        bindings = [QKeySequence(text) for text in found]
        monkeypatch.setattr(QKeySequence, "keyBindings", lambda _, found=bindings: found)
        assert command.sequences() == [QKeySequence(text) for text in wanted]


def test_the_menu_follows_the_button_of_the_window(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On macOS, a button of the window frame fills the screen without the command."""
    action = window.actions_["full_screen"]
    with monkeypatch.context() as patch:
        for state in (True, False):
            patch.setattr(window, "isFullScreen", lambda state=state: state)
            QApplication.sendEvent(window, QEvent(QEvent.Type.WindowStateChange))
            assert action.isChecked() == state
    QTest.keyClick(window, Qt.Key.Key_F11)
    qtbot.waitUntil(window.isFullScreen, timeout=PATIENCE)
    assert action.isChecked()
    QTest.keyClick(window, Qt.Key.Key_F11)
    qtbot.waitUntil(lambda: not window.isFullScreen(), timeout=PATIENCE)
    assert not action.isChecked()
    QTest.keyClick(window, Qt.Key.Key_F11)
    qtbot.waitUntil(window.isFullScreen, timeout=PATIENCE)
    window.stage.setFocus()
    QTest.keyClick(window.stage, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: not window.isFullScreen(), timeout=PATIENCE)
    assert not action.isChecked()


# Files opened from the desktop -----------------------------------------------------------------


def saved(path: Path, level: int) -> Path:
    mesh = shapes.icosphere(level)
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


def shows(window: MainWindow, path: Path) -> bool:
    ready = window.document.ready
    return ready is not None and ready.path == path and window.document.work.job is None


@pytest.mark.slow
def test_files_that_are_double_clicked_open(
    qapp: QApplication, qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    for name in ("ball.npz", "two words.npz", "Kügelchen λ.npz", "50 %41.npz"):
        path = saved(tmp_path / name, 1)
        for handed in (str(path), QUrl.fromLocalFile(str(path))):
            assert QApplication.sendEvent(qapp, QFileOpenEvent(handed))
            qtbot.waitUntil(lambda path=path: shows(window, path), timeout=PATIENCE)
    for handed in ("", QUrl("https://example.org/mesh.ply")):  # not files
        QApplication.sendEvent(qapp, QFileOpenEvent(handed))
        assert window.document.work.job is None
    first, second = saved(tmp_path / "a.npz", 1), saved(tmp_path / "b.npz", 2)
    for path in (first, second):
        QApplication.postEvent(qapp, QFileOpenEvent(str(path)))
    qtbot.waitUntil(lambda: shows(window, second), timeout=PATIENCE)
    QApplication.sendEvent(qapp, QFileOpenEvent(str(tmp_path / "gone.ply")))
    bar = window.stage.message_bar
    qtbot.waitUntil(lambda: "gone.ply" in getattr(bar.notice, "text", ""), timeout=PATIENCE)
    assert shows(window, second)


def test_without_a_window_nothing_happens(qapp: QApplication, tmp_path: Path) -> None:
    QApplication.sendEvent(qapp, QFileOpenEvent(str(saved(tmp_path / "a.npz", 1))))


# Pinches --------------------------------------------------------------------------------------


def pinch(window: MainWindow, value: float, at: QPointF, kind: str = "Zoom") -> bool:
    canvas = window.plotter
    event = QNativeGestureEvent(
        getattr(Qt.NativeGestureType, f"{kind}NativeGesture"),
        QPointingDevice.primaryPointingDevice(),
        2,
        at,
        at,
        QPointF(canvas.mapToGlobal(at.toPoint())),
        value,
        QPointF(),
    )
    return QApplication.sendEvent(canvas, event)


def test_a_pinch_zooms_about_its_place(qtbot: QtBot, window: MainWindow) -> None:
    assert pinch(window, 0.1, QPointF(10.0, 10.0)), "nothing to zoom yet"
    window.document.take_mesh(shapes.icosphere(3))
    qtbot.waitUntil(
        lambda: window.document.ready is not None and window.document.work.job is None,
        timeout=PATIENCE,
    )
    scene, canvas = window.scene, window.plotter
    qtbot.waitUntil(lambda: scene.renderer.view is not None, timeout=PATIENCE)
    at = QPointF(0.7 * canvas.width(), 0.3 * canvas.height())
    width, height, _ = canvas.pixels()
    under = scene.renderer.view.from_pixels(*canvas.to_pixels(at.x(), at.y()), width, height)
    before = scene.renderer.view.half_size
    for value in (0.05, 0.1, 0.02, -0.03, 0.0, 0.2):
        pinch(window, value, at)
    factor = 1.05 * 1.1 * 1.02 * 0.97 * 1.2
    view = scene.renderer.view
    assert view.half_size == pytest.approx(before / factor)
    again = view.from_pixels(*canvas.to_pixels(at.x(), at.y()), width, height)
    np.testing.assert_allclose(again, under, atol=1e-9)
    for value in (-1.0, -7.0):
        pinch(window, value, at)
    for kind in ("Rotate", "Begin", "End", "Pan", "SmartZoom", "Swipe"):
        pinch(window, 0.5, at, kind)
    assert scene.renderer.view.half_size == view.half_size
