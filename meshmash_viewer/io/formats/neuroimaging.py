"""Brain surfaces: GIFTI and FreeSurfer, by nibabel; both are in millimetres."""

from __future__ import annotations

import base64
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.faults import printable
from meshmash_viewer.io.guarded import read_guarded
from meshmash_viewer.io.limits import ReadLimits
from meshmash_viewer.io.polygons import RawMesh

__all__ = ["FREESURFER_ENDINGS", "is_freesurfer_surface", "read_freesurfer", "read_gifti"]

#: What most surfaces are called in a FreeSurfer subject's ``surf`` folder, after "lh" or "rh";
#: the others are known by how they begin.
FREESURFER_ENDINGS = (
    ".pial",
    ".white",
    ".inflated",
    ".sphere",
    ".orig",
    ".smoothwm",
    ".midthickness",
    ".nofix",
    ".fsurf",
)


#: What FreeSurfer surfaces begin with: triangles, and the two kinds of quadrangles.
_TRIANGLES, _QUADS, _SHORT_QUADS = b"\xff\xff\xfe", b"\xff\xff\xfd", b"\xff\xff\xff"
#: A surface holds two arrays; the others of a file are data on it, and never so many.
_MOST_ARRAYS = 10_000
_MOST_DIMENSIONS = 6


def read_gifti(path: Path) -> RawMesh:
    """Read the point set and triangles of a GIFTI surface.

    Raises
    ------
    InputError
        If one of the two is absent, or an array is not what its attributes say.
    """
    try:
        return _surface(path, trusted=False)
    except _UnpacksToMuch:
        return read_guarded(gifti_surface, path)


def gifti_surface(path: Path) -> RawMesh:
    """Read a GIFTI surface however much it unpacks to; only `read_guarded` calls this."""
    return _surface(path, trusted=True)


class _UnpacksToMuch(Exception):
    """An array that had better be unpacked under limits."""


def _surface(path: Path, trusted: bool) -> RawMesh:
    from xml.parsers.expat import ExpatError

    parser = _gifti_parser(path, trusted)
    try:
        with path.open("rb") as file:
            parser.parse(fptr=file)
    except ExpatError as fault:
        raise InputError(f"is not the XML of a GIFTI file ({printable(fault)})") from fault
    except (InputError, MemoryError, _UnpacksToMuch):
        raise
    except Exception as fault:  # whatever a value means to nibabel, that element is to blame
        detail = printable(fault, 80) or type(fault).__name__
        raise InputError(
            f"has an element {parser.element} that cannot be read ({detail})"
        ) from fault
    surface = parser.img
    if surface is None:
        raise InputError("is not a GIFTI file")
    points = surface.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = surface.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if not points or not triangles:
        raise InputError(
            "holds no surface (a GIFTI surface has a point set and triangles;"
            " functional and label files have neither)"
        )
    vertices, faces = points[0].data, triangles[0].data
    if vertices is None or faces is None:
        raise InputError("has a point set or triangles without data")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"has arrays of shapes {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise InputError("has triangles whose vertex indices are no whole numbers")
    return RawMesh(np.asarray(vertices, dtype=np.float64), faces.astype(np.int64), "mm")


def _gifti_parser(path: Path, trusted: bool) -> Any:
    """Nibabel's parser, which believes no array to be larger than what is there."""
    from nibabel.gifti import parse_gifti_fast, util
    from nibabel.nifti1 import data_type_codes

    base: Any = parse_gifti_fast.GiftiImageParser
    codes: Any = util
    types: Any = data_type_codes
    size_of_file = path.stat().st_size

    class Parser(base):  # type: ignore[misc]
        element = ""

        def __init__(self) -> None:
            super().__init__()
            self._n_arrays = self._unpacked = 0
            self._text: list[str] = []

        def StartElementHandler(self, name: str, attributes: dict[str, str]) -> None:
            self.element = printable(name, 40)
            if name == "DataArray":
                self._n_arrays += 1
                if self._n_arrays > _MOST_ARRAYS:
                    raise InputError(f"holds more than {_MOST_ARRAYS} arrays, so it is no surface")
                _check_dimensions(attributes)
            super().StartElementHandler(name, attributes)
            if name == "DataArray" and self.da.ext_fname:
                outside = path.parent / self.da.ext_fname
                room = outside.stat().st_size if outside.is_file() else -1
                if room < self.da.ext_offset + self._size() or self.da.ext_offset < 0:
                    raise InputError(
                        f"keeps numbers in a file {printable(self.da.ext_fname, 60)} that is not"
                        " beside it or too short"
                    )

        def CharacterDataHandler(self, data: str) -> None:
            if self._is_binary():
                self._text.append(data)
            else:
                super().CharacterDataHandler(data)

        def flush_chardata(self) -> None:
            if not self._is_binary() or not self._text:
                super().flush_chardata()
                return
            text, self._text = "".join(self._text), []
            packed = codes.gifti_encoding_codes.label[self.da.encoding] == "B64GZ"
            self._unpacked += self._size() if packed else 0
            if not trusted and ReadLimits.are_needed(size_of_file, self._unpacked):
                raise _UnpacksToMuch
            order: Any = codes.array_index_order_codes.npcode[self.da.ind_ord]
            numbers = np.frombuffer(_decoded(text, self._size(), packed), dtype=self._dtype())
            self.da.data = numbers.reshape(tuple(self.da.dims), order=order)

        def _is_binary(self) -> bool:
            return (
                self.write_to == "Data"
                and self.da is not None
                and codes.gifti_encoding_codes.label[self.da.encoding] in ("B64BIN", "B64GZ")
            )

        def _dtype(self) -> np.dtype[Any]:
            order = codes.gifti_endian_codes.byteorder[self.da.endian]
            dtype: np.dtype[Any] = types.dtype[self.da.datatype].newbyteorder(order)
            return dtype

        def _size(self) -> int:
            lengths: list[int] = self.da.dims
            return math.prod(lengths) * self._dtype().itemsize

    return Parser()


