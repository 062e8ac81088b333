"""Masks of what is picked on a surface: a disc, a lasso, a component, a label, a range."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.geodesics import Geodesics
from meshmash_viewer.surface.lasso import Projection, visible, within_polygon
from meshmash_viewer.surface.masks import Mask, parts


def prepared(mesh: Mesh) -> Geodesics:
    """Make what strokes need, and compile or load the loops of brush and lasso."""
    points = mesh.vertices - mesh.bounds.mean(axis=0)
    made = Geodesics(points, mesh.faces)
    made.within(mesh.faces[0, :1], 0.0)
    _ = mesh.vertex_areas, mesh.component_labels
    pixel = float(np.ptp(mesh.bounds, axis=0).max()) / 100.0 or 1.0
    seen = points.astype(np.float32), mesh.vertex_normals.astype(np.float32)
    projection = Projection(*seen, np.eye(3), np.zeros(3), pixel, (0.0, 0.0))
    lasso(mesh, projection, 60.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), None, False)
    return made


def disc(geodesics: Geodesics, mesh: Mesh, centre: int, radius: float) -> Mask:
    """Find the vertices within a geodesic distance of one."""
    result = np.zeros(mesh.n_vertices, dtype=np.bool_)
    result[geodesics.within(np.array([centre]), radius)[0]] = True
    return result


def lasso(
    mesh: Mesh, projection: Projection, polygon: FloatArray, hidden: Mask | None, through: bool
) -> Mask:
    """Find the visible vertices in a polygon, in pixels; with `through` those behind, too.

    `hidden` are left out, and cover nothing.
    """
    chosen = within_polygon(projection.seen, polygon) & mesh.referenced
    faces = mesh.faces
    if hidden is not None:
        chosen &= ~hidden
        faces = faces[~hidden[faces].any(axis=1)]
        faces.flags.writeable = mesh.faces.flags.writeable  # as the loops were compiled for
    return chosen if through else visible(projection.seen, faces, projection.facing, chosen)


def component(mesh: Mesh, vertex: int) -> Mask:
    """Find the connected component of a vertex."""
    return np.asarray(mesh.component_labels == mesh.component_labels[vertex])


def same_label(mesh: Mesh, values: npt.NDArray[Any], vertex: int) -> Mask:
    """Find the connected part with the value of a vertex."""
    part = parts(mesh, values == values[vertex])
    return np.asarray(part == part[vertex])


def between(
    mesh: Mesh, values: npt.NDArray[Any], low: float, high: float, joined: int | None = None
) -> Mask:
    """Find the vertices with values in a range, or of these what is connected with one."""
    inside = (values >= low) & (values <= high) & mesh.referenced
    return inside if joined is None or not inside[joined] else same_label(mesh, inside, joined)
