"""Background work of a window: jobs, and file access."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from PySide6.QtCore import QObject, Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen, receive, stop_listening
from meshmash_viewer.app.view.camera import geometry_of
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.jobs import Task
from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of, notice_of
from meshmash_viewer.model.open_mesh import MeshReady
from meshmash_viewer.model.pieces import PiecesJob
from meshmash_viewer.model.worker import Worker
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import JobResult, Queueing

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


class Tasks(QObject):
    """Queue that runs the jobs of a document, one at a time, as each says (`Job.queueing`)."""

    _received = Signal(str, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        #: The running job.
        self.task: Task | None = None
        self._queue: list[Task] = []
        self._received.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self.worker = Worker(self._prepare)
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

    def run(self, task: Task) -> None:
        """Run a job now, or add it to the queue."""
        running = self.task
        if running is None:
            self._queue.append(task)
            if len(self._queue) == 1:  # otherwise the next job is about to be started
                self._start_next()
            return
        new, now = task.job.queueing, running.job.queueing
        same = type(task.job) is type(running.job)
        complete, brief, alone = Queueing.COMPLETE, Queueing.BRIEF, Queueing.ALONE
        if not same and (new is brief or (new is alone and now is brief)):
            self._drop(lambda waiting: type(waiting.job) is type(task.job))
            self._queue.append(task)
        elif complete in (new, now):
            self._queue.append(task)
            self._document.notices.say(f"{task.job.label} waits for: {running.job.label}.")
        elif new is alone and not same:
            text = f"{running.job.label} is not done yet: compute when it is."
            self._document.notices.show(
                Notice(text, Severity.WARNING, holds=lambda: self.task is running)
            )
            task.then(task)
        else:
            self._drop(lambda waiting: waiting.job.queueing is not complete)
            self._queue.insert(0, task)
            self.worker.cancel()

    def cancel(self) -> None:
        """Cancel the running job, and drop the waiting jobs."""
        self._drop(lambda _: True)
        self.worker.cancel()

    def close(self) -> None:
        """Stop all jobs, end their processes and delete their temporary files."""
        stop_listening(self)
        self._queue.clear()
        self.worker.close()

    def _drop(self, is_dropped: Callable[[Task], bool]) -> None:
        """Drop waiting jobs."""
        dropped = [task for task in self._queue if is_dropped(task)]
        self._queue = [task for task in self._queue if task not in dropped]
        for task in dropped:
            task.then(task)

    def _start_next(self) -> None:
        if self._queue and self.task is None:
            self.task = self._queue.pop(0)
            self._document.work.started(self.task)
            self.worker.submit(self.task.job)

    def _end(self, notice: Notice | None = None, whole: bool = False) -> None:
        self.task = None
        self._document.maps.end_growing(whole)
        self._document.work.ended()
        if notice is not None:
            self._document.notices.show(notice)
        self._start_next()

    def _on_mesh_changed(self) -> None:
        """Cancel the job if its mesh is no longer displayed, for example after an undo."""
        if self.task is not None and not self.task.needed():
            self.worker.cancel()

    def _on_progressed(self, progress: Progress) -> None:
        self._document.work.progressed(progress)

    def _on_sent(self, part: object) -> None:
        if self.task is not None and self.task.needed():
            self.task.receive(part)

    def _on_finished(self, result: JobResult) -> None:
        assert self.task is not None
        try:
            self.task.take(result.content)
        except Exception:
            self._end()  # the job has ended, although a listener has failed
            raise
        severity = Severity.WARNING if result.warns else Severity.INFORMATION
        if result.path is not None:
            self._end(saved_notice(self._document, result.remark, result.path, severity), True)
        else:
            self._end(Notice(result.remark, severity) if result.remark else None)

    def _on_failed(self, failure: Failure) -> None:
        task = self.task
        lost = "" if task is None else task.lost()
        notice = notice_of(replace(failure, text=failure.text + lost))
        if task is not None and isinstance(task.job, PiecesJob) and failure.code == "seams-differ":
            again = task.again(replace(task.job, accept_seams=True))
            repeat = partial(self._document.work.requested.emit, again)
            notice = replace(notice, action=repeat, button="Accept the seams")
        self._end(notice)

    def _on_cancelled(self, _: None) -> None:
        task = self.task
        if self._queue or task is None:  # another job replaces this one
            self._end()
        else:
            self._end(Notice(task.cancelled() or f"Cancelled: {task.job.label}."))
