"""PLY, text or binary of either byte order, with polygons or triangle strips."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.comments import names_of_properties, stated_comment
from meshmash_viewer.io.polygons import (
    MOST_MAPS,
    NotANumber,
    RawMap,
    RawMesh,
    fan_triangles,
    parse_rows,
    strip_triangles,
)
from meshmash_viewer.io.provenance import stated_structure, stated_unit
from meshmash_viewer.mesh import IntArray

__all__ = ["read_ply"]

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

#: A list property: its values one after the other, and how many each row has.
Lists: TypeAlias = tuple[npt.NDArray[Any], IntArray]


@dataclass(frozen=True)
class _Property:
    name: str
    value_type: str
    count_type: str | None = None


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


def read_ply(path: Path) -> RawMesh:
    """Read elements ``vertex`` (x, y, z) and ``face`` or ``tristrips`` of a PLY file.

    The unit is taken from the comment in which our own exports state it.

    Raises
    ------
    InputError
        If the header is not one of PLY, or the file ends before what the header promises.
    """
    data = path.read_bytes()
    byte_order, elements, start = _parse_header(data)
    body: npt.NDArray[Any]
    if byte_order:
        body = np.frombuffer(data, dtype=np.uint8, offset=start)
    else:
        try:
            body, _ = parse_rows(data[start:], np.float64)
        except NotANumber as fault:
            raise fault.in_line(data.count(b"\n", 0, start) + fault.line + 1) from None
    said = stated_comment(_comments(data[:start]))
    names = names_of_properties(said)
    vertices = None
    maps: tuple[RawMap, ...] = ()
    faces: list[IntArray] = []
    for element in elements:
        columns, used = _read_element(element, body, byte_order)
        body = body[used:]
        if element.name == "vertex":
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
            indices, counts = corners[0].astype(np.int64), corners[1]
            if element.name == "face":
                faces.append(fan_triangles(indices, counts))
            else:
                faces.append(strip_triangles(*_without_breaks(indices, counts)))
    if vertices is None:
        raise InputError("has no vertices")
    corners_of_all = np.concatenate(faces) if faces else np.empty((0, 3), dtype=np.int64)
    structure = stated_structure(said)
    return RawMesh(vertices, corners_of_all, stated_unit(said), maps, structure=structure)


def _without_breaks(indices: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Cut strips where an index is -1, which is no corner."""
    is_break = indices == -1
    strip = np.repeat(np.arange(len(counts)), counts) + np.cumsum(is_break)
    return indices[~is_break], np.bincount(strip[~is_break])


def _comments(header: bytes) -> Iterator[str]:
    for line in header.decode("latin-1").splitlines():
        if line.startswith("comment "):
            yield line.removeprefix("comment ")


def _parse_header(data: bytes) -> tuple[str, list[_Element], int]:
    if data[:3] != b"ply" or data[3:4] not in (b"\n", b"\r"):
        raise InputError('does not begin with "ply"')
    end = data.find(b"end_header")
    newline = data.find(b"\n", end)
    if end < 0 or newline < 0:
        raise InputError("has a header without an end")
    byte_order = None
    elements: list[_Element] = []
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["format", kind, *_]:
                    byte_order = _BYTE_ORDERS[kind]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count)))
                    if elements[-1].count < 0:
                        raise ValueError
                case ["property", "list", count_type, value_type, name]:
                    elements[-1].properties.append(
                        _Property(name, _TYPES[value_type], _TYPES[count_type])
                    )
                case ["property", value_type, name]:
                    elements[-1].properties.append(_Property(name, _TYPES[value_type]))
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            raise InputError(
                f"has a header line that PLY does not know, {printable(line, 60)!r}"
            ) from None
    if byte_order is None:
        raise InputError("has a header without a format line")
    return byte_order, elements, newline + 1


def _read_element(
    element: _Element, body: npt.NDArray[Any], byte_order: str
) -> tuple[dict[str, npt.NDArray[Any] | Lists], int]:
    """Take one element's columns from the front of `body`, and how much of it they fill.

    A text body is an array of numbers, a binary one an array of bytes; a record of the same
    layout describes both.
    """
    properties = element.properties
    values: list[list[npt.NDArray[Any]]] = [[] for _ in properties]
    end = 0
    if element.count and properties:
        first, _ = _read_row(element, body, 0, byte_order, 0)
        layout: list[tuple[Any, ...]] = []
        for index, prop in enumerate(properties):
            if prop.count_type is not None:
                layout.append((f"count{index}", _scalar_type(prop.count_type, byte_order)))
            scalar = _scalar_type(prop.value_type, byte_order)
            layout.append((f"value{index}", scalar, (len(first[index]),)))
        record = np.dtype(layout)
        size = record.itemsize if byte_order else record.itemsize // 8
        available = min(len(body) // size, element.count)
        rows = np.frombuffer(body.data, dtype=record, count=available)
        if all(
            prop.count_type is None or np.all(rows[f"count{index}"] == len(first[index]))
            for index, prop in enumerate(properties)
        ):
            if available < element.count:
                raise _cut_short(element, available)
            return {
                prop.name: rows[f"value{index}"].reshape(-1)
                if prop.count_type is None
                else (
                    rows[f"value{index}"].reshape(-1),
                    np.full(element.count, len(first[index]), dtype=np.int64),
                )
                for index, prop in enumerate(properties)
            }, element.count * size
        for done in range(element.count):
            row, end = _read_row(element, body, end, byte_order, done)
            for all_of_one, taken in zip(values, row, strict=True):
                all_of_one.append(taken)
    columns: dict[str, npt.NDArray[Any] | Lists] = {}
    for prop, parts in zip(properties, values, strict=True):
        joined = np.concatenate([np.empty(0, dtype=prop.value_type), *parts])
        lengths = np.fromiter((len(part) for part in parts), np.int64, len(parts))
        columns[prop.name] = joined if prop.count_type is None else (joined, lengths)
    return columns, end


def _scalar_type(name: str, byte_order: str) -> np.dtype[Any]:
    return np.dtype(byte_order + name) if byte_order else np.dtype(np.float64)


def _read_row(
    element: _Element, body: npt.NDArray[Any], place: int, byte_order: str, done: int
) -> tuple[list[npt.NDArray[Any]], int]:
    """Values of each property of the row that begins at a place after `done` others; its end."""

    def take(type_name: str, count: int = 1) -> npt.NDArray[Any]:
        nonlocal place
        scalar = _scalar_type(type_name, byte_order)
        size = count * (scalar.itemsize if byte_order else 1)
        taken = body[place : place + size]
        if len(taken) < size:
            raise _cut_short(element, done)
        place += size
        return taken.view(scalar)

    values = []
    for prop in element.properties:
        count = 1.0 if prop.count_type is None else float(take(prop.count_type)[0])
        if not (0 <= count < 2**40 and count == int(count)):
            raise InputError(f"has a list of {count:g} entries")
        values.append(take(prop.value_type, int(count)))
    return values, place


def _cut_short(element: _Element, available: int) -> InputError:
    return InputError(
        f"promises {printable(element.count, 24)} of its element"
        f" {printable(element.name, 40)!r} but ends after {available}, so it was cut short"
    )
