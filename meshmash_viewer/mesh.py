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
    check_vertex,
    checked_faces,
    checked_vertices,
    scaled_vertices,
)
from meshmash_viewer.errors import InputError, unknown
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
#: Tests for types that are not accepted, and how to convert them.
_CONVERSIONS: tuple[tuple[Callable[[object], bool], str], ...] = (
    (lambda given: isinstance(given, (str, PurePath)), "read a file with read_mesh"),
    (lambda given: hasattr(given, "extract_surface"), "give mesh.extract_surface()"),
    (lambda given: hasattr(given, "to_mesh"), "give scene.to_mesh()"),
    (lambda given: hasattr(given, "shape"), "give both arrays as one argument, (vertices, faces)"),
    (lambda given: hasattr(given, "cells_dict"), 'give mesh.points, mesh.cells_dict["triangle"]'),
    (lambda given: True, "give (vertices, faces), or an object with these two attributes"),
)


@dataclass(frozen=True, eq=False)
class Mesh(Triangles):
    """A triangle mesh with read-only arrays.

    It unpacks and indexes like the pair ``(vertices, faces)``. Two meshes are equal if vertices,
    faces and unit are equal; name, voxel size and maps are not compared.

    `InputError` is raised if an array has the wrong shape, a coordinate is not finite, an index is
    out of range, there is no face, the faces have no area, the unit is unknown, the voxel
    does not have three positive sizes, or a map has another number of values.

    Parameters
    ----------
    vertices : ndarray of float64, shape (n, 3)
        Coordinates in `unit`, copied.
    faces : ndarray of int64, shape (m, 3)
        Vertex indices of each triangle, copied.
    unit : str
        One of `meshmash_viewer.units.LENGTH_UNITS`.
    name : str
        Displayed name, usually the stem of the file.
    voxel : tuple of three floats
        Factors by which the coordinates of the file were multiplied to give `vertices`, see
        `meshmash_viewer.quantities.parse_unit`.
    maps : tuple of VertexMap
        Values per vertex, from the file or added with `with_maps`; not part of `content_hash`.
    numbering : FileNumbering, optional
        Map from the vertices of the file to those of the mesh, if a repair has removed or merged
        vertices. See `file_index`.
    structure : str
        Brain structure, such as "CortexLeft"; "" for none, or not stated. See
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
        object.__setattr__(self, "unit", _length_unit(self.unit))
        try:
            voxel = tuple(float(size) for size in self.voxel)
        except (TypeError, ValueError):
            voxel = ()
        if not is_voxel(voxel):
            raise InputError("out-of-range", f"voxel is {self.voxel}", "give three positive sizes")
        object.__setattr__(self, "voxel", voxel)
        object.__setattr__(self, "maps", named_apart([self._fitted(each) for each in self.maps]))
        if not self.area > 0.0:
            raise InputError(
                "no-area",
                "The faces have no area, all their vertices coincide or lie on lines",
                "check that the coordinates are those of a surface",
            )

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Iterate over the vertices and the faces."""
        return iter((self.vertices, self.faces))

    def __getitem__(self, index: int | slice) -> Any:
        """Return the vertices for index 0, the faces for 1."""
        return (self.vertices, self.faces)[index]

    def __len__(self) -> int:
        """Return 2, the length of the pair."""
        return 2

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        return self.unit == other.unit and all(
            mine is theirs or np.array_equal(mine, theirs)
            for mine, theirs in zip(self, other, strict=True)
        )

    def __hash__(self) -> int:
        # not a hash of bytes, which differ between -0.0 and 0.0
        return hash((self.unit, self.vertices.shape, int(self.faces.sum())))

    def in_unit(self, unit: str) -> Mesh:
        """Return the mesh with the same coordinates in another unit; derived arrays are kept."""
        return self._with(unit=_length_unit(unit))

    def with_maps(self, *maps: VertexMap) -> Mesh:
        """Return the mesh with more maps; a number is appended to names in use.

        `InputError` is raised if a map has a value neither for each vertex nor for each vertex of
        the file.
        """
        taken = [each.name for each in self.maps]
        more = named_apart([self._fitted(each) for each in maps], taken)
        return self._with(maps=self.maps + more)

    def map_named(self, name: str) -> VertexMap:
        """Return the map of a name; `InputError` is raised if there is none."""
        named = {each.name: each for each in self.maps}
        if name not in named:
            raise unknown("map", name, map(repr, named))
        return named[name]

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """Cache of results that other modules derive from vertices and faces."""
        return {}

    def without_map(self, name: str) -> Mesh:
        """Return the mesh without the map of a name."""
        return self._with(maps=tuple(each for each in self.maps if each.name != name))

    def with_only_maps(self, *maps: VertexMap) -> Mesh:
        """Return the mesh with these maps instead of its own."""
        return self._with(maps=()).with_maps(*maps)

    def with_changed_map(self, changed: VertexMap) -> Mesh:
        """Return the mesh with a map that replaces the map of the same name."""
        maps = (changed if each.name == changed.name else each for each in self.maps)
        return self._with(maps=tuple(maps))

    def _fitted(self, given: VertexMap) -> VertexMap:
        """Return a map at the vertices of this mesh, from a map of the mesh or of its file."""
        if given.n_vertices == self.n_vertices:
            return given
        if self.numbering is not None and given.n_vertices == self.n_file_vertices:
            return given.at(self.numbering.in_file)
        values, vertices = counted(given.n_vertices, "value"), counted(self.n_vertices, "vertex")
        fault = f"Map {given.name!r} has {values} and the mesh {vertices}"
        raise InputError("other-mesh", fault, "give a map that was made for this surface")

    # -- indices in the file -----------------------------------------------------------------

    @property
    def n_file_vertices(self) -> int:
        """Number of vertices in the file, before any repair."""
        return self.n_vertices if self.numbering is None else self.numbering.n_file

    @property
    def file_indices(self) -> IntArray:
        """Index of each vertex in the file, shape (n,)."""
        return np.arange(self.n_vertices) if self.numbering is None else self.numbering.in_file

    def file_index(self, vertex: int) -> int:
        """Return the index of a vertex in the file, which is displayed and exported."""
        return int(vertex if self.numbering is None else self.numbering.in_file[vertex])

    def vertex_of(self, file_index: int) -> int:
        """Return the vertex of an index in the file; for a merged vertex, the remaining one.

        `InputError` is raised if the file has no such vertex, or a repair has removed it.

        Examples
        --------
        >>> corners = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0]]
        >>> mesh = mv.repair_mesh((corners, [[1, 2, 3]]), "drop_unreferenced_vertices")
        >>> mesh.file_index(0), mesh.vertex_of(3)
        (1, 2)
        """
        check_vertex(file_index, self.n_file_vertices)
        here = file_index if self.numbering is None else int(self.numbering.here[file_index])
        if here < 0:
            fault = f"Vertex {file_index} was removed by a repair"
            raise InputError("vertex-unused", fault, "choose another vertex, or omit the repair")
        return here

    def named_vertex(self, vertex: int) -> str:
        """Return the displayed name of a vertex, with its index in the file: "vertex 22,351"."""
        return named_vertex(self.file_index(vertex))

    def on_file(self, values: npt.ArrayLike) -> npt.NDArray[Any]:
        """Expand values of shape (n, ...) to all vertices of the file, shape (n_file, ...).

        Vertices that a repair has removed have NaN, merged vertices the same value.
        """
        values = np.asarray(values)
        return values if self.numbering is None else self.numbering.whole(values)

    def masked(self, mask: npt.ArrayLike) -> Mesh:
        """Return the mesh with only the faces whose corners are all in a mask.

        The vertices are the same. Results are NaN outside of the mask; its boundary is free.

        `InputError` is raised if the mask is not one bool per vertex, or contains no whole face.

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
                "wrong-shape",
                f"A mask has type {kept.dtype} and shape {kept.shape}",
                f"give {self.n_vertices:,} bools: labels == 2, or np.isin(np.arange(n), indices)",
            )
        faces = self.faces[kept[self.faces].all(axis=1)]
        if not len(faces):
            fault = f"The mask has {counted(int(kept.sum()), 'vertex')} and no whole face"
            raise InputError("no-faces", fault, "give the vertices of a connected part")
        return self if len(faces) == self.n_faces else replace(self, faces=faces)

    def like(self, whole: Mesh) -> Mesh:
        """Return this part of a mesh (see `masked`) with the maps, unit and name of `whole`."""
        return self._with(maps=whole.maps, unit=whole.unit, name=whole.name)

    def _with(self, **attributes: Any) -> Mesh:
        """Copy the mesh, its derived arrays included, with changed attributes."""
        mesh = object.__new__(Mesh)
        mesh.__dict__.update(self.__dict__, **attributes)
        return mesh

    def in_voxels(self, voxel: Voxel, unit: str) -> Mesh:
        """Return the mesh of the same file with another voxel size, in `unit`."""
        if voxel == self.voxel:
            return self.in_unit(unit)
        # divided first, which restores the coordinates of the file, and so their hash
        vertices = scaled_vertices(self.vertices, voxel, self.voxel)
        return replace(self, vertices=vertices, unit=unit, voxel=voxel)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes to pickle, without large derived arrays except components.

        Computing the components again would block the window for a fifth of a second.
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
    """Convert any accepted form of a mesh to a `Mesh`.

    Accepted are a `Mesh` (returned unchanged), a pair ``(vertices, faces)``, an object with
    attributes `vertices` and `faces` such as a ``trimesh.Trimesh``, `vertices` and `triangles` such
    as an Open3D ``TriangleMesh``, or `v` and `t` such as a LaPy ``TriaMesh``, and a pyvista
    ``PolyData``, whose polygons are triangulated. `InputError` is raised for other objects and
    invalid meshes (see `Mesh`).
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
            remedy = "give the mesh itself, as (vertices, faces)"
            raise InputError("wrong-type", "A pair of matrices (L, M) is not a mesh", remedy)
        return Mesh(mesh[0], mesh[1])
    kind = type(mesh).__name__
    given = f"a {kind} of {len(mesh)}" if isinstance(mesh, (tuple, list)) else f"of type {kind}"
    remedy = next(text for is_kind, text in _CONVERSIONS if is_kind(mesh))
    raise InputError("wrong-type", f"A mesh is a pair of arrays, not {given}", remedy)


def masked(mesh: MeshLike, mask: npt.ArrayLike | None) -> MeshLike:
    """Return `Mesh.masked` of any form of a mesh, or the mesh unchanged without a mask."""
    return mesh if mask is None else as_mesh(mesh).masked(mask)


def mask_text(part: MeshLike) -> str:
    """Describe the mask of a result of `Mesh.masked`: "of 331 of 642 vertices"."""
    mesh = as_mesh(part)
    n = mesh.n_vertices
    return f"of {n - len(mesh.unreferenced):,} of {counted(n, 'vertex')}"


def mesh_to_poly(mesh: MeshLike) -> Any:
    """Copy a mesh into a new pyvista ``PolyData``, to which values can be added.

    Parameters
    ----------
    mesh : MeshLike
        Any accepted form of a mesh.

    Returns
    -------
    pyvista.PolyData
        Copy with the same order of vertices, which shares no memory with `mesh`.

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
        raise unknown("unit of a mesh", name, (each or "none" for each in LENGTH_UNITS))
    return unit
