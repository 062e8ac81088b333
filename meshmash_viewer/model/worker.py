"""Worker process that runs the jobs of a window, so that the window stays responsive.

`Worker` runs in the window, `serve` in the worker process. The worker process leads a process
group, so that all processes of the solver end with it: on request, and when the pipe is closed,
for example by a crash of the window.
"""

from __future__ import annotations

import contextlib
import faulthandler
import itertools
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, ClassVar, TypeAlias

import numpy as np

from meshmash_viewer.features.filters import bspline_bank
from meshmash_viewer.io.atomic import remove_abandoned, scratch_prefix
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.notices import Failure, failure_of
from meshmash_viewer.progress import CancelCallback, Cancelled, Progress
from meshmash_viewer.spectral.cost import decomposition_bytes
from meshmash_viewer.work import Channel, Child, JobResult, Wire, end_group

#: Function called with the kind of a message and its content: "progressed" with a `Progress`,
#: "sent" with a partial result, and at the end "finished" with the result, "failed" with a
#: `Failure`, or "cancelled" with None.
Receiver: TypeAlias = Callable[[str, Any], None]

#: The label and the function of a job.
_Given: TypeAlias = tuple[str, Callable[[Channel], JobResult]]
_ENDS = ("finished", "failed", "cancelled")
#: Seconds after which the process of a cancelled job is killed.
_CANCEL_PATIENCE = 1.0
#: Seconds to wait for processes to delete their temporary files, when closing and after a crash.
_CLOSE_PATIENCE, _CRASH_PATIENCE = 3.0, 0.5
#: Seconds between two progress reports of a stage.
_REPORT_SECONDS = 0.05


@dataclass(frozen=True, eq=False)
class _Order:
    """A submitted job."""

    number: int
    #: The label and the function of the job.
    given: _Given
    stopped: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)
    answered: threading.Event = field(default_factory=threading.Event)


class Worker:
    """Runner of one job at a time in a child process that is kept running.

    No method but `close` blocks: a thread exchanges the messages, and calls `receive`.
    """

    #: Whether jobs run in the worker's thread instead of a process, for tests of windows.
    in_process: ClassVar[bool] = False

    def __init__(self, receive: Receiver) -> None:
        self._receive = receive
        #: Folder for previews and spare eigenpairs; removed by `close`.
        self.folder = Path(tempfile.mkdtemp(prefix=scratch_prefix()))
        # messages printed by libraries do not belong in the terminal
        self._child = Child(serve, str(self.folder), errors=self.folder / "stderr.txt")
        self._numbers = itertools.count(1)
        self._order: _Order | None = None
        self._orders: queue.SimpleQueue[_Order | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name="worker", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        return self._order is not None and not self._order.ended.is_set()

    @property
    def process_id(self) -> int | None:
        """Id of the child process; None while there is none."""
        process = self._child.process
        return process.pid if process is not None else None

    def submit(self, job: Job) -> None:
        """Start a job.

        `RuntimeError` is raised if a job runs already, or the worker is closed.
        """
        if self.busy or self._child.closed:
            raise RuntimeError("the worker is busy or closed")
        self._order = _Order(next(self._numbers), (job.label, job.work))
        self._orders.put(self._order)

    def cancel(self) -> None:
        """Request the running job to stop, and kill its process after a second."""
        order = self._order
        if order is None or order.ended.is_set():
            return
        order.stopped.set()
        for wait, act in ((0.0, self._ask_to_stop), (_CANCEL_PATIENCE, self._insist)):
            timer = threading.Timer(wait, act, (order,))
            timer.daemon = True
            timer.start()

    def _ask_to_stop(self, order: _Order) -> None:
        self._child.send((order.number, None))

    def _insist(self, order: _Order) -> None:
        if not order.ended.is_set():
            self._child.kill()

    def close(self) -> None:
        """Stop the running job, and wait until its processes have ended and files are deleted."""
        self._orders.put(None)
        self._child.close(_CLOSE_PATIENCE)
        self._thread.join()
        shutil.rmtree(self.folder, ignore_errors=True)

    # -- in the thread ------------------------------------------------------------------------

    def _serve(self) -> None:
        """Start a process, and run submitted jobs in it one after the other."""
        if not self.in_process:
            with contextlib.suppress(OSError, Cancelled):  # the first job reports the error
                self._child.connect()
            _import_libraries()
            remove_abandoned()
        while (order := self._orders.get()) is not None:
            self._run(order)

    def _run(self, order: _Order, *, again: bool = True) -> None:
        """Run a job, and report its end.

        If the process ends without any message, it may have ended while it was idle, which `poll`
        reports with a delay; the job is then retried once in another process.
        """
        receive = partial(self._deliver, order)
        if self._is_stopped(order):
            receive("cancelled", None)
        elif self.in_process:
            run_job(*order.given, receive, partial(self._is_stopped, order), self.folder)
        else:
            try:
                self._exchange(order)
            except Cancelled:
                receive("cancelled", None)
            except (EOFError, BrokenPipeError):
                failure = self._replace_process(order.given[0])
                if self._is_stopped(order):
                    receive("cancelled", None)
                elif again and not order.answered.is_set():
                    self._run(order, again=False)
                else:
                    receive("failed", failure)
            except OSError as error:
                text = f"{order.given[0]} stopped: {error.strerror or error}."
                receive("failed", Failure(text, repr(error), correctable=True))
            except Exception as error:  # noqa: BLE001  a defect must not end the thread silently
                self._child.end(_CRASH_PATIENCE)
                receive("failed", failure_of(error, order.given[0]))

    def _is_stopped(self, order: _Order) -> bool:
        return order.stopped.is_set() or self._child.closed

    def _deliver(self, order: _Order, kind: str, content: Any) -> None:
        order.answered.set()
        if kind in _ENDS:
            order.ended.set()  # set before the receiver submits the next job
        self._receive(kind, content)

    def _exchange(self, order: _Order) -> None:
        """Send a job to the process, and deliver its messages."""
        wire = self._child.connect()
        wire.send((order.number, order.given))
        if order.stopped.is_set():  # stopped before the process was connected
            wire.send((order.number, None))
        while not order.ended.is_set():
            self._deliver(order, *wire.receive())

    def _replace_process(self, label: str) -> Failure:
        """Start another process, and return the reason why the previous process ended."""
        code, process = 0, self._child.process
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):  # `Child.end` ends it
                code = process.wait(_CLOSE_PATIENCE)
        errors = self.folder / "stderr.txt"
        details = errors.read_bytes()[-4000:].decode(errors="replace") if errors.exists() else ""
        self._child.end(_CRASH_PATIENCE)
        with contextlib.suppress(OSError, Cancelled):  # the next job reports the error
            self._child.connect()
        if code == -9:
            text = (
                f"{label} was stopped by the system, most likely because memory ran out: "
                "ask for fewer eigenpairs, or close other programs."
            )
        else:
            how = f"signal {-code}" if code < 0 else f"status {code}"
            text = (
                f"{label} failed: its process ended with {how}. Converged eigenpairs are kept; "
                "compute again to continue."
            )
        return Failure(text, details)


