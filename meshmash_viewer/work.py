"""Work in other processes: how they start, what they exchange, and how they end.

A child is an interpreter that calls one function of the package. It gets two pipes, which a stray
print or the processes that it starts cannot use: standard output goes to standard error.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar, cast

from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.engine.compiler import limit_accelerate

if TYPE_CHECKING:
    import psutil


Result = TypeVar("Result")

# the child imports this package from where its parent did
_CHILD = """
import json, sys
sys.path[:], *given = json.loads(sys.argv[1])
from meshmash_viewer.work import run_child
run_child(*given)
"""
#: Seconds until `call_in_child` looks at the child for the first time, and between the next ones.
_START, _LOOK = 0.2, 0.02
#: Exit status of a child without memory for its answer.
_NO_MEMORY = 65
#: Seconds between two searches for new processes, which read the table of all processes.
_SEARCH = 0.5


# -- starting -----------------------------------------------------------------------------------


def start_child(
    main: Callable[..., None], *arguments: str, stderr: Any = subprocess.DEVNULL, **options: Any
) -> subprocess.Popen[bytes]:
    """Start a process that calls ``main(source, sink, *arguments)``.

    `main` is a function of a module; `source` and `sink` are the two pipes as binary files. The
    messages of libraries go to `stderr`. For `options` see `subprocess.Popen`; `env` holds
    additional environment variables.
    """
    environment = {**os.environ, **options.pop("env", {})}
    limit_accelerate(environment)
    given = [sys.path, main.__module__, main.__qualname__, *arguments]
    return subprocess.Popen(
        [sys.executable, "-c", _CHILD, json.dumps(given)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env=environment,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        **options,
    )


def run_child(module: str, function: str, *arguments: str) -> None:
    """Call a function with the pipes of this process, which is a child."""
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    getattr(importlib.import_module(module), function)(source, sink, *arguments)


class ChildEnded(Exception):
    """A child process ended without an answer."""


def call_in_child(
    function: Callable[..., Result],
    *arguments: object,
    look: Callable[[ProcessTree], None] | None = None,
    env: dict[str, str] | None = None,
) -> Result:
    """Call a function in a child process, and return its result.

    Arguments and result are pickled; what the function raises is raised here, and `ChildEnded` if
    the child crashed. `look` is called every 20 ms; what it raises ends the child with all its
    descendants. `env` holds additional environment variables.
    """
    given = pickle.dumps((function, arguments), pickle.HIGHEST_PROTOCOL)
    pause = _START
    with start_child(answer, env=env or {}) as child:
        tree = ProcessTree(child.pid)
        # by a thread, as `communicate` writes nothing more after its first timeout
        sink, child.stdin = cast(BinaryIO, child.stdin), None
        threading.Thread(target=_write, args=(sink, given), daemon=True).start()
        try:
            while True:
                try:
                    answered = child.communicate(timeout=pause)[0]
                    break
                except subprocess.TimeoutExpired:
                    pause = _LOOK
                    if look is not None:
                        look(tree)
        except BaseException:
            tree.end()
            raise
    if child.returncode == _NO_MEMORY:
        raise MemoryError
    if child.returncode:
        raise ChildEnded(f"status {child.returncode}")
    fault, result = pickle.loads(answered)
    if fault is not None:
        raise fault
    return cast(Result, result)


def _write(sink: BinaryIO, given: bytes) -> None:
    with contextlib.suppress(OSError), sink:  # the child has ended
        sink.write(given)


def answer(source: BinaryIO, sink: BinaryIO) -> None:
    """Call the function that comes through a pipe; the main function of `call_in_child`."""
    function, arguments = pickle.load(source)
    outcome: tuple[Exception | None, Any]
    try:
        outcome = (None, function(*arguments))
    except Exception as fault:  # noqa: BLE001  raised in the parent
        fault.add_note(traceback.format_exc())  # which does not get there otherwise
        outcome = (fault, None)
    try:
        with sink:
            pickle.dump(outcome, sink, pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        os._exit(_NO_MEMORY)


# -- ending -------------------------------------------------------------------------------------


class ProcessTree:
    """A process and its descendants, which are remembered when their parent ends.

    The process that was started need not be the one that works: in a virtual environment of
    Windows ``python.exe`` starts the real interpreter and waits for it, and so do other launchers.

    """

    def __init__(self, root: int) -> None:
        import psutil

        self._processes: list[psutil.Process] = []
        with contextlib.suppress(psutil.Error):  # it has just ended
            self._processes.append(psutil.Process(root))
        #: Processor time of each, those that have ended included.
        self._seconds: dict[psutil.Process, float] = {}
        self._searched = -_SEARCH

    def measured(self) -> tuple[float, float]:
        """Processor time that all have taken (s), and memory that they have in use (bytes)."""
        import psutil

        if time.monotonic() - self._searched >= _SEARCH:
            self._search()
        memory = with_children = 0.0
        for process in self._processes:
            with contextlib.suppress(psutil.Error):  # it has just ended
                spent = process.cpu_times()
                self._seconds[process] = spent.user + spent.system
                with_children += sum(spent[:4])
                memory += process.memory_info().rss
        return max(sum(self._seconds.values()), with_children), memory

    def end(self) -> None:
        """Kill all of them, this process last if it is among them."""
        import psutil

        self._search()
        for process in sorted(self._processes, key=lambda each: each.pid == os.getpid()):
            with contextlib.suppress(psutil.Error):
                process.kill()

    def _search(self) -> None:
        """Add processes that have been started since."""
        import psutil

        for process in list(self._processes):
            with contextlib.suppress(psutil.Error):
                started = process.children(recursive=True)
                self._processes += [each for each in started if each not in self._processes]
        self._searched = time.monotonic()


def end_group(leader: int, patience: float = 0.0) -> None:
    """End the leader of a process group, with its descendants.

    They get SIGTERM, which ends them at once; only the resource trackers of multiprocessing ignore
    it, delete temporary files and then exit. Descendants are killed after `patience` seconds.
    Windows has neither groups nor SIGTERM: all are killed there.
    """
    if sys.platform == "win32":
        ProcessTree(leader).end()
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


#: Error numbers of a pipe whose other end is closed, on POSIX and on Windows.
_CLOSED = (errno.EPIPE, errno.EINVAL)


class Wire:
    """One end of a connection: Python objects over two byte streams.

    Pickling an array into a pipe would copy it several times while holding the interpreter lock,
    which blocks the window. Its memory is written as it is instead (PEP 574), with the lock
    released.
    """

    def __init__(self, source: BinaryIO, sink: BinaryIO) -> None:
        self._source, self._sink = source, sink
        self._lock = threading.Lock()

    def send(self, message: object) -> None:
        """Send a picklable object, from any thread.

        `BrokenPipeError` is raised if the other end is gone.
        """
        arrays: list[memoryview] = []
        pickled = pickle.dumps(
            message, protocol=5, buffer_callback=lambda each: arrays.append(each.raw())
        )
        sizes = json.dumps([len(pickled), *(each.nbytes for each in arrays)]).encode()
        with self._lock, closed_pipe_errors():
            self._sink.write(len(sizes).to_bytes(8, "little") + sizes + pickled)
            for each in arrays:
                self._sink.write(each)
            self._sink.flush()

    def receive(self) -> Any:
        """Wait for the next object, in one thread only.

        `EOFError` or `BrokenPipeError` is raised if the other end is gone.
        """
        sizes = json.loads(bytes(self._read(int.from_bytes(self._read(8), "little"))))
        pickled, *arrays = [self._read(size) for size in sizes]
        return pickle.loads(pickled, buffers=arrays)

    def close(self) -> None:
        """Close both streams; the other end then raises `EOFError`."""
        for stream in (self._sink, self._source):
            with contextlib.suppress(OSError):  # unsent bytes of a dead connection: nothing is lost
                stream.close()

    def _read(self, size: int) -> memoryview:
        import numpy as np  # which the command line need not load

        memory = np.empty(size, dtype=np.uint8).data
        with closed_pipe_errors():
            if cast(Any, self._source).readinto(memory) < size:
                raise EOFError("the other end of the connection is gone")
        return memory


def is_closed_pipe(fault: BaseException) -> bool:
    """Whether writing to a pipe, flushing or closing it failed because its other end is closed.

    On Windows that is ``EINVAL``, which means other things where it comes with a file name.
    """
    if isinstance(fault, BrokenPipeError):
        return True
    return isinstance(fault, OSError) and fault.errno in _CLOSED and fault.filename is None


@contextlib.contextmanager
def closed_pipe_errors() -> Iterator[None]:
    """Raise `BrokenPipeError` where the other end of a pipe is closed, on every system.

    Only what writes to a pipe, flushes it or closes it belongs into the body.
    """
    try:
        yield
    except OSError as fault:
        if is_closed_pipe(fault) and not isinstance(fault, BrokenPipeError):
            raise BrokenPipeError(errno.EPIPE, "the other end of the pipe is closed") from fault
        raise


class Channel(Protocol):
    """Connection from a running job to the window."""

    @property
    def folder(self) -> Path:
        """Temporary folder that is deleted when the window closes."""
        ...

    def report(self, progress: Progress) -> None:
        """Report the progress of the work."""
        ...

    def send(self, message: object) -> None:
        """Send a part of the result (picklable)."""
        ...

    def cancelled(self) -> bool:
        """Whether the user has cancelled."""
        ...


class Job(Protocol):
    """A frozen, picklable description of long work."""

    @property
    def label(self) -> str:
        """Label next to the progress bar: "Decomposing bunny"."""
        ...

    def run(self, channel: Channel) -> object:
        """Do the work in this process; the result is sent to the window."""
        ...
