"""A plane that a mesh is cut at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Plane:
    """The points x with ``normal @ x == level``; the normal, of length 1, is to the kept side."""

    normal: FloatArray
    level: float

    def seen_from(self, origin: FloatArray) -> Plane:
        """The same plane in coordinates relative to an origin."""
        return Plane(self.normal, self.level - float(self.normal @ origin))

    def away(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
        """Find the points, shape (n, 3), that are cut away, shape (n,)."""
        return np.asarray(points @ self.normal.astype(points.dtype) < self.level)

    def kept(self, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the kept part of the way between two points; None if there is none."""
        first, last = (float(self.normal @ each) - self.level for each in (start, end))
        if first < 0.0 and last < 0.0:
            return None
        crossing = start + (first / (first - last) if first != last else 0.0) * (end - start)
        return (crossing if first < 0.0 else start), (crossing if last < 0.0 else end)
