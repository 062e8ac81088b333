"""Pairs of the reduced problem, the one form in which the engine passes them on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray


@dataclass(frozen=True)
class Interval:
    """An interval of the spectrum with the number of its eigenvalues."""

    #: Ends, in the unit of the reduced problem.
    low: float
    high: float
    #: Number of eigenvalues below `low`, null space included.
    first: int
    #: Number of eigenvalues inside, the null space not counted.
    n_expected: int
    #: Shift of the factorization, near the middle.
    shift: float
    #: Smallest distance of an eigenvalue from `high` at which the count is reliable.
    clearance: float = 0.0
    #: Number of lowest pairs to return; None for all pairs.
    most: int | None = None


@dataclass(frozen=True, eq=False)
class ReducedPairs:
    """Pairs of the reduced problem, of which `pairs[some]` selects some by a slice or indices."""

    #: Shape (p,): Rayleigh quotients, ascending up to rounding.
    values: FloatArray
    #: Shape (p, n): Orthonormal, in the order of the vertices of the pencil.
    rows: FloatArray
    #: Shape (p,): ``‖Lφ - λMφ‖ / ‖Mφ‖`` in the reduced unit; empty if not measured.
    residuals: FloatArray = field(default_factory=lambda: np.zeros(0))
    #: Largest defect of the rows' inner products, if it has been measured.
    orthonormality: float | None = None
    #: Where the pairs were found, if they are all of an interval or the lowest of them.
    interval: Interval | None = None

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, some: slice | npt.NDArray[np.intp]) -> ReducedPairs:
        residuals = self.residuals[some] if len(self.residuals) else self.residuals
        return replace(self, values=self.values[some], rows=self.rows[some], residuals=residuals)


def joined(parts: Sequence[ReducedPairs]) -> ReducedPairs:
    """Return the pairs of several parts, which must be orthogonal to each other."""
    return ReducedPairs(
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.rows for part in parts]),
        np.concatenate([part.residuals for part in parts]),
        max((part.orthonormality or 0.0 for part in parts), default=0.0),
    )
