"""Reader of files with values per vertex; errors are one sentence with the fault and a remedy."""

from __future__ import annotations

import gzip
import operator
import re
import warnings
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, MeshWarning, printable
from meshmash_viewer.io.condensed import holds, labelled_domains
from meshmash_viewer.io.formats.brain import (
    freesurfer_annotation,
    freesurfer_kind,
    freesurfer_label,
    freesurfer_values,
    gifti_maps,
    mgh_maps,
)
from meshmash_viewer.io.formats.npz import holds_a_mesh, npy_maps, npz_maps
from meshmash_viewer.io.formats.tables import csv_maps, parquet_maps
from meshmash_viewer.io.raw import RawMap, checked_maps, read_guarded
from meshmash_viewer.io.read import (
    READERS,
    Reader,
    check_file,
    file_ending,
    no_permission,
    unpacked,
)
from meshmash_viewer.io.signatures import misnamed
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.structures import brain_side
from meshmash_viewer.vertex_map import VertexMap, named_apart

#: Readers of files with maps and no mesh, by lower-case ending.
_READERS: dict[str, Reader] = {
    ".npy": npy_maps,
    ".csv": csv_maps,
    ".tsv": csv_maps,
    ".txt": csv_maps,
    ".parquet": parquet_maps,
    ".1d": csv_maps,
    ".annot": freesurfer_annotation,
    ".label": freesurfer_label,
    ".mgh": mgh_maps,
    ".mgz": mgh_maps,
}
#: Endings of FreeSurfer files with one number per vertex, after "lh" or "rh".
_VALUES = (".curv", ".thickness", ".sulc", ".area", ".volume", ".avg_curv", ".jacobian_white")
#: Smallest share of the vertices of a hemisphere that are outside its medial wall.
_LEAST_CORTEX = 0.8
#: A file, and a condition on the values of its map.
_CONDITION = re.compile(r"(?P<file>.+?)\s*(?P<how>[<>]=?)\s*(?P<limit>[-+]?[\d.]+(e[-+]?\d+)?)")
_COMPARED = {
    ">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le,
}  # fmt: skip
_PLAIN = (*_READERS, ".func.gii", ".shape.gii", ".label.gii", *_VALUES)

#: Endings of files with maps and no mesh; other files may contain both.
MAP_ENDINGS: tuple[str, ...] = (
    *_PLAIN,
    *(f"{ending}.gz" for ending in _PLAIN if ending != ".mgz"),
    ".npz.gz",
)
#: Readers by ending, without the endings of FreeSurfer surfaces, which maps may also have.
_BY_ENDING: dict[str, Reader] = {
    **{ending: reader for ending, reader in READERS.items() if reader is not READERS[".pial"]},
    ".npz": npz_maps,
    ".gii": gifti_maps,
    **_READERS,
}


def is_map_file(path: str | Path) -> bool:
    """Whether a file contains maps and no mesh, by its ending, or else its first bytes."""
    path = Path(path)
    if path.name.lower().endswith(MAP_ENDINGS):
        return True
    ending = file_ending(path)
    if ending == ".npz":
        return not holds_a_mesh(path)
    ending = ending.removesuffix(".gz")
    try:
        if ending == ".asc":  # a surface begins with a comment
            return _beginning(path, 1) != b"#"
        if ending == ".gii":  # the point set is the first array
            return b"NIFTI_INTENT_POINTSET" not in _beginning(path, 1_000_000)
    except (OSError, EOFError, zlib.error):
        return False  # reading it as a mesh raises the error
    return ending not in _BY_ENDING and freesurfer_kind(path) == "values"


def _beginning(path: Path, size: int) -> bytes:
    """Return the first bytes of a file, or of the content of a gzip file."""
    with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
        return file.read(size)


def read_maps(path: str | Path, mesh: MeshLike) -> tuple[VertexMap, ...]:
    """Read values per vertex from a file; the format is given by the file's ending.

    Formats of maps, also gzipped, are NPZ, NPY, CSV (also ``.txt``), Parquet, GIFTI (functional,
    shape and label files), those of FreeSurfer (``.curv`` and similar, ``.annot``, ``.label``,
    ``.mgh``), and ``.1D``. From a mesh file, all values at its vertices are read except
    coordinates. Condensed features, see `read_condensed_features`, become one map per column, with
    the value of a domain at each of its vertices, and a label set of the domains.

    The maps have different names, and `VertexMap.path`; see `Mesh.with_maps`. `InputError` is
    raised if the file does not exist, does not have one value per vertex of the mesh, or cannot be
    read; the message names the file, the fault and a remedy. A `MeshWarning` is given for columns
    without numbers, maps with invalid values, and maps of the other hemisphere.

    Examples
    --------
    >>> np.save(folder / "height.npy", ball.vertices[:, 2])
    >>> maps = mv.read_maps(folder / "height.npy", ball)
    >>> mv.Mesh(ball.vertices, ball.faces).with_maps(*maps).maps[0].name
    'height.npy'
    """
    maps, remarks = maps_and_remarks(path, mesh)
    for remark in remarks:
        warnings.warn(remark, MeshWarning, stacklevel=2)
    return maps


