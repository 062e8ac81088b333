"""Readers of OFF, OBJ, STL and PLY files, with vertices and polygons as text or binary.

Colours, normals and texture coordinates are not read. An OBJ corner ``v/vt/vn`` is vertex ``v``, so
that texture seams do not cut the surface. Equal vertices of STL triangles are merged. PLY files may
have polygons or triangle strips; they may be text, or binary in either byte order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, cut_short, printable, wrong_format
from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.provenance import (
    names_of_properties,
    stated_comment,
    stated_labels,
    stated_mesh,
)
from meshmash_viewer.io.raw import (
    REPAIR,
    RawMap,
    RawMesh,
    maps_of_columns,
    most_maps,
    vertex_indices,
)
from meshmash_viewer.io.text import (
    Columns,
    CutShort,
    Element,
    Lines,
    NotANumber,
    Property,
    parse_rows,
    read_text,
    rows_of_text,
    take_rows,
    unmarked,
    with_newlines,
)
from meshmash_viewer.triangulation import strip_triangles, triangulate
from meshmash_viewer.units import counted
from meshmash_viewer.vertex_map import Label

#: First word of an OFF file with its prefixes; a number may follow without a space.
_OFF_HEADER = re.compile(rb"\s*((?:ST|C|N|4)*OFF)(?=[\s\d]|$)\s*(BINARY\b)?", re.IGNORECASE)


def read_off(path: Path) -> RawMesh:
    """Read the vertices and polygons of a text OFF file.

    `InputError` is raised if the header is missing or unsupported, or its counts do not match the
    content.
    """
    data = read_text(path)
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b"", data)
    header = _OFF_HEADER.match(data)
    if header is None:
        raise wrong_format('does not begin with "OFF"')
    if header[2]:
        raise InputError("not-supported", "is a binary OFF file", "write it as text")
    if b"4" in header[1] or header[1].endswith(b"nOFF"):
        what = f"is an OFF file of another dimension ({header[1].decode()})"
        raise InputError("not-supported", what, "write x, y and z of each vertex")
    try:
        numbers, counts = parse_rows(data[header.end() :], np.float64)
    except NotANumber as fault:
        raise fault.in_line(data.count(b"\n", 0, header.end()) + fault.line + 1) from None
    counts = counts[counts > 0]
    if len(numbers) < 2:
        raise wrong_format("does not state how many vertices and faces it holds")
    # the third number, of edges, is ignored; some programs omit it
    stated = 2 if counts[0] == 2 else 3
    promised = numbers[:2]
    rest = np.diff(np.maximum(np.cumsum(counts) - stated, 0), prepend=0)
    rest = rest[rest > 0]
    lacking = InputError(
        "counts-differ",
        f"promises {promised[0]:.15g} vertices and {promised[1]:.15g} faces but has"
        f" {len(rest)} lines after that",
    )
    if not np.all((promised >= 0) & (promised == np.floor(promised)) & (promised < 2.0**53)):
        raise lacking
    n_vertices, n_faces = promised.astype(np.int64).tolist()
    elements = [
        Element("vertex", n_vertices, [Property(axis) for axis in "xyz"]),
        Element("face", n_faces, [Property("corners", count_type=np.dtype("f8"))]),
    ]
    try:
        points, polygons = rows_of_text(elements, numbers[stated:], rest, ragged=True)
    except CutShort:
        raise lacking from None
    vertices = np.column_stack([np.asarray(points[axis]) for axis in "xyz"])
    corners, many = polygons["corners"]
    return RawMesh(vertices, triangulate(vertices, vertex_indices(corners), many))


# -- OBJ ----------------------------------------------------------------------------------------

#: Remark on an OBJ file that ends within a line.
_CUT = "ends within a line, so it may be cut short: compare its size with that of the original"
#: Comments, and texture and normal indices of corners, which are removed.
_OBJ_NOT_READ = re.compile(rb"#[^\n\v]*|/\S*")


def read_obj(path: Path) -> RawMesh:
    """Read the vertices (``v``) and faces (``f``) of an OBJ file.

    Polygons become triangles. Negative indices count back from the last vertex before the face.
    Objects and groups become one mesh. Numbers after the third of a vertex (weight or colour) are
    ignored. `InputError` is raised if a vertex or face is malformed, or an index is out of range;
    the message names the line.
    """
    text = read_text(path)
    if b"\\" in text:  # a backslash continues a line
        text = re.sub(rb"\\[ \t]*\n", rb" \v", text)
    lines = Lines(_OBJ_NOT_READ.sub(b"", text))
    vertex_lines, face_lines = lines.beginning_with(b"v"), lines.beginning_with(b"f")
    if not len(vertex_lines):
        raise InputError("no-vertices", "holds no vertex line (v x y z)")
    vertices = _obj_vertices(lines, vertex_lines)
    before = np.searchsorted(vertex_lines, face_lines)
    corners, counts = _obj_faces(lines, face_lines, before, len(vertices))
    return RawMesh(
        vertices,
        triangulate(vertices, corners, counts),
        remarks=(_CUT,) * _ends_within_line(text, counts),
    )


def _ends_within_line(text: bytes, counts: IntArray) -> bool:
    """Whether the last line has no end, and is neither a vertex nor as long as the face before.

    `counts` are the numbers of corners of the faces.
    """
    words = text.rstrip(b" \t\0\x1a").rpartition(b"\n")[2].lower().split()
    if words[:1] == [b"f"]:
        return bool(counts[-1] < max(3, counts[-2:].max()))
    return words[:1] not in ([], [b"v"])


def _obj_vertices(lines: Lines, which: IntArray) -> FloatArray:
    numbers, counts = lines.rows(which, b"v", np.float64)
    if counts.min() < 3:
        fault = lines.fault(
            "has a vertex with fewer than three coordinates", which[counts.argmin()]
        )
        raise InputError("wrong-shape", fault)
    first = np.cumsum(counts) - counts
    vertices = np.column_stack([numbers[first], numbers[first + 1], numbers[first + 2]])
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        fault = f"has {counted(len(broken), 'vertex')} with a coordinate that is not finite"
        raise InputError("not-finite", lines.fault(fault, which[broken[0]]), REPAIR)
    return vertices


def _obj_faces(
    lines: Lines, which: IntArray, vertices_before: IntArray, n_vertices: int
) -> tuple[IntArray, IntArray]:
    """Return the corners of all faces, counted from 0, and the number of corners of each face."""
    given, counts = lines.rows(which, b"f", np.int64)
    if not counts.all():
        fault = lines.fault("has a face line without corners", which[counts.argmin()])
        raise InputError("wrong-shape", fault)
    line, before = np.repeat(which, counts), np.repeat(vertices_before, counts)
    if np.any(given == 0):
        fault = "has a face with vertex index 0, though OBJ counts from 1"
        raise InputError("vertex-out-of-range", lines.fault(fault, line[given == 0][0]))
    if np.any(given < -before):
        fault = "has a face that counts back to before the first vertex"
        raise InputError("vertex-out-of-range", lines.fault(fault, line[given < -before][0]))
    corners = np.where(given < 0, before + given, given - 1)
    outside = np.flatnonzero(corners >= n_vertices)
    if len(outside):
        fault = (
            f"has {counted(len(np.unique(line[outside])), 'face')} with a vertex index out of"
            f" range, the first being vertex {given[outside[0]]} of {n_vertices}"
        )
        raise InputError("vertex-out-of-range", lines.fault(fault, line[outside[0]]), REPAIR)
    return corners, counts


# -- STL ----------------------------------------------------------------------------------------

_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER_BYTES = 80
#: Numbers of triangles in headers that mean "unknown", from programs that write sequentially.
_UNKNOWN_COUNTS = (0, 0xFFFFFFFF)
#: Longest header, in bytes, that is tried if the file size does not fit a header of 80 bytes.
_LONGEST_STL_HEADER = 256
#: Spaces before a keyword within a line, for files with several statements per line.
_WITHIN_LINE = re.compile(
    rb"(?<=\S)[ \t]+"
    rb"(?=(?:facet\s+normal|outer\s+loop|vertex\s+[-+.\d]|end\s*(?:loop|facet|solid))\b)",
    re.IGNORECASE,
)


def read_stl(path: Path) -> RawMesh:
    """Read a text or binary STL file, and join corners with equal coordinates.

    Triangles that collapse to a line or a point by joining are dropped.
    `InputError` is raised if the file is no STL, was cut short, or has no triangle left.
    """
    data = path.read_bytes()
    text = None if _is_whole_stl(data, _STL_HEADER_BYTES) else _as_text(data)
    if text is None:
        corners = _binary_corners(data)
        faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    else:
        corners, counts = _text_corners(text)
        faces = triangulate(corners, np.arange(len(corners)), counts)
    vertices, joined, _ = join_vertices(corners, faces)
    if len(faces) and not len(joined):
        raise InputError("no-faces", "has no triangle left after equal vertices were merged")
    return RawMesh(vertices, joined)


def _is_whole_stl(data: bytes, header: int) -> bool:
    """Whether the size of a binary file fits its number of triangles and `header` bytes before."""
    return header + 4 + _stated_count(data, header) * _STL_RECORD.itemsize == len(data)


def _stated_count(data: bytes, header: int) -> int:
    return int.from_bytes(data[header : header + 4], "little")


def _as_text(data: bytes) -> bytes | None:
    """Return the text of a text file, None for a binary file, which may also begin with "solid"."""
    text = unmarked(data)
    begins = text[:100_000]
    is_text = b"\0" not in begins[:1_000] and re.search(
        rb"\A\s*solid\b|\bfacet\s+normal\b", begins, re.IGNORECASE
    )
    return with_newlines(text) if is_text else None


def _binary_corners(data: bytes) -> FloatArray:
    header = _STL_HEADER_BYTES
    if not _is_whole_stl(data, header):
        lengths = (each for each in range(_LONGEST_STL_HEADER) if _is_whole_stl(data, each))
        header = next((each for each in lengths if _stated_count(data, each)), header)
    count, room = _stated_count(data, header), len(data) - header - 4
    if room < 0:
        raise InputError("file-cut-short", "is too short for an STL file")
    there, more = divmod(room, _STL_RECORD.itemsize)
    if count in _UNKNOWN_COUNTS and room:
        if more:
            raise InputError(
                "file-cut-short",
                f"does not state how many triangles it holds, and ends {more} bytes after the"
                f" {there:,} there are, so it was cut short or is no STL",
                "copy or export it again",
            )
        count = there
    if count > there:
        raise InputError(
            "file-cut-short",
            f"promises {count} triangles but ends after {there}, so it was cut short or is no STL",
            "copy or export it again",
        )
    every = np.frombuffer(data, _STL_RECORD, there, header + 4)["corners"].astype(np.float64)
    corners, others = every[:count], every[count:]
    if count and len(others) and _are_near(others, corners):
        fault = f"promises {count:,} triangles but holds {there:,}, so one of the two is wrong"
        raise InputError("counts-differ", fault)
    return corners.reshape(-1, 3)


def _are_near(others: FloatArray, corners: FloatArray) -> bool:
    """Whether data after the last triangle are more triangles: near `corners`, not degenerate."""
    lowest, highest = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    margin = (highest - lowest).max()
    is_near = (others >= lowest - margin) & (others <= highest + margin)
    return bool(is_near.all() and (others != others[:, :1]).any(axis=(1, 2)).all())


def _text_corners(text: bytes) -> tuple[FloatArray, IntArray]:
    """Return the corners of all facets, and the number of corners of each facet."""
    try:
        return _corners_by_lines(text)
    except InputError:
        split = _WITHIN_LINE.sub(b"\n", text)
        if split == text:
            raise
        return _corners_by_lines(split)


def _corners_by_lines(text: bytes) -> tuple[FloatArray, IntArray]:
    # only lines within facets count, as names and other lines may begin with any word
    lines = Lines(text)
    lines.drop_until(int(lines.beginning_with(b"solid")[:1].max(initial=0)))
    begun, ended = lines.beginning_with(b"facet"), lines.beginning_with(b"end", b"facet")
    vertices = lines.beginning_with(b"vertex")
    which = np.searchsorted(begun, vertices) - 1
    if len(begun) == len(ended):
        inside = which >= 0
        inside[inside] = vertices[inside] < ended[which[inside]]
        vertices, which = vertices[inside], which[inside]
    counts = np.bincount(which[which >= 0], minlength=len(begun))
    follow = len(begun) == len(ended) and np.all(begun < ended) and np.all(ended[:-1] < begun[1:])
    if not follow or counts.min(initial=3) < 3:
        raise cut_short(
            f"begins {len(begun)} triangles and ends {len(ended)}, not each with its three corners"
        )
    last = np.append(ended, lines.beginning_with(b"end", b"solid")).max(initial=-1)
    if lines.last() > last:
        raise cut_short(
            f"ends in line {lines.number(lines.last())} after its last triangle and before its last"
            " line (endsolid)"
        )
    numbers, each = lines.rows(vertices, b"vertex", np.float64)
    if np.any(each != 3):
        raise InputError("wrong-shape", "has a vertex without exactly three coordinates")
    return numbers.reshape(-1, 3), counts


# -- PLY ----------------------------------------------------------------------------------------

_PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_PLY_TYPES |= {np.dtype(code).name: code for code in (*_PLY_TYPES.values(), "i8", "u8")}
_PLY_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNER_NAMES = ("vertex_indices", "vertex_index")
#: Properties that are left out without a remark: coordinates, normals, colours, texture.
_NO_MAPS = re.compile(
    r"[xyz]|n[xyz]|(diffuse_)?(red|green|blue|alpha)|[stuv]|texture_[uv]|texcoord|texnumber"
)


def read_ply(path: Path) -> RawMesh:
    """Read elements ``vertex`` (x, y, z) and ``face`` or ``tristrips`` of a PLY file.

    In exports of this program, the unit is read from the provenance in comments. `InputError` is
    raised if the header is no PLY header, or the file is shorter than its header states.
    """
    data = unmarked(path.read_bytes())
    is_text, elements, start = _ply_parse_header(data)
    columns_of_each = (_text_body if is_text else _binary_body)(elements, data, start)
    header = data[:start].decode("latin-1").splitlines()
    meta = stated_comment(line.removeprefix("comment ") for line in header)
    columns_of: dict[str, list[Columns]] = {}
    for element, columns in zip(elements, columns_of_each, strict=True):
        if element.name == "vertex" or element.count:
            columns_of.setdefault(element.name, []).append(columns)
    of_vertices = columns_of.get("vertex", [])
    if len(of_vertices) != 1:
        fault = "has two elements 'vertex'" if of_vertices else "has no vertices"
        raise InputError("no-vertices", fault)
    of_vertex = of_vertices[0]
    if "x" not in of_vertex:  # some programs write X, Y and Z
        of_vertex = {name.lower() if name in "XYZ" else name: of_vertex[name] for name in of_vertex}
    axes = [of_vertex.get(axis) for axis in "xyz"]
    if any(axis is None or isinstance(axis, tuple) for axis in axes):
        raise InputError("no-vertices", "has vertices without x, y and z")
    vertices = np.column_stack(axes).astype(np.float64)  # type: ignore[arg-type]
    maps, remarks = _ply_maps(of_vertex, names_of_properties(meta), stated_labels(meta))
    of_faces = [name for columns in columns_of.get("face", []) for name in columns]
    others = [
        repr(printable(name, 60))
        for name in of_faces
        if name not in _CORNER_NAMES and not _NO_MAPS.fullmatch(name)
    ]
    if others:
        remarks += (f"has values of its faces {', '.join(others)}, which are left out",)
    faces = [triangulate(vertices, *_ply_corners(each)) for each in columns_of.get("face", [])]
    for each in columns_of.get("tristrips", []):
        faces.append(strip_triangles(*_without_breaks(*_ply_corners(each))))
    triangles = np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])
    unit, structure = stated_mesh(meta)
    return RawMesh(vertices, triangles, unit, maps, remarks, structure, meta)


def _ply_maps(
    of_vertex: Columns, names: dict[str, str], labels: tuple[Label, ...]
) -> tuple[tuple[RawMap, ...], tuple[str, ...]]:
    """Return a map per number in each property, and a clause on properties that are left out.

    `names` has the names of maps by property in exports of this program, and `labels` are theirs.
    """
    maps: list[RawMap] = []
    others: list[str] = []
    for name, values in of_vertex.items():
        if _NO_MAPS.fullmatch(name):
            continue
        if not isinstance(values, tuple):
            own = labels * (name in names)
            maps.append(RawMap(names.get(name, name), values, own, keep_unused=True))
        elif len(set(values[1].tolist())) == 1:
            rows = values[0].reshape(len(values[1]), -1)
            maps += maps_of_columns(rows, [f"{name} {at}" for at in range(rows.shape[1])])
        else:
            others.append(f"lists of different lengths {printable(name, 60)!r}")
    found, remarks = most_maps(maps)
    if others:
        remarks += (f"has {', '.join(others)}, which are left out",)
    return found, remarks


def _text_body(elements: list[Element], data: bytes, start: int) -> list[Columns]:
    try:
        numbers, counts = parse_rows(with_newlines(data[start:]), np.float64)
    except NotANumber as fault:
        header = with_newlines(data[:start])
        raise fault.in_line(header.count(b"\n") + fault.line + 1) from None
    return rows_of_text(elements, numbers, counts)


def _binary_body(elements: list[Element], data: bytes, start: int) -> list[Columns]:
    columns, end = take_rows(elements, np.frombuffer(data, dtype=np.uint8, offset=start))
    if more := len(data[start + end :].rstrip(b"\0\t\n\r\x1a ")):
        raise InputError("counts-differ", f"holds {more:,} bytes more than its header describes")
    return columns


def _ply_corners(columns: Columns) -> tuple[IntArray, IntArray]:
    """Return the corners of all faces, and the number of corners of each face."""
    corners = next((columns[name] for name in _CORNER_NAMES if name in columns), None)
    if not isinstance(corners, tuple):
        raise InputError("missing-data", "has faces without a list of vertex indices")
    return vertex_indices(corners[0]), corners[1]


def _without_breaks(indices: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Split strips at indices -1; return the other indices, and the length of each strip."""
    is_break = indices == -1
    strip = np.repeat(np.arange(len(counts)), counts) + np.cumsum(is_break)
    return indices[~is_break], np.bincount(strip[~is_break])


