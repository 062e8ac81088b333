"""The maps of a document: added from files or results, growing, removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from psygnal import Signal

from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.history import History
from meshmash_viewer.model.notices import Notices, Severity
from meshmash_viewer.model.open_mesh import OpenMesh, Shown
from meshmash_viewer.model.results import MapGrew
from meshmash_viewer.units import counted, power_unit
from meshmash_viewer.vertex_map import VertexMap


class Maps:
    """Adds maps to the open mesh and removes them; ``requested`` asks that files are read."""

    requested = Signal(object, bool)

    def __init__(
        self, opened: OpenMesh, display: Display, history: History, notices: Notices
    ) -> None:
        self._opened, self._display = opened, display
        self._history, self._notices = history, notices
        #: The map that is being computed, the family that was displayed before, and the mesh.
        self._growing: tuple[str, str, Shown | None] | None = None

    def open(self, paths: Sequence[Path], *, shown: bool = True) -> None:
        """Request that files with values per vertex are read, and the last map shown if `shown`."""
        if self._opened.ready is None:
            text = "There is no mesh to put a map on: open the mesh first, then its maps."
            self._notices.say(text, Severity.WARNING)
        elif paths:
            self.requested.emit(tuple(path.absolute() for path in paths), shown)

    def add(self, mesh: Mesh, maps: Sequence[VertexMap], *, shown: bool = True) -> None:
        """Add maps that were made for a mesh, if that is still open, and show the last."""
        now = self._still(mesh)
        if now is None or not maps:
            return
        more = now.with_maps(*maps)
        self._history.record("new map" if len(maps) == 1 else "new maps", "mesh")
        self._take(more)
        if shown:
            self._show(more.maps[-1].name)
            names = ", ".join(each.name for each in more.maps[len(now.maps) :])
            self._notices.say(f"Added {counted(len(maps), 'map')}: {names}.")
        self._opened.spectrum_changed.emit()

    def remove(self, name: str) -> None:
        """Remove a map from the mesh; its file stays."""
        if self._opened.mesh is not None:
            left = self._opened.mesh.without_map(name)
            self._history.record("removal of a map", "mesh")
            self._take(left)
            self._opened.spectrum_changed.emit()

    def grow(self, mesh: Mesh, grew: MapGrew) -> None:
        """Add values to a map that is being computed, and show it; NaN where values are missing."""
        now = self._still(mesh)
        if now is None:
            return
        if self._growing is None:
            self._growing = grew.name, self._display.kind, self._opened.shown
            values = np.full(now.n_vertices, np.nan, dtype=np.float32)
        else:
            values = np.array(now.map_named(grew.name).values)
        values[grew.vertices] = grew.values
        if any(each.name == grew.name for each in now.maps):
            now = now.without_map(grew.name)
        unit = power_unit(now.unit, -2)
        self._take(now.with_maps(VertexMap(grew.name, values, unit=unit)))
        self._show(grew.name)
        self._opened.spectrum_changed.emit()

    def end_growing(self, whole: bool) -> None:
        """Keep the computed map if it is whole; else remove it and show the previous family."""
        if self._growing is not None:
            (name, kind, before), self._growing = self._growing, None
            if whole:
                self._history.record("new map", before={"mesh": before})
            else:
                with self._history.paused():
                    self.remove(name)
                self._display.kind = kind

    def _still(self, mesh: Mesh) -> Mesh | None:
        """Return the open mesh if it has the vertices of another one, else None."""
        now = self._opened.mesh
        return now if now is not None and now.vertices is mesh.vertices else None

    def _take(self, mesh: Mesh) -> None:
        assert self._opened.ready is not None
        self._opened.take(replace(self._opened.ready, mesh=mesh), self._opened.spectrum)

    def _show(self, name: str) -> None:
        chosen = replace(self._display[OwnMaps], chosen=name, view="map")
        self._display.show(chosen)
