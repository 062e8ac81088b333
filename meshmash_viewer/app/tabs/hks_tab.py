"""Controls of the heat kernel signature on the render."""

from __future__ import annotations

import math

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QSpinBox,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import Facts, estimated_pairs, note, show_note
from meshmash_viewer.app.controls.range_box import RangeBox
from meshmash_viewer.app.controls.scale_marks import decade_marks
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.fields.family import MOST_COUNT
from meshmash_viewer.fields.hks import HeatKernelSignature, resolved_from
from meshmash_viewer.fields.spectrum import Spectrum, first_nonzero
from meshmash_viewer.spectral.weyl import required_eigenvalue, resolved_time
from meshmash_viewer.units import format_quantity, power_unit

__all__ = ["HksTab"]

#: Positions of the slider: finer than a pixel.
_POSITIONS = 1000


class HksTab(FieldStepper):
    """Choose a time, in log scale, its range, and the number of times that are exported."""

    family = HeatKernelSignature

    def _build(self) -> None:
        column = self._build_head(
            ("hks_time_label", "Time of the heat kernel signature"),
            ("hks_time_slider", "Time, in log scale"),
        )
        self.slider.setRange(0, _POSITIONS)

        row = QHBoxLayout()
        row.setSpacing(theme.GAP)
        self.play_button = PlayButton(self._document, "hks_play_button", self)
        self.facts = Facts({"hks_length_label": "Length √t"}, self)
        row.addWidget(self.facts, 1)
        row.addWidget(self.play_button)
        column.addLayout(row)
        column.addWidget(theme.with_role(QLabel("Times", self), "heading"))
        self.scales_spin = QSpinBox(self)
        self.scales_spin.setObjectName("hks_scales_spin")
        self.scales_spin.setAccessibleName("Number of times")
        self.scales_spin.setToolTip("Columns of the exported feature, evenly spaced in log t")
        self.scales_spin.setRange(1, MOST_COUNT)
        self.scales_spin.setKeyboardTracking(False)
        self.scales_spin.valueChanged.connect(self._set_scales)
        line = QHBoxLayout()
        line.addWidget(theme.with_role(QLabel("Number of times", self), "muted"))
        line.addStretch(1)
        line.addWidget(self.scales_spin)
        column.addLayout(line)
        self.range_box = RangeBox(
            ("hks_automatic_check", "hks_t_min_field", "hks_t_max_field"),
            ("Automatic, from the spectrum", "Shortest", "Longest"),
            "time",
            self,
        )
        self.range_box.check.setToolTip("4 ln 10 / λ_max to 4 ln 10 / λ₂ (Sun et al. 2009)")
        self.range_box.automatic_chosen.connect(self._set_automatic)
        self.range_box.range_given.connect(self._set_range)
        column.addWidget(self.range_box)  # last, because what it refuses takes room
        self.missing_note = note("hks_missing_label", "warning", self)
        column.addWidget(self.missing_note)
        column.addStretch(1)

    # -- from the person --------------------------------------------------------------------

    def _range(self) -> tuple[float, float] | None:
        spectrum = self._document.spectrum
        if spectrum is None or first_nonzero(spectrum) >= len(spectrum):
            return None
        return self._document.display[HeatKernelSignature].range(spectrum)

    def _choose(self, position: int) -> None:
        between = self._range()
        if between is not None:
            low, high = between
            share = position / self.slider.maximum()
            self._change(time=low * math.exp(share * math.log(high / low)))

    def _set_automatic(self, on: bool) -> None:
        between = self._range()
        if on or between is None:
            self._change(automatic=on)
        else:
            self._set_range(*between)  # go on from what was automatic

    def _set_range(self, low: float, high: float) -> None:
        self._change(t_min=low, t_max=high, automatic=False)

    def _set_scales(self, count: int) -> None:
        self._change(scales=count)

    # -- from the model ---------------------------------------------------------------------

    def refresh(self) -> None:
        """Show what the model holds."""
        document = self._document
        chosen = document.display[HeatKernelSignature]
        unit = document.mesh.unit if document.mesh is not None else ""
        with QSignalBlocker(self.scales_spin):
            self.scales_spin.setValue(chosen.scales)
        between = self._range()
        self.slider.setEnabled(between is not None)
        one = max(round(_POSITIONS / max(chosen.scales - 1, 1)), 1)  # a time of the feature
        self.slider.setSingleStep(one)
        self.slider.setPageStep(min(10 * one, _POSITIONS))
        shortest, longest = (resolved_time(value) for value in document.translation().bounds[::-1])
        self.range_box.set_bounds((shortest, longest), (shortest, longest))
        self.range_box.show_range(between, power_unit(unit, 2), automatic=chosen.automatic)
        if between is None or document.spectrum is None:
            self._show_nothing()
            return
        time = chosen.time_in(document.spectrum)
        low, high = between
        span = math.log(high / low)
        with QSignalBlocker(self.slider):
            self.slider.setValue(round(math.log(time / low) / span * self.slider.maximum()))
        self.slider.set_marks(decade_marks(low, high))
        self.title.setText(f"t = {format_quantity(time, unit, 2)}")
        self.facts.show_value("hks_length_label", format_quantity(math.sqrt(time), unit))
        self._mark_missing(document.spectrum, low, high, time)

    def _show_nothing(self) -> None:
        self.title.setText("t")
        self.facts.show_value("hks_length_label", "")
        self.slider.set_marks(())
        self.slider.set_hatched(None)
        show_note(self.missing_note, "")

    def _mark_missing(self, spectrum: Spectrum, low: float, high: float, time: float) -> None:
        """Hatch the times that the pairs at hand cannot resolve, and say what would do it."""
        resolved = resolved_from(spectrum)
        if resolved <= low * (1.0 + 1e-9):
            self.slider.set_hatched(None)
            show_note(self.missing_note, "")
            return
        share = min(math.log(resolved / low) / math.log(high / low), 1.0)
        self.slider.set_hatched((0.0, share))
        mesh = self._document.mesh
        if mesh is None:
            return
        wanted, what = (time, "This time") if time < resolved else (low, "The hatched part")
        missing = float(spectrum.missing_shares(heat_kernel_bank([wanted]), mesh.area)[0])
        upto = "" if wanted == time else "up to "
        needed = required_eigenvalue(wanted)
        show_note(
            self.missing_note,
            f"{what} misses {upto}about {percent(missing)} of the signature for want of "
            f"eigenpairs. It takes those up to λ = {format_quantity(needed, mesh.unit, -2)}, "
            f"{estimated_pairs(spectrum, mesh.area, needed)}.",
        )
