"""Work on all vertices in stretches, on a few processors at once.

What a field of a million vertices takes is the reading of memory, and one processor alone does not
get all that memory gives.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

__all__ = ["extremes", "in_stretches"]

Found = TypeVar("Found")

#: Stretches at a time: more processors than this do not read faster.
_AT_ONCE = 4
#: Vertices that a stretch has at least: waking a thread takes as long as a hundred thousand.
_SHORTEST = 150_000


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
    borders = [count * part // parts for part in range(parts + 1)]
    first, *others = (slice(*ends) for ends in zip(borders[:-1], borders[1:], strict=True))
    begun = [_threads().submit(work, other) for other in others]
    return [work(first), *(other.result() for other in begun)]


def extremes(values: npt.NDArray[np.floating]) -> tuple[float, float]:
    """Smallest and largest of some values, NaN as soon as one is; infinities of none."""

    def find(part: slice) -> tuple[float, float]:
        stretch = values[part]
        return stretch.min(initial=np.inf), stretch.max(initial=-np.inf)

    lows, highs = zip(*in_stretches(len(values), find), strict=True)
    return float(np.min(lows)), float(np.max(highs))
