"""Filter responses over the eigenvalue: heat kernel or B-spline bands, with handles to drag."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt

from meshmash_viewer.app import theme
from meshmash_viewer.app.plots.band_curves import band_centers, band_curves, band_responses
from meshmash_viewer.app.plots.plot import Plot, color, dashed, hatch, solid
from meshmash_viewer.model.display import Display, FieldKind, SimilarityBasis
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.ranges import band_range, first_nonzero, hks_range, hks_time
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.units import power_unit

__all__ = ["ResponseView", "shows_bands"]

_RUG = -0.09


def shows_bands(display: Display) -> bool:
    """Whether the filters that matter now are bands, or else heat kernels."""
    if display.kind is FieldKind.SIMILARITY:
        return display.similarity_basis is SimilarityBasis.BANDS
    return display.kind is not FieldKind.HKS


class ResponseView:
    """What is drawn on the spectrum plot while features are looked at.

    For bands the ends of the range and the centre of the current band can be dragged, and a click
    chooses the band there. For HKS the line at ``λ = 1/t`` can be dragged. Under them each
    eigenvalue is a tick.
    """

    def __init__(self, plot: Plot, document: Document) -> None:
        self._plot = plot
        self._document = document
        self._log = False
        self.rug = pg.PlotCurveItem(connect="pairs")
        self.series = tuple(pg.PlotCurveItem(connect="finite") for _ in range(3))
        self.response = pg.PlotCurveItem(fillLevel=0.0)
        self.missing = pg.LinearRegionItem(movable=False)
        self.low, self.high, self.handle = (pg.InfiniteLine(angle=90, movable=True) for _ in "abc")
        for line in (self.low, self.high, self.handle):
            line.setCursor(Qt.CursorShape.SizeHorCursor)
            line.sigDragged.connect(self._drag)
        self.items = (
            self.missing, self.rug, *self.series, self.response, self.low, self.high, self.handle,
        )  # fmt: skip
        self.unbounded = (self.missing,)
        self.dress()

    def dress(self) -> None:
        """Put on the colours of the theme."""
        colors = theme.plot_colors()
        self.rug.setPen(solid(colors.reference, 1.0, 0.8))
        for item, name in zip(self.series, colors.series[:1] + colors.series[2:], strict=False):
            item.setPen(solid(name, 1.2, 0.75))
        self.response.setPen(solid(colors.marker, 2.2))
        self.response.setBrush(color(colors.marker, 0.18))
        self.missing.setBrush(hatch(colors.hatch))
        for line in self.missing.lines:
            line.setPen(solid(colors.hatch, 1.0, 0.0))
        for line in (self.low, self.high):
            line.setPen(solid(colors.foreground, 1.6))
            line.setHoverPen(solid(colors.handle, 3.5))
        self.handle.setPen(dashed(colors.handle, 1.6))
        self.handle.setHoverPen(solid(colors.handle, 3.5))

    def set_log(self, on: bool) -> None:
        """Draw over the logarithm of λ."""
        self._log = on

    def labels(self) -> tuple[str, str]:
        """Names of the axes, with units."""
        mesh = self._document.mesh
        unit = power_unit(mesh.unit if mesh is not None else "", -2)
        return f"λ ({unit})" if unit else "λ", "Response"

    def legend(self) -> str:
        """What the marks mean, as rich text."""
        colors, display = theme.plot_colors(), self._document.display
        ticks = f'<span style="color:{colors.reference}">|</span> eigenvalues'
        mark = f'<span style="color:{colors.marker}">▬</span>'
        if shows_bands(display):
            return f"{mark} band {display.band}&nbsp;&nbsp; {ticks}"
        return f"{mark} exp(−λt), ╌ λ = 1/t&nbsp;&nbsp; {ticks}"

    def heights(self) -> tuple[float, float] | None:
        """Range of the left axis: the same for all responses, so that it stays while they move."""
        return _RUG - 0.03, 1.06

    # -- coordinates ------------------------------------------------------------------------

    def _x(self, eigenvalue: float | np.ndarray) -> np.ndarray:
        if not self._log:
            return np.asarray(eigenvalue, dtype=np.float64)
        return np.log10(np.maximum(eigenvalue, self._floor()))

    def _eigenvalue(self, x: float) -> float:
        value = 10.0**x if self._log else x
        return 0.0 if self._log and value <= 1.001 * self._floor() else max(value, 0.0)

    def _floor(self) -> float:
        """What stands for zero in log scale: a little under the first eigenvalue above it."""
        spectrum = self._document.spectrum
        if spectrum is None or first_nonzero(spectrum) >= len(spectrum):
            return 1e-30
        return float(spectrum.eigenvalues[first_nonzero(spectrum)]) / 2.0

    def _usable(self) -> Spectrum | None:
        spectrum = self._document.spectrum
        usable = spectrum is not None and first_nonzero(spectrum) < len(spectrum)
        return spectrum if usable else None

    # -- from the model ---------------------------------------------------------------------

    def refresh_spectrum(self) -> None:
        """Draw the eigenvalues that have converged, and the responses over them."""
        spectrum = self._usable()
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
        """Draw the responses as the display has them now."""
        spectrum = self._usable()
        if spectrum is None:
            return
        if shows_bands(self._document.display):
            self._draw_bands(spectrum)
        else:
            self._draw_heat(spectrum)

    def _draw_bands(self, spectrum: Spectrum) -> None:
        display = self._document.display
        low, high = band_range(spectrum, display)
        count = display.band_count
        curves = band_curves(low, high, count)
        for offset, item in enumerate(self.series):
            mine = curves[offset :: len(self.series)]
            if mine:
                gap = np.array([np.nan])
                x = np.concatenate([part for c in mine for part in (self._x(c.eigenvalues), gap)])
                y = np.concatenate([part for c in mine for part in (c.response, gap)])
                item.setData(x, y)
            else:
                item.setData([], [])
        current = curves[min(display.band, count - 1)]
        self.response.setData(self._x(current.eigenvalues), current.response)
        center = float(band_centers(low, high, count)[min(display.band, count - 1)])
        known = float(spectrum.eigenvalues[-1])
        for line, value in ((self.low, low), (self.high, high), (self.handle, center)):
            line.setVisible(True)
            if not line.moving:
                line.setValue(float(self._x(value)))
        self._hatch((known, high) if high > known * (1.0 + 1e-9) else None)

    def _draw_heat(self, spectrum: Spectrum) -> None:
        display = self._document.display
        time = hks_time(spectrum, display)
        known = float(spectrum.eigenvalues[-1])
        ends = (self._floor(), known) if self._log else (0.0, known)
        x = np.linspace(float(self._x(ends[0])), float(self._x(ends[1])), 256)
        eigenvalues = 10.0**x if self._log else x
        self.response.setData(x, np.exp(-eigenvalues * time))
        for item in self.series:
            item.setData([], [])
        self.low.setVisible(False)
        self.high.setVisible(False)
        self.handle.setVisible(True)
        if not self.handle.moving:
            self.handle.setValue(float(self._x(1.0 / time)))
        self._hatch(None)

    def _hatch(self, between: tuple[float, float] | None) -> None:
        self.missing.setVisible(between is not None)
        if between is not None:
            self.missing.setRegion([float(self._x(each)) for each in between])

    # -- from the person --------------------------------------------------------------------

    def select(self, x: float, _y: float) -> None:
        """Choose the band, or the time, at a place of the plot."""
        spectrum, display = self._usable(), self._document.display
        if spectrum is None:
            return
        value = self._eigenvalue(x)
        if shows_bands(display):
            low, high = band_range(spectrum, display)
            if low <= value <= high:
                response = band_responses(low, high, display.band_count, np.array([value]))
                display.band = int(np.argmax(response[:, 0]))
                display.kind = FieldKind.BAND
        elif value > 0.0:
            self._set_time(spectrum, 1.0 / value)

    def _set_time(self, spectrum: Spectrum, time: float) -> None:
        low, high = hks_range(spectrum, self._document.display)
        self._document.display.time = min(max(time, low), high)
        self._document.display.kind = FieldKind.HKS

    def _drag(self, line: pg.InfiniteLine) -> None:
        spectrum, display = self._usable(), self._document.display
        if spectrum is None:
            return
        value = self._eigenvalue(float(line.value()))
        if line is self.handle:
            if shows_bands(display):
                low, high = band_range(spectrum, display)
                centers = band_centers(low, high, display.band_count)
                display.band = int(np.argmin(np.abs(centers - value)))
                display.kind = FieldKind.BAND
            elif value > 0.0:
                self._set_time(spectrum, 1.0 / value)
            return
        low, high = band_range(spectrum, display)
        least = 1e-3 * float(spectrum.eigenvalues[-1])
        if line is self.low:
            low = min(max(value, 0.0), high - least)
        else:
            high = max(min(value, float(spectrum.eigenvalues[-1])), low + least)
        display.band_min, display.band_max = low, high
        display.band_automatic = False

    def readout_of(self, x: float) -> float | None:
        """Eigenvalue at a place of the plot."""
        return self._eigenvalue(x) if math.isfinite(x) else None
