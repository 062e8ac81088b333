"""Controls of families of a pinned vertex: distances and similarity."""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import QSignalBlocker

from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import ComputeButton
from meshmash_viewer.app.controls.make import Facts, Part, note, row, show_note
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.tabs.form import FamilyTab
from meshmash_viewer.features.distances import MEASURES
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, shown_family
from meshmash_viewer.model.pins import Pin, pin_at
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import NO_BREAK, counted, format_quantity, power_unit

_ABOUT = {
    "geodesic": "Length of the shortest path along the surface.",
    "biharmonic": "Smooth at the vertex; far from the vertex it depends on the whole shape.",
    "commute": "Duration of a random walk to a vertex and back: long across a thin neck.",
    "diffusion": "How differently heat from two vertices has spread after a time.",
}


class PinChooser(FamilyTab):
    """Base class of tabs of families with a `vertex`, which is set to each new pin."""

    def __init__(self, document: Document, family: type[Family]) -> None:
        self._pins: tuple[Pin, ...] = ()
        super().__init__(document, family)
        listen(document.pins.changed, self._follow_pins)
        self._follow_pins()

    def _make_pin_choice(self) -> tuple[Part, ...]:
        name = self.family.name
        self.hint = note(f"{name}_hint")
        self.combo = make.combo(
            f"{name}_vertex_combo", "Pinned vertex to measure from", self._choose_pin
        )
        above = make.muted("From pinned vertex")
        above.setBuddy(self.combo)
        self.combo.setPlaceholderText("No vertex is pinned yet")
        return above, self.combo, self.hint

    def _choose_pin(self, row: int) -> None:
        self._change(vertex=self._document.pins.placed[row].vertex)

    def _follow_pins(self) -> None:
        """Choose a new pin, or the last pin if the chosen pin was removed; follow a moved pin."""
        pins = self._document.pins.placed
        vertex: int | None = getattr(self._document.display[self.family], "vertex")  # noqa: B009
        before = {pin.number for pin in self._pins}
        was, self._pins = pin_at(self._pins, vertex), pins
        chosen = pin_at(pins, vertex)
        if chosen is None and was is not None:  # the pin may have moved
            chosen = next((pin for pin in pins if pin.number == was.number), None)
        if pins and (chosen is None or pins[-1].number not in before):
            chosen = pins[-1]
        if chosen is None or chosen.vertex != vertex:
            with self._document.history.paused():  # a consequence of the pins
                self._change(vertex=None if chosen is None else chosen.vertex)
        with QSignalBlocker(self.combo):
            self.combo.clear()
            for pin in pins:
                vertex_name = self._document.named_vertex(pin.vertex).capitalize()
                text = f"{pin.number} · {pin.name or vertex_name}"
                self.combo.addItem(make.dot(pin.color), text)
        self.refresh()

    @property
    def _no_pin(self) -> str:
        """The hint while there is no pin."""
        if not self._document.spectrum:
            return "Click a vertex on the render to pin it."
        shown = shown_family(self._document.display).label.lower()
        return f"Click a vertex on the render to pin it. Until then the render shows the {shown}."

    def _show_pin(self, vertex: int | None) -> str:
        """Select the pin of a vertex in the combo box; return the name of the pin or vertex."""
        pins = self._document.pins.placed
        row = next((row for row, pin in enumerate(pins) if pin.vertex == vertex), -1)
        self.combo.setCurrentIndex(row)
        self.combo.setEnabled(bool(pins))
        show_note(self.hint, "" if pins else self._no_pin)
        if vertex is None or row < 0:
            return "a vertex"
        return pins[row].name or self._document.named_vertex(vertex).replace(" ", NO_BREAK)


