"""Progress reports of a run, with an estimate of the time left."""

from __future__ import annotations

import time
from collections.abc import Callable

from meshmash_viewer.progress import Progress, ProgressCallback
from meshmash_viewer.spectral.engine.basis import BLOCK
from meshmash_viewer.spectral.engine.lanczos import usual_rows

#: Time before each stage, in steps of an iteration: measured on meshes of 50 to 420 thousand
#: vertices (`benchmarks/progress.py` measures the accuracy).
_BEFORE = {"matrices": 0.0, "order": 18.0, "eigenpairs": 32.0}
#: Steps of a slice relative to the usual number, and time after them relative to these steps, in
#: which its pairs are rotated, refined, measured and written.
_OVER, _END = 1.26, 0.26
#: Minimum seconds between two reports without new pairs.
_INTERVAL = 0.1
#: Messages of stages before pairs are found.
_MESSAGES = {
    "matrices": "Preparing the solver (the first run after an installation compiles it)",
    "order": "Factoring and counting eigenvalues",
}


class Pace:
    """Progress reports of a run, from its steps until the first pairs are final.

    `pairs` is the estimated number of pairs; `sizes` returns, for a number of pairs, the numbers in
    each slice.
    """

    def __init__(
        self, progress: ProgressCallback | None, pairs: int, sizes: Callable[[int], list[float]]
    ) -> None:
        self.began = self._reported = self._end = time.perf_counter()
        self._progress = progress
        self._sizes = sizes
        self._fraction = 0.0
        self._stage, self._done, self._total = "matrices", 0, 0
        self.begin_slices(pairs)
        self._is_sliced = False

    def begin_slices(self, pairs: int) -> None:
        """Start the last stage: slices with so many pairs."""
        self._pairs, self._is_sliced = pairs, True
        self._steps = _OVER * sum(usual_rows(size) for size in self._sizes(pairs)) / BLOCK

    def stage(self, name: str) -> None:
        """Report the start of a stage before pairs are found."""
        self._stage = name
        self._report(0)

    def pairs(self, done: int, total: int, steps: int) -> None:
        """Report the number of final pairs, after a number of steps in slices."""
        self._stage, self._done, self._total = "eigenpairs", done, total
        self._report(steps)

    def step(self, steps: int) -> None:
        """Report a number of steps in slices without new pairs."""
        if time.perf_counter() > self._reported + _INTERVAL:
            self._report(steps)

    def _report(self, steps: int) -> None:
        if self._progress is None:
            return
        now = self._reported = time.perf_counter()
        done, total = self._done, self._total
        # The end of a slice has no steps: it is complete when its pairs are final.
        found = max(done - (total - self._pairs), 0) if self._is_sliced else 0
        ended = min(found / max(self._pairs, 1), 1.0)
        taken = min(steps, self._steps) + _END * self._steps * ended
        whole = _BEFORE["eigenpairs"] + (1.0 + _END) * self._steps
        fraction = 1.0 if total and done == total else (_BEFORE[self._stage] + taken) / whole
        if fraction > self._fraction:  # it never decreases, nor is the estimated end moved later
            self._fraction = fraction
            self._end = self.began + (now - self.began) / fraction
        left = max(self._end - now, 0.0)
        # an estimated end that has passed says nothing
        remaining = left if self._fraction == 1.0 or (self._fraction and left) else None
        message = f"{done:,} of {total:,} eigenpairs" if total else _MESSAGES[self._stage]
        self._progress(Progress(self._stage, self._fraction, remaining, message, done, total))
