from __future__ import annotations

import math

import numpy as np
import pytest
from closed_form import drag, rectangle_document, rectangle_spectrum, shown, turn_wheel
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QToolButton

from meshmash_viewer.app import theme
from meshmash_viewer.app.panels.spectrum_panel import SpectrumPanel
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.weyl import weyl_eigenvalue

LEFT = Qt.MouseButton.LeftButton
pytestmark = pytest.mark.usefixtures("shown_at_once")


@pytest.fixture
def document() -> Document:
    return rectangle_document()


@pytest.fixture
def panel(qtbot, document: Document) -> SpectrumPanel:
    panel = shown(qtbot, SpectrumPanel(document), 700, 260)
    QTest.qWait(80)  # painting sets the range of the plot
    return panel


def place(panel: SpectrumPanel, x: float, y: float) -> QPoint:
    """Return the viewport position of a point of the plot."""
    QTest.qWait(60)
    return panel.plot.pixel_of(x, y).toPoint()


def click(panel: SpectrumPanel, x: float, y: float) -> None:
    at = place(panel, x, y)
    QTest.mouseMove(panel.plot.viewport(), at)
    QTest.mouseClick(panel.plot.viewport(), LEFT, pos=at)
    QTest.qWait(20)


def test_draws_every_eigenvalue_and_weyls_law(panel: SpectrumPanel, document) -> None:
    view, values = panel.view, document.spectrum.eigenvalues
    x, y = view.points.getData()
    assert np.array_equal(x, np.arange(1, 120))
    assert np.array_equal(y, values[1:])
    assert view.zeros.getData()[0].tolist() == [0.0]
    x, y = view.weyl.getData()
    assert y[-1] == pytest.approx(weyl_eigenvalue(document.mesh.area, x[-1]))
    assert panel.plot.labels[1] == "λ (nm⁻²)"


def test_equal_eigenvalues_have_a_band(qtbot) -> None:
    document = rectangle_document(twins=slice(12, 16))
    panel = shown(qtbot, SpectrumPanel(document), 700, 260)
    x, y = panel.view.multiplets.getData()
    assert x.tolist() == [12.0, 15.0]
    assert y.tolist() == [document.spectrum.eigenvalues[12]] * 2
    assert "equal" in panel.view.legend()
    document.accept_spectrum(rectangle_spectrum(document.mesh, 120))
    assert not len(panel.view.multiplets.getData()[0])
    assert "equal" not in panel.view.legend()


def test_a_click_puts_that_eigenfunction_on_the_render(panel: SpectrumPanel, document) -> None:
    click(panel, 80, 1e-7)
    assert document.display[Eigenfunctions].index == 80
    assert panel.view.marker.value() == 80
    assert panel.view.current.getData()[0].tolist() == [80.0]
    assert panel.readout.text().startswith("λ₈₀ = ")


def test_the_marker_can_be_dragged_along(panel: SpectrumPanel, document) -> None:
    document.display.change(Eigenfunctions, index=20)
    height = document.spectrum.eigenvalues[-1] / 2
    way = [place(panel, x, height) for x in (20, 30, 50, 60)]
    drag(panel.plot.viewport(), *way)
    assert abs(document.display[Eigenfunctions].index - 60) <= 1


def test_it_grows_without_moving_its_axis(qtbot) -> None:
    document = rectangle_document(converged=30)
    panel = shown(qtbot, SpectrumPanel(document), 700, 260)
    QTest.qWait(80)
    before = panel.plot.viewRange()[0]
    document.accept_spectrum(rectangle_spectrum(document.mesh, 120, converged=70))
    QTest.qWait(80)
    assert len(panel.view.points.getData()[0]) == 69
    assert panel.plot.viewRange()[0] == pytest.approx(before)


def test_zero_modes_have_a_place_in_log_scale(panel: SpectrumPanel, document) -> None:
    panel.log_check.setChecked(True)
    _, y = panel.view.zeros.getData()
    assert np.isfinite(y).all()
    assert y[0] < math.log10(document.spectrum.eigenvalues[1])
    _, y = panel.view.points.getData()
    assert y == pytest.approx(np.log10(document.spectrum.eigenvalues[1:]))


