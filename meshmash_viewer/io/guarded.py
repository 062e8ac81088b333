"""Reading of files in a child process with limits of time and memory.

Some libraries do not raise on a broken file but crash, loop forever or exhaust the memory.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import math
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from meshmash_viewer.errors import InputError, missing_module, not_installed, printable
from meshmash_viewer.io.atomic import scratch_prefix
from meshmash_viewer.io.process_tree import ProcessTree
from meshmash_viewer.io.raw import RawMesh, raw_mesh
from meshmash_viewer.plug_ins import PlugIn
from meshmash_viewer.spectral.engine.blas_threads import limit_accelerate

#: Environment variable whose value multiplies all limits.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Largest plausible compression: gzip compresses text of very regular meshes thirty-fold.
_HONEST_RATIO = 40.0
#: Files that unpack to less than this size, or by less than this ratio, need no limits.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0

# the child imports this package from where the parent did
_CHILD = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from meshmash_viewer.io.guarded import convert
convert(*sys.argv[2:])
"""

#: Exit statuses of the child; any other is that of a library that ended it.
_READ, _FAULT, _TOO_LARGE = 0, 64, 65
#: Seconds until the first check of the child, and between the next ones, in which it can allocate
#: some tens of megabytes.
_START, _LOOK = 0.2, 0.02
#: Whether this is the child process, which runs under limits already.
_watched = False
#: Seconds without processor use after which the child is considered blocked.
_IDLE_SECONDS = 60.0


class LimitExceeded(InputError):
    """A file takes more time or memory than its size justifies; the message names the remedy."""

    def __init__(self, what: str) -> None:
        super().__init__(
            f"{what}, more than a sound file of its size should; if you trust it, set"
            f" {RAISE_LIMITS}=10 to allow ten times as much, or export it again."
        )


@dataclass(frozen=True)
class ReadLimits:
    """Limits of the process that reads a file, about twenty times what regular files need.

    Both are multiplied by the number in the environment variable `RAISE_LIMITS`.

    Parameters
    ----------
    seconds : float
        Processor time.
    memory : float
        Bytes in use at once, the interpreter and its libraries included.
    """

    seconds: float
    memory: float

    @classmethod
    def of(cls, n_bytes: int, *, unpacked: int = 0) -> ReadLimits:
        """Return the limits for a file.

        Parameters
        ----------
        n_bytes : int
            Size of the file on the disk.
        unpacked : int, optional
            Size after decompression, where the file is compressed as a whole.

        Raises
        ------
        InputError
            If the environment variable holds no positive number.
        """
        honest = min(float(unpacked), _HONEST_RATIO * n_bytes)
        size = max(float(n_bytes), honest / 5.0)
        factor = _factor()
        return cls(
            factor * (_SECONDS + _SECONDS_PER_BYTE * size),
            factor * (_BYTES + _BYTES_PER_BYTE * size),
        )

    @staticmethod
    def are_needed(n_bytes: int, unpacked: float) -> bool:
        """Whether a file unpacks to so much that it must be read under limits."""
        return unpacked > max(_HARMLESS_BYTES, _HARMLESS_RATIO * n_bytes)


def _factor() -> float:
    text = os.environ.get(RAISE_LIMITS, "1")
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not factor > 0.0:
        raise InputError(
            f"{RAISE_LIMITS} is {text!r}: give the number by which the limits of time and memory"
            " for reading a file are to be multiplied, or unset it."
        )
    return factor


