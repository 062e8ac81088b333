"""Readers of NumPy files: NPZ archives of meshes or maps, and NPY arrays of maps."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.errors import (
    InputError,
    cut_short,
    no_whole_numbers,
    printable,
    wrong_format,
    wrong_shape,
)
from meshmash_viewer.io.condensed import DOMAINS, condensed_columns
from meshmash_viewer.io.provenance import second_file, stated_columns, stated_mesh
from meshmash_viewer.io.raw import (
    MOST_MAPS,
    RawMap,
    RawMesh,
    ReadLimits,
    are_ascending_indices,
    maps_alone,
    maps_of_columns,
    most_maps,
    row_per_vertex,
    too_many_maps,
)
from meshmash_viewer.triangulation import triangulate
from meshmash_viewer.vertex_map import Label

#: Arrays with one entry per eigenpair in exports of this program.
_NOT_READ = ("eigenvalues", "eigenvectors", "residuals")
#: Names of the arrays of a mesh in any case, in this order of preference; most are of other
#: programs.
_VERTICES = (
    "vertices", "verts", "vert", "points", "pts", "coords", "coord", "coordinates", "positions",
    "pos", "xyz", "nodes", "rr",
)  # fmt: skip
_FACES = (
    "faces", "triangles", "tris", "tri", "triv", "simplices", "cells", "elements", "face"
)  # fmt: skip
#: Short names of both arrays, which are accepted only together.
_SHORT = (("V", "F"), ("v", "f"), ("X", "T"), ("V", "T"))
#: Arrays that describe the label numbers in the array ``labels`` in exports of this program.
_LABELS = ("label_numbers", "label_names", "label_colors")


def read_npz(path: Path) -> RawMesh:
    """Read ``vertices`` (n, 3) and ``faces`` (m, 3 or more corners) from an NPZ file.

    Other common names of the two arrays are accepted, and both arrays may be transposed. Faces may
    also be in the form of pyvista, ``[3, a, b, c]`` in rows or concatenated. Other arrays with one
    number per vertex become maps. Exports of this program also contain ``features`` with the names
    of its columns in ``columns``, and the unit in the JSON text ``meta``. `InputError` is raised if
    the file is no NPZ archive, or the arrays are missing or have wrong shapes.
    """
    with _mesh_archive(path) as archive:
        names = _mesh_names(archive.files)
        vertices, faces = (_array(archive, name) for name in names)
        transposed = vertices.ndim == 2 and len(vertices) == 3 != vertices.shape[1]
        if transposed:
            vertices = vertices.T
        # PyTorch Geometric has an array face of shape (3, m)
        if (transposed or names[1] == "face") and faces.ndim == 2 and len(faces) == 3:
            faces = faces.T
        meta = _provenance(archive)
        wide: list[str] = []
        maps, remarks = most_maps(list(_maps(archive, len(vertices), wide)))
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise wrong_shape("Vertices", vertices.shape, "numbers of shape (n, 3)")
    if faces.dtype.kind not in "fiu" or np.any(faces != np.floor(faces)):
        raise no_whole_numbers(f"faces of {faces.dtype}")
    vertices = vertices.astype(np.float64)
    triangles = triangulate(vertices, *_polygons(faces.astype(np.int64), len(vertices)))
    unit, structure = stated_mesh(meta)
    return RawMesh(vertices, triangles, unit, maps, (*remarks, *wide), structure, meta)


def _mesh_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the arrays of vertices and of faces; empty unless both are present."""
    exact = {name: name for name in names}
    known = {name.lower(): name for name in exact if len(name) > 1} | exact
    long = (*_VERTICES, "V"), (*_FACES, "F")
    both = tuple(next((known[name] for name in each if name in known), "") for each in long)
    short = (each for each in _SHORT if known.keys() >= set(each))
    return both if all(both) else next(short, ())


def npz_limits(path: Path) -> ReadLimits | None:
    """Return the limits for an archive; None if its unpacked size needs no limits."""
    with _mesh_archive(path) as archive:
        held = archive.zip.infolist()
    unpacked = sum(member.file_size for member in held if member.filename[:-4] not in _NOT_READ)
    return ReadLimits.if_needed(path.stat().st_size, unpacked)


