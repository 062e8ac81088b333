"""Vertices and faces as arrays: checks, equal rows, numbering in the file, triangle geometry."""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, wrong_type
from meshmash_viewer.units import NO_VOXEL, Voxel

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]

#: Number of invalid vertices or faces that a message lists.
_NAMED_OFFENDERS = 5
#: Largest coordinate; its fourth power, and the inverse of this power, do not overflow.
_LARGEST = 1e75


def blocks(stop: int, size: int, start: int = 0) -> Iterator[slice]:
    """Yield consecutive slices of at most `size` indices, from `start` to `stop`."""
    return (slice(at, min(at + size, stop)) for at in range(start, stop, size))


def exact_array(given: Any) -> npt.NDArray[Any]:
    """Convert a column to an array without rounding whole numbers next to missing ones.

    NumPy converts nullable whole numbers of pandas, polars and Arrow to float64, which rounds
    identifiers beyond 2⁵³. Here they become objects, with None for a missing value.
    Masked values are missing.
    """
    if np.ma.is_masked(given):
        made = np.ma.getdata(given).astype(object)
        made[np.ma.getmaskarray(given)] = None
        return made
    made = np.asarray(given)
    declared = str(getattr(given, "dtype", getattr(given, "type", ""))).lower()
    rounded = made.dtype.kind == "f" and not declared.startswith(("float", "double", "halffloat"))
    is_list = made.dtype.kind == "U" and not declared  # in which NumPy writes NaN as text
    if made.ndim != 1 or not (rounded or is_list or made.dtype.kind == "O"):
        return made
    items = given.to_pylist() if hasattr(given, "to_pylist") else list(given)
    items = [None if _is_missing(each) else _unboxed(each) for each in items]
    if rounded and not any(isinstance(each, int) for each in items):
        return made
    exact = np.empty(len(items), dtype=object)
    exact[:] = items
    return exact


def _unboxed(item: Any) -> Any:
    return int(item) if isinstance(item, np.integer) else item


def _is_missing(item: Any) -> bool:
    """Whether an item is None, a NaN, or a missing value of pandas."""
    is_nan = isinstance(item, float) and np.isnan(item)
    return item is None or is_nan or type(item).__name__ in ("NAType", "NaTType")


def distinct_corners(faces: npt.NDArray[np.integer]) -> npt.NDArray[np.bool_]:
    """Return a mask of the faces with three different corners, shape (m,)."""
    a, b, c = faces.T
    return np.asarray((a != b) & (b != c) & (c != a))


def scaled_vertices(vertices: FloatArray, factors: Voxel, divisors: Voxel = NO_VOXEL) -> FloatArray:
    """Divide coordinates by `divisors`, one for each axis, then multiply them by `factors`.

    Overflows are clipped to the largest float. Only unreferenced vertices can overflow: `Mesh`
    refuses faces with such coordinates.
    """
    largest = np.finfo(np.float64).max
    with np.errstate(over="ignore"):
        divided = np.clip(vertices / divisors, -largest, largest)
        return np.asarray(np.clip(divided * factors, -largest, largest))


