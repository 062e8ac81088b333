"""What the tabs of families have in common whose fields are the columns of a feature."""

from __future__ import annotations

from typing import ClassVar

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QHBoxLayout, QLabel, QSpinBox, QVBoxLayout

from meshmash_viewer.app import theme
from meshmash_viewer.app.controls.facts import Facts, note, show_note
from meshmash_viewer.app.tabs.field_stepper import FieldStepper
from meshmash_viewer.app.tabs.play_button import PlayButton
from meshmash_viewer.fields.bank_columns import MOST_COLUMNS, BankColumns
from meshmash_viewer.fields.spectrum import Spectrum, first_nonzero

__all__ = ["ColumnStepper"]


class ColumnStepper(FieldStepper):
    """Step through the columns; their number is that of the exported feature.

    Subclasses say what a column is in `_describe`, and add controls in `_build_range`.

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
        name = self.family.name
        column = self._build_head((f"{name}_label", self.one), (f"{name}_slider", self.one))
        row = QHBoxLayout()
        row.setSpacing(theme.GAP)
        self.spin = self._index_spin(f"{name}_spin", f"{self.one}, counted from 0")
        self.play_button = PlayButton(self._document, f"{name}_play_button", self)
        row.addWidget(self.spin)
        row.addWidget(self.play_button)
        row.addStretch(1)
        column.addLayout(row)
        self.facts = Facts(self.told, self)
        column.addWidget(self.facts)

        column.addWidget(theme.with_role(QLabel(self.many, self), "heading"))
        line = QHBoxLayout()
        self.count_spin = QSpinBox(self)
        self.count_spin.setObjectName(f"{name}_count_spin")
        self.count_spin.setAccessibleName(f"Number of {self.many.lower()}")
        self.count_spin.setToolTip(self.tip)
        self.count_spin.setRange(1, MOST_COLUMNS)
        self.count_spin.setKeyboardTracking(False)
        self.count_spin.valueChanged.connect(self._set_count)
        line.addWidget(theme.with_role(QLabel(f"Number of {self.many.lower()}", self), "muted"))
        line.addStretch(1)
        line.addWidget(self.count_spin)
        column.addLayout(line)
        self._build_range(column)
        self.missing_note = note(f"{name}_missing_label", "warning", self)
        column.addWidget(self.missing_note)
        column.addStretch(1)

    def _build_range(self, column: QVBoxLayout) -> None:
        """Add what sets the range of the columns."""

    def _set_count(self, count: int) -> None:
        chosen = self._document.display[self.family]
        self._change(index=min(chosen.index, count - 1), count=count)

    @property
    def _usable(self) -> Spectrum | None:
        """The spectrum, if it has a scale to take columns from."""
        spectrum = self._document.spectrum
        usable = spectrum is not None and first_nonzero(spectrum) < len(spectrum)
        return spectrum if usable else None

    def refresh(self) -> None:
        """Show what the model holds."""
        chosen, mesh = self._document.display[self.family], self._document.mesh
        last = chosen.count - 1
        for control in (self.slider, self.spin):
            with QSignalBlocker(control):
                control.setRange(0, last)
                control.setValue(chosen.column)
        self.spin.setSuffix(f" of {last}")
        with QSignalBlocker(self.count_spin):
            self.count_spin.setValue(chosen.count)
        self.title.setText(f"{self.one} {chosen.column}")
        show_note(self.missing_note, "")
        told = self._describe(self._usable, mesh.unit if mesh is not None else "")
        for name in self.told:
            self.facts.show_value(name, told.get(name, ""))

    def _describe(self, spectrum: Spectrum | None, unit: str) -> dict[str, str]:
        """Show what is special to the family, and give the facts about the column."""
        raise NotImplementedError
