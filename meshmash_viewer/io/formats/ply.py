"""PLY, text or binary of either byte order, with polygons or triangle strips."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.comments import names_of_properties, stated_comment
from meshmash_viewer.io.polygons import MOST_MAPS, NotANumber, RawMap, RawMesh, parse_rows
from meshmash_viewer.io.provenance import stated_structure, stated_unit
from meshmash_viewer.io.text import (
    Columns,
    CutShort,
    Element,
    Property,
    rows_of_text,
    unmarked,
    with_newlines,
)
from meshmash_viewer.mesh import IntArray
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

    Raises
    ------
    InputError
        If the header is not one of PLY, or the file ends before what the header promises.
    """
    data = unmarked(path.read_bytes())
    byte_order, elements, start = _parse_header(data)
    if byte_order:
        body = np.frombuffer(data, dtype=np.uint8, offset=start)
        columns_of_each = _rows_of_bytes(elements, body, byte_order)
    else:
        try:
            numbers, counts = parse_rows(with_newlines(data[start:]), np.float64)
        except NotANumber as fault:
            header = with_newlines(data[:start])
            raise fault.in_line(header.count(b"\n") + fault.line + 1) from None
        columns_of_each = rows_of_text(elements, numbers, counts)
    said = stated_comment(_comments(data[:start]))
    names = names_of_properties(said)
    vertices = None
    maps: tuple[RawMap, ...] = ()
    polygons: list[tuple[IntArray, IntArray]] = []
    strips: list[IntArray] = []
    for element, columns in zip(elements, columns_of_each, strict=True):
        if element.name == "vertex":
            if vertices is not None:
                raise InputError("has two elements 'vertex'")
            try:
                axes = [columns[axis] for axis in "xyz"]
            except KeyError:
                raise InputError("has vertices without x, y and z") from None
            if any(isinstance(axis, tuple) for axis in axes):
                raise InputError("has vertices without x, y and z")
            vertices = np.column_stack(axes).astype(np.float64)
            maps = tuple(
                RawMap(names.get(name, name), values)
                for name, values in columns.items()
                if not _NO_MAPS.fullmatch(name) and not isinstance(values, tuple)
            )[:MOST_MAPS]
        elif element.name in ("face", "tristrips") and element.count:
            corners = next((columns[name] for name in _CORNER_NAMES if name in columns), None)
            if not isinstance(corners, tuple):
                raise InputError("has faces without a list of vertex indices")
            indices = _whole(corners[0])
            if element.name == "face":
                polygons.append((indices, corners[1]))
            else:
                strips.append(strip_triangles(*_without_breaks(indices, corners[1])))
    if vertices is None:
        raise InputError("has no vertices")
    faces = [triangulate(vertices, *each) for each in polygons] + strips
    triangles = np.concatenate(faces) if faces else np.empty((0, 3), dtype=np.int64)
    structure = stated_structure(said)
    return RawMesh(vertices, triangles, stated_unit(said), maps, structure=structure)


def _whole(indices: npt.NDArray[Any]) -> IntArray:
    whole = indices.astype(np.int64)
    if indices.dtype.kind == "f" and not np.array_equal(whole, indices):
        raise InputError("has a face with a vertex index that is no whole number")
    return whole


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


def _parse_header(data: bytes) -> tuple[str, list[Element], int]:
    header, start = _split_header(data)
    byte_order = None
    elements: list[Element] = []
    for line in header.decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["format", kind, *_]:
                    byte_order = _BYTE_ORDERS[kind]
                case ["element", name, count]:
                    elements.append(Element(name, int(count)))
                    if elements[-1].count < 0:
                        raise ValueError
                case ["property", "list", count_type, value_type, name]:
                    elements[-1].properties.append(
                        Property(name, _TYPES[value_type], _TYPES[count_type])
                    )
                case ["property", value_type, name]:
                    elements[-1].properties.append(Property(name, _TYPES[value_type]))
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            raise InputError(
                f"has a header line that PLY does not know, {printable(line, 60)!r}"
            ) from None
    if byte_order is None:
        raise InputError("has a header without a format line")
    return byte_order, elements, start


def _rows_of_bytes(
    elements: list[Element], body: npt.NDArray[np.uint8], byte_order: str
) -> list[Columns]:
    """Take the elements of a binary body one after the other."""
    columns = []
    for element in elements:
        taken, used = _take(element, body, byte_order)
        columns.append(taken)
        body = body[used:]
    more = len(body.tobytes().rstrip(b"\0\t\n\r\x1a "))
    if more:
        raise InputError(f"holds {more:,} bytes more than its header describes")
    return columns


def _take(element: Element, body: npt.NDArray[Any], byte_order: str) -> tuple[Columns, int]:
    """Take one element's columns from the front of bytes, and how many bytes they fill."""
    properties = element.properties
    values: list[list[npt.NDArray[Any]]] = [[] for _ in properties]
    end = 0
    if element.count and properties:
        first, _ = _read_row(element, body, 0, byte_order, 0)
        layout: list[tuple[Any, ...]] = []
        for index, prop in enumerate(properties):
            if prop.count_type is not None:
                layout.append((f"count{index}", byte_order + prop.count_type))
            layout.append((f"value{index}", byte_order + prop.value_type, (len(first[index]),)))
        record = np.dtype(layout)
        available = min(len(body) // record.itemsize, element.count)
        rows = np.frombuffer(body.data, dtype=record, count=available)
        if all(
            prop.count_type is None or np.all(rows[f"count{index}"] == len(first[index]))
            for index, prop in enumerate(properties)
        ):
            if available < element.count:
                raise CutShort(element, available)
            return {
                prop.name: rows[f"value{index}"].reshape(-1)
                if prop.count_type is None
                else (
                    rows[f"value{index}"].reshape(-1),
                    np.full(element.count, len(first[index]), dtype=np.int64),
                )
                for index, prop in enumerate(properties)
            }, element.count * record.itemsize
        for done in range(element.count):
            row, end = _read_row(element, body, end, byte_order, done)
            for all_of_one, taken in zip(values, row, strict=True):
                all_of_one.append(taken)
    columns: Columns = {}
    for prop, parts in zip(properties, values, strict=True):
        joined = np.concatenate([np.empty(0, dtype=prop.value_type), *parts])
        lengths = np.fromiter((len(part) for part in parts), np.int64, len(parts))
        columns[prop.name] = joined if prop.count_type is None else (joined, lengths)
    return columns, end


def _read_row(
    element: Element, body: npt.NDArray[Any], place: int, byte_order: str, done: int
) -> tuple[list[npt.NDArray[Any]], int]:
    """Values of each property of the row that begins at a place after `done` others; its end."""

    def take(type_name: str, count: int = 1) -> npt.NDArray[Any]:
        nonlocal place
        scalar = np.dtype(byte_order + type_name)
        size = count * scalar.itemsize
        taken = body[place : place + size]
        if len(taken) < size:
            raise CutShort(element, done)
        place += size
        return taken.view(scalar)

    values = []
    for prop in element.properties:
        count = 1.0 if prop.count_type is None else float(take(prop.count_type)[0])
        if not (0 <= count < 2**40 and count == int(count)):
            raise InputError(f"has a list of {count:g} entries")
        values.append(take(prop.value_type, int(count)))
    return values, place