def read_guarded(
    reader: Callable[[Path], RawMesh], path: Path, limits: ReadLimits | None = None
) -> RawMesh:
    """Read a file in a child process under limits.

    Parameters
    ----------
    reader : callable
        A public function of a module that takes a path and returns a `RawMesh`.
    path : Path
    limits : ReadLimits, optional
        By default ``ReadLimits.of`` the size of the file.

    Raises
    ------
    LimitExceeded
        If it takes more time or memory than `limits`.
    InputError
        If `reader` raises it, or the child crashes.
    """
    if _watched:
        return raw_mesh(reader(path))
    if isinstance(reader, PlugIn):
        reader.load()  # raises here if the plug-in cannot be loaded
    limits = limits or ReadLimits.of(path.stat().st_size)
    with TemporaryDirectory(prefix=scratch_prefix(), ignore_cleanup_errors=True) as folder:
        result = Path(folder) / "mesh.pickle"
        name = f"{reader.__module__}:{reader.__qualname__}"
        command = [sys.executable, "-c", _CHILD, json.dumps(sys.path), name, str(path), str(result)]
        with subprocess.Popen(
            [*command, str(limits.memory)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # messages of libraries before a crash
            env=_environment(),
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        ) as child:
            tree = ProcessTree(child.pid)
            try:
                said = _watch(child, tree, limits)
            except BaseException:
                tree.end()
                raise
        if child.returncode == _TOO_LARGE:
            raise _too_large(limits)
        if child.returncode == _FAULT:
            raise InputError(said.decode("utf-8"))
        if child.returncode != _READ:
            raise InputError("is so broken that the library that reads it ends on it")
        with result.open("rb") as file:
            raw: RawMesh = pickle.load(file)
            return raw


def _environment() -> dict[str, str]:
    """Return the environment of the child, with one OpenBLAS thread as each takes memory."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    limit_accelerate(environment)
    return environment


def _watch(child: subprocess.Popen[bytes], tree: ProcessTree, limits: ReadLimits) -> bytes:
    """Wait until the child has ended, and return its output."""
    began = time.monotonic()
    look = _START
    while True:
        try:
            return child.communicate(timeout=look)[0]
        except subprocess.TimeoutExpired:
            look = _LOOK
        computed, memory = tree.measured()
        if memory > limits.memory:
            raise _too_large(limits)
        if computed > limits.seconds:
            raise LimitExceeded(f"takes longer than {limits.seconds:.0f} seconds to read")
        if time.monotonic() - began > _IDLE_SECONDS + 10.0 * computed:
            raise LimitExceeded("takes too long to read")


def _too_large(limits: ReadLimits) -> LimitExceeded:
    return LimitExceeded(f"takes more than {limits.memory / 1e6:.0f} MB of memory to read")


def convert(reader: str, source: str, result: str, memory: str) -> None:
    """Read a file; the main function of the child process.

    Parameters
    ----------
    reader : str
        Module and function, joined by a colon.
    source, result : str
        Files to read and to write, the latter as a pickled `RawMesh`.
    memory : str
        Limit of memory in bytes.
    """
    global _watched
    module, _, function = reader.partition(":")
    read = getattr(importlib.import_module(module), function)
    _refuse_memory_beyond(float(memory))
    _watched = True
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            raw = raw_mesh(read(Path(source)))
        with open(result, "wb") as file:
            pickle.dump(raw, file, pickle.HIGHEST_PROTOCOL)
    except MemoryError:
        sys.exit(_TOO_LARGE)
    except Exception as fault:  # noqa: BLE001  reported by the parent
        said = fault if isinstance(fault, InputError) else unreadable(fault)
        sys.stdout.buffer.write(str(said).encode("utf-8", "replace"))
        sys.exit(_FAULT)
    finally:
        _watched = False


def unreadable(fault: BaseException) -> InputError:
    """Return an `InputError` for an exception of a library, or for a library not installed."""
    if missing := missing_module(fault):
        return InputError(f"is read by {not_installed(missing)}")
    return InputError(f"is not readable ({printable(fault) or type(fault).__name__})")


def _refuse_memory_beyond(limit: float) -> None:
    """On Linux, limit the memory by the system, which is faster than checks by the parent."""
    try:
        import resource
    except ImportError:
        return  # the parent measures
    if sys.platform == "linux" and limit < 2.0**62:
        with contextlib.suppress(ValueError, OSError):  # the user has set a stricter limit
            resource.setrlimit(resource.RLIMIT_DATA, (int(limit), resource.RLIM_INFINITY))
