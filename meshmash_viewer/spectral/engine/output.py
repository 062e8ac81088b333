"""Scaling, signs and orthogonality of final pairs, and progress reports.

The orthogonality of pairs of different slices is limited by their residuals and distance, so each
slice is orthogonalised against the slice below it, which is final.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError
from meshmash_viewer.progress import Progress, ProgressCallback
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.basis import BLOCK
from meshmash_viewer.spectral.engine.lanczos import usual_rows
from meshmash_viewer.spectral.engine.pairs import ReducedPairs
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.request import Request

#: Largest entry of an eigenvector in float32, with a margin for products.
_LARGEST_SINGLE = 1e30
#: Inner products of neighbouring slices above this are corrected.
_TOUCHING = 1e-11
#: Inner products with earlier slices above this are corrected.
_FAR = 1e-9
#: Correction of rows above which their orthonormality is measured again.
_SEEN = 1e-7
#: Reduced eigenvalues below this have residuals relative to 4π / area.
_ZERO = 1e-9
#: Number of random sums of all rows except the newest slice.
_MIXTURES = 8
#: Vertices processed at a time.
_CHUNK = 8192
#: Earlier rows processed at a time.
_KEPT = 128


class Output:
    """Arrays of a decomposition, filled from the lowest pair upwards.

    `rows`, shape (k, n_all), may begin with final rows (see `keep`); rows to be written have the
    vertex order of `pencil`. `ceiling` is the threshold, which rounded eigenvalues must not exceed.
    """

    def __init__(
        self, pencil: Pencil, rows: npt.NDArray[np.floating[Any]], ceiling: float | None
    ) -> None:
        self.pencil, self.rows, self.ceiling = pencil, rows, ceiling
        self.eigenvalues, self.residuals = np.zeros(len(rows)), np.zeros(len(rows))
        self.written = 0
        self.orthonormality = 0.0
        self._before = slice(0, 0)
        self._inverse_root_mass = 1.0 / pencil.root_mass
        self._random = np.random.default_rng(1)
        self._mixture = np.zeros((_MIXTURES, pencil.n_all))
        self.mass = np.zeros(pencil.n_all)
        self.mass[pencil.active] = pencil.root_mass**2

    @classmethod
    def allocate(cls, pencil: Pencil, request: Request, k: int, n_kept: int) -> Output:
        """Allocate the rows of k pairs; the first `n_kept` are the known pairs of the request."""
        smallest, largest = pencil.root_mass.min(), pencil.root_mass.max()
        if request.lean and not 1.0 / _LARGEST_SINGLE < smallest <= largest < _LARGEST_SINGLE:
            raise InputError(
                "beyond-floating-point",
                f"Masses from {smallest**2:.3g} to {largest**2:.3g} exceed the range of float32",
                "ask for float64, or scale the mesh",
            )
        if request.allocate is not None:
            rows = request.allocate(k, pencil.n_all, n_kept)
        else:
            rows = np.empty((k, pencil.n_all), dtype=request.precision)
            if n_kept and request.known is not None:
                rows[:n_kept] = request.known.rows[:n_kept]
        if rows.shape != (k, pencil.n_all):
            raise ValueError(f"{rows.shape} was allocated for {(k, pencil.n_all)}")
        return cls(pencil, rows, request.max_eigenvalue)

    @property
    def total(self) -> int:
        """Total number of pairs."""
        return len(self.eigenvalues)

    def leading(self, count: int) -> Eigenpairs:
        """Return the first pairs, which are final, with their orthonormality; rows are a view."""
        return Eigenpairs(
            self.eigenvalues[:count].copy(),
            self.rows[:count],
            self.residuals[:count].copy(),
            Certificate("none", orthonormality=self.orthonormality),
            total=self.total,
            mass=self.mass,
        )

    def write(self, pairs: ReducedPairs) -> slice:
        """Scale pairs of the reduced problem and append them; return the slice of their indices.

        The given residuals are in the reduced unit, not relative. The given rows are overwritten.
        """
        pencil = self.pencil
        count = min(len(pairs), self.total - self.written)
        pairs = pairs[:count]
        values, rows, orthonormality = pairs.values, pairs.rows, pairs.orthonormality
        place = slice(self.written, self.written + count)
        # Equal eigenvalues may descend by rounding: make them ascend.
        before = self.eigenvalues[self.written - 1] if self.written else -np.inf
        eigenvalues = np.maximum(np.maximum.accumulate(values * pencil.unit), before)
        if self.ceiling is not None:
            eigenvalues = np.minimum(eigenvalues, self.ceiling)
        self.eigenvalues[place] = eigenvalues
        residuals = pairs.residuals + np.abs(eigenvalues / pencil.unit - values)
        self.residuals[place] = residuals / np.where(values > _ZERO, values, 1.0)
        written = self.rows[place]

        for i, row in enumerate(rows):
            row *= self._inverse_root_mass
            if values[i] == 0.0:
                _level(row)
            written[i, pencil.active] = fix_sign(row, pencil.active)
        if pencil.n < pencil.n_all:
            written[:, self.mass == 0.0] = np.nan
        worst = self._agree(place)
        if orthonormality is None or self.rows.dtype != np.float64:
            orthonormality = self._defect(written)
        worst = max(worst, orthonormality)
        self.orthonormality = max(self.orthonormality, worst)
        self._before = place
        self.written += count
        return place

    def keep(self, known: Eigenpairs, stop: int) -> slice:
        """Accept the next rows of the array, known pairs up to an index, and return their slice.

        They are measured, except pairs of an unfinished run, which have been measured.
        """
        place = slice(self.written, stop)
        self.eigenvalues[place] = known.eigenvalues[place]
        self.residuals[place] = known.residuals[place]
        worst, begun = self._agree(place, final=True), known.certificate
        if begun.method == "none" and begun.orthonormality > 0.0:
            worst = begun.orthonormality
        else:
            worst = max(worst, self._defect(self.rows[place]))
        self.orthonormality = max(self.orthonormality, worst)
        self._before, self.written = place, stop
        return place

    def _separate(self, place: slice, at: slice) -> tuple[FloatArray, FloatArray]:
        """Orthogonalise new rows against final rows; return the remaining inner products."""
        written, others = self.rows[place], self.rows[at]
        shared, far = self._products(written, others)
        most = float(np.abs(shared).max(initial=0.0))
        if most > 0.5:
            raise ArithmeticError("two slices found the same eigenvector")
        if most > _TOUCHING and self.rows.dtype == np.float64:
            for part in blocks(len(self.mass), _CHUNK):
                written[:, part] -= shared @ self._finite(others[:, part])
            # The removed part belongs to eigenvectors of other eigenvalues.
            values = self.eigenvalues / self.pencil.unit
            moved = (np.abs(shared) * np.abs(values[place, None] - values[at])).sum(axis=1)
            self.residuals[place] += moved / np.where(values[place] > _ZERO, values[place], 1.0)
            if most > _SEEN:
                self.orthonormality = max(self.orthonormality, self._defect(written))
            active = self.pencil.active
            for row in written:
                row[active] = fix_sign(row[active], active)
            shared, far = self._products(written, others)
        return shared, far

    def _agree(self, place: slice, final: bool = False) -> float:
        """Orthogonalise rows against the slice before; return the largest remaining inner product.

        `final` rows are only measured. Products with eight random sums of all earlier rows estimate
        the norm of the products with the rows, an upper bound of the largest. Rows are
        orthogonalised against earlier slices too if hundreds of eigenvalues are nearly equal.
        """
        written, before = self.rows[place], self.rows[self._before]
        if len(before) == 0 or len(written) == 0:
            return 0.0
        if final:
            shared, far = self._products(written, before)
        else:
            shared, far = self._separate(place, self._before)
            if _largest(far) > _FAR:
                for earlier in blocks(self._before.start, _KEPT):
                    self._separate(place, earlier)
                shared, far = self._products(written, before)
        signs = self._random.choice([-1.0, 1.0], size=(_MIXTURES, len(before)))
        for part in blocks(len(self.mass), _CHUNK):
            self._mixture[:, part] += signs @ self._finite(before[:, part])
        return max(float(np.abs(shared).max()), _largest(far))

    def _products(
        self, written: npt.NDArray[np.floating[Any]], before: npt.NDArray[np.floating[Any]]
    ) -> tuple[FloatArray, FloatArray]:
        """Compute inner products of rows with `before`, and with the sums of earlier rows."""
        shared = np.zeros((len(written), len(before)))
        far = np.zeros((len(written), _MIXTURES))
        for part in blocks(len(self.mass), _CHUNK):
            weighted = self._finite(written[:, part]) * self.mass[part]
            shared += weighted @ self._finite(before[:, part]).T
            far += weighted @ self._mixture[:, part].T
        return shared, far

    def _defect(self, written: npt.NDArray[np.floating[Any]]) -> float:
        """Compute the largest defect of the inner products among rows."""
        gram = self._products(written, written)[0]
        return float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))

    def _finite(self, rows: npt.NDArray[np.floating[Any]]) -> FloatArray:
        """Return rows in float64, zero where a vertex has no mass."""
        exact: FloatArray = np.asarray(rows, dtype=np.float64)
        if self.pencil.n < self.pencil.n_all:
            exact = np.nan_to_num(exact)
        return exact


def _largest(far: FloatArray) -> float:
    """Estimate the largest norm of a row's inner products from its products with random sums."""
    return float(np.linalg.norm(far, axis=1).max() / _MIXTURES**0.5)


