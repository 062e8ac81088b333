"""The Profiles panel: plots of a feature at the pinned vertices, in the colours of the pins."""

from __future__ import annotations

from functools import partial
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pyqtgraph as pg
from PySide6.QtCore import QPoint, Signal
from PySide6.QtGui import QResizeEvent

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import holder, row
from meshmash_viewer.app.executor import Call, Slot
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.panels.pin_list import MOST_SHOWN, PinLegend, PinTable
from meshmash_viewer.app.plots.panel import PlotPanel, PlotSaver
from meshmash_viewer.app.plots.plot import Plot, Series, color, hatch, marker, solid
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family, Profile
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Labels of the families that have profiles, features first.
_VIEWS = {
    name: family.short
    for name, family in sorted(FAMILIES.items(), key=lambda item: not item[1].counted)
    if family.export and family.profile is not Family.profile
}

#: Number of eigenfunctions shown at once; the curves of hundreds would fill the plot.
_AT_ONCE = 60
#: Largest distance in pixels between the pointer and the curve that it highlights.
_NEAR = 8.0
#: Width of the panel in logical pixels below which the legend shows only numbers.
_NARROW = 340
#: Eigenpairs, and vertices at which eigenfunctions are read.
_Request: TypeAlias = tuple[Eigenpairs, tuple[int, ...]]


def _values_at(request: _Request, call: Call) -> npt.NDArray[np.float64]:
    """Read the k eigenfunctions at m vertices, shape (k, m).

    Eigenfunctions are read one by one, as NumPy keeps the interpreter lock during a copy from disk.
    """
    (spectrum, vertices), rows = request, []
    for at in range(len(spectrum)):
        if call.cancelled():
            raise Cancelled
        rows.append(spectrum.shown_rows[at, np.array(vertices)])
    return np.reshape(rows, (len(rows), len(vertices)))


