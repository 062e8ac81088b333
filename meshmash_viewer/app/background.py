"""Background work of a window: jobs, and file access."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from PySide6.QtCore import QObject, Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from meshmash_viewer.app.executor import Held, Slot
from meshmash_viewer.app.listening import listen, receive
from meshmash_viewer.app.view.camera import geometry_of
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Job, Queueing
from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of, notice_of
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.worker import Worker
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import JobResult

Result = TypeVar("Result")

#: Milliseconds of reading files after which a message is shown.
_SLOW = 400
SHOW_IN_FOLDER = "Show in folder"


class BackgroundIO(QObject):
    """File access in the background: calls functions in order, and shows failures as notices.

    The map files that the document requests are read too.
    """

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._slot = Slot(self, "files")
        self._failures: list[Failure] = []
        self._remarks: list[str] = []
        receive(document.maps.requested, self.read_maps)

    @property
    def idle(self) -> bool:
        return not self._slot.working

    def run(self, doing: str, work: Callable[[], Result], then: Callable[[Result], object]) -> None:
        """Call `work` in a thread, then `then` with its result in the interface thread.

        `doing` names the task in the message of a failure, such as "Writing shape.ply".
        """

        def call(_: object) -> Callable[[], object]:
            try:
                return partial(then, work())
            except Cancelled:
                return partial(self._document.notices.say, f"Cancelled: {doing}.")
            except Exception as fault:  # noqa: BLE001  shown in the message bar
                return partial(self._failures.append, failure_of(fault, doing))

        self._slot.submit(call, self._end, queued=True)

    def read_maps(self, paths: tuple[Path, ...], shown: bool, labels: bool) -> None:
        """Read maps or label sets for the open mesh; one message names all unreadable files."""
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
                    remarks.extend(said if shown else ())
                except Exception as fault:  # noqa: BLE001  shown once idle
                    faults.append(failure_of(fault, f"Reading {path.name}"))
            return maps

        def take(maps: list[VertexMap]) -> None:
            document.maps.add(mesh, maps, shown=shown, labels=labels)
            self._failures += faults
            self._remarks += remarks

        def say() -> None:
            if not self.idle:
                what = paths[0].name if len(paths) == 1 else counted(len(paths), "map file")
                document.notices.show(Notice(f"Reading {what} …", holds=lambda: not self.idle))

        self.run("Reading maps", read, take)
        if shown:
            QTimer.singleShot(_SLOW, self, say)

    def _end(self, then: Callable[[], object]) -> None:
        then()
        if self.idle:
            self._show_failures()
        self._document.notices.review()

    def _show_failures(self) -> None:
        """Show all failures and remarks of the tasks since the last idle moment in one message."""
        failures, self._failures = self._failures, []
        remarks, self._remarks = self._remarks, []
        text = " ".join([*(failure.text for failure in failures), *remarks])
        if failures:
            details = "\n".join(filter(None, (failure.details for failure in failures)))
            self._document.notices.show(notice_of(Failure(text, details)))
        elif remarks:
            self._document.notices.say(text, Severity.WARNING)


def say_saved(document: Document, text: str, path: Path) -> None:
    """Show that a file has been saved, with a button that shows its folder."""
    document.notices.show(saved_notice(document, text, path))


def saved_notice(
    document: Document, text: str, path: Path, severity: Severity = Severity.INFORMATION
) -> Notice:
    """Return the notice that `say_saved` shows."""

    def show_folder() -> None:
        folder = path.absolute().parent
        if not QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder))):
            text = f"This system has no program that shows folders: the folder is {folder}."
            document.notices.say(text, Severity.WARNING)

    return Notice(text, severity, action=show_folder, button=SHOW_IN_FOLDER, brief=True)


class Jobs(QObject):
    """Queue of the jobs of a document, which runs one at a time in a process of its own."""

    _received = Signal(str, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        #: The running job, and those that wait.
        self.running: Job | None = None
        self._waiting: list[Job] = []
        self._received.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self.worker = Worker(self._prepare)
        self._held = Held(self, self._waiting.clear, self.worker.close)
        receive(document.work.requested, self.run)
        listen(document.work.cancel_requested, self.cancel)
        listen(document.mesh_changed, self._on_mesh_changed)

    def _prepare(self, kind: str, content: object) -> None:
        """Pass on a message of the worker, after computing the geometry of a new mesh."""
        if isinstance(content, JobResult) and isinstance(content.content, MeshReady):
            geometry_of(content.content.mesh)
        self._received.emit(kind, content)

    def _take(self, kind: str, content: Any) -> None:
        getattr(self, f"_on_{kind}")(content)

    def run(self, job: Job) -> None:
        """Run a job now, or after others, and cancel those that it replaces."""
        running = self.running
        self._drop(job.replaces)
        self._waiting.append(job)
        if running is None:
            self._start_next()
        elif job.replaces(running):
            self.worker.cancel()
        elif Queueing.COMPLETE in (job.queueing, running.queueing):
            self._document.notices.say(f"{job.label} waits for: {running.label}.")

    def cancel(self) -> None:
        """Cancel the running job, and drop the waiting jobs."""
        self._drop(lambda _: True)
        self.worker.cancel()

    def _drop(self, is_dropped: Callable[[Job], bool]) -> None:
        """Drop waiting jobs."""
        dropped = [job for job in self._waiting if is_dropped(job)]
        self._waiting[:] = [job for job in self._waiting if job not in dropped]
        for job in dropped:
            job.then(job)

    def _start_next(self) -> None:
        self._drop(lambda job: not job.needed())
        if self._waiting and self.running is None:
            self.running = self._waiting.pop(0)
            self._document.work.started(self.running)
            self.worker.submit(self.running)

    def _end(self, notice: Notice | None = None, whole: bool = False) -> None:
        self.running = None
        self._document.maps.end_growing(whole)
        self._document.work.ended()
        if notice is not None:
            self._document.notices.show(notice)
        self._start_next()

    def _on_mesh_changed(self) -> None:
        """Cancel the job if its mesh is no longer displayed, for example after an undo."""
        if self.running is not None and not self.running.needed():
            self.worker.cancel()

    def _on_progressed(self, progress: Progress) -> None:
        self._document.work.progressed(progress)

    def _on_sent(self, part: object) -> None:
        if self.running is not None and self.running.needed():
            self.running.receive(part)

    def _on_finished(self, result: JobResult) -> None:
        assert self.running is not None
        try:
            self.running.take(result.content)
        except Exception:
            self._end()  # the job has ended, although a listener has failed
            raise
        severity = Severity.WARNING if result.warns else Severity.INFORMATION
        if result.path is not None:
            self._end(saved_notice(self._document, result.remark, result.path, severity), True)
        else:
            self._end(Notice(result.remark, severity) if result.remark else None)

    def _on_failed(self, failure: Failure) -> None:
        assert self.running is not None
        self._end(self.running.failed(failure))

    def _on_cancelled(self, _: None) -> None:
        job = self.running
        assert job is not None
        replaced = any(other.replaces(job) for other in self._waiting)
        self._end(None if replaced else Notice(job.cancelled() or f"Cancelled: {job.label}."))
