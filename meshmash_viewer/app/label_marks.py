"""Sizes, borders and graph of the labels of the current set."""

from __future__ import annotations

from functools import partial
from operator import is_
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from PySide6.QtCore import QObject, Signal

from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.surface import BORDERS, GRAPH, Marks
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.labels import LabelSizes, label_sizes
from meshmash_viewer.surface.edges import border_edges, region_graph
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView

#: Mesh, labels, vertices hidden by the user, all hidden vertices, and whether borders and graph are
#: requested.
_Asked: TypeAlias = tuple[Mesh, VertexMap, Mask | None, Mask | None, bool, bool]
#: Marks by the name of their layer in the render.
_Drawn: TypeAlias = dict[str, Marks | None]
_NOTHING: _Drawn = {"borders": None, "graph": None}


class LabelMarks(QObject):
    """Sizes, borders and graph of the current set, computed after each change of the labels."""

    #: A set, and the `LabelSizes` of its labels.
    measured = Signal(object, object)

    def __init__(self, document: Document, scene: MeshView, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._scene = document, scene
        self._asked: _Asked | None = None
        self._slot = Slot(self, "labels")
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
        self._asked = None
        self.refresh()

    def refresh(self) -> None:
        """Measure the labels of the current set, and draw the requested borders and graph."""
        document, display = self._document, self._document.display
        mesh, known = document.mesh, document.labels.current
        drawn = display.label_borders, display.label_graph
        if mesh is None or known is None or not any(drawn):
            self._mark(_NOTHING)
        if mesh is None or known is None:
            self._asked = None
            return
        asked = mesh, known, document.hiding.mask, document.hidden, *drawn
        if self._asked is None or not all(map(is_, self._asked[1:], asked[1:])):
            self._asked = asked
            self._slot.submit(lambda _: _found(asked), partial(self._take, asked))

    def _mark(self, drawn: _Drawn) -> None:
        for name, marks in drawn.items():
            self._scene.set_marks(marks, name)

    def _take(self, asked: _Asked, found: tuple[LabelSizes, _Drawn]) -> None:
        if asked is self._asked:
            sizes, drawn = found
            self.measured.emit(asked[1], sizes)
            if any(asked[4:]) and self._scene.mesh is not None:
                self._mark(drawn)


def _found(asked: _Asked) -> tuple[LabelSizes, _Drawn]:
    mesh, known, chosen, hidden, borders, graph = asked
    faces = mesh.faces if hidden is None else mesh.faces[~hidden[mesh.faces].any(axis=1)]
    values, drawn = np.nan_to_num(known.shown, nan=-1.0), _NOTHING.copy()
    if borders and len(edges := border_edges(faces, values)):
        drawn["borders"] = Marks(edges, BORDERS)
    if graph and len(edges := region_graph(mesh.vertices, faces, values)):
        drawn["graph"] = Marks(edges, GRAPH)
    return label_sizes(mesh, known, chosen), drawn
