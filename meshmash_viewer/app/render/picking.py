"""Which vertex is under the pointer."""

from __future__ import annotations

from threading import Event, Thread
from time import perf_counter, sleep

import numpy as np
import numpy.typing as npt
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkStaticCellLocator

__all__ = ["Picker"]

#: Faces of one piece. VTK holds the interpreter lock while it builds a locator, 0.2 ms for a
#: thousand faces: pieces of this size never keep the window waiting for longer than a frame.
PIECE = 30_000
#: How long the window has the lock, as a multiple of the time that a piece took.
_PAUSE = 2.0


class Picker:
    """Rays against the faces of a mesh, under a millisecond each at a million vertices.

    The search structures are built piece by piece in a thread; until they are there nothing is
    hit.

    Parameters
    ----------
    surface : vtkPolyData
        Has the vertices, which are not changed afterwards.
    points : ndarray, shape (n, 3)
        The same.
    faces : ndarray of int, shape (m, 3)
    size : float
        Diagonal of the box around them.
    """

    def __init__(
        self,
        surface: vtkPolyData,
        points: npt.NDArray[np.floating],
        faces: npt.NDArray[np.integer],
        size: float,
    ) -> None:
        self._vertices = surface.GetPoints()
        self._points = points
        self._faces = faces
        self._size = size or 1.0
        self._locators: list[vtkStaticCellLocator] = []
        self._stop = Event()
        self._thread = Thread(target=self._build, name="picking", daemon=True)
        self._thread.start()

    def _build(self) -> None:
        starts = np.arange(0, 3 * PIECE + 1, 3, dtype=np.int32)
        for start in range(0, len(self._faces), PIECE):
            if self._stop.is_set():
                return
            began = perf_counter()
            piece_faces = self._faces[start : start + PIECE]
            corners = np.ascontiguousarray(piece_faces, dtype=np.int32).reshape(-1)
            cells = vtkCellArray()
            cells.SetData(numpy_to_vtk(starts[: len(piece_faces) + 1]), numpy_to_vtk(corners))
            piece = vtkPolyData()
            piece.SetPoints(self._vertices)
            piece.SetPolys(cells)
            locator = vtkStaticCellLocator()
            locator.SetDataSet(piece)
            locator.BuildLocator()
            self._locators.append(locator)
            sleep(_PAUSE * (perf_counter() - began))

    @property
    def ready(self) -> bool:
        """Whether rays can be cast."""
        return not self._thread.is_alive()

    def wait(self) -> None:
        """Wait until rays can be cast."""
        self._thread.join()

    def stop(self) -> None:
        """Give up building; nothing will be hit."""
        self._stop.set()
        self._thread.join()
        self._locators.clear()

    def _hit(
        self, start: npt.NDArray[np.float64], end: npt.NDArray[np.float64]
    ) -> tuple[int, npt.NDArray[np.float64]] | None:
        """Face and point of the first hit on the way."""
        share, sub, cell = reference(0.0), reference(0), reference(0)
        point, local = [0.0] * 3, [0.0] * 3
        nearest, found = np.inf, None
        for number, locator in enumerate(self._locators):
            met = locator.IntersectWithLine(
                start, end, 1e-9 * self._size, share, point, local, sub, cell
            )
            if met and float(share) < nearest:
                nearest = float(share)
                found = number * PIECE + int(cell), np.array(point)
        return found

    def vertex(self, through: npt.NDArray[np.float64], towards_eye: npt.NDArray[np.float64]) -> int:
        """Nearest corner of the first face that a ray of sight meets.

        Parameters
        ----------
        through : ndarray, shape (3,)
            Any point of the ray.
        towards_eye : ndarray, shape (3,)
            Unit vector against the direction of sight.

        Returns
        -------
        int
            -1 if the ray misses the mesh or the search structure is not built yet.
        """
        if not self.ready:
            return -1
        reach = (float(np.linalg.norm(through)) + self._size) * towards_eye
        hit = self._hit(through + reach, through - reach)
        if hit is None:
            return -1
        corners = self._faces[hit[0]]
        distance = ((self._points[corners] - hit[1]) ** 2).sum(axis=1)
        return int(corners[np.argmin(distance)])

    def hidden(self, vertex: int, towards_eye: npt.NDArray[np.float64]) -> bool:
        """Whether the mesh stands between a vertex and the eye."""
        if not self.ready:
            return False
        point = self._points[vertex].astype(np.float64)
        # Not from the vertex itself, whose own faces would be met.
        start = point + 2e-3 * self._size * towards_eye
        return self._hit(start, start + 2.0 * self._size * towards_eye) is not None
