"""Plots saved and copied from their menu, in light colours for paper."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from closed_form import rectangle_document
from PIL import Image
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QContextMenuEvent, QGuiApplication, QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QMenu, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import theme
from meshmash_viewer.app.executor import is_idle
from meshmash_viewer.app.main_window import MainWindow

LEFT, RIGHT = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton
PATIENCE = 60_000


@pytest.fixture
def window(qtbot: QtBot, reopen_window: Callable[..., MainWindow]) -> MainWindow:
    """A window with a rectangle and two pins, in the dark theme."""
    window = reopen_window(rectangle_document(), (1200, 800))
    theme.set_mode(theme.Mode.DARK)
    for vertex in (20, 70):
        window.document.pins.toggle(vertex)
    qtbot.waitUntil(lambda: is_idle(window.profile_panel), timeout=PATIENCE)
    rested(qtbot, window.spectrum_panel)
    return window


def rested(qtbot: QtBot, widget: QWidget) -> QImage:
    """Return the picture of a widget once it no longer changes."""

    def rests() -> bool:
        before = widget.grab().toImage()
        qtbot.wait(200)
        return widget.grab().toImage() == before

    qtbot.waitUntil(rests, timeout=PATIENCE)
    return widget.grab().toImage()


def saved(qtbot: QtBot, window: MainWindow, plot: QWidget, path: Path) -> Path:
    """Save a plot by a right click, "Save this plot…", a file name, and Return."""
    QTest.mouseClick(plot.viewport(), RIGHT, pos=plot.rect().center())
    choose(qtbot, plot, "save_plot")
    qtbot.waitUntil(lambda: bool(window.findChildren(QDialog, "plot_dialog")), timeout=PATIENCE)
    (dialog,) = window.findChildren(QDialog, "plot_dialog")
    edit = dialog.file_row.edit
    QTest.mouseClick(edit, LEFT)
    edit.selectAll()
    QTest.keyClicks(edit, str(path))
    QTest.keyClick(edit, Qt.Key.Key_Return)
    qtbot.waitUntil(path.exists, timeout=PATIENCE)
    qtbot.waitUntil(lambda: not window.findChildren(QDialog, "plot_dialog"), timeout=PATIENCE)
    return path


def choose(qtbot: QtBot, plot: QWidget, name: str) -> None:
    qtbot.waitUntil(lambda: bool(plot.findChildren(QMenu, "plot_menu")), timeout=PATIENCE)
    (menu,) = plot.findChildren(QMenu, "plot_menu")
    (action,) = [each for each in menu.actions() if each.objectName() == name]
    QTest.mouseClick(menu, LEFT, pos=menu.actionGeometry(action).center())
    qtbot.waitUntil(lambda: not plot.findChildren(QMenu, "plot_menu"), timeout=PATIENCE)


@pytest.mark.slow
def test_the_spectrum_is_saved_as_vectors_pixels_and_numbers(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    spectrum = window.document.spectrum
    window.document.spectrum = spectrum.with_measured(np.geomspace(1e-3, 0.2, len(spectrum)))
    window.document.spectrum_changed.emit()
    plot, spectrum = window.spectrum_panel.plot, window.document.spectrum
    svg = saved(qtbot, window, plot, tmp_path / "a.svg").read_text(encoding="utf-8")
    before = rested(qtbot, plot)
    shown = "".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg))
    for text in ("Index", "λ (µm⁻²)", "Weyl’s law"):
        assert text in shown
    assert "<image" not in svg, "vectors alone"
    pdf = saved(qtbot, window, plot, tmp_path / "a.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/ToUnicode" in pdf, "its text can be selected"
    assert b"/Subtype /Image" not in pdf
    saved(qtbot, window, plot, tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.info["dpi"][0] == pytest.approx(300.0, abs=0.1)
        assert picture.getpixel((2, picture.height - 2)) == (255, 255, 255), "light on paper"
    with saved(qtbot, window, plot, tmp_path / "a.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["series", "Index", "λ (nm⁻²)", "mesh_error"]
    errors = [float(row[3]) for row in rows if row[0] == "eigenvalue"]
    np.testing.assert_array_equal(errors, spectrum.mesh_errors)
    found = [float(row[2]) for row in rows if row[0] == "eigenvalue"]
    np.testing.assert_array_equal(found, spectrum.eigenvalues)
    assert rested(qtbot, plot) == before, "and is as it was on the screen"


@pytest.mark.slow
def test_profiles_and_responses_are_numbers_too(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    window.document.display.kind = "hks"
    window.wait(60.0)
    qtbot.waitUntil(lambda: is_idle(window.profile_panel), timeout=PATIENCE)
    qtbot.wait(100)
    plot = window.profile_panel.plot
    with saved(qtbot, window, plot, tmp_path / "a.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))[1:]
    first = np.array([row[1:] for row in rows if row[0] == "pin 1"], dtype=float)
    assert {row[0] for row in rows} == {"pin 1", "pin 2"}
    spectrum, time = window.document.spectrum, first[3, 0]
    wanted = np.exp(-spectrum.eigenvalues * time) @ spectrum.rows[:, 20] ** 2
    assert first[3, 1] == pytest.approx(wanted, rel=1e-5)
    svg = saved(qtbot, window, plot, tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "pin 2" in svg
    # the menu key opens the menu as well
    plot = window.spectrum_panel.plot
    where = plot.rect().center()
    key = QContextMenuEvent.Reason.Keyboard
    QApplication.sendEvent(plot, QContextMenuEvent(key, where, plot.mapToGlobal(where)))
    QGuiApplication.clipboard().clear()
    choose(qtbot, plot, "copy_plot")
    image = QGuiApplication.clipboard().image()
    assert image.width() == pytest.approx(plot.width() * 300 / 96, abs=1)
    assert image.pixelColor(QPoint(1, image.height() - 2)).name() == "#ffffff"
