"""What a mesh is drawn from, made once and off the interface thread."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import default_axes, sampled_points
from meshmash_viewer.mesh import Mesh

__all__ = ["Geometry", "drawn_points", "geometry_of"]


@dataclass(frozen=True, eq=False)
class Geometry:
    """Arrays as VTK takes them, and what the first view is made from.

    Parameters
    ----------
    centre : ndarray of float64, shape (3,)
        Middle of the mesh, in its coordinates.
    points : ndarray of float32, shape (n, 3)
        `drawn_points`: relative to `centre`, so that single precision is enough.
    faces : ndarray of int32, shape (m, 3)
    bounds : ndarray of float64, shape (2, 3)
        Lowest and highest of `points`.
    sample : ndarray of float64, shape (s, 3)
        `camera.sampled_points`.
    axes : ndarray of float64, shape (3, 3)
        `camera.default_axes`.
    """

    centre: npt.NDArray[np.float64]
    points: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    bounds: npt.NDArray[np.float64]
    sample: npt.NDArray[np.float64]
    axes: npt.NDArray[np.float64]


def geometry_of(mesh: Mesh) -> Geometry:
    """What a mesh is drawn from.

    Some tenths of a second at a million vertices, so a thread should ask before the interface
    does; asked again, or for the same mesh in another unit, it is there.
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
    """Vertices of a mesh, or where they have moved, relative to a centre, shape (n, 3).

    Those that no face uses are not drawn, and may be where single precision does not reach: they
    are at the nearest place within the bounds of the surface.
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
