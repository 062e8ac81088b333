"""Controls of the heat kernel signature on the render."""

from __future__ import annotations

import math

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import (
    Facts,
    estimated_pairs,
    note,
    show_note,
    show_quietly,
)
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.controls.scale_marks import log_share
from meshmash_viewer.app.tabs.field_stepper import FieldStepper, PlayButton
from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.fields.family import MOST_COUNT
from meshmash_viewer.fields.hks import HeatKernelSignature, resolved_from
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import required_eigenvalue, resolved_time
from meshmash_viewer.units import format_quantity, power_unit

__all__ = ["HksTab"]


class HksTab(FieldStepper):
    """Choose a time, in log scale, its range, and the number of times that are exported."""

    family = HeatKernelSignature
    icon = '<path d="M4 4v16h16"/><path d="M6 6c2 8 6 11 13 11.5"/>'
    ends = "t_min", "t_max"

    def _build(self) -> None:
        self.facts = Facts({"hks_length_label": "Length √t"})
        self.missing_note = note("hks_missing_label", "warning")
        self._fill(
            "hks_time_label",
            "Time of the heat kernel signature",
            self._make_time_slider("hks_time_slider", "Time, in log scale"),
            row((self.facts,), PlayButton(self._document, "hks_play_button")),
            make.heading("Times"),
            self._make_count_row(
                "hks_scales_spin",
                "Number of times",
                "Columns of the exported feature, evenly spaced in log t",
                MOST_COUNT,
            ),
            self._make_range_box(
                ("hks_automatic_check", "hks_t_min_field", "hks_t_max_field"),
                ("Automatic, from the spectrum", "Shortest", "Longest"),
                "time",
                "4 ln 10 / λ_max to 4 ln 10 / λ₂ (Sun et al. 2009)",
            ),  # last, because what it refuses takes room
            self.missing_note,
        )

    def refresh(self) -> None:
        """Show what the model holds."""
        document, unit, between = self._document, self._document.unit, self._range()
        chosen = document.display[HeatKernelSignature]
        show_quietly(self.count_spin, chosen.scales)
        self.times.setEnabled(between is not None)
        self.times.set_steps(chosen.scales - 1)  # one is a time of the feature
        shortest, longest = (resolved_time(value) for value in document.translation().bounds[::-1])
        self.range_box.show_range(
            between, power_unit(unit, 2), (shortest, longest), automatic=chosen.automatic
        )
        if between is None or document.spectrum is None:
            self.title.setText("t")
            self.facts.show_value("hks_length_label", "")
            self.times.set_marks(())
            self._show_missing(None, "")
            return
        time = chosen.time_in(document.spectrum)
        self.times.show_number(time, between)
        self.title.setText(f"t = {format_quantity(time, unit, 2)}")
        self.facts.show_value("hks_length_label", format_quantity(math.sqrt(time), unit))
        self._mark_missing(document.spectrum, *between, time)

    def _mark_missing(self, spectrum: Eigenpairs, low: float, high: float, time: float) -> None:
        """Hatch the times that the known pairs cannot resolve, and say how many would."""
        resolved, mesh = resolved_from(spectrum), self._document.mesh
        if mesh is None or resolved <= low * (1.0 + 1e-9):
            self._show_missing(None, "")
            return
        share = min(log_share(resolved, low, high), 1.0)
        wanted, what = (time, "This time") if time < resolved else (low, "The hatched part")
        missing = float(spectrum.missing_shares(heat_kernel_bank([wanted]), mesh.area)[0])
        upto = "" if wanted == time else "up to "
        needed = required_eigenvalue(wanted)
        self._show_missing(
            (0.0, share),
            f"{what} misses {upto}about {percent(missing)} of the signature for want of "
            f"eigenpairs. It takes those up to λ = {format_quantity(needed, mesh.unit, -2)}, "
            f"{estimated_pairs(spectrum, mesh.area, needed)}.",
        )

    def _show_missing(self, hatched: tuple[float, float] | None, sentence: str) -> None:
        self.times.set_hatched(hatched)
        show_note(self.missing_note, sentence)
