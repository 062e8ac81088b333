"""What the tabs of families have in common, from a title to the stepping through columns."""

from __future__ import annotations

from typing import Any, ClassVar

from PySide6.QtCore import QObject, QSignalBlocker, QTimer
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.facts import Facts, note, show_note, show_quietly
from meshmash_viewer.app.controls.layout import PANEL, Part, column, row
from meshmash_viewer.app.controls.range_box import RangeBox
from meshmash_viewer.app.controls.step_slider import LogSlider, StepSlider
from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.bank_columns import MOST_COLUMNS, BankColumns
from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.field import Field
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.model.stepping import advance
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

__all__ = [
    "ColumnStepper",
    "FamilyTab",
    "FieldStepper",
    "PinChooser",
    "PlayButton",
    "Player",
    "plug_in_tab",
]


class Player(QObject):
    """Steps the field on the render while ``display.playing`` holds, round and round."""

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._step)
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

    def _step(self) -> None:
        advance(self._document)


class PlayButton(QPushButton):
    """Starts and stops playing."""

    def __init__(self, document: Document, name: str) -> None:
        super().__init__("Play")
        tip = "Step by itself, round and round (Space)"
        theme.named(self, name, "Play: step by itself", tip=tip)
        self.setCheckable(True)
        self._document = document
        self.toggled.connect(self._toggle)
        follow(document.display.events.playing, self._refresh)

    def _toggle(self, on: bool) -> None:
        self._document.display.playing = on

    def _refresh(self) -> None:
        playing = self._document.display.playing
        self.setChecked(playing)
        self.setText("Stop" if playing else "Play")


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
        follow((document.spectrum_changed, document.display.events), self._refresh_in_front)
        self.refresh()

    def _refresh_in_front(self) -> None:
        """Refresh if this is the tab in front; the others do so when they come there."""
        if self._document.display.kind == self.family.name:
            self.refresh()

    def refresh(self) -> None:
        """Show what the document says."""
        raise NotImplementedError

    def show_field(self, field: Field | None) -> None:
        """Say what is known of the field on the render, of any family, or that there is none.

        Nothing of an earlier one may be held: it holds its mesh and eigenvectors.
        """

    def _build(self) -> None:
        raise NotImplementedError

    def _fill(self, name: str, accessible: str, *parts: Part) -> None:
        """Lay the controls out, under a title of these names."""
        self.title = make.label(name, accessible, role="title")
        self.setLayout(column(self.title, *parts, None, margins=PANEL))

    def _change(self, **parameters: Any) -> None:
        self._document.display.change(self.family, **parameters)


