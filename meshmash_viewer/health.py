"""Health of a mesh: counts of its faults, and their repairs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FileNumbering, FloatArray, IntArray, first_equal
from meshmash_viewer.errors import InputError, MeshWarning, of_mesh, unknown
from meshmash_viewer.mesh import Mesh, MeshLike, as_mesh
from meshmash_viewer.surface.edges import (
    connected,
    count_connected,
    edges_of,
    join_seams,
    side_codes,
    winding_of,
)
from meshmash_viewer.units import counted, format_share
from meshmash_viewer.vertex_map import VertexMap

#: Angle (rad) below which two faces at an edge have the same direction, above rounding.
_SAME_DIRECTION = 1e-9
#: Distance of vertices at one place, relative to the shortest open edges at both.
_ROUNDING = 1e-5


@dataclass(frozen=True, slots=True)
class Health:
    """Sizes and counts of faults of a mesh; plain numbers, so ``dataclasses.asdict`` gives JSON."""

    n_vertices: int
    n_faces: int
    #: Connected components; faces that share a vertex are connected.
    n_components: int
    #: Number of vertices of the largest component.
    largest_component: int
    #: Area of the largest component.
    largest_area: float
    #: Components, if those with an edge at the same place counted as one; and if only those did
    #: that the repair merge_seams joins.
    untouching_components: int
    unseamed_components: int
    #: Edges of one face only.
    boundary_edges: int
    #: Edges of more than two faces.
    nonmanifold_edges: int
    #: Non-manifold edges with two faces in the same direction (duplicate or folded faces) or a face
    #: without area, at which the robust Laplacian depends on the order of the faces.
    ambiguous_edges: int
    #: Faces with a repeated corner or, up to rounding, no area.
    degenerate_faces: int
    #: Faces with the three vertices of an earlier face, in any order.
    duplicate_faces: int
    #: Edges of two faces with inconsistent orientation.
    disagreeing_edges: int
    #: Faces that the repair orient_faces flips to make orientations consistent. A one-sided surface
    #: such as a Möbius strip has disagreeing edges, but no reversed faces.
    reversed_faces: int
    #: Vertices that no face with three different corners uses.
    unreferenced_vertices: int
    #: Vertices at the place of an earlier vertex, see `first_at_place`.
    coincident_vertices: int
    #: Coincident vertices on seams, which the repair merge_seams joins.
    seam_vertices: int
    #: Area of the surface, in squared unit of the mesh.
    area: float


@dataclass(frozen=True, slots=True)
class Repair:
    """A repair of a mesh."""

    #: Label of the button.
    label: str
    #: Function that returns the number of faults to correct.
    count: Callable[[Health], int]
    #: Function that returns the repaired mesh.
    apply: Callable[[Mesh], Mesh]


def mesh_health(mesh: MeshLike) -> Health:
    """Count the faults of a mesh; edges of faces with a repeated corner are ignored.

    Examples
    --------
    >>> health = mv.mesh_health(trimesh.creation.box())
    >>> health.n_components, health.boundary_edges, health.area
    (1, 0, 6.0)
    """
    mesh = as_mesh(mesh)
    faces = mesh.faces[mesh.distinct_corners]
    codes = side_codes(faces, mesh.n_vertices)
    edges = edges_of(codes)
    shared = edges.keys[edges.counts > 2]
    winding = winding_of(mesh, edges)
    places = first_at_place(mesh)
    joined = join_seams(places, faces)
    labels, n_components = mesh.component_labels, mesh.n_components
    sizes = np.bincount(labels[mesh.referenced])
    touching = _touching(places[faces], labels[faces[:, 0]])
    moved = np.flatnonzero(joined != np.arange(mesh.n_vertices))
    on_largest = labels[mesh.faces[:, 0]] == sizes.argmax()
    return Health(
        n_vertices=mesh.n_vertices,
        n_faces=mesh.n_faces,
        n_components=n_components,
        largest_component=int(sizes.max()),
        largest_area=float(mesh.face_areas[on_largest].sum()),
        untouching_components=count_connected(*touching, n_components),
        unseamed_components=count_connected(labels[moved], labels[joined[moved]], n_components),
        boundary_edges=int((edges.counts == 1).sum()),
        nonmanifold_edges=len(shared),
        ambiguous_edges=len(ambiguous_edges(mesh.vertices, faces, codes >> 1, shared)),
        degenerate_faces=int(mesh.degenerate_faces.sum()),
        duplicate_faces=int(mesh.duplicate_faces.sum()),
        disagreeing_edges=len(winding.one_way),
        reversed_faces=int(winding.reversed_faces.sum()),
        unreferenced_vertices=len(mesh.unreferenced),
        coincident_vertices=_moved(places),
        seam_vertices=len(moved),
        area=mesh.area,
    )


def first_repair(name: str, health: Health) -> str:
    """Return the repair to make before, or else in place of, the repair `name`: its own or a merge.

    Components that touch along edges are parts of one surface, and dropping all but the largest
    would lose most of it: they are merged first.
    """
    if name != "keep_largest_component" or health.untouching_components == health.n_components:
        return name
    by_seams = health.unseamed_components <= health.untouching_components
    return "merge_seams" if by_seams else "merge_coincident_vertices"


def described_components(health: Health) -> str:
    """Return sentences on the largest component, and on components that touch."""
    shares = health.largest_component / health.n_vertices, health.largest_area / health.area
    vertices, area = map(format_share, shares)
    said = f"The largest has {vertices} of the vertices and {area} of the area"
    left = counted(health.untouching_components, "component")
    touch = f"; components touch, merging leaves {left}"
    return said + (touch if health.untouching_components < health.n_components else "")


def _touching(corners: IntArray, labels: IntArray) -> tuple[IntArray, IntArray]:
    """Return the `labels` of faces with an edge at the same place; `corners` are their places."""
    keys = side_codes(corners, int(corners.max(initial=0)) + 1) >> 1
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    of_side = labels[order // 3]
    return of_side[same], of_side[same + 1]


def listed_repairs(names: Sequence[str]) -> str:
    """Return the labels of repairs: "Merge coincident vertices, Drop …"."""
    return ", ".join(REPAIRS[name].label if name in REPAIRS else name for name in names)


def repair_mesh(mesh: MeshLike, *names: str) -> Mesh:
    """Repair a mesh.

    `InputError` is raised if a repair does not exist or would leave no face.

    Parameters
    ----------
    mesh : MeshLike
        The mesh.
    *names : str
        Keys of `REPAIRS`, applied in this order.

    Returns
    -------
    Mesh
        The repaired mesh; remaining vertices keep their order.

    Warns
    -----
    MeshWarning
        If "keep_largest_component" drops components that touch the others along edges.

    Examples
    --------
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]]
    >>> mesh = mv.Mesh(corners, [[0, 1, 2]])
    >>> mv.repair_mesh(mesh, "drop_unreferenced_vertices").n_vertices
    3
    """
    repaired = as_mesh(mesh)
    for name in names:
        if name not in REPAIRS:
            raise unknown("repair", name, REPAIRS)
        if name == "keep_largest_component" and repaired.n_components > 1:
            _warn_of_touching(repaired)
        repaired = REPAIRS[name].apply(repaired)
    return repaired


def _warn_of_touching(mesh: Mesh) -> None:
    if not _moved(first_at_place(mesh)):
        return
    health = mesh_health(mesh)
    first = first_repair("keep_largest_component", health)
    if first != "keep_largest_component":
        warnings.warn(
            f"{of_mesh(mesh.name)}keep_largest_component leaves"
            f" {format_share(health.largest_area / health.area)} of the area, as components touch:"
            f" repair with {first} before it, which joins {health.n_components:,} components to"
            f" {health.untouching_components:,}.",
            MeshWarning,
            stacklevel=3,
        )


def largest_component(mesh: MeshLike) -> Mesh:
    """Return the connected component with the most vertices as a mesh.

    Examples
    --------
    >>> both = [trimesh.creation.icosphere(1), trimesh.creation.box()]
    >>> two = trimesh.util.concatenate(both)
    >>> len(two.vertices), mv.largest_component(two).n_vertices
    (50, 42)
    """
    return repair_mesh(mesh, "keep_largest_component")


def median_edge_length(mesh: MeshLike) -> float:
    """Return the median length of the edges of the triangles, in unit of the mesh.

    The shortest wavelength that a mesh resolves is two edges long.
    """
    mesh = as_mesh(mesh)
    corners = mesh.vertices[mesh.faces[mesh.distinct_corners]]
    return float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))


def ambiguous_edges(
    vertices: FloatArray, faces: IntArray, keys: IntArray, edges: IntArray
) -> IntArray:
    """Return the `edges`, sorted keys, around which the faces have no unique order by angle.

    `keys` are the edges of sides 01, 12 and 20 of each face, shape (3 m,).
    """
    sides = np.flatnonzero(np.isin(keys, edges))
    face, side = np.divmod(sides, 3)
    tail, tip = np.divmod(keys[sides], np.int64(len(vertices)))
    along = _unit(vertices[tip] - vertices[tail])
    # two directions perpendicular to the edge
    least = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = _unit(np.cross(along, least))
    second = np.cross(along, first)
    out = _unit(vertices[faces[face, (side + 2) % 3]] - vertices[tail])
    x, y = (np.einsum("ij,ij->i", out, axis) for axis in (first, second))
    angle = np.arctan2(y, x)
    order = np.lexsort((angle, keys[sides]))
    edge, angle = np.searchsorted(edges, keys[sides][order]), angle[order]
    starts = np.flatnonzero(np.diff(edge, prepend=-1))
    following = np.arange(1, len(edge) + 1)
    following[np.append(starts[1:], len(edge))[: len(starts)] - 1] = starts
    gap = (angle[following] - angle) % (2.0 * np.pi)
    equal = np.minimum(gap, 2.0 * np.pi - gap) < _SAME_DIRECTION
    flat = np.hypot(x, y)[order] < _SAME_DIRECTION
    return np.asarray(edges[np.unique(edge[equal | flat])])


def _unit(vectors: FloatArray) -> FloatArray:
    """Normalise vectors in place, except those of length zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=vectors, where=length > 0.0))


