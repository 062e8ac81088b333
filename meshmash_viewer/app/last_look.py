"""Where each mesh was left: it opens in the unit, and if its eigenpairs are stored with the field,
that it had last."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject

from meshmash_viewer.app.listening import follow, listen
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document

__all__ = ["LastLook"]


class LastLook(QObject):
    """Notes what is on the render of a mesh file, and puts it there again when it is reopened.

    The unit is noted once it is given by hand: until then it is what the file says.
    """

    def __init__(self, document: Document, settings: Settings, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self._settings = settings
        self._mesh: Mesh | None = None
        self._looks: dict[str, dict[str, Any]] = settings.looks
        self._unit: tuple[str | None, str] = (None, "")
        listen(document.mesh_changed, self._note_unit)
        # later than `restore`: a mesh that has just come still shows what every mesh begins with
        follow(document.display.events, self._note)

    def _key(self) -> str | None:
        path = self._document.path
        return None if path is None else str(path.absolute())

    def _note(self) -> None:
        key, spectrum, display = self._key(), self._document.spectrum, self._document.display
        if key is None or spectrum is None or not display.family.position:
            return
        self._keep(
            key,
            kind=display.kind,
            fields={
                name: {each: getattr(family, each) for each in family.position}
                for name, family in display.fields.items()
            },
        )

    def _keep(self, key: str, **known: Any) -> None:
        self._looks[key] = self._looks.pop(key, {}) | known  # the newest is last

    def _note_unit(self) -> None:
        key, unit = self._key(), self._document.unit_text
        if key is not None and key == self._unit[0] and unit != self._unit[1]:
            self._keep(key, unit=unit)
        self._unit = key, unit

    def unit(self, path: Path) -> str:
        """The unit that a mesh file was given by hand; empty if there is none."""
        look = self._looks.get(str(path.absolute()), {})
        return str(look.get("unit", ""))

    def restore(self) -> None:
        """Show what was shown last, as far as the stored eigenpairs reach."""
        before, self._mesh = self._mesh, self._document.mesh
        if before is not None and self._mesh and before.vertices is self._mesh.vertices:
            return  # only its unit is another one
        spectrum, display = self._document.spectrum, self._document.display
        look = self._looks.get(self._key() or "")
        if look is None or spectrum is None or not len(spectrum):
            return
        for name, place in look.get("fields", {}).items():
            if name in display.fields:
                display.put(replace(display.fields[name], **place).within(spectrum))
        if look.get("kind") in display.fields:
            display.kind = look["kind"]

    def keep(self) -> None:
        """Store it for the next time the program runs."""
        self._settings.looks = self._looks
