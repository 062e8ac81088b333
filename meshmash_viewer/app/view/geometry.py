"""Arrays that a mesh is drawn from, made once, in any thread."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import default_axes, sampled_points
from meshmash_viewer.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Geometry:
    """Arrays for VTK, and the data of the first view."""

    #: Centre of the mesh, in its coordinates.
    centre: npt.NDArray[np.float64]
    #: `drawn_points`, shape (n, 3): relative to `centre`, so that single precision is enough.
    points: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    #: Bounding box of `points`, shape (2, 3).
    bounds: npt.NDArray[np.float64]
    #: `camera.sampled_points`.
    sample: npt.NDArray[np.float64]
    #: `camera.default_axes`.
    axes: npt.NDArray[np.float64]


def geometry_of(mesh: Mesh) -> Geometry:
    """Geometry of a mesh, computed once.

    Takes some tenths of a second at a million vertices, so the first call belongs in a thread.
    """
    known = mesh.derived.get((Geometry, mesh.unit))
    if known is None:
        others = (each for each in list(mesh.derived.values()) if isinstance(each, Geometry))
        same = next(others, None)
        if same is None:
            known = _new_geometry(mesh)
        else:
            known = replace(same, axes=default_axes(mesh, same.sample))
        mesh.derived[Geometry, mesh.unit] = known
    return known


def drawn_points(
    mesh: Mesh, vertices: npt.NDArray[np.float64], centre: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Positions of the vertices of a mesh relative to a centre, shape (n, 3).

    Unreferenced vertices are not drawn, and may be outside the range of single precision: they
    are moved into the bounds of the surface.
    """
    if len(unused := mesh.unreferenced):
        vertices = vertices.copy()
        vertices[unused] = np.clip(vertices[unused], *mesh.bounds)
    return (vertices - centre).astype(np.float32)


def _new_geometry(mesh: Mesh) -> Geometry:
    sample = sampled_points(mesh)
    centre = (sample.min(axis=0) + sample.max(axis=0)) / 2
    points = drawn_points(mesh, mesh.vertices, centre)
    faces, bounds = mesh.faces.astype(np.int32), mesh.bounds - centre
    return Geometry(centre, points, faces, bounds, sample, default_axes(mesh, sample))
