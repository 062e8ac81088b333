"""Where each mesh was left: it opens in the unit, with the repairs, and if its eigenpairs are
stored with the field, that it had last."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from PySide6.QtCore import QObject

from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.parameter import Refused
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document

#: State of each mesh file, by its path.
Looks: TypeAlias = dict[str, dict[str, Any]]


def _key(path: Path) -> str:
    return str(path.absolute())


def _position(family: Family) -> dict[str, Any]:
    known = family.plain()
    return {name: known[name] for name in family.position if name in known}


class LastState(QObject):
    """Records the unit and the repairs of a document's mesh file.

    The unit is recorded once the user has set it; until then it is that of the file.
    """

    def __init__(self, document: Document, looks: Looks, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._looks = document, looks
        self._before: tuple[str | None, str] = (None, "")
        listen(document.mesh_changed, self._note)

    @property
    def key(self) -> str | None:
        """Key of the mesh file; None for a mesh in memory."""
        path = self._document.path
        return None if path is None else _key(path)

    def keep(self, **known: Any) -> None:
        """Record state of the mesh file."""
        if self.key is not None:
            self._looks[self.key] = self._looks.pop(self.key, {}) | known  # the newest is last

    def _note(self) -> None:
        ready, key, unit = self._document.ready, self.key, self._document.unit_text
        if key is None or ready is None:
            return
        if ready.asked_unit or (key == self._before[0] and unit != self._before[1]):
            self.keep(unit=unit)
        self._before = key, unit
        if ready.repairs or self._looks.get(key, {}).get("repairs"):
            self.keep(repairs=list(ready.repairs), source=ready.source)


class LastLook(QObject):
    """Notes what is on the render of a mesh file, and puts it there again when it is reopened."""

    def __init__(self, document: Document, settings: Settings, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self._settings = settings
        self._mesh: Mesh | None = None
        self._looks: Looks = settings.looks
        self._state = LastState(document, self._looks, self)
        # later than `restore`: a mesh that has just come still shows what every mesh begins with
        follow(document.display.events, self._note)

    def watch(self, document: Document, parent: QObject) -> None:
        """Note unit and repairs of another document, too, as long as `parent` lives."""
        LastState(document, self._looks, parent)

    def _note(self) -> None:
        spectrum, display = self._document.spectrum, self._document.display
        if spectrum is not None and display.family.position:
            self._state.keep(
                kind=display.kind,
                fields={
                    name: {
                        each: at for each, at in family.plain().items() if each in family.position
                    }
                    for name, family in display.fields.items()
                },
            )

    def state(self, path: Path) -> dict[str, Any]:
        """How a mesh file was left, as `Document.open_mesh` takes it: unit and repairs."""
        look = self._looks.get(_key(path), {})
        unit, source, names = (look.get(name) for name in ("unit", "source", "repairs"))
        repairs = names if isinstance(names, list) and source else []
        return {
            "unit": str(unit or ""),
            "repairs": tuple(str(name) for name in repairs),
            "source": str(source or ""),
        }

    def restore(self) -> None:
        """Show what was shown last, as far as the stored eigenpairs reach."""
        before, self._mesh = self._mesh, self._document.mesh
        if before is not None and self._mesh and before.vertices is self._mesh.vertices:
            return  # only its unit is another one
        spectrum, display = self._document.spectrum, self._document.display
        look = self._looks.get(self._state.key or "")
        if look is None or spectrum is None or not len(spectrum):
            return
        for name, place in look.get("fields", {}).items():
            family = display.fields.get(name)
            with contextlib.suppress(Refused):  # of settings that another program has changed
                if family is not None:
                    display.put(replace(family, **family.entries()(place)).within(spectrum))
        family = display.fields.get(str(look.get("kind")))
        if family is not None and family.usable:
            display.kind = family.name

    def keep(self) -> None:
        """Store it for the next time the program runs."""
        self._settings.looks = self._looks
