"""The C library's heap, which keeps what it was given back unless told otherwise."""

from __future__ import annotations

import ctypes
import sys

__all__ = ["give_back", "keep_little"]

# malloc.h of glibc
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3

#: Bytes from which a block is memory of its own, which goes back to the system when it is freed: a
#: field of a million vertices, taken and freed at every tick, stays below.
OWN_BLOCK = 6 << 20


def keep_little() -> None:
    """Let large blocks never become part of the heap, for a process that is ours alone.

    glibc raises this bound up to 32 MB as blocks are freed. The buffers of a mesh then lie between
    small blocks that stay: a window on a million vertices held 0.25 GB that nobody used, more or
    less by chance. Other C libraries are left as they are.
    """
    option = _function("mallopt")
    if option is not None:
        option(_M_MMAP_THRESHOLD, OWN_BLOCK)
        option(_M_TRIM_THRESHOLD, 2 * OWN_BLOCK)


def give_back() -> None:
    """Return to the system what was freed."""
    trim = _function("malloc_trim")
    if trim is not None:
        trim(0)


def _function(name: str) -> ctypes._NamedFuncPointer | None:
    """A function of glibc; musl has neither, and no need of them."""
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), name, None)
