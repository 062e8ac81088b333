"""OFF, the Object File Format of Geomview, with or without colours and normals."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import RawMesh
from meshmash_viewer.io.text import (
    CutShort,
    Element,
    NotANumber,
    Property,
    parse_rows,
    read_text,
    rows_of_text,
)
from meshmash_viewer.triangulation import triangulate

#: The word, with what may be written before it, and how numbers begin after it.
_HEADER = re.compile(rb"\s*((?:ST|C|N|4)*OFF)(?=[\s\d]|$)\s*(BINARY\b)?", re.IGNORECASE)
_AXES = tuple("xyz")


def read_off(path: Path) -> RawMesh:
    """Read the vertices and polygons of a text OFF file.

    `InputError` is raised if the header is missing or that of another kind, or the file has less or
    more than its counts promise.
    """
    data = read_text(path)
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b"", data)
    header = _HEADER.match(data)
    if header is None:
        raise InputError('does not begin with "OFF"')
    if header[2]:
        raise InputError("is a binary OFF file, of which only the text kind can be read")
    if b"4" in header[1] or header[1].endswith(b"nOFF"):
        raise InputError(
            f"is an OFF file of another dimension ({header[1].decode()}), of which only three can"
            " be read"
        )
    try:
        numbers, counts = parse_rows(data[header.end() :], np.float64)
    except NotANumber as fault:
        raise fault.in_line(data.count(b"\n", 0, header.end()) + fault.line + 1) from None
    counts = counts[counts > 0]
    if len(numbers) < 2:
        raise InputError("does not state how many vertices and faces it holds")
    # The third number, that of edges, says nothing, and some leave it out.
    stated = 2 if counts[0] == 2 else 3
    promised = numbers[:2]
    rest = np.diff(np.maximum(np.cumsum(counts) - stated, 0), prepend=0)
    rest = rest[rest > 0]
    lacking = InputError(
        f"promises {promised[0]:.15g} vertices and {promised[1]:.15g} faces but has"
        f" {len(rest)} lines after that"
    )
    if not np.all((promised >= 0) & (promised == np.floor(promised)) & (promised < 2.0**53)):
        raise lacking
    n_vertices, n_faces = promised.astype(np.int64).tolist()
    elements = [
        Element("vertex", n_vertices, [Property(axis) for axis in _AXES]),
        Element("face", n_faces, [Property("corners", count_type=np.dtype("f8"))]),
    ]
    try:
        points, faces = rows_of_text(elements, numbers[stated:], rest, ragged=True)
    except CutShort:
        raise lacking from None
    vertices = np.column_stack([np.asarray(points[axis]) for axis in _AXES])
    corners, many = faces["corners"]
    if not np.array_equal(corners, np.floor(corners)):
        raise InputError("has a face with a vertex index that is no whole number")
    indices = np.clip(corners, -1.0, 2.0**53).astype(np.int64)
    return RawMesh(vertices, triangulate(vertices, indices, many))
