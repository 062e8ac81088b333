"""Which vertex is under the pointer."""

from __future__ import annotations

import contextlib
from threading import Event, Thread

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.surface.rays import RayTarget

__all__ = ["Picker"]


class Picker:
    """Lines of sight against the faces of a mesh.

    What they are cast against is built in a thread; until it is there nothing is hit.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Not changed afterwards, nor are the faces.
    faces : ndarray of int, shape (m, 3)
    size : float
        Diagonal of the box around them.
    """

    def __init__(
        self, points: npt.NDArray[np.floating], faces: npt.NDArray[np.integer], size: float
    ) -> None:
        self._points = points
        self._faces = faces
        self._size = size or 1.0
        self._target: RayTarget | None = None
        self._stop = Event()
        self._thread = Thread(target=self._build, name="picking", daemon=True)
        self._thread.start()

    def _build(self) -> None:
        with contextlib.suppress(Cancelled):
            self._target = RayTarget(self._points, self._faces, self._stop.is_set)

    @property
    def ready(self) -> bool:
        """Whether lines of sight can be followed."""
        return not self._thread.is_alive()

    def stop(self) -> None:
        """Give up building; nothing will be hit."""
        self._stop.set()

    def wait(self) -> None:
        """Wait until lines of sight can be followed."""
        self._thread.join()

    def vertex(self, through: npt.NDArray[np.float64], towards_eye: npt.NDArray[np.float64]) -> int:
        """Nearest corner of the first face that a line of sight meets.

        Parameters
        ----------
        through : ndarray, shape (3,)
            Any point of the line.
        towards_eye : ndarray, shape (3,)
            Unit vector against the direction of sight.

        Returns
        -------
        int
            -1 if the line misses the mesh or the search structure is not built yet.
        """
        if self._target is None:
            return -1
        reach = (float(np.linalg.norm(through)) + self._size) * towards_eye
        hit = self._target.first_hit(through + reach, through - reach)
        if hit is None:
            return -1
        corners = self._faces[hit.face]
        distance = ((self._points[corners] - hit.point) ** 2).sum(axis=1)
        return int(corners[np.argmin(distance)])

    def hidden(self, vertex: int, towards_eye: npt.NDArray[np.float64]) -> bool:
        """Whether the mesh stands between a vertex and the eye."""
        if self._target is None:
            return False
        point = self._points[vertex].astype(np.float64)
        # Not from the vertex itself, whose own faces would be met.
        start = point + 2e-3 * self._size * towards_eye
        end = start + 2.0 * self._size * towards_eye
        return self._target.first_hit(start, end) is not None