def first_at_place(mesh: Mesh) -> IntArray:
    """Return, for each vertex, the lowest index of a vertex at its place, shape (n,).

    Vertices with the same coordinates are at one place, and so are vertices of open edges that
    differ by rounding.
    """
    from scipy.spatial import KDTree

    places = first_equal(mesh.vertices + 0.0)  # + 0.0 makes -0.0 equal to 0.0
    n, edges = (
        mesh.n_vertices,
        edges_of(side_codes(mesh.faces[mesh.distinct_corners], mesh.n_vertices)),
    )
    ends = np.column_stack(np.divmod(edges.keys[edges.counts == 1], n))
    if not len(ends):
        return places
    lengths = np.linalg.norm(np.subtract(*mesh.vertices[ends.T]), axis=1)
    shortest = np.full(n, np.inf)
    np.minimum.at(shortest, ends, lengths[:, None])
    used = np.unique(ends)
    tree = KDTree(mesh.vertices[used])
    first, second = used[tree.query_pairs(_ROUNDING * np.median(lengths), output_type="ndarray")].T
    apart = np.linalg.norm(mesh.vertices[first] - mesh.vertices[second], axis=1)
    near = apart <= _ROUNDING * np.minimum(shortest[first], shortest[second])
    near &= places[first] != places[second]
    if not near.any():
        return places
    labels = connected(places[first[near]], places[second[near]], n)
    return np.asarray(np.unique(labels, return_index=True)[1][labels][places])


