"""Controls of a family that a plug-in adds: which column, and how many."""

from __future__ import annotations

from meshmash_viewer.app.controls.facts import show_note
from meshmash_viewer.app.tabs.field_stepper import ColumnStepper
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.fields.spectrum import Spectrum

__all__ = ["PlugInTab", "plug_in_tab"]


class PlugInTab(ColumnStepper):
    """Step through the columns, of which the family says the quantity."""

    icon = '<path d="M6 2v4M10 2v4M4 6h8v3a4 4 0 0 1-8 0zM8 13v3"/>'
    one = "Column"
    many = "Columns"

    def _describe(self, spectrum: Spectrum | None, unit: str) -> dict[str, str]:
        if spectrum is None:
            return {}
        chosen = self._document.display[self.family]
        try:
            return dict.fromkeys(self.told, chosen.quantity(spectrum, unit))
        except InputError as fault:
            show_note(self.missing_note, str(fault))
            return {}


def plug_in_tab(family: type[BankColumns]) -> type[PlugInTab]:
    """The class of the controls of a family that has none of its own."""
    told = {f"{family.name}_quantity_label": "This column"}
    parts = {"family": family, "tip": family.tip, "told": told}
    return type(f"{family.__name__}Tab", (PlugInTab,), parts)
