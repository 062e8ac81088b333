"""Borders between the labels of the current set, drawn over the displayed field."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from PySide6.QtCore import QObject

from meshmash_viewer.app.latest_thread import LatestThread
from meshmash_viewer.app.listening import listen
from meshmash_viewer.app.view.marks import BORDERS, Marks
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.surface.edges import border_edges
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView

_Asked: TypeAlias = tuple[Mesh, VertexMap, Mask | None]


class LabelBorders(QObject):
    """Finds the borders in a thread whenever labels have changed, and marks them on the render."""

    def __init__(self, document: Document, scene: MeshView, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._scene = document, scene
        self._drawn: _Asked | None = None
        self._thread: LatestThread[_Asked] = LatestThread(_found, self._take, parent=self)
        events = document.display.events
        changes = (
            document.labels.changed, document.spectrum_changed, document.hiding.changed,
            events.label_borders, events.hide_small,
        )  # fmt: skip
        listen(document.mesh_changed, self._begin)
        listen(changes, self.refresh)
        self.refresh()

    def _begin(self) -> None:
        """Draw them anew on a mesh that is drawn anew."""
        self._drawn = None
        self.refresh()

    def refresh(self) -> None:
        """Draw the borders of the current set, or none."""
        document, before = self._document, self._drawn
        mesh, known, hidden = document.mesh, document.labels.current, document.hidden
        if mesh is None or known is None or not document.display.label_borders:
            self._drawn = None
            self._scene.set_marks(None, "borders")
        elif before is None or before[1] is not known or before[2] is not hidden:
            self._drawn = mesh, known, hidden
            self._thread.ask(self._drawn)

    @property
    def idle(self) -> bool:
        """Whether the drawn borders are those of the labels."""
        return not self._thread.working

    def close(self) -> None:
        """Wait for the thread."""
        self._thread.close()

    def _take(self, asked: _Asked, marks: Marks | Exception | None) -> None:
        if isinstance(marks, Exception):
            raise marks
        if asked is self._drawn and self._scene.mesh is not None:
            self._scene.set_marks(marks, "borders")


def _found(asked: _Asked, _cancel: CancelCallback) -> Marks | None:
    mesh, known, hidden = asked
    faces = mesh.faces if hidden is None else mesh.faces[~hidden[mesh.faces].any(axis=1)]
    edges = border_edges(faces, np.nan_to_num(known.shown, nan=-1.0))
    return Marks(edges, BORDERS) if len(edges) else None
