"""Places of widgets: in a small window, and when texts appear."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from closed_form import give, part, rectangle_document
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QComboBox,
    QLineEdit,
    QPushButton,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot
from tiers import slow
from written_annotations import Written

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.main_window import MainWindow
from meshmash_viewer.app.view.annotations import margins
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.limits import PercentileLimits
from meshmash_viewer.progress import Progress

PATIENCE = 60_000


@pytest.fixture
def window(reopen_window: Callable[..., MainWindow]) -> MainWindow:
    """Return a window with a rectangle and its eigenpairs in closed form."""
    return reopen_window(rectangle_document(twins=slice(10, 13)), (1440, 900))


def places(window: MainWindow) -> dict[str, tuple[int, int]]:
    """Return the positions in the window of the controls of both side panels."""
    catch_up()
    QTest.qWait(50)
    kinds = (QAbstractButton, QAbstractSpinBox, QComboBox, QLineEdit)
    found = {}
    for panel in (window.mesh_panel, window.field_panel):
        for kind in kinds:
            for each in panel.findChildren(kind):
                if each.isVisible() and each.objectName() and "qt_" not in each.objectName():
                    at = each.mapTo(window, QPoint(0, 0))
                    found[each.objectName()] = at.x(), at.y()
    assert len(found) > 20
    return found


@pytest.mark.parametrize("size", [(900, 600), slow((1000, 650))])
def test_a_small_window_has_room_for_what_matters(
    qtbot: QtBot, window: MainWindow, size: tuple[int, int]
) -> None:
    window.resize(*size)
    qtbot.wait(100)
    window.resize(*size)  # the plots are tabs by now
    qtbot.wait(100)
    assert (window.width(), window.height()) == size
    inside = window.mesh_panel.findChild(QWidget, "target_count_spin").visibleRegion()
    assert inside.boundingRect() == part(window, "target_count_spin").rect()
    for name in ("spectrum", "profile"):
        dock = window.arrangement.docks[name]
        dock.raise_()
        qtbot.wait(50)
        for control in dock.widget().findChildren(QWidget):
            if control.isVisible() and isinstance(control, QAbstractButton | QComboBox):
                seen = control.visibleRegion().boundingRect()
                assert seen == control.rect(), control.objectName()
    # the title covers neither the mesh nor the number of a pin at its rim: 8 pixels about (13, 12)
    scene, document = window.scene, window.document
    title = scene.title_size.height()
    ratio = scene.devicePixelRatioF()
    beside = margins(True, round(scene.width() * ratio), round(scene.height() * ratio), ratio)
    assert beside.top / ratio - 20 >= title - 16
    tops = [scene.display_point(vertex).y() for vertex in range(document.mesh.n_vertices)]
    assert min(tops) - 20 >= title - 16
    width, height, ratio = scene.plotter.pixels()
    written = Written(scene.renderer, (width, height), ratio)
    quantity = written.texts[scene.renderer.caption.quantity][1]
    for _, below, _, tall in written.strips:  # with the unit above
        assert below + tall + 22 * ratio < quantity - 12, "the colour bar begins below the title"


@pytest.mark.slow
def test_a_narrow_window_leaves_room_for_the_render(qtbot: QtBot, window: MainWindow) -> None:
    field, mesh = window.field_panel, window.mesh_panel
    for _ in range(2):
        window.resize(900, 600)
        qtbot.waitUntil(lambda: window.scene.width() > 560, timeout=PATIENCE)
        assert mesh.visibleRegion().boundingRect() == mesh.rect()
        QTest.keyClick(window, Qt.Key.Key_2)
        qtbot.waitUntil(lambda: not field.visibleRegion().isEmpty(), timeout=PATIENCE)
        assert mesh.visibleRegion().isEmpty()
        assert part(window, "hks_time_slider").isVisible()
        window.resize(1440, 900)
        qtbot.waitUntil(lambda: not mesh.visibleRegion().isEmpty(), timeout=PATIENCE)
        assert field.mapTo(window, QPoint(0, 0)).x() > window.width() / 2
    window.arrangement.docks["label"].raise_()
    for width in (900, 1440):
        window.resize(width, 700)
        qtbot.wait(100)
        assert not window.label_panel.visibleRegion().isEmpty(), "the tab stays"


@pytest.mark.slow
def test_the_layout_of_a_small_window_is_not_that_of_a_large_one(
    qtbot: QtBot, open_window: Callable[..., MainWindow]
) -> None:
    _, state = open_window(size=(900, 600)).arrangement.save()
    window = MainWindow(fresh=True)
    qtbot.addWidget(window)
    window.resize(1440, 900)
    window.show()
    window.arrangement.restore((window.saveGeometry(), state))  # as if maximized then and now
    docks = window.arrangement.docks
    qtbot.waitUntil(lambda: not window.tabifiedDockWidgets(docks["spectrum"]), timeout=PATIENCE)
    qtbot.waitUntil(lambda: docks["profile"].width() > 300, timeout=PATIENCE)
    assert docks["spectrum"].width() > 300
    assert docks["mesh"] not in window.tabifiedDockWidgets(docks["field"])
    window.close()


def test_all_buttons_of_the_toolbar_are_in_sight_at_any_width(
    qtbot: QtBot, window: MainWindow
) -> None:
    for width, written in ((900, {"Open", "Select"}), (1440, {"Open", "Reset camera", "Help"})):
        window.resize(width, 700)
        qtbot.waitUntil(lambda: window.toolbar.sizeHint().width() <= window.width())
        shown = set()
        for action in window.toolbar.actions():
            if not action.isSeparator():
                button = window.toolbar.widgetForAction(action)
                qtbot.waitUntil(lambda: button.visibleRegion().boundingRect() == button.rect())  # noqa: B023
                if action.priority() == QAction.Priority.NormalPriority:
                    shown.add(action.iconText())
                assert button.toolTip(), "an icon alone is explained"
        assert written <= shown
    assert len(shown) == 6


@pytest.mark.parametrize("size", [(900, 600), slow((1000, 700)), slow((1440, 900))])
def test_the_first_thing_one_sees_is_not_cut_off(
    qtbot: QtBot, open_window: Callable[..., MainWindow], size: tuple[int, int]
) -> None:
    window = open_window(size=size)
    window.stage.welcome.set_recent([Path("/data") / ("neuron" * 20) / "864691135.ply"])
    qtbot.wait(50)
    assert (window.width(), window.height()) == size
    for name in ("welcome_open_button", "welcome_sample_button"):
        button = part(window, name)
        assert button.visibleRegion().boundingRect() == button.rect(), name
        assert button.width() >= button.minimumSizeHint().width(), name
    card = part(window, "welcome_card")
    middle = card.mapTo(window.stage, card.rect().center()).x()
    assert abs(middle - window.stage.width() / 2) <= 8  # at most, a scroll bar is next to it
    for link in card.findChildren(QPushButton):
        assert link.mapTo(window.stage, link.rect().bottomRight()).x() < window.stage.width()


def test_no_tab_bar_lies_over_the_menus(window: MainWindow) -> None:
    bars = window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly)
    assert [bar.tabText(0) for bar in bars if bar.isVisible()] == ["Mesh"]


def test_texts_that_appear_move_nothing(qtbot: QtBot, window: MainWindow) -> None:
    document = window.document
    before = places(window)
    document.display.change(Eigenfunctions, index=11)
    with_multiplet = places(window)
    assert before.items() <= with_multiplet.items()
    before = with_multiplet
    assert part(window, "multiplet_label").isVisible()
    give(part(window, "limit_low_field"), "1e9")
    assert places(window) == before, "limits the wrong way round"
    document.display.set_limits(PercentileLimits())
    with_percentiles = places(window)
    assert before.items() <= with_percentiles.items()
    document.display.set_limits(None)
    spin = part(window, "target_count_spin")
    for text in ("99999", "300"):
        spin.setFocus()
        spin.selectAll()
        QTest.keyClicks(spin, text)
        QTest.keyClick(spin, Qt.Key.Key_Tab)
        assert places(window) == before, text
    document.work.started(Job("Decomposing", "", print))
    for message in ("ordering", "the iteration, of which there is a good deal to be said " * 2):
        document.work.progressed(Progress("solve", 0.3, 88.0, message))
        assert places(window) == before, message
        assert part(window, "progress_label").isVisible()
    document.work.ended()
    assert places(window) == before
    document.display.kind = "hks"
    before = places(window)
    give(part(window, "hks_t_min_field"), "1e4")
    assert before.items() <= places(window).items()
    assert part(window, "hks_missing_label").isVisible()
    give(part(window, "hks_t_max_field"), "1")
    assert before.items() <= places(window).items(), "a range the wrong way round"


@pytest.mark.slow
def test_a_pin_is_pointed_at_in_list_plot_and_render_together(
    qtbot: QtBot, window: MainWindow
) -> None:
    document, scene = window.document, window.scene
    for vertex in (25, 200):
        document.pins.toggle(vertex)
    qtbot.waitUntil(lambda: window.findChild(QWidget, "pin_row_200") is not None)
    qtbot.waitUntil(lambda: scene.can_pick and len(window.profile_panel._curves) == 2)
    qtbot.wait(50)
    row, ring = part(window, "pin_row_200"), part(window, "hover_ring")

    def held_over(widget: QWidget, at: QPoint) -> None:
        # move the pointer twice: a picture that is drawn late ends the hover
        QTest.mouseMove(widget, at)
        QTest.mouseMove(widget, at + QPoint(1, 0))

    def ringed() -> bool:
        held_over(row, row.rect().center())
        return bool((ring.geometry().center() - scene.display_point(200)).manhattanLength() <= 2)

    def listed() -> bool:
        held_over(ring.parentWidget(), scene.display_point(25))
        return bool(part(window, "pin_row_25").property("role") == "pointed")

    QTest.mouseMove(window, QPoint(3, 3))
    qtbot.waitUntil(lambda: ringed() and ring.isVisible(), timeout=PATIENCE)
    qtbot.waitUntil(listed, timeout=PATIENCE)
    assert row.property("role") != "pointed"


def test_a_panel_stays_where_it_is_when_its_title_is_clicked_twice(window: MainWindow) -> None:
    for dock in window.arrangement.docks.values():
        title = dock.titleBarWidget()
        QTest.mouseDClick(title, Qt.MouseButton.LeftButton, pos=title.rect().center())
        assert not dock.isFloating()
        QTest.mouseClick(title, Qt.MouseButton.LeftButton)  # leaves no button pressed


def test_units_in_their_list_have_room(qtbot: QtBot, window: MainWindow) -> None:
    combo = part(window, "unit_combo")
    assert isinstance(combo, QComboBox)
    QTest.mouseClick(
        combo, Qt.MouseButton.LeftButton, pos=QPoint(combo.width() - 8, combo.height() // 2)
    )
    rows = combo.view()
    qtbot.waitUntil(rows.isVisible)
    letters = rows.fontMetrics()
    places = [rows.visualRect(rows.model().index(index, 0)) for index in range(combo.count())]
    for above, below in itertools.pairwise(places):
        assert below.top() - above.top() >= 1.4 * letters.height()
    for index, place in enumerate(places):
        assert place.width() >= letters.horizontalAdvance(combo.itemText(index)) + 6
        assert rows.viewport().rect().contains(place), "all of them are in view"
    combo.hidePopup()
