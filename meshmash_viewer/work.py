"""Child processes: start, exchange of objects, and end.

A child is an interpreter that calls one function of the package with two pipes. Its standard output
goes to standard error, so that stray prints and its own children cannot write to the pipes.
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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar, cast

from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.engine.compiler import limit_accelerate

if TYPE_CHECKING:
    import psutil


Result = TypeVar("Result")

# The child has the `sys.path` of its parent, so that it imports the same package.
_CHILD = """
import json, sys
sys.path[:], *given = json.loads(sys.argv[1])
from meshmash_viewer.work import run_child
run_child(*given)
"""
#: Seconds until `call_in_child` calls `look` first, and between further calls.
_START, _LOOK = 0.2, 0.02
#: Exit status of a child that ran out of memory when it sent its result.
_NO_MEMORY = 65
#: Seconds between two searches for new processes, which read the whole process table.
_SEARCH = 0.5


# -- starting -----------------------------------------------------------------------------------


def start_child(
    main: Callable[..., None], *arguments: str, stderr: Any = subprocess.DEVNULL, **options: Any
) -> subprocess.Popen[bytes]:
    """Start a process that calls ``main(source, sink, *arguments)``.

    `main` is a module-level function; `source` and `sink` are the two pipes as binary files.
    `options` are arguments of `subprocess.Popen`; `env` contains additional variables only.
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
    """Call a function with the pipes of this child process."""
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    getattr(importlib.import_module(module), function)(source, sink, *arguments)


class ChildEnded(Exception):
    """A child process ended without an answer."""

    def __init__(self, status: int) -> None:
        super().__init__(f"status {status}")
        #: Whether the system or another program ended the process, as Linux does without memory.
        self.killed = status == -9


def call_in_child(
    function: Callable[..., Result],
    *arguments: object,
    look: Callable[[ProcessTree], None] | None = None,
    env: dict[str, str] | None = None,
) -> Result:
    """Call a function in a child process, and return its result.

    Arguments and result are pickled. An exception of the function is raised again, `ChildEnded` if
    the child crashed. `look` is called every 20 ms; an exception that it raises ends the child with
    its descendants. `env` contains additional environment variables.
    """
    given = pickle.dumps((function, arguments), pickle.HIGHEST_PROTOCOL)
    pause = _START
    with start_child(answer, env=env or {}) as child:
        tree = ProcessTree(child.pid)
        # in a thread, since `communicate` stops writing after its first timeout
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
        raise ChildEnded(child.returncode)
    fault, result = pickle.loads(answered)
    if fault is not None:
        raise fault
    return cast(Result, result)


def _write(sink: BinaryIO, given: bytes) -> None:
    with contextlib.suppress(OSError), sink:  # the child has ended
        sink.write(given)


