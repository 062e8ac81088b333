"""Brain surfaces: GIFTI and FreeSurfer, by nibabel; both are in millimetres."""

from __future__ import annotations

import gzip
import re
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.guarded import read_guarded
from meshmash_viewer.io.provenance import stated_unit
from meshmash_viewer.io.raw import MOST_MAPS, RawMap, RawMesh, maps_alone
from meshmash_viewer.vertex_map import Label

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
    _refuse_dimensions(path)
    return read_guarded(gifti_surface, path)


def _refuse_dimensions(path: Path) -> None:
    """All of which nibabel would look for."""
    many = re.search(rb"Dimensionality\s*=\s*.\s*(\d{2,})", path.read_bytes())
    if many is not None:
        raise InputError(f"has an array of {printable(many[1].decode(), 20)} dimensions")


def gifti_surface(path: Path) -> RawMesh:
    """Read a GIFTI surface however much it unpacks to; only `read_guarded` calls this."""
    image = _gifti(path)
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = image.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if not points or not triangles:
        raise InputError(
            "holds no surface (a GIFTI surface has a point set and triangles;"
            " functional and label files have neither)"
        )
    if len(points) > 1 or len(triangles) > 1:
        raise InputError(
            f"holds {len(points)} point sets and {len(triangles)} sets of triangles, and does not"
            " say which is the surface: write each surface to a file of its own."
        )
    vertices, faces = points[0].data, triangles[0].data
    if vertices is None or faces is None:
        raise InputError("has a point set or triangles without data")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"has arrays of shapes {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise InputError("has triangles whose vertex indices are no whole numbers")
    said = dict(image.meta or {}).get("meshmash-viewer", "")
    return RawMesh(
        np.asarray(vertices, dtype=np.float64),
        faces.astype(np.int64),
        "" if stated_unit(said) == "" else "mm",
        tuple(_gifti_maps(image))[:MOST_MAPS],
        structure=_structure(points[0]) or _structure(image),
    )


def _structure(described: Any) -> str:
    return printable(dict(described.meta or {}).get("AnatomicalStructurePrimary", ""), 60)


def gifti_maps(path: Path) -> RawMesh:
    """Read the arrays of a GIFTI file with one number a vertex, labels with their table."""
    _refuse_dimensions(path)
    return _only(_gifti_maps(_gifti(path)), "one number a vertex")


def _gifti(path: Path) -> Any:
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
    return parser.img


def _gifti_maps(image: Any) -> Iterator[RawMap]:
    """Every array that is neither the points nor the triangles."""
    from nibabel.nifti1 import intent_codes

    table = tuple(
        Label(int(each.key), str(each.label), _hexadecimal(each.rgba))
        for each in image.labeltable.labels
    )
    for at, array in enumerate(image.darrays):
        intent = intent_codes.niistring[array.intent]
        data = array.data
        if intent in ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE") or data is None:
            continue
        name = dict(array.meta or {}).get("Name") or _stem(image, at)
        labels = table if intent == "NIFTI_INTENT_LABEL" else ()
        columns = [data] if data.ndim == 1 else list(data.T) if data.ndim == 2 else []
        for column in columns:
            yield RawMap(name, np.ascontiguousarray(column), labels)


def _stem(image: Any, at: int) -> str:
    return "" if len(image.darrays) == 1 else f"map {at}"


def _hexadecimal(rgba: Any) -> str:
    """A colour from shares of red, green and blue; grey where a file does not say."""
    shares = [0.5 if share is None else min(max(float(share), 0.0), 1.0) for share in rgba[:3]]
    return "#" + "".join(f"{round(255 * share):02x}" for share in shares)


def freesurfer_values(path: Path) -> RawMesh:
    """Read a FreeSurfer file of one number a vertex, such as ``lh.curv`` or ``lh.thickness``."""
    from nibabel.freesurfer.io import read_morph_data

    if not is_freesurfer_values(path):
        raise InputError("does not begin like a FreeSurfer file of one number a vertex")
    read: Any = read_morph_data
    return _only([RawMap("", np.asarray(read(str(path)), dtype=np.float32))], "")


def freesurfer_label(path: Path) -> RawMesh:
    """Read the indices of the vertices in one label (``.label``)."""
    from nibabel.freesurfer.io import read_label

    read: Any = read_label
    inside = np.atleast_1d(np.asarray(read(str(path)), dtype=np.int64))
    if not len(inside) or inside.min() < 0:
        raise InputError("names no vertex")
    return _only([RawMap("", inside, indices=True)], "")


def mgh_maps(path: Path) -> RawMesh:
    """Read a surface's values from MGH or MGZ, one map a frame.

    The values are along any axis, or folded over several as FreeSurfer does for large surfaces,
    the first axis running fastest.
    """
    from nibabel.freesurfer.mghformat import MGHImage

    image: Any = MGHImage
    packed = path.suffix.lower() == ".mgz"
    with gzip.open(path) if packed else path.open("rb") as file:
        data = np.asarray(image.from_bytes(file.read()).dataobj)
    sides, n_frames = data.shape[:3], int(np.prod(data.shape[3:]))
    if max(sides) == 1:  # the axis of frames is that of the values
        sides, n_frames = data.shape, 1
    frames = data.reshape((-1, n_frames), order="F").T
    volume = sides if sum(side > 1 for side in sides) > 1 else ()
    names = [f"frame {at}" for at in range(n_frames)] if n_frames > 1 else [""]
    return _only(
        (
            RawMap(name, np.array(each, np.float64), volume=volume)
            for name, each in zip(names, frames, strict=True)
        ),
        "",
    )


def _only(maps: Iterable[RawMap], what: str) -> RawMesh:
    """What a file of maps alone comes to."""
    found = tuple(maps)
    if not found:
        raise InputError(f"holds nothing with {what}")
    return maps_alone(found)


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
    if is_freesurfer_patch(path):
        raise InputError(
            "A FreeSurfer patch names vertices of a surface and has no triangles of its own: open"
            " the surface that it was cut from."
        )
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


def is_freesurfer_values(path: Path) -> bool:
    """Whether a file is of one number a vertex, by how it begins and by its size."""
    with path.open("rb") as file:
        begins = file.read(3) == _SHORT_QUADS
    return begins and _is_curvature(path, path.stat().st_size)


def is_freesurfer_patch(path: Path) -> bool:
    """Whether a file is a part of a surface, flattened or not: -1, and 16 bytes a vertex."""
    with path.open("rb") as file:
        header = file.read(8)
    if len(header) < 8:
        return False
    magic, n_vertices = struct.unpack(">ii", header)
    return bool(magic == -1 and path.stat().st_size == 8 + 16 * n_vertices)


def is_freesurfer_surface(beginning: bytes) -> bool:
    """Whether a file begins with one of the numbers that FreeSurfer marks surfaces with."""
    return beginning[:3] in (_TRIANGLES, _QUADS, _SHORT_QUADS)