class ProfilePanel(PlotPanel):
    """Bottom panel with profiles of the displayed family, or of a family chosen by the user."""

    #: Vertex of the pin under the pointer in a list or on the plot, -1 for none.
    pin_pointed = Signal(int)
    #: Vertex of a pin double-clicked in a list.
    pin_activated = Signal(int)
    #: Vertex of a right-clicked pin, -1 for none, and the position on the screen.
    menu_requested = Signal(int, QPoint)

    def __init__(self, document: Document) -> None:
        super().__init__(document, "profile", "Profiles")
        self._shown = ""
        self._page: int | None = None
        self._paged = True
        self._pointed = self._hovered = self._pointed_outside = -1
        self._drawn: tuple[Eigenpairs, Family] | None = None
        self._profile: Profile | None = None
        self._curves: dict[Pin, tuple[pg.PlotCurveItem, pg.ScatterPlotItem]] = {}
        #: Eigenfunctions by pinned vertex, kept until the last request has been answered.
        self._values: dict[int, npt.NDArray[np.float64]] = {}
        self._requested: _Request | None = None
        self._reader = Slot(self, "profiles")
        self._build()
        follow((document.spectrum_changed, document.pins.changed), self._refresh)
        follow(document.display.events, self._refresh_display)
        follow(document.display.events.kind, self._follow_kind)
        theme.notifier().changed.connect(self._dress)
        self._dress()
        self._follow_kind()

    def _build(self) -> None:
        self.view_choice = make.combo(
            "profile_view", "Feature shown by the profiles", self._show_view, _VIEWS
        )
        tip = "More than 1 % of these values is missing, because eigenpairs are missing"
        self.missing_label = make.label("profile_missing_label", role="muted", tip=tip)
        self.plot = Plot("profile_plot", "Profiles of the pinned vertices")
        self.legend, self.table = PinLegend(self._document), PinTable(self._document)
        tip = "The pins with their names, indices, values and positions"
        self.table_check = make.check(
            "Table", "pin_table_check", "Table of the pins", self._refresh, tip=tip
        )
        shown = holder(row((self.plot,), self.legend, spacing=0))
        self._arrange((self.view_choice, self.table_check), (self.missing_label,), shown)
        self._stack.addWidget(self.table)
        self._missing = pg.LinearRegionItem(movable=False)
        self._zero = pg.InfiniteLine(pos=0.0, angle=0)
        self._marker = marker(self._drag, self._refresh_display)
        for item in (self._missing, self._zero, self._marker):
            self.plot.addItem(item, ignoreBounds=True)
        self.saver = PlotSaver(self.plot, self._document, self._numbers, self._dress)
        self.plot.clicked.connect(self._select)
        self.plot.hovered.connect(self._hover)
        self.plot.fit_button.clicked.connect(self._stop_paging)
        self.plot.plotItem.vb.sigRangeChangedManually.connect(self._stop_paging)
        for each in (self.legend, self.table):
            each.pointed.connect(self._tell_pointed)
            each.activated_pin.connect(self.pin_activated)
            each.menu_requested.connect(self.menu_requested)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.legend.set_short(self.width() < _NARROW)

    # -- from the user ----------------------------------------------------------------------

    def _show_view(self, key: str) -> None:
        self.view_choice.setCurrentIndex(self.view_choice.findData(key))
        if key != self._shown:
            self._shown, self._page, self._paged = key, None, True
            self.plot.show_all()
            self._refresh()

    def _select(self, x: float, _y: float) -> None:
        spectrum = self._document.spectrum
        if spectrum is not None and self._profile is not None:
            self._document.display.show(self._family.at_place(spectrum, x))

    def _drag(self, marker: pg.InfiniteLine) -> None:
        self._select(float(marker.value()), 0.0)

    def _stop_paging(self, *_: object) -> None:
        """Keep the range of the plot after the user has zoomed."""
        self._paged = False

    def _hover(self, x: float, y: float) -> None:
        nearest, least = -1, _NEAR
        wide, tall = self.plot.plotItem.vb.viewPixelSize()
        for pin, (curve, _) in self._curves.items():
            places, heights = curve.getData()
            if places is None or not len(places):
                continue
            # also the distance from the line between two points
            height = np.interp(x, places, heights)
            distance = np.hypot((places - x) / wide, (heights - y) / tall).min()
            distance = min(float(distance), abs(float(height) - y) / tall)
            if distance < least:
                nearest, least = pin.vertex, distance
        self._tell_pointed(nearest)

    def _tell_pointed(self, vertex: int) -> None:
        if vertex != self._hovered:
            self._hovered = vertex
            self._bring_forward()
            self.pin_pointed.emit(vertex)

    def point_at(self, vertex: int) -> None:
        """Highlight the pin of a vertex, or no pin (-1); a pin under the pointer has precedence."""
        self._pointed_outside = vertex
        self._bring_forward()

    @property
    def chosen_pin(self) -> int:
        """Vertex of the pin under the pointer in any view, or chosen in the table; -1 for none."""
        pointed = self._hovered if self._hovered >= 0 else self._pointed_outside
        return pointed if pointed >= 0 or not self.table.isVisible() else self.table.chosen

    def _bring_forward(self) -> None:
        vertex = self._hovered if self._hovered >= 0 else self._pointed_outside
        vertex = vertex if any(pin.vertex == vertex for pin in self._curves) else -1
        if vertex != self._pointed:
            self._pointed = vertex
            self.legend.point_at(vertex)
            for pin in self._curves:
                self._dress_curve(pin)

    def _numbers(self) -> list[Series]:
        found, (log_bottom, log_left, _) = list[Series](), self._family.logarithmic
        for pin in self._document.pins.placed:
            values, profile = self._values.get(pin.vertex), self._profile
            if pin in self._curves and values is not None and profile is not None:
                x, y = profile.dots.values(values)
                x, y = 10.0**x if log_bottom else x, 10.0**y if log_left else y
                found.append(Series(pin.title, x, y, pin.color))
        return found

    # -- from the model ---------------------------------------------------------------------

    def _follow_kind(self) -> None:
        self._show_view(self._document.display.profile_family.name)

    @property
    def _family(self) -> Family:
        return self._document.display.fields[self._shown]

    def _refresh(self) -> None:
        """Draw the profiles whose values have been read, and request the others."""
        pins, spectrum = self._document.pins.placed[:MOST_SHOWN], self._document.spectrum
        there = bool(pins) and spectrum is not None and len(spectrum) > 0
        read = [self._values[pin.vertex] for pin in pins if pin.vertex in self._values]
        valued = not read or any(np.isfinite(values).all() for values in read)
        self._show_plot(there and valued)
        self.head.show_controls(bool(pins))
        if pins and self.table_check.isChecked():
            self._stack.setCurrentWidget(self.table)
        if pins and there:
            text = "No pin has a value: the pins are on no face, or outside the computed part."
        elif pins:
            text = "Compute eigenpairs to see the profiles of the pinned vertices."
        else:
            text = "Click a vertex on the render to compare its profile."
        self.empty.setText(text)
        for pin in [pin for pin in self._curves if pin not in pins or not there]:
            for item in self._curves.pop(pin):
                self.plot.removeItem(item)
        if spectrum is None or not there:
            self._reader.drop()
            self._requested, self._values = None, {}
            self._drawn = self._profile = None  # release a mesh that may be closed
            return
        request = spectrum, tuple(pin.vertex for pin in pins)
        if request != self._requested:
            self._requested = request
            self._reader.submit(
                partial(_values_at, request), partial(self._take, request), self._fail
            )
            if any(pin.vertex not in self._values for pin in pins):
                return  # all curves are drawn when these values have been read
        bottom, left, _ = self._family.logarithmic
        self.plot.set_log(bottom, left)
        self._profile = self._family.profile(spectrum, self._document.unit)
        self.plot.set_labels(*(("", "") if self._profile is None else self._profile.axes))
        places = np.zeros(0) if self._profile is None else self._profile.dots.places
        self.plot.set_whole(bool(np.all(places == np.round(places))))
        for pin in pins:
            values = self._values.get(pin.vertex)
            if values is not None:
                self._draw(pin, values[: len(spectrum)], self._profile)
        self._drawn = self._key()
        self._mark(spectrum)

    def _take(self, request: _Request, values: npt.NDArray[np.float64]) -> None:
        if request == self._requested:
            self._values = dict(zip(request[1], values.T, strict=True))
            self._refresh()

    def _fail(self, fault: Exception) -> None:
        self._requested = None
        raise fault

    def _refresh_display(self) -> None:
        spectrum = self._document.spectrum
        if not self._curves or spectrum is None:
            return
        if self._key() != self._drawn:
            self._refresh()
        else:
            self._mark(spectrum)

    def _key(self) -> tuple[Eigenpairs, Family] | None:
        """Return the spectrum and family on which the curves depend; None without a spectrum."""
        display, spectrum = self._document.display, self._document.spectrum
        if spectrum is None:
            return None
        return spectrum, self._family.resolved(spectrum, display.fields).at_rest()

    def _draw(self, pin: Pin, values: np.ndarray, profile: Profile | None) -> None:
        if pin not in self._curves:
            curve, dots = pg.PlotCurveItem(), pg.ScatterPlotItem(pxMode=True)
            dots.setPen(None)
            dots.setBrush(color(pin.color))
            self._curves[pin] = curve, dots
            self.plot.addItem(curve)
            self.plot.addItem(dots)
        curve, dots = self._curves[pin]
        if profile is None or not np.isfinite(values).all():  # vertices of no face have no value
            curve.setData([], [])
            dots.setData([], [])
            return
        self._dress_curve(pin)
        curve.setData(*profile.curve.values(values))
        places, heights = profile.dots.values(values)
        dots.setData(places, heights, size=5.0 if len(places) <= 200 else 3.5)

    def _dress_curve(self, pin: Pin) -> None:
        """Colour the curve of a pin, pale while another curve is highlighted."""
        curve, dots = self._curves[pin]
        forward = pin.vertex == self._pointed
        width, strength = (1.0, 0.45) if self._family.signed else (2.0, 1.0)
        if self._pointed >= 0:
            strength = 1.0 if forward else 0.2
        curve.setPen(solid(pin.color, width + forward, strength))
        dots.setBrush(color(pin.color, 0.2 if self._pointed >= 0 and not forward else 1.0))
        for item in (curve, dots):
            item.setZValue(1.0 if forward else 0.0)

    def _turn_page(self, at: float, last: float) -> None:
        """Show the range of `_AT_ONCE` eigenfunctions that contains the displayed one."""
        if not self._family.signed or not self._paged:
            return
        page = int(at) // _AT_ONCE
        if page != self._page:
            self._page = page
            box = self.plot.plotItem.vb
            if last < _AT_ONCE:
                self.plot.show_all()
            else:
                first = min(page * _AT_ONCE, last + 1 - _AT_ONCE)
                box.setAutoVisible(y=True)
                box.setXRange(first - 1, first + _AT_ONCE, padding=0.0)
                box.enableAutoRange(axis="y")

    def _mark(self, spectrum: Eigenpairs) -> None:
        """Mark the displayed position and the range that needs more eigenpairs."""
        self._zero.setVisible(self._family.signed)
        self._marker.setVisible(self._profile is not None)
        if self._profile is None:
            return
        at, missing = self._family.place(spectrum), self._profile.unresolved
        first, last = self._profile.dots.places[[0, -1]].tolist()
        self._marker.setBounds([min(first, at), max(last, at)])
        if not self._marker.moving:
            self._marker.setValue(at)
            self._turn_page(at, last)
        self._missing.setVisible(missing is not None)
        n_pins = len(self._document.pins.placed)
        some = f"First {MOST_SHOWN} of {n_pins} pins" if n_pins > MOST_SHOWN else ""
        self.missing_label.setText(some if missing is None else "Hatched: misses over 1 %")
        self.head.fit()
        if missing is not None:
            self._missing.setRegion(missing)

    def _dress(self) -> None:
        colors = theme.palette()
        self._marker.setPen(solid(colors.marker, 1.2, 0.8))
        self._marker.setHoverPen(solid(colors.marker, 3.0))
        self._zero.setPen(solid(colors.reference, 1.0))
        hatch(self._missing)
        for pin in self._curves:
            self._dress_curve(pin)
