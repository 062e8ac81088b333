"""Wavefront OBJ: positions and polygons; texture coordinates and normals are not read.

A corner written ``v/vt/vn`` is vertex ``v``: a surface is never cut along its texture seams.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.raw import RawMesh
from meshmash_viewer.io.text import Lines, read_text
from meshmash_viewer.triangulation import triangulate
from meshmash_viewer.units import counted

#: A comment, and what follows the vertex of a corner.
_NOT_READ = re.compile(rb"#[^\n\v]*|/\S*")


def read_obj(path: Path) -> RawMesh:
    """Read the vertices (``v``) and faces (``f``) of an OBJ file.

    Polygons become triangles; negative indices count back from the vertices read so far; objects
    and groups become one mesh. Coordinates after the third of a vertex (weight or colour) are
    ignored.

    `InputError` is raised if a vertex or face is not as it should be, or names a vertex that does
    not exist; the message names the line.
    """
    # a line that ends with a backslash continues in the next
    lines = Lines(_NOT_READ.sub(b"", read_text(path).replace(b"\\\n", b" \v")))
    vertex_lines, face_lines = lines.beginning_with(b"v"), lines.beginning_with(b"f")
    if not len(vertex_lines):
        raise InputError("holds no vertex line (v x y z)")
    vertices = _vertices(lines, vertex_lines)
    before = np.searchsorted(vertex_lines, face_lines)
    corners, counts = _faces(lines, face_lines, before, len(vertices))
    return RawMesh(vertices, triangulate(vertices, corners, counts))


def _vertices(lines: Lines, which: IntArray) -> FloatArray:
    numbers, counts = lines.rows(which, b"v", np.float64)
    if counts.min() < 3:
        line = which[counts.argmin()]
        raise lines.fault("has a vertex with fewer than three coordinates", line)
    first = np.cumsum(counts) - counts
    vertices = np.column_stack([numbers[first], numbers[first + 1], numbers[first + 2]])
    broken = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(broken):
        vertex = counted(len(broken), "vertex")
        raise lines.fault(f"has {vertex} with a coordinate that is not finite", which[broken[0]])
    return vertices


def _faces(
    lines: Lines, which: IntArray, vertices_before: IntArray, n_vertices: int
) -> tuple[IntArray, IntArray]:
    """Return the corners of all faces, counted from 0, and how many each has."""
    given, counts = lines.rows(which, b"f", np.int64)
    if not counts.all():
        raise lines.fault("has a face line without corners", which[counts.argmin()])
    line, before = np.repeat(which, counts), np.repeat(vertices_before, counts)
    if np.any(given == 0):
        fault = "has a face with vertex index 0, though OBJ counts from 1"
        raise lines.fault(fault, line[given == 0][0])
    if np.any(given < -before):
        fault = "has a face that counts back to before the first vertex"
        raise lines.fault(fault, line[given < -before][0])
    corners = np.where(given < 0, before + given, given - 1)
    outside = np.flatnonzero(corners >= n_vertices)
    if len(outside):
        raise lines.fault(
            f"has {counted(len(np.unique(line[outside])), 'face')} with a vertex index out of"
            f" range, the first being vertex {given[outside[0]]} of {n_vertices}",
            line[outside[0]],
        )
    return corners, counts
