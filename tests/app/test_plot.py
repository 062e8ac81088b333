"""A plot lays out what is new in one turn of the event loop and paints in a later one."""

from __future__ import annotations

from meshmash_viewer.app.listening import catch_up
from meshmash_viewer.app.plots.plot import Plot


def test_painting_waits_for_a_turn_of_its_own(qtbot) -> None:
    plot = Plot("plot", "A plot")
    qtbot.addWidget(plot)
    plot.show()
    qtbot.waitExposed(plot)
    curve = plot.plotItem.plot([0.0, 1.0], [0.0, 1.0])
    plot.paint_later()
    curve.setData([0.0, 1.0], [1.0, 0.0])
    assert not plot.updatesEnabled()
    qtbot.waitUntil(plot.updatesEnabled)
    plot.paint_later()
    plot.paint_later()
    catch_up()
    assert plot.updatesEnabled()
