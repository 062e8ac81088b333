"""One triangle surface on the graphics card, with a field that is written in place."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkLookupTable, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from meshmash_viewer.app.render.colors import NAN_COLOR, rgb

__all__ = ["LineSet", "Surface", "new_lookup_table", "set_colors"]

#: Lit from the eye's side, whichever way round the corners of a face are: raw meshes mix both.
_FACING = """//VTK::Normal::Impl
  if (normalVCVSOutput.z < 0.0) { normalVCVSOutput = -normalVCVSOutput; }
"""
#: Darker where the surface turns away, so that pale values keep an outline on a pale ground;
#: `normalVCVSOutput.z` is the cosine between the normal and the line of sight.
_RIM = """//VTK::Light::Impl
  fragOutput0.rgb *= mix(0.58, 1.0, smoothstep(0.0, 0.5, abs(normalVCVSOutput.z)));
"""


def new_lookup_table() -> vtkLookupTable:
    """A lookup table that paints missing values grey."""
    table = vtkLookupTable()
    table.SetNanColor(*rgb(NAN_COLOR), 1.0)
    return table


def set_colors(table: vtkLookupTable, colors: npt.NDArray[np.uint8]) -> None:
    """Put colours of shape (m, 4) in a lookup table."""
    table.SetNumberOfTableValues(len(colors))
    table.SetTable(numpy_to_vtk(colors, deep=True))
    table.Modified()


class Surface:
    """An actor whose points, faces and field share memory with NumPy.

    Parameters
    ----------
    points : ndarray of float32, shape (n, 3)
        Near the origin, so that single precision is enough.
    faces : ndarray of int, shape (m, 3)
    normals : ndarray of float32, shape (n, 3)
    table : vtkLookupTable
    """

    def __init__(
        self,
        points: npt.NDArray[np.float32],
        faces: npt.NDArray[np.integer],
        normals: npt.NDArray[np.float32],
        table: vtkLookupTable,
    ) -> None:
        self.values = np.zeros(len(points), dtype=np.float32)
        # VTK holds a reference to each array that it was given without a copy.
        self._array = numpy_to_vtk(self.values)
        self._array.SetName("field")
        vertices = vtkPoints()
        vertices.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32)))
        corners = np.ascontiguousarray(faces, dtype=np.int32).ravel()
        starts = np.arange(0, len(corners) + 1, 3, dtype=np.int32)
        cells = vtkCellArray()
        cells.SetData(numpy_to_vtk(starts), numpy_to_vtk(corners))
        self.data = vtkPolyData()
        self.data.SetPoints(vertices)
        self.data.SetPolys(cells)
        arrows = numpy_to_vtk(np.ascontiguousarray(normals, dtype=np.float32))
        arrows.SetName("normals")
        self.data.GetPointData().SetNormals(arrows)
        self.data.GetPointData().SetScalars(self._array)
        self._mapper = vtkPolyDataMapper()
        self._mapper.SetInputData(self.data)
        self._mapper.SetLookupTable(table)
        self._mapper.UseLookupTableScalarRangeOn()
        # Values are interpolated and then coloured: large faces show the right colours inside.
        self._mapper.InterpolateScalarsBeforeMappingOn()
        self._mapper.ScalarVisibilityOff()
        self.actor = vtkActor()
        self.actor.SetMapper(self._mapper)
        look = self.actor.GetProperty()
        look.SetAmbient(0.32)
        look.SetDiffuse(0.72)
        look.SetSpecular(0.06)
        look.SetSpecularPower(25.0)
        shaders = self.actor.GetShaderProperty()
        shaders.AddFragmentShaderReplacement("//VTK::Normal::Impl", True, _FACING, False)
        shaders.AddFragmentShaderReplacement("//VTK::Light::Impl", True, _RIM, False)

    def write(self, values: npt.NDArray[np.floating]) -> None:
        """Show values of shape (n,), NaN where there is none."""
        np.copyto(self.values, values, casting="same_kind")
        self._array.Modified()
        self.data.Modified()

    def show_field(self, shown: bool) -> None:
        """Colour by the field, or in one colour."""
        self._mapper.SetScalarVisibility(shown)


class LineSet:
    """Line segments on the surface."""

    def __init__(self) -> None:
        self._data = vtkPolyData()
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(self._data)
        self.actor = vtkActor()
        self.actor.SetMapper(mapper)
        self.actor.GetProperty().LightingOff()
        # As ribbons: plain lines leave gaps where a segment is shorter than a pixel.
        self.actor.GetProperty().RenderLinesAsTubesOn()
        self.actor.PickableOff()
        self.actor.VisibilityOff()

    def show(self, segments: npt.NDArray[np.float32] | None) -> None:
        """Show segments of shape (s, 2, 3), or none."""
        self.actor.SetVisibility(segments is not None and len(segments) > 0)
        if segments is None or not len(segments):
            self._data.Initialize()
            return
        points = vtkPoints()
        points.SetData(numpy_to_vtk(segments.reshape(-1, 3).astype(np.float32, copy=False)))
        cells = vtkCellArray()
        count = 2 * len(segments)
        cells.SetData(
            numpy_to_vtk(np.arange(0, count + 1, 2, dtype=np.int32)),
            numpy_to_vtk(np.arange(count, dtype=np.int32)),
        )
        self._data.SetPoints(points)
        self._data.SetLines(cells)
        self._data.Modified()
