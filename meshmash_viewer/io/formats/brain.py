"""Readers of FreeSurfer and GIFTI: brain surfaces in millimetres, and their values and labels."""

from __future__ import annotations

import gzip
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, cut_short, no_whole_numbers, printable, wrong_format
from meshmash_viewer.io.provenance import stated_mesh
from meshmash_viewer.io.raw import RawMap, RawMesh, maps_alone, most_maps, row_per_vertex
from meshmash_viewer.io.text import parse_rows, read_text
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import MOST_LABELS, Label, numbered_labels

#: Endings of common FreeSurfer surfaces, after "lh" or "rh"; other surfaces are recognized by their
#: first bytes.
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
#: First bytes of FreeSurfer surfaces of triangles, and of two kinds of quadrangles.
_TRIANGLES, _QUADS, _SHORT_QUADS = b"\xff\xff\xfe", b"\xff\xff\xfd", b"\xff\xff\xff"
#: Largest number of bytes in which the coordinates of a surface of triangles begin.
_STAMP = 4096
#: Units of files with one number per vertex, by ending.
_UNITS = {".thickness": "mm", ".curv": "mm⁻¹", ".area": "mm²", ".volume": "mm³"}
#: Smallest extent of a surface that is read in metres; a mouse brain has 0.015 m.
_SMALLEST_IN_METRES = 0.005
#: Colour of the label of a ``.label`` file.
_INSIDE = "#d55e00"
#: Version of colour tables in which each label has a number.
_NUMBERED = -2
#: Remedy of files that have values and no surface.
_AS_MAP = "open the surface that it belongs to, and this file as a map of it"


def freesurfer_values(path: Path) -> RawMesh:
    """Read a FreeSurfer file with one number per vertex: ``lh.curv``, ``lh.thickness`` etc."""
    from nibabel.freesurfer.io import read_morph_data

    if freesurfer_kind(path) != "values":
        raise wrong_format("does not begin like a FreeSurfer file of one number per vertex")
    read: Any = read_morph_data
    values = np.asarray(read(str(path)), dtype=np.float32)
    return maps_alone([RawMap("", values, unit=_unit_of_values(path))])


def _unit_of_values(path: Path) -> str:
    """Return the unit of ``lh.thickness``, ``lh.thickness.mgh`` etc.; "" if unknown."""
    return next((_UNITS[end] for end in map(str.lower, path.suffixes) if end in _UNITS), "")


def freesurfer_label(path: Path) -> RawMesh:
    """Read the indices of the vertices in one label (``.label``)."""
    from nibabel.freesurfer.io import read_label

    read: Any = read_label
    inside = np.atleast_1d(np.asarray(read(str(path)), dtype=np.int64))
    if not len(inside) or inside.min() < 0:
        raise InputError("no-vertices", "names no vertex")
    with path.open("rb") as file:  # the second line has the number of vertices, which is not read
        stated = file.read(10_000).split(b"\n")[1].strip()
    if stated.isdigit() and (count := int(stated)) > len(inside):
        raise cut_short(f"promises {counted(count, 'vertex')} and has {len(inside):,}")
    label = Label(1, "", _INSIDE)
    return maps_alone([RawMap("", np.ones(len(inside)), (label,), rows=inside)])


def mgh_maps(path: Path) -> RawMesh:
    """Read values of a surface from an MGH or MGZ file, one map per frame.

    The vertices may be along any axis, or for large surfaces along several axes, with the index of
    the first axis running fastest, as FreeSurfer writes them.
    """
    from nibabel.freesurfer.mghformat import MGHImage

    image: Any = MGHImage
    packed = path.suffix.lower() == ".mgz"
    with gzip.open(path) if packed else path.open("rb") as file:
        data = np.asarray(image.from_bytes(file.read()).dataobj)
    sides, n_frames = data.shape[:3], int(np.prod(data.shape[3:]))
    if max(sides) == 1:  # the vertices are along the axis of frames
        sides, n_frames = data.shape, 1
    frames = data.reshape((-1, n_frames), order="F").T
    volume = sides if sum(side > 1 for side in sides) > 1 else ()
    names = [f"frame {at}" for at in range(n_frames)] if n_frames > 1 else [""]
    return maps_alone(
        RawMap(name, np.array(each, np.float64), unit=_unit_of_values(path), volume=volume)
        for name, each in zip(names, frames, strict=True)
    )


