"""Background work of a window: jobs, and file access."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PySide6.QtCore import QObject, Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from meshmash_viewer.app.executor import Slot
from meshmash_viewer.app.listening import listen, receive, stop_listening
from meshmash_viewer.app.view.camera import geometry_of
from meshmash_viewer.model.classes import ClassesJob, Classified
from meshmash_viewer.model.decomposition import is_worthwhile
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import ExportJob, PinExportJob
from meshmash_viewer.model.jobs import (
    DecomposeJob,
    PartJob,
    PreviewJob,
    ReadJob,
    RegionsJob,
    ResolutionJob,
)
from meshmash_viewer.model.notices import Failure, Notice, Severity, failure_of, notice_of
from meshmash_viewer.model.open_mesh import MapGrew, MeshReady, PartReady, RegionsReady, Written
from meshmash_viewer.model.pieces import PiecesJob
from meshmash_viewer.model.worker import Worker
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import VertexMap
from meshmash_viewer.work import Job

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


#: Jobs that wait for the running job, and that are completed before another job starts.
_EXPORTS = ExportJob, PinExportJob, RegionsJob


class Tasks(QObject):
    """Queue that runs the jobs of a document, one at a time.

    A job that reads another mesh, or computes another decomposition, cancels the running job and
    is run next; pairs that have converged are stored already. An export is queued, and other jobs
    wait for a running export.
    """

    _received = Signal(str, object)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        #: The running job.
        self.job: Job | None = None
        self._queue: list[Job] = []
        self._received.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self.worker = Worker(self._prepare)
        receive(document.work.requested, self.run)
        listen(document.work.cancel_requested, self.cancel)
        listen(document.mesh_changed, self._on_mesh_changed)

    def _prepare(self, kind: str, content: object) -> None:
        """Pass on a message of the worker, after computing the geometry of a new mesh."""
        if isinstance(content, MeshReady):
            geometry_of(content.mesh)
        self._received.emit(kind, content)

    def _take(self, kind: str, content: Any) -> None:
        getattr(self, f"_on_{kind}")(content)

    def run(self, job: Job) -> None:
        """Run a job now, or add it to the queue."""
        if self.job is None and self._queue:
            self._queue.append(job)  # the next job is about to be started
        elif self.job is None:
            self._start(job)
        elif isinstance(job, DecomposeJob) and isinstance(self.job, PreviewJob | ClassesJob):
            # the running job ends within seconds; of several requests, only the last is kept
            self._queue = [other for other in self._queue if not isinstance(other, DecomposeJob)]
            self._queue.insert(0, job)
        elif isinstance(job, ClassesJob) and not isinstance(self.job, ClassesJob):
            self._queue = [other for other in self._queue if not isinstance(other, ClassesJob)]
            self._queue.append(job)
        elif isinstance(job, _EXPORTS) or isinstance(self.job, _EXPORTS):
            self._queue.append(job)
            self._document.notices.say(f"{job.label} waits for: {self.job.label}.")
        elif isinstance(job, DecomposeJob) and not isinstance(self.job, DecomposeJob):
            text, running = f"{self.job.label} is not done yet: compute when it is.", self.job
            self._document.notices.show(
                Notice(text, Severity.WARNING, holds=lambda: self.job is running)
            )
        else:
            self._queue = [waiting for waiting in self._queue if isinstance(waiting, _EXPORTS)]
            self._queue.insert(0, job)
            self.worker.cancel()

    def cancel(self) -> None:
        """Cancel the running job, and drop the waiting jobs."""
        self._queue.clear()
        self.worker.cancel()

    def close(self) -> None:
        """Stop all jobs, end their processes and delete their temporary files."""
        stop_listening(self)
        self._queue.clear()
        self.worker.close()

    def _start(self, job: Job) -> None:
        self.job = job
        document = self._document
        document.work.started(job, document.solve.expected_of(job))
        self.worker.submit(job)

    def _end(self, notice: Notice | None = None, whole: bool = False) -> None:
        self.job = None
        self._document.maps.end_growing(whole)
        self._document.work.ended()
        if notice is not None:
            self._document.notices.show(notice)
        if self._queue and self.job is None:
            self._start(self._queue.pop(0))

    def _on_mesh_changed(self) -> None:
        """Cancel the job if its mesh is no longer displayed, for example after an undo."""
        job, document = self.job, self._document
        if isinstance(job, DecomposeJob | PreviewJob | ClassesJob | ResolutionJob):
            stale = not document.is_solved(job.mesh)
        else:
            stale = isinstance(job, PiecesJob) and not document.is_shown(job.mesh)
        if stale:
            self.worker.cancel()

    def _on_progressed(self, progress: Progress) -> None:
        self._document.work.progressed(progress)

    def _on_sent(self, message: object) -> None:
        job = self.job
        if isinstance(message, MapGrew) and isinstance(job, PiecesJob):
            self._document.maps.grow(job.mesh, message)
        elif isinstance(job, DecomposeJob | PreviewJob) and self._document.is_solved(job.mesh):
            if isinstance(message, Eigenpairs):
                self._document.accept_spectrum(message)
            elif isinstance(message, str):
                self._document.notices.say(message, Severity.WARNING)

    def _on_finished(self, result: object) -> None:
        try:
            notice, whole = self._accept(result)
        except Exception:
            self._end()  # the job has ended, although a listener has failed
            raise
        self._end(notice, whole)

    def _accept(self, result: object) -> tuple[Notice | None, bool]:
        """Store the result of a job; return a notice, and whether maps in pieces are complete."""
        if isinstance(result, MeshReady):
            self._document.accept_mesh(result)
            if is_worthwhile(result):
                self._queue.append(PreviewJob(result.mesh, self._document.solve.operator))
        elif isinstance(result, PartReady):
            if isinstance(self.job, PartJob) and self._document.is_shown(self.job.mesh):
                self._document.accept_part(result)
        elif isinstance(result, RegionsReady) and isinstance(self.job, RegionsJob):
            self._document.labels.accept_regions(self.job, result)
        elif isinstance(result, Written):
            written = f"{result.description} written to {result.path}."
            if result.remark:
                written += f" {result.remark}."
            warns = bool(result.remark) and result.warns
            severity = Severity.WARNING if warns else Severity.INFORMATION
            return saved_notice(self._document, written, result.path, severity), True
        elif isinstance(result, np.ndarray) and isinstance(self.job, ResolutionJob):
            if self._document.is_solved(self.job.mesh):
                self._document.accept_errors(result)
            return None, False
        elif isinstance(result, Classified) and isinstance(self.job, ClassesJob):
            self._document.classes.accept(self.job, result)
            return None, False
        else:
            self._on_sent(result)
            return None, False
        return Notice(result.remark, Severity.WARNING) if result.remark else None, False

    def _on_failed(self, failure: Failure) -> None:
        if isinstance(self.job, ReadJob) and self._document.following:
            names = ", ".join(path.name for path in self._document.following)
            failure = replace(failure, text=f"{failure.text} Not opened either: {names}.")
        notice, job = notice_of(failure), self.job
        if isinstance(job, PiecesJob) and failure.code == "seams-differ":
            accepted = partial(self._document.work.request, replace(job, accept_seams=True))
            notice = replace(notice, action=accepted, button="Accept the seams")
        self._end(notice)

    def _on_cancelled(self, _: None) -> None:
        job, spectrum = self.job, self._document.spectrum
        if self._queue or job is None:  # another job replaces this one
            self._end()
        elif not isinstance(job, DecomposeJob):
            self._end(Notice(f"Cancelled: {job.label}."))
        elif spectrum is None or not len(spectrum.exact):
            self._end(Notice("Cancelled before any eigenpair converged."))
        else:
            kept = counted(len(spectrum.exact), "eigenpair")
            self._end(Notice(f"Cancelled; {kept} that converged before are kept."))
