"""Controls of eigenfunctions, and of a filter with a formula."""

from __future__ import annotations

import math
from dataclasses import replace

from PySide6.QtCore import QTimer
from PySide6.QtGui import QColor, QInputMethodEvent, QTextCharFormat
from PySide6.QtWidgets import QApplication, QLineEdit

from meshmash_viewer.app import theme
from meshmash_viewer.app.actions import native_text
from meshmash_viewer.app.controls import make
from meshmash_viewer.app.controls.document_controls import undone_as_one
from meshmash_viewer.app.controls.make import (
    Facts,
    column,
    holder,
    note,
    reserved_note,
    row,
    show_note,
    show_quietly,
)
from meshmash_viewer.app.controls.step_slider import StepSlider
from meshmash_viewer.app.tabs.form import FamilyTab
from meshmash_viewer.app.tabs.parameters import FilterParameters, refusal
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.formula import MOST_CHARACTERS, Formula, FormulaError
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.filters import READY, Filters
from meshmash_viewer.spectral.alignment import MULTIPLET_GAP
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero, format_eigenvalue
from meshmash_viewer.spectral.weyl import format_wavelength
from meshmash_viewer.units import counted, format_number, format_share, power_unit, subscript

_FACTS = {
    "wavelength_label": "Wavelength 2π/√λ",
    "residual_label": "Relative residual",
    "converged_label": "Eigenpairs",
}


class EigenfunctionTab(FamilyTab):
    """Controls of the eigenfunctions, with facts about the displayed one."""

    def _build(self) -> None:
        self.facts = Facts(_FACTS)
        self.multiplet_note = note("multiplet_label")
        self._build_rotation()
        self.preview_note = note("preview_label", "warning")
        tip = native_text("Arrow keys, or the wheel after a click: one step; PgDn: ten steps")
        slider = self._make_slider("eigenvector_slider", "Eigenfunction", tip)
        spoken = "Index of the eigenfunction, counted from 0"
        index = self._make_index_row("eigenvector", spoken)
        notes = self.multiplet_note, self.rotation, self.preview_note
        parts = slider, index, self.facts, *notes
        self._fill("eigenvalue_label", "Eigenvalue", *parts)

    def _build_rotation(self) -> None:
        self.towards_combo = make.combo(
            "rotation_combo", "Second eigenfunction of the rotation", self._rotate
        )
        self.angle_label = make.label("rotation_label", role="value")
        self.angle = theme.named(StepSlider(), "rotation_slider", "Angle of the rotation")
        self.angle.setRange(0, 180)
        self.angle.setPageStep(15)
        self.angle.valueChanged.connect(self._rotate)
        undone_as_one(self.angle, self._document)
        above = row(make.muted("Rotate towards"), self.towards_combo, None, self.angle_label)
        self.rotation = theme.named(holder(column(above, self.angle)), "rotation_controls")

    def _rotate(self, _: int) -> None:
        if self.angle.value() or self._document.display[Eigenfunctions].rotation:
            self._document.rotate(self.towards_combo.currentData(), self.angle.value())

    def _show_rotation(self, chosen: Eigenfunctions, spectrum: Eigenpairs | None) -> None:
        space = None if spectrum is None else chosen.space(spectrum)
        self.rotation.setVisible(space is not None)
        if space is None or spectrum is None:
            return
        rotated, combo = chosen.rotated(spectrum), self.towards_combo
        others = [each for each in space if each != chosen.index]
        if [combo.itemData(at) for at in range(combo.count())] != others:
            combo.clear()
            for each in others:
                combo.addItem(f"φ{subscript(each)}", each)
            combo.setCurrentIndex(combo.findData(chosen.index + 1))
        if rotated is not None or combo.currentIndex() < 0:
            combo.setCurrentIndex(combo.findData(others[0] if rotated is None else rotated[1]))
        degrees = 0 if rotated is None else rotated[2]
        show_quietly(self.angle, degrees)
        self.angle_label.setText(f"{degrees}°")

    def refresh(self) -> None:
        spectrum, display = self._document.spectrum, self._document.display
        last = max(0 if spectrum is None else len(spectrum) - 1, 0)
        chosen = display[Eigenfunctions]
        index = min(chosen.index, last)
        for control in (self.slider, self.spin):
            show_quietly(control, index, most=last)
        self.spin.setSuffix(f" of {last}" if spectrum is not None and len(spectrum) else "")
        title, facts, multiplet, preview = "λ", {}, "", ""
        if spectrum is not None and len(spectrum):
            unit, zeros = self._document.unit, first_nonzero(spectrum)
            value = 0.0 if index < zeros else float(spectrum.eigenvalues[index])
            exact = spectrum.is_exact(index)
            written = format_eigenvalue(value, spectrum, unit, 4) if value else "0"
            title = f"λ{subscript(index)} {'=' if exact else '≈'} {written}"
            facts["wavelength_label"] = format_wavelength(value, unit)
            if exact and index < len(spectrum.residuals):
                facts["residual_label"] = format_number(spectrum.residuals[index], 2)
            facts["converged_label"] = _converged(spectrum)
            multiplet = _multiplet(spectrum, index, zeros)
            if not exact:
                preview = (
                    "Preview: from a coarse mesh, λ within about"
                    f" {format_share(spectrum.error, 2)}. Exact eigenfunctions replace the preview"
                    " as they converge."
                )
        self._show_rotation(replace(chosen, index=index), spectrum)
        self.title.setText(title)
        self.facts.show_values(facts)
        show_note(self.multiplet_note, multiplet)
        show_note(self.preview_note, preview)