def read_freesurfer(path: Path) -> RawMesh:
    """Read a FreeSurfer surface (triangle or quadrangle file).

    `InputError` is raised if the file is no surface, or is shorter than its header states.
    """
    kind = freesurfer_kind(path)
    if kind == "patch":
        fault = "is a FreeSurfer patch, which names vertices of a surface and has no triangles"
        raise InputError("no-faces", fault, "open the surface that it was cut from")
    if kind == "values":
        fault = "holds one number per vertex, such as a thickness, and no surface"
        raise InputError("no-faces", fault, _AS_MAP)
    if not kind:
        raise wrong_format("does not begin like a FreeSurfer surface")
    content = path.read_bytes()
    magic = content[:3]
    if magic == _TRIANGLES:
        start, n_vertices, n_faces = _sizes(content)
    else:
        start, header = 9, content[3:9].ljust(6, b"\0")
        n_vertices, n_faces = (int.from_bytes(part) for part in (header[:3], header[3:]))
    needed = start + (6 if magic == _SHORT_QUADS else 12) * n_vertices + 12 * n_faces
    if min(n_vertices, n_faces) < 0 or needed > len(content):
        raise cut_short(
            f"promises {counted(n_vertices, 'vertex')} and {counted(n_faces, 'face')}, for which it"
            " does not have enough bytes"
        )
    if magic == _TRIANGLES:
        vertices = np.frombuffer(content, ">f4", 3 * n_vertices, start)
        faces = np.frombuffer(content, ">i4", 3 * n_faces, start + 12 * n_vertices)
    else:
        from nibabel.freesurfer.io import read_geometry

        read: Any = read_geometry
        vertices, faces = read(str(path))[:2]
    return _surface(vertices, faces)


def _sizes(content: bytes) -> tuple[int, int, int]:
    """Return the start of the coordinates, and the numbers of vertices and faces.

    The text before them usually consists of the creator and an empty line. Some programs write
    another number of lines: of several possible numbers, one is taken that fits the file's size.
    """
    ends = [each.end() for each in re.finditer(b"\n", content[:_STAMP])][:4]
    ends = [*ends[1:3], *ends[:1], *ends[3:]] or [3]
    found = [(at + 8, *struct.unpack(">ii", content[at : at + 8].ljust(8, b"\xff"))) for at in ends]
    fits = (
        (start, n, m)
        for start, n, m in found
        if min(n, m) > 0 and start + 12 * (n + m) <= len(content)
    )
    return next(fits, found[0])


def read_freesurfer_ascii(path: Path) -> RawMesh:
    """Read a FreeSurfer surface as text (``lh.pial.asc``), or values (``lh.thickness.asc``).

    `InputError` is raised if the file has another number of numbers than its header states.
    """
    text = read_text(path)
    is_surface = text.startswith(b"#")
    numbers, _ = parse_rows(text.partition(b"\n")[2] if is_surface else text, np.float64)
    if not is_surface:
        if not len(numbers) or len(numbers) % 5:
            raise wrong_format("holds neither a FreeSurfer surface nor values as text")
        values = numbers.reshape(-1, 5)[:, 4]  # after index and coordinates
        return maps_alone([RawMap("", values, unit=_unit_of_values(path))])
    n_vertices, n_faces = numbers[:2].astype(np.int64).tolist() if len(numbers) > 1 else (0, 0)
    if len(numbers) != 2 + 4 * (n_vertices + n_faces):
        raise InputError(
            "counts-differ",
            f"promises {counted(n_vertices, 'vertex')} and {counted(n_faces, 'face')} of four"
            f" numbers, and holds {counted(max(len(numbers) - 2, 0), 'number')}",
        )
    rows_of_four = numbers[2:].reshape(-1, 4)[:, :3]  # the last number is a flag
    return _surface(rows_of_four[:n_vertices], rows_of_four[n_vertices:])


