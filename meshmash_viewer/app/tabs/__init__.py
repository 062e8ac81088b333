"""The controls of each family of fields: ``<name>_tab.py`` holds those of the family of a name."""

from __future__ import annotations

from importlib import import_module

from meshmash_viewer.app.tabs.field_stepper import FamilyTab
from meshmash_viewer.fields.family import Family

__all__ = ["tab_of"]


def tab_of(family: type[Family]) -> type[FamilyTab]:
    """The class of a family's controls: the one of its module whose `family` it is."""
    module = import_module(f"{__name__}.{family.name}_tab")
    found: type[FamilyTab] = next(
        each
        for each in vars(module).values()
        if isinstance(each, type) and vars(each).get("family") is family
    )
    return found
