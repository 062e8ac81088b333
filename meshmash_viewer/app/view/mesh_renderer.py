"""The whole picture: mesh, field, lines, pins and what is written, for any window that shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
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
from meshmash_viewer.app.view.surface import Surface
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import Field
from meshmash_viewer.surface.clustering import CoarseMesh
from meshmash_viewer.surface.rays import RayTarget

__all__ = ["MeshRenderer"]


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
        self.annotations = Annotations(self.renderer)
        self.mesh: Mesh | None = None
        self.normals: npt.NDArray[np.float32] | None = None
        self.centre = np.zeros(3)
        #: Points and directions by which the whole mesh is shown from its best side.
        self.sample, self.axes = np.zeros((1, 3)), np.eye(3)
        self._bounds = np.zeros((2, 3))
        #: Where vertices are drawn that are not where the mesh has them, relative to `centre`.
        self.moved: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]] | None = None
        self.view: View | None = None
        self._placed: tuple[View | None, int] = (None, 0)
        self._hidden: tuple[Any, ...] = ()
        self._pins_placed: list[Pin] = []
        self.caption: Caption | None = None
        #: Written in the place of the quantity while another field is being computed.
        self.awaited = ""
        self.surface: Surface | None = None
        self.coarse: Surface | None = None
        #: What lines of sight are cast against, once it is there.
        self.picker: RayTarget | None = None
        self._coarse_mesh: CoarseMesh | None = None
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
            surface.set_theme(self.theme)

    @property
    def _surfaces(self) -> list[Surface]:
        """The mesh and its stand-in, as far as they are there."""
        return [surface for surface in (self.surface, self.coarse) if surface is not None]

    def set_mesh(self, mesh: Mesh | None, normals: npt.NDArray[np.float32] | None) -> None:
        """Take a mesh with normals of shape (n, 3), or none; field and pins go."""
        for surface in self._surfaces:
            self.renderer.RemoveActor(surface.actor)
        self.surface = self.coarse = self.picker = self._coarse_mesh = self.moved = None
        self.caption, self._pins = None, ()
        if mesh is None:
            self.mesh = self.normals = self.view = None
            return
        normals = mesh.vertex_normals if normals is None else normals
        self.mesh, self.normals = mesh, normals
        geometry = geometry_of(mesh)
        self.sample, self.axes = geometry.sample, geometry.axes
        self.centre, self._bounds = geometry.centre, geometry.bounds
        self.surface = self._new_surface(geometry.points, geometry.faces, normals)

    def move(
        self,
        points: npt.NDArray[np.float32] | None,
        normals: npt.NDArray[np.float32] | None = None,
    ) -> None:
        """Draw the vertices elsewhere; nothing can be picked.

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
        else:
            if normals is None:
                normals = self.normals if self.moved is None else self.moved[1]
            self.moved = (points, normals)
            self.surface.move(points, normals)
        self.picker = None
        # what moves reaches beyond the mesh, and is not to be cut off
        room = 0.0 if points is None else 0.3 * np.ptp(geometry.bounds, axis=0).max()
        self._bounds = geometry.bounds + np.array([[-room], [room]])
        self._hidden = ()

    @property
    def drawn(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Where the vertices are drawn relative to `centre`, and normals, both of shape (n, 3)."""
        assert self.mesh is not None
        assert self.normals is not None
        return self.moved or (geometry_of(self.mesh).points, self.normals)

    def place(self, vertex: int) -> npt.NDArray[np.float64]:
        """Where a vertex is drawn, shape (3,), in mesh coordinates."""
        assert self.mesh is not None
        if self.moved is None and self.mesh.referenced[vertex]:
            return np.asarray(self.mesh.vertices[vertex])
        return np.asarray(self.drawn[0][vertex] + self.centre)

    @property
    def drawn_vertices(self) -> npt.NDArray[np.float64]:
        """Where all of them are drawn, shape (n, 3), in mesh coordinates."""
        assert self.mesh is not None
        if self.moved is None and not len(self.mesh.unreferenced):
            return self.mesh.vertices
        return self.drawn[0] + self.centre

    def _new_surface(
        self,
        points: npt.NDArray[np.float32],
        faces: npt.NDArray[np.integer[Any]],
        normals: npt.NDArray[np.float32],
    ) -> Surface:
        surface = Surface(points, faces, normals)
        surface.actor.SetPosition(*self.centre)
        surface.set_theme(self.theme)
        surface.dress(self.caption)
        self.renderer.AddActor(surface.actor)
        return surface

    def set_coarse(self, coarse: CoarseMesh, dot_size: float = 0.0) -> None:
        """Take a stand-in that `show_coarse` draws in place of the mesh, and of one before it.

        Parameters
        ----------
        coarse : CoarseMesh
        dot_size : float
            Pixels; other than 0, only the vertices are drawn, in dots of that size.
        """
        if self.coarse is not None:
            self.renderer.RemoveActor(self.coarse.actor)
        points, normals = (each[coarse.representatives] for each in self.drawn)
        self.coarse, self._coarse_mesh = self._new_surface(points, coarse.faces, normals), coarse
        self.coarse.actor.VisibilityOff()
        if dot_size:
            self.coarse.show_as_dots(dot_size)

    def show_coarse(self, shown: bool) -> None:
        """Draw the stand-in, if it is there yet, or the mesh."""
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
        lines: float | None = None,
    ) -> None:
        """Colour the mesh by values of shape (n,), or by none; the rest is that of a `Caption`.

        Raises
        ------
        ValueError
            If there is not one value a vertex, or no such colour map.
        """
        if self.mesh is None or self.surface is None:
            return
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
            missing = self.surface.write(values)
            self.caption = Caption(title, quantity, unit, low, high, colormap, missing, lines)
        for surface in self._surfaces:
            surface.dress(self.caption)

    def show(
        self, field: Field, limits: tuple[float, float], colormap: ColorMap, *, lined: bool
    ) -> None:
        """Colour the mesh by a field, with all that it says of itself, and its lines."""
        assert self.mesh is not None
        self.set_field(
            self.mesh.on_surface(field.values),
            limits,
            colormap,
            field.title,
            field.told(lined),
            field.unit,
            lines=field.line_spacing if lined else None,
        )

    @property
    def said(self) -> Caption | None:
        """What is written about the field, and that another one is awaited."""
        if self.caption is None or not self.awaited:
            return self.caption
        return replace(self.caption, quantity=self.awaited)

    def set_pins(self, pins: Sequence[tuple[int, str, str]]) -> None:
        """Mark vertices in their colours, each with a label."""
        self._pins = tuple(pins)

    # -- the eye ----------------------------------------------------------------------------

    def fit_view(
        self, width: int, height: int, scale: float, axes: npt.NDArray[np.float64] | None = None
    ) -> None:
        """Show the whole mesh along given axes, or from its best side."""
        space = margins(self.caption is not None, width, height, scale)
        axes = self.axes if axes is None else axes
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
            self.fit_view(width, height, scale)
        if self.view is not None:
            for surface in self._surfaces:
                surface.set_scale(scale)
            self._place_camera(self.view, width, height)
        page = Page(self.theme, width, height, scale, plates)
        unit = "" if self.mesh is None else self.mesh.unit
        view = self.view if self.annotated else None
        self.annotations.show(page, view, self.said, unit, self._placed_pins())

    def _write_coarse(self) -> None:
        """Give the stand-in values and places of the mesh at its vertices."""
        assert self.surface is not None
        assert self.coarse is not None
        assert self._coarse_mesh is not None
        chosen = self._coarse_mesh.representatives
        self.coarse.write(self.surface.values[chosen])
        points, normals = self.drawn
        self.coarse.move(points[chosen], normals[chosen])

    def _place_camera(self, view: View, width: int, height: int) -> None:
        camera = self.renderer.GetActiveCamera()
        known_view, known_time = self._placed
        if known_view is view and known_time != camera.GetMTime():
            view = self.view = _view_of(camera, width, height)  # somebody else has turned it
        # Not the surface's own bounds: VTK goes through all faces to find them.
        boxes = [self.centre + self._bounds]
        for box in (prop.GetBounds() for prop in self.added()):
            if box is not None and box[0] <= box[1]:
                boxes.append(np.reshape(box, (3, 2)).T)
        reach = max(float(np.linalg.norm(np.abs(box - view.focus).max(axis=0))) for box in boxes)
        reach = max(reach, 1e-300)
        camera.ParallelProjectionOn()
        camera.SetFocalPoint(*view.focus)
        camera.SetPosition(*(view.focus + 2.0 * reach * view.axes[2]))
        camera.SetViewUp(*view.axes[1])
        camera.SetParallelScale(view.half_size * height / max(min(width, height), 1))
        camera.SetClippingRange(0.9 * reach, 3.1 * reach)
        self._placed = view, camera.GetMTime()

    def _placed_pins(self) -> list[Pin]:
        if self.mesh is None or self.view is None or not self._pins:
            return []
        known = (self.view, self.picker, self._pins)
        if self._hidden != known:
            self._hidden = known
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
        ours |= set(map(id, self.annotations.actors))
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
            other.surface.dress(self.caption)
            other.caption = self.caption
        return other


def _view_of(camera: vtkCamera, width: int, height: int) -> View:
    rows = camera.GetViewTransformMatrix()
    axes = [[rows.GetElement(row, column) for column in range(3)] for row in range(3)]
    half_size = camera.GetParallelScale() * min(width, height) / height
    return View(np.array(camera.GetFocalPoint()), np.array(axes), half_size)
