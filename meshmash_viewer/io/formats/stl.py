"""STL, binary or text: triangles without shared vertices, joined on reading."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.joining import join_vertices
from meshmash_viewer.io.raw import RawMesh
from meshmash_viewer.io.text import Lines, unmarked, with_newlines
from meshmash_viewer.triangulation import triangulate

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER_BYTES = 80
#: Numbers of triangles that mean that it was not known when the header was written.
_UNKNOWN = (0, 0xFFFFFFFF)
#: Where the number of triangles may be if the header has another length than it should.
_LONGEST_HEADER = 256
#: Words within a line that begin one in other files.
_WITHIN_LINE = re.compile(
    rb"(?<=\S)[ \t]+"
    rb"(?=(?:facet\s+normal|outer\s+loop|vertex\s+[-+.\d]|end\s*(?:loop|facet|solid))\b)",
    re.IGNORECASE,
)


def read_stl(path: Path) -> RawMesh:
    """Read an STL file and join the corners with equal coordinates.

    Triangles that collapse to a line or a point by joining are dropped.

    `InputError` is raised if the file is neither kind of STL, was cut short, or has no triangle
    left.
    """
    data = path.read_bytes()
    text = None if _is_whole(data, _HEADER_BYTES) else _as_text(data)
    if text is None:
        corners = _binary_corners(data)
        faces = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    else:
        corners, counts = _text_corners(text)
        faces = triangulate(corners, np.arange(len(corners)), counts)
    vertices, joined, _ = join_vertices(corners, faces)
    if len(faces) and not len(joined):
        raise InputError("has no triangle left after equal vertices were merged")
    return RawMesh(vertices, joined)


def _is_whole(data: bytes, header: int) -> bool:
    """Whether a binary file with a header of so many bytes ends with its last triangle."""
    return header + 4 + _stated(data, header) * _RECORD.itemsize == len(data)


def _stated(data: bytes, header: int) -> int:
    return int.from_bytes(data[header : header + 4], "little")


def _as_text(data: bytes) -> bytes | None:
    """The file if it is text: some binary ones begin with "solid" too."""
    text = unmarked(data)
    begins = text[:100_000]
    is_text = b"\0" not in begins[:1_000] and re.search(
        rb"\A\s*solid\b|\bfacet\s+normal\b", begins, re.IGNORECASE
    )
    return with_newlines(text) if is_text else None


def _binary_corners(data: bytes) -> FloatArray:
    header = _HEADER_BYTES
    if not _is_whole(data, header):
        lengths = (each for each in range(_LONGEST_HEADER) if _is_whole(data, each))
        header = next((each for each in lengths if _stated(data, each)), header)
    count, room = _stated(data, header), len(data) - header - 4
    if room < 0:
        raise InputError("is too short for an STL file")
    there, more = divmod(room, _RECORD.itemsize)
    if count in _UNKNOWN and room:
        if more:
            raise InputError(
                f"does not state how many triangles it holds, and ends {more} bytes after the"
                f" {there:,} there are, so it was cut short or is no STL"
            )
        count = there
    if count > there:
        raise InputError(
            f"promises {count} triangles but ends after {there}, so it was cut short or is no STL"
        )
    every = np.frombuffer(data, _RECORD, there, header + 4)["corners"].astype(np.float64)
    corners, others = every[:count], every[count:]
    if count and len(others) and _are_near(others, corners):
        raise InputError(
            f"promises {count:,} triangles but holds {there:,}, so one of the two is wrong"
        )
    return corners.reshape(-1, 3)


def _are_near(others: FloatArray, corners: FloatArray) -> bool:
    """Whether what follows the last triangle are more triangles: near the others, and no points."""
    lowest, highest = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    margin = (highest - lowest).max()
    is_near = (others >= lowest - margin) & (others <= highest + margin)
    return bool(is_near.all() and (others != others[:, :1]).any(axis=(1, 2)).all())


def _text_corners(text: bytes) -> tuple[FloatArray, IntArray]:
    """Corners of all facets, one after the other, and how many each has."""
    try:
        return _corners_by_lines(text)
    except InputError:
        split = _WITHIN_LINE.sub(b"\n", text)
        if split == text:
            raise
        return _corners_by_lines(split)


def _corners_by_lines(text: bytes) -> tuple[FloatArray, IntArray]:
    # What comes after "solid" or in lines of other words may hold any word.
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
        raise InputError(
            f"begins {len(begun)} triangles and ends {len(ended)}, not each with its three"
            " corners, so it was cut short"
        )
    last = np.append(ended, lines.beginning_with(b"end", b"solid")).max(initial=-1)
    if lines.last() > last:
        raise InputError(
            f"ends in line {lines.number(lines.last())} after its last triangle and before its last"
            " line (endsolid), so it was cut short"
        )
    numbers, each = lines.rows(vertices, b"vertex", np.float64)
    if np.any(each != 3):
        raise InputError("has a vertex without exactly three coordinates")
    return numbers.reshape(-1, 3), counts