def test_ends_of_the_bands_are_dragged_on_the_spectrum(panel: SpectrumPanel, document) -> None:
    display = document.display
    display.kind = "band"
    last = document.spectrum.eigenvalues[-1]
    way = [place(panel, share * last, 0.85) for share in (1.0, 0.9, 0.7, 0.6)]
    drag(panel.plot.viewport(), *way)
    assert not display[GeometryVectors].automatic
    assert display[GeometryVectors].high == pytest.approx(0.6 * last, rel=0.02)
    assert display[GeometryVectors].low == 0.0
    assert panel.view.high.value() == pytest.approx(display[GeometryVectors].high)


def test_the_low_end_is_dragged_where_the_first_band_is_held(
    panel: SpectrumPanel, document
) -> None:
    display, last = document.display, document.spectrum.eigenvalues[-1]
    display.kind = "band"
    display.change(GeometryVectors, index=0)
    grip = float(panel.plot.viewRange()[1][1]) - 0.08
    drag(panel.plot.viewport(), *[place(panel, share * last, grip) for share in (0, 0.1, 0.2, 0.3)])
    assert display[GeometryVectors].low == pytest.approx(0.3 * last, rel=0.05)
    assert display[GeometryVectors].index == 0
    # below the grips, a drag moves the band instead
    centers = display[GeometryVectors].centers(document.spectrum)
    low = display[GeometryVectors].low
    drag(panel.plot.viewport(), *[place(panel, centers[band], 0.4) for band in (0, 4, 8, 9)])
    assert (display[GeometryVectors].low, display[GeometryVectors].index) == (low, 9)


def test_ends_that_are_dragged_stay_where_pairs_are_between_them(
    panel: SpectrumPanel, document
) -> None:
    display, values = document.display, document.spectrum.eigenvalues
    display.kind = "band"
    last = values[-1]
    seen: list[tuple[float, float]] = []
    panel.view.low.sigDragged.connect(
        lambda line: seen.append((line.value(), display[GeometryVectors].low))
    )
    grip = float(panel.plot.viewRange()[1][1]) - 0.08
    drag(panel.plot.viewport(), *[place(panel, share * last, grip) for share in (0, 0.5, 1, 1.03)])
    assert len(seen) >= 3
    assert all(line == pytest.approx(field) for line, field in seen)
    low, high = display[GeometryVectors].range(document.spectrum)
    assert np.count_nonzero((values >= low) & (values <= high)) >= 2
    drag(panel.plot.viewport(), *[place(panel, x, grip) for x in (high, 0.5 * last, 0.0)])
    low, high = display[GeometryVectors].range(document.spectrum)
    assert np.count_nonzero((values >= low) & (values <= high)) >= 2
    assert panel.view.high.value() == pytest.approx(high)


def test_a_marker_that_is_let_go_stands_where_its_field_is(panel: SpectrumPanel, document) -> None:
    display, last = document.display, document.spectrum.eigenvalues[-1]
    display.change(Eigenfunctions, index=100)
    drag(panel.plot.viewport(), *[place(panel, x, last / 4) for x in (100, 110, 120, 124)])
    assert display[Eigenfunctions].index == panel.view.marker.value() == 119
    display.kind = "band"
    display.change(GeometryVectors, index=28)
    centers = display[GeometryVectors].centers(document.spectrum)
    ways = [place(panel, x, 0.9) for x in (centers[28], centers[30], 1.03 * last)]
    drag(panel.plot.viewport(), *ways)
    assert display[GeometryVectors].index == 31
    assert panel.view.handle.value() == pytest.approx(centers[31])


