"""OFF, the Object File Format of Geomview, with or without colours and normals."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import NotANumber, RawMesh, fan_triangles, parse_rows

__all__ = ["read_off"]

_HEADER = re.compile(rb"\s*(ST)?C?N?OFF\b\s*")


def read_off(path: Path) -> RawMesh:
    """Read the vertices and polygons of a text OFF file.

    Raises
    ------
    InputError
        If the header is missing, or the file ends before what its counts promise.
    """
    data = path.read_bytes()
    header = _HEADER.match(re.sub(rb"#[^\n]*", b"", data[:10_000]))
    if header is None:
        raise InputError('does not begin with "OFF"')
    if b"#" in data:
        data = re.sub(rb"#[^\n]*", b"", data)
    header = _HEADER.match(data)
    assert header is not None
    if data[header.end() :].startswith(b"BINARY"):
        raise InputError("is a binary OFF file, of which only the text kind can be read")
    body = data[header.end() :]
    if b"\n" not in body:
        body = body.replace(b"\r", b"\n")
    try:
        numbers, counts = parse_rows(body, np.float64)
    except NotANumber as fault:
        raise fault.in_line(data.count(b"\n", 0, header.end()) + fault.line + 1) from None
    if not len(counts) or counts[0] < 2:
        raise InputError("does not state how many vertices and faces it holds")
    promised = numbers[:2]
    if not (np.all(promised >= 0) and len(counts) > promised.sum()):
        raise InputError(
            f"promises {promised[0]:.15g} vertices and {promised[1]:.15g} faces but has"
            f" {len(counts) - 1} lines after that"
        )
    n_vertices, n_faces = promised.astype(np.int64).tolist()
    first = np.cumsum(counts) - counts
    vertex_rows = first[1 : 1 + n_vertices]
    if n_vertices and counts[1 : 1 + n_vertices].min() < 3:
        raise InputError("has a vertex with fewer than three coordinates")
    vertices = np.column_stack([numbers[vertex_rows + axis] for axis in range(3)])
    face_rows = first[1 + n_vertices : 1 + n_vertices + n_faces]
    stated, room = numbers[face_rows], counts[1 + n_vertices : 1 + n_vertices + n_faces]
    if not np.all((stated >= 0) & (stated < room)):
        raise InputError("has a face with fewer corners than it states")
    corner_counts = stated.astype(np.int64)
    within = np.arange(corner_counts.sum()) - np.repeat(
        np.cumsum(corner_counts) - corner_counts, corner_counts
    )
    corners = numbers[np.repeat(face_rows + 1, corner_counts) + within]
    if not np.all(np.abs(corners) < 2.0**53):
        raise InputError("has a face with a vertex index that is no whole number")
    return RawMesh(vertices, fan_triangles(corners.astype(np.int64), corner_counts))