class FieldStepper(FamilyTab):
    """A tab that steps through its family.

    Subclasses take what the slider or the index was moved to in `_choose`, or the time to which a
    slider in log scale was moved as `time`, and the two ends of a range in the parameters named by
    `ends`.
    """

    ends: ClassVar[tuple[str, str]]

    def _choose(self, value: int) -> None:
        self._change(index=value)

    def _make_slider(self, name: str, accessible: str, tip: str = "") -> StepSlider:
        self.slider = theme.named(StepSlider(), name, accessible, tip=tip)
        self.slider.valueChanged.connect(self._choose)
        return self.slider

    def _make_time_slider(self, name: str, accessible: str) -> LogSlider:
        self.times = theme.named(LogSlider(), name, accessible)
        self.times.given.connect(lambda time: self._change(time=time))
        return self.times

    def _make_index_row(self, name: str, accessible: str, *more: Part) -> QHBoxLayout:
        """The index as a number, and the button that plays."""
        self.spin = make.spin(f"{name}_spin", accessible, self._choose)
        return row(self.spin, PlayButton(self._document, f"{name}_play_button"), None, *more)

    def _make_count_row(self, name: str, text: str, tip: str, most: int) -> QHBoxLayout:
        """The number of columns of the exported feature."""
        self.count_spin = make.spin(name, text, self._set_count, tip=tip, minimum=1, maximum=most)
        return row(make.muted(text), None, self.count_spin, spacing=6)

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
    fact_labels : dict
        Object names of the facts about a column, and what they are called.
    """

    family: ClassVar[type[BankColumns]]
    one: ClassVar[str]
    many: ClassVar[str]
    tip: ClassVar[str]
    fact_labels: ClassVar[dict[str, str]]

    def _build(self) -> None:
        name, number = self.family.name, f"Number of {self.many.lower()}"
        self.facts = Facts(self.fact_labels)
        self.missing_note = note(f"{name}_missing_label", "warning")
        self._fill(
            f"{name}_label",
            self.one,
            self._make_slider(f"{name}_slider", self.one),
            self._make_index_row(name, f"{self.one}, counted from 0"),
            self.facts,
            make.heading(self.many),
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
        facts = self._describe(self._document.scaled_spectrum, self._document.unit)
        self.facts.show_values(facts)

    def _describe(self, spectrum: Eigenpairs | None, unit: str) -> dict[str, str]:
        """Show what is special to the family, and give the facts about the column."""
        raise NotImplementedError


class PlugInTab(ColumnStepper):
    """Step through the columns, of which the family says the quantity."""

    icon = '<path d="M6 2v4M10 2v4M4 6h8v3a4 4 0 0 1-8 0zM8 13v3"/>'
    one = "Column"
    many = "Columns"

    def _describe(self, spectrum: Eigenpairs | None, unit: str) -> dict[str, str]:
        if spectrum is None:
            return {}
        chosen = self._document.display[self.family]
        try:
            return dict.fromkeys(self.fact_labels, chosen.quantity(spectrum, unit))
        except InputError as fault:
            show_note(self.missing_note, str(fault))
            return {}


def plug_in_tab(family: type[BankColumns]) -> type[PlugInTab]:
    """The class of the controls of a family that has none of its own."""
    fact_labels = {f"{family.name}_quantity_label": "This column"}
    parts = {"family": family, "tip": family.tip, "fact_labels": fact_labels}
    return type(f"{family.__name__}Tab", (PlugInTab,), parts)


class PinChooser(FieldStepper):
    """A tab of a family with a `vertex`, which follows the newest pin."""

    def __init__(self, document: Document) -> None:
        self._pins: tuple[Pin, ...] = ()
        super().__init__(document)
        listen(document.pins_changed, self._follow_pins)
        self._follow_pins()

    def _make_pin_choice(self) -> tuple[Part, ...]:
        name = self.family.name
        self.hint = note(f"{name}_hint")
        self.combo = make.combo(
            f"{name}_vertex_combo", "Pinned vertex to measure from", self._choose_pin
        )
        above = make.muted("From pinned vertex")
        above.setBuddy(self.combo)
        return above, self.combo

    def _choose_pin(self, row: int) -> None:
        self._change(vertex=self._document.pins[row].vertex)

    def _follow_pins(self) -> None:
        """Measure from the newest pin; from the last one left where its pin was taken away."""
        pins = self._document.pins
        vertex: int | None = getattr(self._document.display[self.family], "vertex")  # noqa: B009
        before = {pin.number for pin in self._pins}
        self._pins = pins
        vertices = [pin.vertex for pin in pins]
        if vertices and (pins[-1].number not in before or vertex not in vertices):
            self._change(vertex=vertices[-1])
        elif not vertices:
            self._change(vertex=None)
        with QSignalBlocker(self.combo):
            self.combo.clear()
            for pin in pins:
                text = f"{pin.number} · {self._document.named_vertex(pin.vertex).capitalize()}"
                self.combo.addItem(make.dot(pin.color), text)
        self.refresh()

    def _show_pin(self, vertex: int | None) -> str:
        """Show from which pin is measured, and say which vertex that is."""
        pins = self._document.pins
        row = next((row for row, pin in enumerate(pins) if pin.vertex == vertex), -1)
        self.combo.setCurrentIndex(row)
        self.combo.setEnabled(bool(pins))
        show_note(self.hint, "" if pins else "Click a vertex on the render to pin it.")
        return "a vertex" if vertex is None or row < 0 else self._document.named_vertex(vertex)