def _polygons(faces: IntArray, n_vertices: int) -> tuple[IntArray, IntArray]:
    """Return the corners of all faces, and the number of corners of each face.

    A face in the file is a row of corners; or the number of corners followed by the corners, as in
    pyvista and VTK: ``[3, a, b, c]``, in rows or concatenated.
    """
    if faces.ndim == 1:
        return _listed_polygons(faces)
    if faces.ndim != 2 or faces.shape[1] < 3:
        raise wrong_shape("Faces", faces.shape, "whole numbers of shape (m, 3)")
    width = faces.shape[1] - 1
    counts = np.full(len(faces), width + 1, dtype=np.int64)
    if width < 3 or not np.all(faces[:, 0] == width):
        return faces.ravel(), counts
    # the first number is no corner if it is out of range, or is again in the same face
    if width >= n_vertices or np.any(faces[:, 1:] == width):
        return faces[:, 1:].ravel(), counts - 1
    if len(faces) > 1:
        raise InputError(
            "ambiguous-content",
            f"has faces that all begin with {width}, which may be their number of corners as in"
            " pyvista, or a vertex that all of them share",
            "leave the number out",
        )
    return faces.ravel(), counts


def _listed_polygons(cells: IntArray) -> tuple[IntArray, IntArray]:
    counts, place = [], 0
    while place < len(cells):
        counts.append(int(cells[place]))
        if counts[-1] < 3:
            raise wrong_format("has faces that are no list of polygons, each after its number")
        place += counts[-1] + 1
    if place > len(cells):
        raise cut_short("has a list of faces that ends within one")
    is_corner = np.ones(len(cells), dtype=np.bool_)
    many = np.array(counts, dtype=np.int64)
    is_corner[np.cumsum(many + 1) - many - 1] = False
    return cells[is_corner], many


def npy_maps(path: Path) -> RawMesh:
    """Read an array of shape (n,), or (n, columns), as maps."""
    try:
        values = np.load(path)
    except ValueError as fault:
        raise _of_objects("an array", fault) or fault from fault
    if values.ndim not in (1, 2):
        raise wrong_shape("Values", values.shape, "one number per vertex")
    if values.dtype.names and values.ndim == 1:
        return maps_alone(RawMap(name, values[name].copy()) for name in values.dtype.names)
    if values.ndim == 1:
        return maps_alone([RawMap("", values)])
    values = row_per_vertex(values)
    count = values.shape[1]
    if count > MOST_MAPS:
        raise too_many_maps(count)
    meta = second_file(path)
    names = stated_columns(meta)
    if len(names) != count:
        names = [f"column {at}" for at in range(count)]
    return maps_alone(maps_of_columns(values, names), meta=meta)


def npz_maps(path: Path) -> RawMesh:
    """Read the arrays of shape (n,) and (n, columns) as maps."""
    with _opened(path) as archive:
        if {"X", "labels"} <= set(archive.files):
            return maps_alone(
                _of_domains(path, *(_array(archive, each) for each in ("X", "labels")))
            )
        if {"nodes", "edges"} <= set(archive.files):
            raise InputError(
                "no-values",
                "holds a graph of domains, which View › Graph of labels draws once the features of"
                " these domains (X and labels) are open",
            )
        wide: list[str] = []
        maps, meta = tuple(_maps(archive, None, wide)), _provenance(archive)
        names = printable(", ".join(archive.files) or "nothing")
    if not maps:
        none = f"holds {names}, of which none has one number per vertex"
        raise InputError("no-values", wide[0] if wide else none)
    return maps_alone(maps, tuple(wide), meta)


def _of_domains(path: Path, values: npt.NDArray[Any], labels: npt.NDArray[Any]) -> Iterator[RawMap]:
    """Yield a map of the domain numbers, and a map per column of condensed features."""
    names = condensed_columns(path, values, labels)
    domains = labels.astype(np.float64)
    yield RawMap(DOMAINS, np.where(domains < 0.0, np.nan, domains))
    for name, column in zip(names[: MOST_MAPS - 1], values.T, strict=False):
        yield RawMap(name, np.where(labels < 0, np.nan, column[labels + 1]))


def _provenance(archive: Any) -> str:
    """Return the provenance text in exports of this program; "" for other archives."""
    try:
        return str(_array(archive, "meta"))
    except InputError:
        return ""


