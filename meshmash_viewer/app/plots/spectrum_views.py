"""Contents of the spectrum plot: eigenvalues by index, or responses of filters."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QTextDocumentFragment

from meshmash_viewer.app import theme
from meshmash_viewer.app.plots.plot import Series, color, dashed, hatch, marker, rim, solid
from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.alignment import multiplets
from meshmash_viewer.spectral.eigenpairs import RESOLVED, Eigenpairs, first_nonzero
from meshmash_viewer.spectral.weyl import weyl_eigenvalue
from meshmash_viewer.units import format_share, named_quantity


class EigenvalueView:
    """Contents of the spectrum plot for eigenfunctions.

    A click, or a drag of the marker, selects an eigenfunction. Zero modes are hollow points.
    """

    #: Range of the left axis; None for an automatic range.
    heights: ClassVar[tuple[float, float] | None] = None

    def __init__(self, document: Document) -> None:
        self._document = document
        #: Whether the left axis is logarithmic.
        self.log = False
        self.weyl = pg.PlotCurveItem()
        #: Band behind the points of each multiplet.
        self.multiplets = pg.PlotCurveItem(connect="pairs")
        self._has_multiplets = False
        self.points = pg.ScatterPlotItem(pxMode=True)
        #: Eigenvalues that the mesh does not resolve, in grey.
        self.unresolved = pg.ScatterPlotItem(pxMode=True)
        self.zeros = pg.ScatterPlotItem(pxMode=True)
        self.current = pg.ScatterPlotItem(pxMode=True)
        self.marker = marker(self._drag, self.refresh_current)
        self.expected = pg.PlotCurveItem()  # invisible: extends the axes to the requested pairs
        self.items = (
            self.expected, self.weyl, self.multiplets, self.points, self.unresolved,
            self.zeros, self.marker, self.current,
        )  # fmt: skip
        for item in (self.weyl, self.multiplets, self.points, self.unresolved, self.zeros):
            item.setCacheMode(item.CacheMode.DeviceCoordinateCache)  # a new index keeps the item
        # Weyl's law may be far above the eigenvalues of a neuron, and must not affect the range
        self.unbounded = (self.weyl, self.marker, self.multiplets, self.current)
        self.dress()

    def dress(self) -> None:
        colors = theme.palette()
        self.expected.setPen(None)
        self.weyl.setPen(dashed(colors.reference, 1.5))
        band = solid(colors.accent, 14.0, 0.25)
        band.setCapStyle(Qt.PenCapStyle.RoundCap)
        self.multiplets.setPen(band)
        self.points.setPen(None)
        self.points.setBrush(color(colors.accent))
        self.unresolved.setPen(None)
        self.unresolved.setBrush(color(colors.reference))
        self.zeros.setBrush(color(colors.surface))
        self.zeros.setPen(rim(colors.accent, 1.5))
        self.current.setBrush(color(colors.marker))
        self.current.setPen(rim(colors.surface, 1.5))
        self.marker.setPen(solid(colors.marker, 1.0, 0.7))
        self.marker.setHoverPen(solid(colors.marker, 3.0))

    def labels(self) -> tuple[str, str]:
        return "Index", named_quantity("λ", self._document.unit, -2)

    def legend(self) -> str:
        colors, spectrum = theme.palette(), self._document.spectrum
        preview = spectrum is not None and spectrum.preview
        what = "approximate eigenvalue" if preview else "eigenvalue"
        parts = [f'<span style="color:{colors.accent}">●</span> {what}']
        if spectrum is not None and (count := first_nonzero(spectrum)):
            what = "zero mode" if count == 1 else f"{count} zero modes"
            parts.append(f'<span style="color:{colors.accent}">○</span> {what}')
        if self._has_multiplets:
            parts.append(f'<span style="color:{colors.accent}">▬</span> equal')
        parts.append(f'<span style="color:{colors.reference}">╌╌</span> Weyl’s law')
        return "&nbsp;&nbsp; ".join(parts)

    def remark(self) -> str:
        """Return the legend of the grey points, "" without any."""
        spectrum, shade = self._document.spectrum, theme.palette().reference
        if spectrum is None or spectrum.resolved.all():
            return ""
        share = format_share(RESOLVED)
        return f'<span style="color:{shade}">● off by over {share}</span>'

    def refresh_spectrum(self) -> None:
        """Draw the computed pairs on axes that extend to all requested pairs."""
        spectrum, solved = self._document.spectrum, self._document.solved
        if spectrum is None or not len(spectrum):
            for item in self.items:
                if item is not self.marker:
                    item.setData([], [])
            self.marker.setVisible(False)
            return
        zeros, length = first_nonzero(spectrum), len(spectrum)
        index = np.arange(length, dtype=np.float64)
        heights = self._heights(spectrum.eigenvalues, zeros)
        size = 5.0 if length <= 400 else 3.5
        # approximate eigenvalues have pale points
        self.points.setBrush(color(theme.palette().accent, 0.45 if spectrum.preview else 1.0))
        rest, resolved = np.arange(length) >= zeros, spectrum.resolved
        for item, shown in ((self.points, rest & resolved), (self.unresolved, rest & ~resolved)):
            item.setData(index[shown], heights[shown], size=size)
        self.zeros.setData(index[:zeros], heights[:zeros], size=6.0)
        runs = ((first, end - 1) for first, end in multiplets(spectrum.eigenvalues, zeros, length))
        ends = [each for run in runs if run[1] > run[0] for each in run]
        self._has_multiplets = bool(ends)
        self.multiplets.setData(index[ends], heights[ends])
        last = max(spectrum.total, length) - 1
        top = heights[-1] if self.log else heights[-1] * max(last, 1) / max(length - 1, 1)
        self.expected.setData([0.0, float(last)], [heights[0], top])
        if solved is not None:
            area = float(solved.mesh.area)
            along = np.linspace(1.0 if self.log else 0.0, max(last, 1), 200)
            law = np.array([weyl_eigenvalue(area, each) for each in along])
            self.weyl.setData(along, np.log10(law) if self.log else law)
        self.refresh_current()

    def refresh_current(self) -> None:
        spectrum = self._document.spectrum
        if spectrum is None or not len(spectrum):
            return
        index = self.index
        height = self._heights(spectrum.eigenvalues, first_nonzero(spectrum))[index]
        self.current.setData([index], [height], size=10.0)
        self.marker.setVisible(True)
        self.marker.setBounds((0, len(spectrum) - 1))
        if not self.marker.moving:
            self.marker.setValue(index)

    def numbers(self) -> list[Series]:
        spectrum, colors = self._document.spectrum, theme.palette()
        along, law = self.weyl.getData()
        if spectrum is None or along is None:
            return []
        values = spectrum.eigenvalues
        name = "approximate eigenvalue" if spectrum.preview else "eigenvalue"
        return [
            Series(name, np.arange(len(values)), values, colors.accent, spectrum.mesh_errors),
            Series("Weyl’s law", along, 10.0**law if self.log else law, colors.reference),
        ]

    def select(self, x: float, _y: float) -> None:
        display = self._document.display
        display.show(replace(display[Eigenfunctions], index=self.index_at(x)))

    @property
    def family(self) -> Family:
        """Family whose eigenvalues are drawn."""
        return self._document.display[Eigenfunctions]

    @property
    def index(self) -> int:
        """Index of the displayed pair, at most the index of the last computed pair."""
        spectrum, chosen = self._document.spectrum, self._document.display[Eigenfunctions]
        return chosen.index if spectrum is None else chosen.within(spectrum).index

    def index_at(self, x: float) -> int:
        """Return the index of the pair nearest to a position on the bottom axis."""
        spectrum = self._document.spectrum
        last = len(spectrum) - 1 if spectrum is not None else 0
        return min(max(round(x), 0), max(last, 0)) if math.isfinite(x) else 0

    def _drag(self, marker: pg.InfiniteLine) -> None:
        if self._document.spectrum is not None:
            self.select(float(marker.value()), 0.0)

    def _heights(self, eigenvalues: npt.NDArray[np.float64], zeros: int) -> npt.NDArray[np.float64]:
        if not self.log:
            return np.asarray(np.maximum(eigenvalues, 0.0))
        # zero has no logarithm, so zero modes are drawn below the first nonzero eigenvalue
        rest = eigenvalues[zeros:]
        floor = rest[0] / 3.0 if len(rest) else 1.0
        return np.asarray(np.log10(np.concatenate([np.full(zeros, floor), rest])))


#: Lower end, on the left axis, of the ticks that mark eigenvalues.
_RUG = -0.09
#: Upper end of the left axis, with space for grips above 1.
_TOP = 1.32
#: Fraction of the height spanned by the handle of the filter, below the grips of the limits.
_HANDLE_SPAN = 0.82
#: Diameter of a grip in pixels.
_GRIP = 10
#: Minimum width of the range of filters, as a fraction of the largest computed eigenvalue.
_NARROWEST = 1e-3
#: Number of samples of a response.
_SAMPLES = 256


class ResponseView:
    """Contents of the spectrum plot for features.

    Handles move the filter of the field, and the limits of the family's range of filters, if any.
    A click selects the filter at the clicked eigenvalue. Ticks at the bottom mark eigenvalues.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        #: Whether the bottom axis is logarithmic.
        self.log = False
        self._response_text = ""
        #: Why no response is drawn.
        self._reason = ""
        self.rug = pg.PlotCurveItem(connect="pairs")
        self.series = tuple(pg.PlotCurveItem(connect="finite") for _ in range(3))
        self.response = pg.PlotCurveItem(fillLevel=0.0)
        for item in (self.rug, *self.series, self.response):  # most updates keep these items
            item.setCacheMode(item.CacheMode.DeviceCoordinateCache)
        self.missing = pg.LinearRegionItem(movable=False)
        self.low, self.high, self.handle = (
            marker(self._drag, self.refresh_current) for _ in range(3)
        )
        for line in (self.low, self.high):
            line.addMarker("o", 0.94, _GRIP)
        self.handle.addMarker("o", 1.0, _GRIP)
        self.handle.setSpan(0.0, _HANDLE_SPAN)
        self.handle.setZValue(1.0)
        self.items = (
            self.missing, self.rug, *self.series, self.response, self.low, self.high, self.handle,
        )  # fmt: skip
        self.unbounded = (self.missing,)
        self.dress()

    def dress(self) -> None:
        colors = theme.palette()
        self.rug.setPen(solid(colors.reference, 1.0, 0.8))
        for item, name in zip(self.series, colors.series[:1] + colors.series[2:], strict=False):
            item.setPen(solid(name, 1.2, 0.75))
        self.response.setPen(solid(colors.marker, 2.2))
        self.response.setBrush(color(colors.marker, 0.18))
        hatch(self.missing)
        for line in (self.low, self.high):
            line.setPen(solid(colors.axis, 1.6))
            line.setHoverPen(solid(colors.marker, 3.5))
        self.handle.setPen(dashed(colors.marker, 1.6))
        self.handle.setHoverPen(solid(colors.marker, 3.5))

    def labels(self) -> tuple[str, str]:
        return named_quantity("λ", self._document.unit, -2), self.family.response_label

    def legend(self) -> str:
        colors = theme.palette()
        ticks = f'<span style="color:{colors.reference}">|</span> eigenvalues'
        mark = f'<span style="color:{colors.marker}">▬</span>'
        response = f"{mark} {self._response_text}" if self._response_text else self._reason
        return f"{response}&nbsp;&nbsp; {ticks}" if response else ticks

    def numbers(self) -> list[Series]:
        spectrum, family = self._document.scaled_spectrum, self.family
        response = None if spectrum is None else family.response(spectrum, self._along(spectrum))
        if response is None:
            return []
        legend = QTextDocumentFragment.fromHtml(response.legend).toPlainText()
        curves = [(legend, response.curve, theme.palette().marker)]
        curves += [(f"other {at}", each, "") for at, each in enumerate(response.others, 1)]
        if not family.response_decades:
            return [Series(name, *curve, shade) for name, curve, shade in curves]
        found = []
        for name, (x, y), shade in curves:  # y = 0 is the lower end of a logarithmic axis
            above = y > 0.0
            values = 10.0 ** (family.response_decades * (y[above] - 1.0))
            found.append(Series(name, x[above], values, shade))
        return found

    # -- coordinates ------------------------------------------------------------------------

    def _x(self, eigenvalue: float | np.ndarray) -> np.ndarray:
        if not self.log:
            return np.asarray(eigenvalue, dtype=np.float64)
        return np.log10(np.maximum(eigenvalue, self._floor()))

    def _eigenvalue(self, x: float) -> float:
        value = 10.0**x if self.log else x
        return 0.0 if self.log and value <= 1.001 * self._floor() else max(value, 0.0)

    def _floor(self) -> float:
        """Return the value drawn for 0 on a logarithmic axis: half the first nonzero eigenvalue."""
        spectrum = self._document.scaled_spectrum
        if spectrum is None:
            return 1e-30
        return float(spectrum.eigenvalues[first_nonzero(spectrum)]) / 2.0

    # -- from the model ---------------------------------------------------------------------

    def refresh_spectrum(self) -> None:
        """Draw the computed eigenvalues, and the responses."""
        spectrum = self._document.scaled_spectrum
        if spectrum is None:
            for item in (self.rug, self.response, *self.series):
                item.setData([], [])
            for item in (self.low, self.high, self.handle, self.missing):
                item.setVisible(False)
            return
        x = np.repeat(self._x(spectrum.eigenvalues), 2)
        self.rug.setData(x, np.tile([_RUG, -0.02], len(spectrum)))
        self.refresh_current()

    def refresh_current(self) -> None:
        spectrum = self._document.scaled_spectrum
        if spectrum is None:
            return
        response = self.family.response(spectrum, self._along(spectrum))
        for item in (self.response, *self.series, self.handle, self.low, self.high, self.missing):
            item.setVisible(response is not None)
        if response is None:
            shown = getattr(self.family.resolved(spectrum, {}), "shown", None)
            labels = "labels are names, not numbers, so they have no spectrum"
            others = f"{self.family.label}: no filter can be drawn for these eigenvalues"
            self._response_text = ""
            self._reason = labels if shown is not None and shown.labels else others
            return
        self._response_text = response.legend
        gap = np.array([np.nan])
        for offset, item in enumerate(self.series):
            mine = response.others[offset :: len(self.series)]
            x = [part for places, _ in mine for part in (places, gap)]
            y = [part for _, heights in mine for part in (heights, gap)]
            _set_curve(item, self._x(np.concatenate([gap, *x])), np.concatenate([gap, *y]))
        _set_curve(self.response, self._x(response.curve[0]), response.curve[1])
        low, high = response.ends or (None, None)
        known = float(spectrum.eigenvalues[-1])
        for line, value in ((self.low, low), (self.high, high), (self.handle, response.handle)):
            line.setVisible(value is not None)
            if value is not None and not line.moving:
                line.setBounds((None, None))
                line.setValue(float(self._x(value)))
        some_left = len(spectrum) < spectrum.n_vertices  # there are no more than n eigenvalues
        beyond = some_left and high is not None and bool(high > known * (1.0 + 1e-9))
        self.missing.setVisible(beyond)
        if beyond and high is not None:
            self.missing.setRegion([float(self._x(each)) for each in (known, high)])

    @property
    def heights(self) -> tuple[float, float] | None:
        """Range of the left axis, from -1 or 0 to 1 with margins."""
        signed = self.family.signed and not self.family.response_decades
        return (-_TOP if signed else _RUG - 0.03), _TOP

    @property
    def family(self) -> Family:
        """Family whose filters are drawn; a family of features if the displayed family has none."""
        display = self._document.display
        if display.response_family is not None:
            return display.response_family
        even = next(name for name, family in FEATURES.items() if not family.logarithmic[2])
        return display.fields[even]

    def _along(self, spectrum: Eigenpairs) -> FloatArray:
        known = float(spectrum.eigenvalues[-1])
        first = self._floor() if self.log else 0.0
        x = np.linspace(float(self._x(first)), float(self._x(known)), _SAMPLES)
        return 10.0**x if self.log else x

    # -- from the mouse ---------------------------------------------------------------------

    def select(self, x: float, _y: float) -> None:
        spectrum, family = self._document.scaled_spectrum, self.family
        if spectrum is None:
            return
        value = self._eigenvalue(x)
        response = family.response(spectrum, self._along(spectrum))
        ends = None if response is None else response.ends
        if ends is None or ends[0] <= value <= ends[1]:
            self._document.display.show(family.at_eigenvalue(spectrum, value))

    def _drag(self, line: pg.InfiniteLine) -> None:
        spectrum, display = self._document.scaled_spectrum, self._document.display
        family = self.family
        if spectrum is None:
            return
        line.setBounds([float(self._x(value)) for value in self._bounds(spectrum, line)])
        value = self._eigenvalue(float(line.value()))
        if line is self.handle:
            display.show(family.at_eigenvalue(spectrum, value))
            return
        low, high = self._ends(spectrum)
        display.put(family.between(value, high) if line is self.low else family.between(low, value))

    def _bounds(self, spectrum: Eigenpairs, line: pg.InfiniteLine) -> tuple[float, float]:
        """Return the limits for dragging a line, such that the range contains some eigenvalues."""
        values = spectrum.eigenvalues
        known = float(values[-1])
        if line is self.handle:
            family, one = self.family, values[-1:]
            ends = (family.at_eigenvalue(spectrum, each) for each in (1e-6 * known, 1e6 * known))
            responses = [each.response(spectrum, one) for each in ends]
            held = sorted(each.handle for each in responses if each and each.handle is not None)
            return (held[0], held[-1]) if held else (0.0, known)
        low, high = self._ends(spectrum)
        if line is self.low:
            below = int(np.searchsorted(values, min(high, known), side="right"))
            return 0.0, max(min(values[max(below - 2, 0)], high - _NARROWEST * known), 0.0)
        above = int(np.searchsorted(values, low, side="left"))
        return max(values[min(above + 1, len(values) - 1)], low + _NARROWEST * known), known

    def _ends(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return the range of the family's filters."""
        response = self.family.response(spectrum, spectrum.eigenvalues[-1:])
        return (0.0, 0.0) if response is None or response.ends is None else response.ends


def _set_curve(item: pg.PlotCurveItem, x: FloatArray, y: FloatArray) -> None:
    """Set the data of a curve if they differ, because a repaint takes milliseconds."""
    before = item.getData()
    if any(
        old is None or not np.array_equal(old, new, equal_nan=True)
        for old, new in zip(before, (x, y), strict=True)
    ):
        item.setData(x, y)
