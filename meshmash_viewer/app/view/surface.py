"""Actors of a mesh: its surface, coloured by a field in the shader, and marks over the surface."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the mappers)
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPlane, vtkPolyData
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkAssembly,
    vtkMapper,
    vtkPolyDataMapper,
    vtkTexture,
)

from meshmash_viewer.app.view.caption import Caption, PointLegend
from meshmash_viewer.app.view.style import (
    LIGHT,
    NAN_COLOR,
    SELECTION_COLOR,
    RenderTheme,
    color_table,
    rgb,
)
from meshmash_viewer.arrays import IntArray
from meshmash_viewer.surface.decimation import CoarseMesh
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.surface.rays import Plane
from meshmash_viewer.vertex_map import MOST_LABELS

#: Lights faces from the eye's side in either orientation, because raw meshes mix orientations.
_FACING = """//VTK::Normal::Impl
  if (normalVCVSOutput.z < 0.0) { normalVCVSOutput = -normalVCVSOutput; }
"""
#: Darkens the silhouette, so that pale values stand out from a pale background.
#: `normalVCVSOutput.z` is the cosine between the normal and the line of sight. The normal of a
#: tube of radius r rotates by 1/r per pixel; tubes a few pixels wide are not darkened, because
#: they would be dark everywhere.
_RIM = """//VTK::Light::Impl
  vec2 turning = vec2(length(dFdx(normalVCVSOutput.xy)), length(dFdy(normalVCVSOutput.xy)));
  float turn = max(turning.x, turning.y) * pixelsToPoint;
  float rim = 1.0 - smoothstep(0.06, 0.3, turn);
  rim *= 1.0 - smoothstep(0.0, 0.5, abs(normalVCVSOutput.z));
  fragOutput0.rgb *= 1.0 - 0.42 * rim;