def holds_a_mesh(path: Path) -> bool:
    """Whether an archive contains a mesh; True if it cannot be opened."""
    try:
        with zipfile.ZipFile(path) as archive:
            return bool(_mesh_names(name.removesuffix(".npy") for name in archive.namelist()))
    except (zipfile.BadZipFile, OSError):
        return True


def _maps(archive: Any, n_vertices: int | None, wide: list[str]) -> Iterator[RawMap]:
    """Yield a map per column of the arrays with `n_vertices` rows; with None, of any length.

    A clause on each array with too many columns is appended to `wide`.

    Exports of this program after a repair have an array ``vertex`` with the index in the mesh file
    of each row. It is used if `n_vertices` is None, that is, if no mesh is read.
    """
    rows = _rows(archive)
    passed = {*_mesh_names(archive.files), "vertices", "faces", "meta", "columns", *_NOT_READ}
    if rows is not None:
        passed.add("vertex")
    if n_vertices is not None:
        rows = None
    labels = _labels(archive)
    for name in archive.files:
        if name in passed or (labels and name in _LABELS):
            continue
        try:
            values = _array(archive, name)
        except InputError:  # a damaged array does not prevent reading the others
            continue
        if values.ndim not in (1, 2):
            continue
        if len(values) != n_vertices and values.ndim == 2:
            values = row_per_vertex(values)
        length = n_vertices or len(values if rows is None else rows)
        if len(values) != length or not length:
            continue
        if values.ndim == 1:
            named = labels if name == "labels" else ()
            yield RawMap(name, values, named, rows, keep_unused=True)
        elif values.shape[1] <= MOST_MAPS:
            own = name == "features" and "columns" in archive.files
            names = list(map(str, np.ravel(_array(archive, "columns")))) if own else []
            if len(names) != values.shape[1]:
                names = [f"{name} {at}" for at in range(values.shape[1])]
            yield from maps_of_columns(values, names, rows)
        else:
            wide.append(
                f"has an array {printable(name, 40)} of {values.shape[1]:,} columns, of which"
                f" {MOST_MAPS} can be taken at most, so it is left out"
            )


def _labels(archive: Any) -> tuple[Label, ...]:
    """Return the labels of the array ``labels``; empty if names or colours are missing."""
    if not {"labels", *_LABELS} <= set(archive.files):
        return ()
    numbers, names, colors = (np.ravel(_array(archive, name)).tolist() for name in _LABELS)
    if not all(isinstance(number, int) for number in numbers):
        return ()
    return tuple(
        Label(number, str(name), str(color))
        for number, name, color in zip(numbers, names, colors, strict=False)
    )


def _rows(archive: Any) -> IntArray | None:
    """Return the index in the mesh file of each row; None without an array ``vertex``."""
    values = _array(archive, "vertex") if "vertex" in archive.files else np.zeros(0)
    return values.astype(np.int64) if len(values) and are_ascending_indices(values) else None


def _mesh_archive(path: Path) -> Any:
    archive = _opened(path)
    if not _mesh_names(archive.files):
        archive.close()
        names = printable(", ".join(archive.files) or "nothing")
        raise InputError("missing-data", f"holds {names}, not arrays called vertices and faces")
    return archive


def _opened(path: Path) -> Any:
    if not zipfile.is_zipfile(path):
        raise wrong_format("is not an NPZ archive")
    try:
        return np.load(path)
    except (zipfile.BadZipFile, OSError, ValueError) as fault:
        raise InputError("file-damaged", "has a damaged table of contents") from fault


def _array(archive: Any, name: str) -> npt.NDArray[Any]:
    try:
        return np.asarray(archive[name])
    except Exception as fault:  # the parsers raise various types
        damaged = InputError("file-damaged", f"has an array {name} that is damaged or cut short")
        raise _of_objects(f"an array {name}", fault) or damaged from fault


def _of_objects(array: str, fault: Exception) -> InputError | None:
    """Return the error for an array of Python objects; None for other errors of NumPy."""
    if "Object arrays" not in str(fault):
        return None
    what = f"has {array} of Python objects"
    return InputError("wrong-type", what, "save it with a type of numbers")
