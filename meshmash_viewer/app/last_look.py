"""Where each mesh was left: one with stored eigenpairs opens with the field it had last."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from PySide6.QtCore import QObject

from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document

__all__ = ["LastLook"]


class LastLook(QObject):
    """Notes what is on the render of a mesh file, and puts it there again when it is reopened."""

    def __init__(self, document: Document, settings: Settings, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self._settings = settings
        self._mesh: Mesh | None = None
        self._looks: dict[str, dict[str, Any]] = settings.looks
        # later than `restore`: a mesh that has just come still shows what every mesh begins with
        follow(document.display.events, self._note)

    def _key(self) -> str | None:
        path = self._document.path
        return None if path is None else str(path.absolute())

    def _note(self) -> None:
        key, spectrum, display = self._key(), self._document.spectrum, self._document.display
        if key is None or spectrum is None or not display.family.position:
            return
        self._looks.pop(key, None)  # the newest is last
        self._looks[key] = {
            "kind": display.kind,
            "fields": {
                name: {each: getattr(family, each) for each in family.position}
                for name, family in display.fields.items()
            },
        }

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
        if look["kind"] in display.fields:
            display.kind = look["kind"]

    def keep(self) -> None:
        """Store it for the next time the program runs."""
        self._settings.looks = self._looks
