"""The controls of each family of fields: ``<name>_tab.py`` holds those of the family of a name."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec

from meshmash_viewer.app.tabs.field_stepper import FamilyTab, plug_in_tab
from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.fields.family import Family

__all__ = ["tab_of"]


def tab_of(family: type[Family]) -> type[FamilyTab]:
    """The class of a family's controls: the one of its module whose `family` it is."""
    name = f"{__name__}.{family.name}_tab"
    if issubclass(family, BankColumns) and find_spec(name) is None:
        return plug_in_tab(family)
    found: type[FamilyTab] = next(
        each
        for each in vars(import_module(name)).values()
        if isinstance(each, type) and vars(each).get("family") is family
    )
    return found
