"""Controls for the ends of a range, and for the parameters of a filter."""

from __future__ import annotations

import math
from functools import partial

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QLabel, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import column, grid, note, row, show_note, show_quietly
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.step_slider import LogSlider
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.formula import MOST_NAMES
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.model.document import Document
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import format_wavelength, wavelength_eigenvalue
from meshmash_viewer.units import format_quantity, power_unit

#: Full width at half maximum of the smoothing exp(-s*λ), in units of √s, on a plane.
_WIDTH = math.sqrt(16.0 * math.log(2.0))
_WIDTH_TIP = "Full width at half maximum of the smoothing, √(16 ln 2 · s): type a length to set it"


class RangeBox(QWidget):
    """Check box for an automatic range, and a field for each end of the current range.

    The ends can be typed in either order: an end beyond the other end is kept until the other end
    has been typed. `names` and `texts` are object names and labels of the check box, the low and
    the high end; `noun` is the quantity, such as "time".
    """

    automatic_chosen = Signal(bool)
    #: Low and high end.
    range_given = Signal(float, float)

    def __init__(self, names: tuple[str, str, str], texts: tuple[str, str, str], noun: str) -> None:
        super().__init__()
        self._unit = ""
        self._disorder = f"The {texts[1].lower()} {noun} has to be below the {texts[2].lower()}."
        self._between: tuple[float | None, float | None] = None, None
        self.check = make.check(
            texts[0], names[0], f"Range of {noun}s: automatic", self.automatic_chosen
        )
        self.low = NumberField(names[1], f"{texts[1]} {noun}")
        self.high = NumberField(names[2], f"{texts[2]} {noun}")
        self.fault = note(f"{names[1]}_fault", "warning")
        self._units: list[QLabel] = []
        rows = []
        for text, field, other in (
            (texts[1], self.low, self.high), (texts[2], self.high, self.low)
        ):  # fmt: skip
            name, unit = make.muted(text), make.muted()
            name.setBuddy(field)
            self._units.append(unit)
            # an empty column of units would still add its spacing
            rows.append((name, row((field,), unit)))
            field.edited.connect(lambda _number, other=other: self._give(other))
            field.refused.connect(partial(show_note, self.fault))
            field.editingFinished.connect(self._settle)
        self.setLayout(grid((self.check,), *rows, (self.fault,)))

    def show_range(
        self,
        between: tuple[float, float] | None,
        unit: str,
        bounds: tuple[float, float],
        *,
        automatic: bool,
    ) -> None:
        """Show a range of the model, or None; `bounds` are the smallest and largest valid end."""
        self.low.bounds = self.high.bounds = bounds
        show_quietly(self.check, automatic)
        for label in self._units:
            label.setText(unit)
            label.setVisible(bool(unit))
        self._between = between if between is not None else (None, None)
        self._unit = unit
        if not self._is_waiting():
            self._show()

    def _show(self) -> None:
        for field, end in zip((self.low, self.high), self._between, strict=True):
            field.show_value(end, self._unit)

    def _is_waiting(self) -> bool:
        """Return whether the ends are in the wrong order because one is still to be typed."""
        low, high = self.low.value, self.high.value
        here = self.low.hasFocus() or self.high.hasFocus()
        return here and low is not None and high is not None and low >= high

    def _settle(self) -> None:
        """Show the current range again if the focus has left before both ends were typed."""
        QTimer.singleShot(0, self, lambda: None if self._is_waiting() else self._show())

    def _give(self, other: NumberField) -> None:
        low, high = self.low.value, self.high.value
        if low is None or high is None:
            return
        show_note(self.fault, "" if low < high else self._disorder)
        if low < high:
            self.range_given.emit(low, high)
        elif not other.hasFocus():
            other.setFocus(Qt.FocusReason.OtherFocusReason)
            other.selectAll()


class FilterParameters(QWidget):
    """Row for each parameter of the filter of a document; object names begin with `prefix`."""

    #: The user chose a value: why it is invalid, or "".
    tried = Signal(str)

    def __init__(self, document: Document, prefix: str = "") -> None:
        super().__init__()
        self._document = document
        names = (f"{prefix}filter_parameter_{at}" for at in range(MOST_NAMES))
        self.rows = list(map(FilterParameterRow, names))
        for each in self.rows:
            each.chosen.connect(self._set_value)
        self.setLayout(column(*self.rows))

    def refresh(self) -> None:
        chosen, spectrum = self._document.display[Filters], self._document.scaled_spectrum
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
                    gaussian=chosen.text == READY["Gaussian"],
                )

    def _set_value(self, name: str, value: float) -> None:
        moved = self._document.display[Filters].with_values(**{name: value})
        complaint = refusal(moved, self._document.scaled_spectrum)
        self.tried.emit(complaint)
        if complaint:
            self.refresh()
        else:
            self._document.display.put(moved)


def refusal(chosen: Filters, spectrum: Eigenpairs | None) -> str:
    """Return why a filter is invalid for these eigenpairs, or ""."""
    try:
        if spectrum is not None:
            chosen.weights(spectrum)
    except InputError as fault:
        return str(fault)
    return ""


class FilterParameterRow(QWidget):
    """Slider in log scale and field for a parameter, with the corresponding length."""

    #: Name of the parameter, and the value that the user chose.
    chosen = Signal(str, float)

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = ""
        self.label = make.label(f"{name}_label", "Parameter")
        self.slider = theme.named(LogSlider(), f"{name}_slider", "Parameter, in log scale")
        self.field = NumberField(f"{name}_field", "Parameter")
        for given in (self.slider.given, self.field.edited):
            given.connect(lambda value: self.chosen.emit(self._name, value))
        self.unit, self.length = make.muted(), make.muted()
        self.fault = note(f"{name}_fault", "warning")
        self.field.refused.connect(partial(show_note, self.fault))
        above = row(self.label, self.length, None, self.field, self.unit, spacing=6)
        self.setLayout(column(above, self.slider, self.fault, spacing=2))

    def show_parameter(
        self,
        name: str,
        value: float,
        span: tuple[float, float],
        power: int,
        unit: str,
        *,
        gaussian: bool = False,
    ) -> None:
        """Show a parameter, whose unit is a `power` of length, and the corresponding length.

        For a `gaussian` filter, the length is its full width at half maximum.
        """
        self._name = name
        self.label.setText(name)
        for control in (self.slider, self.field):
            control.setAccessibleName(f"Parameter {name}")
        self.slider.show_number(value, span)
        written = power_unit(unit, power) if power else ""
        self.unit.setText(written)
        self.unit.setVisible(bool(written))
        self.field.show_value(value, written)
        meant, self.field.from_length = "", None
        if gaussian:
            meant = f"FWHM {format_quantity(_WIDTH * value**0.5, unit)}"
            self.field.from_length = unit, lambda width: (width / _WIDTH) ** 2
        elif power == -2:
            meant = f"waves of {format_wavelength(value, unit)}"
            self.field.from_length = unit, wavelength_eigenvalue
        elif power in (2, 4, -1, -4):
            meant = f"length {format_quantity(value ** (1.0 / power), unit)}"
            self.field.from_length = unit, lambda length: length**power
        self.length.setText(meant)
        self.length.setToolTip(_WIDTH_TIP if gaussian else "")
