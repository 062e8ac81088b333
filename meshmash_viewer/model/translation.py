"""Count, largest eigenvalue and wavelength, each in terms of the others.

Where eigenpairs are known the answer is exact; beyond them Weyl's law goes on from the last one,
with its slope but not its error so far, which along thin branches is a factor of ten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from meshmash_viewer.weyl import Target, wavelength, weyl_count, weyl_eigenvalue

__all__ = ["Translation"]


@dataclass(frozen=True, eq=False)
class Translation:
    """How many eigenvalues a mesh has up to where.

    Parameters
    ----------
    area : float
        Of the surface, positive, in squared length units.
    eigenvalues : ndarray of float64, shape (k,)
        Those known, ascending and complete from the first; empty where none are.
    """

    area: float
    eigenvalues: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def eigenvalue(self, target: Target) -> tuple[float, bool]:
        """Largest eigenvalue that a target asks for, and whether that is exact."""
        bound = target.max_eigenvalue
        if bound is not None:
            return bound, True
        count, known = int(target.value), len(self.eigenvalues)
        if count <= known:
            return max(float(self.eigenvalues[count - 1]), 0.0), True
        return self._last + weyl_eigenvalue(self.area, count - known), False

    def wavelength(self, target: Target) -> tuple[float, bool]:
        """Shortest wavelength that a target asks for, and whether that is exact."""
        if target.kind == "wavelength":
            return float(target.value), True
        eigenvalue, exact = self.eigenvalue(target)
        return wavelength(eigenvalue), exact

    def count(self, target: Target) -> tuple[int, bool]:
        """Number of eigenpairs that a target asks for, and whether that is exact."""
        bound = target.max_eigenvalue
        if bound is None:
            return int(target.value), True
        if bound < self._last:
            return int(np.searchsorted(self.eigenvalues, bound, side="right")), True
        beyond = weyl_count(self.area, bound - self._last)
        return max(1, math.floor(len(self.eigenvalues) + beyond + 0.5)), False

    @property
    def _last(self) -> float:
        return max(float(self.eigenvalues[-1]), 0.0) if len(self.eigenvalues) else 0.0
