"""STL, binary or text: triangles without shared vertices, merged on reading."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.polygons import RawMesh, parse_rows
from meshmash_viewer.mesh import FloatArray

__all__ = ["read_stl"]

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES = 84


def read_stl(path: Path) -> RawMesh:
    """Read an STL file and merge the corners with exactly equal coordinates.

    Triangles that collapse to a line or a point by merging are dropped.

    Raises
    ------
    InputError
        If the file is neither kind of STL, was cut short, or has no triangle left.
    """
    data = path.read_bytes()
    count = int(np.frombuffer(data, "<u4", 1, 80)[0]) if len(data) >= _HEADER_BYTES else 0
    expected = _HEADER_BYTES + count * _RECORD.itemsize
    # Some binary files begin with "solid" too: only their size tells the two kinds apart.
    if data.lstrip()[:5].lower() == b"solid" and len(data) != expected:
        corners = _text_corners(data)
    elif len(data) < _HEADER_BYTES:
        raise InputError("is too short for an STL file")
    elif len(data) < expected:
        raise InputError(
            f"promises {count} triangles but ends after"
            f" {(len(data) - _HEADER_BYTES) // _RECORD.itemsize}, so it was cut short or is no STL"
        )
    else:
        records = np.frombuffer(data, _RECORD, count, _HEADER_BYTES)
        corners = records["corners"].reshape(-1, 3).astype(np.float64)
    faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    vertices, merged, _ = join_vertices(corners, faces)
    if len(faces) and not len(merged):
        raise InputError("has no triangle left after equal vertices were merged")
    return RawMesh(vertices, merged)


def _text_corners(data: bytes) -> FloatArray:
    body = data.lower()
    lines = re.findall(rb"\bvertex\b([^\r\n]*)", body)
    numbers, counts = parse_rows(b"\n".join(lines), np.float64)
    opened, closed = len(re.findall(rb"\bfacet\s+normal\b", body)), body.count(b"endfacet")
    if opened != closed or len(lines) != 3 * opened or b"endsolid" not in body:
        raise InputError(
            f"begins {opened} triangles, ends {closed} and may lack its last line (endsolid), so"
            " it was cut short"
        )
    if len(counts) != len(lines) or np.any(counts != 3):
        raise InputError("has a vertex without exactly three coordinates")
    return numbers.reshape(-1, 3)
