"""Slices of the spectrum computed side by side, handed out lowest first.

In threads, since the kernels release the interpreter lock. A slice's result does not depend on
what ran beside it, so the number of threads never changes a bit of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

from meshmash_viewer.spectral.engine.factorization import OrderedPencil, StopFlag
from meshmash_viewer.spectral.engine.lanczos import Interval, IntervalPairs, find_pairs

__all__ = ["run_slices"]


def run_slices(
    ordered: OrderedPencil,
    intervals: Iterable[Interval],
    tolerance: float,
    n_jobs: int,
    stop: StopFlag,
) -> Iterator[IntervalPairs]:
    """Yield the pairs of each interval in order.

    Parameters
    ----------
    ordered : OrderedPencil
    intervals : iterable of Interval
        May be computed as it is consumed.
    tolerance : float
        Wanted residual relative to the eigenvalue.
    n_jobs : int
        Slices at a time.
    stop : ndarray of uint8, shape (1,)
        Set here when the iteration is left early; running kernels look at it.
    """
    if n_jobs == 1:
        for interval in intervals:
            yield find_pairs(ordered, interval, tolerance, stop)
        return
    with ThreadPoolExecutor(n_jobs, "slice") as threads:
        begun: deque[Future[IntervalPairs]] = deque()
        try:
            for interval in intervals:
                begun.append(threads.submit(find_pairs, ordered, interval, tolerance, stop))
                busy = [slice_ for slice_ in begun if not slice_.done()]
                if len(busy) == n_jobs:
                    wait(busy, return_when=FIRST_COMPLETED)
                while begun and begun[0].done():
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        except BaseException:
            stop[0] = 1
            raise
