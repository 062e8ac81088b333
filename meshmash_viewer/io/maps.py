"""Files with values per vertex to `VertexMap`, or one clear sentence."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.formats.neuroimaging import (
    freesurfer_annotation,
    freesurfer_label,
    freesurfer_values,
    gifti_maps,
    is_freesurfer_values,
    mgh_maps,
)
from meshmash_viewer.io.formats.npz import holds_a_mesh, npz_maps
from meshmash_viewer.io.guarded import LimitExceeded, read_guarded
from meshmash_viewer.io.polygons import MOST_MAPS, RawMap, RawMesh, are_ascending_indices
from meshmash_viewer.io.read import READERS, Reader, check_file, vertex_map
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.vertex_map import VertexMap

if TYPE_CHECKING:
    import pyarrow

__all__ = ["MAP_ENDINGS", "csv_maps", "is_map_file", "npy_maps", "parquet_maps", "read_maps"]


def npy_maps(path: Path) -> RawMesh:
    """Read an array of one number a vertex, or of one a vertex and column."""
    values = np.load(path)
    if values.ndim not in (1, 2):
        raise InputError(f"has shape {values.shape}, which is not one number a vertex")
    if values.ndim == 1:
        return _only([RawMap("", values)])
    return _only(RawMap(f"column {at}", each.copy()) for at, each in enumerate(values.T))


def csv_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a table, with or without a first line of names."""
    import pyarrow.csv

    with path.open("rb") as file:
        first = file.readline(100_000).strip()
    named = not all(_is_number(word) for word in re.split(rb"[,;\t]", first))
    separator = next((sign for sign in ("\t", ";") if sign.encode() in first), ",")
    table = pyarrow.csv.read_csv(
        path,
        pyarrow.csv.ReadOptions(autogenerate_column_names=not named, use_threads=False),
        pyarrow.csv.ParseOptions(delimiter=separator),
        pyarrow.csv.ConvertOptions(null_values=["", "NA", "NaN", "nan", "null"]),
    )
    if not named and len(table.column_names) == 1:
        table = table.rename_columns([""])
    return _table(table)


def parquet_maps(path: Path) -> RawMesh:
    """Read the columns of numbers of a Parquet table."""
    import pyarrow.parquet

    return _table(pyarrow.parquet.read_table(path, use_threads=False))


#: Readers of maps alone, by lower-case ending.
_READERS: dict[str, Reader] = {
    ".npy": npy_maps,
    ".csv": csv_maps,
    ".tsv": csv_maps,
    ".parquet": parquet_maps,
    ".annot": freesurfer_annotation,
    ".label": freesurfer_label,
    ".mgh": mgh_maps,
    ".mgz": mgh_maps,
}
#: Of a FreeSurfer subject, after "lh" or "rh": one number a vertex.
_VALUES = (".curv", ".thickness", ".sulc", ".area", ".volume", ".avg_curv", ".jacobian_white")
_GIFTI_MAPS = (".func.gii", ".shape.gii", ".label.gii")

#: Endings that say that a file holds maps and no mesh; others may turn out to hold both.
MAP_ENDINGS: tuple[str, ...] = (*_READERS, *_GIFTI_MAPS, *_VALUES)


def is_map_file(path: str | Path) -> bool:
    """Whether a file is one of maps alone, by its ending, or else by how it begins."""
    path = Path(path)
    name = path.name.lower()
    if name.endswith(MAP_ENDINGS):
        return True
    try:
        if name.endswith(".npz"):
            return not holds_a_mesh(path)
        if name.endswith(".gii"):
            with path.open("rb") as file:  # the points come first
                return b"NIFTI_INTENT_POINTSET" not in file.read(1_000_000)
        return path.suffix.lower() not in _OF_MESHES and is_freesurfer_values(path)
    except OSError:
        return False  # whoever reads it as a mesh says why not


#: Endings of meshes that say for sure what is in the file, unlike FreeSurfer's.
_OF_MESHES = tuple(ending for ending in READERS if READERS[ending] is not READERS[".pial"])