def _import_libraries() -> None:
    """Import modules in this thread, so that the interface thread need not wait for them."""
    decomposition_bytes(1000, 10)
    bspline_bank(0.0, 1.0, 4)([0.0, 0.5])


# -- in the process -----------------------------------------------------------------------------


def serve(source: BinaryIO, sink: BinaryIO, folder: str) -> None:
    """Run jobs until the pipe is closed; then end this process and its descendants."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is handled by the window
    _lower_priority()
    wire = Wire(source, sink)
    jobs: queue.SimpleQueue[tuple[int, _Given]] = queue.SimpleQueue()
    stopped: set[int] = set()
    threading.Thread(target=_listen, args=(wire, jobs, stopped, folder), daemon=True).start()
    _warm_up()
    # in parallel to the first job; a job that needs the solver waits for it
    threading.Thread(target=_warm_up_solver, daemon=True).start()

    def receive(kind: str, content: Any) -> None:
        wire.send((kind, content))

    while True:
        number, given = jobs.get()
        run_job(*given, receive, partial(stopped.__contains__, number), Path(folder))


def _listen(
    wire: Wire, jobs: queue.SimpleQueue[tuple[int, _Given]], stopped: set[int], folder: str
) -> None:
    """Receive jobs, and numbers of jobs to stop, while the main thread works."""
    try:
        while True:
            number, given = wire.receive()
            if given is None:
                stopped.add(number)
            else:
                jobs.put((number, given))
    except (EOFError, OSError):
        # the window has ended, possibly without deleting the folder
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        end_group(os.getpid())
        os._exit(0)


def run_job(
    label: str,
    work: Callable[[Channel], JobResult],
    receive: Receiver,
    cancelled: CancelCallback,
    folder: Path,
) -> None:
    """Run a job, and pass its messages and its end to a receiver."""
    try:
        receive("finished", work(_JobChannel(receive, cancelled, folder)))
    except Cancelled:
        receive("cancelled", None)
    except Exception as error:  # noqa: BLE001  the window reports it
        receive("failed", failure_of(error, label))


class _JobChannel:
    """A `Channel` with at most one progress report per `_REPORT_SECONDS` and stage."""

    def __init__(self, receive: Receiver, cancelled: CancelCallback, folder: Path) -> None:
        self.folder, self.cancelled = folder, cancelled
        self._receive = receive
        self._reported, self._stage = -_REPORT_SECONDS, ""

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if progress.stage == self._stage and now - self._reported < _REPORT_SECONDS:
            return
        self._reported, self._stage = now, progress.stage
        self._receive("progressed", progress)

    def send(self, message: object) -> None:
        self._receive("sent", message)


def _lower_priority() -> None:
    """Lower the priority, and let the system kill this process first if memory runs out."""
    if sys.platform == "win32":
        import psutil

        with contextlib.suppress(psutil.Error):
            psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    else:
        os.nice(5)
    with contextlib.suppress(OSError):  # other systems have no such file
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")


def _warm_up() -> None:
    """Import the modules that every job needs, in one thread.

    Packages with circular imports (joblib, numba) can fail if two threads import them at once.
    """
    import joblib  # noqa: F401
    import scipy.sparse.linalg  # noqa: F401

    import meshmash_viewer.health
    import meshmash_viewer.io.read
    import meshmash_viewer.model.decomposition
    import meshmash_viewer.spectral.engine.multifrontal
    import meshmash_viewer.spectral.preview  # noqa: F401


def _warm_up_solver() -> None:
    """Solve and preview a small mesh, which loads the compiled kernels and takes a second."""
    from meshmash_viewer.laplacian import cotangent_laplacian
    from meshmash_viewer.spectral.eigensolver import solve
    from meshmash_viewer.spectral.preview import preview_eigenpairs
    from meshmash_viewer.spectral.resolution import quick_error

    x, y = np.indices((50, 50)).reshape(2, -1)
    first = np.arange(2500).reshape(50, 50)[:-1, :-1].ravel()
    faces = np.concatenate([first[:, None] + corners for corners in ([0, 50, 1], [1, 50, 51])])
    grid = Mesh(np.stack([x, y, 0 * x], axis=1), faces)
    quick_error(grid, solve(*cotangent_laplacian(grid), 30, n_jobs=1))
    preview_eigenpairs(grid, 3)
