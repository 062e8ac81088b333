"""Controls of a filter of one's own: its formula, and a slider for each of its parameters."""

from __future__ import annotations

import math

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import (
    format_wavelength,
    note,
    reserved_note,
    show_note,
    show_quietly,
)
from meshmash_viewer.app.controls.layout import column, row
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.formula import MOST_CHARACTERS, MOST_NAMES, Formula
from meshmash_viewer.fields.bank_columns import MOST_COLUMNS
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.units import format_quantity, power_unit

__all__ = ["FilterTab"]

#: Positions of a slider: finer than a pixel.
_POSITIONS = 1000
#: What the list calls a filter that is none of the ready ones.
_OWN = "Formula"
_HINT = "x is λ; other names become sliders. Arithmetic, comparisons, exp, log, sqrt, where, …"


class ParameterRow(QWidget):
    """A parameter as a slider in log scale and as a number, with the length that it means.

    Signals
    -------
    chosen(str, float)
        Its name, and what a person gave.
    """

    chosen = Signal(str, float)

    def __init__(self, place: int) -> None:
        super().__init__()
        name = f"filter_parameter_{place}"
        self._name, self._span = "", (1.0, 1.0)
        self.label = theme.named(QLabel(), f"{name}_label", "Parameter")
        self.slider = theme.named(StepSlider(), f"{name}_slider", "Parameter, in log scale")
        self.slider.setRange(0, _POSITIONS)
        self.slider.setSingleStep(10)
        self.slider.setPageStep(100)
        self.slider.valueChanged.connect(self._slide)
        self.field = NumberField(f"{name}_field", "Parameter")
        self.field.edited.connect(lambda value: self.chosen.emit(self._name, value))
        self.unit = theme.with_role(QLabel(), "muted")
        self.length = theme.with_role(QLabel(), "muted")
        self.fault = note(f"{name}_fault", "warning")
        self.field.refused.connect(lambda sentence: show_note(self.fault, sentence))
        above = row(self.label, self.length, None, self.field, self.unit, spacing=6)
        self.setLayout(column(above, self.slider, self.fault, spacing=2))

    def show_parameter(
        self, name: str, value: float, span: tuple[float, float], power: int, unit: str
    ) -> None:
        """Show a parameter that is a power of length."""
        self._name, self._span = name, span
        low, high = span
        self.label.setText(name)
        for control in (self.slider, self.field):
            control.setAccessibleName(f"Parameter {name}")
        share = math.log(value / low) / math.log(high / low) if value > 0.0 else 0.0
        show_quietly(self.slider, round(min(max(share, 0.0), 1.0) * _POSITIONS))
        written = power_unit(unit, power) if power else ""
        self.unit.setText(written)
        self.unit.setVisible(bool(written))
        self.field.show_value(value, written)
        self.length.setText(_length(value, power, unit))

    def _slide(self, position: int) -> None:
        low, high = self._span
        self.chosen.emit(self._name, low * math.exp(position / _POSITIONS * math.log(high / low)))


def _length(value: float, power: int, unit: str) -> str:
    """The length that a value means, where it is a power of one."""
    if power == -2:
        return f"waves of {format_wavelength(value, unit)}"
    if power in (2, 4, -1, -4):
        return f"length {format_quantity(value ** (1.0 / power), unit)}"
    return ""