def _moved(onto: IntArray) -> int:
    """Count the vertices that would be merged into another one."""
    return int((onto != np.arange(len(onto))).sum())


def _with_faces(mesh: Mesh, kept: npt.NDArray[np.bool_]) -> Mesh:
    if not kept.any():
        raise InputError("no-faces", "This repair would leave no face", "keep the mesh as it is")
    return replace(mesh, faces=mesh.faces[kept])


def _without_vertices(mesh: Mesh, onto: IntArray, faces: IntArray) -> Mesh:
    """Remove vertices of a mesh, and renumber the remaining ones and `faces`.

    `onto`, shape (n,), is the vertex itself, the vertex into which it is merged, or -1 if removed.
    """
    kept = onto == np.arange(mesh.n_vertices)
    if kept.all():
        return replace(mesh, faces=faces)
    number = np.cumsum(kept) - 1
    here = np.where(onto >= 0, number[onto], -1)
    numbering = FileNumbering(here) if mesh.numbering is None else mesh.numbering.then(here)
    return replace(
        mesh,
        vertices=mesh.vertices[kept],
        faces=here[faces],
        maps=_maps_left(mesh, kept),
        numbering=numbering,
    )


def _maps_left(mesh: Mesh, kept: npt.NDArray[np.bool_]) -> tuple[VertexMap, ...]:
    """Return the maps at kept vertices; leave out maps without a value there, with a warning."""
    maps, lost = list[VertexMap](), list[str]()
    for each in mesh.maps:
        try:
            maps.append(each.at(kept))
        except InputError:
            lost.append(each.name)
    if lost:
        what, has = ("map", "has") if len(lost) == 1 else ("maps", "have")
        warnings.warn(
            f"{of_mesh(mesh.name)}the {what} {', '.join(lost)} {has} no value at the vertices that"
            f" the repair keeps, and {'is' if len(lost) == 1 else 'are'} left out.",
            MeshWarning,
            stacklevel=4,
        )
    return tuple(maps)


