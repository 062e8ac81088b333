"""Work on all vertices in stretches, on a few processors at once.

What a field of a million vertices takes is the reading of memory, and one processor alone does not
get all that memory gives.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["extremes", "in_stretches"]

Found = TypeVar("Found")

#: Stretches at a time: more processors than this do not read faster.
_AT_ONCE = 4
#: How many vertices take as long as waking a thread, and how many a stretch has at least.
_WAKING, _SHORTEST = 80_000, 150_000
#: Vertices whose values stay in a processor's cache between two looks at them.
_CACHED = 1 << 17


@cache
def _processors() -> int:
    from joblib import cpu_count

    return min(int(cpu_count()), _AT_ONCE)


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(_processors() - 1, 1), "stretch")


def in_stretches(count: int, work: Callable[[slice], Found]) -> list[Found]:
    """Call a function with stretches that make up ``0`` to `count`.

    Parameters
    ----------
    count : int
        Number of vertices.
    work : callable
        Must release the interpreter lock for most of its time, and touch its stretch alone.

    Returns
    -------
    list
        What it returned, in the order of the stretches.
    """
    parts = max(min(_processors(), count // _SHORTEST), 1)
    # Whoever need not be woken takes more: nobody has to be woken when the others are done, either.
    own = (count + (parts - 1) * _WAKING) // parts
    borders = [own + (count - own) * part // max(parts - 1, 1) for part in range(parts)]
    first, *others = (slice(*ends) for ends in pairwise([0, *borders]))
    begun = [_threads().submit(work, other) for other in others]
    return [work(first), *(other.result() for other in begun)]


def extremes(
    values: npt.NDArray[np.floating], write: Callable[[slice], None] | None = None
) -> tuple[float, float]:
    """Smallest and largest of some values, NaN as soon as one is; infinities of none.

    Parameters
    ----------
    values : ndarray, shape (n,)
    write : callable, optional
        Writes a stretch of them first: what has just been written is read fastest.
    """

    def find(part: slice) -> tuple[float, float]:
        low, high = np.inf, -np.inf
        for start in range(part.start, part.stop, _CACHED):
            piece = slice(start, min(start + _CACHED, part.stop))
            if write is not None:
                write(piece)
            # As NumPy does, these let NaN through, whichever side it is on.
            low = np.minimum(low, values[piece].min())
            high = np.maximum(high, values[piece].max())
        return low, high

    lows, highs = zip(*in_stretches(len(values), find), strict=True)
    return float(np.min(lows)), float(np.max(highs))
