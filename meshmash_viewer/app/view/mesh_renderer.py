"""The whole picture: mesh, field, lines, pins and what is written, for any window that shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkCamera,
    vtkLight,
    vtkProp,
    vtkRenderer,
    vtkRenderWindow,
)

from meshmash_viewer.app.view.annotations import Annotations, Caption, Page, Pin, margins
from meshmash_viewer.app.view.camera import View, fitted_view
from meshmash_viewer.app.view.colors import DARK, LIGHT, ColorMap, color_table, rgb
from meshmash_viewer.app.view.geometry import geometry_of
from meshmash_viewer.app.view.picking import Picker
from meshmash_viewer.app.view.surface import LineSet, Surface
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.clustering import CoarseMesh

__all__ = ["MeshRenderer", "read_pixels"]


class MeshRenderer:
    """What is drawn, without a window: `add_to` one, and `prepare` runs per frame.

    The renderer is in mesh coordinates, and so is what others add to it. Our own actors hold
    their points relative to the middle of the mesh, where single precision is enough, and stand
    there; VTK multiplies matrices in double precision.

    Parameters
    ----------
    dark : bool
        Which theme.
    renderer : vtkRenderer, optional
        That of a plotter; a new one if none is given.
    """

    def __init__(self, dark: bool = False, renderer: vtkRenderer | None = None) -> None:
        self.renderer = vtkRenderer() if renderer is None else renderer
        self.renderer.SetUseDepthPeeling(False)
        self.renderer.AutomaticLightCreationOff()
        # From over the left shoulder, and a weak one from the other side; both go with the eye.
        for x, y, z, intensity in ((-0.5, 0.7, 1.6, 0.92), (0.9, -0.5, 0.8, 0.30)):
            light = vtkLight()
            light.SetLightTypeToCameraLight()
            light.SetPosition(x, y, z)
            light.SetFocalPoint(0.0, 0.0, 0.0)
            light.SetIntensity(intensity)
            self.renderer.AddLight(light)
        self.renderer.GetActiveCamera().ParallelProjectionOn()
        self._lines = LineSet()
        self.renderer.AddActor(self._lines.actor)
        self.annotations = Annotations(self.renderer)
        self.mesh: Mesh | None = None
        self.normals: npt.NDArray[np.float32] | None = None
        self.centre = np.zeros(3)
        #: Points and directions by which the whole mesh is shown from its best side.
        self.sample, self.axes = np.zeros((1, 3)), np.eye(3)
        self._bounds = np.zeros((2, 3))
        #: Where vertices are drawn that are not where the mesh has them, relative to `centre`.
        self.moved: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]] | None = None
        self._coarse_moved: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]] | None = None
        self._own_picker: Picker | None = None
        self.view: View | None = None
        self._placed: tuple[Any, ...] | None = None
        self._scale = 0.0
        self._hidden: tuple[Any, ...] = ()
        self._pins_placed: list[Pin] = []
        self.caption: Caption | None = None
        self.surface: Surface | None = None
        self.coarse: Surface | None = None
        self.picker: Picker | None = None
        self._coarse_mesh: CoarseMesh | None = None
        #: The values of the mesh that the stand-in has those of its vertices from.
        self._coarse_of: npt.NDArray[np.float32] | None = None
        self._segments: tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]] | None = None
        self._pins: tuple[tuple[int, str, str], ...] = ()
        #: Whether anything is written over the mesh.
        self.annotated = True
        self.set_theme(dark)

    # -- what is drawn ----------------------------------------------------------------------

    def smooth_afterwards(self, smooth: bool) -> None:
        """Smooth edges in the finished frame, where more samples a pixel would take too long."""
        self.renderer.SetUseFXAA(smooth)

    def set_theme(self, dark: bool) -> None:
        """Colours of the background and of all that is not the field."""
        self.dark = dark
        self.theme = DARK if dark else LIGHT
        self.renderer.SetBackground(*rgb(self.theme.background_bottom))
        self.renderer.SetBackground2(*rgb(self.theme.background_top))
        self.renderer.GradientBackgroundOn()
        for surface in self._surfaces:
            surface.actor.GetProperty().SetColor(*rgb(self.theme.surface))

    @property
    def _surfaces(self) -> list[Surface]:
        """The mesh and its stand-in, as far as they are there."""
        return [surface for surface in (self.surface, self.coarse) if surface is not None]

    def set_mesh(
        self, mesh: Mesh | None, normals: npt.NDArray[np.float32] | None, *, picking: bool = False
    ) -> None:
        """Take a mesh with normals of shape (n, 3), or none; field, lines and pins go."""
        for surface in self._surfaces:
            self.renderer.RemoveActor(surface.actor)
        for picker in (self.picker, self._own_picker):
            if picker is not None:
                picker.stop()
        self.surface = self.coarse = self.picker = self._coarse_mesh = self._coarse_of = None
        self.moved = self._coarse_moved = self._own_picker = None
        self.caption, self._pins = None, ()
        self.set_segments(None)
        if mesh is None:
            self.mesh = self.normals = self.view = None
            return
        normals = mesh.vertex_normals if normals is None else normals
        self.mesh, self.normals = mesh, normals
        self._placed = None
        geometry = geometry_of(mesh)
        self.sample, self.axes = geometry.sample, geometry.axes
        self.centre, self._bounds = geometry.centre, geometry.bounds
        self.surface = self._new_surface(geometry.points, geometry.faces, normals)
        if picking:
            self.picker = self._own_picker = self._new_picker(geometry.points)

    def _new_picker(self, points: npt.NDArray[np.float32]) -> Picker:
        assert self.mesh is not None
        geometry = geometry_of(self.mesh)
        size = float(np.linalg.norm(geometry.bounds[1] - geometry.bounds[0]))
        return Picker(points, geometry.faces, size)

    def move(
        self,
        points: npt.NDArray[np.float32] | None,
        normals: npt.NDArray[np.float32] | None = None,
    ) -> None:
        """Draw the vertices elsewhere; `segments` go, and nothing can be picked.

        Parameters
        ----------
        points : ndarray of float32, shape (n, 3), or None
            Relative to `centre`; None for where the mesh has them.
        normals : ndarray of float32, shape (n, 3), optional
            Those of before, if none are given.
        """
        if self.mesh is None or self.surface is None or self.normals is None:
            return
        geometry = geometry_of(self.mesh)
        if points is None:
            self.moved = None
            self.surface.move(geometry.points, self.normals)
            self.picker = self._own_picker
        else:
            if normals is None:
                normals = self.normals if self.moved is None else self.moved[1]
            self.moved = (points, normals)
            self.surface.move(points, normals)
            if self.picker is not self._own_picker and self.picker is not None:
                self.picker.stop()
            self.picker = None
        # what moves reaches beyond the mesh, and is not to be cut off
        room = 0.0 if points is None else 0.3 * np.ptp(geometry.bounds, axis=0).max()
        self._bounds = geometry.bounds + np.array([[-room], [room]])
        self._placed, self._hidden = None, ()
        self.set_segments(None)

    def pick_moved(self) -> None:
        """Let the vertices be picked where they are drawn now."""
        if self.moved is not None and self.picker is None and self._own_picker is not None:
            self.picker = self._new_picker(self.moved[0])

    def place(self, vertex: int) -> npt.NDArray[np.float64]:
        """Where a vertex is drawn, shape (3,), in mesh coordinates."""
        assert self.mesh is not None
        if self.moved is None:
            return np.asarray(self.mesh.vertices[vertex])
        return np.asarray(self.moved[0][vertex] + self.centre)

    @property
    def drawn_vertices(self) -> npt.NDArray[np.float64]:
        """Where all of them are drawn, shape (n, 3), in mesh coordinates."""
        assert self.mesh is not None
        return self.mesh.vertices if self.moved is None else self.moved[0] + self.centre

    def _new_surface(
        self,
        points: npt.NDArray[np.float32],
        faces: npt.NDArray[np.integer[Any]],
        normals: npt.NDArray[np.float32],
    ) -> Surface:
        surface = Surface(points, faces, normals)
        surface.actor.SetPosition(*self.centre)
        surface.actor.GetProperty().SetColor(*rgb(self.theme.surface))
        surface.set_scale(self._scale or 1.0)
        if self.caption is not None:
            _dress(surface, self.caption)
        self.renderer.AddActor(surface.actor)
        return surface

    def set_coarse(
        self,
        coarse: CoarseMesh,
        points: npt.NDArray[np.float32],
        normals: npt.NDArray[np.float32],
        dot_size: float = 0.0,
    ) -> None:
        """Take a stand-in that `show_coarse` draws in place of the mesh, and of one before it.

        Parameters
        ----------
        coarse : CoarseMesh
        points, normals : ndarray of float32, shape (c, 3)
            Of its representatives, relative to `centre`.
        dot_size : float
            Pixels; other than 0, only the vertices are drawn, in dots of that size.
        """
        if self.coarse is not None:
            self.renderer.RemoveActor(self.coarse.actor)
        self.coarse = self._new_surface(points, coarse.faces, normals)
        self.coarse.actor.VisibilityOff()
        if dot_size:
            self.coarse.show_as_dots(dot_size)
        self._coarse_mesh, self._coarse_of, self._coarse_moved = coarse, None, None

    def show_coarse(self, shown: bool) -> None:
        """Draw the stand-in, if it is there yet, or the mesh with its lines."""
        self._lines.actor.SetVisibility(not shown and self._segments is not None)
        if self.surface is not None:
            self.surface.actor.SetVisibility(not shown)
        if self.coarse is not None:
            self.coarse.actor.SetVisibility(shown)

    @property
    def shows_coarse(self) -> bool:
        """Whether the stand-in is drawn."""
        return self.coarse is not None and bool(self.coarse.actor.GetVisibility())

    def set_field(
        self,
        values: npt.NDArray[np.floating] | None,
        limits: tuple[float, float],
        colormap: ColorMap,
        title: str = "",
        quantity: str = "",
        unit: str = "",
        *,
        complete: bool = False,
    ) -> None:
        """Colour the mesh by values of shape (n,), or by none.

        `complete` says that none of them is NaN, so that this need not be looked for.

        Raises
        ------
        ValueError
            If there is not one value a vertex, or no such colour map.
        """
        if self.mesh is None or self.surface is None:
            return
        before = None
        if values is None:
            self.caption = None
        else:
            if values.shape != (self.mesh.n_vertices,):
                raise ValueError(
                    f"A field of shape {values.shape} does not fit a mesh of "
                    f"{self.mesh.n_vertices} vertices."
                )
            color_table(colormap)  # refuses what is none before anything is changed
            low, high = (float(limit) for limit in limits)
            missing = self.surface.write(values, complete=complete)
            before = self.caption
            self.caption = Caption(title, quantity, unit, low, high, colormap, missing)
        for surface in self._surfaces:
            if self.caption is None:
                surface.show_field(False)
            else:
                _dress(surface, self.caption, before)

    def set_segments(
        self,
        segments: npt.NDArray[np.float32] | None,
        widths: npt.NDArray[np.float64] | None = None,
    ) -> None:
        """Draw segments of shape (s, 2, 3) relative to `centre`, or none.

        `widths`, of shape (s,), are those of the branches that they go around.
        """
        self._segments = None
        if segments is not None and widths is not None and len(segments):
            self._segments = segments, widths
        self._lines.show(segments, widths)

    @property
    def segments(self) -> npt.NDArray[np.float32] | None:
        """The segments that are drawn, relative to `centre`."""
        return None if self._segments is None else self._segments[0]

    def set_pins(self, pins: Sequence[tuple[int, str, str]]) -> None:
        """Mark vertices in their colours, each with a label."""
        self._pins = tuple(pins)

    # -- the eye ----------------------------------------------------------------------------

    def reset_view(self, width: int, height: int, scale: float) -> None:
        """Show the whole mesh from its best side."""
        if self.mesh is not None:
            self.fit_view(self.axes, width, height, scale)

    def fit_view(
        self, axes: npt.NDArray[np.float64], width: int, height: int, scale: float
    ) -> None:
        """Show the whole mesh along given axes."""
        space = margins(self.caption is not None, width, height, scale)
        self.view = fitted_view(self.sample, axes, width, height, space)

    def prepare(self, width: int, height: int, scale: float, plates: bool = True) -> None:
        """Set field, camera and annotations for a frame of this size.

        Parameters
        ----------
        width, height : int
            In pixels.
        scale : float
            Pixels to one point of what is written.
        plates : bool
            Whether that has plates in the colour of the background behind it.
        """
        if self.shows_coarse:
            self._write_coarse()
        if self.mesh is not None and self.view is None:
            self.reset_view(width, height, scale)
        if self.view is not None:
            if scale != self._scale:
                self._scale = scale
                self._lines.actor.GetProperty().SetLineWidth(2.0 * scale)
                for surface in self._surfaces:
                    surface.set_scale(scale)
            self._place_camera(self.view, width, height)
            length_per_point = scale * self.view.length_per_pixel(width, height)
            self._lines.fade(length_per_point, rgb(self.theme.line))
        page = Page(self.theme, width, height, scale, plates)
        unit = "" if self.mesh is None else self.mesh.unit
        view = self.view if self.annotated else None
        self.annotations.show(page, view, self.caption, unit, self._placed_pins())

    def _write_coarse(self) -> None:
        """Give the stand-in the values of the mesh at its vertices, if they are new."""
        assert self.surface is not None
        assert self.coarse is not None
        assert self._coarse_mesh is not None
        if self._coarse_of is not self.surface.values:
            self._coarse_of = self.surface.values
            self.coarse.write(self._coarse_of[self._coarse_mesh.representatives])
        if self._coarse_moved is not self.moved:
            self._coarse_moved = self.moved
            assert self.mesh is not None
            assert self.normals is not None
            points, normals = self.moved or (geometry_of(self.mesh).points, self.normals)
            chosen = self._coarse_mesh.representatives
            self.coarse.move(points[chosen], normals[chosen])

    def _place_camera(self, view: View, width: int, height: int) -> None:
        camera = self.renderer.GetActiveCamera()
        known_view, known_time = (None, 0) if self._placed is None else self._placed[-2:]
        if known_view is view and known_time != camera.GetMTime():
            view = self.view = _view_of(camera, width, height)  # somebody else has turned it
        boxes = (prop.GetBounds() for prop in self.added())
        added = tuple(box for box in boxes if box is not None and box[0] <= box[1])
        place = (width, height, added, view, camera.GetMTime())
        if place == self._placed:  # VTK would take it for another camera
            return
        # Not the surface's own bounds: VTK goes through all faces to find them.
        corners = [self.centre + self._bounds, *(np.reshape(box, (3, 2)).T for box in added)]
        reach = max(float(np.linalg.norm(np.abs(box - view.focus).max(axis=0))) for box in corners)
        reach = max(reach, 1e-300)
        # Nodal lines lie in the surface: some pixels nearer to the eye they are seen whole, and, in
        # a parallel projection, at the same place.
        lift = 5.0 * view.length_per_pixel(width, height)
        self._lines.actor.SetPosition(*(self.centre + lift * view.axes[2]))
        camera.ParallelProjectionOn()
        camera.SetFocalPoint(*view.focus)
        camera.SetPosition(*(view.focus + 2.0 * reach * view.axes[2]))
        camera.SetViewUp(*view.axes[1])
        camera.SetParallelScale(view.half_size * height / max(min(width, height), 1))
        camera.SetClippingRange(0.9 * reach, 3.1 * reach)
        self._placed = (*place[:-1], camera.GetMTime())

    def _placed_pins(self) -> list[Pin]:
        if self.mesh is None or self.view is None or not self._pins:
            return []
        ready = self.picker is not None and self.picker.ready
        if self._hidden[:1] != (self.view,) or self._hidden[1:] != (ready, self._pins):
            self._hidden = (self.view, ready, self._pins)
            eye = self.view.axes[2]
            self._pins_placed = [
                Pin(
                    tuple(self.place(vertex).tolist()),
                    color,
                    label,
                    self.picker is not None and self.picker.hidden(vertex, eye),
                )
                for vertex, color, label in self._pins
            ]
        return self._pins_placed

    # -- what others have added ---------------------------------------------------------------

    def added(self) -> Iterator[vtkProp]:
        """Actors in the renderer that are not ours."""
        ours = {id(surface.actor) for surface in self._surfaces}
        ours |= {id(self._lines.actor), *map(id, self.annotations.actors)}
        props = self.renderer.GetViewProps()
        for number in range(props.GetNumberOfItems()):
            prop = props.GetItemAsObject(number)
            if isinstance(prop, vtkProp) and id(prop) not in ours:
                yield prop

    def _add_copies(self, props: Iterator[vtkProp]) -> None:
        """Take actors of another window: the data are shared, what the card holds is not."""
        for prop in props:
            copy = prop.NewInstance()
            copy.ShallowCopy(prop)
            if isinstance(copy, vtkActor) and isinstance(prop, vtkActor) and prop.GetMapper():
                known = prop.GetMapper()
                mapper = known.NewInstance()
                mapper.ShallowCopy(known)
                if known.GetNumberOfInputConnections(0):
                    mapper.SetInputConnection(known.GetInputConnection(0, 0))
                copy.SetMapper(mapper)
            self.renderer.AddViewProp(copy)

    def add_to(self, window: vtkRenderWindow) -> None:
        """Draw into a window from now on."""
        window.SetNumberOfLayers(2)
        if not window.HasRenderer(self.renderer):
            window.AddRenderer(self.renderer)
        window.AddRenderer(self.annotations.corner)

    def remove_from(self, window: vtkRenderWindow) -> None:
        """Let go of a window."""
        window.RemoveRenderer(self.annotations.corner)
        window.RemoveRenderer(self.renderer)

    def leave_background(self) -> None:
        """Leave nothing behind the mesh, black and clear."""
        self.renderer.GradientBackgroundOff()
        self.renderer.SetBackground(0.0, 0.0, 0.0)
        self.renderer.SetBackgroundAlpha(0.0)

    # -- another one of the same ------------------------------------------------------------

    def twin(self) -> MeshRenderer:
        """The same picture for another window; the arrays of mesh and field are shared."""
        other = MeshRenderer(self.dark)
        other._add_copies(self.added())
        if self.mesh is None:
            return other
        other.set_mesh(self.mesh, self.normals)
        assert self.surface is not None
        assert other.surface is not None
        if self.moved is not None:
            other.move(*self.moved)
        other.view, other.picker, other._pins = self.view, self.picker, self._pins
        if self.caption is not None:
            other.surface.write(self.surface.values)
            _dress(other.surface, self.caption)
            other.caption = self.caption
        if self._segments is not None:
            other.set_segments(*self._segments)
        return other

    def camera_state(self) -> dict[str, Any] | None:
        """The view for a session file."""
        return self.view.to_json() if self.view is not None else None


def _view_of(camera: vtkCamera, width: int, height: int) -> View:
    rows = camera.GetViewTransformMatrix()
    axes = [[rows.GetElement(row, column) for column in range(3)] for row in range(3)]
    half_size = camera.GetParallelScale() * min(width, height) / height
    return View(np.array(camera.GetFocalPoint()), np.array(axes), half_size)


def _dress(surface: Surface, caption: Caption, before: Caption | None = None) -> None:
    """Give a surface the colours of a caption, as far as they are not those of the one before."""
    if before is None or caption.colormap != before.colormap:
        surface.set_colors(caption.table)
        surface.show_labels(not isinstance(caption.colormap, str))
    if before is None or (caption.low, caption.high) != (before.low, before.high):
        surface.set_range(caption.low, caption.high)
    if before is None:
        surface.show_field(True)


def read_pixels(
    window: vtkRenderWindow, alpha: bool, bottom: int, rows: int
) -> npt.NDArray[np.uint8]:
    """Rows of the frame that was rendered last, shape (rows, width, 3 or 4), upper row first.

    A view: VTK has the lowest row first. `bottom` is the lowest, counted from below.
    """
    width, _ = window.GetSize()
    pixels = vtkUnsignedCharArray()
    corners = (0, bottom, width - 1, bottom + rows - 1)
    if alpha:
        # The samples of a pixel are averaged here once more: VTK averages light, not colours
        # times opacity, for the frame on the screen.
        window.GetRGBACharPixelData(*corners, 0, pixels, 0)
    else:
        # The frame as it would be on the screen; averaged already, while it was drawn.
        window.GetPixelData(*corners, 1, pixels, 0)
    shown: npt.NDArray[np.uint8] = vtk_to_numpy(pixels).reshape(rows, width, -1)[::-1]
    return shown
