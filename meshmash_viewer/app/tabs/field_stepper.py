"""What the tabs of families have in common, from a title to the stepping through columns."""

from __future__ import annotations

from typing import Any, ClassVar

from PySide6.QtWidgets import QHBoxLayout, QLabel, QSpinBox, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import Facts, note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import PANEL, Part, column, row
from meshmash_viewer.app.controls.range_box import RangeBox
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.fields.bank_columns import MOST_COLUMNS, BankColumns
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field

__all__ = ["ColumnStepper", "FamilyTab", "FieldStepper"]


class FamilyTab(QWidget):
    """The controls of one family of fields.

    Subclasses build themselves in `_build` and show the document in `refresh`. `icon` is a drawing
    like those of `meshmash_viewer.app.controls.icons`.
    """

    family: ClassVar[type[Family]]
    icon: ClassVar[str]

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._build()
        follow(document.spectrum_changed, self._refresh_in_front)
        follow(document.display.events, self._refresh_in_front)
        self.refresh()

    def _refresh_in_front(self) -> None:
        """Refresh if this is the tab in front; the others do so when they come there."""
        if self._document.display.kind == self.family.name:
            self.refresh()

    def refresh(self) -> None:
        """Show what the document says."""
        raise NotImplementedError

    def show_field(self, field: Field | None) -> None:
        """Say what is known of the field on the render, where the family has more to say."""

    def _build(self) -> None:
        raise NotImplementedError

    def _fill(self, name: str, accessible: str, *parts: Part) -> None:
        """Lay the controls out, under a title of these names."""
        self.title = theme.named(QLabel(), name, accessible, role="title")
        self.setLayout(column(self.title, *parts, None, margins=PANEL))

    def _change(self, **parameters: Any) -> None:
        self._document.display.change(self.family, **parameters)


class FieldStepper(FamilyTab):
    """A tab that steps through its family.

    Subclasses take what the slider or the index was moved to in `_choose`, and the two ends of a
    range in the parameters named by `ends`.
    """

    ends: ClassVar[tuple[str, str]]

    def _choose(self, value: int) -> None:
        self._change(index=value)

    def _make_slider(self, name: str, accessible: str, tip: str = "") -> StepSlider:
        self.slider = theme.named(StepSlider(), name, accessible, tip=tip)
        self.slider.valueChanged.connect(self._choose)
        return self.slider

    def _make_index_row(self, name: str, accessible: str, *more: Part) -> QHBoxLayout:
        """The index as a number, and the button that plays."""
        self.spin = theme.named(QSpinBox(), f"{name}_spin", accessible)
        self.spin.setKeyboardTracking(False)
        self.spin.valueChanged.connect(self._choose)
        return row(self.spin, PlayButton(self._document, f"{name}_play_button"), None, *more)

    def _make_count_row(self, name: str, text: str, tip: str, most: int) -> QHBoxLayout:
        """The number of columns of the exported feature."""
        self.count_spin = theme.named(QSpinBox(minimum=1, maximum=most), name, text, tip=tip)
        self.count_spin.setKeyboardTracking(False)
        self.count_spin.valueChanged.connect(self._set_count)
        return row(theme.with_role(QLabel(text), "muted"), None, self.count_spin, spacing=6)

    def _set_count(self, count: int) -> None:
        self._change(**{self.family.counted: count})

    def _make_range_box(
        self, names: tuple[str, str, str], texts: tuple[str, str, str], noun: str, tip: str
    ) -> RangeBox:
        self.range_box = RangeBox(names, texts, noun)
        self.range_box.check.setToolTip(tip)
        self.range_box.automatic_chosen.connect(self._set_automatic)
        self.range_box.range_given.connect(self._set_range)
        return self.range_box

    def _range(self) -> tuple[float, float] | None:
        """The range in force, if there is a spectrum to take it from."""
        chosen: Any = self._document.display[self.family]
        spectrum = self._document.scaled_spectrum
        return None if spectrum is None else chosen.range(spectrum)

    def _set_automatic(self, on: bool) -> None:
        between = self._range()
        if on or between is None:
            self._change(automatic=on)
        else:
            self._set_range(*between)  # go on from what was automatic

    def _set_range(self, low: float, high: float) -> None:
        self._change(**dict(zip(self.ends, (low, high), strict=True)), automatic=False)


class ColumnStepper(FieldStepper):
    """Step through the columns of a feature; their number is that of the exported one.

    Subclasses say what a column is in `_describe`, and give the control of a range in
    `_range_parts`.

    Attributes
    ----------
    one, many : str
        What a column is called: "Band", "Bands".
    tip : str
        What the columns are.
    told : dict
        Object names of the facts about a column, and what they are called.
    """

    family: ClassVar[type[BankColumns]]
    one: ClassVar[str]
    many: ClassVar[str]
    tip: ClassVar[str]
    told: ClassVar[dict[str, str]]

    def _build(self) -> None:
        name, number = self.family.name, f"Number of {self.many.lower()}"
        self.facts = Facts(self.told)
        self.missing_note = note(f"{name}_missing_label", "warning")
        self._fill(
            f"{name}_label",
            self.one,
            self._make_slider(f"{name}_slider", self.one),
            self._make_index_row(name, f"{self.one}, counted from 0"),
            self.facts,
            theme.with_role(QLabel(self.many), "heading"),
            self._make_count_row(f"{name}_count_spin", number, self.tip, MOST_COLUMNS),
            *self._range_parts(),
            self.missing_note,
        )

    def _range_parts(self) -> tuple[Part, ...]:
        """What sets the range of the columns, if anything does."""
        return ()

    def _set_count(self, count: int) -> None:
        chosen = self._document.display[self.family]
        self._change(index=min(chosen.index, count - 1), count=count)

    def refresh(self) -> None:
        """Show what the model holds."""
        chosen = self._document.display[self.family]
        for control in (self.slider, self.spin):
            show_quietly(control, chosen.column, most=chosen.count - 1)
        self.spin.setSuffix(f" of {chosen.count - 1}")
        show_quietly(self.count_spin, chosen.count)
        self.title.setText(f"{self.one} {chosen.column}")
        show_note(self.missing_note, "")
        told = self._describe(self._document.scaled_spectrum, self._document.unit)
        for name in self.told:
            self.facts.show_value(name, told.get(name, ""))

    def _describe(self, spectrum: Spectrum | None, unit: str) -> dict[str, str]:
        """Show what is special to the family, and give the facts about the column."""
        raise NotImplementedError
