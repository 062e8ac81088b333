"""Runs the jobs that a document requests, and passes their results to it."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, Qt, Signal

from meshmash_viewer.app.background import saved_notice
from meshmash_viewer.app.listening import listen, stop_listening
from meshmash_viewer.app.view.camera import geometry_of
from meshmash_viewer.model.classes import ClassesJob, Classified
from meshmash_viewer.model.decomposition import is_worthwhile
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import ExportJob, PinExportJob
from meshmash_viewer.model.jobs import DecomposeJob, PartJob, PreviewJob, RegionsJob
from meshmash_viewer.model.notices import Failure, Notice, Severity, notice_of
from meshmash_viewer.model.open_mesh import MapGrew, MeshReady, PartReady, RegionsReady, Written
from meshmash_viewer.model.pieces import PiecesJob
from meshmash_viewer.model.worker import Worker
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import counted
from meshmash_viewer.work import Job

#: Jobs that wait for others, and for which others wait.
_EXPORTS = ExportJob, PinExportJob, RegionsJob


class Tasks(QObject):
    """The one job of a document.

    A job that brings another mesh, or another decomposition, stops the one that runs and goes
    next: converged pairs are in the store, so nothing is lost. An export waits its turn, and
    while one is being written the others wait for it.
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
        document.work.requested.connect(self.run)
        listen(document.work.cancel_requested, self.cancel)
        listen(document.mesh_changed, self._on_mesh_changed)

    def _prepare(self, kind: str, content: object) -> None:
        """Derive geometry in the worker's thread, then pass a message on."""
        if isinstance(content, MeshReady):
            geometry_of(content.mesh)
        self._received.emit(kind, content)

    def _take(self, kind: str, content: Any) -> None:
        getattr(self, f"_on_{kind}")(content)

    def run(self, job: Job) -> None:
        """Run a job now, or after the running one."""
        if self.job is None and self._queue:
            self._queue.append(job)  # between two jobs, as after the preview of a repaired mesh
        elif self.job is None:
            self._start(job)
        elif isinstance(job, DecomposeJob) and isinstance(self.job, PreviewJob | ClassesJob):
            # these end within seconds and are used; two requests for one job run it once
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
        """Cancel the running job, and drop the waiting ones."""
        self._queue.clear()
        self.worker.cancel()

    def close(self) -> None:
        """Stop everything; no process and no temporary file remains."""
        self._document.work.requested.disconnect(self.run)
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
        """Stop a job on a mesh that is no longer shown, as after an undo."""
        job, document = self.job, self._document
        if isinstance(job, DecomposeJob | PreviewJob | ClassesJob):
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
            self._end()  # a listener failed: the job is over nevertheless
            raise
        self._end(notice, whole)

    def _accept(self, result: object) -> tuple[Notice | None, bool]:
        """Take the result of a job; return what to say, and whether growing maps are whole."""
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
        elif isinstance(result, Classified) and isinstance(self.job, ClassesJob):
            self._document.classes.accept(self.job, result)
            return None, False
        else:
            self._on_sent(result)
            return None, False
        return Notice(result.remark, Severity.WARNING) if result.remark else None, False

    def _on_failed(self, failure: Failure) -> None:
        self._end(notice_of(failure))

    def _on_cancelled(self, _: None) -> None:
        job = self.job
        replaced = bool(self._queue)
        if replaced or job is None:
            self._end()
        elif isinstance(job, DecomposeJob):
            spectrum = self._document.spectrum
            known = 0 if spectrum is None else len(spectrum.exact)
            kept = f"; {counted(known, 'eigenpair')} that converged before stay" if known else ""
            self._end(Notice(f"Cancelled{kept or ' before an eigenpair had converged'}."))
        else:
            self._end(Notice(f"Cancelled: {job.label}."))
