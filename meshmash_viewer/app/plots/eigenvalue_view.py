"""Plot of the eigenvalues against their index, with Weyl's law."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import Qt

from meshmash_viewer.app import theme
from meshmash_viewer.app.plots.plot import Series, color, dashed, marker, rim, solid
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.alignment import multiplets
from meshmash_viewer.spectral.eigenpairs import first_nonzero
from meshmash_viewer.spectral.weyl import weyl_eigenvalue
from meshmash_viewer.units import named_quantity


class EigenvalueView:
    """Contents of the spectrum plot for eigenfunctions.

    A click or a drag of the marker selects an eigenfunction; zero modes are hollow.
    """

    #: Range of the left axis, None for an automatic one.
    heights: ClassVar[tuple[float, float] | None] = None

    def __init__(self, document: Document) -> None:
        self._document = document
        #: Whether the left axis is logarithmic.
        self.log = False
        self.weyl = pg.PlotCurveItem()
        #: A band behind the points of each multiplet.
        self.multiplets = pg.PlotCurveItem(connect="pairs")
        self._has_multiplets = False
        self.points = pg.ScatterPlotItem(pxMode=True)
        self.zeros = pg.ScatterPlotItem(pxMode=True)
        self.current = pg.ScatterPlotItem(pxMode=True)
        self.marker = marker(self._drag, self.refresh_current)
        self.expected = pg.PlotCurveItem()  # invisible: extends the axes to the requested pairs
        self.items = (
            self.expected, self.weyl, self.multiplets, self.points, self.zeros, self.marker,
            self.current,
        )  # fmt: skip
        for item in (self.weyl, self.multiplets, self.points, self.zeros):
            item.setCacheMode(item.CacheMode.DeviceCoordinateCache)  # the same for all indices
        # neurons have far more eigenvalues than Weyl's law, which must not set the scale
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
        self.zeros.setBrush(color(colors.surface))
        self.zeros.setPen(rim(colors.accent, 1.5))
        self.current.setBrush(color(colors.marker))
        self.current.setPen(rim(colors.surface, 1.5))
        self.marker.setPen(solid(colors.marker, 1.0, 0.7))
        self.marker.setHoverPen(solid(colors.marker, 3.0))

    def labels(self) -> tuple[str, str]:
        """Labels of the axes, with units."""
        return "Index", named_quantity("λ", self._document.unit, -2)

    def legend(self) -> str:
        """Legend as rich text."""
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

    def refresh_spectrum(self) -> None:
        """Draw the pairs computed so far, on axes that extend to all requested ones."""
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
        # approximate ones are pale
        self.points.setBrush(color(theme.palette().accent, 0.45 if spectrum.preview else 1.0))
        self.points.setData(index[zeros:], heights[zeros:], size=size)
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
        """Move the marker to the displayed eigenfunction."""
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
        """The eigenvalues, and Weyl's law, where they are drawn."""
        spectrum, colors = self._document.spectrum, theme.palette()
        along, law = self.weyl.getData()
        if spectrum is None or along is None:
            return []
        values = spectrum.eigenvalues
        name = "approximate eigenvalue" if spectrum.preview else "eigenvalue"
        return [
            Series(name, np.arange(len(values)), values, colors.accent),
            Series("Weyl’s law", along, 10.0**law if self.log else law, colors.reference),
        ]

    def select(self, x: float, _y: float) -> None:
        """Display the eigenfunction at a position of the plot."""
        display = self._document.display
        display.show(replace(display[Eigenfunctions], index=self.index_at(x)))

    @property
    def family(self) -> Family:
        """The family whose eigenvalues are drawn."""
        return self._document.display[Eigenfunctions]

    @property
    def index(self) -> int:
        """Index of the chosen pair, limited to those computed."""
        spectrum, chosen = self._document.spectrum, self._document.display[Eigenfunctions]
        return chosen.index if spectrum is None else chosen.within(spectrum).index

    def index_at(self, x: float) -> int:
        """Index of the pair nearest to a position of the plot."""
        spectrum = self._document.spectrum
        last = len(spectrum) - 1 if spectrum is not None else 0
        return min(max(round(x), 0), max(last, 0)) if math.isfinite(x) else 0

    def _drag(self, marker: pg.InfiniteLine) -> None:
        if self._document.spectrum is not None:
            self.select(float(marker.value()), 0.0)

    def _heights(self, eigenvalues: npt.NDArray[np.float64], zeros: int) -> npt.NDArray[np.float64]:
        if not self.log:
            return np.asarray(np.maximum(eigenvalues, 0.0))
        # zero has no logarithm: zero modes are drawn below the first nonzero eigenvalue
        rest = eigenvalues[zeros:]
        floor = rest[0] / 3.0 if len(rest) else 1.0
        return np.asarray(np.log10(np.concatenate([np.full(zeros, floor), rest])))