def read_mask(given: str | Path, mesh: MeshLike) -> npt.NDArray[np.bool_]:
    """Read a mask of vertices, shape (n,), from a file of maps.

    `InputError` is raised as by `read_maps` and `VertexMap.mask`.

    Parameters
    ----------
    given : str or Path
        The file, of any format of `read_maps`. A colon and labels may follow, see
        `VertexMap.mask`: "lh.aparc.annot:cuneus,lingual", "lh.aparc.annot:-unknown"; or a colon and
        the name of a map: "maps.npz:thickness". A condition on the values with >, >=, < or <= may
        be last: "lh.thickness>0.5", "maps.npz:thickness<=2"; NaN does not meet a condition.
    mesh : MeshLike

    Examples
    --------
    >>> np.save(folder / "cap.npy", ball.vertices[:, 2] > 0.5)
    >>> int(mv.read_mask(folder / "cap.npy", ball).sum())
    165
    """
    condition = None if Path(given).exists() else _CONDITION.fullmatch(str(given))
    path, named = _divided(given if condition is None else condition["file"])
    maps, faults = read_maps(path, mesh), list[InputError]()
    chosen = tuple(each for each in maps if each.name == named)
    if chosen:
        maps, named = chosen, ""
    elif len(maps) > 1 and not named:
        raise _several(path, maps)
    for each in maps:
        try:
            found = as_mesh(mesh).with_maps(each).maps[-1]
            return found.mask(named) if condition is None else _meeting(condition, found, named)
        except InputError as fault:
            faults.append(fault)
    raise faults[0].of(path)


def read_labels(given: str | Path, mesh: MeshLike) -> VertexMap:
    """Read a label set from a file of maps.

    If the file has only numbers, the set has no labels. `InputError` is raised as by `read_maps`,
    and if the file has no map of the given name, or the name is needed and missing.

    Parameters
    ----------
    given : str or Path
        The file, of any format of `read_maps`. A colon and the name of a map may follow:
        "maps.npz:lobes". The name is needed unless the file has a single map, or a single map with
        labels.
    mesh : MeshLike

    Examples
    --------
    >>> rows = "label,name\\n" + 300 * "1,spine\\n" + 342 * "2,shaft\\n"
    >>> _ = (folder / "parts.csv").write_text(rows)
    >>> parts = mv.read_labels(folder / "parts.csv", ball)
    >>> [label.name for label in parts.labels], int(parts.mask("spine").sum())
    (['spine', 'shaft'], 300)
    """
    path, named = _divided(given)
    maps = read_maps(path, mesh)
    found = [each for each in maps if (each.name == named if named else each.labels)]
    if not found and not named and len(maps) == 1:
        found = list(maps)
    if len(found) != 1:
        raise _several(path, maps)
    return as_mesh(mesh).with_maps(found[0]).maps[-1]


def _meeting(condition: re.Match[str], found: VertexMap, named: str) -> npt.NDArray[np.bool_]:
    """Return a mask of the vertices whose value meets a condition."""
    if named or found.labels:
        what = f"has no map {named!r}" if named else f"{found.name!r} has labels"
        raise InputError("no-values", f"{what}, and a condition is on the values of a map")
    return np.asarray(_COMPARED[condition["how"]](found.values, float(condition["limit"])))


def _divided(given: str | Path) -> tuple[Path, str]:
    """Split a text into the path of a file and the text after the colon, "" without one."""
    path, named = Path(given), ""
    if not path.exists() and ":" in str(given):
        text, named = str(given).rsplit(":", 1)
        path = Path(text)
    return path, named


def _several(path: Path, maps: tuple[VertexMap, ...]) -> InputError:
    names = ", ".join(each.name for each in maps)
    if len(maps) == 1:
        remedy = "leave out the name after the colon"
        return InputError("unknown-name", f"{path} has one map, {names}", remedy)
    remedy = f"name one after a colon, of {names}"
    return InputError("ambiguous-content", f"{path} has {len(maps)} maps", remedy)


