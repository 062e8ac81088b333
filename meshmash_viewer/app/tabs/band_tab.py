"""Controls of the geometry vectors: how many B-spline bands, over which range, and which one."""

from __future__ import annotations

import numpy as np
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSpinBox

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import (
    Facts,
    estimated_pairs,
    format_wavelength,
    note,
    show_note,
)
from meshmash_viewer.app.controls.range_box import RangeBox
from meshmash_viewer.app.plots.band_curves import band_centers, band_support
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.model.display import MOST_BANDS, FieldKind
from meshmash_viewer.model.ranges import band_range, first_nonzero
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.units import format_quantity, power_unit

__all__ = ["BandTab"]

_FACTS = {
    "band_center_label": "Centre λ",
    "band_wavelength_label": "Wavelength there",
    "band_support_label": "Not zero between",
    "band_pairs_label": "Eigenpairs in it",
}


class BandTab(FieldStepper):
    """Step through the bands; their number and range are those of the exported feature."""

    kind = FieldKind.BAND

    def _build(self) -> None:
        column = self._build_head(("band_label", "Band"), ("band_slider", "Band"))
        row = QHBoxLayout()
        row.setSpacing(theme.GAP)
        self.spin = self._index_spin("band_spin", "Band, counted from 0")
        self.play_button = PlayButton(self._document, "band_play_button", self)
        row.addWidget(self.spin)
        row.addWidget(self.play_button)
        row.addStretch(1)
        column.addLayout(row)
        self.facts = Facts(_FACTS, self)
        column.addWidget(self.facts)

        column.addWidget(theme.with_role(QLabel("Bands", self), "heading"))
        line = QHBoxLayout()
        self.count_spin = QSpinBox(self)
        self.count_spin.setObjectName("band_count_spin")
        self.count_spin.setAccessibleName("Number of bands")
        self.count_spin.setToolTip("Columns of the exported feature; cubic B-splines that sum to 1")
        self.count_spin.setRange(1, MOST_BANDS)
        self.count_spin.setKeyboardTracking(False)
        self.count_spin.valueChanged.connect(self._set_count)
        line.addWidget(theme.with_role(QLabel("Number of bands", self), "muted"))
        line.addStretch(1)
        line.addWidget(self.count_spin)
        column.addLayout(line)
        self.range_box = RangeBox(
            ("band_automatic_check", "band_min_field", "band_max_field"),
            ("Automatic, from 0 to λ_max", "Lowest", "Highest"),
            "eigenvalue",
            self,
            zero_allowed=True,
        )
        self.range_box.check.setToolTip("The ends can be dragged on the spectrum, too")
        self.range_box.automatic_chosen.connect(self._set_automatic)
        self.range_box.range_given.connect(self._set_range)
        column.addWidget(self.range_box)
        self.missing_note = note("band_missing_label", "warning", self)
        column.addWidget(self.missing_note)
        column.addStretch(1)

    # -- from the person --------------------------------------------------------------------

    def _range(self) -> tuple[float, float] | None:
        spectrum = self._document.spectrum
        if spectrum is None or first_nonzero(spectrum) >= len(spectrum):
            return None
        return band_range(spectrum, self._document.display)

    def _choose(self, band: int) -> None:
        self._document.display.band = band

    def _set_count(self, count: int) -> None:
        display = self._document.display
        display.band = min(display.band, count - 1)
        display.band_count = count

    def _set_automatic(self, on: bool) -> None:
        between, display = self._range(), self._document.display
        if not on and between is not None:
            display.band_min, display.band_max = between  # go on from what was automatic
        display.band_automatic = on

    def _set_range(self, low: float, high: float) -> None:
        display = self._document.display
        display.band_min, display.band_max = low, high
        display.band_automatic = False

    # -- from the model ---------------------------------------------------------------------

    def refresh(self) -> None:
        """Show what the model holds."""
        document, display = self._document, self._document.display
        unit = document.mesh.unit if document.mesh is not None else ""
        last = display.band_count - 1
        band = min(display.band, last)
        for control in (self.slider, self.spin):
            blocked = control.blockSignals(True)
            control.setRange(0, last)
            control.setValue(band)
            control.blockSignals(blocked)
        self.spin.setSuffix(f" of {last}")
        blocked = self.count_spin.blockSignals(True)
        self.count_spin.setValue(display.band_count)
        self.count_spin.blockSignals(blocked)
        between, spectrum = self._range(), document.spectrum
        self.range_box.show_range(between, power_unit(unit, -2), automatic=display.band_automatic)
        self.title.setText(f"Band {band}")
        if between is None or spectrum is None:
            for name in _FACTS:
                self.facts.show_value(name, "")
            show_note(self.missing_note, "")
            return
        low, high = between
        center = float(band_centers(low, high, display.band_count)[band])
        start, end = band_support(low, high, display.band_count, band)
        eigenvalues = spectrum.eigenvalues
        pairs = np.searchsorted(eigenvalues, [start, end])
        self.facts.show_value("band_center_label", format_quantity(center, unit, -2))
        self.facts.show_value("band_wavelength_label", format_wavelength(center, unit))
        self.facts.show_value(
            "band_support_label", f"{start:.3g} – {format_quantity(end, unit, -2, 3)}"
        )
        self.facts.show_value("band_pairs_label", str(int(pairs[1] - pairs[0])))
        self._mark_missing(spectrum, high, unit)

    def _mark_missing(self, spectrum: Spectrum, high: float, unit: str) -> None:
        known = max(float(spectrum.eigenvalues[-1]), spectrum.known_to)
        if high <= known * (1.0 + 1e-9) or 0 < spectrum.n_vertices <= len(spectrum):
            show_note(self.missing_note, "")
            return
        mesh = self._document.mesh
        pairs = f", {estimated_pairs(spectrum, mesh.area, high)}" if mesh is not None else ""
        show_note(
            self.missing_note,
            f"Bands above λ = {format_quantity(known, unit, -2, 3)} need more eigenpairs{pairs}.",
        )
