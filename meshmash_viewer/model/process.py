"""Worker process: takes jobs from a pipe, one at a time.

The window starts it with `child_command` and keeps it running. It leads its own process group, so
that it ends together with all processes of the solver: on request, and when the window's end of
the pipe closes for any reason, including a crash of the window.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import queue
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np

from meshmash_viewer.io.process_tree import ProcessTree
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.jobs import Job
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.progress import CancelCallback, Cancelled, Progress
from meshmash_viewer.spectral.engine.blas_threads import limit_accelerate

#: Seconds between two progress reports.
_REPORT_SECONDS = 0.05


def child_command(folder: Path) -> list[str]:
    """Return the command line of the process; large arrays are exchanged through `folder`."""
    code = (
        "import sys; sys.path[:] = sys.argv[2:]; "
        "from meshmash_viewer.model.process import serve; serve(sys.argv[1])"
    )
    return [sys.executable, "-c", code, str(folder), *sys.path]


def child_environment() -> dict[str, str]:
    """Return the environment variables of the process."""
    environment = dict(os.environ)
    limit_accelerate(environment)
    return environment


def serve(folder: str) -> None:
    """Run jobs until the pipe on standard input closes; then end, with all descendants."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is handled by the window
    _lower_priority()
    # The pipe gets its own descriptors: a stray print must not be written to it, and processes of
    # the solver must not inherit it.
    source = os.fdopen(os.dup(0), "rb")
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    wire = Wire(source, sink, Path(folder))
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    asked_to_stop = threading.Event()
    listener = threading.Thread(
        target=_listen, args=(wire, jobs, asked_to_stop, folder), daemon=True
    )
    listener.start()
    _warm_up()
    # while a first mesh is read, or before the first job; a job that needs the solver waits for it
    threading.Thread(target=_warm_up_solver, daemon=True).start()
    while True:
        run_job(jobs.get(), wire.send, asked_to_stop.is_set, Path(folder))


def _listen(
    wire: Wire, jobs: queue.SimpleQueue[Job], asked_to_stop: threading.Event, folder: str
) -> None:
    """Receive orders while the main thread works."""
    try:
        while True:
            order, job = cast(tuple[str, Job], wire.receive())
            if order == "run":
                asked_to_stop.clear()
                jobs.put(job)
            else:
                asked_to_stop.set()
    except (EOFError, OSError):
        # the window has ended, possibly without deleting the folder
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        end_group(os.getpid())
        os._exit(0)


def run_job(
    job: Job, send: Callable[[tuple[str, object]], None], cancelled: CancelCallback, folder: Path
) -> None:
    """Do a job, and send what it reports and how it ended, as kind and content."""
    message: tuple[str, object]
    try:
        send(("finished", job.run(_JobChannel(send, cancelled, folder))))
        return
    except Cancelled:
        message = ("cancelled", None)
    except Exception as error:  # noqa: BLE001  the window reports it
        message = ("failed", failure_of(error, job.label))
    send(message)


class _JobChannel:
    """A `Channel` with at most one progress report per `_REPORT_SECONDS` and stage."""

    def __init__(
        self,
        send: Callable[[tuple[str, object]], None],
        cancelled: CancelCallback,
        folder: Path,
    ) -> None:
        self.folder, self.cancelled = folder, cancelled
        self._send = send
        self._reported = -_REPORT_SECONDS
        self._stage = ""

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if progress.stage == self._stage and now - self._reported < _REPORT_SECONDS:
            return
        self._reported, self._stage = now, progress.stage
        self._send(("progressed", progress))

    def send(self, message: object) -> None:
        self._send(("sent", message))


def end_group(leader: int, patience: float = 0.0) -> None:
    """End the leader of a process group, with its descendants.

    They get SIGTERM, which ends them at once; only the resource trackers of multiprocessing ignore
    it, delete temporary files and then exit. Descendants are killed after `patience` seconds.
    Windows has neither groups nor SIGTERM: all but such trackers are killed there.
    """
    if sys.platform == "win32":
        ProcessTree(leader).end(patience)
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, signal.SIGTERM)
        deadline = time.monotonic() + patience
        while patience and _lives(leader):
            if time.monotonic() > deadline:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(leader, signal.SIGKILL)
                return
            time.sleep(0.01)


def _lives(leader: int) -> bool:
    """Whether a process of the group is alive and not a zombie."""
    if sys.platform != "win32":
        import psutil

        try:
            os.killpg(leader, 0)
        except ProcessLookupError:
            return False
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error, ProcessLookupError):
                if os.getpgid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                    return True
    return False


def _lower_priority() -> None:
    """Lower the priority, and mark the process as the first to be killed without memory."""
    if sys.platform == "win32":
        import psutil

        with contextlib.suppress(psutil.Error):
            psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    else:
        os.nice(5)
    with contextlib.suppress(OSError):  # other systems have no such file
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")


def _warm_up() -> None:
    """Import the modules that every job needs.

    In one thread: packages with circular imports (joblib, numba) can fail when two threads import
    them at once.
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

    x, y = np.indices((50, 50)).reshape(2, -1)
    first = np.arange(2500).reshape(50, 50)[:-1, :-1].ravel()
    faces = np.concatenate([first[:, None] + corners for corners in ([0, 50, 1], [1, 50, 51])])
    grid = Mesh(np.stack([x, y, 0 * x], axis=1), faces)
    solve(*cotangent_laplacian(grid), 30, n_jobs=1)
    preview_eigenpairs(grid, 3)
