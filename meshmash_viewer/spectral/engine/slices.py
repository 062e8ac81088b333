"""Slices of the spectrum computed side by side, handed out lowest first.

joblib runs them: in threads, since the kernels release the interpreter lock, or on whatever
backend `joblib.parallel_config` names, a cluster included. A slice's result does not depend on
what ran beside it, so in one process the number of workers never changes a bit of it; between
processes and machines the last digits may differ.
"""

from __future__ import annotations

import os
import queue
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from meshmash_viewer.spectral.engine.factorization import OrderedPencil, StopFlag
from meshmash_viewer.spectral.engine.lanczos import Interval, IntervalPairs, find_pairs

__all__ = ["run_slices"]

#: Times that slices are done again after their process died.
_REVIVALS = 2


def run_slices(
    ordered: OrderedPencil,
    intervals: Iterable[Interval],
    tolerance: float,
    n_jobs: int,
    stop: StopFlag,
    poll: Callable[[], None],
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
        Set here when the iteration is left; running kernels look at it.
    poll : callable
        Called several times a second while waiting; what it raises ends the run.
    """
    results: queue.Queue[IntervalPairs | BaseException | None] = queue.Queue(maxsize=2)
    crew = _Crew(ordered, intervals, tolerance, n_jobs, stop, results)
    thread = threading.Thread(target=crew.work, name="slices", daemon=True)
    thread.start()
    try:
        while True:
            try:
                item = results.get(timeout=0.05)
            except queue.Empty:
                poll()
                continue
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            yield item
            crew.taken.release()
            poll()
    finally:
        stop[0] = 1
        crew.taken.release()
        crew.abandon()
        while thread.is_alive():
            try:
                results.get(timeout=0.02)
            except queue.Empty:
                continue
        thread.join()


class _Crew:
    """The workers, driven from a thread so that whoever waits can be asked to cancel."""

    def __init__(
        self,
        ordered: OrderedPencil,
        intervals: Iterable[Interval],
        tolerance: float,
        n_jobs: int,
        stop: StopFlag,
        results: queue.Queue[Any],
    ) -> None:
        from joblib.parallel import get_active_backend

        self._ordered, self._tolerance, self._stop = ordered, tolerance, stop
        self._n_jobs, self._results = n_jobs, results
        self.taken = threading.Semaphore(0)
        self._intervals = iter(intervals)
        self._handed_out: list[Interval] = []
        # Thread-local in joblib, so it is asked for here, where the caller set it.
        self._backend = get_active_backend(prefer="threads")[0]
        self._in_threads = bool(getattr(self._backend, "supports_sharedmem", False))
        self._in_loky = type(self._backend).__name__ == "LokyBackend"

    def work(self) -> None:
        """Run everything; results, then None or the fault, go to the queue."""
        try:
            done = 0
            for revival in range(_REVIVALS + 1):
                try:
                    for pairs in self._run(done):
                        self._results.put(pairs)
                        done += 1
                    break
                except Exception as fault:
                    if revival == _REVIVALS or not _is_death_of_worker(fault) or self._stop[0]:
                        raise
            self._results.put(None)
        except BaseException as fault:  # noqa: BLE001 - handed over whole to the consumer
            self._results.put(fault)

    def _run(self, done: int) -> Iterator[IntervalPairs]:
        from joblib import Parallel, delayed, parallel_config

        stop = self._stop if self._in_threads else None

        def pending() -> Iterator[Interval]:
            yield from self._handed_out[done:]
            for interval in self._intervals:
                self._handed_out.append(interval)
                yield interval

        if self._n_jobs == 1 and self._in_threads:
            for interval in pending():
                yield find_pairs(self._ordered, interval, self._tolerance, self._stop)
                # The next one's basis takes the memory of these pairs, once they are written.
                self.taken.acquire()
            return
        with parallel_config(backend=self._backend), self._make_folder() as folder:
            jobs = (
                delayed(_find_pairs_alone)(self._ordered, interval, self._tolerance, stop, folder)
                for interval in pending()
            )
            parallel = Parallel(
                n_jobs=self._n_jobs, return_as="generator", pre_dispatch=self._n_jobs
            )
            for pairs, file in parallel(jobs):
                yield _with_rows(pairs, file)

    def _make_folder(self) -> AbstractContextManager[str | None]:
        """A folder for rows, where results would come through a pipe."""
        if not self._in_loky:
            return nullcontext()
        return tempfile.TemporaryDirectory(ignore_cleanup_errors=True)

    def abandon(self) -> None:
        """End worker processes at once; threads look at the stop flag."""
        if self._in_loky:
            from joblib.externals.loky import reusable_executor

            executor = reusable_executor._executor
            if executor is not None:
                executor.shutdown(wait=True, kill_workers=True)


def _find_pairs_alone(
    ordered: OrderedPencil,
    interval: Interval,
    tolerance: float,
    stop: StopFlag | None,
    folder: str | None,
) -> tuple[IntervalPairs, str | None]:
    """One slice, with one thread for linear algebra where it has the process to itself.

    With a folder, the rows are written to a file there and its name is returned beside the rest:
    loky waits for ever for the end of a result whose process was killed while sending it, unless
    the result fits into the pipe whole.
    """
    if stop is not None:
        return find_pairs(ordered, interval, tolerance, stop), None
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        pairs = find_pairs(ordered, interval, tolerance, np.zeros(1, dtype=np.uint8))
    if folder is None:
        return pairs, None
    with tempfile.NamedTemporaryFile(dir=folder, suffix=".npy", delete=False) as file:
        np.save(file, pairs.rows)
    return replace(pairs, rows=pairs.rows[:0].copy()), file.name


def _with_rows(pairs: IntervalPairs, file: str | None) -> IntervalPairs:
    """A slice with the rows that came in a file, which is removed."""
    if file is None:
        return pairs
    rows = np.load(file)
    os.unlink(file)
    return replace(pairs, rows=rows)


def _is_death_of_worker(fault: BaseException) -> bool:
    from concurrent.futures.process import BrokenProcessPool

    return isinstance(fault, BrokenProcessPool)
