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
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    from meshmash_viewer.app.view.mesh_view import MeshView

_Asked: TypeAlias = tuple[Mesh, VertexMap]


class LabelBorders(QObject):
    """Finds the borders in a thread whenever labels have changed, and marks them on the render."""

    def __init__(self, document: Document, scene: MeshView, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._scene = document, scene
        self._drawn: _Asked | None = None
        self._thread: LatestThread[_Asked] = LatestThread(_found, self._take, parent=self)
        labels, borders = document.labels.changed, document.display.events.label_borders
        listen((labels, borders, document.spectrum_changed, document.mesh_changed), self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Draw the borders of the current set, or none."""
        mesh, known = self._document.mesh, self._document.labels.current
        if mesh is None or known is None or not self._document.display.label_borders:
            self._drawn = None
            self._scene.set_marks(None, "borders")
        elif (
            self._drawn is None
            or self._drawn[0].faces is not mesh.faces
            or self._drawn[1] is not known
        ):
            self._drawn = mesh, known
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
    mesh, known = asked
    edges = border_edges(mesh.faces, np.nan_to_num(known.shown, nan=-1.0))
    return Marks(edges, BORDERS) if len(edges) else None
