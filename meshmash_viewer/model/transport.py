"""Messages between two processes: pickles on a pipe, large arrays through files.

Pickling an array into a pipe would copy it several times while holding the interpreter lock, which
blocks the window. Out-of-band pickling (PEP 574) gives access to the memory instead, which is
written to a file and read back with the lock released.
"""

from __future__ import annotations

import contextlib
import pickle
import threading
import uuid
from pathlib import Path
from typing import BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import discard, persistently
from meshmash_viewer.io.pipes import closed_pipe_errors
from meshmash_viewer.progress import Progress

#: Arrays of at least this many bytes go through a file.
_FILE_BYTES = 1 << 16


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


class Wire:
    """One end of a connection: whole Python objects over two byte streams.

    Parameters
    ----------
    source, sink : binary file
        Streams that messages are read from and written to.
    folder : Path
        Folder for large arrays; the receiver deletes each file after reading it.
    """

    def __init__(self, source: BinaryIO, sink: BinaryIO, folder: Path) -> None:
        self._source = source
        self._sink = sink
        self._folder = folder
        self._lock = threading.Lock()

    def send(self, message: object) -> None:
        """Send a picklable object, from any thread.

        Raises
        ------
        BrokenPipeError
            If the other end is gone.
        OSError
            If the disk is full.
        """
        files: list[tuple[str, int]] = []

        def keep_in_band(buffer: pickle.PickleBuffer) -> bool:
            raw = buffer.raw()
            if raw.nbytes < _FILE_BYTES:
                return True
            name = uuid.uuid4().hex
            files.append((name, raw.nbytes))
            try:
                (self._folder / name).write_bytes(raw)
            except OSError as fault:
                # the error for a full disk has no file name
                raise OSError(fault.errno, fault.strerror, str(self._folder)) from fault
            return False

        try:
            payload = pickle.dumps(message, protocol=5, buffer_callback=keep_in_band)
            frame = pickle.dumps((files, payload), protocol=5)
            with self._lock, closed_pipe_errors():
                self._sink.write(len(frame).to_bytes(8, "little"))
                self._sink.write(frame)
                self._sink.flush()
        except BaseException:
            discard(*(self._folder / name for name, _ in files))
            raise

    def receive(self) -> object:
        """Wait for the next object, in one thread only.

        Raises
        ------
        EOFError, BrokenPipeError
            If the other end is gone.
        """
        length = int.from_bytes(self._read(8), "little")
        files, payload = pickle.loads(self._read(length))
        buffers = [self._take(name, size) for name, size in files]
        return pickle.loads(payload, buffers=buffers)

    def close(self) -> None:
        """Close both streams; the other end then raises `EOFError`."""
        for stream in (self._sink, self._source):
            with contextlib.suppress(OSError):  # unsent bytes of a dead connection: nothing is lost
                stream.close()

    def _read(self, count: int) -> bytes:
        with closed_pipe_errors():
            data = self._source.read(count)
        if len(data) < count:
            raise EOFError("the other end of the connection is gone")
        return data

    def _take(self, name: str, size: int) -> npt.NDArray[np.uint8]:
        path = self._folder / name
        # releases the interpreter lock
        memory = persistently(lambda: np.fromfile(path, dtype=np.uint8))
        if len(memory) < size:
            raise EOFError(f"{path} is shorter than its {size} bytes")
        discard(path)
        return memory
