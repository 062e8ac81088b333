"""Series of pictures of one mesh, with the field and the view of each; without Qt."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.annotations import caption_of, margins
from meshmash_viewer.app.view.camera import Margins, View, fitted_view
from meshmash_viewer.app.view.mesh_renderer import MeshRenderer
from meshmash_viewer.app.view.picture import OffScreen, text_scale
from meshmash_viewer.fields.family import Family
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.field import Field, FieldRequest, LiveFeatures, compute_field
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@dataclass(frozen=True, eq=False)
class Shot:
    """Field and view of one picture; None leaves those of the drawing."""

    request: FieldRequest | None = None
    view: View | None = None


def shots_of(
    families: Sequence[Family],
    spectrum: Eigenpairs,
    mesh: Mesh,
    sample: npt.NDArray[np.int64],
    chosen: Mapping[str, Family],
    hidden: npt.NDArray[np.bool_] | None = None,
    names: Mapping[int, str] | None = None,
) -> list[Shot]:
    """A shot of each family, with its open parameters resolved.

    Limits are taken from the vertices `sample` (`Mesh.area_sample`), and not from those that are
    `hidden`; `chosen` are all families by name, since one may build on another. `names` are those
    of pinned vertices.
    """
    resolved = (each.resolved(spectrum, chosen) for each in families)
    return [
        Shot(
            FieldRequest(
                spectrum, mesh.unit, each, sample, mesh.vertices, hidden,
                pin=(names or {}).get(getattr(each, "vertex", -1), ""),
            )
        )
        for each in resolved
    ]  # fmt: skip


def compute_shot(
    shot: Shot, display: Display, live: LiveFeatures, picked: npt.NDArray[np.int64] | None = None
) -> Field | None:
    """Compute the field of a shot, by the direct sum if there is one; in any thread.

    `picked` are the vertices of the mesh that the drawing has, None for all.
    """
    if shot.request is None:
        return None
    found = compute_field(shot.request, live)
    if found is None:
        live.prepare(shot.request)
        found = compute_field(shot.request, live)
    assert found is not None, "its table has been prepared"
    found.prepare_colors(display.policies.get(found.family.limits_key))
    return found if picked is None else found.carried(picked)


def show_shot(drawing: MeshRenderer, shot: Shot, field: Field | None, display: Display) -> None:
    """Set the view and the field of a shot, with the colours and lines of a display."""
    if shot.view is not None:
        drawing.view = shot.view
    if field is not None:
        caption = caption_of(field, *field.colors(display), lined=display.nodal_lines)
        drawing.set_field(field.values, caption)


def draw_series(
    drawing: MeshRenderer,
    size: tuple[int, int],
    shots: Sequence[Shot],
    display: Display,
    transparent: bool = False,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Draw pictures of one size one after another, see `OffScreen.draw`."""
    live = LiveFeatures()
    with contextlib.closing(OffScreen(drawing, size, transparent)) as window:
        for shot in shots:
            show_shot(drawing, shot, compute_shot(shot, display, live), display)
            yield window.draw()


def series_view(
    drawing: MeshRenderer,
    size: tuple[int, int],
    seen: tuple[int, int] | None = None,
    *,
    turning: bool = False,
) -> View:
    """The view that pictures of a size share, along the axes of the drawing's view.

    If that view shows only a part of the mesh in a picture of size `seen`, the part is shown;
    otherwise the whole mesh fills the pictures, `turning` also while it turns about the vertical.
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
    """Views of one turn of the mesh about the vertical of a view, through its centre."""
    middle = _middle(drawing.sample, view.axes)
    offset = view.axes @ (view.focus - middle)
    views = []
    for frame in range(count):
        turned = view.turned(2.0 * np.pi * frame / count, 0.0)
        views.append(replace(turned, focus=middle + offset @ turned.axes))
    return views


def aspect(drawing: MeshRenderer) -> float:
    """Width over height of the mesh in its view."""
    axes = drawing.axes if drawing.view is None else drawing.view.axes
    wide, high = np.ptp(axes[:2] @ drawing.sample.T, axis=1)
    return float(np.clip(wide / max(high, 1e-300), 0.25, 4.0))


def _shows_all(view: View, points: npt.NDArray[np.float64], size: tuple[int, int]) -> bool:
    places = view.to_pixels(points, *size)[:, :2]
    return bool((places >= -1.0).all() and (places <= np.array(size) + 1.0).all())


def _middle(
    points: npt.NDArray[np.float64], axes: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    seen = axes @ points.T
    return np.asarray((seen.min(axis=1) + seen.max(axis=1)) / 2 @ axes)


def _cylinder(
    points: npt.NDArray[np.float64], axes: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Corners, shape (4, 3), of the area that points sweep as they turn about the vertical."""
    middle = _middle(points, axes)
    seen = axes @ (points - middle).T
    reach = float(np.hypot(seen[0], seen[2]).max())
    corners = [
        (side * reach, end, 0.0) for side in (-1.0, 1.0) for end in (seen[1].min(), seen[1].max())
    ]
    return np.asarray(middle + np.array(corners) @ axes)
