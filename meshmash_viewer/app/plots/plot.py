"""Plots in the colours of the theme, with tick labels such as 2×10⁻⁸."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import QPoint, QPointF, Qt, Signal
from PySide6.QtGui import (
    QBrush,
    QColor,
    QContextMenuEvent,
    QFont,
    QFontMetricsF,
    QGuiApplication,
    QPen,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QToolButton

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.field_events import scroll_area
from meshmash_viewer.app.listening import later
from meshmash_viewer.units import engineering, minus, named_quantity, power_text, superscript


def color(name: str, alpha: float = 1.0) -> QColor:
    """Return a colour with an opacity."""
    result = QColor(name)
    result.setAlphaF(alpha)
    return result


class _Pens:
    """Scale of the pens of lines, whose widths are in pixels of the screen or picture in Qt.

    Rims of points are not scaled: pyqtgraph adjusts automatic ranges to the widest rim ever drawn.
    """

    #: Pixels of a picture per logical pixel; None for the screen.
    scale: float | None = None

    @classmethod
    def wide(cls, width: float) -> float:
        """Return the width of a pen in pixels; `width` is in logical pixels."""
        if cls.scale is not None:
            return width * cls.scale
        return width * QGuiApplication.primaryScreen().devicePixelRatio()


@contextmanager
def scaled_pens(scale: float) -> Iterator[None]:
    """Scale the pens made within the context, for a picture of a higher resolution."""
    _Pens.scale = scale
    try:
        yield
    finally:
        _Pens.scale = None


def solid(name: str, width: float = 1.0, alpha: float = 1.0) -> QPen:
    """Return a pen whose width does not depend on the zoom."""
    return QPen(pg.mkPen(color(name, alpha), width=_Pens.wide(width)))


def rim(name: str, width: float) -> QPen:
    """Return a pen for the rims of points."""
    return QPen(pg.mkPen(color(name), width=width))


def dashed(name: str, width: float = 1.0) -> QPen:
    """Return a dashed pen whose width does not depend on the zoom."""
    return QPen(pg.mkPen(color(name), width=_Pens.wide(width), style=Qt.PenStyle.DashLine))


def hatch(region: pg.LinearRegionItem) -> None:
    """Hatch a region of eigenvalues that have not been computed."""
    name = theme.palette().hatch
    region.setBrush(QBrush(color(name, 0.8), Qt.BrushStyle.BDiagPattern))
    for line in region.lines:
        line.setPen(solid(name, 1.0, 0.0))


def marker(drag: Callable[[pg.InfiniteLine], None], settle: Callable[[], None]) -> pg.InfiniteLine:
    """Return a vertical line; `drag` is called while it is dragged, `settle` at its release."""
    line = pg.InfiniteLine(angle=90, movable=True)
    line.setCursor(Qt.CursorShape.SizeHorCursor)
    line.sigDragged.connect(drag)
    line.sigPositionChangeFinished.connect(settle)
    return line


def _named(label: str) -> tuple[str, str]:
    """Split a text made by `units.named_quantity` into name and unit."""
    name, _, unit = label.removesuffix(")").rpartition(" (")
    return (name, unit) if name and label.endswith(")") else (label, "")


#: Minimum distance in pixels between labels of a logarithmic axis, horizontal and vertical.
_CLOSEST = 44.0, 18.0
#: Widest label of the left axis.
_WIDEST = "−2.5×10⁻⁵"
#: Approximate maximum power of ten of a float.
_POWERS = 300.0


class ScientificAxis(pg.AxisItem):  # type: ignore[misc]  # pyqtgraph ships no types
    """An axis with labels such as 2×10⁻⁸, in a unit chosen for its range."""

    #: Unit of the data.
    unit = ""

    def __init__(self, orientation: str) -> None:
        super().__init__(orientation)
        #: Whether ticks are integers.
        self.whole = False
        #: Number of powers of ten from 0 to 1; 0 for a linear axis.
        self.decades = 0

    def resizeEvent(self, event: Any = None) -> None:
        super().resizeEvent(event)
        if self.orientation == "left" and self.label is not None:
            self.label.setRotation(0.0)
            self.label.setPos(0.0, -self.label.boundingRect().height())

    def _updateWidth(self) -> None:
        """Set the width of the axis to the width of the tick labels."""
        super()._updateWidth()
        if self.label.isVisible():
            # subtract 0.8 of the height of the label, added by pyqtgraph
            wide = self.maximumWidth() - 0.8 * self.label.boundingRect().height()
            self.setMinimumWidth(wide)
            self.setMaximumWidth(wide)

    def updateAutoSIPrefix(self) -> None:
        """Choose a unit for the range; pyqtgraph's prefixes are wrong for nm⁻²."""
        low, high = self.range
        # the range may still be in indices, and 10 to the power of an index may exceed a float
        power = min(max((low + high) / 2.0, -_POWERS), _POWERS)
        size = 10.0**power if self.logMode else max(abs(low), abs(high))
        exponent, written = engineering(size, self.unit)
        self.autoSIPrefixScale: float = 10.0**exponent
        self.labelUnits: str = written
        self._updateLabel()

    def labelString(self) -> str:
        style = ";".join(f"{name}: {value}" for name, value in self.labelStyle.items())
        return f"<span style='{style}'>{named_quantity(self.labelText, self.labelUnits)}</span>"

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str | None]:
        if self.decades and not self.logMode:
            powers = [self.decades * (value - 1.0) for value in values]
            return [power_text(round(p)) if abs(p - round(p)) < 1e-9 else None for p in powers]
        if self.logMode:
            low, high = self.range
            upright = self.orientation == "left"
            pixels = self.height() if upright else self.width()
            # labels at 1 and 2 times a power of ten are 0.3 decades apart
            close = 0.3 * pixels < _CLOSEST[upright] * (high - low)
            factors = (1, 10) if high - low > 1.0 and close else (1, 2, 5, 10)
            powers = [value + math.log10(scale) for value in values]
            parts = [(math.floor(power + 1e-9), power) for power in powers]
            multiples = [(whole, round(10.0 ** (power - whole))) for whole, power in parts]
            return [power_text(*each) if each[1] in factors else None for each in multiples]
        texts: list[str] = super().tickStrings(values, scale, spacing)
        largest = max(map(abs, self.range)) * scale
        if not 1e-3 <= largest < 1e5:  # use the power of ten of the largest value in all labels
            power = math.floor(math.log10(largest or 1.0))
            ten = f"×10{superscript(power)}"
            texts = [f"{value * scale / 10.0**power:.4g}{ten}" for value in values]
            texts = ["0" if text == f"0{ten}" else text for text in texts] if power else texts
        return [minus(text) for text in texts]

    def tickSpacing(self, low: float, high: float, size: float) -> list[tuple[float, float]]:
        spacing: list[tuple[float, float]] = super().tickSpacing(low, high, size)
        if not self.whole:
            return spacing
        steps = {max(round(step), 1) for step, _ in spacing}
        return [(float(step), 0.0) for step in sorted(steps, reverse=True)]