def _ply_split_header(data: bytes) -> tuple[bytes, int]:
    """Return the header without its last line, and the position of the first byte after it."""
    if not re.match(rb"ply[ \t]*[\r\n]", data, re.IGNORECASE):
        raise wrong_format('does not begin with "ply"')
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\n|\r)", data)
    if end is None:
        raise wrong_format("has a header without an end")
    start = end.end()
    if end[1] == b"\r\n" and b"\n" not in data[: end.start() + 1]:
        start -= 1  # lines end in \r alone; the \n is a byte of the first number
    return data[: end.start()], start


def _ply_parse_header(data: bytes) -> tuple[bool, list[Element], int]:
    """Return whether the body is text, its elements, and the position of its first byte."""
    header, start = _ply_split_header(data)
    lines = [line.split() for line in header.decode("latin-1").splitlines()[1:]]
    order = next((_PLY_ORDERS.get(line[1]) for line in lines if line[:1] == ["format"]), None)
    if order is None:
        raise wrong_format("has a header without the format line of a PLY file")
    elements: list[Element] = []
    for words in lines:
        try:
            match words:
                case [] | ["comment" | "obj_info" | "format", *_]:
                    pass
                case ["element", name, count] if int(count) >= 0:
                    elements.append(Element(name, int(count)))
                case ["property", "list", count_type, value_type, name]:
                    kinds = _number_type(order, value_type), _number_type(order, count_type)
                    elements[-1].properties.append(Property(name, *kinds))
                case ["property", value_type, name]:
                    elements[-1].properties.append(Property(name, _number_type(order, value_type)))
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            line = printable(" ".join(words), 60)
            raise wrong_format(f"has a header line that PLY does not know, {line!r}") from None
    return not order, elements, start


def _number_type(order: str, name: str) -> np.dtype[Any]:
    """Return the type of a property in a byte order "<" or ">"; float64 for "", text."""
    code = _PLY_TYPES[name]
    return np.dtype(order + code if order else "f8")