def maps_and_remarks(
    path: str | Path, mesh: MeshLike
) -> tuple[tuple[VertexMap, ...], tuple[str, ...]]:
    """Do as `read_maps`, but return the warnings as sentences."""
    path, mesh = Path(path), as_mesh(mesh)
    check_file(path)
    ending = file_ending(path)
    try:
        reader = _reader(path)
        with unpacked(path, ending) as (plain, limits):
            raw = read_guarded(reader, plain, limits)
            of_domains = reader is npz_maps and holds(plain, "X", "labels")
        if not raw.maps:
            raise InputError("no-values", "has no values at its vertices except coordinates")
        found, faults = _fitting(raw.described_maps, mesh, path)
        if of_domains:
            found, said_of_domains = labelled_domains(found, mesh)
            faults = (*faults, *said_of_domains)
    except InputError as fault:
        found_kind = misnamed(path, ending) or fault
        raise found_kind.of(path, "give a file with one number per vertex") from fault
    except PermissionError as fault:
        raise no_permission(path) from fault
    said = () if len(raw.vertices) else raw.remarks
    said = (*said, *_of_other_side(found, mesh, raw.structure, path))
    return found, tuple(f"{path} {remark}." for remark in (*said, *faults))


def _of_other_side(
    maps: tuple[VertexMap, ...], mesh: Mesh, structure: str, path: Path
) -> tuple[str, ...]:
    """Return a clause on a file, or else on maps by their names, of the other hemisphere."""
    here = brain_side(mesh.structure, mesh.name)
    other = {"left": "right", "right": "left"}.get(here or "")
    side = brain_side(structure, path.name, of_values=True)
    names = [each.name for each in maps if brain_side("", each.name, of_values=True) == other]
    if other is None or not (side == other or (side is None and names)):
        return ()
    stated = f"it states {structure}" if structure else "by its name"
    if side is None:
        stated = f"by the name {printable(', '.join(names), 60)}"
    return (f"is of the other hemisphere than {mesh.name}: {stated}",)


def _reader(path: Path) -> Reader:
    ending = file_ending(path).removesuffix(".gz")
    if ending in _BY_ENDING:
        return _BY_ENDING[ending]
    kind = freesurfer_kind(path)
    if ending in _VALUES or kind == "values":
        return freesurfer_values
    if kind == "patch":
        raise InputError("no-values", "is a FreeSurfer patch, a part of a surface without values")
    known = f"has an ending ({printable(ending, 40) or 'none'}) of no known format of maps"
    raise InputError("unknown-ending", known)


def _fitting(
    maps: tuple[RawMap, ...], mesh: Mesh, path: Path
) -> tuple[tuple[VertexMap, ...], tuple[str, ...]]:
    """Return maps with one value per vertex of the mesh or its file, and clauses on invalid ones.

    `InputError` is raised if no map is left.
    """
    lengths = {mesh.n_vertices, mesh.n_file_vertices}
    fitting = [each for each in maps if each.last >= 0 or len(each.values) in lengths]
    if not fitting and len(maps) in lengths:  # rows of an array of few vertices are maps
        maps = _transposed(maps)
        fitting = list(maps)
    found, faults, clauses = checked_maps(fitting or maps, max(lengths), path)
    if not fitting:
        if volume := maps[0].volume:
            raise InputError("wrong-shape", f"has the shape {volume} of a volume, not of a surface")
        _check_wall(maps[0], mesh, path)
        mesh.with_maps(*found)
    if not found or not fitting:
        raise faults[0]
    return named_apart(found), clauses


def _transposed(maps: tuple[RawMap, ...]) -> tuple[RawMap, ...]:
    """Return a map for each row of columns of equal lengths, or the columns if lengths differ."""
    if len({len(each.values) for each in maps}) > 1:
        return maps
    rows = np.stack([each.values for each in maps], axis=1)
    return tuple(
        replace(maps[0], name=f"row {at}", values=values) for at, values in enumerate(rows)
    )


def _check_wall(found: RawMap, mesh: Mesh, path: Path) -> None:
    """Raise `InputError` if the map of a brain may be without the vertices of the medial wall."""
    count, n = len(found.values), mesh.n_file_vertices
    if brain_side(mesh.structure, mesh.name) is not None and _LEAST_CORTEX * n < count < n:
        raise InputError(
            "other-mesh",
            f"Map {found.name or path.name!r} has {count:,} values and the mesh {n:,} vertices, so"
            " it may be without the medial wall",
            "add the vertices of its values, with a mask that is True outside the wall, as in"
            f' np.savez("{path.name.split(".")[0]}.npz", vertex=np.flatnonzero(mask),'
            " values=values)",
        )