def _merge_seams(mesh: Mesh) -> Mesh:
    onto = join_seams(first_at_place(mesh), mesh.faces[mesh.distinct_corners])
    return _without_vertices(mesh, onto, mesh.faces)


def _orient_faces(mesh: Mesh) -> Mesh:
    turned = winding_of(mesh).reversed_faces
    return replace(mesh, faces=np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces))


def _keep_largest_component(mesh: Mesh) -> Mesh:
    sizes = np.bincount(mesh.component_labels[mesh.referenced])
    kept = mesh.component_labels == int(sizes.argmax())
    faces = mesh.faces[mesh.distinct_corners]
    return _keep(mesh, kept, faces[kept[faces[:, 0]]])


def _keep(mesh: Mesh, kept: npt.NDArray[np.bool_], faces: IntArray) -> Mesh:
    """Return the mesh with the vertices of a mask, and `faces` between them."""
    return _without_vertices(mesh, np.where(kept, np.arange(mesh.n_vertices), -1), faces)


#: The repairs by name, in the order in which they are best applied.
REPAIRS: dict[str, Repair] = {
    "merge_seams": Repair(
        "Merge vertices of seams, where two open edges lie on one another",
        lambda health: health.seam_vertices,
        _merge_seams,
    ),
    "merge_coincident_vertices": Repair(
        "Merge all coincident vertices",
        lambda health: health.coincident_vertices,
        lambda mesh: _without_vertices(mesh, first_at_place(mesh), mesh.faces),
    ),
    "drop_degenerate_faces": Repair(
        "Drop degenerate faces",
        lambda health: health.degenerate_faces,
        lambda mesh: _with_faces(mesh, ~mesh.degenerate_faces),
    ),
    "drop_duplicate_faces": Repair(
        "Drop duplicate faces",
        lambda health: health.duplicate_faces,
        lambda mesh: _with_faces(mesh, ~mesh.duplicate_faces),
    ),
    "orient_faces": Repair(
        "Turn faces that look to another side than their neighbours",
        lambda health: health.reversed_faces,
        _orient_faces,
    ),
    "drop_unreferenced_vertices": Repair(
        "Drop unreferenced vertices",
        lambda health: health.unreferenced_vertices,
        # faces with a repeated corner may use unreferenced vertices
        lambda mesh: _keep(mesh, mesh.referenced, mesh.faces[mesh.distinct_corners]),
    ),
    "keep_largest_component": Repair(
        "Keep the largest component",
        lambda health: health.n_components - 1,
        _keep_largest_component,
    ),
}
