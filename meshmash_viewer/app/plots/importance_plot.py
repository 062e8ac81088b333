"""Plot of the importance of columns for classes, over their diffusion times."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg

from meshmash_viewer.app import theme
from meshmash_viewer.app.plots.panel import PlotSaver
from meshmash_viewer.app.plots.plot import Plot, Series, color, solid
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.learn import KINDS
from meshmash_viewer.model.classes import Learned
from meshmash_viewer.model.document import Document
from meshmash_viewer.units import format_number, format_quantity, named_quantity

#: Height in pixels.
_HEIGHT = 150
#: What the legend calls each kind of columns with what corresponds to a time, a column of it, and
#: the power of length of that.
_KINDS = dict(
    zip(
        KINDS,
        (("HKS", "HKS at", 2), ("WKS (λ = 1/t)", "WKS at", -2), ("Curvature (l = √t)", "over", 1)),
        strict=True,
    )
)
#: Columns that are named.
_NAMED = 3


class ImportancePlot(Plot):
    """The sum of the importance of the columns at each time, a curve for each kind."""

    def __init__(self, document: Document) -> None:
        self._learned = Learned()
        self._curves: dict[str, pg.PlotDataItem] = {}
        super().__init__("class_importance_plot", "Importance of each column for the classes")
        self.setFixedHeight(_HEIGHT)
        self.set_log(True, False)
        self.saver = PlotSaver(self, document, self.numbers, self.dress)

    def show_learned(self, learned: Learned) -> None:
        """Draw what is known of a prediction."""
        if learned is self._learned:
            return
        self._learned = learned
        self.set_labels(named_quantity("t", learned.unit, 2), "Importance")
        for kind in set(self._curves) - set(learned.kinds):
            self.removeItem(self._curves.pop(kind))
        for kind, (times, sums) in self._sums().items():
            if kind not in self._curves:
                self._curves[kind] = self.plot([], [], symbol="o", symbolSize=4)
            self._curves[kind].setData(np.log10(times), sums)
        self.dress()
        self.show_all()

    def _sums(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Times of each kind of columns, and the sums of the importance of those at each."""
        learned, found = self._learned, dict[str, tuple[FloatArray, FloatArray]]()
        for kind in dict.fromkeys(learned.kinds):
            own = np.array(learned.kinds) == kind
            times, at = np.unique(np.array(learned.times)[own], return_inverse=True)
            sums = np.bincount(at, np.array(learned.importance)[own])
            found[kind] = times, sums.astype(np.float64)
        return found

    def numbers(self) -> list[Series]:
        """The curves, and the importance of each column."""
        learned = self._learned
        curves = [
            Series(_KINDS[kind][0], *sums, _color(kind)) for kind, sums in self._sums().items()
        ]
        each = zip(learned.names, learned.times, learned.importance, strict=True)
        return curves + [Series(name, [time], [share]) for name, time, share in each]

    def legend(self) -> str:
        """Legend and the most important columns, as rich text."""
        names = {kind: _KINDS[kind][0].replace(" ", "&nbsp;") for kind in self._curves}
        parts = [
            f'<span style="color:{_color(kind)}">▬</span>&nbsp;{name}'
            for kind, name in names.items()
        ]
        order = np.argsort(self._learned.importance)[::-1][:_NAMED]
        most = ", ".join(map(self._described, order))
        return f"{' &nbsp;'.join(parts)}<br>Most important: {most}."

    def _described(self, at: int) -> str:
        """Write a column with its importance: "HKS at 0.231 µm² (0.08)"."""
        learned = self._learned
        _, place, power = _KINDS[learned.kinds[at]]
        size = format_quantity(learned.times[at] ** (power / 2), learned.unit, power)
        name = "" if abs(power) == 2 else f"{learned.names[at].partition('_')[0]} "
        said = f"{name}{place} {size}"
        return f"{said} ({format_number(learned.importance[at], 2)})".replace(" ", "&nbsp;")

    def dress(self) -> None:
        super().dress()
        for kind, curve in self._curves.items():
            shade = _color(kind)
            curve.setPen(solid(shade, 1.6))
            curve.setSymbolPen(None)
            curve.setSymbolBrush(color(shade))


def _color(kind: str) -> str:
    return str(theme.palette().series[list(_KINDS).index(kind)])
