"""Command palette (Ctrl+K): commands, settings and families are found by name or synonym."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from closed_form import rectangle_document
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QLabel, QLineEdit, QTreeWidget, QWidget
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import COMMANDS
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields import FAMILIES


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    return reopen_window(rectangle_document(), (1440, 900))


def palette(window: MainWindow) -> QDialog:
    QTest.keyClick(window, Qt.Key.Key_K, Qt.KeyboardModifier.ControlModifier)
    (dialog,) = (each for each in window.findChildren(QDialog, "command_palette"))
    return dialog


def rows(dialog: QDialog, text: str) -> list[str]:
    search = dialog.findChild(QLineEdit, "palette_search")
    assert search is not None
    search.clear()
    QTest.keyClicks(search, text)
    listed = dialog.findChild(QTreeWidget, "palette_list")
    assert listed is not None
    items = (listed.topLevelItem(at) for at in range(listed.topLevelItemCount()))
    return [item.text(0) for item in items if item is not None]


def close(dialog: QDialog) -> None:
    dialog.reject()
    QApplication.processEvents()


WORDS = {
    "turn": "Rotate", "shift": "Pan", "save image": "Save picture", "theme": "Dark",
    "screenshot": "Save picture", "video": "Save movie", "shortcuts": "Help", "load": "Open mesh",
    "hks": "heat kernel", "stop": "Cancel", "colour map": "Colour map",
    "number of eig": "eigenpairs", "smooth": "Own maps", "smoothing": "Filter",
    "colour bar": "Limits", "threshold": "Limits", "montage": "Gallery",
}  # fmt: skip


def test_other_words_find_it(window: MainWindow) -> None:
    dialog = palette(window)
    for typed, found in WORDS.items():
        assert any(found.casefold() in row.casefold() for row in rows(dialog, typed)), typed
    close(dialog)


@pytest.mark.slow
def test_every_command_and_family_is_found_by_its_name(window: MainWindow) -> None:
    dialog = palette(window)
    names = [each.text.rstrip("…") for each in COMMANDS if each.name != "command_palette"]
    for name in [*names, *(family.label for family in FAMILIES.values())]:
        assert any(name in row for row in rows(dialog, name)), name
    close(dialog)


@pytest.mark.slow
def test_the_rows_fill_the_list(window: MainWindow) -> None:
    dialog = palette(window)
    listed = dialog.findChild(QTreeWidget, "palette_list")
    last = listed.visualItemRect(listed.topLevelItem(listed.topLevelItemCount() - 1))
    assert 0 <= listed.viewport().height() - last.bottom() < last.height()
    close(dialog)


@pytest.mark.slow
def test_the_text_stays_in_its_place_while_it_is_typed(window: MainWindow) -> None:
    dialog, places = palette(window), set()
    for typed in ("e", "similar", "export pins", "no such thing"):
        rows(dialog, typed)
        QApplication.processEvents()
        search = dialog.findChild(QLineEdit, "palette_search")
        assert search is not None
        places.add(search.y())
    assert len(places) == 1
    close(dialog)


def test_nothing_found_says_so(window: MainWindow) -> None:
    dialog = palette(window)
    assert rows(dialog, "xyzzy") == []
    label = dialog.findChild(QLabel, "palette_nothing")
    assert label is not None
    assert label.isVisible()
    QTest.keyClick(dialog.findChild(QLineEdit, "palette_search"), Qt.Key.Key_Return)
    assert dialog.isVisible()
    close(dialog)


@pytest.mark.slow
def test_enter_runs_and_what_was_run_comes_first(window: MainWindow, qtbot: QtBot) -> None:
    dialog = palette(window)
    rows(dialog, "night")
    QTest.keyClick(dialog.findChild(QLineEdit, "palette_search"), Qt.Key.Key_Return)
    assert theme.is_dark()
    QApplication.processEvents()
    dialog = palette(window)
    assert rows(dialog, "")[0].startswith("Dark")
    rows(dialog, "always light")
    QTest.keyClick(dialog.findChild(QLineEdit, "palette_search"), Qt.Key.Key_Return)
    assert not theme.is_dark()


def run(window: MainWindow, text: str) -> None:
    dialog = palette(window)
    assert rows(dialog, text)
    QTest.keyClick(dialog.findChild(QLineEdit, "palette_search"), Qt.Key.Key_Return)
    QApplication.processEvents()


def test_panels_and_what_is_behind_another_tab_are_found(window: MainWindow, qtbot: QtBot) -> None:
    for typed, name in (("vibration", "shape"), ("health", "mesh"), ("shape", "shape")):
        run(window, typed)
        panel = window.findChild(QWidget, f"{name}_panel")
        assert panel is not None
        qtbot.waitUntil(panel.isVisible)
    run(window, "unit of")
    qtbot.waitUntil(lambda: window.focusWidget().objectName() == "unit_combo")
    assert window.focusWidget().isVisible()


def test_a_setting_gets_the_focus(window: MainWindow, qtbot: QtBot) -> None:
    dialog = palette(window)
    assert rows(dialog, "unit of")
    QTest.keyClick(dialog.findChild(QLineEdit, "palette_search"), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: window.focusWidget() is not window.stage)
    focused = window.focusWidget()
    assert isinstance(focused, QWidget)
    assert "unit" in focused.accessibleName().casefold()
