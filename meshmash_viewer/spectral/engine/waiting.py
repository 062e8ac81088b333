"""Waiting for work that can't be stopped by asking it, while someone else is asked about it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

__all__ = ["wait_for"]

T = TypeVar("T")

#: Seconds between two questions.
_INTERVAL = 0.05


def wait_for(
    work: Callable[[], T],
    poll: Callable[[], None] | None,
    abandon: Callable[[], None] | None = None,
) -> T:
    """Do work in a thread, and poll from this one while it lasts.

    Parameters
    ----------
    work : callable
        Releases the interpreter lock, or this thread is not heard.
    poll : callable, optional
        What it raises is raised here, after the work has ended; without it the work is done here.
    abandon : callable, optional
        Called first in that case, to make the work end.
    """
    if poll is None:
        return work()
    with ThreadPoolExecutor(1, thread_name_prefix="waited-for") as pool:
        future = pool.submit(work)
        try:
            while not wait([future], timeout=_INTERVAL).done:
                poll()
        except BaseException:
            if abandon is not None:
                abandon()
            raise
        return future.result()