def read_maps(path: str | Path, mesh: MeshLike) -> tuple[VertexMap, ...]:
    """Read values per vertex from a file; the format is told by the file's ending.

    Files of maps alone are NPZ, NPY, CSV, Parquet, GIFTI (functional, shape and label files), and
    FreeSurfer's (``.curv`` and alike, ``.annot``, ``.label``, ``.mgh``). Of a mesh file, what it
    has at its vertices besides coordinates.

    Parameters
    ----------
    path : str or Path
    mesh : MeshLike
        The mesh that they are for.

    Returns
    -------
    tuple of VertexMap
        One or more, with `VertexMap.path`; see `Mesh.with_maps`.

    Raises
    ------
    InputError
        If there is no such file, it has no value for each vertex of the mesh, or a value is none;
        one sentence that names the file, the fault and the way out.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(3)
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "height.npy"
    ...     np.save(file, ball.vertices[:, 2])
    ...     mesh = mv.Mesh(ball.vertices, ball.faces).with_maps(*mv.read_maps(file, ball))
    >>> mesh.maps[0].name
    'height.npy'
    """
    path, mesh = Path(path), as_mesh(mesh)
    check_file(path)
    try:
        raw = read_guarded(_reader(path), path)
        if not raw.maps:
            raise InputError("has nothing at its vertices but coordinates")
        fitting = tuple(_fitting(raw.maps, mesh, path))
    except LimitExceeded as fault:
        raise InputError(f"{path} {fault}") from fault
    except InputError as fault:
        text = str(fault)
        if text.startswith("Map "):
            raise InputError(f"{path}: {text[0].lower()}{text[1:]}") from fault
        if "not installed" in text:
            raise InputError(f"{path} {text}.") from fault
        raise InputError(f"{path} {text}; give a file with one number a vertex.") from fault
    except PermissionError as fault:
        raise InputError(f"{path} may not be read by you; give yourself permission.") from fault
    return fitting


def _reader(path: Path) -> Reader:
    name = path.name.lower()
    ending = path.suffix.lower()
    if ending in _READERS:
        return _READERS[ending]
    if ending == ".npz":
        return npz_maps
    if ending == ".gii":
        return gifti_maps
    if ending in _OF_MESHES:
        return READERS[ending]
    if name.endswith(_VALUES) or is_freesurfer_values(path):
        return freesurfer_values
    raise InputError(
        f"has an ending ({printable(ending, 40) or 'none'}) of no known format of maps"
    )


def _fitting(maps: Iterable[RawMap], mesh: Any, path: Path) -> Iterator[VertexMap]:
    """Those of as many numbers as the mesh has vertices, or had when it was read."""
    all_of_them = tuple(maps)
    known = [each for each in all_of_them if each.values.dtype.kind in "fiubc"] or all_of_them
    lengths = {mesh.n_vertices, mesh.n_file_vertices}
    fitting = [each for each in known if each.last >= 0 or len(each.values) in lengths]
    for each in fitting or known:
        named = replace(each, name=each.name or path.name)
        found = vertex_map(named, max(lengths), str(path))
        yield found if fitting else mesh.with_maps(found).maps[-1]


def _is_number(word: bytes) -> bool:
    try:
        float(word.strip(b' "'))
    except ValueError:
        return False
    return True


def _table(table: pyarrow.Table) -> RawMesh:
    """The columns of numbers; one called "vertex" says which vertex a row is for."""
    columns: dict[str, Any] = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        values = column.to_numpy()
        if values.dtype.kind in "fiub":
            columns[name] = values
    rows = columns.pop("vertex", None)
    if rows is not None:
        order = np.argsort(rows, kind="stable")
        rows = rows[order]
        columns = {name: values[order] for name, values in columns.items()}
        if not are_ascending_indices(rows):
            raise InputError("has a column vertex that is not an index from 0 in each row, once")
        all_of_them = not len(rows) or rows[-1] < len(rows)
        rows = None if all_of_them else rows.astype(np.int64)
    return _only(
        RawMap(name, np.ascontiguousarray(each), rows=rows) for name, each in columns.items()
    )


def _only(maps: Iterable[RawMap]) -> RawMesh:
    found = tuple(maps)
    if not found:
        raise InputError("has no column of numbers")
    if len(found) > MOST_MAPS:
        raise InputError(f"has {len(found):,} columns, of which {MOST_MAPS} can be taken at most")
    return RawMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), maps=found)
