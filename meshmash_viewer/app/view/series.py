"""Many pictures of one mesh: what each of them shows, and from where. Without Qt."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.annotations import margins
from meshmash_viewer.app.view.camera import Margins, View, fitted_view
from meshmash_viewer.app.view.colors import ColorMap
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import OffScreen, RawPicture, all_steps, text_scale
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import (
    Field,
    FieldRequest,
    LiveFeatures,
    compute_field,
    shown_family,
)
from meshmash_viewer.model.limits import LimitPolicy
from meshmash_viewer.surface.nodal_lines import nodal_segments

__all__ = [
    "Dress",
    "Look",
    "Shot",
    "aspect",
    "draw_series",
    "dressed",
    "look_of",
    "series_view",
    "shots_of",
    "turntable",
]


@dataclass(frozen=True)
class Look:
    """What all pictures have in common.

    Parameters
    ----------
    colormap : str
        One of matplotlib's.
    policy : LimitPolicy, optional
        How limits are chosen for each; None as suits the field.
    nodal_lines : bool
        Whether lines are drawn, of zero or at round values.
    diverging : str, optional
        The colour map of fields of both signs, if it is another.
    """

    colormap: str
    policy: LimitPolicy | None = None
    nodal_lines: bool = False
    diverging: str = ""

    def colors(self, field: Field) -> str | tuple[str, ...]:
        """The colour map of a field, or the colours of its labels."""
        if field.labels:
            return tuple(label.color for label in field.labels)
        return (self.diverging if field.signed else "") or self.colormap


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture: the field, or that which is there, and the view, or that which is there."""

    request: FieldRequest | None = None
    view: View | None = None


@dataclass(frozen=True, eq=False)
class Dress:
    """A field ready to be put on a mesh; it needs no graphics, and any thread can make it."""

    shot: Shot
    field: Field | None = None
    values: npt.NDArray[np.float32] | None = None
    limits: tuple[float, float] = (0.0, 1.0)
    colormap: ColorMap = ""
    lines: tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]] | None = None

    def put_on(self, drawing: MeshRenderer) -> None:
        """Show it, from where the shot says."""
        if self.shot.view is not None:
            drawing.view = self.shot.view
        if self.field is None:
            return
        drawing.set_field(
            self.values,
            self.limits,
            self.colormap,
            self.field.title,
            self.field.told(self.lines is not None),
            self.field.unit,
            complete=self.field.complete,
        )
        if self.lines is None:
            drawing.set_segments(None)
        else:
            drawing.set_segments(*self.lines)


def look_of(display: Display) -> Look:
    """The colours of what is on the render."""
    family = shown_family(display)
    return Look(
        display.sequential_colormap,
        display.policies.get(family.name),
        display.nodal_lines,
        display.diverging_colormap,
    )


def shots_of(
    families: Sequence[Family],
    spectrum: Spectrum,
    mesh: Mesh,
    sample: npt.NDArray[np.int64],
    chosen: Mapping[str, Family],
) -> list[Shot]:
    """A shot of each; the parameters that they leave open are filled in.

    Parameters
    ----------
    families : sequence of Family
    spectrum : Spectrum
    mesh : Mesh
    sample : ndarray of int64
        Vertices that limits are taken over (`Mesh.area_sample`).
    chosen : mapping of str to Family
        Every family, for one may build on another.
    """
    resolved = (each.resolved(spectrum, chosen) for each in families)
    return [
        Shot(FieldRequest(spectrum, mesh.unit, each, sample=sample, places=mesh.vertices))
        for each in resolved
    ]


