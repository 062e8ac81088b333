"""Reuse of the lowest pairs from an earlier run: their verification, and where to continue."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.factorization import FactorizationError, OrderedPencil
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.plan import SpectrumPlan
from meshmash_viewer.spectral.engine.refinement import measure_pairs

#: Largest residual, relative to the eigenvalue, of an accepted pair.
_RESIDUAL = 1e-6
#: Rows measured at a time.
_ROWS = 32
#: Number of last known pairs among which the widest gap is chosen as border.
_TAIL = 16
#: Relative distance below which neighbouring eigenvalues are equal.
_EQUAL = 1e-7
#: Smallest share of the norm of a known row that lies in the span of its slice.
_INSIDE = 1.0 - 1e-6


class KnownPairs:
    """The lowest pairs from an earlier run; `values` are eigenvalues in the reduced problem."""

    def __init__(self, given: Eigenpairs, pencil: Pencil) -> None:
        self.given = given
        self._pencil = pencil
        self.values = given.eigenvalues / pencil.unit

    @classmethod
    def of_shape(cls, given: Eigenpairs | None, pencil: Pencil) -> KnownPairs | None:
        """Return pairs whose shape, dtype and null space are those of a problem, else None."""
        if given is None or given.rows.dtype != np.float64 or given.rows.shape[1] != pencil.n_all:
            return None
        known, null = cls(given, pencil), pencil.null_rows(len(given.eigenvalues))
        alike = np.allclose(known.rows(0, len(null)), null, rtol=0.0, atol=1e-9)
        return known if len(known.values) and alike else None

    @classmethod
    def verified(cls, given: Eigenpairs | None, ordered: OrderedPencil) -> KnownPairs | None:
        """Return known pairs if each of them solves a problem, else None."""
        known = cls.of_shape(given, ordered.pencil)
        if known is None:
            return None
        count = len(known.values)
        for part in blocks(count, _ROWS, ordered.pencil.n_null):
            rows = known.rows(part.start, part.stop)
            values, residuals = measure_pairs(ordered, rows)
            limit = _RESIDUAL * np.maximum(values, 1e-3)
            unit = (np.abs(np.linalg.norm(rows, axis=1) - 1.0) < 1e-6).all()
            # Written so that NaN fails as well.
            small = (residuals <= limit) & (np.abs(values - known.values[part]) <= limit)
            if not (unit and small.all()):
                return None
        return known

    def agrees_with(self, values: FloatArray) -> bool:
        """Whether the first eigenvalues are equal to others, except for rounding."""
        m = min(len(values), len(self.values))
        limit = _RESIDUAL * np.maximum(np.abs(values[:m]), 1e-3)
        return bool((np.abs(values[:m] - self.values[:m]) <= limit).all())

    def rows(self, start: int, stop: int) -> FloatArray:
        """Return rows in the reduced problem, shape (p, n)."""
        found = np.asarray(self.given.rows[start:stop], dtype=np.float64)
        return np.ascontiguousarray(found[:, self._pencil.active]) * self._pencil.root_mass

    def border(self, plan: SpectrumPlan, count: int) -> float | None:
        """Return a value in a wide gap near the end of the first `count` pairs; 0 without one.

        All copies of a multiple eigenvalue are above it. None if a count there, or below the last
        pair and its copies, contradicts the indices of the known pairs.
        """
        values, n_null = self.values[:count], self._pencil.n_null
        index = np.arange(n_null + 1, count)
        gaps = values[index] - values[index - 1]
        wide = np.flatnonzero(gaps > _EQUAL * values[index])
        if len(wide) == 0:
            return 0.0
        try:
            below_last = plan.settle(float(values[-1]), -1.0, wide=True)
            if plan.count(below_last) != index[wide[-1]]:
                return None
            last = wide[wide >= len(index) - _TAIL] if wide[-1] >= len(index) - _TAIL else wide[-1:]
            at = index[last[np.argmax(gaps[last])]]
            border = plan.settle(0.5 * float(values[at - 1] + values[at]))
        except FactorizationError:
            return None
        return border if border < values[at] and plan.count(border) == at else None

    def complement(
        self, start: int, stop: int, values: FloatArray, rows: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the pairs of a slice other than the known ones in it, which have some indices.

        Of all m pairs of the slice, `rows` of shape (m, n), these are the orthogonal complement,
        ascending. `ArithmeticError` is raised if a known pair does not lie in the slice.
        """
        inner = rows @ self.rows(start, stop).T
        left, sizes, _ = np.linalg.svd(inner, full_matrices=True)
        if sizes.min(initial=1.0) < _INSIDE:
            raise ArithmeticError("a known eigenvector does not lie in the slice of its eigenvalue")
        rest = left[:, stop - start :]
        found, rotation = np.linalg.eigh(rest.T @ (values[:, None] * rest))
        return found, np.asarray((rest @ rotation).T @ rows)
