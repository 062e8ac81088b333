"""The surface and the lines on it, as an actor whose arrays share memory with NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataObject, vtkPolyData
from vtkmodules.vtkRenderingCore import VTK_POINTS, vtkActor, vtkPolyDataMapper

from meshmash_viewer.app.view.annotations import Caption
from meshmash_viewer.app.view.colors import LIGHT, NAN_COLOR, RenderTheme, color_table, rgb
from meshmash_viewer.vertex_map import MOST_LABELS

__all__ = ["Surface"]

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
  float turn = max(turning.x, turning.y) * pixelsToPoint;
  float rim = 1.0 - smoothstep(0.06, 0.3, turn);
  rim *= 1.0 - smoothstep(0.0, 0.5, abs(normalVCVSOutput.z));
  fragOutput0.rgb *= 1.0 - 0.42 * rim;
"""
#: Lines two points wide where the field is zero, or at a multiple of a spacing: as far from them
#: as the field is over its slope on the screen. Those of zero are the fainter the thinner a branch
#: is that is less than 10 points wide, and gone at 6: they would hide its colours.
_LINES = """
  float level = lineSpacing > 0.0 ? lineSpacing * max(round(fieldVC / lineSpacing), 1.0) : 0.0;
  vec2 rise = abs(vec2(dFdx(fieldVC), dFdy(fieldVC)));
  float most = max(max(rise.x, rise.y), 1e-37);  // squares of tiny values would be none
  float slope = most * length(rise / most) * pixelsToPoint;
  float away = abs(fieldVC - level);
  if (linesShown > 0 && slope > 0.0 && away < 2.0 * slope && abs(fieldVC) < 1e20) {
    float soft = 0.5 / pixelsToPoint;
    float line = 1.0 - smoothstep(1.0 - soft, 1.0 + soft, away / slope);
    if (lineSpacing <= 0.0) {
      line *= smoothstep(6.0, 10.0, 2.0 * abs(normalVCVSOutput.z) / max(turn, 1e-6));
    }
    fragOutput0.rgb = mix(fragOutput0.rgb, lineColor, line);
  }
"""
#: The field goes to the graphics card as it is and is coloured there, from a table of as many
#: colours as there may be labels, or of 256 that are there twice: VTK's own colouring computes
#: texture coordinates on the processor, 25 ms for a million vertices.
_COLORS = MOST_LABELS
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
        cells = vtkCellArray()
        cells.SetData(3, numpy_to_vtk(np.ascontiguousarray(faces, dtype=np.int32).ravel()))
        self.data = vtkPolyData()
        self.data.SetPoints(vtkPoints())
        self.data.SetPolys(cells)
        self.data.GetPointData().AddArray(self._array)
        self.move(points, normals)
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
        shaders.AddFragmentShaderReplacement("//VTK::Light::Impl", True, _RIM + _LINES, False)
        shaders.AddVertexShaderReplacement("//VTK::Normal::Dec", True, _FIELD_IN, False)
        shaders.AddVertexShaderReplacement("//VTK::Normal::Impl", True, _FIELD_THROUGH, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Dec", True, _FIELD_OUT, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _FIELD_COLOR, False)
        self._uniforms = shaders.GetFragmentCustomUniforms()
        self._uniforms.SetUniformi("fieldMissing", int(NAN_COLOR[1:], 16))
        self.set_scale(1.0)
        self.set_theme(LIGHT)
        # a shader knows what has been set once
        self.dress(Caption("", "", "", 0.0, 1.0, "viridis"))
        self.dress(None)

    def move(self, points: npt.NDArray[np.float32], normals: npt.NDArray[np.float32]) -> None:
        """Draw the vertices elsewhere, with other normals, both of shape (n, 3).

        They are not copied, and must not be changed while they are shown.
        """
        arrows = numpy_to_vtk(np.ascontiguousarray(normals, dtype=np.float32))
        arrows.SetName("normals")
        self.data.GetPointData().SetNormals(arrows)
        places = numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32))
        self.data.GetPoints().SetData(places)
        self.data.Modified()

    def write(self, values: npt.NDArray[np.floating]) -> bool:
        """Show values of shape (n,), NaN where there is none; returns whether there are such.

        They are not copied, and must not be changed while they are shown.
        """
        # Field values are never changed, so the array that came is shown and no copy of it.
        shown = np.ascontiguousarray(values, dtype=np.float32)
        # The least is NaN as soon as one entry is: one pass, without a temporary array.
        missing = bool(np.isnan(shown.min(initial=0.0)))
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

    def dress(self, caption: Caption | None) -> None:
        """Colour by the field as is written about it, with its lines; or in one colour."""
        self._uniforms.SetUniformi("fieldShown", int(caption is not None))
        if caption is None:
            return
        if isinstance(caption.colormap, tuple):
            table = color_table(caption.colormap, _COLORS)
        else:
            table = np.repeat(caption.table, _COLORS // len(caption.table), axis=0)
        packed = table[:, :3].astype(np.int64) @ [1 << 16, 1 << 8, 1]
        self._uniforms.SetUniform1iv("fieldColors", _COLORS, packed.tolist())
        self._uniforms.SetUniformf("fieldLow", caption.low)
        self._uniforms.SetUniformf("fieldScale", _COLORS / (caption.high - caption.low))
        self._uniforms.SetUniformi("fieldLabels", int(not isinstance(caption.colormap, str)))
        self._uniforms.SetUniformi("linesShown", int(caption.lines is not None))
        self._uniforms.SetUniformf("lineSpacing", caption.lines or 0.0)

    def show_as_dots(self, size: float) -> None:
        """Draw the corners of the faces and not the faces, in dots that many pixels wide."""
        look = self.actor.GetProperty()
        look.SetRepresentationToPoints()
        look.SetPointSize(size)

    @property
    def dotted(self) -> bool:
        """Whether it is drawn in dots."""
        return bool(self.actor.GetProperty().GetRepresentation() == VTK_POINTS)

    def set_scale(self, scale: float) -> None:
        """Set how many pixels make a point, which the rim is drawn in."""
        self._uniforms.SetUniformf("pixelsToPoint", scale)

    def set_theme(self, theme: RenderTheme) -> None:
        """Take the colours of the lines, and of the surface where it shows no field."""
        self.actor.GetProperty().SetColor(*rgb(theme.surface))
        self._uniforms.SetUniform3f("lineColor", rgb(theme.line))
