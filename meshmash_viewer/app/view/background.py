"""The ground behind everything: one colour at the top that fades to another at the bottom."""

from __future__ import annotations

import numpy as np
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkActor2D,
    vtkCoordinate,
    vtkPolyDataMapper2D,
    vtkRenderer,
)

from meshmash_viewer.app.view.colors import rgb

__all__ = ["Background"]

#: Less than a step of colour, other at each pixel: bands of one colour would be seen on a dark
#: ground. Interleaved gradient noise (Jimenez, "Next generation post processing", SIGGRAPH 2014).
_DITHER = """//VTK::Color::Impl
  float grain = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
  gl_FragData[0].rgb += (grain - 0.5) / 255.0;
"""


class Background:
    """Fills a renderer, behind its mesh.

    A renderer of VTK's can do that itself, but makes all that it takes anew for each frame: half
    a millisecond. This one comes after the mesh, which its filters know nothing of.

    Parameters
    ----------
    renderer : vtkRenderer
    """

    def __init__(self, renderer: vtkRenderer) -> None:
        self._renderer = renderer
        self._colors = np.zeros((4, 4), dtype=np.uint8)
        points = vtkPoints()
        corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=np.float32)
        points.SetData(numpy_to_vtk(corners))
        cells = vtkCellArray()
        ends, order = np.array([0, 4], dtype=np.int32), np.arange(4, dtype=np.int32)
        cells.SetData(numpy_to_vtk(ends), numpy_to_vtk(order))
        self._data = vtkPolyData()
        self._data.SetPoints(points)
        self._data.SetPolys(cells)
        self._data.GetPointData().SetScalars(numpy_to_vtk(self._colors))
        whole = vtkCoordinate()
        whole.SetCoordinateSystemToNormalizedViewport()
        mapper = vtkPolyDataMapper2D()
        mapper.SetInputData(self._data)
        mapper.SetScalarModeToUsePointData()
        mapper.SetTransformCoordinate(whole)
        self._actor = vtkActor2D()
        self._actor.SetMapper(mapper)
        self._actor.GetProperty().SetDisplayLocationToBackground()
        shader = self._actor.GetShaderProperty()
        shader.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _DITHER, False)
        renderer.AddViewProp(self._actor)

    def show(self, bottom: str, top: str) -> None:
        """Take two colours as "#rrggbb"."""
        for corners, color in (((0, 1), bottom), ((2, 3), top)):
            self._colors[corners, :] = np.round(255.0 * np.array([*rgb(color), 1.0]))
        self._data.GetPointData().GetScalars().Modified()
        self._data.Modified()
        self._renderer.SetBackground(*rgb(bottom))
        self._renderer.SetBackground2(*rgb(top))

    def come_first(self, first: bool) -> None:
        """Be there before the mesh, for what blends the mesh with it; or after it, as usual."""
        self._renderer.SetGradientBackground(first)
        self._actor.SetVisibility(not first)

    def leave(self) -> None:
        """Leave nothing behind the mesh, black and clear."""
        self._renderer.GradientBackgroundOff()
        self._actor.VisibilityOff()
        self._renderer.SetBackground(0.0, 0.0, 0.0)
        self._renderer.SetBackgroundAlpha(0.0)
