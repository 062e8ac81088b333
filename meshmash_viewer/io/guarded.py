"""Reading of files in a child process with limits of time and memory.

Some libraries do not raise on a broken file but crash, loop forever or exhaust the memory.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from meshmash_viewer.errors import InputError, missing_module, not_installed, printable
from meshmash_viewer.io.raw import RawMesh, read_raw
from meshmash_viewer.plug_ins import PlugIn
from meshmash_viewer.work import ChildEnded, ProcessTree, call_in_child

#: Environment variable whose value multiplies all limits.
RAISE_LIMITS = "MESHMASH_READ_LIMITS"

_SECONDS, _SECONDS_PER_BYTE = 8.0, 5e-7
_BYTES, _BYTES_PER_BYTE = 640e6, 40.0
#: Largest plausible compression: gzip compresses text of very regular meshes thirty-fold.
_HONEST_RATIO = 40.0
#: Files that unpack to less than this size, or by less than this ratio, need no limits.
_HARMLESS_BYTES, _HARMLESS_RATIO = 12e6, 8.0

#: Whether this is the child process, which runs under limits already.
_watched = False
#: Seconds without processor use after which the child is considered blocked.
_IDLE_SECONDS = 60.0


def is_child() -> bool:
    """Whether this process reads for another one, and may read what it is given itself."""
    return _watched


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
    """

    #: Processor time.
    seconds: float
    #: Bytes in use at once, the interpreter and its libraries included.
    memory: float

    @classmethod
    def of(cls, n_bytes: int, *, unpacked: int = 0) -> ReadLimits:
        """Return the limits for a file of some bytes, and more after decompression as a whole.

        `InputError` is raised if the environment variable holds no positive number.
        """
        honest = min(float(unpacked), _HONEST_RATIO * n_bytes)
        size = max(float(n_bytes), honest / 5.0)
        factor = limit_factor()
        return cls(
            factor * (_SECONDS + _SECONDS_PER_BYTE * size),
            factor * (_BYTES + _BYTES_PER_BYTE * size),
        )

    @staticmethod
    def are_needed(n_bytes: int, unpacked: float) -> bool:
        """Whether a file unpacks to so much that it must be read under limits."""
        return unpacked > max(_HARMLESS_BYTES, _HARMLESS_RATIO * n_bytes)


def limit_factor() -> float:
    """Return the number in the environment variable `RAISE_LIMITS`, by default 1."""
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
    """Read a file in a child process under limits, by default ``ReadLimits.of`` its size.

    `reader` is a public function of a module. `LimitExceeded` is raised if it takes more time or
    memory; `InputError` if `reader` raises it, or the child crashes.
    """
    if _watched:
        return read_raw(reader, path)
    if isinstance(reader, PlugIn):
        reader.load()  # raises here if the plug-in cannot be loaded
    limits = limits or ReadLimits.of(path.stat().st_size)
    name = f"{reader.__module__}:{reader.__qualname__}"
    try:
        # one thread of OpenBLAS, as each takes memory
        return call_in_child(
            convert,
            name,
            path,
            limits.memory,
            look=_Watch(limits),
            env={"OPENBLAS_NUM_THREADS": "1"},
        )
    except MemoryError:
        raise _too_large(limits) from None
    except ChildEnded:
        raise InputError("is so broken that the library that reads it ends on it") from None


class _Watch:
    """Raises `LimitExceeded` when a process exceeds its limits."""

    def __init__(self, limits: ReadLimits) -> None:
        self._limits, self._began = limits, time.monotonic()

    def __call__(self, tree: ProcessTree) -> None:
        computed, memory = tree.measured()
        if memory > self._limits.memory:
            raise _too_large(self._limits)
        if computed > self._limits.seconds:
            raise LimitExceeded(f"takes longer than {self._limits.seconds:.0f} seconds to read")
        if time.monotonic() - self._began > _IDLE_SECONDS + 10.0 * computed:
            raise LimitExceeded("takes too long to read")


def _too_large(limits: ReadLimits) -> LimitExceeded:
    return LimitExceeded(f"takes more than {limits.memory / 1e6:.0f} MB of memory to read")


def convert(reader: str, path: Path, memory: float) -> RawMesh:
    """Read a file in the child process, by a reader given as "module:function".

    `memory` is the limit in bytes. All exceptions except `MemoryError` are raised as `InputError`.
    """
    global _watched
    module, _, function = reader.partition(":")
    read = getattr(importlib.import_module(module), function)
    _refuse_memory_beyond(memory)
    _watched = True
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return read_raw(read, path)
    except MemoryError:
        raise
    except Exception as fault:  # noqa: BLE001  reported by the parent
        said = str(fault) if isinstance(fault, InputError) else str(unreadable(fault))
        raise InputError(said) from None
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
