"""Reads files of maps for the open mesh, off the interface thread."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Qt, QThreadPool, Signal, Slot

from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.failure import Failure, failure_of
from meshmash_viewer.vertex_map import VertexMap

__all__ = ["MapLoader"]


class MapLoader(QObject):
    """Hands the maps in files to the document; a file that holds none costs a sentence.

    Each file is read in a process of its own (`meshmash_viewer.io.maps`), beside whatever job runs.
    """

    _read = Signal(object, object, object, bool)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._pool = QThreadPool(self, maxThreadCount=1)
        self._waiting = 0
        self._read.connect(self._accept, Qt.ConnectionType.QueuedConnection)
        document.maps_requested.connect(self.load)

    @property
    def idle(self) -> bool:
        """Whether nothing is being read."""
        return self._waiting == 0

    def load(self, paths: tuple[Path, ...], shown: bool) -> None:
        """Read files for the mesh that is open now, and put the last map on the render or not."""
        mesh = self._document.mesh
        if mesh is not None:
            self._waiting += 1
            self._pool.start(lambda: self._work(mesh, paths, shown))

    def close(self) -> None:
        """Wait for what is being read, and take nothing any more."""
        self._document.maps_requested.disconnect(self.load)
        self._read.disconnect(self._accept)
        self._pool.waitForDone()

    def _work(self, mesh: Mesh, paths: tuple[Path, ...], shown: bool) -> None:
        from meshmash_viewer.io.maps import read_maps

        maps: list[VertexMap] = []
        faults: list[Failure] = []
        for path in paths:
            try:
                maps += read_maps(path, mesh)
            except Exception as fault:  # noqa: BLE001  the window says it
                faults.append(failure_of(fault, f"Reading {path.name}"))
        self._read.emit(mesh, maps, faults, shown)

    @Slot(object, object, object, bool)
    def _accept(
        self, mesh: Mesh, maps: list[VertexMap], faults: list[Failure], shown: bool
    ) -> None:
        self._waiting -= 1
        self._document.accept_maps(mesh, maps, shown=shown)
        for failure in faults:
            self._document.notify(notice_of(failure))
