"""Marked points, edges and faces over the surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from meshmash_viewer.app.view.colors import rgb
from meshmash_viewer.arrays import IntArray

#: Colour of marks, which is in no colour map; widths of lines and points in points.
_COLOR, _LINE, _POINT = "#ff2fa8", 2.5, 8.0
#: How far marks are drawn in front of the surface that they lie on, in units of depth.
_FRONT = -8.0


class Marks:
    """Draws points, edges or faces, given by their vertices: shape (k, 1), (k, 2) or (k, 3).

    Of a face the sides are drawn, too, so that one without area is visible.
    """

    def __init__(self, parts: IntArray) -> None:
        #: Vertices whose positions `move` takes.
        self.vertices, numbers = np.unique(parts, return_inverse=True)
        numbers = numbers.reshape(parts.shape)
        self._data = vtkPolyData()
        self._data.SetPoints(vtkPoints())
        if parts.shape[1] == 1:
            self._data.SetVerts(_cells(numbers))
        elif parts.shape[1] == 2:
            self._data.SetLines(_cells(numbers))
        else:
            self._data.SetPolys(_cells(numbers))
            self._data.SetLines(_cells(numbers[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)))
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(self._data)
        mapper.SetResolveCoincidentTopologyToPolygonOffset()
        mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, _FRONT)
        mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, _FRONT)
        mapper.SetRelativeCoincidentTopologyPointOffsetParameter(_FRONT)
        self.actor = vtkActor()
        self.actor.SetMapper(mapper)
        self.actor.PickableOff()
        look = self.actor.GetProperty()
        look.SetColor(*rgb(_COLOR))
        look.LightingOff()
        look.SetRenderPointsAsSpheres(True)

    def move(self, points: npt.NDArray[np.float32]) -> None:
        """Draw `vertices` at positions of shape (len(vertices), 3)."""
        self._data.GetPoints().SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
        self._data.Modified()

    def set_scale(self, scale: float) -> None:
        """Set the number of pixels per point."""
        self.actor.GetProperty().SetLineWidth(_LINE * scale)
        self.actor.GetProperty().SetPointSize(_POINT * scale)


def _cells(vertices: npt.NDArray[np.integer]) -> vtkCellArray:
    cells = vtkCellArray()
    flat = numpy_to_vtk(np.ascontiguousarray(vertices, dtype=np.int32).ravel(), deep=True)
    cells.SetData(vertices.shape[1], flat)
    return cells
