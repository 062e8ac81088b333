"""Reuse of pairs from an earlier run: their verification, and the ranges that are missing."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.spectral.engine.factorization import FactorizationError, OrderedPencil
from meshmash_viewer.spectral.engine.lanczos import measure_pairs
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.plan import SpectrumPlan

FloatArray = npt.NDArray[np.float64]

#: Largest residual, relative to the eigenvalue, of an accepted pair.
_RESIDUAL = 1e-6
#: Rows measured at a time.
_ROWS = 32
#: Number of known pairs next to missing ones among which the widest gap is chosen as border.
_TAIL = 16
#: Relative distance below which neighbouring eigenvalues are equal.
_EQUAL = 1e-7
#: Smallest share of the norm of a known row that lies in the span of its slice.
_INSIDE = 1.0 - 1e-6


class KnownPairs:
    """Pairs of an earlier run, by their index in the spectrum.

    Parameters
    ----------
    given : Decomposition
        An eigenvalue of NaN marks a missing pair.
    pencil : Pencil

    Attributes
    ----------
    mask : ndarray of bool, shape (m,)
        Whether a pair is known.
    values : ndarray of float64, shape (m,)
        Eigenvalues in the reduced problem.
    """

    def __init__(self, given: Any, pencil: Pencil) -> None:
        self.given = given
        self._pencil = pencil
        self.mask = np.isfinite(given.eigenvalues)
        self.values = given.eigenvalues / pencil.unit

    @classmethod
    def of_shape(cls, given: Any, pencil: Pencil) -> KnownPairs | None:
        """Return pairs whose arrays have the shape and dtype of a problem, else None."""
        if given is None or given.rows.dtype != np.float64 or given.rows.shape[1] != pencil.n_all:
            return None
        known = cls(given, pencil)
        return known if known.mask.any() else None

    def has_null_rows(self) -> bool:
        """Whether the known rows of the null space are the constants."""
        null = np.flatnonzero(self.mask[: self._pencil.n_null])
        if len(null) == 0:
            return True
        rows = self._pencil.null_rows(int(null[-1]) + 1)[null]
        return bool(np.allclose(self.rows(null), rows, rtol=0.0, atol=1e-9))

    @staticmethod
    def equal(values: FloatArray) -> bool:
        """Whether ``values[0]`` and ``values[1]`` are equal except for rounding."""
        size = np.maximum(np.abs(values[1]), 1e-3)
        return bool((np.abs(values[1] - values[0]) <= _RESIDUAL * size).all())

    def kept(self, count: int) -> npt.NDArray[np.bool_]:
        """Return which of the first `count` pairs are known, shape (count,)."""
        kept = np.zeros(count, dtype=bool)
        kept[: len(self.mask)] = self.mask[:count]
        return kept

    def rows(self, indices: npt.NDArray[np.int64]) -> FloatArray:
        """Return rows in the reduced problem, shape (p, n)."""
        found = np.asarray(self.given.rows[indices], dtype=np.float64)
        return np.ascontiguousarray(found[:, self._pencil.active]) * self._pencil.root_mass

    def missing_ranges(
        self, plan: SpectrumPlan, n_expected: int, top: float
    ) -> list[tuple[float, float]] | None:
        """Return ranges of the spectrum below `top` that contain all missing pairs, lowest first.

        Their borders lie in gaps between known pairs. So a range may contain a few of these as
        well, and all copies of a multiple eigenvalue are in one range. None if a count contradicts
        the indices of the known pairs.
        """
        total, n_null = plan.count(top), self._pencil.n_null
        missing = np.flatnonzero(~self.kept(n_expected))
        missing = missing[missing >= n_null]
        if n_expected < total:  # the count proves the last pairs only if all counted ones are found
            missing = np.append(missing, n_expected)
        found: list[tuple[float, float]] = []
        for part in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1):
            if len(part) == 0:
                continue
            if not self._are_lowest(plan, int(part[0]) - 1):
                return None
            values = self.values[:n_expected]  # above them the end is `top`
            low = self._border(values, int(part[0]), -1)
            high = self._border(values, int(part[-1]) + 1, 1)
            ends = []
            for index, otherwise in ((low, 0.0), (high, top)):
                end = otherwise if index is None else self._between(plan, index)
                if end is None:
                    return None
                ends.append(end)
            begin, end = ends
            if found and begin < found[-1][1]:
                begin, before = found.pop()
                end = max(end, before)
            found.append((begin, end))
        return found

    def _are_lowest(self, plan: SpectrumPlan, last: int) -> bool:
        """Whether the count below a known pair and its copies agrees with its index."""
        first = last
        while first > self._pencil.n_null and self.kept(last + 1)[first - 1]:
            if self.values[first - 1] < self.values[last] * (1.0 - _EQUAL):
                break
            first -= 1
        if first <= self._pencil.n_null or not self.kept(first)[first - 1]:
            return True  # no known pair to compare with
        try:
            below = plan.settle(float(self.values[last]), -1.0, wide=True)
        except FactorizationError:
            return False
        return plan.count(below) == first

    def _between(self, plan: SpectrumPlan, index: int) -> float | None:
        """Return a value between a known pair and the one before, if the count there agrees."""
        below, above = self.values[index - 1], self.values[index]
        try:
            border = plan.settle(0.5 * float(below + above))
        except FactorizationError:
            return None
        return border if border < above and plan.count(border) == index else None

    def _border(self, values: FloatArray, index: int, direction: int) -> int | None:
        """Return the known pair above the widest gap near an index in one direction, or None."""
        widest, best, n_examined = 0.0, None, 0
        # Continue while all are equal, as eigenvalues of equal components may be.
        while n_examined < _TAIL or best is None:
            index += direction
            if not self._pencil.n_null < index < len(values):
                break
            n_examined += 1
            gap = float(values[index] - values[index - 1])
            # NaN next to a missing pair, for which the comparison is false.
            if gap > max(widest, _EQUAL * float(values[index])):
                widest, best = gap, index
        return best

    def complement(
        self, indices: npt.NDArray[np.int64], values: FloatArray, rows: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the pairs of a slice other than the known ones in it.

        Parameters
        ----------
        indices : ndarray of int, shape (p,)
            Indices of the known pairs.
        values, rows : ndarray, shape (m,) and (m, n)
            All pairs of the slice, in the reduced problem.

        Returns
        -------
        values, rows : ndarray, shape (m - p,) and (m - p, n)
            Pairs of the orthogonal complement, ascending.

        Raises
        ------
        ArithmeticError
            If a known pair does not lie in the slice.
        """
        inner = rows @ self.rows(indices).T
        left, sizes, _ = np.linalg.svd(inner, full_matrices=True)
        if sizes.min(initial=1.0) < _INSIDE:
            raise ArithmeticError("a known eigenvector does not lie in the slice of its eigenvalue")
        rest = left[:, len(indices) :]
        found, rotation = np.linalg.eigh(rest.T @ (values[:, None] * rest))
        return found, np.asarray((rest @ rotation).T @ rows)


def verified_pairs(given: Any, ordered: OrderedPencil) -> KnownPairs | None:
    """Return known pairs if there are any and each of them solves this problem, else None."""
    known = KnownPairs.of_shape(given, ordered.pencil)
    if known is None or not known.has_null_rows():
        return None
    indices = np.flatnonzero(known.mask)
    above = int(np.searchsorted(indices, ordered.pencil.n_null))
    for start in range(above, len(indices), _ROWS):
        part = indices[start : start + _ROWS]
        rows = known.rows(part)
        sizes = np.linalg.norm(rows, axis=1)
        if not (np.abs(sizes - 1.0) < 1e-6).all():
            return None
        values, residuals = measure_pairs(ordered, rows)
        limit = _RESIDUAL * np.maximum(values, 1e-3)
        if (residuals > limit).any() or (np.abs(values - known.values[part]) > limit).any():
            return None
    return known
