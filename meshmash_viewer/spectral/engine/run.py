"""Control of one decomposition: threads, reports and results."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.cost import slice_sizes
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.compiler import one_blas_thread
from meshmash_viewer.spectral.engine.computation import Computation
from meshmash_viewer.spectral.engine.output import Output, Pace
from meshmash_viewer.spectral.engine.pencil import reduce_pencil
from meshmash_viewer.spectral.engine.request import Request

#: Number of pairs assumed for progress reports before it is known.
_USUAL_PAIRS = 80
#: Seconds between two calls of `cancel`.
_INTERVAL = 0.05


class Run:
    """The run of a request: one thread computes, and the calling one reports.

    `InputError` is raised if the matrices are invalid.
    """

    def __init__(self, stiffness: Any, mass: Any, request: Request) -> None:
        self._request = request
        n = max(np.shape(stiffness), default=0)
        sizes = partial(slice_sizes, n, lean=request.lean, early=request.early)
        self._pace = Pace(request.progress, request.n_components or _USUAL_PAIRS, sizes)
        pencil = reduce_pencil(stiffness, mass)
        # Events from the computing thread to the waiting one: slices of final rows, reports to
        # be made, at the end an exception or None.
        self._events: queue.Queue[slice | Callable[[], None] | BaseException | None]
        self._events = queue.Queue()
        self._computation = Computation(pencil, request, self._pace, sizes, self._events.put)
        self._computation.timings["matrices"] = time.perf_counter() - self._pace.began

    @property
    def output(self) -> Output:
        """Results so far."""
        return self._computation.output

    def pairs(self) -> Eigenpairs:
        """Compute and return all pairs, with their certificate."""
        for _ in self.batches():
            pass
        output, certificate = self.output, self._computation.certificate()
        if output.written != output.total:
            raise ArithmeticError(f"{output.written} of {output.total} eigenpairs found")
        seconds = time.perf_counter() - self._pace.began
        return replace(
            output.leading(output.total),
            rows=output.rows,
            certificate=certificate,
            timings={**self._computation.timings, "total": seconds},
            known_to=(self._request.max_eigenvalue or 0.0) if certificate.complete else 0.0,
        )

    def batches(self) -> Generator[slice, None, None]:
        """Compute all pairs; yield slices of rows when they become final.

        Another thread computes, so that this one can report progress and call `cancel`.
        """
        finder = threading.Thread(target=self._find, name="eigenpairs", daemon=True)
        self._pace.stage("matrices")
        with one_blas_thread():
            finder.start()
            try:
                while True:
                    self._poll()
                    try:
                        event = self._events.get(timeout=_INTERVAL)
                    except queue.Empty:
                        continue
                    if event is None:
                        return
                    if isinstance(event, BaseException):
                        try:
                            raise event
                        finally:
                            del event  # its traceback would keep all memory alive
                    if isinstance(event, slice):
                        self._publish(event)
                        yield event
                    else:
                        event()
            finally:
                self._computation.leave()
                finder.join()

    def _find(self) -> None:
        """Compute, in the other thread."""
        try:
            with one_blas_thread():
                for place in self._computation.batches():
                    self._events.put(place)
            self._events.put(None)
        except BaseException as fault:  # noqa: BLE001 - raised in the waiting thread
            if not self._computation.is_left:
                self._events.put(fault)

    def _publish(self, place: slice) -> None:
        """Report pairs that are final."""
        output = self.output
        if self._request.on_pairs is not None:
            self._request.on_pairs(output.leading(place.stop))
        self._pace.pairs(place.stop, output.total, self._computation.steps)

    def _poll(self) -> None:
        if self._request.cancel is not None and self._request.cancel():
            raise Cancelled("the decomposition was cancelled")
        self._pace.step(self._computation.steps)
