"""Reading in a process of its own, stopped when a file takes more than one of its size may.

Some libraries do not fail on a broken file: they end their process, go round for ever or take all
memory. That must not be our process.
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
from meshmash_viewer.io.polygons import RawMesh, raw_mesh
from meshmash_viewer.io.process_tree import ProcessTree
from meshmash_viewer.plug_ins import PlugIn
from meshmash_viewer.spectral.engine.blas_threads import limit_accelerate

__all__ = ["RAISE_LIMITS", "LimitExceeded", "ReadLimits", "convert", "read_guarded", "unreadable"]

#: The environment variable by whose value every limit is multiplied.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Text of the most regular meshes shrinks thirty-fold by gzip, binary files far less.
_HONEST_RATIO = 40.0
#: What unpacks to a few megabytes at most, or not by much, can do no harm.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0

# The child finds this package wherever the parent found it.
_CHILD = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from meshmash_viewer.io.guarded import convert
convert(*sys.argv[2:])
"""

#: Exit statuses of the child; any other is that of a library that ended it.
_READ, _FAULT, _TOO_LARGE = 0, 64, 65
#: Seconds until the first look at the child, in which it hardly gets beyond its start, and between
#: the others: memory fills by some tens of megabytes meanwhile.
_START, _LOOK = 0.2, 0.02
#: Whether this is the process that is stopped when it takes too much.
_watched = False
#: A child that does not compute waits for something that will not come.
_IDLE_SECONDS = 60.0


class LimitExceeded(InputError):
    """A file that takes more than one of its size should; the sentence says how to go on."""

    def __init__(self, what: str) -> None:
        super().__init__(
            f"{what}, more than a sound file of its size should; if you trust it, set"
            f" {RAISE_LIMITS}=10 to allow ten times as much, or export it again."
        )


@dataclass(frozen=True)
class ReadLimits:
    """What the process that reads a file may take before it is stopped.

    Honest files take a twentieth of it. Both limits are multiplied by the number in the
    environment variable `RAISE_LIMITS`.

    Parameters
    ----------
    seconds : float
        Processor time, which does not depend on what else the machine is doing.
    memory : float
        Bytes in use at once, the interpreter and its libraries included.
    """

    seconds: float
    memory: float

    @classmethod
    def of(cls, n_bytes: int, *, unpacked: int = 0) -> ReadLimits:
        """Limits for a file of so many bytes.

        Parameters
        ----------
        n_bytes : int
            Of the file as it lies on the disk.
        unpacked : int, optional
            Of what it unpacks to, where it is compressed as a whole.

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
        """Whether a file unpacks to so much that it had better be read under limits."""
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
    """Read a file by a function of this package, in another process and under limits.

    Parameters
    ----------
    reader : callable
        A public function of a module; its file goes in and a `RawMesh` comes out.
    path : Path
    limits : ReadLimits, optional
        Those of the file's size if not given.

    Raises
    ------
    LimitExceeded
        If it takes more time or memory than `limits`.
    InputError
        What `reader` raises, or that it ended its process.
    """
    if _watched:
        return raw_mesh(reader(path))
    if isinstance(reader, PlugIn):
        reader.load()  # says what is wrong with it, as its process could not
    limits = limits or ReadLimits.of(path.stat().st_size)
    with TemporaryDirectory(prefix=scratch_prefix(), ignore_cleanup_errors=True) as folder:
        result = Path(folder) / "mesh.pickle"
        name = f"{reader.__module__}:{reader.__qualname__}"
        command = [sys.executable, "-c", _CHILD, json.dumps(sys.path), name, str(path), str(result)]
        with subprocess.Popen(
            [*command, str(limits.memory)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # where libraries complain once more before they end it
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
    """Variables of the child, whose threads of OpenBLAS would take memory each."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    limit_accelerate(environment)
    return environment


def _watch(child: subprocess.Popen[bytes], tree: ProcessTree, limits: ReadLimits) -> bytes:
    """What the child says; it has ended then."""
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
            raise LimitExceeded("keeps its reader waiting")


def _too_large(limits: ReadLimits) -> LimitExceeded:
    return LimitExceeded(f"takes more than {limits.memory / 1e6:.0f} MB of memory to read")


def convert(reader: str, source: str, result: str, memory: str) -> None:
    """Do the reading, in the child process, which ends with it.

    Parameters
    ----------
    reader : str
        Module and function, with a colon between.
    source, result : str
        Files to read and to write, the latter as a pickled `RawMesh`.
    memory : str
        Bytes that the process may take.
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
    except Exception as fault:  # noqa: BLE001  the parent says it
        said = fault if isinstance(fault, InputError) else unreadable(fault)
        sys.stdout.buffer.write(str(said).encode("utf-8", "replace"))
        sys.exit(_FAULT)
    finally:
        _watched = False


def unreadable(fault: BaseException) -> InputError:
    """What is left to say where a library says it best, or is not there."""
    if missing := missing_module(fault):
        return InputError(f"is read by {not_installed(missing)}")
    return InputError(f"is not readable ({printable(fault) or type(fault).__name__})")


def _refuse_memory_beyond(limit: float) -> None:
    """On Linux, refuse at once what the parent, which measures, would see too late."""
    try:
        import resource
    except ImportError:
        return  # the parent measures
    if sys.platform == "linux" and limit < 2.0**62:
        with contextlib.suppress(ValueError, OSError):  # a stricter limit of the user's own
            resource.setrlimit(resource.RLIMIT_DATA, (int(limit), resource.RLIM_INFINITY))
