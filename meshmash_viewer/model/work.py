"""The job of a document: which are requested, and the one that runs."""

from __future__ import annotations

import time
from dataclasses import replace

from psygnal import Signal

from meshmash_viewer.model.jobs import JobState
from meshmash_viewer.progress import Progress
from meshmash_viewer.work import Job


class Work:
    """The running job of a document.

    Long work is only described here: ``requested`` carries a `Job`, and its runner calls `started`,
    `progressed` and `ended`. ``finished`` carries the last `JobState` of a job that has ended.
    """

    changed = Signal()
    requested = Signal(object)
    cancel_requested = Signal()
    finished = Signal(object)

    def __init__(self) -> None:
        self.job: JobState | None = None

    def request(self, job: Job) -> None:
        """Request that a job runs, such as an export."""
        self.requested.emit(job)

    def cancel(self) -> None:
        """Ask the running job to stop."""
        if self.job is not None:
            self.job = replace(self.job, cancelling=True)
            self.changed.emit()
            self.cancel_requested.emit()

    def started(self, job: Job, expected: float | None = None) -> None:
        """Record that a job runs now, and the seconds that it is expected to take."""
        self.job = JobState(job, Progress("starting"), began=time.monotonic(), expected=expected)
        self.changed.emit()

    def progressed(self, progress: Progress) -> None:
        """Record the progress of the job."""
        if self.job is not None:
            self.job = self.job.progressed(progress)
            self.changed.emit()

    def ended(self) -> None:
        """Record the end of the job."""
        job, self.job = self.job, None
        self.changed.emit()
        if job is not None:
            self.finished.emit(job)
