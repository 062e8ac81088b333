"""What is read or written beside the job that runs, in a thread of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from PySide6.QtCore import QObject, Qt, QThreadPool, Signal

from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.model.document import Document, Notice, Severity
from meshmash_viewer.model.failure import Failure, failure_of
from meshmash_viewer.vertex_map import VertexMap

__all__ = ["Errands"]

Result = TypeVar("Result")


class Errands(QObject):
    """Does one thing after the other, and tells the document of those that fail.

    Files of maps that the document asks for are read here.
    """

    _done = Signal(object, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._pool = QThreadPool(self, maxThreadCount=1)
        self._waiting = 0
        self._done.connect(self._end, Qt.ConnectionType.QueuedConnection)
        document.maps_requested.connect(self.read_maps)

    @property
    def idle(self) -> bool:
        """Whether there is nothing left to do."""
        return self._waiting == 0

    def run(self, doing: str, work: Callable[[], Result], then: Callable[[Result], object]) -> None:
        """Call a function in the thread, and then another one here with what it returned.

        Parameters
        ----------
        doing : str
            For the sentence on a failure: "Writing shape.ply".
        work, then : callable
        """

        def errand() -> None:
            try:
                result = work()
            except Exception as fault:  # noqa: BLE001  said to the person
                failure = failure_of(fault, doing)
                self._done.emit(lambda _: self._document.notify(notice_of(failure)), None)
            else:
                self._done.emit(then, result)

        self._waiting += 1
        self._pool.start(errand)

    def read_maps(self, paths: tuple[Path, ...], shown: bool) -> None:
        """Hand the maps in files to the open mesh; a file that holds none costs a sentence."""
        from meshmash_viewer.io.maps import maps_and_remarks

        document, mesh = self._document, self._document.mesh
        assert mesh is not None  # they are asked for with it
        faults: list[Failure] = []
        remarks: list[str] = []

        def read() -> list[VertexMap]:
            maps: list[VertexMap] = []
            for path in paths:
                try:
                    found, said = maps_and_remarks(path, mesh)
                    maps += found
                    remarks.extend(said)
                except Exception as fault:  # noqa: BLE001  said below
                    faults.append(failure_of(fault, f"Reading {path.name}"))
            return maps

        def take(maps: list[VertexMap]) -> None:
            document.accept_maps(mesh, maps, shown=shown)
            for failure in faults:
                document.notify(notice_of(failure))
            if shown and remarks:
                document.notify(Notice(" ".join(remarks), Severity.WARNING))

        self.run("Reading maps", read, take)

    def close(self) -> None:
        """Wait for what is being done, and take nothing any more."""
        self._document.maps_requested.disconnect(self.read_maps)
        self._done.disconnect(self._end)
        self._pool.waitForDone()

    def _end(self, then: Callable[[Any], object], result: object) -> None:
        self._waiting -= 1
        then(result)
