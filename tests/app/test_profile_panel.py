from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapes
from closed_form import rectangle_document, rectangle_spectrum, shown
from PySide6.QtCore import QPoint, QRegularExpression, Qt
from PySide6.QtGui import QContextMenuEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel, QToolButton, QWidget

from meshmash_viewer.app.panels.profile_panel import ProfilePanel
from meshmash_viewer.features.filter_responses import hks_times
from meshmash_viewer.features.filters import bspline_bank
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature, resolved_from
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.health import mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pins import Pin

LEFT = Qt.MouseButton.LeftButton
pytestmark = pytest.mark.usefixtures("shown_at_once")


@pytest.fixture
def document() -> Document:
    return rectangle_document()


@pytest.fixture
def panel(qtbot, document: Document) -> ProfilePanel:
    panel = shown(qtbot, ProfilePanel(document), 700, 260)
    yield panel
    panel.close()


def curves(panel: ProfilePanel, document: Document, qtbot) -> dict[int, tuple]:
    """Wait for all profiles; return the dots of each pinned vertex."""
    qtbot.waitUntil(lambda: len(panel._curves) == len(document.pins.placed), timeout=5000)
    return {pin.vertex: dots.getData() for pin, (_, dots) in panel._curves.items()}


def test_says_what_to_do_until_something_is_pinned(panel: ProfilePanel, document, qtbot) -> None:
    assert panel.empty.isVisible()
    assert panel.empty.text() == "Click a vertex on the render to compare its profile."
    document.pins.toggle(5)
    assert panel.plot.isVisible()
    document.pins.clear()
    assert panel.empty.isVisible()


def test_hks_over_time_is_the_direct_sum(panel: ProfilePanel, document, qtbot) -> None:
    document.display.kind = "hks"
    document.pins.toggle(5)
    document.pins.toggle(300)
    spectrum = document.spectrum
    times = hks_times(spectrum.eigenvalues)
    for vertex, (x, y) in curves(panel, document, qtbot).items():
        truth = np.exp(-np.outer(times, spectrum.eigenvalues)) @ spectrum.rows[:, vertex] ** 2
        assert 10**x == pytest.approx(times)
        assert 10**y == pytest.approx(truth, rel=1e-10)
    assert panel.plot.labels[0] == "Time t (nm²)"
    assert panel.plot.labels[1] == "HKS (nm⁻²)"


def test_bands_and_coefficients(panel: ProfilePanel, document, qtbot) -> None:
    document.pins.toggle(42)
    spectrum, display = document.spectrum, document.display
    values = spectrum.rows[:, 42]
    display.change(Eigenfunctions, flipped=frozenset({3}))
    x, y = curves(panel, document, qtbot)[42]
    assert y[3] == -values[3]
    assert np.array_equal(np.delete(y, 3), np.delete(values, 3))
    display.kind = "band"
    x, y = curves(panel, document, qtbot)[42]
    bank = bspline_bank(*display[GeometryVectors].range(spectrum), display[GeometryVectors].count)
    assert np.array_equal(x, np.arange(32))
    assert y == pytest.approx(bank(spectrum.eigenvalues) @ values**2)


def test_current_time_is_marked_and_what_needs_more_pairs_hatched(
    panel: ProfilePanel, document, qtbot
) -> None:
    display = document.display
    display.kind = "hks"
    document.pins.toggle(5)
    curves(panel, document, qtbot)
    assert not panel._missing.isVisible()
    display.change(HeatKernelSignature, t_min=1e5)
    display.change(HeatKernelSignature, t_max=1e8)
    display.change(HeatKernelSignature, automatic=False)
    assert 10 ** np.array(panel._missing.getRegion()) == pytest.approx(
        [1e5, resolved_from(document.spectrum)]
    )
    assert panel.missing_label.isVisible()
    display.change(HeatKernelSignature, time=3e6)
    assert 10 ** panel._marker.value() == pytest.approx(3e6)
    display.change(HeatKernelSignature, time=3e4)
    assert 10 ** panel._marker.value() == pytest.approx(3e4), "shorter than the shortest time"


def test_a_click_puts_that_time_on_the_render(panel: ProfilePanel, document, qtbot) -> None:
    document.display.kind = "hks"
    document.pins.toggle(5)
    curves(panel, document, qtbot)
    low, high = document.display[HeatKernelSignature].range(document.spectrum)
    QTest.qWait(80)
    (_, _), (bottom, top) = panel.plot.viewRange()
    x = np.log10(low * (high / low) ** 0.8)
    at = panel.plot.pixel_of(x, bottom + 0.9 * (top - bottom)).toPoint()
    QTest.mouseMove(panel.plot.viewport(), at)
    QTest.mouseClick(panel.plot.viewport(), LEFT, pos=at)
    assert np.log10(document.display[HeatKernelSignature].time) == pytest.approx(x, abs=0.02)


def test_profiles_grow_with_the_spectrum(qtbot) -> None:
    document = rectangle_document(converged=30)
    panel = ProfilePanel(document)
    qtbot.addWidget(panel)
    panel.show()
    document.pins.toggle(7)
    assert len(curves(panel, document, qtbot)[7][0]) == 30
    document.accept_spectrum(rectangle_spectrum(document.mesh, 120))
    qtbot.waitUntil(lambda: len(curves(panel, document, qtbot)[7][0]) == 120, timeout=5000)


