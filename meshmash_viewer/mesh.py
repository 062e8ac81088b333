"""The triangle mesh: vertices, faces and the unit of its coordinates."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError

__all__ = ["Mesh", "MeshLike", "as_mesh"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
#: ``(vertices, faces)``, an object with these two attributes, or a pyvista ``PolyData``.
MeshLike: TypeAlias = Any


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh; neither array is changed after construction.

    Parameters
    ----------
    vertices : ndarray of float64, shape (n, 3)
        Coordinates in `unit`.
    faces : ndarray of int64, shape (m, 3)
        Vertex indices of each triangle.
    unit : str
        One of `meshmash_viewer.units.LENGTH_UNITS`.
    name : str
        What people call it, usually the file's stem.

    Raises
    ------
    InputError
        If an array has the wrong shape, a coordinate is not finite, an index is out of range,
        or there is no face.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        vertices = np.ascontiguousarray(self.vertices, dtype=np.float64)
        faces = np.ascontiguousarray(self.faces, dtype=np.int64)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        # validation: NUM fills in

    @property
    def n_vertices(self) -> int:
        """Number of vertices, unreferenced ones included."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of coordinates and indices: 64 hexadecimal digits."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces):
            digest.update(str(array.shape).encode())
            digest.update(memoryview(array).cast("B"))
        return digest.hexdigest()


def as_mesh(mesh: MeshLike) -> Mesh:
    """Take a mesh in any of the accepted forms (see `MeshLike`)."""
    if isinstance(mesh, Mesh):
        return mesh
    raise InputError("not a mesh")  # NUM fills in