"""
#: Draws level lines, two points wide, at zero or at multiples of a spacing. The distance from a
#: line is the difference from its level divided by the slope of the field on the screen. Zero lines
#: fade out on branches between 10 and 6 points wide, because they would hide the colours.
_LINES = """
  float level = lineSpacing > 0.0 ? lineSpacing * max(round(fieldVC / lineSpacing), 1.0) : 0.0;
  vec2 rise = abs(vec2(dFdx(fieldVC), dFdy(fieldVC)));
  float most = max(max(rise.x, rise.y), 1e-37);  // squares of tiny values would be 0
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
#: Draws stripes over selected vertices, in a colour that no colour map contains, and a dark line
#: at their border.
_SELECTED = """
  if (selectionShown > 0) {
    vec2 change = vec2(dFdx(selectedVC), dFdy(selectedVC));
    float edge = (selectedVC - 0.5) / max(length(change) * pixelsToPoint, 1e-6);
    float along = mod((gl_FragCoord.x + gl_FragCoord.y) / pixelsToPoint, 8.0);
    float stripe = smoothstep(0.0, 1.0, along) - smoothstep(4.0, 5.0, along);
    float inside = smoothstep(-0.5, 0.5, edge);
    fragOutput0.rgb = mix(fragOutput0.rgb, selectionColor, inside * (0.25 + 0.45 * stripe));
    float border = length(change) > 0.0 ? 1.0 - smoothstep(0.5, 1.5, abs(edge)) : 0.0;
    fragOutput0.rgb = mix(fragOutput0.rgb, vec3(0.06), border);
  }
"""
#: Draws a line along a cut, and the inner side of the surface paler than the outer side.
_CUT = """
  if (cutInwards != 0) {
    if (gl_FrontFacing == (cutInwards < 0)) {
      float stripes = step(0.5, fract((gl_FragCoord.x - gl_FragCoord.y) / (6.0 * pixelsToPoint)));
      fragOutput0.rgb = mix(fragOutput0.rgb, insideColor, 0.5 + 0.12 * stripes);
    }
    float toCut = heightOverCut / max(length(vec2(dFdx(heightOverCut), dFdy(heightOverCut)))
                                      * pixelsToPoint, 1e-30);
    fragOutput0.rgb = mix(lineColor, fragOutput0.rgb, smoothstep(1.5, 2.5, toCut));
  }
"""
#: Size of the colour table in the shader: the maximum number of labels. Each of the 256 colours of
#: a map is repeated. VTK's own colouring is not used, because it computes texture coordinates on
#: the processor, which takes 25 ms for a million vertices.
_COLORS = MOST_LABELS
#: Value in place of NaN, which some drivers do not detect.
_MISSING = np.float32(-3e38)
#: Value at vertices whose faces are not drawn.
_HIDDEN = np.float32(-3.3e38)
#: Width of the textures of vertices; each texel has the values of four vertices, in its red, green,
#: blue and alpha channel. (VTK converts textures of one or two channels to bytes.)
_WIDTH = 1024
_FIELD_IN = """//VTK::Normal::Dec
uniform sampler2D fieldTexture;
uniform sampler2D selectedTexture;
out float fieldVC;
out float selectedVC;
out float hiddenVC;
flat out float labelVC;
"""
_FIELD_THROUGH = f"""//VTK::Normal::Impl
  int texel = gl_VertexID / 4;
  ivec2 place = ivec2(texel % {_WIDTH}, texel / {_WIDTH});
  fieldVC = texelFetch(fieldTexture, place, 0)[gl_VertexID % 4];
  selectedVC = texelFetch(selectedTexture, place, 0)[gl_VertexID % 4];
  hiddenVC = fieldVC < -3.15e38 ? 1.0 : 0.0;
  labelVC = fieldVC;
"""
_FIELD_OUT = """//VTK::Color::Dec
in float fieldVC;
in float selectedVC;
in float hiddenVC;
flat in float labelVC;
"""
#: Maps interpolated values to colours, so that large faces have the right colours. Labels are not
#: interpolated: a face has the label of one of its corners.
_FIELD_COLOR = f"""//VTK::Color::Impl
  if (hiddenVC > 0.0) discard;  // one corner is enough
  float heightOverCut = dot(cutPlane.xyz, vertexVC.xyz) + cutPlane.w;
  if (heightOverCut < 0.0) discard;
  if (fieldShown > 0) {{
    float along = ((fieldLabels > 0 ? labelVC : fieldVC) - fieldLow) * fieldScale;
    // also in faces with one such corner, where rounding may change the sign
    bool missing = !(abs(along) < 1e20);
    if (fieldLogScale > 0.0) {{
      along = (log(max(fieldVC, 1e-37)) - fieldLogLow) * fieldLogScale;
    }}
    int place = missing ? 0 : int(clamp(along, 0.0, {_COLORS - 1}.0));
    int packedColor = missing ? fieldMissing : fieldColors[place];
    vec3 fieldColor =
      vec3(packedColor >> 16, (packedColor >> 8) & 255, packedColor & 255) / 255.0;
    ambientColor = ambientIntensity * fieldColor;
    diffuseColor = diffuseIntensity * fieldColor;
  }}
"""


class _VertexTexture:
    """Texture with one value per vertex, read by the vertex shader at `gl_VertexID`.

    VTK uploads the array of a texture as it is, and copies a vertex attribute to a new array first.
    At a million vertices a move of the brush takes 3 ms less; between the ticks of a slider, no
    difference was measured.
    """

    def __init__(self, actor: vtkActor, name: str, size: int, dtype: npt.DTypeLike) -> None:
        rows = max(math.ceil(size / (4 * _WIDTH)), 1)
        texels = np.zeros((rows * _WIDTH, 4), dtype=dtype)
        self._values = texels.reshape(-1)[:size]
        self._image = vtkImageData()
        self._image.SetDimensions(_WIDTH, rows, 1)
        self._image.GetPointData().SetScalars(numpy_to_vtk(texels))
        texture = vtkTexture()
        texture.SetInputData(self._image)
        texture.SetColorModeToDirectScalars()
        actor.GetProperty().SetTexture(name, texture)

    def write(self, values: npt.NDArray[Any]) -> None:
        """Set the values, shape (size,); they are uploaded with the next frame."""
        self._values[:] = values
        self._image.Modified()  # not the array, whose range VTK would compute again