def dressed(
    shot: Shot,
    look: Look,
    live: LiveFeatures,
    drawing: MeshRenderer,
    picked: npt.NDArray[np.int64] | None = None,
) -> Dress:
    """Compute what a shot shows, by the direct sum where there is one.

    `picked` are the vertices of the field's mesh that are those of the drawing's, if not all.
    """
    if shot.request is None:
        return Dress(shot)
    found = compute_field(shot.request, live)
    if found is None:
        live.prepare(shot.request)
        found = compute_field(shot.request, live)
    assert found is not None, "its table is there"
    mesh, lines = drawing.mesh, None
    assert mesh is not None
    values = mesh.on_surface(found.values if picked is None else found.values[picked])
    if look.nodal_lines and found.levels:
        lines = nodal_segments(mesh.vertices, mesh.faces, values, drawing.centre, found.levels)
    return Dress(shot, found, values, found.limits(look.policy), look.colors(found), lines)


def draw_series(
    drawing: MeshRenderer,
    size: tuple[int, int],
    shots: Sequence[Shot],
    look: Look,
    transparent: bool = False,
) -> Iterator[tuple[Dress, RawPicture]]:
    """Draw one picture after the other, all of one size; none of them is kept."""
    live = LiveFeatures()
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        for shot in shots:
            dress = dressed(shot, look, live, drawing)
            dress.put_on(drawing)
            yield dress, all_steps(window.draw())


def series_view(
    drawing: MeshRenderer,
    size: tuple[int, int],
    seen: tuple[int, int] | None = None,
    *,
    turning: bool = False,
) -> View:
    """The view that pictures of a size share: along the drawing's own, if it has one.

    Parameters
    ----------
    drawing : MeshRenderer
        With a mesh.
    size : (int, int)
        Of the pictures in pixels.
    seen : (int, int), optional
        Of what the drawing's view was chosen on. If it showed only a part of the mesh, the
        pictures show that part; otherwise the whole mesh fills them.
    turning : bool
        Whether the mesh has to fit while it turns about the picture's vertical.
    """
    width, height = size
    view, points = drawing.view, drawing.sample
    if view is not None and seen is not None and not _shows_all(view, points, seen):
        pixel = view.length_per_pixel(*seen) * max(seen[0] / width, seen[1] / height)
        return replace(view, half_size=pixel * min(size) / 2)
    axes = drawing.axes if view is None else view.axes
    if turning:
        points = _cylinder(points, axes)
    space = Margins(*(0.04 * min(size),) * 4)
    if drawing.annotated:
        space = margins(drawing.caption is not None, width, height, text_scale(size))
    return fitted_view(points, axes, width, height, space)


def turntable(drawing: MeshRenderer, view: View, count: int) -> list[View]:
    """Views all around: the mesh turns once about the vertical of a view through its middle."""
    middle = _middle(drawing.sample, view.axes)
    beside = view.axes @ (view.focus - middle)
    views = []
    for frame in range(count):
        turned = view.turned(2.0 * np.pi * frame / count, 0.0)
        views.append(replace(turned, focus=middle + beside @ turned.axes))
    return views


def aspect(drawing: MeshRenderer) -> float:
    """Width over height of the mesh as it is seen."""
    axes = drawing.axes if drawing.view is None else drawing.view.axes
    wide, high = np.ptp(drawing.sample @ axes[:2].T, axis=0)
    return float(np.clip(wide / max(high, 1e-300), 0.25, 4.0))


def _shows_all(view: View, points: npt.NDArray[np.float64], size: tuple[int, int]) -> bool:
    places = view.to_pixels(points, *size)[:, :2]
    return bool((places >= -1.0).all() and (places <= np.array(size) + 1.0).all())


def _middle(
    points: npt.NDArray[np.float64], axes: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    seen = points @ axes.T
    return np.asarray((seen.min(axis=0) + seen.max(axis=0)) / 2 @ axes)


def _cylinder(
    points: npt.NDArray[np.float64], axes: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """The outline of what points sweep over when they turn about the vertical, shape (4, 3)."""
    middle = _middle(points, axes)
    seen = (points - middle) @ axes.T
    reach = float(np.hypot(seen[:, 0], seen[:, 2]).max())
    corners = [
        (side * reach, end, 0.0)
        for side in (-1.0, 1.0)
        for end in (seen[:, 1].min(), seen[:, 1].max())
    ]
    return np.asarray(middle + np.array(corners) @ axes)