class Plot(pg.PlotWidget):  # type: ignore[misc]  # pyqtgraph ships no types
    """A plot in the theme's colours.

    The wheel zooms (in a scrolling panel only if the plot has the focus), a drag pans, and the
    button "Fit" shows all data. A right click or the menu key requests a menu, see
    `meshmash_viewer.app.plots.panel`.
    """

    #: Position in plot coordinates.
    clicked = Signal(float, float)
    #: Position in plot coordinates; NaN when the pointer leaves the plot.
    hovered = Signal(float, float)
    #: Position of the menu on the screen.
    menu_requested = Signal(QPoint)

    def __init__(self, name: str, accessible_name: str) -> None:
        axes = {side: ScientificAxis(side) for side in ("left", "bottom")}
        super().__init__(axisItems=axes, enableMenu=False)
        theme.named(self, name, accessible_name)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)  # not by Tab: panels handle the keys
        self.setFrameShape(self.Shape.NoFrame)
        self.setMinimumSize(120, 110)
        self.setAntialiasing(True)
        self.hideButtons()
        # pyqtgraph makes the menu without a parent, so it would outlive the plot
        menu = self.plotItem.ctrlMenu
        menu.setParent(self, menu.windowFlags())
        self.fit_button = QToolButton(self)
        fit, tip = f"Fit the plot: {accessible_name}", "Show all drawn data"
        theme.named(self.fit_button, f"{name}_fit_button", fit, tip=tip)
        self.fit_button.setText("Fit")
        self.fit_button.clicked.connect(self.show_all)
        self._labels = {"left": "", "bottom": ""}
        self._heights: tuple[float, float] | None = None
        self.scene().sigMouseClicked.connect(self._click)
        self.scene().sigMouseMoved.connect(self._move)
        theme.notifier().changed.connect(self.dress)
        self.dress()

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom, or scroll the panel if it can scroll and the plot has no focus."""
        if scroll_area(self) is None or self.hasFocus():
            super().wheelEvent(event)
        else:
            event.ignore()

    def paint_later(self) -> None:
        self.setUpdatesEnabled(False)
        later(self._paint)

    def _paint(self) -> None:
        self.setUpdatesEnabled(True)

    def set_labels(self, bottom: str, left: str) -> None:
        if self._labels != {"left": left, "bottom": bottom}:
            self._labels = {"left": left, "bottom": bottom}
            self._dress_axes()

    @property
    def labels(self) -> tuple[str, str]:
        return self._labels["bottom"], self._labels["left"]

    def set_log(self, bottom: bool, left: bool) -> None:
        """Label axes with powers of ten; the data must be logarithms already."""
        for side, on in (("bottom", bottom), ("left", left)):
            axis = self.getAxis(side)
            if axis.logMode != on:
                axis.setLogMode(on)

    def set_whole(self, whole: bool) -> None:
        """Set whether the ticks of the bottom axis are integers."""
        self.getAxis("bottom").whole = whole

    def dress(self) -> None:
        self.setBackground(theme.palette().surface)
        self._dress_axes()

    def _dress_axes(self) -> None:
        colors = theme.palette()
        font = theme.tabular(QFont(self.font()))
        font.setPointSizeF(max(self.font().pointSizeF() * 0.9, 6.0))
        for side, text in self._labels.items():
            axis = self.getAxis(side)
            axis.setPen(solid(theme.palette().border_strong))
            axis.setTextPen(solid(colors.axis))
            # a fixed width, because pyqtgraph's width depends on the previous labels
            wide = round(QFontMetricsF(font).horizontalAdvance(_WIDEST))
            axis.setStyle(
                tickFont=font,
                tickLength=-4,
                autoExpandTextSpace=side == "bottom",
                tickTextWidth=wide,
                hideOverlappingLabels=True,
            )
            axis.label.setFont(font)
            name, axis.unit = _named(text)
            style = {"color": colors.axis, "font-size": f"{font.pointSizeF()}pt"}
            axis.setLabel(name, axis.unit, **style)
            axis.updateAutoSIPrefix()
            axis.setGrid(False)
        above = self.getAxis("left").label.boundingRect().height() if self._labels["left"] else 1.0
        self.plotItem.layout.setContentsMargins(1.0, above, 1.0, 1.0)

    def show_all(self) -> None:
        self.plotItem.vb.enableAutoRange()
        if self._heights is not None:
            self.plotItem.vb.setYRange(*self._heights, padding=0.0)

    def set_heights(self, heights: tuple[float, float] | None) -> None:
        """Fix the range of the left axis; None makes the range automatic."""
        self._heights = heights
        self.setMouseEnabled(x=True, y=heights is None)

    def pixel_of(self, x: float, y: float) -> QPointF:
        """Return the position on the widget of a point in plot coordinates."""
        return QPointF(self.mapFromScene(self.plotItem.vb.mapViewToScene(QPointF(x, y))))

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        super().resizeEvent(event)
        if event is not None:  # pyqtgraph passes None before the button exists
            self.fit_button.move(0, self.height() - self.fit_button.sizeHint().height())

    def leaveEvent(self, event: object) -> None:
        self.hovered.emit(math.nan, math.nan)
        super().leaveEvent(event)

    def _point(self, position: QPointF) -> QPointF | None:
        box = self.plotItem.vb
        inside = box.sceneBoundingRect().contains(position)
        return QPointF(box.mapSceneToView(position)) if inside else None

    def _click(self, event: Any) -> None:
        point = self._point(event.scenePos())
        if event.button() == Qt.MouseButton.LeftButton and point is not None:
            self.clicked.emit(point.x(), point.y())
        elif event.button() == Qt.MouseButton.RightButton:
            self.menu_requested.emit(QPointF(event.screenPos()).toPoint())

    def contextMenuEvent(self, event: QContextMenuEvent) -> None:
        """Request the menu if the menu key was pressed; `_click` handles the right button."""
        if event.reason() == QContextMenuEvent.Reason.Keyboard:
            self.menu_requested.emit(self.mapToGlobal(self.rect().center()))
        event.accept()

    def _move(self, position: QPointF) -> None:
        point = self._point(position)
        if point is not None:
            self.hovered.emit(point.x(), point.y())


@dataclass(frozen=True, eq=False)
class Series:
    """A curve or points in the units of a `Plot`; the legend lists series with a `color`."""

    name: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    color: str = ""
    #: Relative errors of y, for the table of the plot; empty if unknown.
    errors: npt.ArrayLike = ()


#: Magnitude above which entries have the full colour; entries of a refined map are at most 1.
_FULL = 0.5


class MatrixView(Plot):
    """Plot of the matrix of a functional map; the colours of entries depend on sign and size."""

    def __init__(self, name: str) -> None:
        self._image = pg.ImageItem(axisOrder="row-major")
        #: Displayed matrix.
        self.matrix = np.zeros((0, 0))
        super().__init__(name, "Matrix of the functional map")
        self.addItem(self._image)
        self.set_whole(True)
        self.getAxis("left").whole = True
        self.plotItem.vb.invertY(True)
        self.set_labels("Eigenfunctions of the second", "Of the first")
        self.setFixedHeight(190)

    def show_matrix(self, matrix: npt.NDArray[np.float64]) -> None:
        """Show a matrix of shape (k, l)."""
        self.matrix = matrix
        self._image.setImage(matrix, levels=(-_FULL, _FULL))
        rows, columns = matrix.shape
        self._image.setRect(-0.5, -0.5, columns, rows)  # entries are centred on their indices
        self.show_all()

    def dress(self) -> None:
        super().dress()
        palette = theme.palette()
        colors = palette.series[0], palette.surface, palette.series[1]
        ends = [pg.mkColor(each).getRgb()[:3] for each in colors]
        self._image.setColorMap(pg.ColorMap([0.0, 0.5, 1.0], np.array(ends, dtype=np.ubyte)))