class Surface:
    """Actor of a surface with a field; VTK uses the memory of points and normals.

    Points, float32 of shape (n, 3), should be near the origin, where float32 is most precise.
    """

    def __init__(
        self,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
        faces: npt.NDArray[np.integer],
    ) -> None:
        self.values = self._given = np.zeros(len(points), dtype=np.float32)
        self._hidden: Mask | None = None
        cells = vtkCellArray()
        cells.SetData(3, numpy_to_vtk(np.ascontiguousarray(faces, dtype=np.int32).ravel()))
        self.data = vtkPolyData()
        self.data.SetPoints(vtkPoints())
        self.data.SetPolys(cells)
        self.move(points, normals)
        self._mapper = vtkPolyDataMapper()
        self._mapper.SetInputData(self.data)
        self._mapper.ScalarVisibilityOff()
        self.actor = vtkActor()
        self.actor.SetMapper(self._mapper)
        self._field = _VertexTexture(self.actor, "fieldTexture", len(points), np.float32)
        self._selected = _VertexTexture(self.actor, "selectedTexture", len(points), np.uint8)
        look = self.actor.GetProperty()
        look.SetAmbient(0.32)
        look.SetDiffuse(0.72)
        look.SetSpecular(0.06)
        look.SetSpecularPower(25.0)
        shaders = self.actor.GetShaderProperty()
        shaders.AddFragmentShaderReplacement("//VTK::Normal::Impl", True, _FACING, False)
        shaders.AddFragmentShaderReplacement(
            "//VTK::Light::Impl", True, _RIM + _LINES + _SELECTED + _CUT, False
        )
        # VTK would multiply the colours by the textures
        shaders.AddFragmentShaderReplacement("//VTK::TCoord::Impl", True, "", False)
        shaders.AddVertexShaderReplacement("//VTK::Normal::Dec", True, _FIELD_IN, False)
        shaders.AddVertexShaderReplacement("//VTK::Normal::Impl", True, _FIELD_THROUGH, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Dec", True, _FIELD_OUT, False)
        shaders.AddFragmentShaderReplacement("//VTK::Color::Impl", True, _FIELD_COLOR, False)
        self._uniforms = shaders.GetFragmentCustomUniforms()
        self._uniforms.SetUniformi("selectionShown", 0)
        self._uniforms.SetUniform3f("selectionColor", rgb(SELECTION_COLOR))
        self._uniforms.SetUniformi("fieldMissing", int(NAN_COLOR[1:], 16))
        self._inwards = 0
        self.cut(None)
        self.set_scale(1.0)
        self.set_theme(LIGHT)
        # every uniform variable must be set once before the first frame
        self.set_caption(Caption("", "", "", 0.0, 1.0, "viridis"))
        self.set_caption(None)

    def move(self, points: npt.NDArray[np.float32], normals: npt.NDArray[np.float32]) -> None:
        """Set points and normals, both of shape (n, 3).

        The arrays are not copied, and must not be changed while displayed.
        """
        arrows = numpy_to_vtk(np.ascontiguousarray(normals, dtype=np.float32))
        arrows.SetName("normals")
        self.data.GetPointData().SetNormals(arrows)
        places = numpy_to_vtk(np.ascontiguousarray(points, dtype=np.float32))
        self.data.GetPoints().SetData(places)
        self.data.Modified()

    def write(self, values: npt.NDArray[np.floating]) -> bool:
        """Set the values, shape (n,); return whether any value is NaN (no value).

        The array is not copied, and must not be changed while displayed.
        """
        shown = np.ascontiguousarray(values, dtype=np.float32)
        # the minimum is NaN if any entry is NaN; it takes one pass and no temporary array
        missing = bool(np.isnan(shown.min(initial=0.0)))
        if missing:
            shown = np.where(np.isnan(shown), _MISSING, shown)
        self._given = shown
        self._show()
        return missing

    def hide(self, hidden: Mask | None) -> None:
        """Hide the faces around given vertices; None shows all faces."""
        self._hidden = hidden
        self._show()

    def select(self, selected: Mask | None) -> None:
        """Draw given vertices as selected; None deselects all vertices."""
        self._uniforms.SetUniformi("selectionShown", int(selected is not None))
        if selected is not None:
            self._selected.write(255 * selected.view(np.uint8))

    def cut(self, plane: tuple[float, float, float, float] | None) -> None:
        """Hide the part with ax + by + cz + d < 0 for a plane (a, b, c, d); None hides nothing.

        x, y and z are camera coordinates.
        """
        if plane is not None and not self._inwards:
            self._inwards = self._orientation()
        # only uniform variables change, so no array is uploaded when the plane moves
        self._uniforms.SetUniform4f("cutPlane", plane or (0.0, 0.0, 0.0, 1.0))
        self._uniforms.SetUniformi("cutInwards", 0 if plane is None else self._inwards)

    def _orientation(self) -> int:
        """Return 1 if the normals mostly point away from the centre of the points, else -1."""
        points = vtk_to_numpy(self.data.GetPoints().GetData())
        normals = vtk_to_numpy(self.data.GetPointData().GetNormals())
        away = np.einsum("ij,ij->i", points - points.mean(axis=0), normals)
        return 1 if np.nansum(away) >= 0.0 else -1

    def _show(self) -> None:
        shown = self._given
        if self._hidden is not None:
            shown = np.where(self._hidden, _HIDDEN, shown)
        self._field.write(shown)
        self.values = shown

    def shown_values(self) -> npt.NDArray[np.float32]:
        """Return a copy of the displayed values, NaN for vertices without a value."""
        return np.where(self.values <= _MISSING, np.float32(np.nan), self.values)

    def set_caption(self, caption: Caption | None) -> None:
        """Set colours, limits and lines of the field by a caption; None for a single colour."""
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
        logarithms = (
            (math.log(caption.low), math.log(caption.high)) if caption.logarithmic else None
        )
        low, high = logarithms or (0.0, math.inf)
        self._uniforms.SetUniformf("fieldLogLow", low)
        self._uniforms.SetUniformf("fieldLogScale", _COLORS / (high - low))
        self._uniforms.SetUniformi("fieldLabels", int(not isinstance(caption.colormap, str)))
        self._uniforms.SetUniformi("linesShown", int(caption.lines is not None))
        self._uniforms.SetUniformf("lineSpacing", caption.lines or 0.0)

    def set_scale(self, scale: float) -> None:
        """Set the number of pixels per point, for the width of lines and silhouettes."""
        self._uniforms.SetUniformf("pixelsToPoint", scale)

    def set_theme(self, theme: RenderTheme) -> None:
        """Set the colours of the lines, and of the surface without a field."""
        self.actor.GetProperty().SetColor(*rgb(theme.surface))
        self._uniforms.SetUniform3f("lineColor", rgb(theme.line))
        self._uniforms.SetUniform3f("insideColor", rgb(theme.inside))


class StandIn(Surface):
    """Simplified surface that follows the values, selection and positions of the full surface."""

    def __init__(
        self,
        mesh: CoarseMesh,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
    ) -> None:
        self.mesh, self._points, chosen = mesh, points, mesh.representatives
        super().__init__(points[chosen], normals[chosen], mesh.faces)

    def follow(
        self,
        full: Surface,
        selected: Mask | None,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
    ) -> None:
        """Copy values, selection, displayed points and normals of the full surface."""
        chosen = self.mesh.representatives
        self.write(full.values[chosen])
        self.select(None if selected is None else selected[chosen])
        if points is not self._points:  # copying scattered rows is slow
            self._points = points
            self.move(points[chosen], normals[chosen])


#: Diameters, in points, of marked points, of the corners of marked edges and faces (visible where
#: an edge or face is smaller than a pixel), and of the nodes of a graph.
_POINT, _CORNER, _NODE = 8.0, 5.0, 3.6


class Layer(NamedTuple):
    """Style of an actor; several actors (layers) draw the same marks."""

    #: Offset away from the eye, in units of depth; negative for in front of the surface.
    front: float
    opacity: float
    color: str
    #: Width of lines in points.
    width: float


#: Marks of faults, in a colour that no colour map contains. Marks behind the surface are drawn
#: fainter, by the second layer.
FAULTS = (Layer(-8.0, 1.0, "#ff2fa8", 2.5), Layer(-1e6, 0.45, "#ff2fa8", 2.5))
#: Borders between labels: dark lines with a faint light edge, visible over every colour.
BORDERS = (Layer(-8.0, 0.4, "#ffffff", 3.6), Layer(-12.0, 1.0, "#14181d", 1.8))
#: Graph of regions, visible through the mesh. Both layers have the same depth at this offset; VTK
#: draws the second layer over the first only if the first is opaque.
GRAPH = (Layer(-1e6, 1.0, "#ffffff", 2.4), Layer(-1e6, 1.0, "#14181d", 1.2))


class Overlay:
    """Base class of marks and points over the surface; each window needs a separate copy.

    Pickled overlays are copies for another process.
    """

    #: pyvista.PolyData: points (relative to the centre of the mesh) and cells of the marks.
    _data: Any
    actor: Any
    _mappers: list[vtkMapper]
    #: Legend of the colours.
    legend: PointLegend | None = None

    def move(self, drawn: npt.NDArray[np.float32]) -> None:
        """Move the overlay to the displayed vertices, shape (n, 3)."""
        raise NotImplementedError

    def hide(self, hidden: Mask | None) -> None:
        """Hide the parts at hidden vertices; by default nothing is hidden."""

    def cut(self, plane: Plane | None) -> None:
        """Hide the part behind a plane in mesh coordinates; None hides nothing."""
        for mapper in self._mappers:
            mapper.RemoveAllClippingPlanes()
            if plane is not None:
                clipping = vtkPlane()
                clipping.SetNormal(*plane.normal)
                clipping.SetOrigin(*(plane.level * plane.normal))
                mapper.AddClippingPlane(clipping)

    def set_scale(self, scale: float) -> None:
        """Set the number of pixels per point."""
        raise NotImplementedError

    def _make_actor(self) -> None:
        """Make the actor of `_data`, and its mappers."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        made = ("actor", "_mappers", "_looks")
        return {name: each for name, each in self.__dict__.items() if name not in made}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._data = state["_data"].copy()
        self._make_actor()

    def copy(self) -> Self:
        """Return a copy for another window."""
        other = object.__new__(type(self))
        other.__setstate__(self.__getstate__())
        return other


class Marks(Overlay):
    """Marked points, edges or faces, given by their vertices: shape (k, 1), (k, 2) or (k, 3).

    The edges of a face are drawn as well, so that a face without area is visible. The corners of
    all marks except borders are also drawn.
    """

    def __init__(self, parts: IntArray, layers: tuple[Layer, ...] = FAULTS) -> None:
        import pyvista  # slow to import, and not needed by pictures without marks

        self.parts, self._layers = parts, layers
        self._vertices, numbers = np.unique(parts, return_inverse=True)
        numbers = numbers.reshape(parts.shape)
        self._data = pyvista.PolyData(np.zeros((len(self._vertices), 3), dtype=np.float32))
        if layers is BORDERS:
            self._data.verts = np.zeros(0, dtype=np.int64)
        if parts.shape[1] == 2:
            self._data.lines = _padded(numbers)
        elif parts.shape[1] == 3:
            self._data.faces = _padded(numbers)
            self._data.lines = _padded(numbers[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))
        corner = _NODE if layers is GRAPH else _CORNER
        self._point = _POINT if parts.shape[1] == 1 else corner
        self._make_actor()

    def _make_actor(self) -> None:
        self.actor = vtkAssembly()
        self.actor.PickableOff()
        actors = [_drawn(self._data, each) for each in self._layers]
        self._looks = [each.GetProperty() for each in actors]
        self._mappers = [each.GetMapper() for each in actors]
        for each in actors:
            self.actor.AddPart(each)

    def move(self, drawn: npt.NDArray[np.float32]) -> None:
        self._data.points = drawn[self._vertices]

    def set_scale(self, scale: float) -> None:
        for look, layer in zip(self._looks, self._layers, strict=True):
            look.SetLineWidth(layer.width * scale)
            look.SetPointSize(self._point * scale)


def overlay_actor(data: vtkPolyData, front: float) -> vtkActor:
    """Return the actor of points, lines and faces, with an offset as in `Layer.front`."""
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, front)
    mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, front)
    mapper.SetRelativeCoincidentTopologyPointOffsetParameter(front)
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.PickableOff()
    actor.GetProperty().SetRenderPointsAsSpheres(True)
    return actor


def _drawn(data: vtkPolyData, layer: Layer) -> vtkActor:
    actor = overlay_actor(data, layer.front)
    look = actor.GetProperty()
    look.SetColor(*rgb(layer.color))
    look.SetOpacity(layer.opacity)
    look.LightingOff()
    return actor


def _padded(cells: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Return cells of k vertices, shape (n, k), as pyvista stores them: k before each cell."""
    return np.insert(cells, 0, cells.shape[1], axis=1).ravel()
