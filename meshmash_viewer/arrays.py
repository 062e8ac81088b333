"""Arrays of vertices and faces: checks, equal rows, scaling, numbering in the file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import NO_VOXEL, Voxel

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

#: How many offenders a message names before it only counts.
_NAMED_OFFENDERS = 5
#: Largest coordinate, whose fourth power and its inverse are still numbers.
_LARGEST = 1e75


def blocks(stop: int, size: int, start: int = 0) -> Iterator[slice]:
    """Yield slices of at most `size` indices that cover those from `start` to `stop`."""
    return (slice(at, min(at + size, stop)) for at in range(start, stop, size))


def distinct_corners(faces: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
    """Which faces have three different corners, shape (m,); the others are no triangles."""
    a, b, c = faces.T
    return np.asarray((a != b) & (b != c) & (c != a))


def scaled_vertices(vertices: FloatArray, factors: Voxel, divisors: Voxel = NO_VOXEL) -> FloatArray:
    """Coordinates by a divisor, times a factor for each axis; what overflows is as large as can be.

    Only a vertex that no face uses can be so far away: others are refused by `Mesh`.
    """
    largest = np.finfo(np.float64).max
    with np.errstate(over="ignore"):
        divided = np.clip(vertices / divisors, -largest, largest)
        return np.asarray(np.clip(divided * factors, -largest, largest))


def first_equal(rows: npt.NDArray[Any]) -> IntArray:
    """For each row of an array, the lowest index of those that are equal to it, shape (n,)."""
    order = np.lexsort(rows.T[::-1])  # stable: equal rows keep their order
    ordered = rows[order]
    starts = np.ones(len(rows), dtype=np.bool_)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first = np.empty(len(rows), dtype=np.int64)
    first[order] = order[starts][np.cumsum(starts) - 1]
    return first


def _offenders(indices: IntArray) -> str:
    """Name the first few of a list of offenders: "3, 17, 21 and 40 more"."""
    named = ", ".join(str(index) for index in indices[:_NAMED_OFFENDERS])
    rest = len(indices) - _NAMED_OFFENDERS
    return f"{named} and {rest} more" if rest > 0 else named


def checked_vertices(given: Any) -> FloatArray:
    """Copy coordinates, and raise an `InputError` unless they are finite, shape (n, 3)."""
    try:
        if np.iscomplexobj(given):
            raise TypeError  # a cast would drop the imaginary parts
        vertices = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError("Vertices are an array of numbers of shape (n, 3).") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(
            f"Vertices have shape {vertices.shape}: give x, y and z for each, shape (n, 3)."
        )
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(
            f"The coordinates of some vertices are NaN or infinite (vertex {_offenders(bad)}): "
            "remove or repair them first."
        )
    return vertices


def check_size(vertices: FloatArray, faces: IntArray) -> None:
    """Refuse coordinates of faces whose fourth power or its inverse is no number."""
    largest = float(np.abs(vertices).max(initial=0.0))
    if largest > _LARGEST or 0.0 < largest < 1.0 / _LARGEST:
        # vertices that no face uses may be anywhere
        largest = float(np.abs(vertices[faces[distinct_corners(faces)]]).max(initial=0.0))
    if largest > _LARGEST or 0.0 < largest < 1.0 / _LARGEST:
        raise InputError(
            f"Coordinates of size {largest:.3g} leave no room for areas and eigenvalues in "
            f"floating-point numbers: scale them to between {1.0 / _LARGEST:.0g} and "
            f"{_LARGEST:.0g}."
        )


def checked_faces(given: Any, n_vertices: int) -> IntArray:
    """Copy indices, and raise an `InputError` unless they are those of triangles, shape (m, 3)."""
    array = np.asarray(given)
    if array.size == 0:
        raise InputError("The mesh has no faces: a surface is needed, not a cloud of points.")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(
            f"Faces have shape {array.shape}: give three vertex indices for each triangle, "
            "shape (m, 3); polygons have to be split into triangles first."
        )
    if array.dtype.kind not in "iuf":
        raise InputError(f"Faces are vertex indices, not of type {array.dtype}.")
    with np.errstate(invalid="ignore"):
        wrong = (array < 0) | (array >= n_vertices)
        if array.dtype.kind == "f":
            wrong |= array != np.floor(array)
    bad = np.flatnonzero(wrong.any(axis=1))
    if len(bad):
        raise InputError(
            f"Faces name vertices that do not exist (face {_offenders(bad)}, the first as "
            f"{array[bad[0]].tolist()}): indices run from 0 to {n_vertices - 1}."
        )
    return np.array(array, dtype=np.int64, order="C")


@dataclass(frozen=True, eq=False)
class FileNumbering:
    """Map from the vertices of a file to those of a repaired mesh.

    Examples
    --------
    >>> from meshmash_viewer.arrays import FileNumbering
    >>> numbering = FileNumbering(np.array([-1, 0, 1, 0]))
    >>> numbering.in_file, numbering.whole(np.array([0.5, 0.25]))
    (array([1, 2]), array([ nan, 0.5 , 0.25, 0.5 ]))
    """

    #: Shape (n_file,): For each vertex of the file its vertex in the mesh, the same one for merged
    #: vertices; -1 for removed ones.
    here: npt.NDArray[np.int64]

    @property
    def n_file(self) -> int:
        """Number of vertices of the file."""
        return len(self.here)

    @cached_property
    def in_file(self) -> npt.NDArray[np.int64]:
        """For each vertex of the mesh its index in the file, the lowest of merged ones, (n,)."""
        indices = np.flatnonzero(self.here >= 0)[::-1]
        result = np.zeros(int(self.here.max(initial=-1)) + 1, dtype=np.int64)
        # for merged vertices the last assignment remains, that of the lowest index
        result[self.here[indices]] = indices
        return result

    def then(self, here: npt.NDArray[np.int64]) -> FileNumbering:
        """Compose with another repair, given by its map from the mesh before it."""
        return FileNumbering(np.where(self.here >= 0, here[self.here], -1))

    def whole(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Expand values of shape (n, ...) to the vertices of the file, NaN at removed ones.

        Merged vertices have the same value. Integers become float64.
        """
        kind = values.dtype if values.dtype.kind == "f" else np.dtype(np.float64)
        result = np.full((self.n_file, *values.shape[1:]), np.nan, dtype=kind)
        left = self.here >= 0
        result[left] = values[self.here[left]]
        return result
