"""PLY, text or binary of either byte order, with polygons or triangle strips."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.faults import printable
from meshmash_viewer.io.polygons import (
    NotANumber,
    RawMesh,
    fan_triangles,
    parse_rows,
    strip_triangles,
)
from meshmash_viewer.io.provenance import stated_unit
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
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
    "int64": "i8",
    "uint64": "u8",
}
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNER_NAMES = ("vertex_indices", "vertex_index")

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
    vertices = None
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
    return RawMesh(vertices, corners_of_all, _unit_in_comments(data[:start]))


def _without_breaks(indices: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Cut strips where an index is -1, which is no corner."""
    is_break = indices == -1
    strip = np.repeat(np.arange(len(counts)), counts) + np.cumsum(is_break)
    return indices[~is_break], np.bincount(strip[~is_break])


def _unit_in_comments(header: bytes) -> str | None:
    for line in header.splitlines():
        if line.startswith(b"comment meshmash-viewer "):
            return stated_unit(line.split(b" ", 2)[2].decode("latin-1"))
    return None


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
    if not element.count or not element.properties:
        return {p.name: _no_values(p) for p in element.properties}, 0
    counts = _list_counts(element, body, byte_order)
    if counts is None:
        return _read_uneven(element, body, byte_order)
    record = _record_type(element, counts, byte_order)
    size = record.itemsize if byte_order else record.itemsize // 8
    available = len(body) // size
    if available < element.count:
        raise _cut_short(element, available)
    rows = np.frombuffer(body.data, dtype=record, count=element.count)
    columns: dict[str, npt.NDArray[Any] | Lists] = {}
    for index, prop in enumerate(element.properties):
        values = rows[f"value{index}"]
        if prop.count_type is None:
            columns[prop.name] = values
            continue
        if np.any(rows[f"count{index}"] != counts[index]):
            return _read_uneven(element, body, byte_order)
        columns[prop.name] = (
            values.reshape(-1),
            np.full(element.count, counts[index], dtype=np.int64),
        )
    return columns, element.count * size


def _no_values(prop: _Property) -> npt.NDArray[Any] | Lists:
    empty = np.empty(0, dtype=prop.value_type)
    return empty if prop.count_type is None else (empty, np.empty(0, dtype=np.int64))


def _scalar_type(name: str, byte_order: str) -> np.dtype[Any]:
    return np.dtype(byte_order + name) if byte_order else np.dtype(np.float64)


def _record_type(element: _Element, counts: dict[int, int], byte_order: str) -> np.dtype[Any]:
    fields: list[tuple[Any, ...]] = []
    for index, prop in enumerate(element.properties):
        value = _scalar_type(prop.value_type, byte_order)
        if prop.count_type is None:
            fields.append((f"value{index}", value))
        else:
            fields.append((f"count{index}", _scalar_type(prop.count_type, byte_order)))
            fields.append((f"value{index}", value, (counts[index],)))
    return np.dtype(fields)


def _list_counts(
    element: _Element, body: npt.NDArray[Any], byte_order: str
) -> dict[int, int] | None:
    """Lengths of the first row's lists, None if the body ends within that row."""
    counts: dict[int, int] = {}
    row = _Row(body, byte_order)
    try:
        for index, prop in enumerate(element.properties):
            if prop.count_type is not None:
                counts[index] = row.take_count(prop.count_type)
            row.take(prop.value_type, counts.get(index, 1))
    except EOFError:
        return None
    return counts


class _Row:
    """A place in the body that moves on as values are taken."""

    def __init__(self, body: npt.NDArray[Any], byte_order: str) -> None:
        self.body, self.byte_order, self.position = body, byte_order, 0

    def take(self, type_name: str, count: int = 1) -> npt.NDArray[Any]:
        scalar = _scalar_type(type_name, self.byte_order)
        size = count * (scalar.itemsize if self.byte_order else 1)
        taken = self.body[self.position : self.position + size]
        if len(taken) < size:
            raise EOFError
        self.position += size
        return taken.view(scalar)

    def take_count(self, type_name: str) -> int:
        count = float(self.take(type_name)[0])
        if not (0 <= count < 2**40 and count == int(count)):
            raise InputError(f"has a list of {count:g} entries")
        return int(count)


def _read_uneven(
    element: _Element, body: npt.NDArray[Any], byte_order: str
) -> tuple[dict[str, npt.NDArray[Any] | Lists], int]:
    """Row by row, for lists of differing lengths."""
    values: list[list[npt.NDArray[Any]]] = [[] for _ in element.properties]
    row = _Row(body, byte_order)
    for done in range(element.count):
        try:
            for index, prop in enumerate(element.properties):
                count = 1 if prop.count_type is None else row.take_count(prop.count_type)
                values[index].append(row.take(prop.value_type, count))
        except EOFError:
            raise _cut_short(element, done) from None
    columns: dict[str, npt.NDArray[Any] | Lists] = {}
    for index, prop in enumerate(element.properties):
        joined = np.concatenate(values[index])
        lengths = np.fromiter((len(part) for part in values[index]), np.int64, element.count)
        columns[prop.name] = joined if prop.count_type is None else (joined, lengths)
    return columns, row.position


def _cut_short(element: _Element, available: int) -> InputError:
    return InputError(
        f"promises {printable(element.count, 24)} of its element"
        f" {printable(element.name, 40)!r} but ends after {available}, so it was cut short"
    )
