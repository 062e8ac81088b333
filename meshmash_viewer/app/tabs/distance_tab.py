"""Controls of the distances: which one, from which pinned vertex, and how far the others are."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.compute_button import ComputeButton
from meshmash_viewer.app.controls.facts import Facts, note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import row
from meshmash_viewer.app.tabs.form import PinChooser, PlayButton
from meshmash_viewer.features.distances import MEASURES
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.model.field import Field
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import format_quantity, power_unit

_LINES = "Lines at round distances"
_ABOUT = {
    "geodesic": "Along the surface, by the heat method: right to about an edge.",
    "biharmonic": "Smooth at the vertex, and aware of the whole shape far from it.",
    "commute": "How long a random walk is on its way there and back: a thin neck is far.",
    "diffusion": "How differently heat from two vertices has spread after a time.",
}


class DistanceTab(PinChooser):
    """Paint how far every vertex is from a pinned one; follows the last pin."""

    def _build(self) -> None:
        self.measure_combo = make.combo(
            "distance_measure_combo",
            "Kind of distance",
            lambda name: self._change(measure=name),
            {name: text for name, (text, _) in MEASURES.items()},
        )
        self.about = note("distance_about")
        self.time_label = make.label("distance_time_label", "Time of diffusion")
        self.play = PlayButton(self._document, "distance_play_button")
        self.facts = Facts({"distance_pins_label": "To the other pins"})
        self.lines_check = make.check(
            _LINES,
            "distance_lines_check",
            "Draw lines at round distances",
            partial(setattr, self._document.display, "nodal_lines"),
        )
        self.missing_note = note("distance_missing_label", "warning")
        self.compute_button = ComputeButton(self._document, "distance_compute_button")
        self._fill(
            "distance_label",
            "",
            *self._make_pin_choice(),
            make.muted("Distance"),
            self.measure_combo,
            self.about,
            row(self.time_label, None, self.play),
            self._make_time_slider("distance_time_slider", "Time of diffusion, in log scale"),
            self.facts,
            self.lines_check,
            self.missing_note,
            row(self.compute_button, None),
        )

    def refresh(self) -> None:
        """Show what the model holds."""
        chosen = self._document.display[Distances]
        self.title.setText(f"Distance from {self._show_pin(chosen.vertex)}")
        self.measure_combo.setCurrentIndex(self.measure_combo.findData(chosen.measure))
        show_note(self.about, _ABOUT[chosen.measure])
        show_quietly(self.lines_check, self._document.display.nodal_lines)
        spectrum = self._document.scaled_spectrum
        for widget in (self.time_label, self.play, self.times):
            widget.setVisible(chosen.timed)
        if chosen.timed and spectrum is not None:
            self._show_time(chosen, spectrum)
        if chosen.needs_pairs and spectrum is None:
            show_note(
                self.hint,
                "This distance is a sum over eigenpairs above zero: compute more of them.",
            )

    def _show_time(self, chosen: Distances, spectrum: Eigenpairs) -> None:
        time, unit = chosen.time_in(spectrum), self._document.unit
        between = spectrum.time_range
        self.times.show_number(time, between, power_unit(unit, 2))
        written = format_quantity(time, unit, 2, like=math.sqrt(math.prod(between)))
        length = format_quantity(math.sqrt(time), unit)
        self.time_label.setText(f"t = {written}, √t = {length}")

    def show_field(self, field: Field | None) -> None:
        """Say how far the other pins are, and what is missing."""
        family = None if field is None else field.family
        if field is None or not isinstance(family, Distances):
            return
        far = [
            f"{pin.label}: {field.value_text(pin.vertex, 4)}"
            for pin in self._document.pins.placed
            if pin.vertex != family.vertex and np.isfinite(field.values[pin.vertex])
        ]
        self.facts.show_value("distance_pins_label", "\n".join(far))
        text = field.spacing_text
        self.lines_check.setText(text[:1].upper() + text[1:] or _LINES)
        sample = field.request.sample
        typical = float(np.nanmedian(field.values if sample is None else field.values[sample]))
        spectrum = field.request.spectrum
        sufficient = family.sufficient(spectrum, typical) if family.needs_pairs else None
        share = percent(family.missing(spectrum, typical))
        text = f"About {share} of a typical distance is missing for want of eigenpairs."
        show_note(self.missing_note, "" if sufficient is None else text)
        self.compute_button.show_target(sufficient)
