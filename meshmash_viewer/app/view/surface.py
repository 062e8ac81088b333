"""The surface and the nodal lines on it, as actors whose arrays share memory with NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataObject, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

from meshmash_viewer.app.view.colors import NAN_COLOR

__all__ = ["LineSet", "Surface"]

#: Lit from the eye's side, whichever way round the corners of a face are: raw meshes mix both.
_FACING = """//VTK::Normal::Impl
  if (normalVCVSOutput.z < 0.0) { normalVCVSOutput = -normalVCVSOutput; }
"""
#: Darker where the surface turns away, so that pale values keep an outline on a pale ground;
#: `normalVCVSOutput.z` is the cosine between the normal and the line of sight. The normal of a
#: tube of radius r turns by 1/r a pixel: one that is a few pixels wide would be all rim, and has
#: none.
_RIM = """//VTK::Light::Impl
  vec2 turning = vec2(length(dFdx(normalVCVSOutput.xy)), length(dFdy(normalVCVSOutput.xy)));
  float rim = 1.0 - smoothstep(0.06, 0.3, max(turning.x, turning.y) * pixelsToPoint);
  rim *= 1.0 - smoothstep(0.0, 0.5, abs(normalVCVSOutput.z));
  fragOutput0.rgb *= 1.0 - 0.42 * rim;
"""
#: The field goes to the graphics card as it is and is coloured there, from a table of 256 colours:
#: VTK's own colouring computes texture coordinates on the processor, 25 ms for a million vertices.
_COLORS = 256
#: Stands for "no value": not every driver knows NaN when it sees it.
_MISSING = np.float32(-3e38)
_FIELD_IN = """//VTK::Normal::Dec
in float fieldMC;
out float fieldVC;
flat out float labelVC;
"""
_FIELD_THROUGH = """//VTK::Normal::Impl
  fieldVC = fieldMC;
  labelVC = fieldMC;
"""
_FIELD_OUT = """//VTK::Color::Dec
in float fieldVC;
flat in float labelVC;
"""
#: Values are interpolated and then coloured: large faces show the right colours inside. Labels are
#: not: between the third and the ninth there are no others, so a face has that of one corner.
_FIELD_COLOR = f"""//VTK::Color::Impl
  if (fieldShown > 0) {{
    float along = ((fieldLabels > 0 ? labelVC : fieldVC) - fieldLow) * fieldScale;
    // In a face with one such corner, too: at its far edge, rounding may turn the sign.
    bool missing = !(abs(along) < 1e20);
    int place = missing ? 0 : int(clamp(along, 0.0, {_COLORS - 1}.0));
    int packedColor = missing ? fieldMissing : fieldColors[place];
    vec3 fieldColor =
      vec3(packedColor >> 16, (packedColor >> 8) & 255, packedColor & 255) / 255.0;
    ambientColor = ambientIntensity * fieldColor;
    diffuseColor = diffuseIntensity * fieldColor;
  }}
