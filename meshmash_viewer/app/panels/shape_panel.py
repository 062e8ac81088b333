"""The Shape panel: reconstruction from the lowest eigenfunctions, morphing and vibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import undone_as_one
from meshmash_viewer.app.controls.make import PANEL, column, row
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.dialogs.files import ask_to_save
from meshmash_viewer.app.listening import follow, later
from meshmash_viewer.app.shape_source import DrawnShape
from meshmash_viewer.io.writers import MESH_WRITERS
from meshmash_viewer.model.display import FEWEST_PAIRS, MOST_AMPLITUDE
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.spectral.weyl import format_wavelength
from meshmash_viewer.units import counted, format_quantity, format_share

_FACTS = {"shape_distance_label": "Moved by (rms)", "shape_wave_label": "Shortest wave"}


class ShapePanel(QWidget):
    """Controls of the drawn shape; its colours show the displayed field."""

    #: Path of the file for the shape.
    save_requested = Signal(object)

    def __init__(self, document: Document) -> None:
        super().__init__()
        theme.named(self, "shape_panel", "Shape")
        self._document = document
        self._field: Field | None = None
        self._drawn: DrawnShape | None = None
        self._build()
        events = document.display.events
        shown = events.shape, events.vibrating, document.spectrum_changed, document.mesh_changed
        follow(shown, self.refresh)
        self.refresh()

    def _build(self) -> None:
        self.check = make.check(
            "From the lowest eigenfunctions",
            "shape_check",
            "Draw the mesh from its lowest eigenfunctions",
            lambda on: self._change(shown=on),
            tip="The coordinates as sums of the lowest eigenfunctions (projection with area"
            " weights)",
        )
        what = "Number of the lowest eigenfunctions"
        self.slider = self._slider("pairs", what, self._choose_pairs)
        self.spin = make.spin("shape_pairs_spin", what, self._choose_pairs)
        self.morph = self._slider(
            "morph",
            "From the mesh itself to the reconstruction",
            lambda share: self._change(morph=share / 100, shown=True),
            (0, 100),
        )
        self.morph_label = make.label("shape_morph_label", role="value")
        self.facts = make.Facts(_FACTS)
        self.save_button = make.button(
            "Export shape…", "shape_save_button", "Save the shape as a mesh", self._save
        )
        self.amplitude = self._slider(
            "amplitude",
            "Amplitude, in percent of the size of the mesh",
            lambda share: self._change(amplitude=share / 100),
            (1, round(100 * MOST_AMPLITUDE)),
        )
        self.amplitude_label = make.label("shape_amplitude_label", role="value")
        self.swing_button = make.button(
            "Vibrate",
            "shape_vibrate_button",
            "Vibrate: move the vertices along their normals by the displayed field",
            lambda on: setattr(self._document.display, "vibrating", on),
            checkable=True,
        )
        self.hint, self.swing_hint = make.note("shape_hint"), make.note("shape_vibrate_hint")
        for label in (self.morph_label, self.amplitude_label):
            label.setMinimumWidth(label.fontMetrics().horizontalAdvance("100 %") + 4)
        self.setLayout(
            column(
                make.heading("Reconstruction"),
                self.check,
                row((self.slider,), self.spin),
                self.facts,
                row(make.muted("Morph"), (self.morph,), self.morph_label),
                row(self.save_button, None),
                self.hint,
                make.heading("Vibration"),
                row(make.muted("Amplitude"), (self.amplitude,), self.amplitude_label),
                row(self.swing_button, None),
                self.swing_hint,
                None,
                margins=PANEL,
            )
        )

    def _slider(
        self,
        what: str,
        spoken: str,
        act: Callable[[int], None],
        ends: tuple[int, int] = (FEWEST_PAIRS, FEWEST_PAIRS),
    ) -> StepSlider:
        made = theme.named(StepSlider(own_keys=True), f"shape_{what}_slider", spoken)
        made.setRange(*ends)  # before the connection, as it changes the value
        made.valueChanged.connect(act)
        undone_as_one(made, self._document)
        return made

    # -- from the user ----------------------------------------------------------------------

    def _change(self, **chosen: Any) -> None:
        display = self._document.display
        display.shape = replace(display.shape, **chosen)

    def _choose_pairs(self, pairs: int) -> None:
        self._change(pairs=pairs, shown=True)

    def _save(self) -> None:
        name = f"{self.spin.value()}_eigenfunctions.ply"
        path = ask_to_save(self, self._document, "shape", name, "Meshes", MESH_WRITERS)
        if path is not None:
            self.save_requested.emit(path)

    # -- from the model ---------------------------------------------------------------------

    def set_field(self, field: Field | None) -> None:
        self._field = field
        later(self.refresh)

    def show_shape(self, drawn: DrawnShape) -> None:
        self._drawn = drawn
        later(self.refresh)

    def refresh(self) -> None:
        display, spectrum = self._document.display, self._document.spectrum
        shape, known = display.shape, 0 if spectrum is None else len(spectrum)
        usable = known >= FEWEST_PAIRS
        shown = usable and shape.shown
        count = shape.within(known) if usable else FEWEST_PAIRS
        for number in (self.slider, self.spin):
            make.show_quietly(number, count, most=max(known, FEWEST_PAIRS), least=FEWEST_PAIRS)
        self.spin.setSuffix(f" of {known:,}" if usable else "")
        make.show_quietly(self.check, shown)
        make.show_quietly(self.morph, round(100 * shape.morph))
        self.morph_label.setText(format_share(shape.morph))
        make.show_quietly(self.amplitude, round(100 * shape.amplitude))
        self.amplitude_label.setText(format_share(shape.amplitude))
        for control in (self.check, self.slider, self.spin, self.morph):
            control.setEnabled(usable)
        self.save_button.setEnabled(shown)
        drawn, unit = self._drawn, self._document.unit
        if drawn is not None and not self._document.is_solved(drawn.spectrum.mesh):
            drawn = self._drawn = None
        current = shown and drawn is not None and drawn.spectrum is spectrum and drawn.count > 0
        values = {}
        if current and drawn is not None:
            values["shape_distance_label"] = format_quantity(drawn.distance, unit)
        if usable and spectrum is not None:
            wave = format_wavelength(float(spectrum.eigenvalues[count - 1]), unit)
            values["shape_wave_label"] = wave
        self.facts.show_values(values)
        make.show_note(self.hint, self._hint(usable, shown, count))
        field = self._field
        swings = spectrum is not None and field is not None and field.signed
        self.amplitude.setEnabled(swings)
        self.swing_button.setEnabled(swings)
        make.show_quietly(self.swing_button, display.vibrating)
        self.swing_button.setText("Stop" if display.vibrating else "Vibrate")
        said = "Display an eigenfunction or another signed field to vibrate the mesh."
        if swings and field is not None:
            said = f"{field.title} along the normals"
        make.show_note(self.swing_hint, said if spectrum is not None else "")

    def _hint(self, usable: bool, shown: bool, count: int) -> str:
        ready, spectrum = self._document.ready, self._document.spectrum
        if ready is None:
            return "Open a mesh, and compute its eigenpairs."
        if not usable:
            return f"A shape takes {FEWEST_PAIRS} eigenfunctions at least: press Compute."
        components = ready.health.n_components
        if shown and count <= components and components > 1:
            return (
                f"The first {counted(components, 'pair')} are constant on each component, and draw"
                " it as a point: use more pairs."
            )
        if shown and spectrum is not None and spectrum.preview:
            return "Computed from approximate pairs: the shape changes when exact pairs converge."
        return ""
