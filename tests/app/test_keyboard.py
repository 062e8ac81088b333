"""Window without a mouse: controls by Tab, commands by menu, and names for screen readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
from closed_form import rectangle_document
from PySide6.QtCore import QPoint, QRect, Qt
from PySide6.QtGui import QAccessible, QAccessibleInterface, QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QScrollArea,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import MENUS
from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.fields import FAMILIES

PATIENCE = 60_000
CONTROLS = (QAbstractButton, QAbstractSlider, QAbstractSpinBox, QComboBox, QLineEdit, QTabBar)
#: Accessible roles of the controls that a user operates.
ROLES = {
    QAccessible.Role.Button, QAccessible.Role.CheckBox, QAccessible.Role.RadioButton,
    QAccessible.Role.ComboBox, QAccessible.Role.SpinBox, QAccessible.Role.Slider,
    QAccessible.Role.EditableText, QAccessible.Role.PageTab, QAccessible.Role.ProgressBar,
    QAccessible.Role.MenuItem,
}  # fmt: skip


@pytest.fixture
def window(qtbot: QtBot, reopen_window: Callable[..., MainWindow]) -> MainWindow:
    """Return a window with a rectangle, its eigenpairs in closed form, and two pins."""
    window = reopen_window(rectangle_document(), (1440, 900))
    for vertex in (25, 200):
        window.document.pins.toggle(vertex)
    qtbot.waitUntil(lambda: window.findChild(QWidget, "pin_row_200") is not None)
    catch_up()
    return window


def by_tab(window: MainWindow) -> list[QWidget]:
    """Return the widgets that Tab focuses, in order, until it returns to the first."""
    window.stage.setFocus()
    stops: list[QWidget] = []
    while True:
        QTest.keyClick(window, Qt.Key.Key_Tab)
        now = QApplication.focusWidget()
        if now is None or now in stops or len(stops) > 200:
            return stops
        stops.append(now)


def place(window: MainWindow, widget: QWidget) -> QRect:
    return QRect(widget.mapTo(window, QPoint(0, 0)), widget.size())


def around(window: MainWindow, widget: QWidget) -> np.ndarray:
    """Return a picture of a widget with its focus frame, and without selected text."""
    if isinstance(widget, QLineEdit):
        widget.deselect()
    elif isinstance(widget, QAbstractSpinBox | QComboBox) and widget.findChild(QLineEdit):
        widget.findChild(QLineEdit).deselect()
    picture = window.grab(place(window, widget).adjusted(-3, -3, 3, 3)).toImage()
    picture.convertTo(QImage.Format.Format_RGB32)
    return np.array(picture.constBits()).reshape(picture.height(), -1, 4)


@pytest.mark.slow
def test_tab_comes_to_every_control_and_shows_where_it_is(qtbot: QtBot, window: MainWindow) -> None:
    looks = [(theme.Mode.LIGHT, name) for name in FAMILIES] + [(theme.Mode.DARK, "hks")]
    seen: set[str] = set()
    for mode, kind in looks:
        theme.set_mode(mode)
        window.document.display.kind = kind
        catch_up()
        qtbot.wait(100)
        stops = tab_through(window)
        new = [stop for stop in stops if f"{mode} {stop.objectName()}" not in seen]
        seen |= {f"{mode} {stop.objectName()}" for stop in new}
        for stop in new:
            for area in window.findChildren(QScrollArea):
                if area.isAncestorOf(stop):
                    area.ensureWidgetVisible(stop)  # as Tab does
            stop.setFocus(Qt.FocusReason.TabFocusReason)
            focused = around(window, stop)
            window.stage.setFocus()
            changed = np.any(focused != around(window, stop), axis=2).sum()
            assert changed > 40 * window.devicePixelRatio(), stop.objectName()


def test_a_letter_after_an_arrow_in_a_list_is_a_command(qtbot: QtBot, window: MainWindow) -> None:
    combo = window.findChild(QComboBox, "limits_combo")
    combo.setFocus()
    QTest.keyClick(combo, Qt.Key.Key_Down)
    with qtbot.waitSignal(window.actions_["view_lateral"].triggered):
        QTest.keyClick(combo, Qt.Key.Key_X)
    QTest.keyClicks(combo, "lx")
    assert combo.currentText() == "Locked", "letters after a letter search the list"


def tab_through(window: MainWindow) -> list[QWidget]:
    """Return the stops of Tab; check for missing controls and for reading order."""
    stops = by_tab(window)
    for control in window.findChildren(QWidget):
        inner = isinstance(control.parent(), QAbstractSpinBox | QComboBox | QTabBar)
        if not isinstance(control, CONTROLS) or inner or control.parent() is window.toolbar:
            continue
        if not control.isVisible() or not control.isEnabled() or not control.objectName():
            continue
        if control.focusPolicy() == Qt.FocusPolicy.NoFocus:
            assert control.objectName().endswith("dock_close"), control.objectName()
            continue
        group = control.group() if isinstance(control, QAbstractButton) else None
        same = group.buttons() if group is not None and group.exclusive() else [control]
        assert set(same) & set(stops), control.objectName()
    # panel by panel, and in reading order within a panel
    panels = (window.mesh_panel, window.field_panel, window.spectrum_panel, window.profile_panel)
    tabs = [stop for stop in stops if isinstance(stop, QTabBar)]
    assert [bar.count() for bar in tabs] == [4], "Mesh, Shape, Compare and Labels share a place"
    inside = [stop for stop in stops if stop not in tabs]
    at = [next(n for n, each in enumerate(panels) if each.isAncestorOf(stop)) for stop in inside]
    assert at == sorted(at)
    for number, panel in enumerate(panels):
        stops_here = [stop for stop, n in zip(inside, at, strict=True) if n == number]
        # skip widgets that are scrolled out of view
        mine = [place(window, stop) for stop in stops_here if not stop.visibleRegion().isEmpty()]
        for above, below in pairwise(mine):
            beside = above.left() < below.left() and panel is not window.mesh_panel
            assert above.center().y() <= below.center().y() + 8 or beside, (above, below)
    return stops


def walk(found: QAccessibleInterface) -> Iterator[QAccessibleInterface]:
    yield found
    for at in range(found.childCount()):
        child = found.child(at)
        if child is not None and child.isValid():
            yield from walk(child)


def test_a_screen_reader_has_a_name_for_everything(window: MainWindow) -> None:
    heard: dict[str, int] = {}
    for found in walk(QAccessible.queryAccessibleInterface(window)):
        state, role = found.state(), found.role()
        if role not in ROLES or state.invisible:
            continue
        thing = found.object()
        if thing is not None and "qt_" in thing.objectName():
            continue
        if isinstance(thing, QLineEdit) and isinstance(thing.parent(), QComboBox):
            thing = thing.parent()
        # for a list, Qt on Linux returns the chosen entry as text; its name is accessibleName()
        listed = isinstance(thing, QComboBox)
        name = thing.accessibleName() if listed else found.text(QAccessible.Text.Name)
        assert name.strip(" ×…"), (role, thing)
        heard[name] = heard.get(name, 0) + 1
    for name in ("Number of eigenpairs", "Eigenfunction", "Colour map", "Compute eigenpairs"):
        assert name in heard, name
    assert len(heard) > 40


def test_every_menu_opens_by_its_letter(qtbot: QtBot, window: MainWindow) -> None:
    window.stage.setFocus()
    for name in MENUS:
        menu = window.menus[name]
        letter = menu.title()[menu.title().index("&") + 1].upper()
        QTest.keyClick(window, getattr(Qt.Key, f"Key_{letter}"), Qt.KeyboardModifier.AltModifier)
        qtbot.waitUntil(menu.isVisible)
        QTest.keyClick(menu, Qt.Key.Key_Down)
        assert menu.activeAction() in menu.actions()
        QTest.keyClick(menu, Qt.Key.Key_Escape)
        QTest.keyClick(window.menuBar(), Qt.Key.Key_Escape)
        assert not menu.isVisible()
