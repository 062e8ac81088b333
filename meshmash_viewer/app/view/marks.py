"""What is drawn over the surface, at its vertices: marked points, edges and faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPlane, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkAssembly, vtkMapper, vtkPolyDataMapper

from meshmash_viewer.app.view.style import rgb
from meshmash_viewer.arrays import IntArray
from meshmash_viewer.surface.masks import Mask

#: Widths in points of points, of the corners of edges and faces, which are seen where these are
#: smaller than a pixel, and of nodes of a graph.
_POINT, _CORNER, _NODE = 8.0, 5.0, 3.6


class Layer(NamedTuple):
    """How marks are drawn once: how far in front of the surface that they lie on, and so on."""

    #: In units of depth.
    front: float
    opacity: float
    color: str
    #: Of lines, in points.
    width: float


#: Marks of faults, in a colour that no colour map has: what is behind or within a branch is seen
#: through it, fainter.
FAULTS = (Layer(-8.0, 1.0, "#ff2fa8", 2.5), Layer(-1e6, 0.45, "#ff2fa8", 2.5))
#: Borders between labels: dark lines with a faint light edge, which are seen over every colour.
BORDERS = (Layer(-8.0, 0.4, "#ffffff", 3.6), Layer(-12.0, 1.0, "#14181d", 1.8))
#: Graph of regions, seen through the mesh. Both are opaque: so far in front they have one depth,
#: where the second covers the first, but a translucent first one would cover it in turn.
GRAPH = (Layer(-1e6, 1.0, "#ffffff", 2.4), Layer(-1e6, 1.0, "#14181d", 1.2))


@dataclass(frozen=True)
class PointLegend:
    """Colours "#rrggbb" of points with what they mean, from above; shades if `graded`."""

    title: str
    rows: tuple[tuple[str, str], ...]
    graded: bool = False


class Overlay:
    """What is drawn over the surface, by an `actor`, in a window of its own for each copy."""

    actor: Any
    _mappers: list[vtkMapper]
    #: What its colours mean.
    legend: PointLegend | None = None

    def move(self, drawn: npt.NDArray[np.float32]) -> None:
        """Follow the displayed vertices, shape (n, 3)."""
        raise NotImplementedError

    def hide(self, hidden: Mask | None) -> None:
        """Follow which vertices are hidden, as far as that concerns it."""

    def cut(self, plane: vtkPlane | None) -> None:
        """Leave out what is on the negative side of a plane; None to draw all."""
        for mapper in self._mappers:
            mapper.RemoveAllClippingPlanes()
            if plane is not None:
                mapper.AddClippingPlane(plane)

    def set_scale(self, scale: float) -> None:
        """Set the number of pixels per point."""
        raise NotImplementedError

    def copy(self) -> Overlay:
        """The same for another window."""
        raise NotImplementedError


class Marks(Overlay):
    """Draws points, edges or faces, given by their vertices: shape (k, 1), (k, 2) or (k, 3).

    Of a face the sides are drawn, too, so that one without area is visible; of faults and graphs
    the corners.
    """

    def __init__(self, parts: IntArray, layers: tuple[Layer, ...] = FAULTS) -> None:
        self.parts, self._layers = parts, layers
        self._vertices, numbers = np.unique(parts, return_inverse=True)
        numbers = numbers.reshape(parts.shape)
        self._data = vtkPolyData()
        self._data.SetPoints(vtkPoints())
        if layers is not BORDERS:
            self._data.SetVerts(_cells(np.arange(len(self._vertices))[:, np.newaxis]))
        if parts.shape[1] == 2:
            self._data.SetLines(_cells(numbers))
        elif parts.shape[1] == 3:
            self._data.SetPolys(_cells(numbers))
            self._data.SetLines(_cells(numbers[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)))
        corner = _NODE if layers is GRAPH else _CORNER
        self._point = _POINT if parts.shape[1] == 1 else corner
        self.actor = vtkAssembly()
        self.actor.PickableOff()
        actors = [_drawn(self._data, each) for each in layers]
        self._looks = [each.GetProperty() for each in actors]
        self._mappers = [each.GetMapper() for each in actors]
        for each in actors:
            self.actor.AddPart(each)

    def copy(self) -> Marks:
        return Marks(self.parts, self._layers)

    def move(self, drawn: npt.NDArray[np.float32]) -> None:
        self._data.GetPoints().SetData(numpy_to_vtk(drawn[self._vertices], deep=True))
        self._data.Modified()

    def set_scale(self, scale: float) -> None:
        for look, layer in zip(self._looks, self._layers, strict=True):
            look.SetLineWidth(layer.width * scale)
            look.SetPointSize(self._point * scale)


def _drawn(data: vtkPolyData, layer: Layer) -> vtkActor:
    """Make the actor that draws marks once."""
    front = layer.front
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
    look.SetColor(*rgb(layer.color))
    look.SetOpacity(layer.opacity)
    look.LightingOff()
    look.SetRenderPointsAsSpheres(True)
    return actor


def _cells(vertices: npt.NDArray[np.integer]) -> vtkCellArray:
    cells = vtkCellArray()
    flat = numpy_to_vtk(np.ascontiguousarray(vertices, dtype=np.int32).ravel(), deep=True)
    cells.SetData(vertices.shape[1], flat)
    return cells
