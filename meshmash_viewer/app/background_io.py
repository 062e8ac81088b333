"""Reading and writing of small files in a background thread, and notices of saved files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import shiboken6
from PySide6.QtCore import QObject, Qt, QThreadPool, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from meshmash_viewer.app.faults import notice_of
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap

Result = TypeVar("Result")

#: Milliseconds after which reading is announced.
_SLOW = 400
SHOW_IN_FOLDER = "Show in folder"


class BackgroundIO(QObject):
    """Runs tasks one after the other in a thread, and notifies the document of failures.

    Files of maps that the document requests are read here.
    """

    _done = Signal(object, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._pool = QThreadPool(self, maxThreadCount=1)
        self._waiting = 0
        self._done.connect(self._end, Qt.ConnectionType.QueuedConnection)
        document.maps.requested.connect(self.read_maps)

    @property
    def idle(self) -> bool:
        """Whether no task is running or waiting."""
        return self._waiting == 0

    def run(self, doing: str, work: Callable[[], Result], then: Callable[[Result], object]) -> None:
        """Call `work` in the thread, and then `then` in the caller's thread with its result.

        `doing` names the task in the message on a failure: "Writing shape.ply".
        """

        def task() -> None:
            try:
                result = work()
            except Exception as fault:  # noqa: BLE001  shown in the message bar
                failure = failure_of(fault, doing)
                finish(lambda _: self._document.notices.show(notice_of(failure)), None)
            else:
                finish(then, result)

        def finish(call: Callable[[Any], object], result: object) -> None:
            if shiboken6.isValid(self):  # the program may have ended meanwhile
                self._done.emit(call, result)

        self._waiting += 1
        self._pool.start(task)

    def read_maps(self, paths: tuple[Path, ...], shown: bool) -> None:
        """Read maps for the open mesh; a file without maps gives a message."""
        from meshmash_viewer.io.maps import maps_and_remarks

        document, mesh = self._document, self._document.mesh
        assert mesh is not None  # the document requests maps only with a mesh
        faults: list[Failure] = []
        remarks: list[str] = []

        def read() -> list[VertexMap]:
            maps: list[VertexMap] = []
            for path in paths:
                try:
                    found, said = maps_and_remarks(path, mesh)
                    maps += found
                    remarks.extend(said)
                except Exception as fault:  # noqa: BLE001  shown below
                    faults.append(failure_of(fault, f"Reading {path.name}"))
            return maps

        def take(maps: list[VertexMap]) -> None:
            document.maps.add(mesh, maps, shown=shown)
            for failure in faults:
                document.notices.show(notice_of(failure))
            if shown and remarks:
                document.notices.say(" ".join(remarks), Severity.WARNING)

        def say() -> None:
            if not self.idle:
                what = paths[0].name if len(paths) == 1 else counted(len(paths), "map file")
                document.notices.show(Notice(f"Reading {what} …", holds=lambda: not self.idle))

        self.run("Reading maps", read, take)
        if shown:
            QTimer.singleShot(_SLOW, self, say)

    def close(self) -> None:
        """Disconnect, and wait for the running task."""
        self._document.maps.requested.disconnect(self.read_maps)
        self._done.disconnect(self._end)
        self._pool.waitForDone()

    def _end(self, then: Callable[[Any], object], result: object) -> None:
        self._waiting -= 1
        then(result)
        self._document.notices.review()


def say_saved(document: Document, text: str, path: Path) -> None:
    """Show that a file has been saved, with a button that shows its folder."""
    document.notices.show(saved_notice(document, text, path))


def saved_notice(
    document: Document, text: str, path: Path, severity: Severity = Severity.INFORMATION
) -> Notice:
    """Return the notice of `say_saved`."""

    def show_folder() -> None:
        folder = path.absolute().parent
        if not QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder))):
            text = f"This system has no program that shows folders: the folder is {folder}."
            document.notices.say(text, Severity.WARNING)

    return Notice(text, severity, action=show_folder, button=SHOW_IN_FOLDER)
