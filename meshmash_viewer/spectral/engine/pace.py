"""How far a run is, and when it will end, told to whoever waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable

from meshmash_viewer.progress import Progress, ProgressCallback
from meshmash_viewer.spectral.engine.basis import BLOCK
from meshmash_viewer.spectral.engine.lanczos import usual_rows

#: What matrices and order take, and the counts, in steps of an iteration: measured on meshes of 50
#: to 420 thousand vertices (`benchmarks/progress.py` shows how well it is told).
_MATRICES, _COUNTS = 18.0, 14.0
#: Steps that a slice takes over the usual ones, and what follows on them, in parts of them: its
#: pairs are rotated, refined, measured and written. Its factor is mostly there from the counts.
#: These and the next two are where told and true times fit best on the meshes of the benchmark.
_OVER, _END = 1.26, 0.26
#: Power of the steps left by which time is left: they grow dearer with their basis.
_DEARER = 1.12
#: Steps after which their own pace says when the run will end.
_TELLING = 16.0
#: Seconds between two reports that nothing but time has brought about.
_INTERVAL = 0.25
#: What is said of stages in which no pairs are counted yet.
_MESSAGES = {
    "matrices": "Preparing the solver (the first run after an installation compiles it)",
    "order": "Factoring and counting eigenvalues",
}


class Pace:
    """Reports of a run, from its steps before the first pairs are there.

    Parameters
    ----------
    progress : callable, optional
        Takes the reports.
    pairs : int
        How many are expected, until it is known.
    sizes : callable
        Gives, for a number of pairs, how many each slice is to hold.
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
        self._heard = self._end = self.began
        self._slices_began: float | None = None

    def _steps_for(self, pairs: int) -> float:
        rows = [usual_rows(size) for size in self._sizes(pairs)]
        return _OVER * (1.0 + _END) * sum(rows) / BLOCK

    def begin_slices(self, pairs: int) -> None:
        """What is left are slices with so many pairs."""
        self._pairs, self._expected = pairs, self._steps_for(pairs)
        self._slices_began = time.perf_counter()

    def stage(self, name: str) -> None:
        """The first stages, in which no pairs are found."""
        if name == "order":
            self._before = _MATRICES
        self._report(name, 0, 0, 0)

    def pairs(self, done: int, total: int, steps: int) -> None:
        """So many pairs are final, after so many steps in slices."""
        self._before = _MATRICES + _COUNTS
        self._report("eigenpairs", done, total, steps)

    def step(self, steps: int) -> None:
        """Nothing new but steps in slices."""
        if self._last is not None and time.perf_counter() > self._heard + _INTERVAL:
            self._report(self._last.stage, self._last.converged, self._last.total, steps)

    def _report(self, stage: str, done: int, total: int, steps: int) -> None:
        if self._progress is None:
            return
        now = self._heard = time.perf_counter()
        # The end of a slice has no steps: it is over where its pairs are there.
        sliced = total and self._slices_began is not None  # a null space comes before
        found = max(done - (total - self._pairs), 0) / max(self._pairs, 1) if sliced else 0.0
        taken = min(steps + found * self._expected * _END / (1.0 + _END), self._expected)
        if taken > _TELLING and self._slices_began is not None:
            if taken > self._taken:
                spent = now - self._slices_began
                self._end = self._slices_began + spent * (self._expected / taken) ** _DEARER
            remaining = max(self._end - now, 0.075 * (now - self.began))
            fraction = (now - self.began) / (now - self.began + remaining)
        else:
            fraction = (self._before + taken) / (_MATRICES + _COUNTS + self._expected)
            remaining = None
            if fraction:
                # A stage that says nothing meanwhile is no reason to expect more of the next ones.
                if self._before + taken > self._done:
                    self._done = self._before + taken
                    self._end = self.began + (now - self.began) / fraction
                remaining = max(self._end - now, 0.0)
        self._taken = max(taken, self._taken)
        if total and done == total:
            fraction, remaining = 1.0, 0.0
        # A bar never runs backwards.
        fraction = self._fraction = max(fraction, self._fraction)
        message = f"{done} of {total} eigenpairs" if total else _MESSAGES.get(stage, stage)
        self._last = Progress(stage, fraction, remaining, message, done, total)
        self._progress(self._last)
