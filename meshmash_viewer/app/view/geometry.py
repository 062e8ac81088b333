"""What a mesh is drawn from, made once and off the interface thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from meshmash_viewer.app.view.camera import default_axes, sampled_points
from meshmash_viewer.mesh import Mesh

__all__ = ["Geometry", "geometry_of"]

#: Faces or vertices converted at a time, so that other threads get the interpreter in between.
_CHUNK = 1 << 17
#: Directions along which the outermost points are looked for.
_DIRECTIONS = 500


@dataclass(frozen=True, eq=False)
class Geometry:
    """Arrays as VTK takes them, and what the first view is made from.

    Parameters
    ----------
    centre : ndarray of float64, shape (3,)
        Middle of the mesh, in its coordinates.
    points : ndarray of float32, shape (n, 3)
        Vertices relative to `centre`, so that single precision is enough.
    faces : ndarray of int32, shape (m, 3)
    bounds : ndarray of float64, shape (2, 3)
        Lowest and highest of `points`.
    sample : ndarray of float64, shape (s, 3)
        Vertices that the whole mesh lies between, whatever it is looked at along.
    axes : ndarray of float64, shape (3, 3)
        `camera.default_axes`.
    """

    centre: npt.NDArray[np.float64]
    points: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    bounds: npt.NDArray[np.float64]
    sample: npt.NDArray[np.float64]
    axes: npt.NDArray[np.float64]


#: Of each mesh that is still in use.
_known: WeakKeyDictionary[Mesh, Geometry] = WeakKeyDictionary()
_lock = Lock()


def geometry_of(mesh: Mesh) -> Geometry:
    """What a mesh is drawn from.

    Some tenths of a second at a million vertices, so a thread should ask before the interface
    does; asked again, or for the same mesh in another unit, it is there.
    """
    with _lock:
        known = _known.get(mesh)
        same = next((_known[other] for other in _known if other.vertices is mesh.vertices), None)
    if known is None:
        if same is not None:
            known = replace(same, axes=default_axes(mesh))
        else:
            known = _new_geometry(mesh)
        with _lock:
            _known[mesh] = known
    return known


def _new_geometry(mesh: Mesh) -> Geometry:
    sample = sampled_points(mesh)
    centre = (sample.min(axis=0) + sample.max(axis=0)) / 2
    points = np.empty(mesh.vertices.shape, dtype=np.float32)
    for start in range(0, len(points), _CHUNK):
        part = slice(start, start + _CHUNK)
        np.subtract(mesh.vertices[part], centre, out=points[part], casting="same_kind")
    faces = np.empty(mesh.faces.shape, dtype=np.int32)
    for start in range(0, len(faces), _CHUNK):
        faces[start : start + _CHUNK] = mesh.faces[start : start + _CHUNK]
    axes = default_axes(mesh, sample)
    return Geometry(centre, points, faces, mesh.bounds - centre, _outermost(sample), axes)


def _outermost(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points between which all lie: those that are farthest along some of a thousand directions.

    Along any other direction they reach as far as all points but for a thousandth.
    """
    if len(points) <= 4 * _DIRECTIONS:
        return points
    # Evenly over half of the sphere, along a spiral of golden angles.
    height = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), height])
    chosen = []
    for direction in np.concatenate([np.eye(3), directions.T]):
        along = points[:, 0] * direction[0]
        along += points[:, 1] * direction[1]
        along += points[:, 2] * direction[2]
        chosen += [int(along.argmin()), int(along.argmax())]
    return points[np.unique(chosen)]