def _level(row: FloatArray) -> None:
    """Make nonzero entries that are equal within rounding exactly equal, in place.

    On stiff meshes the rounding of the entries of a constant would cause a large residual.
    """
    used = np.flatnonzero(row)
    entries = row[used]
    if len(used) and np.ptp(entries) <= 8.0 * np.finfo(np.float64).eps * abs(entries[0]):
        row[used] = entries[0]


def fix_sign(row: FloatArray, places: npt.NDArray[np.int64]) -> FloatArray:
    """Flip the sign of a row in place so that its entry of largest magnitude is positive.

    Among entries whose magnitudes agree to 1e-6 the first vertex of the mesh decides, independently
    of rounding; `places` are the indices of vertices in the mesh.
    """
    highest, lowest = float(row.max(initial=0.0)), float(row.min(initial=0.0))
    near = (1.0 - 1e-6) * max(highest, -lowest)
    is_flipped = highest < near
    if highest >= near and -lowest >= near:
        leading = np.flatnonzero(np.abs(row) >= near)
        is_flipped = row[leading[np.argmin(places[leading])]] <= 0.0
    if is_flipped:
        np.negative(row, out=row)
    return row


#: Time before each stage, in steps of an iteration: measured on meshes of 50 to 420 thousand
#: vertices.
_BEFORE = {"matrices": 0.0, "order": 18.0, "eigenpairs": 32.0}
#: Steps of a slice relative to the usual number, and time to rotate, refine, measure and write its
#: pairs relative to the time of its steps.
_OVER, _END = 1.26, 0.26
#: Minimum seconds between two reports without new pairs.
_INTERVAL = 0.1
#: Messages of stages before pairs are found.
_MESSAGES = {
    "matrices": "Preparing the solver (the first run after an installation compiles it)",
    "order": "Factoring and counting eigenvalues",
}


class Pace:
    """Progress reports of a run.

    `pairs` is the estimated number of pairs; `sizes` returns the number of pairs of each slice for
    a total number.
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
        """Start the last stage, the slices, which have a number of pairs in total."""
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
        # The final work on a slice has no steps: it is counted when its pairs are final.
        found = max(done - (total - self._pairs), 0) if self._is_sliced else 0
        ended = min(found / max(self._pairs, 1), 1.0)
        taken = min(steps, self._steps) + _END * self._steps * ended
        whole = _BEFORE["eigenpairs"] + (1.0 + _END) * self._steps
        fraction = 1.0 if total and done == total else (_BEFORE[self._stage] + taken) / whole
        if fraction > self._fraction:  # never decrease it, nor delay the estimated end
            self._fraction = fraction
            self._end = self.began + (now - self.began) / fraction
        left = max(self._end - now, 0.0)
        # no estimate if the estimated end has passed
        remaining = left if self._fraction == 1.0 or (self._fraction and left) else None
        message = f"{done:,} of {total:,} eigenpairs" if total else _MESSAGES[self._stage]
        self._progress(Progress(self._stage, self._fraction, remaining, message, done, total))
