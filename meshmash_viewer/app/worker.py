"""Runs jobs in a child process, so that the window stays responsive."""

from __future__ import annotations

import contextlib
import itertools
import queue
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path
from typing import BinaryIO, ClassVar, cast

from PySide6.QtCore import QObject, QTimer, Signal

from meshmash_viewer.app.view.geometry import geometry_of
from meshmash_viewer.io.atomic import remove_abandoned, scratch_prefix
from meshmash_viewer.model.failure import Failure, failure_of
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.process import child_command, child_environment, end_group, run_job
from meshmash_viewer.model.results import MeshReady, SpectrumGrew
from meshmash_viewer.model.transport import Wire

#: Milliseconds after which the process of a cancelled job is killed.
_CANCEL_PATIENCE = 1000
#: Seconds that the processes of a job have to delete their temporary files at closing.
_CLOSE_PATIENCE = 3.0
#: Messages of the process (and signals of the worker) that end a job.
_ENDS = ("finished", "failed", "cancelled")


class Worker(QObject):
    """Runs one job at a time in a child process that is kept running.

    A job ends with exactly one of the signals `finished`, `failed` and `cancelled`, after which the
    next can be submitted. A thread of the worker reads and writes arrays, so that no method blocks.
    """

    #: Whether jobs run in the worker's thread instead of a process, as tests of windows need.
    in_process: ClassVar[bool] = False

    started = Signal(object)
    progressed = Signal(object)
    sent = Signal(object)
    finished = Signal(object)
    failed = Signal(object)
    cancelled = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._folder = Path(tempfile.mkdtemp(prefix=scratch_prefix()))
        self._lock = threading.Lock()  # guards the four below
        self._process: subprocess.Popen[bytes] | None = None
        self._wire: Wire | None = None
        self._closing = self._stop_asked = False
        self._orders: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._numbers = itertools.count(1)
        self._number = 0  # of the running job; 0 while idle
        for kind in _ENDS:
            getattr(self, kind).connect(self._end)
        self._thread = threading.Thread(target=self._serve, name="worker", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        return self._number != 0

    @property
    def process_id(self) -> int | None:
        """Id of the child process; None while there is none."""
        process = self._process
        return process.pid if process is not None else None

    @property
    def folder(self) -> Path:
        """Folder through which arrays are exchanged; removed by `close`."""
        return self._folder

    def submit(self, job: Job) -> None:
        """Start a job.

        Raises
        ------
        RuntimeError
            If a job runs already, or the worker is closed.
        """
        if self.busy or self._closing:
            raise RuntimeError("the worker is busy or closed")
        self._number = next(self._numbers)
        # here and not where the job starts, as it may be cancelled before
        with self._lock:
            self._stop_asked = False
        self.started.emit(job)
        self._orders.put(job)

    def cancel(self) -> None:
        """Ask the running job to stop, and kill its process after a second."""
        if not self.busy:
            return
        number = self._number
        with self._lock:
            self._stop_asked = True
            wire = self._wire
        if wire is not None:
            with contextlib.suppress(OSError, ValueError):  # the process has just ended
                wire.send(("stop", None))
        QTimer.singleShot(_CANCEL_PATIENCE, self, lambda: self._insist(number))

    def close(self) -> None:
        """Stop the running job, and wait until its processes have ended and files are deleted."""
        with self._lock:
            self._closing = True
        self._orders.put(None)
        self._end_process()
        self._thread.join()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _end(self) -> None:
        self._number = 0

    def _insist(self, number: int) -> None:
        if self._number == number:
            self._end_process()

    def _end_process(self) -> None:
        with self._lock:
            if self._process is not None:
                end_group(self._process.pid)

    # -- in the thread ------------------------------------------------------------------------

    def _serve(self) -> None:
        """Start a process, and give it one job after the other."""
        try:
            if not self.in_process:
                with contextlib.suppress(OSError):  # the first job tries again, and says why
                    self._start_process()
                _warm_up()
                remove_abandoned()
            run = self._run_here if self.in_process else self._run
            while (job := self._orders.get()) is not None:
                run(job)
        finally:
            self._drop_process(patience=_CLOSE_PATIENCE)

    def _run_here(self, job: Job) -> None:
        run_job(job, self._emit, lambda: self._stop_asked or self._closing, self.folder)

    def _emit(self, message: tuple[str, object]) -> None:
        kind, content = message
        _open_files(content)
        getattr(self, kind).emit(content)

    def _run(self, job: Job, *, again: bool = True) -> None:
        received = False
        with self._lock:
            stop_asked = self._stop_asked
        if stop_asked:
            self.cancelled.emit(None)
            return
        try:
            wire = self._send(job)
            while True:
                message = cast(tuple[str, object], wire.receive())
                received = True
                self._emit(message)
                if message[0] in _ENDS:
                    return
        except (EOFError, BrokenPipeError):
            with self._lock:
                wanted = not (self._stop_asked or self._closing)
            if again and wanted and not received:
                # it ended while idle, which `poll` has not reported yet
                self._drop_process()
                self._run(job, again=False)
                return
            self._report_end(job)
        except OSError as error:
            text = f"{job.label} stopped: {error.strerror or error}."
            self.failed.emit(Failure(text, repr(error), correctable=True))
        except Exception as error:  # noqa: BLE001  a defect must not end the thread silently
            self._drop_process()
            self.failed.emit(failure_of(error, job.label))

    def _send(self, job: Job) -> Wire:
        """Send a job to the process, which is started if there is none; return the connection."""
        if self._process is None or self._process.poll() is not None:
            self._drop_process()
            self._start_process()
        if self._wire is None:
            raise EOFError
        self._wire.send(("run", job))
        if self._stop_asked:  # sent to the process before the job was
            self._wire.send(("stop", None))
        return self._wire

    def _report_end(self, job: Job) -> None:
        """Report why the process has ended, and start another one."""
        process, folder = self._process, self.folder
        code = process.wait() if process is not None else 0
        details = _tail(folder / "stderr.txt")
        with self._lock:
            stop_asked, closing = self._stop_asked, self._closing
        self._drop_process()
        if stop_asked or closing:
            self.cancelled.emit(None)
        else:
            self.failed.emit(_crash(job, code, details))
        if not closing:
            with contextlib.suppress(OSError):  # the next job tries again, and says why
                self._start_process()

    def _start_process(self) -> None:
        with self._lock:
            if self._closing:
                return
            # messages of libraries must not be printed in the terminal of the window
            with open(self.folder / "stderr.txt", "wb") as errors:
                self._process = subprocess.Popen(
                    child_command(self.folder),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    env=child_environment(),
                    start_new_session=True,
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
            pipes = cast(BinaryIO, self._process.stdout), cast(BinaryIO, self._process.stdin)
            self._wire = Wire(*pipes, self.folder)

    def _drop_process(self, patience: float = 0.5) -> None:
        with self._lock:
            process, self._process = self._process, None
            wire, self._wire = self._wire, None
        if process is None:
            return
        end_group(process.pid, patience)
        process.wait()
        if wire is not None:
            wire.close()


def _open_files(message: object) -> None:
    """Open files and derive geometry that the interface thread would otherwise wait for."""
    if isinstance(message, SpectrumGrew):
        _ = message.spectrum
    elif isinstance(message, MeshReady):
        geometry_of(message.mesh)
        if message.known is not None:
            _ = message.known.spectrum


def _crash(job: Job, code: int, details: str) -> Failure:
    """Describe the end of a process that sent no message."""
    if code == -9:
        text = (
            f"{job.label} was stopped by the system, most likely because memory ran out: "
            "ask for fewer eigenpairs, or close other programs."
        )
    else:
        how = f"signal {-code}" if code < 0 else f"status {code}"
        text = (
            f"{job.label} failed: its process ended with {how}. What had converged is kept; "
            "compute again to go on from there."
        )
    return Failure(text, details)


def _warm_up() -> None:
    """Import modules in this thread, so that the interface thread need not wait for them."""
    from meshmash_viewer.features.filters import bspline_bank
    from meshmash_viewer.model.cost import decomposition_bytes

    decomposition_bytes(1000, 10)
    bspline_bank(0.0, 1.0, 4)([0.0, 0.5])


def _tail(path: Path, size: int = 4000) -> str:
    try:
        return path.read_bytes()[-size:].decode(errors="replace")
    except FileNotFoundError:
        return ""
