"""Which vertex is under the pointer."""

from __future__ import annotations

from threading import Thread

import numpy as np
import numpy.typing as npt
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkPolyData, vtkStaticCellLocator

__all__ = ["Picker"]


class Picker:
    """Rays against the faces of a mesh, 0.1 ms each at a million vertices.

    The search structure is built by a thread of its own; VTK lets go of the interpreter lock
    meanwhile. Until it is there nothing is hit.

    Parameters
    ----------
    surface : vtkPolyData
        Triangles; not changed afterwards (its point data may be).
    points : ndarray, shape (n, 3)
        Its vertices.
    faces : ndarray of int, shape (m, 3)
    """

    def __init__(
        self,
        surface: vtkPolyData,
        points: npt.NDArray[np.floating],
        faces: npt.NDArray[np.integer],
    ) -> None:
        self._points = points
        self._faces = faces
        self._size = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
        # A shallow copy: the field is written into the other one while the thread reads this one.
        shape = vtkPolyData()
        shape.SetPoints(surface.GetPoints())
        shape.SetPolys(surface.GetPolys())
        # What a data set makes on demand must not be made by two threads at once.
        shape.BuildCells()
        shape.ComputeBounds()
        self._locator = vtkStaticCellLocator()
        self._locator.SetDataSet(shape)
        self._thread = Thread(target=self._locator.BuildLocator, name="picking", daemon=True)
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether rays can be cast."""
        return not self._thread.is_alive()

    def wait(self) -> None:
        """Wait until rays can be cast."""
        self._thread.join()

    def _hit(self, start: npt.NDArray, end: npt.NDArray) -> tuple[int, npt.NDArray, float] | None:
        """Face, point and share of the way of the first hit."""
        share, sub, cell = reference(0.0), reference(0), reference(0)
        point, local = [0.0] * 3, [0.0] * 3
        if not self._locator.IntersectWithLine(
            start, end, 1e-9 * self._size, share, point, local, sub, cell
        ):
            return None
        return int(cell), np.array(point), float(share)

    def vertex(self, through: npt.NDArray, towards_eye: npt.NDArray) -> int:
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

    def hidden(self, vertex: int, towards_eye: npt.NDArray) -> bool:
        """Whether the mesh stands between a vertex and the eye."""
        if not self.ready:
            return False
        point = self._points[vertex].astype(np.float64)
        # Not from the vertex itself, whose own faces would be met.
        start = point + 2e-3 * self._size * towards_eye
        return self._hit(start, start + 2.0 * self._size * towards_eye) is not None