def test_legend_names_the_pins_in_their_colours_and_takes_them_away(
    panel: ProfilePanel, document, qtbot
) -> None:
    document.pins.toggle(5)
    document.pins.toggle(300)
    drawn = curves(panel, document, qtbot)
    assert set(drawn) == {5, 300}
    for pin, (_, dots) in panel._curves.items():
        assert dots.opts["brush"].color().name().upper() == pin.color
    cross = panel.findChild(QToolButton, "unpin_button_5")
    QTest.mouseClick(cross, LEFT)
    assert [pin.vertex for pin in document.pins.placed] == [300]
    assert set(curves(panel, document, qtbot)) == {300}
    document.pins.toggle(7)  # takes number 1, as number 2 is still used

    def told(name: str) -> dict[str, str]:
        labels = panel.findChildren(QLabel, QRegularExpression(f"^{name}_"))
        return {each.objectName().rsplit("_", 1)[1]: each.text() for each in labels}

    qtbot.waitUntil(lambda: told("pin_number") == {"7": "<b>1</b>", "300": "<b>2</b>"})
    assert told("pin_label") == {"7": "Vertex 7", "300": "Vertex 300"}
    document.pins.change("rename", 300, name="a spine on the apical dendrite")
    assert told("pin_label")["300"].endswith("…")
    label = panel.findChildren(QLabel, "pin_label_300")[-1]
    assert label.parentWidget().toolTip() == "a spine on the apical dendrite"


def test_a_vertex_on_no_face_has_no_profile(panel: ProfilePanel, document, qtbot) -> None:
    document.spectrum.rows[:, 9] = np.nan
    document.pins.toggle(9)
    assert len(curves(panel, document, qtbot)[9][0]) == 0
    assert panel.empty.isVisible()
    assert panel.empty.text().startswith("No pin has a value")
    document.pins.toggle(5)
    curves(panel, document, qtbot)
    assert panel.plot.isVisible()


def test_bands_are_counted_in_whole_numbers(panel: ProfilePanel, document, qtbot) -> None:
    document.display.change(GeometryVectors, count=6)
    document.display.kind = "band"
    document.pins.toggle(9)
    curves(panel, document, qtbot)
    axis = panel.plot.getAxis("bottom")
    ticks = [value for _, level in axis.tickValues(3.0, 6.0, 600.0) for value in level]
    assert ticks == [3.0, 4.0, 5.0, 6.0]
    document.display.kind = "eigenfunction"
    curves(panel, document, qtbot)
    assert all(value % 1 == 0 for _, level in axis.tickValues(3.0, 6.0, 600.0) for value in level)


def test_few_enough_eigenfunctions_are_in_view_to_be_told_apart(qtbot) -> None:
    document = rectangle_document(300)
    panel = shown(qtbot, ProfilePanel(document), 700, 260)
    for vertex in (5, 42, 100, 200, 300):
        document.pins.toggle(vertex)
    for index in (0, 130, 299):
        document.display.change(Eigenfunctions, index=index)
        curves(panel, document, qtbot)
        first, last = panel.plot.viewRange()[0]
        assert first < index < last
        assert last - first <= 65
    assert panel.plot.getAxis("bottom").isVisible()
    QTest.mouseClick(panel.plot.fit_button, LEFT)
    QTest.qWait(60)
    first, last = panel.plot.viewRange()[0]
    assert first <= 0
    assert last >= 299
    document.display.change(Eigenfunctions, index=20)
    assert panel.plot.viewRange()[0] == [first, last], "what was asked for stays"
    panel.close()


def test_a_pin_that_is_pointed_at_is_brought_forward(panel: ProfilePanel, document, qtbot) -> None:
    document.display.kind = "hks"
    document.pins.toggle(5)
    document.pins.toggle(300)
    curves(panel, document, qtbot)
    told: list[int] = []
    panel.pin_pointed.connect(told.append)

    def strengths() -> dict[int, float]:
        return {
            pin.vertex: curve.opts["pen"].color().alphaF()
            for pin, (curve, _) in panel._curves.items()
        }

    rows = {vertex: panel.findChild(QWidget, f"pin_row_{vertex}") for vertex in (5, 300)}
    assert strengths() == {5: 1.0, 300: 1.0}
    QTest.mouseMove(rows[300], rows[300].rect().center())
    qtbot.waitUntil(lambda: told == [300])
    assert strengths()[300] > 2 * strengths()[5]
    depths = {pin.vertex: curve.zValue() for pin, (curve, _) in panel._curves.items()}
    assert depths[300] > depths[5]
    assert (rows[5].property("role") or "", rows[300].property("role")) == ("", "pointed")
    # point at the first dot of the other curve, which lies far above
    QTest.qWait(60)
    (curve,) = (curve for pin, (curve, _) in panel._curves.items() if pin.vertex == 5)
    x, y = (float(values[0]) for values in curve.getData())
    at = panel.plot.pixel_of(x, y).toPoint()
    QTest.mouseMove(panel.plot.viewport(), at + QPoint(1, 0))
    QTest.mouseMove(panel.plot.viewport(), at)
    qtbot.waitUntil(lambda: told[-1] == 5)
    assert strengths()[5] > 2 * strengths()[300]
    QTest.mouseMove(panel.empty.window(), QPoint(3, 3))
    qtbot.waitUntil(lambda: told[-1] == -1)
    assert strengths() == {5: 1.0, 300: 1.0}
    QTest.mouseMove(rows[300], rows[300].rect().center())
    qtbot.waitUntil(lambda: told[-1] == 300)
    QTest.mouseClick(panel.findChild(QToolButton, "unpin_button_300"), LEFT)
    assert strengths() == {5: 1.0}, "nothing is pointed at any more"


