"""Undo and redo of what is displayed and of the options of the solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from meshmash_viewer.fields.family import Family
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.history import History
from meshmash_viewer.model.open_mesh import OpenMesh
from meshmash_viewer.model.solve import Solve

#: Attributes of the display and of the solve that are recorded, with their names in the menu.
_OF_DISPLAY = {
    "policies": "colour limits",
    "log_scales": "colour scale",
    "diverging_colormap": "colour map",
    "sequential_colormap": "colour map",
    "hide_small": "hiding of small components",
    "cut": "clipping plane",
    "shape": "rebuilt shape",
    "nodal_lines": "nodal lines",
    "label_borders": "borders of labels",
    "label_graph": "graph of labels",
}
_OF_SOLVE = {"operator": "Laplacian", "target": "number of eigenpairs"}
#: Parameters of families that choose what is displayed, like `Display.kind`.
_CHOICES = {"chosen", "view"}
_PARAMETERS = {"flipped": "flip of a sign", "rotation": "rotation"}


class DisplayHistory:
    """The parts of a history that are attributes of the display and of the solve."""

    def __init__(self, opened: OpenMesh, display: Display, history: History) -> None:
        self._opened, self._display, self._history = opened, display, history
        #: Names of the parts of the families.
        self.families = tuple(f"field {name}" for name in display.fields)
        #: Names of all parts of the display.
        self.parts = *self.families, "kind", *_OF_DISPLAY
        for part, name in zip(self.families, display.fields, strict=True):
            history.keep(part, partial(self._family, name), self._restore_family)
        history.keep("kind", lambda: display.kind, lambda kind: setattr(display, "kind", kind))
        display.events.fields.connect(self._record_families)
        for part, label in _OF_DISPLAY.items():
            self._keep(display, display.events, part, label)

    def keep_solve(self, solve: Solve) -> None:
        """Declare the options of the solve, and record their changes."""
        for part, label in _OF_SOLVE.items():
            self._keep(solve, solve.changed, part, label)

    def _keep(self, of: object, events: Any, part: str, label: str) -> None:
        """Declare an attribute as a part of the history, and record its changes."""
        self._history.keep(part, partial(getattr, of, part), partial(setattr, of, part))
        # psygnal keeps a weak reference to a method in a partial, so a closed document is freed
        getattr(events, part).connect(partial(self._record, part, label))

    def _record(self, part: str, label: str, _new: object, old: object) -> None:
        self._history.record(label, before={part: old})

    def _record_families(self, new: Mapping[str, Family], old: Mapping[str, Family]) -> None:
        """Record changes of parameters, but for choices of what is displayed and for playing."""
        if self._history.is_paused or self._display.playing:
            return
        changed = [
            (each, name)
            for each in new.values()
            if f"field {each.name}" in self.families and each is not old[each.name]
            for name in each.declared()
            if name not in _CHOICES and getattr(each, name) != getattr(old[each.name], name)
        ]
        if changed:
            family, name = changed[0]
            label = _PARAMETERS.get(name) or f"{family.short} {_word(family, name)}"
            names = {each.name for each, _ in changed}
            self._history.record(label, before={f"field {at}": old[at] for at in names})

    def _family(self, name: str) -> Family:
        return self._display.fields[name]

    def _restore_family(self, family: Family) -> None:
        """Restore a family, within the range of the eigenpairs computed since."""
        now, spectrum = self._display.fields[family.name], self._opened.spectrum
        chosen = {each: getattr(now, each) for each in family.declared() if each in _CHOICES}
        family = replace(family, **chosen)
        within = spectrum is not None and spectrum.complete
        self._display.put(family.within(spectrum) if within and spectrum else family)


def _word(family: Family, name: str) -> str:
    """Return the word for a parameter in "Undo …", such as "time" of a heat kernel signature."""
    declared, noun = family.declared()[name], family.nouns[0]
    if declared.text:
        return declared.text[0].lower() + declared.text[1:].partition(",")[0]
    return noun.lower() if name in family.position and noun != "Column" else name
