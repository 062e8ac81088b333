"""Count, largest eigenvalue, wavelength and time, each in terms of the others.

Where eigenpairs are known the answer is exact; beyond them Weyl's law goes on from the last one,
with its slope but not its error so far, which along thin branches is a factor of ten, and to no
more pairs than the mesh has vertices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from meshmash_viewer.spectral.weyl import (
    Target,
    resolved_time,
    wavelength,
    weyl_count,
    weyl_eigenvalue,
)

__all__ = ["Translation"]

#: How far eigenvalues may lie beyond those that Weyl's law gives the first and the last pair.
_BELOW, _ABOVE = 1e-6, 1e3


@dataclass(frozen=True, eq=False)
class Translation:
    """How many eigenvalues a mesh has up to where.

    Parameters
    ----------
    area : float
        Of the surface, positive, in squared length units.
    eigenvalues : ndarray of float64, shape (k,)
        Those known, ascending and complete from the first; empty where none are.
    n_vertices : float
        Of the surface: that many pairs there are in all.
    known_to : float
        Eigenvalue up to which the known ones are proven to be all, beyond the last of them.
    """

    area: float
    eigenvalues: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    n_vertices: float = math.inf
    known_to: float = 0.0

    def eigenvalue(self, target: Target) -> tuple[float, bool]:
        """Largest eigenvalue that a target asks for, and whether that is exact."""
        bound = target.max_eigenvalue
        if bound is not None:
            return bound, True
        count, known = self.count(target)[0], len(self.eigenvalues)
        if count <= known:
            return max(float(self.eigenvalues[count - 1]), 0.0), True
        return self._last + weyl_eigenvalue(self.area, count - known), False

    def wavelength(self, target: Target) -> tuple[float, bool]:
        """Shortest wavelength that a target asks for, and whether that is exact."""
        if target.kind == "wavelength":
            return float(target.value), True
        eigenvalue, exact = self.eigenvalue(target)
        return wavelength(eigenvalue), exact

    def time(self, target: Target) -> tuple[float, bool]:
        """Shortest time of a heat kernel signature that a target resolves, and if that is exact."""
        if target.kind == "time":
            return float(target.value), True
        eigenvalue, exact = self.eigenvalue(target)
        return resolved_time(eigenvalue), exact

    def count(self, target: Target) -> tuple[int, bool]:
        """Number of eigenpairs that a target asks for, and whether that is exact."""
        bound, known = target.max_eigenvalue, len(self.eigenvalues)
        if bound is None:
            return int(min(target.value, self.n_vertices)), True
        if known and (bound < float(self.eigenvalues[-1]) or known >= self.n_vertices):
            return int(np.searchsorted(self.eigenvalues, bound, side="right")), True
        if bound <= self.known_to:
            return known, True
        beyond = weyl_count(self.area, bound - self._last)
        estimated = max(1, math.floor(known + beyond + 0.5))
        return int(min(estimated, self.n_vertices)), False

    @property
    def bounds(self) -> tuple[float, float]:
        """Sizes between which all eigenvalues but zero of a mesh like this lie for certain."""
        if not self.area > 0.0:
            return 1e-140, 1e140
        last = min(self.n_vertices, 1e140)
        low = min(max(_BELOW * weyl_eigenvalue(self.area, 1), 1e-140), 1e140)
        return low, min(max(_ABOVE * weyl_eigenvalue(self.area, last), low), 1e140)

    @property
    def _last(self) -> float:
        last = float(self.eigenvalues[-1]) if len(self.eigenvalues) else 0.0
        return max(last, self.known_to)
