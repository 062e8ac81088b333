"""Messages over pipes: whole Python objects, with the memory of arrays as it is."""

from __future__ import annotations

import contextlib
import errno
import json
import pickle
import threading
from collections.abc import Iterator
from typing import Any, BinaryIO, cast

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