def _check_dimensions(attributes: dict[str, str]) -> None:
    stated = attributes.get("Dimensionality", "0")
    lengths = [attributes.get(f"Dim{axis}", "0") for axis in range(_MOST_DIMENSIONS)]
    if not (stated.isdecimal() and len(stated) == 1 and int(stated) <= _MOST_DIMENSIONS):
        raise InputError(f"has an array of {printable(stated, 20)} dimensions")
    for length in lengths:
        if not (length.isdecimal() and len(length) <= 12):
            raise InputError(f"has an array of length {printable(length, 20)}")


def _decoded(text: str, size: int, packed: bool) -> bytes:
    """Bytes of an array, of which no more than it states are ever unpacked."""
    try:
        data = base64.b64decode(text)
        if packed:
            data = zlib.decompressobj().decompress(data, size + 1)
    except (ValueError, zlib.error) as fault:
        raise InputError(f"has an array that is damaged ({printable(fault)})") from fault
    if len(data) != size:
        more = "more" if len(data) > size else f"{len(data)}"
        raise InputError(f"has an array that promises {size} bytes but holds {more}")
    return data


def read_freesurfer(path: Path) -> RawMesh:
    """Read a FreeSurfer surface (triangle or quadrangle file).

    Raises
    ------
    InputError
        If the file does not begin like one, or ends before what it promises.
    """
    from nibabel.freesurfer.io import read_geometry

    with path.open("rb") as file:
        magic = file.read(3)
        if magic == _TRIANGLES:
            file.readline(), file.readline()  # who made it, and an empty line
            n_vertices, n_faces = struct.unpack(">ii", file.read(8).ljust(8, b"\xff"))
            needed = file.tell() + 12 * n_vertices + 12 * n_faces
        elif magic in (_QUADS, _SHORT_QUADS):
            header = file.read(6).ljust(6, b"\0")
            n_vertices, n_faces = (int.from_bytes(part) for part in (header[:3], header[3:]))
            needed = 9 + (12 if magic == _QUADS else 6) * n_vertices + 12 * n_faces
        else:
            raise InputError("does not begin like a FreeSurfer surface")
        size = path.stat().st_size
    if magic == _SHORT_QUADS and needed != size and _is_curvature(path, size):
        raise InputError("holds one number a vertex, such as a curvature or thickness, no surface")
    if min(n_vertices, n_faces) < 0 or needed > size:
        raise InputError(
            f"promises {n_vertices} vertices and {n_faces} faces, for which it has not enough"
            " bytes, so it was cut short"
        )
    read: Any = read_geometry
    vertices, faces = read(str(path))[:2]
    return RawMesh(
        np.asarray(vertices, dtype=np.float64).reshape(-1, 3),
        np.asarray(faces, dtype=np.int64).reshape(-1, 3),
        "mm",
    )


def _is_curvature(path: Path, size: int) -> bool:
    """Whether it is a file of values, which begins as a surface of quadrangles may."""
    with path.open("rb") as file:
        header = file.read(15)
    if len(header) < 15:
        return False
    n_vertices, _, n_values = struct.unpack(">iii", header[3:])
    return bool(size == 15 + 4 * n_vertices * n_values)


def is_freesurfer_surface(beginning: bytes) -> bool:
    """Whether a file begins with one of the numbers that FreeSurfer marks surfaces with."""
    return beginning[:3] in (_TRIANGLES, _QUADS, _SHORT_QUADS)
