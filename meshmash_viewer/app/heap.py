"""The C library's heap, which keeps what was given back to it until it is told otherwise."""

from __future__ import annotations

import ctypes
import sys

__all__ = ["give_back"]


def give_back() -> None:
    """Return to the system what was freed; of C libraries other than glibc nobody need ask it."""
    if sys.platform.startswith("linux"):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
