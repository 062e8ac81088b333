"""Wavefront OBJ: positions and polygons; texture coordinates and normals are passed over.

A corner written ``v/vt/vn`` is vertex ``v``: a surface is never cut along its texture seams.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh, fan_triangles, parse_rows
from meshmash_viewer.mesh import FloatArray, IntArray

__all__ = ["read_obj"]

BoolArray = npt.NDArray[np.bool_]


def read_obj(path: Path) -> RawMesh:
    """Read the vertices (``v``) and faces (``f``) of an OBJ file.

    Polygons become fans of triangles; negative indices count back from the vertices read so
    far; objects and groups become one mesh. Coordinates after the third of a ``v`` line
    (weight or colour) are passed over.

    Raises
    ------
    InputError
        If a line is not what its first letter promises, or an index is zero.
    """
    data = path.read_bytes()
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    if b"\\" in data:
        data = re.sub(rb"\\\r?\n", b" ", data)
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
    vertices = _vertices(_text(characters, lengths, is_vertex), int(is_vertex.sum()))
    faces = _faces(_text(characters, lengths, is_face), np.cumsum(is_vertex)[is_face])
    return RawMesh(vertices, faces)


def _text(characters: npt.NDArray[np.uint8], lengths: IntArray, lines: BoolArray) -> bytes:
    text = characters[np.repeat(lines, lengths)].tobytes()
    return re.sub(rb"#[^\n]*", b"", text) if b"#" in text else text


def _vertices(text: bytes, n_lines: int) -> FloatArray:
    numbers, counts = parse_rows(text, np.float64)
    if len(counts) != n_lines or counts.min() < 3:
        raise InputError("has a vertex with fewer than three coordinates")
    first = np.cumsum(counts) - counts
    return np.column_stack([numbers[first], numbers[first + 1], numbers[first + 2]])


def _faces(text: bytes, vertices_before: IntArray) -> IntArray:
    if b"/" in text:
        text = _without_slashes(text)
    corners, counts = parse_rows(text, np.int64)
    if len(counts) != len(vertices_before):
        raise InputError("has a face line without corners")
    if np.any(corners == 0):
        raise InputError("has a face with vertex index 0, though OBJ counts from 1")
    if len(corners) and corners.min() < 0:
        before = np.repeat(vertices_before, counts)
        if np.any(corners < -before):
            raise InputError("has a face that counts back to before the first vertex")
        corners = np.where(corners < 0, before + corners, corners - 1)
    else:
        corners = corners - 1
    return fan_triangles(corners, counts)


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