class FilterTab(FieldStepper):
    """Choose a ready filter or write one, and move its parameters."""

    family = Filters
    icon = '<path d="M3 5h18l-7 8v6l-4 2v-8z"/>'
    ends = "low", "high"

    def _build(self) -> None:
        self.combo = theme.named(QComboBox(), "filter_combo", "Ready filters")
        self.combo.addItems([*READY, _OWN])
        self.combo.activated.connect(self._choose_ready)
        self.edit = theme.named(QLineEdit(), "filter_formula_edit", "Formula of the filter")
        self.edit.setMaxLength(MOST_CHARACTERS)
        self.edit.setToolTip(_HINT)
        self.edit.textEdited.connect(self._check)
        self.edit.editingFinished.connect(self._take_formula)
        self.fault = reserved_note("filter_fault", 2, "muted", "What is wrong with the formula")
        self.rows = [ParameterRow(place) for place in range(MOST_NAMES)]
        for each in self.rows:
            each.chosen.connect(self._set_value)
        self._fill(
            "filter_label",
            "Filter",
            self.combo,
            self.edit,
            self.fault,
            *self.rows,
            row(PlayButton(self._document, "filter_play_button"), None),
            theme.with_role(QLabel("Exported columns"), "heading"),
            self._make_count_row(
                "filter_count_spin",
                "Number of columns",
                "With more than one, the first parameter goes through its range, evenly in log",
                MOST_COLUMNS,
            ),
            self._make_range_box(
                ("filter_automatic_check", "filter_low_field", "filter_high_field"),
                ("Automatic, from the spectrum", "Lowest", "Highest"),
                "value",
                "Of the first parameter",
            ),
        )

    # -- from the person --------------------------------------------------------------------

    def _choose_ready(self, index: int) -> None:
        text = READY.get(self.combo.itemText(index))
        if text is None:
            self.edit.setFocus()
            self.edit.selectAll()
        else:
            self._set_formula(text)

    def _set_formula(self, text: str) -> None:
        kept = {name: value for name, value in self._chosen.values if name in Formula(text).powers}
        same = Formula(text).powers == self._chosen.formula.powers
        self._change(
            text=text,
            values=tuple(kept.items()) if same else (),
            automatic=True,
            low=None,
            high=None,
        )

    def _take_formula(self) -> None:
        text = self.edit.text().strip()
        if text != self._chosen.text and not self._complaint(text):
            self._set_formula(text)

    def _check(self, text: str) -> None:
        """Say what is wrong as one types."""
        self._say(self._complaint(text))

    def _set_value(self, name: str, value: float) -> None:
        moved = self._chosen.with_values(**{name: value})
        complaint = self._tried(moved)
        self._say(complaint)
        if complaint:
            self.refresh()
        else:
            self._document.display.put(moved)

    # -- from the model ---------------------------------------------------------------------

    @property
    def _chosen(self) -> Filters:
        return self._document.display[Filters]

    def _complaint(self, text: str) -> str:
        """What is wrong with a formula on these eigenpairs; empty if nothing is."""
        try:
            Formula(text)
        except InputError as fault:
            return str(fault)
        return self._tried(Filters(text))

    def _tried(self, family: Filters) -> str:
        spectrum = self._document.scaled_spectrum
        try:
            if spectrum is not None:
                family.weights(spectrum)
        except InputError as fault:
            return str(fault)
        return ""

    def _say(self, complaint: str) -> None:
        theme.change_role(self.fault, "warning" if complaint else "muted")
        self.fault.setText(complaint or _HINT)

    def refresh(self) -> None:
        """Show what the model holds."""
        chosen, spectrum = self._chosen, self._document.scaled_spectrum
        named = next((name for name, text in READY.items() if text == chosen.text), _OWN)
        with QSignalBlocker(self.combo):
            self.combo.setCurrentText(named)
        self.title.setText(named)
        if not (self.edit.hasFocus() and self.edit.isModified()):
            self.edit.setText(chosen.text)
            self._say("")
        show_quietly(self.count_spin, chosen.count)
        self._show_parameters(chosen, spectrum)

    def _show_parameters(self, chosen: Filters, spectrum: Spectrum | None) -> None:
        unit, powers = self._document.unit, chosen.formula.powers
        for each in self.rows[len(powers) :]:
            each.hide()
        for each, (name, power) in zip(self.rows, powers.items(), strict=False):
            each.setVisible(spectrum is not None)
            if spectrum is not None:
                span = chosen.range(spectrum) if name == chosen.first else None
                each.show_parameter(
                    name,
                    chosen.value(name, spectrum),
                    span or chosen.span(name, spectrum),
                    power,
                    unit,
                )
        power = powers.get(chosen.first, 0)
        between = None if spectrum is None or not chosen.first else chosen.range(spectrum)
        self.range_box.show_range(
            between,
            power_unit(unit, power) if power else "",
            (0.0, math.inf),
            automatic=chosen.automatic,
        )
