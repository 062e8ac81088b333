"""Axis labels of plots, and layout and painting in separate turns of the event loop."""

from __future__ import annotations

import math

import pytest
import shiboken6
from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtGui import QGuiApplication, QScreen

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.plots.plot import Plot, ScientificAxis, scaled_pens, solid


@pytest.mark.parametrize(
    ("values", "spacing", "texts"),
    [
        ([0.0, 1e-8, 2e-8], 1e-8, ["0", "1×10⁻⁸", "2×10⁻⁸"]),
        ([0.0, 5e-9, 1e-8, 1.5e-8], 5e-9, ["0", "0.5×10⁻⁸", "1×10⁻⁸", "1.5×10⁻⁸"]),
        ([0.0, 5e-5, 1e-4], 5e-5, ["0", "0.5×10⁻⁴", "1×10⁻⁴"]),
        ([-1e-5, 0.0, 1e-5], 1e-5, ["−1×10⁻⁵", "0", "1×10⁻⁵"]),
        ([0.0, 50.0, 100.0], 50.0, ["0", "50", "100"]),
        ([0.0, 2e6], 2e6, ["0", "2×10⁶"]),
        ([], 1.0, []),
    ],
)
def test_ticks_are_powers_of_ten(qapp, values, spacing, texts) -> None:
    axis = ScientificAxis("left")
    axis.setRange(min(values, default=0.0), max(values, default=1.0))
    assert axis.tickStrings(values, 1.0, spacing) == texts


@pytest.mark.parametrize(
    ("ends", "texts"),
    [
        ((-8.0, -7.0), ["10⁻⁸", "2×10⁻⁸", None, "5×10⁻⁸"]),
        ((-8.0, -4.0), ["10⁻⁸", None, None, None]),
    ],
)
def test_few_ticks_in_log_scale_have_labels(qapp, ends, texts) -> None:
    axis = ScientificAxis("left")
    axis.setLogMode(True)
    axis.setRange(*ends)
    powers = [-8.0, *(math.log10(1e-8 * size) for size in (2, 3, 5))]
    assert axis.tickStrings(powers, 1.0, 1.0) == texts
    # another unit multiplies the values
    assert axis.tickStrings([power + 3.0 for power in powers], 1e-3, 1.0) == texts


@pytest.mark.parametrize(("width", "second"), [(140, None), (500, "2")])
def test_labels_in_log_scale_do_not_touch(qapp, width, second) -> None:
    axis = ScientificAxis("bottom")
    axis.setLogMode(True)
    axis.setRange(0.0, 1.7)
    axis.resize(width, 40)
    assert axis.tickStrings([0.0, math.log10(2.0)], 1.0, 1.0) == ["1", second]


def test_an_axis_is_labelled_in_a_unit_that_suits_its_range_upright(qtbot) -> None:
    plot = Plot("plot", "A plot")
    qtbot.addWidget(plot)
    plot.set_labels("Time t (nm²)", "λ (nm⁻²)")
    plot.plotItem.vb.setRange(xRange=(0.0, 2e8), yRange=(0.0, 2e-6), padding=0.0)
    with qtbot.waitExposed(plot, timeout=120_000):
        plot.show()
    left, bottom = (plot.getAxis(side) for side in ("left", "bottom"))
    assert "λ (µm⁻²)" in left.labelString()
    assert "Time t (µm²)" in bottom.labelString()
    assert left.tickStrings([0.0, 1e-6], left.autoSIPrefixScale, 1e-6) == ["0", "1"]
    assert left.label.rotation() == 0.0
    inside = plot.rect().adjusted(0, -1, 0, 1)
    place = left.label.boundingRect()
    qtbot.waitUntil(
        lambda: inside.contains(left.label.mapRectToScene(place).toAlignedRect()), timeout=5000
    )


def test_an_axis_of_thousands_of_indices_becomes_logarithmic(qtbot) -> None:
    plot = Plot("plot", "A plot")
    qtbot.addWidget(plot)
    plot.setXRange(0.0, 6000.0)
    plot.set_log(True, False)
    plot.set_labels("λ (nm⁻²)", "Response")
    plot.setXRange(-9.0, -6.0)
    assert plot.getAxis("bottom").labelUnits == "µm⁻²"


def test_painting_waits_for_a_turn_of_its_own(qtbot) -> None:
    plot = Plot("plot", "A plot")
    qtbot.addWidget(plot)
    with qtbot.waitExposed(plot, timeout=120_000):
        plot.show()
    curve = plot.plotItem.plot([0.0, 1.0], [0.0, 1.0])
    plot.paint_later()
    curve.setData([0.0, 1.0], [1.0, 0.0])
    assert not plot.updatesEnabled()
    qtbot.waitUntil(plot.updatesEnabled)
    plot.paint_later()
    plot.paint_later()
    catch_up()
    assert plot.updatesEnabled()


def test_lines_are_as_wide_on_a_dense_screen(qapp, monkeypatch) -> None:
    width = solid("#000000", 1.5).widthF()
    ratio = QGuiApplication.primaryScreen().devicePixelRatio()
    monkeypatch.setattr(QScreen, "devicePixelRatio", lambda _screen: 2.0 * ratio)
    assert solid("#000000", 1.5).widthF() == 2.0 * width
    with scaled_pens(1.0):  # as in a saved picture
        assert solid("#000000", 1.5).widthF() == 1.5


def test_the_menu_of_pyqtgraph_ends_with_the_plot(qapp) -> None:
    plot = Plot("plot", "A plot")
    menu = plot.plotItem.ctrlMenu
    assert not menu.isVisible()
    plot.deleteLater()
    QCoreApplication.sendPostedEvents(plot, QEvent.Type.DeferredDelete)
    assert not shiboken6.isValid(menu)
