"""The Spectrum panel: a plot of the eigenvalues, or of filter responses over them."""

from __future__ import annotations

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGraphicsTextItem

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import show_quietly
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.app.plots.panel import PlotPanel, PlotSaver
from meshmash_viewer.app.plots.plot import Plot
from meshmash_viewer.app.plots.spectrum_views import EigenvalueView, ResponseView
from meshmash_viewer.fields import FAMILIES
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.eigenpairs import format_eigenvalue
from meshmash_viewer.spectral.weyl import format_wavelength
from meshmash_viewer.units import subscript


class SpectrumPanel(PlotPanel):
    """Bottom panel with the plot for the displayed field, or a plot chosen by the user."""

    def __init__(self, document: Document) -> None:
        super().__init__(document, "spectrum", "Spectrum")
        choices = {"eigenvalues": "Eigenvalues", "responses": "Filters"}
        self.view_choice = make.Segments("spectrum_view", "Content of the spectrum plot", choices)
        self.view_choice.chosen.connect(self._show_view)
        self.log_check = make.check(
            "Log λ", "spectrum_log_check", "Eigenvalues in log scale", self._set_log
        )
        self.readout = make.label("spectrum_readout")
        rich = Qt.TextFormat.RichText
        self.legend = make.label("spectrum_legend", textFormat=rich, role="muted")
        self.plot = Plot("spectrum_plot", "Spectrum")
        #: Legend of the grey points, in the plot because the row above has no space for it.
        #: pyqtgraph's LabelItem raises errors when Python collects it after its plot.
        self.remark = QGraphicsTextItem(self.plot.plotItem.vb)
        self.remark.setPos(theme.GAP, 0)
        self._remark = ""
        self.empty.setText("The eigenvalues appear here as they converge.")
        labels = self.readout, self.legend
        self._arrange((self.view_choice, self.log_check), labels, self.plot)
        self._eigenvalues = EigenvalueView(document)
        self._views: dict[str, EigenvalueView | ResponseView] = {
            "eigenvalues": self._eigenvalues,
            "responses": ResponseView(document),
        }
        self._shown = ""
        #: Name of the family and range of the left axis of the drawn responses.
        self._drawn_scale: tuple[str, tuple[float, float] | None] = ("", None)
        #: Whether λ is logarithmic, by name of the family whose responses are shown.
        self._log = {name: family.logarithmic[2] for name, family in FAMILIES.items()}
        self.saver = PlotSaver(self.plot, document, lambda: self.view.numbers(), self._dress)
        self.plot.clicked.connect(self._select)
        self.plot.hovered.connect(self._hover)
        # two separate calls, as the layout of a hidden plot takes as long as filling the plot
        follow((document.spectrum_changed, document.mesh_changed), self._show_what_is_there)
        follow((document.spectrum_changed, document.mesh_changed), self._refresh_spectrum)
        follow(document.display.events, self._refresh_current)
        follow(document.display.events.kind, self._follow_kind)
        theme.notifier().changed.connect(self._dress)
        self._follow_kind()

    @property
    def view(self) -> EigenvalueView | ResponseView:
        return self._views[self._shown]

    # -- from the user ----------------------------------------------------------------------

    def _set_log(self, on: bool) -> None:
        self._log[self.view.family.name] = on
        self._refresh_spectrum()
        self.plot.show_all()

    def _select(self, x: float, y: float) -> None:
        if self._document.spectrum is not None:
            self.view.select(x, y)

    def _hover(self, x: float, _y: float) -> None:
        if self._shown == "eigenvalues" and math.isfinite(x):
            self._read(self._eigenvalues.index_at(x))
        else:
            self._read(None)

    # -- from the model ---------------------------------------------------------------------

    def _follow_kind(self) -> None:
        family = self._document.display.response_family
        responds = family is not None
        noun = Family.response_noun if family is None else family.response_noun
        self.view_choice.set_text("responses", noun)
        self._show_view("responses" if responds else "eigenvalues")

    def follow_field(self) -> None:
        """Update the responses after the field on the render has changed."""
        if self._shown == "responses":
            later(self._refresh_current)

    def _show_view(self, key: str) -> None:
        self.view_choice.show_key(key)
        if key != self._shown:
            if self._shown:
                for item in self.view.items:
                    self.plot.removeItem(item)
            self._shown = key
            for item in self.view.items:
                self.plot.addItem(item, ignoreBounds=item in self.view.unbounded)
            self._refresh_spectrum()
            self.plot.show_all()

    def _show_what_is_there(self) -> None:
        spectrum = self._document.spectrum
        self._show_plot(spectrum is not None and len(spectrum) > 0)

    def _refresh_spectrum(self) -> None:
        self._show_what_is_there()
        bottom, left = self.view.labels()
        log = self._log[self.view.family.name]
        show_quietly(self.log_check, log)
        self.view.log = log
        responses = self._shown == "responses"
        self.plot.set_log(log and responses, log and not responses)
        self.plot.set_labels(bottom, left)
        self.plot.set_whole(not responses)
        self.plot.set_heights(self.view.heights)
        decades = self.view.family.response_decades if responses else 0
        self.plot.getAxis("left").decades = decades
        self.view.refresh_spectrum()
        self._drawn_scale = self.view.family.name, self.view.heights
        self._describe()

    def _refresh_current(self) -> None:
        if (self.view.family.name, self.view.heights) != self._drawn_scale:
            self._refresh_spectrum()
            self.plot.show_all()
        else:
            self.view.refresh_current()
            self._describe()

    def _describe(self) -> None:
        self.legend.setText(self.view.legend())
        remark = self._eigenvalues.remark() if self._shown == "eigenvalues" else ""
        if remark != self._remark:  # unlike QLabel, it would paint the plot again
            self._remark = remark
            self.remark.setHtml(remark)
        self._read(None)
        self.head.fit()

    def _read(self, index: int | None) -> None:
        """Show the eigenvalue of an index, or for None of the displayed position."""
        spectrum, unit = self._document.spectrum, self._document.unit
        if spectrum is None or not len(spectrum) or self._shown != "eigenvalues":
            self.readout.setText("")
            self.plot.setToolTip("")
            return
        index = self._eigenvalues.index if index is None else index
        value = float(spectrum.eigenvalues[index])
        text = (
            f"λ{subscript(index)} {'=' if spectrum.is_exact(index) else '≈'} "
            f"{format_eigenvalue(value, spectrum, unit, 4)}, "
            f"wavelength {format_wavelength(value, unit)}"
        )
        self.readout.setText(text)
        self.plot.setToolTip(text)  # a narrow panel cuts off the readout

    def _dress(self) -> None:
        for view in self._views.values():
            view.dress()
        self._refresh_spectrum()
