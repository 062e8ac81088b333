"""The process that does long work: it takes jobs from a pipe, one at a time.

The window starts it with `child_command` and keeps it warm. It leads a process group of its own,
so that it ends together with whatever processes the solver has started: when told to, and when
the window's end of the pipe closes for any reason, a crash of the window included.
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
from pathlib import Path
from typing import cast

import numpy as np

from meshmash_viewer.io.process_tree import ProcessTree
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.failure import failure_of
from meshmash_viewer.model.jobs import Channel, Job
from meshmash_viewer.model.transport import Wire
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.engine.blas_threads import limit_accelerate

__all__ = ["child_command", "child_environment", "end_group", "serve"]

#: Seconds between two reports; a person reads no faster.
_REPORT_SECONDS = 0.05


def child_command(folder: Path) -> list[str]:
    """Command line that starts the process; `folder` is where arrays pass through."""
    code = (
        "import sys; sys.path[:] = sys.argv[2:]; "
        "from meshmash_viewer.model.process import serve; serve(sys.argv[1])"
    )
    return [sys.executable, "-c", code, str(folder), *sys.path]


def child_environment() -> dict[str, str]:
    """Variables that the process starts with."""
    environment = dict(os.environ)
    limit_accelerate(environment)
    return environment


def serve(folder: str) -> None:
    """Run jobs until the pipe on standard input closes; then end, with all descendants."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C in the terminal is the window's
    _lower_priority()
    # The pipe moves to descriptors of its own: a stray print must not end up in it, and
    # processes of the solver must not inherit it.
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
    # While a first mesh is read, or nothing is asked for; whoever needs it sooner waits for it.
    threading.Thread(target=_warm_up_solver, daemon=True).start()
    while True:
        channel = _PipeChannel(wire, asked_to_stop, Path(folder))
        _run(jobs.get(), channel, wire)


def _listen(
    wire: Wire, jobs: queue.SimpleQueue[Job], asked_to_stop: threading.Event, folder: str
) -> None:
    """Take orders while the main thread works."""
    try:
        while True:
            order, job = cast(tuple[str, Job], wire.receive())
            if order == "run":
                asked_to_stop.clear()
                jobs.put(job)
            else:
                asked_to_stop.set()
    except (EOFError, OSError):
        # The window is gone, maybe without a chance to tidy up.
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        end_group(os.getpid())
        os._exit(0)


def _run(job: Job, channel: Channel, wire: Wire) -> None:
    """Do a job and send how it ended."""
    message: tuple[str, object]
    try:
        wire.send(("finished", job.run(channel)))
        return
    except Cancelled:
        message = ("cancelled", None)
    except Exception as error:  # noqa: BLE001  whatever it is, the window must hear of it
        message = ("failed", failure_of(error, job.label))
    wire.send(message)


class _PipeChannel:
    """A `Channel` into the pipe; reports are thinned to what a person can read."""

    def __init__(self, wire: Wire, asked_to_stop: threading.Event, folder: Path) -> None:
        self.folder = folder
        self._wire = wire
        self._asked_to_stop = asked_to_stop
        self._reported = -_REPORT_SECONDS
        self._stage = ""

    def report(self, progress: Progress) -> None:
        now = time.monotonic()
        if progress.stage == self._stage and now - self._reported < _REPORT_SECONDS:
            return
        self._reported, self._stage = now, progress.stage
        self._wire.send(("progressed", progress))

    def send(self, message: object) -> None:
        self._wire.send(("sent", message))

    def cancelled(self) -> bool:
        return self._asked_to_stop.is_set()


def end_group(leader: int, patience: float = 0.0) -> None:
    """End a process that leads a group, with its descendants.

    They are asked with SIGTERM, which nothing here handles, so it is certain and immediate; only
    multiprocessing's resource trackers ignore it, to delete temporary files and then leave.
    `patience` is how many seconds descendants have to clean up, before they are killed.
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
    """Whether a process of the group still does anything (a zombie does not)."""
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
    """Leave the processor to the window first, and be ended first when memory runs out."""
    if sys.platform == "win32":
        import psutil

        with contextlib.suppress(psutil.Error):
            psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    else:
        os.nice(5)
    with contextlib.suppress(OSError):  # other systems have no such file
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")


def _warm_up() -> None:
    """Import what every job needs before the first one is asked for.

    All of it here: packages whose modules need each other (joblib, numba) fail in one of two
    threads that import them at once.
    """
    import joblib  # noqa: F401
    import scipy.sparse.linalg  # noqa: F401

    import meshmash_viewer.health
    import meshmash_viewer.io.read
    import meshmash_viewer.model.decomposition
    import meshmash_viewer.spectral.engine.multifrontal
    import meshmash_viewer.spectral.preview  # noqa: F401


def _warm_up_solver() -> None:
    """Solve and preview something small, which loads compiled kernels: a second otherwise."""
    from meshmash_viewer.laplacian import cotangent_laplacian
    from meshmash_viewer.spectral.eigensolver import solve
    from meshmash_viewer.spectral.preview import preview_eigenpairs

    x, y = np.indices((50, 50)).reshape(2, -1)
    first = np.arange(2500).reshape(50, 50)[:-1, :-1].ravel()
    faces = np.concatenate([first[:, None] + corners for corners in ([0, 50, 1], [1, 50, 51])])
    grid = Mesh(np.stack([x, y, 0 * x], axis=1), faces)
    solve(*cotangent_laplacian(grid), 30, n_jobs=1)
    preview_eigenpairs(grid, 3)