"""


class Surface:
    """An actor whose points, faces and field share memory with NumPy.

    Parameters
    ----------
    points : ndarray of float32, shape (n, 3)
        Near the origin, so that single precision is enough.
    faces : ndarray of int, shape (m, 3)
    normals : ndarray of float32, shape (n, 3)
    """

    def __init__(
        self,
        points: npt.NDArray[np.float32],
        faces: npt.NDArray[np.integer],
        normals: npt.NDArray[np.float32],
    ) -> None:
        self.values = np.zeros(len(points), dtype=np.float32)
        # VTK holds a reference to each array that it was given without a copy.
        self._array = numpy_to_vtk(self.values)
        self._array.SetName("field")
        self._points = vtkPoints()
        self._points.SetData(numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32)))
        corners = np.ascontiguousarray(faces, dtype=np.int32).ravel()
        starts = np.arange(0, len(corners) + 1, 3, dtype=np.int32)
        cells = vtkCellArray()
        cells.SetData(numpy_to_vtk(starts), numpy_to_vtk(corners))
        self.data = vtkPolyData()
        self.data.SetPoints(self._points)
        self.data.SetPolys(cells)
        arrows = numpy_to_vtk(np.ascontiguousarray(normals, dtype=np.float32))
        arrows.SetName("normals")
        self.data.GetPointData().SetNormals(arrows)
        #: Held as long as VTK has their addresses; at first VTK holds what it was given itself.
        self._moved: tuple[npt.NDArray[np.float32] | None, npt.NDArray[np.float32] | None]
        self._moved = (None, None)
        self.data.GetPointData().AddArray(self._array)
        self._mapper = vtkPolyDataMapper()
        self._mapper.SetInputData(self.data)
        self._mapper.ScalarVisibilityOff()
        points_have_it = vtkDataObject.FIELD_ASSOCIATION_POINTS
        self._mapper.MapDataArrayToVertexAttribute("fieldMC", "field", points_have_it, -1)
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
        shaders.AddVertexShaderReplacement("//VTK::Normal::Dec", True, _FIELD_IN, False)
        shaders.AddVertexShaderReplacement("//VTK::Normal::Impl", True, _FIELD_THROUGH, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Dec", True, _FIELD_OUT, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _FIELD_COLOR, False)
        self._uniforms = shaders.GetFragmentCustomUniforms()
        self._uniforms.SetUniformi("fieldMissing", int(NAN_COLOR[1:], 16))
        self.set_colors(np.zeros((_COLORS, 4), dtype=np.uint8))
        self.set_range(0.0, 1.0)
        self.set_scale(1.0)
        self.show_field(False)
        self.show_labels(False)

    def move(self, points: npt.NDArray[np.float32], normals: npt.NDArray[np.float32]) -> None:
        """Draw the vertices elsewhere, with other normals, both of shape (n, 3).

        They are not copied, and must not be changed while they are shown.
        """
        before, self._moved = self._moved, (points, normals)
        arrays = self._points.GetData(), self.data.GetPointData().GetNormals()
        for array, known, moved in zip(arrays, before, self._moved, strict=True):
            if known is not moved:
                array.SetVoidArray(moved.reshape(-1), moved.size, 1)
                array.Modified()
        self._points.Modified()
        self.data.Modified()

    def write(self, values: npt.NDArray[np.floating], *, complete: bool = False) -> bool:
        """Show values of shape (n,), NaN where there is none; returns whether there are such.

        `complete` says that there are none.
        They are not copied, and must not be changed while they are shown.
        """
        # Field values are never changed, so the array that came is shown and no copy of it.
        shown = np.ascontiguousarray(values, dtype=np.float32)
        # The least is NaN as soon as one entry is: one pass, without a temporary array.
        missing = not complete and bool(np.isnan(shown.min(initial=0.0)))
        if missing:
            shown = np.where(np.isnan(shown), _MISSING, shown)
        self._array.SetVoidArray(shown, len(shown), 1)
        self._array._numpy_reference = shown  # held as long as VTK has its address
        self._array.Modified()
        self.data.Modified()
        self.values = shown
        return missing

    def shown_values(self) -> npt.NDArray[np.float32]:
        """A copy of the values that are shown, NaN where there is none."""
        return np.where(self.values == _MISSING, np.float32(np.nan), self.values)

    def set_colors(self, colors: npt.NDArray[np.uint8]) -> None:
        """Take a table of colours of shape (256, 4)."""
        packed = colors[:, :3].astype(np.int64) @ [1 << 16, 1 << 8, 1]
        self._uniforms.SetUniform1iv("fieldColors", _COLORS, packed.tolist())

    def set_range(self, low: float, high: float) -> None:
        """Set the values of the first and of the last colour."""
        self._uniforms.SetUniformf("fieldLow", low)
        self._uniforms.SetUniformf("fieldScale", _COLORS / (high - low))

    def show_as_dots(self, size: float) -> None:
        """Draw the corners of the faces and not the faces, in dots that many pixels wide."""
        look = self.actor.GetProperty()
        look.SetRepresentationToPoints()
        look.SetPointSize(size)

    def set_scale(self, scale: float) -> None:
        """Set how many pixels make a point, which the rim is drawn in."""
        self._uniforms.SetUniformf("pixelsToPoint", scale)

    def show_labels(self, shown: bool) -> None:
        """Give each face the colour of one corner, for values between which there are none."""
        self._uniforms.SetUniformi("fieldLabels", int(shown))

    def show_field(self, shown: bool) -> None:
        """Colour by the field, or in one colour."""
        self._uniforms.SetUniformi("fieldShown", int(shown))


class LineSet:
    """Lines on the surface, each the fainter the thinner the branch that it goes around."""

    #: Of a branch in points, below which its lines are not seen and above which they are in full.
    FAINT, FULL = 8.0, 16.0

    def __init__(self) -> None:
        self._data = vtkPolyData()
        self._widths = np.zeros(0)
        self._shown_at: tuple[Any, ...] | None = None
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(self._data)
        mapper.SetColorModeToDirectScalars()
        self.actor = vtkActor()
        self.actor.SetMapper(mapper)
        self.actor.GetProperty().LightingOff()
        # As ribbons: plain lines leave gaps where a segment is shorter than a pixel.
        self.actor.GetProperty().RenderLinesAsTubesOn()
        self.actor.PickableOff()
        self.actor.VisibilityOff()

    def show(
        self, segments: npt.NDArray[np.float32] | None, widths: npt.NDArray[np.float64] | None
    ) -> None:
        """Show segments of shape (s, 2, 3) of branches of widths of shape (s,), or none."""
        self._shown_at = None
        self._data.Initialize()
        self.actor.SetVisibility(segments is not None and len(segments) > 0)
        if segments is None or widths is None or not len(segments):
            return
        self._widths = np.repeat(widths, 2)
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

    def fade(self, length_per_point: float, color: tuple[float, float, float]) -> None:
        """Take a colour, and opacities for a size of the mesh on the screen."""
        known = (length_per_point, color)
        if known == self._shown_at or not self._data.GetNumberOfPoints():
            return
        self._shown_at = known
        rgba = np.empty((len(self._widths), 4), dtype=np.uint8)
        rgba[:, :3] = np.round(255 * np.array(color))
        share = (self._widths / length_per_point - self.FAINT) / (self.FULL - self.FAINT)
        rgba[:, 3] = np.round(255 * share.clip(0.0, 1.0))
        self._data.GetPointData().SetScalars(numpy_to_vtk(rgba, deep=True))
