"""Brain surfaces: GIFTI and FreeSurfer, by nibabel; both are in millimetres."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.guarded import read_guarded
from meshmash_viewer.io.polygons import RawMesh

__all__ = [
    "FREESURFER_ENDINGS",
    "gifti_surface",
    "is_freesurfer_surface",
    "read_freesurfer",
    "read_gifti",
]

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


def read_gifti(path: Path) -> RawMesh:
    """Read the point set and triangles of a GIFTI surface, by nibabel in a process of its own.

    Raises
    ------
    InputError
        If one of the two is absent, or an array is not what its attributes say.
    """
    # All of which nibabel would look for.
    many = re.search(rb"Dimensionality\s*=\s*.\s*(\d{2,})", path.read_bytes())
    if many is not None:
        raise InputError(f"has an array of {printable(many[1].decode(), 20)} dimensions")
    return read_guarded(gifti_surface, path)


def gifti_surface(path: Path) -> RawMesh:
    """Read a GIFTI surface however much it unpacks to; only `read_guarded` calls this."""
    from xml.parsers.expat import ExpatError

    from nibabel.gifti import parse_gifti_fast

    untyped: Any = parse_gifti_fast
    parser = untyped.GiftiImageParser()
    try:
        with path.open("rb") as file:
            parser.parse(fptr=file)
    except ExpatError as fault:
        raise InputError(f"is not the XML of a GIFTI file ({printable(fault)})") from fault
    if parser.img is None:
        raise InputError("is not a GIFTI file")
    points = parser.img.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = parser.img.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
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
