"""Borders between the labels of the current set, and the graph of regions, over the field."""

from __future__ import annotations

from operator import is_
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from PySide6.QtCore import QObject

from meshmash_viewer.app.background import LatestThread
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.surface import BORDERS, GRAPH, Marks
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.surface.edges import border_edges, region_graph
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Mesh, labels, hidden vertices, and whether borders and graph are requested.
_Asked: TypeAlias = tuple[Mesh, VertexMap, Mask | None, bool, bool]
#: Marks by the name of their layer in the render.
_Found: TypeAlias = dict[str, Marks | None]
_NOTHING: _Found = {"borders": None, "graph": None}


class LabelBorders(QObject):
    """Drawing of borders and graph, which a thread computes after each change of the labels."""

    def __init__(self, document: Document, scene: MeshView, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._scene = document, scene
        self._drawn: _Asked | None = None
        self._thread: LatestThread[_Asked] = LatestThread(_found, self._take, parent=self)
        events = document.display.events
        changes = (
            document.labels.changed, document.spectrum_changed, document.hiding.changed,
            events.label_borders, events.label_graph, events.hide_small,
        )  # fmt: skip
        listen(document.mesh_changed, self._begin)
        listen(changes, self.refresh)
        self.refresh()

    def _begin(self) -> None:
        """Draw borders and graph on a new mesh."""
        self._drawn = None
        self.refresh()

    def refresh(self) -> None:
        """Draw the requested borders and graph of the current label set."""
        document, display = self._document, self._document.display
        mesh, known = document.mesh, document.labels.current
        if mesh is None or known is None or not (display.label_borders or display.label_graph):
            self._drawn = None
            self._mark(_NOTHING)
            return
        asked = mesh, known, document.hidden, display.label_borders, display.label_graph
        if self._drawn is None or not all(map(is_, self._drawn[1:], asked[1:])):
            self._drawn = asked
            self._thread.ask(asked)

    def _mark(self, found: _Found) -> None:
        for name, marks in found.items():
            self._scene.set_marks(marks, name)

    @property
    def idle(self) -> bool:
        """Whether borders and graph of the current labels are drawn."""
        return not self._thread.working

    def close(self) -> None:
        """Wait until the thread has ended."""
        self._thread.close()

    def _take(self, asked: _Asked, found: _Found | Exception) -> None:
        if isinstance(found, Exception):
            raise found
        if asked is self._drawn and self._scene.mesh is not None:
            self._mark(found)


def _found(asked: _Asked, _cancel: CancelCallback) -> _Found:
    mesh, known, hidden, borders, graph = asked
    faces = mesh.faces if hidden is None else mesh.faces[~hidden[mesh.faces].any(axis=1)]
    values, found = np.nan_to_num(known.shown, nan=-1.0), _NOTHING.copy()
    if borders and len(edges := border_edges(faces, values)):
        found["borders"] = Marks(edges, BORDERS)
    if graph and len(edges := region_graph(mesh.vertices, faces, values)):
        found["graph"] = Marks(edges, GRAPH)
    return found
