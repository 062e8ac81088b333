"""Wavefront OBJ: positions and polygons; texture coordinates and normals are passed over.

A corner written ``v/vt/vn`` is vertex ``v``: a surface is never cut along its texture seams.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import NotANumber, RawMesh, parse_rows
from meshmash_viewer.io.text import read_text
from meshmash_viewer.mesh import FloatArray, IntArray
from meshmash_viewer.triangulation import triangulate
from meshmash_viewer.units import counted

BoolArray = npt.NDArray[np.bool_]


def read_obj(path: Path) -> RawMesh:
    """Read the vertices (``v``) and faces (``f``) of an OBJ file.

    Polygons become triangles; negative indices count back from the vertices read so
    far; objects and groups become one mesh. Coordinates after the third of a ``v`` line
    (weight or colour) are passed over.

    Raises
    ------
    InputError
        If a line is not what its first letter promises, or names a vertex that is not there; the
        message names the line.
    """
    whole = data = read_text(path)
    if b"\\" in data:
        data = data.replace(b"\\\n", b" ")
    if re.search(rb"^[ \t]+[vf][ \t]", data, re.MULTILINE):
        data = re.sub(rb"^[ \t]+", b"", data, flags=re.MULTILINE)
    # Whole-file array work: a loop over the lines of a million vertices takes ten times longer.
    characters = np.frombuffer(data + b"\n", dtype=np.uint8).copy()
    ends = np.flatnonzero(characters == ord("\n"))
    starts = np.append(0, ends[:-1] + 1)
    second = characters[np.minimum(starts + 1, len(characters) - 1)]
    spaced = (second == ord(" ")) | (second == ord("\t"))
    is_vertex = (characters[starts] == ord("v")) & spaced
    is_face = (characters[starts] == ord("f")) & spaced
    if not is_vertex.any():
        raise InputError("holds no vertex line (v x y z)")
    characters[starts[is_vertex | is_face]] = ord(" ")
    lengths = ends + 1 - starts
    try:
        kind = is_vertex
        vertices = _vertices(_text(characters, lengths, is_vertex))
        kind = is_face
        text = _text(characters, lengths, is_face)
        corners, counts = _faces(text, np.cumsum(is_vertex)[is_face], len(vertices))
    except _LineFault as fault:
        line = _line_number(whole, int(np.flatnonzero(kind)[fault.row]))
        raise InputError(f"{fault}, in line {line}") from None
    return RawMesh(vertices, triangulate(vertices, corners, counts))


class _LineFault(InputError):
    """What is wrong, and with which of the vertex lines or of the face lines."""

    def __init__(self, what: str, row: int) -> None:
        super().__init__(what)
        self.row = row


def _line_number(data: bytes, index: int) -> int:
    """Line in the file, counted from 1, of a line counted from 0 after the joining of lines."""
    if b"\\" not in data:
        return index + 1
    lines = data.split(b"\n")
    begins = [True, *(not line.endswith(b"\\") for line in lines[:-1])]
    return int(np.flatnonzero(begins)[index]) + 1


def _text(characters: npt.NDArray[np.uint8], lengths: IntArray, lines: BoolArray) -> bytes:
    text = characters[np.repeat(lines, lengths)].tobytes()
    return re.sub(rb"#[^\n]*", b"", text) if b"#" in text else text


def _rows(
    text: bytes, dtype: type[np.generic], fault_if_empty: str
) -> tuple[npt.NDArray[Any], IntArray]:
    """As `parse_rows`, but every line has to hold something."""
    try:
        numbers, counts = parse_rows(text, dtype)
    except NotANumber as fault:
        raise _LineFault(str(fault), fault.line) from None
    if len(counts) < text.count(b"\n"):
        empty = [not line.strip() for line in text.split(b"\n")].index(True)
        raise _LineFault(fault_if_empty, empty)
    return numbers, counts


def _vertices(text: bytes) -> FloatArray:
    too_few = "has a vertex with fewer than three coordinates"
    numbers, counts = _rows(text, np.float64, too_few)
    if counts.min() < 3:
        raise _LineFault(too_few, int(counts.argmin()))
    first = np.cumsum(counts) - counts
    vertices = np.column_stack([numbers[first], numbers[first + 1], numbers[first + 2]])
    if not np.isfinite(vertices).all():
        broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        vertex = counted(len(broken), "vertex")
        raise _LineFault(f"has {vertex} with a coordinate that is not finite", int(broken[0]))
    return vertices


def _faces(text: bytes, vertices_before: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Corners of all faces, counted from 0, and how many each has."""
    if b"/" in text:
        text = _without_slashes(text)
    given, counts = _rows(text, np.int64, "has a face line without corners")
    if not len(given):
        return given, counts
    ends = np.cumsum(counts)
    corners = given - 1
    if given.min() <= 0:
        before = np.repeat(vertices_before, counts)
        corners = np.where(given < 0, before + given, corners)
        if np.any(given == 0):
            row = int(np.searchsorted(ends, np.argmax(given == 0), side="right"))
            raise _LineFault("has a face with vertex index 0, though OBJ counts from 1", row)
        if np.any(given < -before):
            row = int(np.searchsorted(ends, np.argmax(given < -before), side="right"))
            raise _LineFault("has a face that counts back to before the first vertex", row)
    if corners.max() >= n_vertices:
        wrong = np.flatnonzero(corners >= n_vertices)
        rows = np.unique(np.searchsorted(ends, wrong, side="right"))
        face = counted(len(rows), "face")
        raise _LineFault(
            f"has {face} with a vertex index out of range, the first being vertex"
            f" {given[wrong[0]]} of {n_vertices}",
            int(rows[0]),
        )
    return corners, counts


def _without_slashes(text: bytes) -> bytes:
    """Blank every token from its first slash on: "7/2/9" leaves "7"."""
    characters = np.frombuffer(text, dtype=np.uint8).copy()
    is_token = np.zeros(len(characters) + 2, dtype=np.int8)
    is_token[1:-1] = characters > 32
    edges = np.flatnonzero(np.diff(is_token))
    starts, ends = edges[::2], edges[1::2]
    slashes = np.append(np.flatnonzero(characters == ord("/")), len(characters))
    cuts = np.minimum(slashes[np.searchsorted(slashes, starts)], ends)
    blank = np.zeros(len(characters) + 1, dtype=np.int8)
    blank[cuts] += 1
    blank[ends] -= 1
    characters[np.cumsum(blank[:-1], dtype=np.int8) > 0] = ord(" ")
    return characters.tobytes()
