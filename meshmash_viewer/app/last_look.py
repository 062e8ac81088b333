"""Where each mesh was left: one with stored eigenpairs opens with the field it had last."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject

from meshmash_viewer.app.listening import follow
from meshmash_viewer.app.settings import Settings
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import FieldKind
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.ranges import hks_range

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
        if key is None or spectrum is None or display.kind is FieldKind.SIMILARITY:
            return
        self._looks.pop(key, None)  # the newest is last
        self._looks[key] = {
            "kind": display.kind.value,
            "index": display.index,
            "time": display.time,
            "band": display.band,
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
        display.index = min(int(look["index"]), len(spectrum) - 1)
        display.band = min(int(look["band"]), display.band_count - 1)
        low, high = hks_range(spectrum, display)
        time = look["time"]
        display.time = time if time is not None and low <= time <= high else None
        display.kind = FieldKind(look["kind"])

    def keep(self) -> None:
        """Store it for the next time the program runs."""
        self._settings.looks = self._looks
