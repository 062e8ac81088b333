"""The triangle mesh: vertices, faces and the unit of its coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import PurePath
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import (
    FileNumbering,
    IntArray,
    Triangles,
    check_size,
    checked_faces,
    checked_vertices,
    scaled_vertices,
)
from meshmash_viewer.errors import InputError
from meshmash_viewer.triangulation import polydata_triangles
from meshmash_viewer.units import (
    LENGTH_UNITS,
    MESH_UNITS,
    NO_VOXEL,
    Voxel,
    counted,
    is_voxel,
    named_vertex,
    written_unit,
)
from meshmash_viewer.vertex_map import VertexMap, named_apart

#: ``(vertices, faces)``, an object with these two attributes or with LaPy's ``v`` and ``t``, or a
#: pyvista ``PolyData``.
MeshLike: TypeAlias = Any

#: Attributes that hold the vertices and the faces of the mesh types of other packages.
_ATTRIBUTES = (("vertices", "faces"), ("vertices", "triangles"), ("v", "t"))
#: How objects that are no surface are converted to one.
_CONVERSIONS: tuple[tuple[Callable[[object], bool], str], ...] = (
    (lambda given: isinstance(given, (str, PurePath)), "Read a file with read_mesh."),
    (lambda given: hasattr(given, "extract_surface"), "Give mesh.extract_surface()."),
    (lambda given: hasattr(given, "to_mesh"), "Give scene.to_mesh()."),
    (lambda given: hasattr(given, "cells_dict"), 'Give mesh.points, mesh.cells_dict["triangle"].'),
)


@dataclass(frozen=True, eq=False)
class Mesh(Triangles):
    """A triangle mesh; neither array is changed after construction.

    It unpacks and indexes like the pair ``(vertices, faces)``. Two meshes are equal if vertices,
    faces and unit are: name, maps and what a file's numbers were multiplied by do not matter.

    `InputError` is raised if an array has the wrong shape, a coordinate is not finite, an index is
    out of range, there is no face, the faces have no area at all, the unit is unknown, the voxel
    has not three positive sizes, or a map is of another number of vertices.

    Parameters
    ----------
    vertices : ndarray of float64, shape (n, 3)
        Coordinates in `unit`. Copied, and read-only from then on.
    faces : ndarray of int64, shape (m, 3)
        Vertex indices of each triangle. Copied, and read-only from then on.
    unit : str
        One of `meshmash_viewer.units.LENGTH_UNITS`.
    name : str
        What people call it, usually the file's stem.
    voxel : tuple of three floats
        What the coordinates of its file were multiplied by to be `vertices`, see
        `meshmash_viewer.quantities.parse_unit`.
    maps : tuple of VertexMap
        Values per vertex that came with it or were added, see `with_maps`. They make no other mesh
        of it: `content_hash` does not know them.
    numbering : FileNumbering, optional
        What the vertices of its file have become, where a repair has left some out or merged some;
        None where both have the same. See `file_index`.
    structure : str
        The part of a brain it is, such as "CortexLeft"; "" for none, or not stated. See
        `meshmash_viewer.structures`.

    Examples
    --------
    >>> mesh = mv.Mesh([[0, 0, 0], [4, 0, 0], [0, 3, 0]], [[0, 1, 2]], unit="nm")
    >>> mesh
    <Mesh without a name: 3 vertices, 1 face, nm>
    >>> mesh.n_vertices, mesh.area
    (3, 6.0)
    >>> vertices, faces = mesh
    >>> mesh == mv.Mesh(vertices, faces, unit="nm"), mesh[1].tolist()
    (True, [[0, 1, 2]])
    """

    unit: str = ""
    name: str = ""
    voxel: Voxel = NO_VOXEL
    maps: tuple[VertexMap, ...] = ()
    numbering: FileNumbering | None = None
    structure: str = ""

    def __repr__(self) -> str:
        """Write it in one line, without its arrays."""
        unit = f", {written_unit(self.unit, self.voxel)}" if self.unit else ""
        size = f"{counted(self.n_vertices, 'vertex')}, {counted(self.n_faces, 'face')}"
        return f"<Mesh {self.name or 'without a name'}: {size}{unit}>"

    def __post_init__(self) -> None:
        vertices = checked_vertices(self.vertices)
        faces = checked_faces(self.faces, len(vertices))
        check_size(vertices, faces)
        vertices.flags.writeable = False
        faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "voxel", tuple(float(size) for size in self.voxel))
        object.__setattr__(self, "unit", _length_unit(self.unit))
        if not is_voxel(self.voxel):
            raise InputError(f"A voxel has three positive sizes, not {self.voxel!r}.")
        object.__setattr__(self, "maps", named_apart([self._fitted(each) for each in self.maps]))
        if not self.area > 0.0:
            raise InputError(
                "The faces have no area: all their vertices coincide or lie on lines. "
                "Check that the coordinates are those of a surface."
            )

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Vertices, then faces."""
        return iter((self.vertices, self.faces))

    def __getitem__(self, index: int | slice) -> Any:
        """Vertices for 0, faces for 1, as of the pair."""
        return (self.vertices, self.faces)[index]

    def __len__(self) -> int:
        """2, as of the pair."""
        return 2

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        return self.unit == other.unit and all(
            mine is theirs or np.array_equal(mine, theirs)
            for mine, theirs in zip(self, other, strict=True)
        )

    def __hash__(self) -> int:
        # not of the bytes: -0.0 and 0.0 are equal
        return hash((self.unit, self.vertices.shape, int(self.faces.sum())))

    def in_unit(self, unit: str) -> Mesh:
        """The same numbers said to be in another unit; what was derived from them is kept."""
        return self._with(unit=_length_unit(unit))

    def with_maps(self, *maps: VertexMap) -> Mesh:
        """The same mesh with more maps; one whose name is taken gets a number after it.

        `InputError` is raised if one has neither a value for each vertex nor for each that was
        read.
        """
        taken = [each.name for each in self.maps]
        more = named_apart([self._fitted(each) for each in maps], taken)
        return self._with(maps=self.maps + more)

    def map_named(self, name: str) -> VertexMap:
        """The map of a name.

        `InputError` is raised if there is none.
        """
        named = {each.name: each for each in self.maps}
        if name not in named:
            names = ", ".join(map(repr, named)) or "none"
            raise InputError(f"The mesh has no map {name!r}: its maps are {names}.")
        return named[name]

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """What others have derived from vertices and faces, and keep with them."""
        return {}

    def without_map(self, name: str) -> Mesh:
        """The same mesh without the map of a name."""
        return self._with(maps=tuple(each for each in self.maps if each.name != name))

    def with_only_maps(self, *maps: VertexMap) -> Mesh:
        """The same mesh with these maps instead of its own."""
        return self._with(maps=()).with_maps(*maps)

    def with_changed_map(self, changed: VertexMap) -> Mesh:
        """The same mesh with another map in the place of the one of its name."""
        maps = (changed if each.name == changed.name else each for each in self.maps)
        return self._with(maps=tuple(maps))

    def _fitted(self, given: VertexMap) -> VertexMap:
        """A map of these vertices, of one of these or of all that were read."""
        if given.n_vertices == self.n_vertices:
            return given
        if self.numbering is not None and given.n_vertices == self.n_file_vertices:
            return given.at(self.numbering.in_file)
        raise InputError(
            f"Map {given.name!r} has {given.n_vertices:,} values and the mesh"
            f" {self.n_vertices:,} vertices: give the one that was made for this surface."
        )

    # -- the file's numbers ------------------------------------------------------------------

    @property
    def n_file_vertices(self) -> int:
        """Number of vertices of the mesh as it was read, before any repair."""
        return self.n_vertices if self.numbering is None else self.numbering.n_file

    @property
    def file_indices(self) -> IntArray:
        """Index of each vertex in the mesh file, before all repairs, shape (n,)."""
        return np.arange(self.n_vertices) if self.numbering is None else self.numbering.in_file

    def file_index(self, vertex: int) -> int:
        """The index in the file of one vertex: what is shown and exported of it."""
        return int(vertex if self.numbering is None else self.numbering.in_file[vertex])

    def vertex_of(self, file_index: int) -> int:
        """The vertex that one of the file is here, itself or the one that it was merged into.

        `InputError` is raised if the file has no such vertex, or a repair has left it out.

        Examples
        --------
        >>> corners = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0]]
        >>> mesh = mv.repair_mesh((corners, [[1, 2, 3]]), "drop_unreferenced_vertices")
        >>> mesh.file_index(0), mesh.vertex_of(3)
        (1, 2)
        """
        if not 0 <= file_index < self.n_file_vertices:
            raise InputError(
                f"There is no vertex {file_index}: they are counted from 0 to"
                f" {self.n_file_vertices - 1}."
            )
        here = file_index if self.numbering is None else int(self.numbering.here[file_index])
        if here < 0:
            raise InputError(
                f"Vertex {file_index} has been left out by a repair: choose another, or leave the"
                " repair."
            )
        return here

    def named_vertex(self, vertex: int) -> str:
        """Write which vertex one is, by its index in the file: "vertex 22,351"."""
        return named_vertex(self.file_index(vertex))

    def on_file(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Values of shape (n, ...) at all vertices of the file, shape (n_file, ...).

        NaN where a repair has left a vertex out; a vertex that was merged into another has the
        value of that one.
        """
        values = np.asarray(values)
        return values if self.numbering is None else self.numbering.whole(values)

    def masked(self, mask: npt.ArrayLike) -> Mesh:
        """The same vertices, with those faces only whose corners are all in a mask.

        The others are in no face then: results are NaN there, and the boundary of the mask is free.

        `InputError` is raised if it is not one bool a vertex, or has no whole face.

        Parameters
        ----------
        mask : array_like of bool, shape (n,)
            The vertices to keep.

        Examples
        --------
        >>> northern = mv.Mesh(ball.vertices, ball.faces).masked(ball.vertices[:, 2] >= 0.0)
        >>> northern.n_vertices, round(northern.area, 2)
        (642, 6.25)
        """
        kept = np.asarray(mask)
        if kept.dtype != np.bool_ or kept.shape != (self.n_vertices,):
            raise InputError(
                f"A mask is {self.n_vertices:,} bools, one a vertex, not {kept.dtype} of shape"
                f" {kept.shape}: make one with a comparison such as labels == 2, or from indices"
                " with np.isin(np.arange(n), indices)."
            )
        faces = self.faces[kept[self.faces].all(axis=1)]
        if not len(faces):
            raise InputError(
                f"The mask has {counted(int(kept.sum()), 'vertex')} and no whole face: give the"
                " vertices of a connected part."
            )
        return self if len(faces) == self.n_faces else replace(self, faces=faces)

    def like(self, whole: Mesh) -> Mesh:
        """The same part of a mesh (`masked`) with its present maps, unit and name."""
        return self._with(maps=whole.maps, unit=whole.unit, name=whole.name)

    def _with(self, **attributes: Any) -> Mesh:
        """Another one with some attributes that nothing is derived from."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__, **attributes)
        return mesh

    def in_voxels(self, voxel: Voxel, unit: str) -> Mesh:
        """The mesh of the same file whose voxels are of another size, given in `unit`."""
        if voxel == self.voxel:
            return self.in_unit(unit)
        # divided first: the numbers of the file come back, and with them what is stored for them
        vertices = scaled_vertices(self.vertices, voxel, self.voxel)
        return replace(self, vertices=vertices, unit=unit, voxel=voxel)

    def __getstate__(self) -> dict[str, Any]:
        """What goes to another process: derived arrays that are large are derived there.

        Components are sent: computing them holds the interpreter lock for a fifth of a second.
        """
        sent = [*(each.name for each in fields(self)), "content_hash", "area", "bounds"]
        labels = self.__dict__.get("component_labels")
        if labels is not None and labels.max() > 0:
            sent.append("component_labels")
        return {name: self.__dict__[name] for name in sent if name in self.__dict__}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.vertices.flags.writeable = False
        self.faces.flags.writeable = False


def as_mesh(mesh: MeshLike) -> Mesh:
    """Take a mesh in any of the accepted forms.

    These are a `Mesh` (returned as it is), a pair ``(vertices, faces)``, an object with attributes
    `vertices` and `faces` such as a ``trimesh.Trimesh``, `vertices` and `triangles` such as an
    Open3D ``TriangleMesh``, or `v` and `t` such as a LaPy ``TriaMesh``, and a pyvista ``PolyData``,
    whose polygons are triangulated. `InputError` is raised if it is none of these, or not a valid
    mesh (see `Mesh`).
    """
    if isinstance(mesh, Mesh):
        return mesh
    if hasattr(mesh, "GetPolys"):
        return Mesh(*polydata_triangles(mesh))
    for vertices, faces in _ATTRIBUTES:
        if hasattr(mesh, vertices) and hasattr(mesh, faces):
            return Mesh(getattr(mesh, vertices), getattr(mesh, faces))
    if isinstance(mesh, (tuple, list)) and len(mesh) == 2:
        from scipy.sparse import issparse

        if any(issparse(part) for part in mesh):
            raise InputError(
                "A pair of matrices (L, M) is not accepted here: give the mesh itself, "
                "as (vertices, faces)."
            )
        return Mesh(mesh[0], mesh[1])
    kind = type(mesh).__name__
    given = f"a {kind} of {len(mesh)}" if isinstance(mesh, (tuple, list)) else f"of type {kind}"
    hint = next((f" {text}" for is_kind, text in _CONVERSIONS if is_kind(mesh)), "")
    raise InputError(
        f"A mesh is a pair (vertices, faces) or an object with these two attributes, "
        f"not {given}.{hint}"
    )


def masked(mesh: MeshLike, mask: npt.ArrayLike | None) -> MeshLike:
    """Return `Mesh.masked` of a mesh in any of the accepted forms; without a mask as it is."""
    return mesh if mask is None else as_mesh(mesh).masked(mask)


def mask_text(part: MeshLike) -> str:
    """Describe the mask of a result of `Mesh.masked`: "of 331 of 642 vertices"."""
    mesh = as_mesh(part)
    n = mesh.n_vertices
    return f"of {n - len(mesh.unreferenced):,} of {counted(n, 'vertex')}"


def mesh_to_poly(mesh: MeshLike) -> Any:
    """Copy a mesh into a new pyvista ``PolyData``, ready to take per-vertex values.

    Parameters
    ----------
    mesh : MeshLike
        Any accepted form of a mesh.

    Returns
    -------
    pyvista.PolyData
        With the vertices in the same order; it shares no memory with `mesh`.

    Examples
    --------
    >>> poly = mv.mesh_to_poly(ball)
    >>> poly["height"] = poly.points[:, 2]
    >>> poly.n_points, poly.active_scalars_name
    (642, 'height')
    """
    import pyvista

    mesh = as_mesh(mesh)
    padded = np.empty((mesh.n_faces, 4), dtype=np.int64)
    padded[:, 0] = 3
    padded[:, 1:] = mesh.faces
    return pyvista.PolyData(mesh.vertices.copy(), padded.ravel())


def _length_unit(name: str) -> str:
    """Return the unit of `LENGTH_UNITS` with a name such as "um", or raise an `InputError`."""
    factor, unit = MESH_UNITS.get(name, (0.0, ""))
    if factor != 1.0:
        known = ", ".join(each or "none" for each in LENGTH_UNITS)
        raise InputError(f"{name!r} is not a unit a mesh can have: give one of {known}.")
    return unit
