"""Controls of a family of fields, made from the declarations of its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from msgspec.inspect import BoolType, IntType
from PySide6.QtCore import QObject, Qt, QTimer
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QSizePolicy,
    QSpinBox,
    QWidget,
)

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import ComputeButton, undone_as_one
from meshmash_viewer.app.controls.make import PANEL, Part, column, row
from meshmash_viewer.app.controls.number_field import NumberField
from meshmash_viewer.app.controls.step_slider import LogSlider, StepSlider, decade_marks
from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.app.tabs.parameters import RangeBox
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.family import Family, Reading
from meshmash_viewer.fields.parameter import Parameter
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field, advance
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import resolved_time
from meshmash_viewer.units import power_unit


class Player(QObject):
    """Timer that steps through the displayed family in a loop while ``display.playing`` is set."""

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._timer = QTimer(self)
        self._timer.timeout.connect(partial(advance, document))
        events = document.display.events
        listen((events.playing, events.kind, document.spectrum_changed), self._refresh)

    def _refresh(self) -> None:
        display, spectrum = self._document.display, self._document.known
        interval = display.family.interval
        if display.playing and spectrum is not None and interval:
            self._timer.start(interval)
        else:
            self._timer.stop()
            display.playing = False


class FamilyTab(QWidget):
    """Base class of the controls of a family of fields.

    Subclasses make their widgets in `_build` and show the document in `refresh`.
    """

    def __init__(self, document: Document, family: type[Family]) -> None:
        super().__init__()
        self._document, self.family = document, family
        self._build()
        follow((document.spectrum_changed, document.display.events), self._refresh_displayed)
        self.refresh()

    def _refresh_displayed(self) -> None:
        """Refresh if the family is displayed; the panel refreshes other tabs when shown."""
        if self._document.display.kind == self.family.name:
            self.refresh()

    def refresh(self) -> None: ...

    def show_field(self, field: Field | None) -> None:
        """Show facts about the displayed field, which may be None or of another family.

        Implementations release the previous field, which refers to its mesh and eigenvectors.
        """

    def _build(self) -> None: ...

    def _fill(self, name: str, accessible: str, *parts: Part) -> None:
        """Lay the controls out below a title with this object name and accessible name."""
        self.title = make.label(name, accessible, role="title")
        # a long title, such as one with the name of a pin, wraps and does not widen the panel
        self.title.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.title.setWordWrap(True)
        head: Part = self.title
        if self.family.page:
            name, tip = f"{self.family.name}_page_button", "Explanation of this family"
            spoken = f"Page on: {self.family.label}"
            page = make.button("?", name, spoken, self._open_page, role="link", tip=tip)
            head = row((self.title,), page)
        self.setLayout(column(head, *parts, None, margins=PANEL))

    def _open_page(self) -> None:
        """Show the page on the family in a modeless dialog."""
        from meshmash_viewer.app.dialogs.help_dialog import PageDialog

        formula = self._document.display.fields[self.family.name].definition
        dialog = PageDialog(self.family.page, formula, self.window())
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.show()

    def _change(self, **parameters: Any) -> None:
        self._document.display.change(self.family, **parameters)

    # -- controls -----------------------------------------------------------------------------

    def _choose(self, value: int) -> None:
        """Set the index to the value of the slider or of the field."""
        self._change(index=value)

    def _make_slider(self, name: str, accessible: str, tip: str = "") -> StepSlider:
        self.slider = theme.named(StepSlider(), name, accessible, tip=tip)
        self.slider.valueChanged.connect(self._choose)
        undone_as_one(self.slider, self._document)
        return self.slider

    def _make_time_slider(self, name: str, accessible: str) -> LogSlider:
        self.times = theme.named(LogSlider(), name, accessible)
        undone_as_one(self.times, self._document)
        self.times.given.connect(lambda time: self._change(**{self.family.position[0]: time}))
        return self.times

    def _make_index_row(self, name: str, accessible: str) -> QHBoxLayout:
        self.spin = make.spin(f"{name}_spin", accessible, self._choose)
        return row(self.spin, None)

    def _make_count_row(self, text: str, tip: str) -> QHBoxLayout:
        counted = self.family.counted
        kind = self.family.declared()[counted].info
        assert isinstance(kind, IntType)
        name = f"{self.family.name}_{counted}_spin"
        self.count_spin = make.spin(
            name, text, self._set_count, tip=tip, minimum=1, maximum=kind.le
        )
        return row(make.muted(text), None, self.count_spin, spacing=6)

    def _set_parameter(self, name: str, value: Any) -> None:
        self._change(**{name: value})

    def _set_count(self, count: int) -> None:
        self._change(**{self.family.counted: count})

    def _make_range_box(self) -> RangeBox:
        """Make the controls of the parameters `ordered`, the ends of a range, and `automatic`."""
        family, declared = self.family, self.family.declared()
        assert family.ordered is not None
        automatic, low, high = (declared[name] for name in ("automatic", *family.ordered))
        names = [declared[name].control or f"{family.name}_{name}_field" for name in family.ordered]
        (lowest, _, noun), (highest, _, _) = low.text.partition(" "), high.text.partition(" ")
        self.range_box = RangeBox(
            (f"{family.name}_automatic_check", names[0], names[1]),
            (automatic.text, lowest, highest),
            noun,
        )
        self.range_box.check.setToolTip(automatic.tip)
        self.range_box.automatic_chosen.connect(self._set_automatic)
        self.range_box.range_given.connect(self._set_range)
        return self.range_box

    def _range(self) -> tuple[float, float] | None:
        """Return the current range; None without a spectrum."""
        chosen: Any = self._document.display[self.family]
        spectrum = self._document.scaled_spectrum
        return None if spectrum is None else chosen.range(spectrum)

    def _set_automatic(self, on: bool) -> None:
        between = self._range()
        if on or between is None:
            self._change(automatic=on)
        else:
            self._set_range(*between)  # begin with the automatic range

    def _set_range(self, low: float, high: float) -> None:
        assert self.family.ordered is not None
        self._change(**dict(zip(self.family.ordered, (low, high), strict=True)), automatic=False)


class ParameterRow(QWidget):
    """Row with the text of a parameter and its control: a field, combo box or check box.

    The object name of the control begins with `name`; `take` is called with values from the user.
    """

    def __init__(self, name: str, declared: Parameter, take: Callable[[Any], None]) -> None:
        super().__init__()
        kind: Any = declared.info
        self._declared, text = declared, declared.text
        self.control: QWidget
        self.unit = make.muted()
        if isinstance(kind, BoolType):
            self.control = make.check(text, f"{name}_check", text, take, tip=declared.tip)
            self.setLayout(row(self.control, None))
            return
        if isinstance(kind, IntType):
            ends = {"minimum": kind.ge, "maximum": kind.le}
            self.control = make.spin(f"{name}_spin", text, take, tip=declared.tip, **ends)
        elif declared.labels is not None:
            labels = {key: str(label) for key, label in declared.labels.items()}
            self.control = make.combo(f"{name}_combo", text, take, labels, tip=declared.tip)
        else:
            self.control = NumberField(f"{name}_field", text)
            self.control.bounds = kind.ge, kind.le
            self.control.setToolTip(declared.tip)
            self.control.edited.connect(take)
        self.setLayout(row(make.muted(text), None, self.control, self.unit, spacing=6))

    def show_value(self, value: Any, unit: str) -> None:
        """Show a value with its unit, a power of the unit of length `unit`."""
        written = power_unit(unit, self._declared.power) if self._declared.power else ""
        self.unit.setText(written)
        if isinstance(self.control, NumberField):
            self.control.show_value(value, written)
        elif isinstance(self.control, QComboBox):
            self.control.setCurrentIndex(self.control.findData(value))
        elif isinstance(self.control, QSpinBox | QCheckBox):
            make.show_quietly(self.control, value)


class FamilyForm(FamilyTab):
    """Controls of the position in the family, facts about it, parameters, and exported columns."""

    def _build(self) -> None:
        family, (one, many) = self.family, self.family.nouns
        self.labels = family.facts or {f"{family.name}_quantity_label": f"This {one.lower()}"}
        self.facts = make.Facts(self.labels)
        self.warning = make.note(f"{family.name}_missing_label", "warning")
        self.compute_button = ComputeButton(self._document, f"{family.name}_compute_button")
        counted = family.declared()[family.counted]
        (self.position,) = family.position
        #: Whether the position is an index, not a number in log scale.
        self.stepped = isinstance(family.declared()[self.position].info, IntType)
        name = family.name if self.stepped else f"{family.name}_{self.position}"
        shown = {self.position, family.counted, "automatic", *(family.ordered or ())}
        self.rows = {
            each: ParameterRow(
                declared.control or f"{family.name}_{each}",
                declared,
                partial(self._set_parameter, each),
            )
            for each, declared in family.declared().items()
            if declared.text and each not in shown
        }
        self._fill(
            f"{name}_label",
            one if self.stepped else f"{one} of the {family.label.lower()}",
            *self._position_parts(name, one),
            *self.rows.values(),
            make.heading(many),
            self._make_count_row(
                counted.text or f"Number of {many.lower()}",
                counted.tip or f"Columns of the exported feature. {family.tip}",
            ),
            *((self._make_range_box(),) if family.ordered else ()),
            self.warning,  # last, because it would move widgets below
            row(self.compute_button, None),
        )

    def _position_parts(self, name: str, one: str) -> tuple[Part, ...]:
        if self.stepped:
            slider = self._make_slider(f"{name}_slider", one)
            index = self._make_index_row(name, f"{one}, counted from 0")
            return slider, index, self.facts
        slider = self._make_time_slider(f"{name}_slider", f"{one}, in log scale")
        declared = replace(self.family.declared()[self.position], text=one)
        self.number = ParameterRow(name, declared, partial(self._set_parameter, self.position))
        fault = make.note(f"{name}_field_fault", "warning")
        assert isinstance(self.number.control, NumberField)
        self.number.control.refused.connect(lambda sentence: make.show_note(fault, sentence))
        return slider, self.number, fault, self.facts

    def _set_parameter(self, name: str, value: Any) -> None:
        self._change(**{name: value})

    def _set_count(self, count: int) -> None:
        position = getattr(self._document.display[self.family], self.position)
        clipped = {self.position: min(position, count - 1)} if self.stepped else {}
        self._change(**clipped, **{self.family.counted: count})

    def refresh(self) -> None:
        chosen, spectrum = self._document.display[self.family], self._document.scaled_spectrum
        count, (one, _) = getattr(chosen, self.family.counted), self.family.nouns
        index = min(getattr(chosen, self.position), count - 1) if self.stepped else 0
        reading = Reading(f"{one} {index}" if self.stepped else one)
        if spectrum is not None:
            try:
                reading = chosen.reading(spectrum, self._document.unit)
            except InputError as fault:
                reading = replace(reading, warning=str(fault))
        make.show_quietly(self.count_spin, count)
        for name, each in self.rows.items():
            each.show_value(getattr(chosen, name), self._document.unit)
        if self.stepped:
            for control in (self.slider, self.spin):
                make.show_quietly(control, index, most=count - 1)
            self.spin.setSuffix(f" of {count - 1}")
            self.slider.set_marks(decade_marks(*reading.decades) if reading.decades else ())
        else:
            self._show_number(chosen, spectrum, count, reading)
        if self.family.ordered:
            self._show_range()
        self.title.setText(reading.title)
        self.facts.show_values(dict(zip(self.labels, reading.facts, strict=False)))
        make.show_note(self.warning, reading.warning)
        self.compute_button.show_target(reading.sufficient)

    def _show_number(
        self, chosen: Family, spectrum: Eigenpairs | None, count: int, reading: Reading
    ) -> None:
        between = self._range()
        self.times.setEnabled(between is not None)
        self.times.set_steps(count - 1)  # one step between neighbouring columns
        self.times.set_hatched((0.0, min(reading.hatched, 1.0)) if reading.hatched else None)
        self.number.setEnabled(between is not None)
        if spectrum is None or between is None:
            self.times.set_marks(())
            self.number.show_value(None, self._document.unit)
        else:
            unit = power_unit(self._document.unit, chosen.declared()[self.position].power)
            number = 10.0 ** chosen.place(spectrum)
            self.times.show_number(number, between, unit)
            assert isinstance(self.number.control, NumberField)
            self.number.control.bounds = self._bounds(self.position)
            self.number.show_value(number, self._document.unit)

    def _show_range(self) -> None:
        assert self.family.ordered is not None
        chosen: Any = self._document.display[self.family]
        end = self.family.ordered[0]
        unit = power_unit(self._document.unit, self.family.declared()[end].power)
        bounds = self._bounds(end)
        self.range_box.show_range(self._range(), unit, bounds, automatic=chosen.automatic)

    def _bounds(self, name: str) -> tuple[float, float]:
        """Return the smallest and largest time or eigenvalue of this mesh."""
        low, high = self._document.solve.translation().bounds
        is_time = self.family.declared()[name].power > 0
        return (resolved_time(high), resolved_time(low)) if is_time else (0.0, high)
