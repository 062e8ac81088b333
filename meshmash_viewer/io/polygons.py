"""What the readers of mesh files share: rows of numbers, polygons to triangles."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.mesh import FloatArray, IntArray, MeshLike, as_mesh
from meshmash_viewer.vertex_map import Label

#: Maps that are taken of one file.
MOST_MAPS = 64


@dataclass(frozen=True)
class RawMap:
    """Values per vertex as a file has them, before any check.

    Parameters
    ----------
    name : str
        "" for that of the file.
    values : ndarray, shape (n,)
    labels : tuple of Label
    indices : bool
        Whether the values are the indices of the vertices that are in a label.
    rows : ndarray of int64, shape (n,), optional
        The vertices of the mesh's file that the values are of, ascending; None for all of them.
    volume : tuple of int
        The shape that the values have in the file, where it may be that of a volume.
    """

    name: str
    values: npt.NDArray[Any]
    labels: tuple[Label, ...] = ()
    indices: bool = False
    rows: IntArray | None = None
    volume: tuple[int, ...] = ()

    @property
    def last(self) -> int:
        """The last vertex that it names; -1 where it names none."""
        named = self.values if self.indices else self.rows
        return -1 if named is None else int(named.max())


def are_ascending_indices(values: npt.NDArray[Any]) -> bool:
    """Whether an array holds whole numbers from 0, each larger than the one before."""
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        return False
    whole = np.isfinite(values).all() and np.array_equal(values, np.floor(values))
    return bool(whole and (values[:1] >= 0).all() and (values[1:] > values[:-1]).all())


@dataclass(frozen=True)
class RawMesh:
    """What a file holds, before any check; a file of maps alone has no vertices and no faces.

    Parameters
    ----------
    vertices : ndarray of float64, shape (n, 3)
        Coordinates as written in the file.
    faces : ndarray of int64, shape (m, 3)
        Vertex indices, counted from zero; they may be out of range.
    unit : str, optional
        The unit the format or the file states; None where it states none.
    maps : tuple of RawMap
        What it has at each vertex besides.
    remarks : tuple of str
        What was left out of the file, as clauses that follow its name: "holds 12 lines, which are
        left out".
    structure : str
        The part of a brain that the file says it is of, "" if it does not.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str | None = None
    maps: tuple[RawMap, ...] = ()
    remarks: tuple[str, ...] = ()
    structure: str = ""


def maps_alone(maps: Iterable[RawMap], remarks: tuple[str, ...] = ()) -> RawMesh:
    """What a file holds that has no mesh."""
    no_vertices, no_faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return RawMesh(no_vertices, no_faces, maps=tuple(maps), remarks=remarks)


def raw_mesh(given: RawMesh | MeshLike) -> RawMesh:
    """What a reader gives: those of plug-ins give a mesh in any accepted form."""
    if isinstance(given, RawMesh):
        return given
    mesh = as_mesh(given)
    maps = tuple(RawMap(each.name, each.values, each.labels) for each in mesh.maps)
    return RawMesh(mesh.vertices, mesh.faces, mesh.unit or None, maps, structure=mesh.structure)


class NotANumber(InputError):
    """What stands where a number should, and the line of the text, counted from 0."""

    def __init__(self, token: str, text: bytes, place: int) -> None:
        self.token = token
        self.line = text.count(b"\n", 0, place)
        super().__init__(f"holds {token!r} where a number should be")

    def in_line(self, number: int) -> InputError:
        """The same with the number of the line in the file, counted from 1."""
        return InputError(f"holds {self.token!r} where a number should be, in line {number}")


def parse_rows(text: bytes, dtype: type[np.generic]) -> tuple[npt.NDArray[Any], IntArray]:
    """Read lines of numbers separated by white space, far faster than line by line.

    Parameters
    ----------
    text : bytes
        ASCII lines; lines without a number are left out.
    dtype : type
        `numpy.float64` or `numpy.int64`.

    Returns
    -------
    numbers : ndarray of `dtype`, shape (k,)
        The numbers of all lines, one after the other.
    counts : ndarray of int64, shape (rows,)
        How many numbers each line holds, at least 1.

    Raises
    ------
    NotANumber
        If something is no number.
    """
    characters = np.frombuffer(text, dtype=np.uint8)
    is_space = characters <= 32
    begins = ~is_space
    begins[1:] &= is_space[:-1]
    token_starts = np.flatnonzero(begins)
    line_ends = np.append(np.flatnonzero(characters == ord("\n")), len(characters))
    counts = np.diff(np.searchsorted(token_starts, line_ends), prepend=0).astype(np.int64)
    numbers: npt.NDArray[Any]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # older NumPy stops early instead
            numbers = np.fromstring(text, dtype=dtype, sep=" ")
    except ValueError:
        numbers = np.empty(0, dtype=dtype)
    if len(numbers) != len(token_starts):
        raise _first_fault(text, dtype)
    return numbers, counts[counts > 0]


def _first_fault(text: bytes, dtype: type[np.generic]) -> NotANumber:
    convert = float if np.issubdtype(dtype, np.floating) else int
    for token in re.finditer(rb"[^\x00-\x20]+", text):
        try:
            convert(token[0].replace(b"_", b"?"))  # Python would take 1_000
        except ValueError:
            return NotANumber(printable(token[0].decode("latin-1"), 20), text, token.start())
    odd = re.search(rb"[\x00-\x08\x0e-\x1f]", text)  # as little a number as it is white space
    return NotANumber("\ufffd", text, odd.start() if odd else 0)
