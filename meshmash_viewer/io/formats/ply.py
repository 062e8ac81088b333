"""PLY, text or binary of either byte order, with polygons or triangle strips."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.provenance import (
    names_of_properties,
    stated_comment,
    stated_labels,
    stated_mesh,
)
from meshmash_viewer.io.raw import MOST_MAPS, RawMap, RawMesh
from meshmash_viewer.io.text import (
    Columns,
    Element,
    NotANumber,
    Property,
    parse_rows,
    rows_of_text,
    take_rows,
    unmarked,
    with_newlines,
)
from meshmash_viewer.triangulation import strip_triangles, triangulate

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_TYPES |= {np.dtype(code).name: code for code in (*_TYPES.values(), "i8", "u8")}
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNER_NAMES = ("vertex_indices", "vertex_index")
#: Properties of a vertex that are no map: coordinates, normal, colour, place in a texture.
_NO_MAPS = re.compile(r"[xyz]|n[xyz]|(diffuse_)?(red|green|blue|alpha)|[stuv]|texture_[uv]")


def read_ply(path: Path) -> RawMesh:
    """Read elements ``vertex`` (x, y, z) and ``face`` or ``tristrips`` of a PLY file.

    The unit is taken from the comment in which our own exports state it.

    `InputError` is raised if the header is not one of PLY, or the file ends before what the header
    promises.
    """
    data = unmarked(path.read_bytes())
    is_text, elements, start = _parse_header(data)
    columns_of_each = (_text_body if is_text else _binary_body)(elements, data, start)
    said = stated_comment(_comments(data[:start]))
    columns_of: dict[str, list[Columns]] = {}
    for element, columns in zip(elements, columns_of_each, strict=True):
        if element.name == "vertex" or element.count:
            columns_of.setdefault(element.name, []).append(columns)
    of_vertices = columns_of.get("vertex", [])
    if len(of_vertices) != 1:
        raise InputError("has two elements 'vertex'" if of_vertices else "has no vertices")
    axes = [of_vertices[0].get(axis) for axis in "xyz"]
    if any(axis is None or isinstance(axis, tuple) for axis in axes):
        raise InputError("has vertices without x, y and z")
    vertices = np.column_stack(axes).astype(np.float64)  # type: ignore[arg-type]
    names = names_of_properties(said)
    labels = stated_labels(said)
    maps = [
        RawMap(names.get(name, name), values, labels * (name in names), keep_unused=True)
        for name, values in of_vertices[0].items()
        if not _NO_MAPS.fullmatch(name) and not isinstance(values, tuple)
    ]
    faces = [triangulate(vertices, *_corners(each)) for each in columns_of.get("face", [])]
    for each in columns_of.get("tristrips", []):
        faces.append(strip_triangles(*_without_breaks(*_corners(each))))
    triangles = np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])
    unit, structure = stated_mesh(said)
    found = tuple(maps[:MOST_MAPS])
    return RawMesh(vertices, triangles, unit, found, structure=structure, meta=said)


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
        raise InputError(f"holds {more:,} bytes more than its header describes")
    return columns


def _corners(columns: Columns) -> tuple[IntArray, IntArray]:
    """Return the corners of all faces, and how many each has."""
    corners = next((columns[name] for name in _CORNER_NAMES if name in columns), None)
    if not isinstance(corners, tuple):
        raise InputError("has faces without a list of vertex indices")
    whole = corners[0].astype(np.int64)
    if corners[0].dtype.kind == "f" and not np.array_equal(whole, corners[0]):
        raise InputError("has a face with a vertex index that is no whole number")
    return whole, corners[1]


def _without_breaks(indices: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Cut strips where an index is -1, which is no corner."""
    is_break = indices == -1
    strip = np.repeat(np.arange(len(counts)), counts) + np.cumsum(is_break)
    return indices[~is_break], np.bincount(strip[~is_break])


def _comments(header: bytes) -> Iterator[str]:
    for line in header.decode("latin-1").splitlines():
        if line.startswith("comment "):
            yield line.removeprefix("comment ")


def _split_header(data: bytes) -> tuple[bytes, int]:
    """Return the header without its last line, and the position of the first byte after it."""
    if not re.match(rb"ply[ \t]*[\r\n]", data, re.IGNORECASE):
        raise InputError('does not begin with "ply"')
    end = re.search(rb"[\r\n][ \t]*end_header[ \t]*(\r\n|\n|\r)", data)
    if end is None:
        raise InputError("has a header without an end")
    start = end.end()
    if end[1] == b"\r\n" and b"\n" not in data[: end.start() + 1]:
        start -= 1  # lines end in \r alone; the \n is a byte of the first number
    return data[: end.start()], start


def _parse_header(data: bytes) -> tuple[bool, list[Element], int]:
    """Return whether the body is text, its elements, and the position of its first byte."""
    header, start = _split_header(data)
    lines = [line.split() for line in header.decode("latin-1").splitlines()[1:]]
    order = next((_BYTE_ORDERS.get(line[1]) for line in lines if line[:1] == ["format"]), None)
    if order is None:
        raise InputError("has a header without the format line of a PLY file")
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
            raise InputError(f"has a header line that PLY does not know, {line!r}") from None
    return not order, elements, start


def _number_type(order: str, name: str) -> np.dtype[Any]:
    """Return the type of a property in a body of a byte order; text is read as 64-bit floats."""
    code = _TYPES[name]
    return np.dtype(order + code if order else "f8")
