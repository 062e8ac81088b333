"""Drawing of a mesh with its field, lines, pins and annotations in a VTK renderer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the renderers)
from vtkmodules.vtkRenderingCore import vtkActor, vtkCamera, vtkLight, vtkProp, vtkRenderer

from meshmash_viewer.app.view.annotations import Annotations, Page, margins
from meshmash_viewer.app.view.camera import SAMPLED, View, fitted_view, geometry_of
from meshmash_viewer.app.view.caption import Caption, Pin, PointLegend
from meshmash_viewer.app.view.points import PointCloud
from meshmash_viewer.app.view.style import DARK, LIGHT, color_table, rgb
from meshmash_viewer.app.view.surface import Overlay, StandIn, Surface
from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.decimation import CoarseMesh
from meshmash_viewer.surface.masks import Mask
from meshmash_viewer.surface.rays import Plane, RayTarget

#: Maximum number of pins with labels.
_LABELLED = 40
_NOTHING = np.zeros((0, 3), dtype=np.float32)


class MeshRenderer:
    """Drawing of a mesh in a VTK renderer, to be added to a window; call `prepare` at each frame.

    `renderer` has mesh coordinates, so that scripts can add actors. The actors of this class have
    points relative to the centre of the mesh, for which single precision is sufficient, and are
    positioned at the centre; VTK multiplies matrices in double precision.
    """

    def __init__(self, dark: bool = False, renderer: vtkRenderer | None = None) -> None:
        self.renderer = vtkRenderer() if renderer is None else renderer
        self.renderer.SetUseDepthPeeling(False)
        # they would compute bounds from all faces, 70 ms in the first frame of a million vertices
        self.renderer.GetCullers().RemoveAllItems()
        self.renderer.AutomaticLightCreationOff()
        # a light from above left and a weak light from the right; both move with the camera
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
        #: Points and axes of the default view, see `Geometry`.
        self.sample, self.axes = np.zeros((1, 3)), np.eye(3)
        self._bounds = np.zeros((2, 3))
        #: Hidden vertices, whose faces are hidden too; None if no vertex is hidden.
        self.hidden: Mask | None = None
        #: Vertices drawn as selected; None if no vertex is selected.
        self.selected: Mask | None = None
        #: Clipping plane in mesh coordinates.
        self.cut: Plane | None = None
        #: Handle of the plane, drawn in the window but not in pictures.
        self.handle: vtkProp | None = None
        #: Displayed points, relative to `centre`, and normals, both of shape (n, 3).
        self.drawn = _NOTHING, _NOTHING
        self.view: View | None = None
        #: View last given to VTK's camera, and the modification time of the camera.
        self._camera_state: tuple[View | None, int] = (None, 0)
        #: State for which `_placed_pins` was computed.
        self._pins_key: tuple[Any, ...] = ()
        self._placed_pins: list[Pin] = []
        self.caption: Caption | None = None
        #: Text that replaces the quantity while another field is being computed, or "".
        self.awaited = ""
        #: Description of the displayed shape; "" for the shape of the mesh.
        self.shape_text = ""
        self.surface: Surface | None = None
        #: The stand-in (see `Frames`), drawn by `show_coarse` instead of the mesh.
        self.coarse: StandIn | None = None
        #: Search structure for picking and for hidden pins; None until computed.
        self.picker: RayTarget | None = None
        self._pins: tuple[tuple[int, str, str], ...] = ()
        #: Overlays by name: "faults", "borders", "graph" or "points".
        self.overlays: dict[str, Overlay] = {}
        #: Whether annotations are drawn.
        self.annotated = True
        self.set_theme(dark)
        #: Size and appearance of the last frame.
        self.page = Page(self.theme, 1, 1, 1.0)

    # -- contents ---------------------------------------------------------------------------

    def set_theme(self, dark: bool) -> None:
        """Set all colours except the colours of the field."""
        self.dark = dark
        self.theme = DARK if dark else LIGHT
        self.renderer.SetBackground(*rgb(self.theme.background_bottom))
        self.renderer.SetBackground2(*rgb(self.theme.background_top))
        self.renderer.GradientBackgroundOn()
        self.renderer.SetBackgroundAlpha(1.0)
        for surface in self._surfaces:
            surface.set_theme(self.theme)

    @property
    def _surfaces(self) -> list[Surface]:
        """The existing surfaces: of the mesh, and of its stand-in."""
        return [surface for surface in (self.surface, self.coarse) if surface is not None]

    def set_mesh(self, mesh: Mesh | None, normals: npt.NDArray[np.float32] | None) -> None:
        """Draw a mesh, or nothing for None, without field and pins; `normals` have shape (n, 3)."""
        for of in tuple(self.overlays):
            self.set_overlay(None, of)
        for surface in self._surfaces:
            self.renderer.RemoveActor(surface.actor)
        self.surface = self.coarse = self.picker = None
        self.hidden = self.selected = self.cut = None
        self.caption, self._pins, self.shape_text = None, (), ""
        if mesh is None:
            self.mesh = self.normals = self.view = None
            self.drawn = _NOTHING, _NOTHING  # releases the arrays
            return
        normals = mesh.vertex_normals if normals is None else normals
        self.mesh, self.normals = mesh, normals
        geometry = geometry_of(mesh)
        self.sample, self.axes = geometry.sample, geometry.axes
        self.centre, self._bounds = geometry.centre, geometry.bounds
        self.drawn = geometry.points, normals
        self.surface = Surface(*self.drawn, geometry.faces)
        self._add_surface(self.surface)

    def set_hidden(self, hidden: Mask | None) -> None:
        """Hide vertices and the faces around them; None shows all vertices."""
        if self.mesh is None or self.surface is None:
            return
        self.hidden = hidden
        self.surface.hide(hidden)
        for overlay in self.overlays.values():
            overlay.hide(hidden)
        geometry = geometry_of(self.mesh)
        self.sample = geometry.sample  # kept if no vertex is visible
        if hidden is not None and len(visible := np.flatnonzero(self.mesh.referenced & ~hidden)):
            chosen = visible[:: max(1, len(visible) // SAMPLED)]
            self.sample = geometry.points[chosen] + self.centre

    def set_selected(self, selected: Mask | None) -> None:
        """Draw vertices as selected; None deselects all vertices."""
        if self.surface is not None:
            self.selected = selected
            self.surface.select(selected)

    def set_cut(self, plane: Plane | None) -> None:
        """Cut the mesh at a plane in mesh coordinates; None draws the whole mesh."""
        self.cut = plane
        for overlay in self.overlays.values():
            overlay.cut(plane)

    @property
    def local_cut(self) -> Plane | None:
        """The clipping plane relative to `centre`."""
        return None if self.cut is None else self.cut.seen_from(self.centre)

    def away(self) -> Mask | None:
        """Return the mask of hidden or cut-away vertices; None if there are none."""
        cut = self.local_cut
        if self.mesh is None or cut is None:
            return self.hidden
        away = cut.away(self.drawn[0])
        return away if self.hidden is None else away | self.hidden

    def is_covered(self, vertex: int) -> bool:
        """Return whether the mesh hides a vertex, or the vertex is cut away."""
        if self.picker is None or self.view is None:
            return False
        cut = self.local_cut
        if cut is not None and bool(cut.away(self.drawn[0][vertex])):
            return True
        return self.picker.hidden(vertex, self.view.axes[2], cut)

    def move(
        self, points: npt.NDArray[np.float32] | None, normals: npt.NDArray[np.float32] | None = None
    ) -> None:
        """Draw the vertices at other positions, and reset `picker`.

        `points`, shape (n, 3), are relative to `centre`; None for the positions of the mesh.
        `normals`, shape (n, 3), are the displayed normals by default.
        """
        if self.mesh is None or self.surface is None or self.normals is None:
            return
        geometry = geometry_of(self.mesh)
        if points is None:
            self.drawn = geometry.points, self.normals
        else:
            self.drawn = points, self.drawn[1] if normals is None else normals
        self.surface.move(*self.drawn)
        for overlay in self.overlays.values():
            overlay.move(self.drawn[0])
        self.picker = None
        # vertices may move out of the bounds of the mesh, and must not be clipped
        room = 0.0 if points is None else 0.3 * np.ptp(geometry.bounds, axis=0).max()
        self._bounds = geometry.bounds + np.array([[-room], [room]])
        self._pins_key = ()

    @property
    def moved(self) -> bool:
        """Whether the vertices are drawn at other positions than those of the mesh."""
        return self.mesh is not None and self.drawn[0] is not geometry_of(self.mesh).points

    def place(self, vertex: int) -> FloatArray:
        """Return the displayed position of a vertex, shape (3,), in mesh coordinates."""
        assert self.mesh is not None
        if not self.moved and self.mesh.referenced[vertex]:
            return np.asarray(self.mesh.vertices[vertex])
        return np.asarray(self.drawn[0][vertex] + self.centre)

    @property
    def drawn_vertices(self) -> FloatArray:
        """Displayed positions of all vertices, shape (n, 3), in mesh coordinates."""
        assert self.mesh is not None
        if not self.moved and not len(self.mesh.unreferenced):
            return self.mesh.vertices
        return self.drawn[0] + self.centre

    def _add_surface(self, surface: Surface) -> None:
        surface.actor.SetPosition(*self.centre)
        surface.set_theme(self.theme)
        surface.set_caption(self.caption)
        self.renderer.AddActor(surface.actor)

    def set_coarse(self, coarse: CoarseMesh) -> None:
        """Make the stand-in, which is hidden until `show_coarse`."""
        self.coarse = StandIn(coarse, *self.drawn)
        self._add_surface(self.coarse)
        self.coarse.actor.VisibilityOff()

    def show_coarse(self, shown: bool) -> None:
        """Draw the stand-in, if `shown` and if it exists, or the mesh."""
        if self.surface is not None and self.coarse is not None:
            self.surface.actor.SetVisibility(not shown)
            self.coarse.actor.SetVisibility(shown)

    @property
    def shows_coarse(self) -> bool:
        """Whether the stand-in is drawn."""
        return self.coarse is not None and bool(self.coarse.actor.GetVisibility())

    def set_field(
        self, values: npt.NDArray[np.floating] | None, caption: Caption | None = None
    ) -> None:
        """Colour the mesh by values of shape (n,) and a caption; None removes the field.

        Raises
        ------
        ValueError
            If the shape is not (n,), or the colour map does not exist.
        """
        if self.mesh is None or self.surface is None:
            return
        if values is None or caption is None:
            self.caption = None
        else:
            if values.shape != (self.mesh.n_vertices,):
                raise ValueError(
                    f"A field of shape {values.shape} does not fit a mesh of "
                    f"{self.mesh.n_vertices} vertices."
                )
            color_table(caption.colormap)  # raises ValueError before any attribute is changed
            missing = self.surface.write(self.mesh.on_surface(values))
            self.caption = replace(caption, missing=missing)
        for surface in self._surfaces:
            surface.set_caption(self.caption)

    @property
    def shown_caption(self) -> Caption | None:
        """The caption with `shape_text`, and with `awaited` (if set) in place of the quantity."""
        if self.caption is None:
            return None
        parts = [self.awaited or self.caption.quantity, self.shape_text]
        return replace(self.caption, quantity=" · ".join(filter(None, parts)))

    def set_pins(self, pins: Sequence[tuple[int, str, str]]) -> None:
        """Set the vertex, colour and label of each pin."""
        self._pins = tuple(pins)

    def set_overlay(self, overlay: Overlay | None, of: str) -> None:
        """Replace the overlay with the name `of`; None removes it."""
        if of in self.overlays:
            self.renderer.RemoveActor(self.overlays.pop(of).actor)
        if overlay is not None:
            overlay.move(self.drawn[0])
            overlay.hide(self.hidden)
            self._add_overlay(overlay, of, self.centre)

    def _add_overlay(self, overlay: Overlay, of: str, centre: FloatArray) -> None:
        self.overlays[of] = overlay
        overlay.actor.SetPosition(*centre)
        overlay.cut(self.cut)
        self.renderer.AddActor(overlay.actor)

    @property
    def points(self) -> PointCloud | None:
        points = self.overlays.get("points")
        return points if isinstance(points, PointCloud) else None

    @property
    def legend(self) -> PointLegend | None:
        """Legend of the points, or None."""
        return None if self.points is None else self.points.legend

    # -- camera and frame -------------------------------------------------------------------

    def fit_view(
        self, width: int, height: int, scale: float, axes: FloatArray | None = None
    ) -> None:
        """Show the whole mesh with given axes, by default the axes of the default view."""
        space = margins(self.caption is not None, width, height, scale)
        axes = self.axes if axes is None else axes
        self.view = fitted_view(self.sample, axes, width, height, space)

    def prepare(self, width: int, height: int, scale: float, plates: bool = True) -> None:
        """Update stand-in, camera and annotations for a frame; see `Page` for the arguments."""
        if self.surface is not None and self.coarse is not None and self.shows_coarse:
            self.coarse.follow(self.surface, self.selected, *self.drawn)
        if self.mesh is not None and self.view is None:
            self.fit_view(width, height, scale)
        if self.view is not None:
            for surface in self._surfaces:
                surface.set_scale(scale)
            for overlay in self.overlays.values():
                overlay.set_scale(scale)
            self._place_camera(self.view, width, height)
        page = self.page = Page(self.theme, width, height, scale, plates)
        unit = "" if self.mesh is None else self.mesh.unit
        view = self.view if self.annotated else None
        pins = self.placed_pins()
        self.annotations.show(page, view, self.shown_caption, unit, pins, self.legend)

    def _place_camera(self, view: View, width: int, height: int) -> None:
        camera = self.renderer.GetActiveCamera()
        known_view, known_time = self._camera_state
        if known_view is view and known_time != camera.GetMTime():
            view = self.view = _view_of(camera, width, height)  # a script moved the camera
        # use the stored bounds, because VTK would compute bounds from all faces
        boxes = [self.centre + self._bounds]
        handles = () if self.handle is None or not self.handle.GetVisibility() else (self.handle,)
        for box in (prop.GetBounds() for prop in (*self.added(), *handles)):
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
        cut = self.cut
        if cut is not None:
            normal = view.axes @ cut.normal
            seen = (*normal.tolist(), float(cut.normal @ camera.GetPosition()) - cut.level)
        for surface in self._surfaces:
            surface.cut(None if cut is None else seen)
        self._camera_state = view, camera.GetMTime()

    def placed_pins(self) -> list[Pin]:
        """Return the pins with their positions, and whether each pin is hidden by the mesh.

        A ray and a label take a quarter of a millisecond each. Pins after the first 40 therefore
        have no label, and count as hidden if the normal of their vertex points away from the eye.
        """
        if self.mesh is None or self.view is None or not self._pins:
            return []
        known = (self.view, self.picker, self._pins, self.cut)
        if self._pins_key != known:
            self._pins_key = known
            eye, (_, normals) = self.view.axes[2], self.drawn
            self._placed_pins = [
                Pin(
                    vertex,
                    tuple(self.place(vertex).tolist()),
                    color,
                    label if at < _LABELLED else "",
                    self.is_covered(vertex)
                    if at < _LABELLED
                    else self.picker is not None and bool(normals[vertex] @ eye < 0.0),
                )
                for at, (vertex, color, label) in enumerate(self._pins)
            ]
        return self._placed_pins

    # -- actors added by scripts, and copies -------------------------------------------

    def added(self) -> Iterator[vtkProp]:
        """Yield the actors that scripts have added to the renderer."""
        ours = {id(prop) for prop in (*self.annotations.props, self.handle)}
        ours |= {id(surface.actor) for surface in self._surfaces}
        ours |= {id(overlay.actor) for overlay in self.overlays.values()}
        props = self.renderer.GetViewProps()
        for number in range(props.GetNumberOfItems()):
            prop = props.GetItemAsObject(number)
            if isinstance(prop, vtkProp) and id(prop) not in ours:
                yield prop

    def _add_copies(self, props: Iterator[vtkProp]) -> None:
        """Add copies of actors of another window, which share the data of the originals."""
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

    def leave_background(self) -> None:
        self.renderer.GradientBackgroundOff()
        self.renderer.SetBackground(0.0, 0.0, 0.0)
        self.renderer.SetBackgroundAlpha(0.0)

    def twin(self) -> MeshRenderer:
        """Return a copy for another window, which shares the arrays of mesh and field."""
        other = MeshRenderer(self.dark)
        other._add_copies(self.added())
        other.restore(self.contents())
        return other

    def contents(self) -> dict[str, Any]:
        """Return the contents of a copy: arrays are shared, and overlays are copied."""
        mesh, surface = self.mesh, self.surface
        state = {name: getattr(self, name) for name in _COPIED}
        overlays = {
            name: (overlay.copy(), np.array(overlay.actor.GetPosition()))
            for name, overlay in self.overlays.items()
            if name != "faults"  # not drawn in pictures
        }
        values = None if surface is None else surface.values
        shape = self.normals, self.drawn if self.moved else None, self.hidden, self.selected
        return {"mesh": mesh, "shape": shape, "values": values, "overlays": overlays, **state}

    def restore(self, state: dict[str, Any]) -> None:
        """Draw the result of `contents` of another drawing."""
        normals, moved, hidden, selected = state["shape"]
        self.set_mesh(state["mesh"], normals)
        if moved is not None:
            self.move(*moved)
        self.set_hidden(hidden)
        self.set_selected(selected)
        for name in _COPIED:
            setattr(self, name, state[name])
        if self.caption is not None:
            self.show_values(state["values"], self.caption)
        for name, (overlay, centre) in state["overlays"].items():
            self._add_overlay(overlay, name, centre)

    def show_values(self, values: npt.NDArray[np.float32], caption: Caption | None) -> None:
        """Colour the mesh by `Surface.values` of another drawing of the same mesh."""
        assert self.surface is not None
        self.surface.write(values)
        self.surface.set_caption(caption)
        self.caption = caption

    def coarse_twin(self) -> tuple[MeshRenderer, IntArray] | None:
        """Return a copy of the stand-in, without a field, and its vertices; None if not made."""
        mesh, coarse = self.mesh, self.coarse
        if mesh is None or coarse is None:
            return None
        other, picked = MeshRenderer(self.dark), coarse.mesh.representatives
        small = Mesh(mesh.vertices[picked], coarse.mesh.faces, unit=mesh.unit)
        other.set_mesh(small, self.drawn[1][picked])
        other.set_hidden(None if self.hidden is None else self.hidden[picked])
        other.view, other.cut = self.view, self.cut
        if self.points is not None:
            other._add_overlay(self.points.copy(), "points", self.centre)
        return other, picked


#: Attributes that a copy has in common with the original.
_COPIED = ("shape_text", "view", "picker", "_pins", "cut", "caption", "annotated")


def _view_of(camera: vtkCamera, width: int, height: int) -> View:
    rows = camera.GetViewTransformMatrix()
    axes = [[rows.GetElement(row, column) for column in range(3)] for row in range(3)]
    half_size = camera.GetParallelScale() * min(width, height) / height
    return View(np.array(camera.GetFocalPoint()), np.array(axes), half_size)
