"""Content of mesh files before any check, which readers return, and its conversion to maps."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.io.provenance import stated_units
from meshmash_viewer.mesh import MeshLike, as_mesh
from meshmash_viewer.vertex_map import COLOR, Label, VertexMap, labels_in_use, unused_number

#: Maps that are taken of one file.
MOST_MAPS = 64
#: Colour of a label whose file has another text there.
_NO_COLOR = "#808080"


@dataclass(frozen=True)
class RawMap:
    """Values per vertex as a file has them, before any check."""

    #: "" for that of the file.
    name: str
    #: Shape (n,).
    values: npt.NDArray[Any]
    #: One without a name has that of the map.
    labels: tuple[Label, ...] = ()
    #: Shape (n,): The vertices of the mesh's file that the values are of; None for all of them.
    rows: IntArray | None = None
    #: Whether labels without a vertex are kept; tables of other programs have hundreds of them.
    keep_unused: bool = False
    #: The shape that the values have in the file, where it may be that of a volume.
    volume: tuple[int, ...] = ()
    #: Unit of the values, "" if it is not stated.
    unit: str = ""

    @property
    def last(self) -> int:
        """The last vertex that it names; -1 where it names none."""
        return -1 if self.rows is None else int(self.rows.max())

    def checked(self, n_vertices: int, path: Path | None = None) -> VertexMap:
        """Convert to a map of a mesh with n vertices, as a rule without unused labels.

        `InputError` is raised as by `VertexMap`, and if it names a vertex that does not exist.
        """
        name = self.name or (path.name if path else "")
        origin = str(path.absolute()) if path else ""
        if self.last >= n_vertices:
            raise InputError(
                f"Map {name!r} names vertex {self.last:,}, and the mesh has {n_vertices:,}"
                " vertices: give the one that was made for this surface."
            )
        values, labels = self.values, self.labels
        if self.rows is not None:
            values = np.full(n_vertices, unused_number(labels) if labels else np.nan)
            values[self.rows] = self.values
        used = labels if self.keep_unused else labels_in_use(labels, values)
        if labels and not used:
            raise InputError(f"Map {name!r} has no vertex with a label: export it again.")
        labels = tuple(
            replace(
                label,
                name=label.name or name,
                color=label.color if COLOR.fullmatch(label.color) else _NO_COLOR,
            )
            for label in used
        )
        return VertexMap(name, values, labels, self.unit, path=origin)


def checked_maps(
    maps: Iterable[RawMap], n_vertices: int, path: Path | None = None
) -> tuple[list[VertexMap], list[InputError], tuple[str, ...]]:
    """Convert to maps; return these, the faults of the others, and a clause on each fault."""
    found, faults = [], []
    for each in maps:
        try:
            found.append(each.checked(n_vertices, path))
        except InputError as fault:
            faults.append(fault)
    clauses = (str(fault).removeprefix("Map ").removesuffix(".") for fault in faults)
    return found, faults, tuple(f"has a map that is left out: {clause}" for clause in clauses)


def maps_of_columns(
    values: npt.NDArray[Any], names: Sequence[str], rows: IntArray | None = None
) -> Iterator[RawMap]:
    """Make a map of each column of values, shape (n, columns)."""
    for name, column in zip(names, values.T, strict=True):
        yield RawMap(name, np.ascontiguousarray(column), rows=rows)


def are_ascending_indices(values: npt.NDArray[Any]) -> bool:
    """Whether an array holds whole numbers from 0, each larger than the one before."""
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        return False
    whole = np.isfinite(values).all() and np.array_equal(values, np.floor(values))
    return bool(whole and (values[:1] >= 0).all() and (values[1:] > values[:-1]).all())


@dataclass(frozen=True)
class RawMesh:
    """What a file holds, before any check; a file of maps alone has no vertices and no faces."""

    #: Shape (n, 3): Coordinates as written in the file.
    vertices: FloatArray
    #: Shape (m, 3): Vertex indices, counted from zero; they may be out of range.
    faces: IntArray
    #: The unit the format or the file states; None where it states none.
    unit: str | None = None
    #: What it has at each vertex besides.
    maps: tuple[RawMap, ...] = ()
    #: What was left out of the file, as clauses that follow its name: "holds 12 lines, which are
    #: left out".
    remarks: tuple[str, ...] = ()
    #: The part of a brain that the file says it is of, "" if it does not.
    structure: str = ""
    #: What our own exports say of it, see `io.provenance`.
    meta: str = ""

    @property
    def maps_in_units(self) -> tuple[RawMap, ...]:
        """The maps, with the units that our own exports state."""
        units = stated_units(self.meta)
        return tuple(replace(each, unit=units.get(each.name, each.unit)) for each in self.maps)


def maps_alone(maps: Iterable[RawMap], remarks: tuple[str, ...] = (), meta: str = "") -> RawMesh:
    """What a file holds that has no mesh."""
    no_vertices, no_faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    return RawMesh(no_vertices, no_faces, maps=tuple(maps), remarks=remarks, meta=meta)


def read_raw(reader: Callable[[Path], RawMesh | MeshLike], path: Path) -> RawMesh:
    """Call a reader; mesh warnings become remarks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", MeshWarning)
        raw = raw_mesh(reader(path))
    said = tuple(f"has a fault: {each.message}" for each in caught)
    return replace(raw, remarks=(*raw.remarks, *said)) if said else raw


def raw_mesh(given: RawMesh | MeshLike) -> RawMesh:
    """What a reader gives: those of plug-ins give a mesh in any accepted form."""
    if isinstance(given, RawMesh):
        return given
    mesh = as_mesh(given)
    maps = tuple(RawMap(each.name, each.values, each.labels, unit=each.unit) for each in mesh.maps)
    return RawMesh(mesh.vertices, mesh.faces, mesh.unit or None, maps, structure=mesh.structure)