def test_fit_shows_everything_again_and_changes_nothing_else(
    panel: SpectrumPanel, document
) -> None:
    document.display.change(Eigenfunctions, index=20)
    QTest.qWait(60)
    before = panel.plot.viewRange()
    turn_wheel(panel.plot.viewport(), -5)
    QTest.qWait(60)
    assert panel.plot.viewRange()[0][1] < 0.9 * before[0][1]
    QTest.mouseClick(panel.findChild(QToolButton, "spectrum_plot_fit_button"), LEFT)
    QTest.qWait(60)
    np.testing.assert_allclose(panel.plot.viewRange(), before)
    assert document.display[Eigenfunctions].index == 20
    turn_wheel(panel.plot.viewport(), -5)
    zoomed = panel.plot.viewRange()
    QTest.mouseDClick(panel.plot.viewport(), LEFT, pos=panel.plot.viewport().rect().center())
    assert panel.plot.viewRange() == zoomed, "a double click is two clicks"


def test_a_band_is_clicked_or_dragged_to(panel: SpectrumPanel, document) -> None:
    display = document.display
    display.kind = "band"
    centers = display[GeometryVectors].centers(document.spectrum)
    click(panel, centers[20], 0.9)
    assert display[GeometryVectors].index == 20
    assert panel.view.handle.value() == pytest.approx(centers[20])
    drag(panel.plot.viewport(), *[place(panel, centers[band], 0.9) for band in (20, 18, 12, 10)])
    assert display[GeometryVectors].index == 10
    x, y = panel.view.response.getData()
    assert (x[0], x[-1]) == pytest.approx(display[GeometryVectors].support(document.spectrum))
    assert y.max() == pytest.approx(2 / 3, rel=0.01), "a uniform cubic B-spline"


def test_the_legend_says_why_labels_have_no_response(
    panel: SpectrumPanel, document: Document
) -> None:
    document.display.kind = "hks"
    assert "exp(−λt)" in panel.view.legend()
    document.labels.new_set()
    assert panel.view.legend().endswith("|</span> eigenvalues")
    assert panel.view.legend().startswith("labels are names, not numbers, so they have no spectrum")
    assert "▬" not in panel.view.legend()
    assert "labels are names" in panel.legend.text()
    document.display.kind = "hks"
    assert "labels are names" not in panel.view.legend()


def test_a_heat_kernel_is_drawn_and_its_time_dragged(panel: SpectrumPanel, document) -> None:
    display = document.display
    display.kind = "hks"
    time = display[HeatKernelSignature].time_in(document.spectrum)
    x, y = panel.view.response.getData()
    assert y == pytest.approx(np.exp(-(10.0**x) * time)), "in log scale by itself"
    assert panel.view.handle.value() == pytest.approx(math.log10(1 / time))
    start = math.log10(1 / time)
    drag(panel.plot.viewport(), *[place(panel, start + by, 0.6) for by in (0, 0.1, 0.2, 0.3)])
    assert display[HeatKernelSignature].time == pytest.approx(time / 10**0.3, rel=0.05)
    low, high = display[HeatKernelSignature].range(document.spectrum)
    assert low <= display[HeatKernelSignature].time <= high


def test_what_is_beyond_the_spectrum_is_hatched(panel: SpectrumPanel, document) -> None:
    display = document.display
    display.kind = "band"
    assert not panel.view.missing.isVisible()
    display.change(GeometryVectors, high=2 * document.spectrum.eigenvalues[-1])
    display.change(GeometryVectors, automatic=False)
    assert panel.view.missing.isVisible()
    assert panel.view.missing.getRegion()[0] == pytest.approx(document.spectrum.eigenvalues[-1])


def test_follows_the_theme_and_says_what_will_come(qtbot) -> None:
    panel = SpectrumPanel(Document())
    qtbot.addWidget(panel)
    panel.show()
    assert panel.empty.isVisible()
    assert not panel.plot.isVisible()
    before = theme.mode()
    try:
        theme.set_mode("dark")
        assert panel.plot.backgroundBrush().color().name() == theme.palette().surface
    finally:
        theme.set_mode(before)


def test_the_axes_stay_from_one_eigenfunction_to_the_next(panel: SpectrumPanel, document) -> None:
    before = panel.plot.plotItem.vb.viewRange()
    for index in (0, 60, 119):
        document.display.change(Eigenfunctions, index=index)
        panel.plot.grab()
        assert panel.plot.plotItem.vb.viewRange() == before