def first_equal(rows: npt.NDArray[Any]) -> IntArray:
    """Return, for each row of an array, the lowest index of an equal row, shape (n,)."""
    order = np.lexsort(rows.T[::-1])  # stable: equal rows keep their order
    ordered = rows[order]
    starts = np.ones(len(rows), dtype=np.bool_)
    starts[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first = np.empty(len(rows), dtype=np.int64)
    first[order] = order[starts][np.cumsum(starts) - 1]
    return first


_XYZ = "give x, y and z of each, shape (n, 3)"
_CORNERS = "give three vertex indices for each triangle, shape (m, 3)"


def _offenders(indices: IntArray) -> str:
    """Write the first indices of a list: "3, 17, 21 and 40 more"."""
    named = ", ".join(str(index) for index in indices[:_NAMED_OFFENDERS])
    rest = len(indices) - _NAMED_OFFENDERS
    return f"{named} and {rest} more" if rest > 0 else named


def checked_vertices(given: Any) -> FloatArray:
    """Copy coordinates; raise an `InputError` unless they are finite and of shape (n, 3)."""
    try:
        if np.iscomplexobj(given):
            raise TypeError  # a cast would drop the imaginary parts
        if np.asarray(given).dtype.kind in "mM":
            raise TypeError  # times
        if np.ma.is_masked(given):
            given = np.ma.filled(np.ma.asarray(given, np.float64), np.nan)
        vertices = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError("wrong-type", "Vertices are not an array of numbers", _XYZ) from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError("wrong-shape", f"Vertices have shape {vertices.shape}", _XYZ)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        fault = f"The coordinates of some vertices are NaN or infinite (vertex {_offenders(bad)})"
        raise InputError("not-finite", fault, "remove or repair them first")
    return vertices


def check_vertex(vertex: int, n: int) -> None:
    """Raise an `InputError` unless a vertex is an index from 0 to n - 1."""
    try:
        valid = not isinstance(vertex, bool) and 0 <= operator.index(vertex) < n
    except TypeError:
        valid = False
    if not valid:
        remedy = f"give a whole number from 0 to {n - 1}"
        raise InputError("vertex-out-of-range", f"There is no vertex {vertex}", remedy)


def check_size(vertices: FloatArray, faces: IntArray) -> None:
    """Raise an `InputError` if the fourth power of coordinates, or its inverse, overflows."""
    largest = float(np.abs(vertices).max(initial=0.0))
    if largest > _LARGEST or 0.0 < largest < 1.0 / _LARGEST:
        # unreferenced vertices may be anywhere
        largest = float(np.abs(vertices[faces[distinct_corners(faces)]]).max(initial=0.0))
    if largest > _LARGEST or 0.0 < largest < 1.0 / _LARGEST:
        raise InputError(
            "beyond-floating-point",
            f"Coordinates of size {largest:.3g} leave no room for areas and eigenvalues",
            f"scale them to between {1.0 / _LARGEST:.0g} and {_LARGEST:.0g}",
        )


def checked_faces(given: Any, n_vertices: int) -> IntArray:
    """Copy vertex indices of triangles; raise an `InputError` unless valid, shape (m, 3)."""
    try:
        array = np.asarray(np.ma.filled(given, -1) if np.ma.is_masked(given) else given)
        if array.dtype.kind == "O" and array.ndim == 2:
            array = array.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError("wrong-type", "Faces are not an array of indices", _CORNERS) from None
    if array.size == 0:
        raise InputError("no-faces", "The mesh has no faces", "give a surface, not points")
    if array.ndim != 2 or array.shape[1] != 3:
        counts_first = array.ndim == 2 and array.shape[1] == 4 and np.all(array[:, 0] == 3)
        remedy = "omit the counts, with faces[:, 1:]" if counts_first else "split polygons first"
        raise InputError("wrong-shape", f"Faces have shape {array.shape}", f"{_CORNERS}; {remedy}")
    if array.dtype.kind not in "iuf":
        raise wrong_type("Faces", array.dtype, "vertex indices")
    with np.errstate(invalid="ignore"):
        wrong = (array < 0) | (array >= n_vertices)
        if array.dtype.kind == "f":
            wrong |= array != np.floor(array)
    bad = np.flatnonzero(wrong.any(axis=1))
    if len(bad):
        from_one = np.min(array) == 1 and np.max(array) == n_vertices
        raise InputError(
            "vertex-out-of-range",
            f"Faces name vertices that do not exist (face {_offenders(bad)}, the first as"
            f" {array[bad[0]].tolist()})",
            f"count from 0 to {n_vertices - 1}{': subtract 1' if from_one else ''}",
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

    #: Shape (n_file,): Index in the mesh of each vertex of the file, -1 if removed. Merged vertices
    #: have the same index.
    here: npt.NDArray[np.int64]

    @property
    def n_file(self) -> int:
        """Number of vertices of the file."""
        return len(self.here)

    @cached_property
    def in_file(self) -> npt.NDArray[np.int64]:
        """Index in the file of each vertex of the mesh, the lowest of merged vertices, (n,)."""
        vertices, first = np.unique(self.here, return_index=True)
        return first[vertices >= 0].astype(np.int64)

    def then(self, here: npt.NDArray[np.int64]) -> FileNumbering:
        """Compose with a further repair; `here` maps the vertices before it to those after it."""
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


#: Area of a small component relative to the largest one, see `Triangles.small_components`.
SMALL = 0.05
#: Height of a degenerate face relative to its longest edge.
_FLAT = 1e-12
#: Faces processed at a time, so that their arrays fit into the cache.
_FACES = 16384


@dataclass(frozen=True, eq=False)
class Triangles:
    """Vertices, shape (n, 3), and faces, (m, 3), with their geometry: base class of `Mesh`."""

    vertices: FloatArray
    faces: IntArray

    @property
    def n_vertices(self) -> int:
        """Number of vertices, unreferenced ones included."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lowest and highest coordinates, shape (2, 3), in `unit`, without unreferenced vertices.

        A single distant unreferenced vertex would determine the size of the whole view.
        """
        points = self.vertices[self.referenced] if len(self.unreferenced) else self.vertices
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def face_areas(self) -> FloatArray:
        """Area of each face, shape (m,), in squared `unit`."""
        areas = np.empty(self.n_faces)
        for part in blocks(self.n_faces, _FACES):
            areas[part] = 0.5 * np.linalg.norm(self._crosses(part), axis=1)
        return areas

    @cached_property
    def area(self) -> float:
        """Area of the whole surface, in squared `unit`."""
        return float(self.face_areas.sum())

    @cached_property
    def vertex_areas(self) -> FloatArray:
        """A third of the area of the faces around each vertex, shape (n,), in squared `unit`."""
        return self._sums_at_vertices(self.face_areas / 3.0)

    def area_sample(self, count: int = 10_000) -> IntArray:
        """Return vertices spread over the surface in proportion to its area, shape (count,).

        Statistics over the sample are weighted by area. `small_components` are left out, since
        values on debris differ (heat cannot flow away). The indices ascend, a vertex may occur
        several times, and the result is deterministic.
        """
        large = ~self.small_components[self.faces[:, 0]]
        filled = np.cumsum(self.face_areas * large)
        drawn = np.searchsorted(filled, (np.arange(count) + 0.5) / count * filled[-1])
        corners = self.faces[np.minimum(drawn, self.n_faces - 1), np.arange(count) % 3]
        return np.sort(corners).astype(np.int64)

    @cached_property
    def referenced(self) -> npt.NDArray[np.bool_]:
        """Mask of the vertices of faces with three different corners, shape (n,)."""
        used = np.zeros(self.n_vertices, dtype=np.bool_)
        used[self.faces[self.distinct_corners]] = True
        return used

    @cached_property
    def unreferenced(self) -> IntArray:
        """Indices of the vertices that are not `referenced`."""
        return np.flatnonzero(~self.referenced)

    def on_surface(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Replace values, shape (n, ...), by 0 at unreferenced vertices, where NaN is allowed."""
        if len(self.unreferenced):
            values = values.copy()
            values[self.unreferenced] = 0.0
        return values

    @cached_property
    def distinct_corners(self) -> npt.NDArray[np.bool_]:
        """Mask of the faces with three different corners, shape (m,)."""
        return distinct_corners(self.faces)

    @property
    def proper_faces(self) -> IntArray:
        """Faces with three different corners; `faces` itself if these are all."""
        distinct = self.distinct_corners
        return self.faces if distinct.all() else self.faces[distinct]

    @cached_property
    def degenerate_faces(self) -> npt.NDArray[np.bool_]:
        """Mask of the faces with a repeated corner or, up to rounding, no area, shape (m,)."""
        a, b, c = self._corners(slice(None))
        squares = [np.square(p - q).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))]
        longest = np.sqrt(np.max(squares, axis=0))
        # The height over the longest edge is as inaccurate as the coordinates.
        rounding = 4.0 * np.finfo(np.float64).eps * np.abs(self.bounds).max()
        flat = 2.0 * self.face_areas <= (_FLAT * longest + rounding) * longest
        return np.asarray(~self.distinct_corners | flat)

    @cached_property
    def duplicate_faces(self) -> npt.NDArray[np.bool_]:
        """Mask of the faces with the three vertices of an earlier face, shape (m,)."""
        return np.asarray(first_equal(np.sort(self.faces, axis=1)) != np.arange(self.n_faces))

    @cached_property
    def component_labels(self) -> IntArray:
        """Connected component of each vertex, shape (n,); -1 where unreferenced.

        Faces that share a vertex are connected. Components are numbered by their lowest vertex.
        """
        from scipy import sparse
        from scipy.sparse.csgraph import connected_components

        index = sparse.get_index_dtype(maxval=self.n_vertices)
        corners = self.proper_faces.T.astype(index, order="C")
        sides = corners[:2].ravel(), corners[1:].ravel()
        joined = sparse.coo_array(
            (np.ones(len(sides[0]), dtype=np.int8), sides), shape=(self.n_vertices,) * 2
        )
        _, labels = connected_components(joined, directed=False)
        result = np.full(self.n_vertices, -1, dtype=np.int64)
        # SciPy numbers in the same order, but counts unreferenced vertices as components
        result[self.referenced] = np.unique(labels[self.referenced], return_inverse=True)[1]
        return result

    @cached_property
    def small_components(self) -> npt.NDArray[np.bool_]:
        """Mask of the vertices of components below `SMALL` times the largest area, shape (n,)."""
        labels = self.component_labels
        areas = np.bincount(
            np.maximum(labels[self.faces[:, 0]], 0), self.face_areas, int(labels.max()) + 1
        )
        return np.asarray((areas < SMALL * areas.max())[labels] & (labels >= 0))

    @property
    def n_components(self) -> int:
        """Number of connected components; unreferenced vertices are in none."""
        return int(self.component_labels.max()) + 1

    @cached_property
    def vertex_normals(self) -> npt.NDArray[np.float32]:
        """Unit normals, shape (n, 3): the area-weighted mean over the faces around a vertex.

        (0, 0, 1) where the mean vanishes: at unreferenced vertices, and where normals cancel.
        """
        crosses = np.empty((self.n_faces, 3))
        for part in blocks(self.n_faces, _FACES):
            crosses[part] = self._crosses(part)
        total = np.column_stack([self._sums_at_vertices(axis) for axis in crosses.T])
        length = np.linalg.norm(total, axis=1, keepdims=True)
        # sums within rounding of zero have no direction
        vanishing = length[:, 0] <= 1e-12 * self.area / self.n_faces
        total[vanishing] = (0.0, 0.0, 1.0)
        length[vanishing] = 1.0
        return np.asarray(total / length, dtype=np.float32)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of coordinates and indices: 64 hexadecimal digits."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces):
            digest.update(str(array.shape).encode())
            digest.update(array.ravel().data)
        return digest.hexdigest()

    def _sums_at_vertices(self, of_faces: FloatArray) -> FloatArray:
        """Sum values of faces, shape (m,), at their vertices, shape (n,)."""
        repeated = np.repeat(of_faces, 3)
        return np.bincount(self.faces.ravel(), repeated, self.n_vertices).astype(np.float64)

    def _crosses(self, part: slice) -> FloatArray:
        """Return the cross products of two edges of some faces, shape (p, 3).

        The length is twice the area, the direction the normal.
        """
        a, b, c = self._corners(part)
        return np.asarray(np.cross(b - a, c - a), dtype=np.float64)

    def _corners(self, part: slice) -> tuple[FloatArray, ...]:
        """Return coordinates of the three corners of some faces, shape (p, 3) each.

        Faces with a repeated corner are reduced to one point.
        """
        faces, distinct = self.faces[part], self.distinct_corners[part]
        if not distinct.all():
            faces = np.where(distinct[:, None], faces, faces[:, :1])
        return tuple(self.vertices[faces[:, corner]] for corner in range(3))