def test_a_spectrum_of_zeros_alone_has_no_profile(panel: ProfilePanel, document, qtbot) -> None:
    """During a decomposition, the zero eigenvalue may be the only known one."""
    document.display.kind = "wks"
    document.pins.toggle(5)
    assert np.isfinite(curves(panel, document, qtbot)[5][1]).all()
    whole = document.spectrum
    zeros = replace(
        whole,
        eigenvalues=whole.eigenvalues[:1],
        rows=whole.rows[:1],
        residuals=whole.residuals[:1],
    )
    document.spectrum = zeros
    document.display.change(WaveKernelSignature, index=3)  # before the signal of the spectrum
    assert len(curves(panel, document, qtbot)[5][0]) == 0


def test_each_family_shows_profiles_that_are_in_the_list(panel: ProfilePanel, document) -> None:
    for name in FAMILIES:
        document.display.kind = name
        assert panel.view_choice.currentText(), name
    assert panel.view_choice.currentData() == "eigenfunction", "maps have none of their own"


def test_the_table_is_there_without_eigenpairs(qtbot) -> None:
    document = rectangle_document()
    document.accept_mesh(replace(document.ready, known=None))
    panel = shown(qtbot, ProfilePanel(document), 700, 260)
    document.pins.set("pins", [Pin(5, 1, "soma"), Pin(300, 2)])
    assert panel.empty.isVisible()
    QTest.mouseClick(panel.table_check, LEFT)
    assert panel.table.isVisible()
    assert [panel.table.model().index(row, 1).data() for row in range(2)] == ["soma", ""]
    assert [panel.table.model().index(row, 2).data() for row in range(2)] == ["5", "300"]
    document.pins.clear()
    assert panel.empty.isVisible()
    panel.close()


def test_a_right_click_on_a_line_of_the_legend_asks_for_its_menu(
    panel: ProfilePanel, document
) -> None:
    document.pins.set("pins", [Pin(5, 1, "soma"), Pin(300, 2)])
    asked: list[int] = []
    panel.menu_requested.connect(lambda vertex, _place: asked.append(vertex))
    line = panel.findChild(QWidget, "pin_row_5")
    at = line.rect().center()
    reason = QContextMenuEvent.Reason.Mouse
    QApplication.sendEvent(line, QContextMenuEvent(reason, at, line.mapToGlobal(at)))
    assert asked == [5]
    assert panel.findChild(QLabel, "pin_label_5").text() == "soma"


def test_the_plot_has_most_of_a_narrow_panel(panel: ProfilePanel, document, qtbot) -> None:
    document.pins.set("pins", [Pin(5, 1, "soma"), Pin(300, 2)])
    curves(panel, document, qtbot)
    named, wide = panel.findChild(QLabel, "pin_label_300"), panel.width()
    qtbot.waitUntil(named.isVisible)
    panel.resize(280, 180)  # as in a window of 900 × 600
    qtbot.waitUntil(lambda: panel.plot.width() >= 180)
    assert not named.isVisible()
    cross = panel.findChild(QToolButton, "unpin_button_300")
    corner = cross.mapTo(panel, cross.rect().bottomRight())
    assert panel.rect().contains(corner)
    panel.resize(wide, 260)
    qtbot.waitUntil(named.isVisible)


def test_an_index_of_many_digits_is_legible(qtbot) -> None:
    flat = shapes.rectangle(60, 30, 60.0, 30.0)
    mesh = Mesh(flat.vertices, flat.faces, unit="nm")
    document = Document()
    document.accept_mesh(MeshReady(mesh, mesh_health(mesh), mesh.vertex_normals))
    panel = shown(qtbot, ProfilePanel(document), 700, 260)
    document.pins.set("pins", [Pin(1111, 1), Pin(1196, 2), Pin(7, 3, "a name of many words")])
    labels = [panel.findChild(QLabel, f"pin_label_{vertex}") for vertex in (1111, 1196, 7)]
    assert [each.text() for each in labels[:2]] == ["Vertex 1,111", "Vertex 1,196"]
    assert labels[2].text().endswith("…")
    assert labels[2].parentWidget().toolTip() == "a name of many words"
    qtbot.waitUntil(lambda: all(each.width() >= each.sizeHint().width() for each in labels))
    panel.close()