def _surface(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> RawMesh:
    vertices = vertices.astype(np.float64).reshape(-1, 3)
    unit, remark = _unit(vertices)
    return RawMesh(vertices, faces.astype(np.int64).reshape(-1, 3), unit, unit_remark=remark)


def _unit(vertices: FloatArray) -> tuple[str, str]:
    """Return the unit of a brain by its extent, "mm" or "m", and a remark on "m"."""
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
    if not _SMALLEST_IN_METRES < extent < 1.0:
        return "mm", ""
    return "m", (
        f"has an extent of {extent:.3g}, too small for a brain in mm, the unit of its format, so it"
        " is read in m; if that is wrong, choose another unit in the panel Mesh, or with --unit mm"
    )


def freesurfer_kind(path: Path) -> str:
    """Return "surface", "values" or "patch", a part of a surface, by the first bytes; else ""."""
    is_packed = path.suffix.lower() == ".gz"
    try:
        with gzip.open(path) if is_packed else path.open("rb") as file:
            header = file.read(15)
        size = (
            int.from_bytes(path.read_bytes()[-4:], "little") if is_packed else path.stat().st_size
        )
    except (OSError, EOFError, zlib.error):
        return ""  # reading the file reports the error
    magic, n_vertices, _, n_values = struct.unpack(">3siii", header.ljust(15, b"\0"))
    if header.startswith(b"\xff\xff\xff\xff"):
        (n_placed,) = struct.unpack(">i", header[4:8].ljust(4, b"\0"))
        return "patch" if size == 8 + 16 * n_placed else "surface"
    is_old = size == 6 + 2 * int.from_bytes(header[:3]) > 6  # old format of values
    if is_old or (magic == _SHORT_QUADS and size == 15 + 4 * n_vertices * n_values):
        return "values"
    return "surface" if magic in (_TRIANGLES, _QUADS, _SHORT_QUADS) else ""


def freesurfer_annotation(path: Path) -> RawMesh:
    """Read a parcellation with its names and colours (``.annot``).

    The file has the packed colour of a label for each vertex, and a table of names and colours.
    Without a table, labels are named after their numbers. nibabel is not used: it ignores the
    vertex indices, assigns a label to vertices without one, and fails on tables with gaps in the
    numbers, such as FreeSurfer's table of 1,266 labels with numbers up to 14,175.

    `InputError` is raised if the file is cut short, or does not contain each vertex once.
    """
    content, place = path.read_bytes(), 0

    def take(size: int) -> bytes:
        nonlocal place
        taken = content[place : place + max(size, 0)]
        if len(taken) != size:
            raise cut_short("ends within its labels")
        place += size
        return taken

    def numbers(count: int) -> list[int]:
        taken: list[int] = np.frombuffer(take(4 * count), ">i4").tolist()
        return taken

    (count,) = numbers(1)
    pairs = np.array(numbers(2 * count), dtype=np.int64).reshape(-1, 2)
    order = np.argsort(pairs[:, 0], kind="stable")
    if not len(pairs) or not np.array_equal(pairs[order, 0], np.arange(len(pairs))):
        raise InputError("counts-differ", "has an annotation not once for each vertex from 0")
    if place == len(content) or numbers(1) == [0]:
        values = np.maximum(pairs[order, 1], 0)  # negative numbers are no labels
        if not values.any():
            raise InputError("no-labels", "has no vertex with a label")
        return maps_alone([RawMap("", values, _numbered(values))])
    labels = _labels(take, numbers)
    annotations = {int(label.color[5:7] + label.color[3:5] + label.color[1:3], 16): label.key
                   for label in reversed(labels)}  # fmt: skip
    known, places = np.unique(pairs[order, 1], return_inverse=True)
    others = np.where((known > 0) & ~np.isin(known, [each.key for each in labels]), known, -1)
    keys = list(map(annotations.get, known.tolist(), others.tolist()))  # no row: the packed colour
    return maps_alone([RawMap("", np.array(keys, dtype=np.int64)[places], labels)])


def _labels(take: Callable[[int], bytes], numbers: Callable[[int], list[int]]) -> tuple[Label, ...]:
    """Return the labels in the order of the file; keys are numbers in the file or positions."""
    (count,) = numbers(1)
    numbered = count == _NUMBERED
    if count < 0 and not numbered:
        raise InputError("wrong-version", f"has a label table of the unknown version {-count}")
    if numbered:
        numbers(1)  # largest number
    take(*numbers(1))  # name of the original file of the table
    if numbered:
        (count,) = numbers(1)
    labels = []
    for place in range(count):
        key = numbers(1)[0] if numbered else place
        name = take(*numbers(1)).split(b"\0")[0].decode("utf-8", "replace")
        rgb = numbers(4)[:3]
        labels.append(Label(key, name, "#" + "".join(f"{share & 255:02x}" for share in rgb)))
    return tuple(labels)


# -- GIFTI, by nibabel ---------------------------------------------------------------------------


def read_gifti(path: Path) -> RawMesh:
    """Read the point set and triangles of a GIFTI surface.

    `InputError` is raised if either is missing or given twice, or its arrays are invalid.
    """
    image = _gifti(path)
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = image.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if not points or not triangles:
        raise InputError(
            "no-faces",
            "holds no surface (a GIFTI surface has a point set and triangles, functional and label"
            " files have neither)",
            _AS_MAP,
        )
    if len(points) > 1 or len(triangles) > 1:
        raise InputError(
            "ambiguous-content",
            f"holds {len(points)} point sets and {len(triangles)} sets of triangles, and does not"
            " say which is the surface",
            "write each surface to a file of its own",
        )
    vertices, faces = points[0].data, triangles[0].data
    if vertices is None or faces is None:
        raise InputError("missing-data", "has a point set or triangles without data")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError("wrong-shape", f"has arrays of shapes {vertices.shape} and {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise no_whole_numbers("vertex indices")
    meta = _provenance(image)
    vertices = np.asarray(vertices, dtype=np.float64)
    stated = stated_mesh(meta)[0]  # unit before an export in mm
    unit, remark = _unit(vertices) if stated is None else ("mm" if stated else "", "")
    maps, remarks = most_maps(list(_gifti_maps(image)))
    return RawMesh(
        vertices,
        faces.astype(np.int64),
        unit,
        maps,
        remarks,
        structure=_structure(points[0]) or _structure(image),
        meta=meta,
        unit_remark=remark,
    )


def _provenance(image: Any) -> str:
    return str(dict(image.meta or {}).get("meshmash-viewer", ""))


def _structure(described: Any) -> str:
    return printable(dict(described.meta or {}).get("AnatomicalStructurePrimary", ""), 60)


def gifti_maps(path: Path) -> RawMesh:
    """Read the arrays of a GIFTI file with one number per vertex, and the table of labels."""
    image = _gifti(path)
    structures = filter(None, map(_structure, [image, *image.darrays]))
    structure = next(structures, "")
    return maps_alone(_gifti_maps(image, path.name), (), _provenance(image), structure)


def _gifti(path: Path) -> Any:
    from xml.parsers.expat import ExpatError

    from nibabel.gifti import parse_gifti_fast

    content = path.read_bytes()
    if many := re.search(rb"Dimensionality\s*=\s*.\s*(\d{2,})", content):  # slow in nibabel
        raise wrong_format(f"has an array of {printable(many[1].decode(), 20)} dimensions")
    untyped: Any = parse_gifti_fast
    parser = untyped.GiftiImageParser()
    try:
        with path.open("rb") as file:  # external data are found by its name
            parser.parse(fptr=file)
    except ExpatError as fault:
        raise wrong_format(f"is not the XML of a GIFTI file ({printable(fault)})") from fault
    if parser.img is None:
        raise wrong_format("is not a GIFTI file")
    return parser.img


def _gifti_maps(image: Any, name: str = "") -> Iterator[RawMap]:
    """Yield all arrays except points, triangles and indices; arrays without name are numbered."""
    from nibabel.nifti1 import intent_codes

    table = tuple(
        Label(int(each.key), str(getattr(each, "label", "")), _hexadecimal(each.rgba))
        for each in image.labeltable.labels
        if each.key != 0 or each.alpha != 0.0  # transparent 0 is "no label" in Workbench
    )
    others = ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE", "NIFTI_INTENT_NODE_INDEX")
    indices = image.get_arrays_from_intent("NIFTI_INTENT_NODE_INDEX")
    rows = indices[0].data.astype(np.int64) if indices else None
    if rows is not None and (rows.ndim != 1 or not len(rows) or rows.min() < 0):
        raise no_whole_numbers("vertex indices")
    alone = (
        sum(array.intent not in map(intent_codes.__getitem__, others) for array in image.darrays)
        == 1
    )
    for at, array in enumerate(image.darrays):
        intent = intent_codes.niistring[array.intent]
        data = array.data
        if intent in others or data is None:
            continue
        own_name = dict(array.meta or {}).get("Name") or (
            "" if alone else f"{name} {at}" if name else f"map {at}"
        )
        of_labels = intent == "NIFTI_INTENT_LABEL"
        own = "meshmash-viewer" in dict(image.meta or {})
        if data.ndim == 2:
            data = row_per_vertex(data).T
        columns = list(np.atleast_2d(data)) if data.ndim in (1, 2) else []
        for column in columns:
            labels = (table or _numbered(column)) if of_labels else ()
            if rows is not None and len(rows) != len(column):
                raise InputError("counts-differ", "has more or fewer vertex indices than values")
            yield RawMap(own_name, np.ascontiguousarray(column), labels, rows, keep_unused=own)


def _numbered(column: npt.NDArray[Any]) -> tuple[Label, ...]:
    """Return labels named after the numbers in a column; empty if there are too many."""
    whole = column.dtype.kind in "iu" or np.array_equal(column, np.rint(column))
    labels = numbered_labels(column) if whole else ()
    return labels if len(labels) <= MOST_LABELS else ()


def _hexadecimal(rgba: Any) -> str:
    """Return "#rrggbb" for red, green and blue from 0 to 1; None counts as 0.5."""
    shares = [0.5 if share is None else min(max(float(share), 0.0), 1.0) for share in rgba[:3]]
    return "#" + "".join(f"{round(255 * share):02x}" for share in shares)