class DistanceTab(PinChooser):
    """Controls of the distance from a pinned vertex."""

    def _build(self) -> None:
        self.measure_combo = make.combo(
            "distance_measure_combo",
            "Kind of distance",
            lambda name: self._change(measure=name),
            {name: text for name, (text, _) in MEASURES.items()},
        )
        self.about = note("distance_about")
        self.time_label = make.label("distance_time_label", "Time of diffusion")
        self.facts = Facts({"distance_pins_label": "To the other pins"})
        self.missing_note = note("distance_missing_label", "warning")
        self.compute_button = ComputeButton(self._document, "distance_compute_button")
        measure = make.muted("Distance"), self.measure_combo, self.about
        slider = self._make_time_slider("distance_time_slider", "Time of diffusion, in log scale")
        time = self.time_label, slider
        compute = row(self.compute_button, None)
        parts = *measure, *time, self.facts, self.missing_note, compute
        self._fill("distance_label", "", *self._make_pin_choice(), *parts)

    def refresh(self) -> None:
        chosen = self._document.display[Distances]
        self.title.setText(f"Distance from {self._show_pin(chosen.vertex)}")
        self.measure_combo.setCurrentIndex(self.measure_combo.findData(chosen.measure))
        show_note(self.about, _ABOUT[chosen.measure])
        spectrum = self._document.scaled_spectrum
        for widget in (self.time_label, self.times):
            widget.setVisible(chosen.timed)
        if chosen.timed and spectrum is not None:
            self._show_time(chosen, spectrum)
        if chosen.needs_pairs and spectrum is None:
            show_note(
                self.hint,
                "This distance is a sum over nonzero eigenpairs: compute more eigenpairs.",
            )

    def _show_time(self, chosen: Distances, spectrum: Eigenpairs) -> None:
        time, unit = chosen.time_in(spectrum), self._document.unit
        between = spectrum.time_range
        self.times.show_number(time, between, power_unit(unit, 2))
        written = format_quantity(time, unit, 2, like=math.sqrt(math.prod(between)))
        length = format_quantity(math.sqrt(time), unit)
        self.time_label.setText(f"t = {written}, √t = {length}")

    def show_field(self, field: Field | None) -> None:
        """Show the distances to the other pins, and the share of the distance that is missing."""
        family = None if field is None else field.family
        if field is None or not isinstance(family, Distances):
            return
        far = [
            f"{pin.label}: {field.value_text(pin.vertex, 4)}"
            for pin in self._document.pins.placed
            if pin.vertex != family.vertex and np.isfinite(field.values[pin.vertex])
        ]
        self.facts.show_value("distance_pins_label", "\n".join(far))
        sample = field.request.sample
        typical = float(np.nanmedian(field.values if sample is None else field.values[sample]))
        spectrum = field.request.spectrum
        sufficient = family.sufficient(spectrum, typical) if family.needs_pairs else None
        share = percent(family.missing(spectrum, typical))
        text = f"About {share} of a typical distance is missing"
        target, limit = (None, "")
        if sufficient is not None:
            target, limit = spectrum.within_resolution(sufficient)
            if limit and family.divergence:
                target, limit = None, f"{family.divergence}. {limit}"
            remedy = "" if target is None else ": compute more eigenpairs"
            text = f"{text}{remedy}. {limit}".rstrip()
        show_note(self.missing_note, "" if sufficient is None else text)
        self.compute_button.show_target(target)


class SimilarityTab(PinChooser):
    """Controls of the distance in feature space from a pinned vertex."""

    def _build(self) -> None:
        self.basis = make.Segments(
            "similarity_basis",
            "Features to measure in",
            {name: family.short for name, family in FEATURES.items()},
            in_row=2,
        )
        self.basis.chosen.connect(lambda key: self._change(basis=key))
        self.explanation = note("similarity_explanation")
        parts = make.muted("Distance measured in"), self.basis, self.explanation
        self._fill("similarity_label", "", *self._make_pin_choice(), *parts)

    def refresh(self) -> None:
        display = self._document.display
        chosen = display[Similarity]
        self.title.setText(f"Similar to {self._show_pin(chosen.vertex)}")
        self.basis.show_key(chosen.basis)
        features = display.fields[chosen.basis]
        count = getattr(features, features.counted)
        show_note(
            self.explanation,
            f"Over the {counted(count, 'column')} of the {features.short} tab, each in units of its"
            " spread; 0 is alike and bright, larger is less so and dark.",
        )
