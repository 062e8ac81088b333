"""Marked points, edges and faces over the surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkAssembly, vtkPolyDataMapper

from meshmash_viewer.app.view.colors import rgb
from meshmash_viewer.arrays import IntArray

#: Colour of marks, which is in no colour map; widths in points of lines, of points, and of the
#: corners of edges and faces, which are seen where these are smaller than a pixel.
_COLOR, _LINE, _POINT, _CORNER = "#ff2fa8", 2.5, 8.0, 5.0
#: How far marks are drawn in front of the surface that they lie on, in units of depth, with their
#: opacity: what is behind or within a branch is seen through it, fainter.
_LAYERS = ((-8.0, 1.0), (-1e6, 0.45))


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
        self._data.SetVerts(_cells(np.arange(len(self.vertices))[:, np.newaxis]))
        if parts.shape[1] == 2:
            self._data.SetLines(_cells(numbers))
        elif parts.shape[1] == 3:
            self._data.SetPolys(_cells(numbers))
            self._data.SetLines(_cells(numbers[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)))
        self._point = _POINT if parts.shape[1] == 1 else _CORNER
        self.actor = vtkAssembly()
        self.actor.PickableOff()
        layers = [_layer(self._data, *each) for each in _LAYERS]
        self._looks = [each.GetProperty() for each in layers]
        for each in layers:
            self.actor.AddPart(each)

    def move(self, points: npt.NDArray[np.float32]) -> None:
        """Draw `vertices` at positions of shape (len(vertices), 3)."""
        self._data.GetPoints().SetData(numpy_to_vtk(np.ascontiguousarray(points), deep=True))
        self._data.Modified()

    def set_scale(self, scale: float) -> None:
        """Set the number of pixels per point."""
        for look in self._looks:
            look.SetLineWidth(_LINE * scale)
            look.SetPointSize(self._point * scale)


def _layer(data: vtkPolyData, front: float, opacity: float) -> vtkActor:
    """Draw marks so far in front of where they are."""
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, front)
    mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, front)
    mapper.SetRelativeCoincidentTopologyPointOffsetParameter(front)
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.PickableOff()
    look = actor.GetProperty()
    look.SetColor(*rgb(_COLOR))
    look.SetOpacity(opacity)
    look.LightingOff()
    look.SetRenderPointsAsSpheres(True)
    return actor


def _cells(vertices: npt.NDArray[np.integer]) -> vtkCellArray:
    cells = vtkCellArray()
    flat = numpy_to_vtk(np.ascontiguousarray(vertices, dtype=np.int32).ravel(), deep=True)
    cells.SetData(vertices.shape[1], flat)
    return cells