def _converged(spectrum: Eigenpairs) -> str:
    if spectrum.preview and not spectrum.n_exact:
        return f"{len(spectrum):,} approximate"
    if spectrum.preview and spectrum.complete:
        return f"{spectrum.n_exact:,}, complete; {len(spectrum):,} with a preview"
    if spectrum.preview:
        return f"{spectrum.n_exact:,} of {spectrum.total or len(spectrum):,} so far"
    if spectrum.complete:
        return f"{len(spectrum):,}, complete"
    of = f" of {spectrum.total:,}" if spectrum.total else ""
    return f"{len(spectrum):,}{of} so far"


def _multiplet(spectrum: Eigenpairs, index: int, zeros: int) -> str:
    if index < zeros:
        if zeros == 1:
            return "Zero mode: constant, because the surface is connected."
        return (
            f"λ₀…λ{subscript(zeros - 1)} are zero: one constant function for each of "
            f"{counted(zeros, 'component')}; any combination of them is an eigenfunction too."
        )
    found = spectrum.multiplet(index)
    if found is None:
        return ""
    return (
        f"λ{subscript(found[0])}…λ{subscript(found[-1])} within {format_number(MULTIPLET_GAP, 1)}: "
        "any orthogonal combination of these is an eigenfunction too."
    )


#: Entry of the combo box for a filter that is not a ready filter.
_OWN = "Formula"
_HINT = "x is λ; other names become sliders. Arithmetic, comparisons, exp, log, sqrt, where, …"


def _no_range(value: float) -> str:
    """Return why a value cannot be an end of a range in log scale, or ""."""
    return "" if value > 0.0 else "The range of a parameter begins above zero."


def _underline(edit: QLineEdit, position: int | None) -> None:
    """Underline the character at a position; None removes the underline."""
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
    """Controls of a filter: ready formulas, a field for a formula, and its parameters."""

    def _build(self) -> None:
        self.combo = make.combo("filter_combo", "Ready filters", self._choose_ready)
        self.combo.addItems([*READY, _OWN])
        self.edit = QLineEdit(maxLength=MOST_CHARACTERS)
        theme.named(self.edit, "filter_formula_edit", "Formula of the filter", tip=_HINT)
        self.edit.textEdited.connect(self._check)
        self.edit.editingFinished.connect(self._take_formula)
        # deferred, as the window takes the focus on Return
        self.edit.returnPressed.connect(lambda: QTimer.singleShot(0, self.edit, self._select_error))
        #: Position of the error in the typed formula.
        self._position: int | None = None
        self.fault = reserved_note("filter_fault", 2, "muted", "Fault of the formula")
        self.parameters = FilterParameters(self._document)
        self.parameters.tried.connect(self._say)
        tip = "Number of values of the first parameter in its range, evenly spaced in log scale"
        count = self._make_count_row("Number of columns", tip)
        heading, box = make.heading("Exported columns"), self._make_range_box()
        filters = self.combo, self.edit, self.fault, self.parameters
        self._fill("filter_label", "Filter", *filters, heading, count, box)
        for field in (self.range_box.low, self.range_box.high):
            field.fault = _no_range

    # -- input of the user ------------------------------------------------------------------

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

    def _select_error(self) -> None:
        """Return the focus to the field of an invalid formula, and select the wrong character."""
        if self._complaint(self.edit.text()):
            self.edit.setFocus()
            if self._position is not None:
                self.edit.setSelection(self._position, 1)

    # -- from the model ---------------------------------------------------------------------

    @property
    def _chosen(self) -> Filters:
        return self._document.display[Filters]

    def _complaint(self, text: str) -> str:
        """Return why a formula is invalid for these eigenpairs, or ""; set `_position`."""
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
