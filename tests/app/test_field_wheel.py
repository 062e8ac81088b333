"""Wheel over a field: the panel scrolls, unless the field has the focus."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from closed_form import rectangle_document
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QScrollArea,
    QScrollBar,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot

from meshmash_viewer.app.controls import field_events
from meshmash_viewer.app.dialogs.export_dialog import ExportDialog, PiecesDialog
from meshmash_viewer.app.dialogs.figure_dialog import FigureDialog
from meshmash_viewer.app.dialogs.gallery_dialog import GalleryDialog
from meshmash_viewer.app.dialogs.movie_dialog import MovieDialog
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.model.limits import PercentileLimits

DOWN, SIDE, STILL = QPoint(0, -120), QPoint(-120, 0), QPoint()
NO_PHASE = Qt.ScrollPhase.NoScrollPhase
NONE, CONTROL = Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ControlModifier
#: Angle, pixels, phase and modifiers of a mouse, a fine wheel, and a trackpad with momentum.
TURNS = (
    (DOWN, STILL, NO_PHASE, NONE),
    (-DOWN, STILL, NO_PHASE, NONE),
    (DOWN, STILL, NO_PHASE, CONTROL),
    (QPoint(0, -960), STILL, NO_PHASE, NONE),
    *((QPoint(0, -60), STILL, NO_PHASE, NONE),) * 3,
    (SIDE, STILL, NO_PHASE, NONE),
    (STILL, QPoint(0, -30), NO_PHASE, NONE),
    (STILL, STILL, Qt.ScrollPhase.ScrollBegin, NONE),
    (DOWN, QPoint(0, -40), Qt.ScrollPhase.ScrollUpdate, NONE),
    (DOWN, QPoint(0, -40), Qt.ScrollPhase.ScrollMomentum, NONE),
    (STILL, STILL, Qt.ScrollPhase.ScrollEnd, NONE),
)


@pytest.fixture
def window(qtbot: QtBot, reopen_window: Callable[..., MainWindow]) -> MainWindow:
    window = reopen_window(rectangle_document(), (1300, 800))
    for vertex in (3, 9, 30):
        window.document.pins.toggle(vertex)
    window.document.display.policies = {"hks": PercentileLimits()}
    catch_up()
    return window


def fields(within: QWidget) -> list[QWidget]:
    kinds = (QComboBox, QAbstractSpinBox, QAbstractSlider, QTabBar)
    found = [each for each in within.findChildren(QWidget) if isinstance(each, kinds)]
    return [each for each in found if not isinstance(each, QScrollBar)]


def state(field: QWidget) -> object:
    if isinstance(field, QComboBox):
        return field.currentIndex(), field.currentText()
    if isinstance(field, QTabBar):
        return field.currentIndex()
    return field.value() if isinstance(field, QAbstractSlider) else field.text()


def turn(
    field: QWidget,
    angle: QPoint = DOWN,
    pixels: QPoint = STILL,
    phase: Qt.ScrollPhase = NO_PHASE,
    modifiers: Qt.KeyboardModifier = NONE,
) -> None:
    middle = field.rect().center()
    event = QWheelEvent(
        QPointF(middle), QPointF(field.mapToGlobal(middle)), pixels, angle,
        Qt.MouseButton.NoButton, modifiers, phase, False,
    )  # fmt: skip
    QApplication.sendEvent(field, event)


def turn_really(field: QWidget, angle: QPoint = DOWN) -> None:
    """Turn the wheel as the window system does, which finds the widget and may focus it."""
    window = field.window()
    place = field.mapTo(window, field.rect().center())
    QTest.wheelEvent(window.windowHandle(), QPointF(place), angle)
    catch_up()


def check(field: QWidget) -> None:
    before, name = state(field), field.objectName()
    for each in TURNS:
        turn(field, *each)
    catch_up()
    assert state(field) == before, name
    assert not field.hasFocus(), name
    assert field.focusPolicy() != Qt.FocusPolicy.WheelFocus, name


@pytest.mark.slow
def test_no_field_of_the_window_changes_without_the_focus(window: MainWindow, qtbot: QtBot) -> None:
    document, seen = window.document, set()
    window.stage.setFocus()
    for kind in FAMILIES:
        document.display.kind = kind
        window.wait(60.0)
        catch_up()
        before = (
            document.display,
            document.solve.target,
            document.unit_text,
            document.solve.operator,
        )
        for field in fields(window):
            if field.objectName() not in seen or field.objectName().startswith("limit"):
                check(field)
            seen.add(field.objectName())
        assert before == (
            document.display, document.solve.target, document.unit_text, document.solve.operator
        )  # fmt: skip
    assert len(seen) > 50


@pytest.mark.slow
def test_nor_does_one_of_a_dialog(window: MainWindow, qtbot: QtBot, tmp_path) -> None:
    document, scene = window.document, window.scene
    dialogs: list[QDialog] = [
        ExportDialog(document, tmp_path, window),
        FigureDialog(tmp_path / "a", list, window),
        PiecesDialog(document, tmp_path, window),
        GalleryDialog(document, scene, window),
        MovieDialog(document, scene, tmp_path / "a", window),
    ]
    for dialog in dialogs:
        found = fields(dialog)
        assert found, dialog.objectName()
        for field in found:
            check(field)
        dialog.reject()
        dialog.deleteLater()


def test_the_panel_scrolls_instead(window: MainWindow, qtbot: QtBot) -> None:
    area = window.mesh_panel.findChild(QScrollArea)
    bar = area.verticalScrollBar()
    assert bar.maximum() > 100
    for way in (turn, turn_really):
        for name in ("unit_combo", "target_count_spin", "target_time_spin"):
            window.stage.setFocus()
            field = window.findChild(QWidget, name)
            bar.setValue(20)
            QTest.qWait(1)
            before = state(field)
            way(field)
            assert bar.value() > 20, name
            assert state(field) == before, name
            assert window.stage.hasFocus(), name


def test_a_field_with_the_focus_takes_it(window: MainWindow, qtbot: QtBot) -> None:
    for name in ("unit_combo", "target_count_spin", "limits_combo", "eigenvector_slider"):
        field = window.findChild(QWidget, name)
        field.setFocus()
        before = state(field)
        turn_really(field)
        assert state(field) != before, name


def test_a_list_takes_a_step_a_notch_and_none_of_momentum(window: MainWindow) -> None:
    combo = window.findChild(QComboBox, "limits_combo")
    combo.setFocus()
    for _ in range(9):
        turn(combo, QPoint(0, -30))
    assert combo.currentIndex() == 2
    turn(combo, DOWN, phase=Qt.ScrollPhase.ScrollMomentum)
    assert combo.currentIndex() == 2


def test_a_field_that_is_scrolled_under_the_pointer_is_not_changed(
    window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(field_events, "_TURN", 10**9)  # as on a slow machine
    field = window.findChild(QWidget, "target_time_spin")
    area = window.mesh_panel.findChild(QScrollArea)
    field.setFocus()
    before = state(field)
    turn_really(window.findChild(QWidget, "mesh_area_label"))
    assert area.verticalScrollBar().value() > 0
    turn_really(field)
    assert state(field) == before, "it is one turn of the wheel"
    monkeypatch.setattr(field_events, "_TURN", 0)
    turn_really(field)
    assert state(field) != before


@pytest.mark.slow
def test_tabs_that_come_later_are_watched(window: MainWindow, qtbot: QtBot) -> None:
    docks = window.arrangement.docks
    window.tabifyDockWidget(docks["spectrum"], docks["profile"])
    QTest.qWait(20)
    bars = [each for each in window.findChildren(QTabBar) if each.count() > 1]
    assert len(bars) == 2
    for each in bars:
        check(each)
