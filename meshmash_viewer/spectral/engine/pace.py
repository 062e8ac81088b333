"""Progress reports of a run, with an estimate of the time left."""

from __future__ import annotations

import time
from collections.abc import Callable

from meshmash_viewer.progress import Progress, ProgressCallback
from meshmash_viewer.spectral.engine.basis import BLOCK
from meshmash_viewer.spectral.engine.lanczos import usual_rows

#: Time of the stages matrices and order, and of counting, in steps of an iteration: measured on
#: meshes of 50 to 420 thousand vertices (`benchmarks/progress.py` measures the accuracy).
_MATRICES, _COUNTS = 18.0, 14.0
#: Steps of a slice relative to the usual number, and time after them relative to these steps, in
#: which its pairs are rotated, refined, measured and written. (Its factor is mostly known from the
#: counts.) These and the next two are fitted to measured times on the meshes of the benchmark.
_OVER, _END = 1.26, 0.26
#: Exponent of the time as a function of the steps: they take longer with a larger basis.
_GROWTH = 1.12
#: Number of steps after which the time left is extrapolated from them.
_MIN_STEPS = 16.0
#: Minimum seconds between two reports without new pairs.
_INTERVAL = 0.25
#: Messages of stages before pairs are found.
_MESSAGES = {
    "matrices": "Preparing the solver (the first run after an installation compiles it)",
    "order": "Factoring and counting eigenvalues",
}


class Pace:
    """Progress reports of a run, from its steps until the first pairs are final.

    Parameters
    ----------
    progress : callable, optional
        Receives the reports.
    pairs : int
        Estimated number of pairs.
    sizes : callable
        Returns, for a number of pairs, the numbers in each slice.
    """

    def __init__(
        self, progress: ProgressCallback | None, pairs: int, sizes: Callable[[int], list[float]]
    ) -> None:
        self.began = time.perf_counter()
        self._progress = progress
        self._sizes = sizes
        self._pairs, self._expected = pairs, self._steps_for(pairs)
        self._before = self._done = self._taken = self._fraction = 0.0
        self._last: Progress | None = None
        self._reported = self._end = self.began
        self._slices_began: float | None = None

    def _steps_for(self, pairs: int) -> float:
        rows = [usual_rows(size) for size in self._sizes(pairs)]
        return _OVER * (1.0 + _END) * sum(rows) / BLOCK

    def begin_slices(self, pairs: int) -> None:
        """Start the last stage: slices with so many pairs."""
        self._pairs, self._expected = pairs, self._steps_for(pairs)
        self._slices_began = time.perf_counter()

    def stage(self, name: str) -> None:
        """Report the start of a stage before pairs are found."""
        if name == "order":
            self._before = _MATRICES
        self._report(name, 0, 0, 0)

    def pairs(self, done: int, total: int, steps: int) -> None:
        """Report the number of final pairs, after a number of steps in slices."""
        self._before = _MATRICES + _COUNTS
        self._report("eigenpairs", done, total, steps)

    def step(self, steps: int) -> None:
        """Report a number of steps in slices without new pairs."""
        if self._last is not None and time.perf_counter() > self._reported + _INTERVAL:
            self._report(self._last.stage, self._last.converged, self._last.total, steps)

    def _report(self, stage: str, done: int, total: int, steps: int) -> None:
        if self._progress is None:
            return
        now = self._reported = time.perf_counter()
        # The end of a slice has no steps: it is complete when its pairs are final.
        sliced = total and self._slices_began is not None  # after the null space
        found = max(done - (total - self._pairs), 0) / max(self._pairs, 1) if sliced else 0.0
        taken = min(steps + found * self._expected * _END / (1.0 + _END), self._expected)
        if taken > _MIN_STEPS and self._slices_began is not None:
            if taken > self._taken:
                spent = now - self._slices_began
                self._end = self._slices_began + spent * (self._expected / taken) ** _GROWTH
            remaining = max(self._end - now, 0.075 * (now - self.began))
            fraction = (now - self.began) / (now - self.began + remaining)
        else:
            fraction = (self._before + taken) / (_MATRICES + _COUNTS + self._expected)
            remaining = None
            if fraction:
                # Without a new report the estimate is not increased.
                if self._before + taken > self._done:
                    self._done = self._before + taken
                    self._end = self.began + (now - self.began) / fraction
                remaining = max(self._end - now, 0.0)
        self._taken = max(taken, self._taken)
        if total and done == total:
            fraction, remaining = 1.0, 0.0
        # The fraction never decreases.
        fraction = self._fraction = max(fraction, self._fraction)
        message = f"{done} of {total} eigenpairs" if total else _MESSAGES.get(stage, stage)
        self._last = Progress(stage, fraction, remaining, message, done, total)
        self._progress(self._last)