def answer(source: BinaryIO, sink: BinaryIO) -> None:
    """Call the function received from `source`; the main function of `call_in_child`."""
    function, arguments = pickle.load(source)
    outcome: tuple[Exception | None, Any]
    try:
        outcome = (None, function(*arguments))
    except Exception as fault:  # noqa: BLE001  raised in the parent
        fault.add_note(traceback.format_exc())  # tracebacks are not pickled
        outcome = (fault, None)
    try:
        with sink:
            pickle.dump(outcome, sink, pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        os._exit(_NO_MEMORY)


# -- ending -------------------------------------------------------------------------------------


class ProcessTree:
    """A process and its descendants, including those whose parent has ended.

    The started process may only be a launcher: in a virtual environment on Windows ``python.exe``
    starts the real interpreter and waits for it.
    """

    def __init__(self, root: int) -> None:
        import psutil

        self._processes: list[psutil.Process] = []
        with contextlib.suppress(psutil.Error):  # it has just ended
            self._processes.append(psutil.Process(root))
        #: Processor time of each process, also of ended ones.
        self._seconds: dict[psutil.Process, float] = {}
        self._searched = -_SEARCH

    def measured(self) -> tuple[float, float]:
        """Return the processor time of all processes (s) and the memory in use (bytes)."""
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
        """Kill all processes, the calling one last."""
        import psutil

        self._search()
        for process in sorted(self._processes, key=lambda each: each.pid == os.getpid()):
            with contextlib.suppress(psutil.Error):
                process.kill()

    def _search(self) -> None:
        import psutil

        for process in list(self._processes):
            with contextlib.suppress(psutil.Error):
                started = process.children(recursive=True)
                self._processes += [each for each in started if each not in self._processes]
        self._searched = time.monotonic()


def end_group(leader: int, patience: float = 0.0) -> None:
    """End the leader of a process group, with its descendants.

    The processes receive SIGTERM; the resource trackers of multiprocessing ignore it, to delete
    temporary files first. All are killed after `patience` seconds, on Windows at once.
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

        with contextlib.suppress(ProcessLookupError):
            os.killpg(leader, 0)  # faster than a search if the group has ended
            for process in psutil.process_iter():
                with contextlib.suppress(psutil.Error, ProcessLookupError):
                    alive = process.status() != psutil.STATUS_ZOMBIE
                    if alive and os.getpgid(process.pid) == leader:
                        return True
    return False


#: Error numbers of a pipe whose other end is closed, on POSIX and on Windows.
_CLOSED = (errno.EPIPE, errno.EINVAL)


class Wire:
    """One end of a connection that transfers Python objects over two byte streams.

    Pickling an array would copy it several times without releasing the interpreter lock, which
    blocks the window. Its memory is written directly instead (PEP 574), with the lock released.
    """

    def __init__(self, source: BinaryIO, sink: BinaryIO) -> None:
        self._source, self._sink = source, sink
        self._lock = threading.Lock()

    def send(self, message: object) -> None:
        """Send a picklable object, from any thread.

        `BrokenPipeError` is raised if the other end is closed.
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

        `EOFError` or `BrokenPipeError` is raised if the other end is closed.
        """
        sizes = json.loads(bytes(self._read(int.from_bytes(self._read(8), "little"))))
        pickled, *arrays = [self._read(size) for size in sizes]
        return pickle.loads(pickled, buffers=arrays)

    def close(self) -> None:
        """Close both streams; the other end then raises `EOFError`."""
        for stream in (self._sink, self._source):
            with contextlib.suppress(OSError):  # unsent bytes, if the other end is closed
                stream.close()

    def _read(self, size: int) -> memoryview:
        import numpy as np  # not needed for the help of the command line

        memory = np.empty(size, dtype=np.uint8).data
        with closed_pipe_errors():
            if cast(Any, self._source).readinto(memory) < size:
                raise EOFError("the other end of the connection is gone")
        return memory


class Child:
    """A child process with a `Wire`, which calls ``main(source, sink, *arguments)``.

    The process is started by the first use, and again after its end. Its standard error is written
    to the file `errors`. All methods can be called in any thread.
    """

    def __init__(
        self, main: Callable[..., None], *arguments: str, errors: Path | None = None
    ) -> None:
        self._main, self._arguments, self._errors = main, arguments, errors
        self._lock = threading.Lock()
        self._wire: Wire | None = None
        #: The process; None while there is none.
        self.process: subprocess.Popen[bytes] | None = None
        #: Whether `close` has been called.
        self.closed = False

    def connect(self) -> Wire:
        """Return the wire to the process; raise `Cancelled` after `close`."""
        if self.process is not None and self.process.poll() is not None:
            self.end()
        with self._lock:
            if self.closed:
                raise Cancelled
            if self._wire is None:
                with open(self._errors or os.devnull, "wb") as errors:
                    child = start_child(
                        self._main, *self._arguments, stderr=errors, start_new_session=True
                    )
                self._wire = Wire(cast(BinaryIO, child.stdout), cast(BinaryIO, child.stdin))
                self.process = child
            return self._wire

    def send(self, message: object) -> None:
        """Send an object, if the process runs and is not about to end."""
        wire = self._wire
        if wire is not None:
            with contextlib.suppress(OSError, ValueError):  # the process has just ended
                wire.send(message)

    def kill(self) -> None:
        """End the process with its descendants, without waiting."""
        with self._lock:
            if self.process is not None:
                end_group(self.process.pid)

    def close(self, patience: float = 0.0) -> None:
        """End the process for good, see `end`."""
        self.closed = True
        self.end(patience)

    def end(self, patience: float = 0.0) -> None:
        """Wait until the process has ended; descendants may take `patience` seconds to clean up."""
        with self._lock:
            process, self.process = self.process, None
            wire, self._wire = self._wire, None
        if process is not None and wire is not None:
            end_group(process.pid, patience)
            process.wait()
            wire.close()


def is_closed_pipe(fault: BaseException) -> bool:
    """Whether an error of writing, flushing or closing a pipe means that its other end is closed.

    Windows raises ``EINVAL``, which has other meanings if the error has a file name.
    """
    if isinstance(fault, BrokenPipeError):
        return True
    return isinstance(fault, OSError) and fault.errno in _CLOSED and fault.filename is None


@contextlib.contextmanager
def closed_pipe_errors() -> Iterator[None]:
    """Raise `BrokenPipeError` on every system if the other end of a pipe is closed.

    The body may only write to a pipe, flush it or close it.
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


@dataclass(frozen=True, eq=False)
class JobResult:
    """The result of a job, sent to the window."""

    #: Passed to the function `accept` of the job.
    content: Any = None
    #: Sentences for the message bar, or "".
    remark: str = ""
    #: Whether the remark is shown as a warning.
    warns: bool = True
    #: The file that was written.
    path: Path | None = None
