"""Controls of a filter of one's own: its formula, and a slider for each of its parameters."""

from __future__ import annotations

import math

from PySide6.QtCore import QTimer
from PySide6.QtGui import QColor, QInputMethodEvent, QTextCharFormat
from PySide6.QtWidgets import QApplication, QLineEdit

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.make import reserved_note, row, show_quietly
from meshmash_viewer.app.tabs.form import FamilyTab, PlayButton
from meshmash_viewer.app.tabs.parameters import FilterParameters, refusal
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.formula import MOST_CHARACTERS, Formula, FormulaError
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import power_unit

#: What the list calls a filter that is none of the ready ones.
_OWN = "Formula"
_HINT = "x is λ; other names become sliders. Arithmetic, comparisons, exp, log, sqrt, where, …"


def _no_range(value: float) -> str:
    """Why a value cannot be an end of the range, which is run through in log scale."""
    return "" if value > 0.0 else "The range of a parameter begins above zero."


def _underline(edit: QLineEdit, position: int | None) -> None:
    """Underline a character; None for no character."""
    formats = []
    if position is not None:
        wave = QTextCharFormat()
        wave.setUnderlineStyle(QTextCharFormat.UnderlineStyle.WaveUnderline)
        wave.setUnderlineColor(QColor(theme.palette().error))
        wave.setForeground(QColor(theme.palette().error))
        kind = QInputMethodEvent.AttributeType.TextFormat
        start = position - edit.cursorPosition()
        formats = [QInputMethodEvent.Attribute(kind, start, 1, wave)]
    # Qt has no other way to format a part of the text
    QApplication.sendEvent(edit, QInputMethodEvent("", formats))


class FilterTab(FamilyTab):
    """Choose a ready filter or write one, and move its parameters."""

    def _build(self) -> None:
        self.combo = make.combo("filter_combo", "Ready filters", self._choose_ready)
        self.combo.addItems([*READY, _OWN])
        self.edit = QLineEdit(maxLength=MOST_CHARACTERS)
        theme.named(self.edit, "filter_formula_edit", "Formula of the filter", tip=_HINT)
        self.edit.textEdited.connect(self._check)
        self.edit.editingFinished.connect(self._take_formula)
        # after the window has taken the focus away
        self.edit.returnPressed.connect(lambda: QTimer.singleShot(0, self.edit, self._point))
        #: Where the typed formula is wrong.
        self._position: int | None = None
        self.fault = reserved_note("filter_fault", 2, "muted", "What is wrong with the formula")
        self.parameters = FilterParameters(self._document)
        self.parameters.tried.connect(self._say)
        self._fill(
            "filter_label",
            "Filter",
            self.combo,
            self.edit,
            self.fault,
            self.parameters,
            row(PlayButton(self._document, "filter_play_button"), None),
            make.heading("Exported columns"),
            self._make_count_row(
                "Number of columns",
                "With more than one, the first parameter goes through its range, evenly in log",
            ),
            self._make_range_box(),
        )
        for field in (self.range_box.low, self.range_box.high):
            field.fault = _no_range

    # -- from the person --------------------------------------------------------------------

    def _choose_ready(self, index: int) -> None:
        text = READY.get(self.combo.itemText(index))
        if text is None:
            self.edit.setFocus()
            self.edit.selectAll()
        else:
            self._set_formula(text)

    def _set_formula(self, text: str) -> None:
        self._document.display.put(self._chosen.with_text(text))

    def _take_formula(self) -> None:
        text = self.edit.text().strip()
        if text != self._chosen.text and not self._complaint(text):
            self._set_formula(text)

    def _check(self, text: str) -> None:
        self._say(self._complaint(text))
        _underline(self.edit, self._position)

    def _point(self) -> None:
        """Select the wrong character of a formula that is not taken, to be typed over."""
        if self._complaint(self.edit.text()):
            self.edit.setFocus()
            if self._position is not None:
                self.edit.setSelection(self._position, 1)

    # -- from the model ---------------------------------------------------------------------

    @property
    def _chosen(self) -> Filters:
        return self._document.display[Filters]

    def _complaint(self, text: str) -> str:
        """What is wrong with a formula on these eigenpairs; empty if nothing is."""
        try:
            Formula(text)
        except InputError as fault:
            self._position = fault.position if isinstance(fault, FormulaError) else None
            return str(fault)
        self._position = None
        return refusal(Filters(text), self._document.scaled_spectrum)

    def _say(self, complaint: str) -> None:
        theme.change_role(self.fault, "warning" if complaint else "muted")
        self.fault.setText(complaint or _HINT)

    def refresh(self) -> None:
        chosen, spectrum = self._chosen, self._document.scaled_spectrum
        named = next((name for name, text in READY.items() if text == chosen.text), _OWN)
        self.combo.setCurrentText(named)
        self.title.setText(named)
        if not (self.edit.hasFocus() and self.edit.isModified()):
            self.edit.setText(chosen.text)
            self._say("")
        show_quietly(self.count_spin, chosen.count)
        self.parameters.refresh()
        self._show_range(chosen, spectrum)

    def _show_range(self, chosen: Filters, spectrum: Eigenpairs | None) -> None:
        unit, powers = self._document.unit, chosen.formula.powers
        power = powers.get(chosen.first, 0)
        between = None if spectrum is None or not chosen.first else chosen.range(spectrum)
        self.range_box.show_range(
            between,
            power_unit(unit, power) if power else "",
            (0.0, math.inf),
            automatic=chosen.automatic,
        )
