"""Memory of bases, which can be let go in part.

A basis takes most of a run's memory, and its pairs are made in it: what lies behind them is of no
use any more, long before the pairs have been written. An array can't be cut, but the system takes
back pages that it is told of.
"""

from __future__ import annotations

import mmap
from contextlib import suppress
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["CAN_LET_GO", "allocate", "let_go"]

FloatArray: TypeAlias = npt.NDArray[np.float64]

#: Whether this can be done at all: elsewhere than on Linux pages are not taken back while they can
#: still be read.
CAN_LET_GO = hasattr(mmap, "MADV_DONTNEED") and hasattr(mmap, "MADV_HUGEPAGE")


def allocate(size: int) -> FloatArray:
    """Memory for so many numbers, shape (size,).

    Raises
    ------
    MemoryError
        If the system has none left.
    """
    if not CAN_LET_GO or size == 0:
        return np.empty(size)
    try:
        pages = mmap.mmap(-1, 8 * size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as fault:
        raise MemoryError(f"no room for {8 * size} bytes") from fault
    # Small pages take several times as long to be touched first; a kernel without large ones
    # refuses the hint, and the memory is as good.
    with suppress(OSError):
        pages.madvise(mmap.MADV_HUGEPAGE)
    return np.frombuffer(pages)


def let_go(rows: FloatArray) -> None:
    """Give the pages behind contiguous rows back; what they hold is undefined from now on."""
    memory: Any = rows.base
    view: Any = memory.base if isinstance(memory, np.ndarray) else None
    pages = view.obj if isinstance(view, memoryview) else view
    if rows.size == 0 or not isinstance(pages, mmap.mmap):
        return
    first = rows.ctypes.data - memory.ctypes.data
    last = (first + rows.nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
    first = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE
    if first < last:
        pages.madvise(mmap.MADV_DONTNEED, first, last - first)
