"""Places of the faults counted by `Health`, and effects of repairs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from meshmash_viewer.arrays import IntArray, first_equal
from meshmash_viewer.errors import InputError
from meshmash_viewer.health import REPAIRS, ambiguous_edges, first_at_place
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.edges import (
    Edges,
    connected,
    edges_of,
    join_seams,
    side_codes,
    winding_of,
)
from meshmash_viewer.units import counted, format_share

#: Share of the area below which a difference is rounding.
_ROUNDING = 1e-12


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


def repair_effect(mesh: Mesh, name: str) -> str:
    """Describe what a repair would change, with shares: "drops 3 faces, opens 9 boundary edges".

    Maps are not considered.
    """
    try:
        repaired = REPAIRS[name].apply(mesh.with_only_maps())
    except InputError as fault:
        return str(fault)
    merges = name.startswith("merge")
    lost, n_turned = 1.0 - repaired.area / mesh.area, 0
    if name == "orient_faces":
        n_turned = int((repaired.faces != mesh.faces).any(axis=1).sum())
    change = "merges" if merges else "drops"
    n_vertices, n_faces = mesh.n_vertices - repaired.n_vertices, mesh.n_faces - repaired.n_faces
    n_components = mesh.n_components - repaired.n_components
    counts = (
        (change, n_components, f"{n_components:,} of {counted(mesh.n_components, 'component')}"),
        (change, n_vertices, _share(n_vertices, "vertex", mesh.n_vertices)),
        ("drops", n_faces, _share(n_faces, "face", mesh.n_faces)),
        ("drops", n_faces and lost > _ROUNDING, f"{format_share(lost)} of the area"),
        ("turns", n_turned, counted(n_turned, "face")),
        *_edge_changes(mesh, repaired, merges),
    )
    said: list[str] = []
    before = ""
    for verb, count, what in counts:
        if count > 0:
            said.append(what if verb == before else f"{verb} {what}")
            before = verb
    return ", ".join(said)


def _share(count: int, noun: str, total: int) -> str:
    return f"{counted(count, noun)} ({format_share(count / total)})"


def _edge_changes(mesh: Mesh, repaired: Mesh, merges: bool) -> list[tuple[str, int, str]]:
    """Count the boundary edges that a repair closes, or opens where faces were at both sides."""
    if merges:
        verb, count = "closes", len(_open(mesh)) - len(_open(repaired))
    else:
        places = first_equal(np.concatenate([mesh.vertices, repaired.vertices]) + 0.0)
        before = edges_of(side_codes(places[mesh.proper_faces], len(places)))
        corners = places[mesh.n_vertices + repaired.proper_faces]
        after = edges_of(side_codes(corners, len(places)))
        left = after.keys[after.counts == 1]
        verb, count = "opens", int(np.isin(left, before.keys[before.counts > 1]).sum())
    return [(verb, count, counted(count, "boundary edge"))]


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
