"""Places of the faults counted by `Health`, and effects of repairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from meshmash_viewer.arrays import IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.health import Health, ambiguous_edges, first_at_place, repair_mesh
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.edges import (
    Edges,
    connected,
    edges_of,
    join_seams,
    side_codes,
    winding_of,
)
from meshmash_viewer.units import counted


@dataclass(frozen=True, eq=False)
class FaultPlaces:
    """Points, edges or faces with a fault of one kind, in connected groups."""

    #: Vertices of each point, edge or face, shape (k, 1), (k, 2) or (k, 3).
    parts: IntArray
    #: Index of the group of each part, shape (k,), in descending order of size.
    groups: IntArray

    @property
    def n_groups(self) -> int:
        """Number of groups."""
        return int(self.groups.max(initial=-1)) + 1

    def group(self, index: int) -> IntArray:
        """Return the parts of a group."""
        return np.asarray(self.parts[self.groups == index])

    def describe(self, index: int) -> str:
        """Count the parts of a group: "12 edges"."""
        noun = ("vertex", "edge", "face")[self.parts.shape[1] - 1]
        return counted(len(self.group(index)), noun)


def fault_places(mesh: Mesh, fault: str) -> FaultPlaces:
    """Find the places of faults, given by the name of a count of `Health`.

    For ``n_components`` the places are the faces outside of the largest component, for coincident
    and seam vertices all vertices that coincide with another.

    Examples
    --------
    >>> box = trimesh.creation.box()
    >>> open_box = mv.Mesh(box.vertices, box.faces[2:])
    >>> places = fault_places(open_box, "boundary_edges")
    >>> places.n_groups, places.describe(0)
    (1, '4 edges')
    """
    parts = _PARTS[fault](mesh)
    used, numbers = np.unique(parts, return_inverse=True)
    numbers = numbers.reshape(parts.shape)
    if parts.shape[1] > 1:
        ends = [(numbers[:, 0], numbers[:, corner]) for corner in range(1, parts.shape[1])]
    else:  # points are connected by the sides of faces
        marked = np.full(mesh.n_vertices, -1)
        marked[used] = np.arange(len(used))
        corners = marked[mesh.faces]
        sides = np.stack([corners.ravel(), np.roll(corners, -1, axis=1).ravel()])
        sides = sides[:, (sides >= 0).all(axis=0)]
        ends = [(sides[0], sides[1])]
    rows, columns = (np.concatenate(each) for each in zip(*ends, strict=True))
    labels = connected(rows, columns, len(used))[numbers[:, 0]]
    _, labels, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return FaultPlaces(parts, rank[labels])


def repair_effect(mesh: Mesh, name: str, health: Health) -> str:
    """Describe what a repair would change: "drops 3 faces, opens 9 edges".

    `health` is the health of the mesh. Maps are not considered.
    """
    try:
        repaired = repair_mesh(mesh.with_only_maps(), name)
    except InputError as fault:
        return str(fault)
    n_vertices, n_faces = mesh.n_vertices - repaired.n_vertices, mesh.n_faces - repaired.n_faces
    merges = name.startswith("merge")
    components = health.n_components - 1 if name == "keep_largest_component" else 0
    opened = closed = 0
    if merges:
        closed = health.boundary_edges - len(_open(repaired))
    elif n_faces and not n_vertices:
        opened = len(np.setdiff1d(_open(repaired), _open(mesh)))
    counts = (
        ("drops", components, "component"),
        ("merges" if merges else "drops", n_vertices, "vertex"),
        ("drops", n_faces, "face"),
        ("turns", health.reversed_faces if name == "orient_faces" else 0, "face"),
        ("opens", opened, "edge"),
        ("closes", closed, "edge"),
    )
    said: list[str] = []
    before = ""
    for verb, count, noun in counts:
        if count:
            said.append(f"{'' if verb == before else verb} {counted(count, noun)}".strip())
            before = verb
    return ", ".join(said)


def _edges(mesh: Mesh) -> Edges:
    return edges_of(side_codes(mesh.proper_faces, mesh.n_vertices))


def _open(mesh: Mesh) -> IntArray:
    """Return the keys of boundary edges."""
    edges = _edges(mesh)
    return np.asarray(edges.keys[edges.counts == 1])


def _ends(keys: IntArray, mesh: Mesh) -> IntArray:
    """Return the two vertices of edges, shape (k, 2), from their keys."""
    return np.stack(np.divmod(keys, np.int64(mesh.n_vertices)), axis=1)


def _outside_largest(mesh: Mesh) -> IntArray:
    sizes = np.bincount(mesh.component_labels[mesh.referenced])
    faces = mesh.proper_faces
    return np.asarray(faces[mesh.component_labels[faces[:, 0]] != sizes.argmax()])


def _ambiguous(mesh: Mesh) -> IntArray:
    faces = mesh.proper_faces
    codes = side_codes(faces, mesh.n_vertices)
    edges = edges_of(codes)
    shared = edges.keys[edges.counts > 2]
    return _ends(ambiguous_edges(mesh.vertices, faces, codes >> 1, shared), mesh)


def _together(onto: IntArray) -> IntArray:
    """Return the vertices that are merged with another one, shape (k, 1)."""
    moved = onto != np.arange(len(onto))
    return np.unique(np.append(np.flatnonzero(moved), onto[moved]))[:, np.newaxis]


#: Function that returns the parts of `FaultPlaces`, by count of `Health`.
_PARTS: dict[str, Callable[[Mesh], IntArray]] = {
    "n_components": _outside_largest,
    "boundary_edges": lambda mesh: _ends(_open(mesh), mesh),
    "nonmanifold_edges": lambda mesh: _ends((each := _edges(mesh)).keys[each.counts > 2], mesh),
    "ambiguous_edges": _ambiguous,
    "degenerate_faces": lambda mesh: mesh.faces[mesh.degenerate_faces],
    "duplicate_faces": lambda mesh: mesh.faces[mesh.duplicate_faces],
    "disagreeing_edges": lambda mesh: _ends(winding_of(mesh).one_way, mesh),
    "unreferenced_vertices": lambda mesh: mesh.unreferenced[:, np.newaxis],
    "seam_vertices": lambda mesh: _together(join_seams(first_at_place(mesh), mesh.proper_faces)),
    "coincident_vertices": lambda mesh: _together(first_at_place(mesh)),
}
