"""Masks of vertices: brush strokes, lassos, components, ranges of values, and changes of masks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.geodesics import GeodesicSolver
from meshmash_viewer.surface.rays import RayTarget

#: Whether each vertex is selected, shape (n,).
Mask: TypeAlias = npt.NDArray[np.bool_]


def grown(mesh: Mesh, mask: Mask) -> Mask:
    """Add the neighbours of the vertices of a mask."""
    a, b, c = (mask[mesh.faces[:, corner]] for corner in range(3))
    result = mask.copy()
    result[mesh.faces[(a | b | c) & ~(a & b & c)]] = True
    return result


def shrunk(mesh: Mesh, mask: Mask) -> Mask:
    """Remove the vertices with a neighbour outside the mask."""
    return ~grown(mesh, ~mask)


def parts(mesh: Mesh, mask: Mask) -> IntArray:
    """Return the index of the connected part of each vertex, shape (n,); -1 outside the mask."""
    from meshmash_viewer.surface.kernels import parts_of

    return np.asarray(parts_of(mesh.faces, mask))


def filled(mesh: Mesh, mask: Mask) -> Mask:
    """Add the parts of the surface that the mask encloses.

    In each connected component of the mesh the largest part outside the mask, by area, stays
    outside; all other parts are added.
    """
    components = mesh.component_labels
    outside = ~mask & (components >= 0)
    part = parts(mesh, outside)
    if part.max() < 0:
        return mask
    areas = np.bincount(part[outside], mesh.vertex_areas[outside])
    of_part = np.zeros(len(areas), dtype=np.int64)  # component of each part
    of_part[part[outside]] = components[outside]
    order = np.argsort(-areas, kind="stable")
    largest = order[np.unique(of_part[order], return_index=True)[1]]  # of each component
    stays = np.isin(np.arange(len(areas)), largest)
    result = mask.copy()
    result[outside] = ~stays[part[outside]]
    return result


@dataclass(frozen=True, eq=False)
class Projection:
    """Vertices with normals, shape (n, 3) each, and a camera with parallel projection."""

    points: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    #: Shape (3, 3): unit vectors to the right, up and towards the eye, as rows.
    axes: FloatArray
    #: Shape (3,): the point in the middle of the picture.
    focus: FloatArray
    #: Length of a pixel.
    pixel: float
    #: Position of the middle of the picture, in pixels.
    middle: tuple[float, float]

    @cached_property
    def seen(self) -> npt.NDArray[np.float32]:
        """Positions in pixels: to the right, up, and towards the eye (the height), shape (n, 3)."""
        from meshmash_viewer.surface.kernels import project

        shift = np.array([*self.middle, 0.0]) - self.axes @ self.focus / self.pixel
        scaled = (self.axes / self.pixel).astype(np.float32)
        return np.asarray(project(self.points, scaled, shift.astype(np.float32)))

    @cached_property
    def facing(self) -> npt.NDArray[np.float32]:
        """Cosine of the angle between each normal and the direction of the eye, shape (n,)."""
        return np.asarray(self.normals @ self.axes[2].astype(np.float32))


def within_polygon(seen: npt.NDArray[np.floating], polygon: FloatArray) -> Mask:
    """Return a mask of the points in a closed polygon, to within a pixel, shape (n,).

    `seen`, shape (n, 2) or (n, 3), and `polygon`, shape (k, 2), are in pixels.
    """
    from PIL import Image, ImageDraw

    from meshmash_viewer.surface.kernels import in_picture

    low = np.floor(polygon.min(axis=0))
    width, height = (np.ceil(polygon.max(axis=0)) - low + 1.0).astype(int).tolist()
    drawn = Image.new("1", (width, height))
    if len(polygon) > 1:
        ImageDraw.Draw(drawn).polygon([tuple(each) for each in (polygon - low).tolist()], fill=1)
    return np.asarray(in_picture(seen, low, np.asarray(drawn)))


def prepared(mesh: Mesh) -> GeodesicSolver:
    """Return the solver of a mesh; compile or load the loops of brush and lasso before."""
    points = np.clip(mesh.vertices, *mesh.bounds) - mesh.bounds.mean(axis=0)
    made = GeodesicSolver(mesh)
    made.within(mesh.faces[0, :1], 0.0, np.ones(mesh.n_vertices, np.bool_))
    _ = mesh.vertex_areas, mesh.component_labels
    pixel = float(np.ptp(mesh.bounds, axis=0).max()) / 100.0 or 1.0
    seen = points.astype(np.float32), mesh.vertex_normals.astype(np.float32)
    projection = Projection(*seen, np.eye(3), np.zeros(3), pixel, (0.0, 0.0))
    lasso(mesh, projection, 60.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), None, False)
    return made


def lasso(
    mesh: Mesh,
    projection: Projection,
    polygon: FloatArray,
    hidden: Mask | None,
    through: bool,
    target: RayTarget | None = None,
) -> Mask:
    """Return a mask of the visible vertices, or all if `through`, in a polygon in pixels.

    Vertices in `hidden` are left out and cover no others. With `target`, the search structure for
    rays of the same points and faces, only large faces are read.
    """
    from meshmash_viewer.surface.kernels import CELL, visible

    drawn = mesh.referenced if hidden is None else mesh.referenced & ~hidden
    chosen = within_polygon(projection.seen, polygon) & drawn
    if through:
        return chosen
    faces = mesh.faces if target is None else target.larger_faces(CELL * projection.pixel)
    return np.asarray(visible(projection.seen, faces, projection.facing, chosen, drawn))


def component(mesh: Mesh, vertex: int) -> Mask:
    """Return a mask of the connected component of a vertex."""
    return np.asarray(mesh.component_labels == mesh.component_labels[vertex])


def same_label(mesh: Mesh, values: npt.NDArray[Any], vertex: int) -> Mask:
    """Return a mask of the connected part around a vertex with the same value."""
    part = parts(mesh, values == values[vertex])
    return np.asarray(part == part[vertex])


def between(
    mesh: Mesh, values: npt.NDArray[Any], low: float, high: float, joined: int | None = None
) -> Mask:
    """Return a mask of values in a range; with `joined` only the part with this vertex."""
    inside = (values >= low) & (values <= high) & mesh.referenced
    return inside if joined is None or not inside[joined] else same_label(mesh, inside, joined)
