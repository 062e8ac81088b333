"""Division of the graph of a mesh into overlapping pieces of bounded size, along geodesics.

Every vertex is in the core of exactly one piece. A piece consists of its core and all vertices
within a given distance of the core, so that the cut does not affect results on the core.

Large components are first condensed into small cells (nearest seed by edge distance), then bisected
recursively: with two distant ends a and b, a vertex belongs to the half of a if d_a − d_b is small.
Both halves are connected: the half of a contains the shortest path from a to each of its vertices.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.edges import side_codes

Graph: TypeAlias = "sparse.csr_array[Any]"

#: Number of cells in a piece. More cells follow geodesics better; fewer are bisected faster.
_CELLS_PER_PIECE = 64
#: Number of cores that are widened to estimate the maximum size of cores.
_SAMPLES = 8
#: Smallest share of a piece to which cores are bisected to make room for the overlap. Where the
#: mesh is so dense that the overlap alone fills the piece, the overlap is narrower instead.
_SMALLEST_CORE = 0.25


class Piece(tuple[FloatArray, IntArray]):
    """``(vertices, faces)`` of a piece, with `faces` as indices into its vertices.

    `first`, shape (n_i,), is the square of the first eigenvector of the whole mesh at these
    vertices: one over the area of the first component on this component, and 0 on all others.
    """

    first: FloatArray


def edge_graph(mesh: Mesh) -> Graph:
    """Build the symmetric graph of edge lengths, shape (n, n), in the unit of `mesh`.

    Edges of zero length get a tiny positive length, because a stored zero is not an edge.
    """
    n = mesh.n_vertices
    keys = side_codes(mesh.proper_faces, n) >> 1
    keys.sort()
    keys = keys[np.diff(keys, prepend=-1) > 0]
    a, b = (each.astype(np.int32) for each in np.divmod(keys, n))
    lengths = np.sqrt(sum(np.square(axis[a] - axis[b]) for axis in mesh.vertices.T))
    np.maximum(lengths, 1e-9 * lengths.max(initial=0.0), out=lengths)
    half = sparse.csr_array((lengths, (a, b)), shape=(n, n))
    return sparse.csr_array(half + half.T)


def interior_depth(graph: Graph, members: IntArray) -> FloatArray:
    """Compute the distance of each member from members with a neighbour outside, (members,).

    Distances are measured along edges between members, and infinite if no edge leaves the members.
    """
    degrees = np.diff(graph.indptr)
    inner = _subgraph(graph, members)
    border = np.flatnonzero(np.diff(inner.indptr) < degrees[members])
    if len(border) == 0:
        return np.full(len(members), np.inf)
    return _distances(inner, border)


def overlapping_pieces(
    graph: Graph,
    labels: IntArray,
    size: int,
    width: float,
    *,
    most: int | None = None,
    whole: bool = False,
) -> list[IntArray]:
    """Cut a graph from `edge_graph` into cores of at most `size` vertices, and widen each.

    A piece is a core and the vertices within `width`, in the unit of the graph; at most the `most`
    nearest, but always all neighbours of the core. If `whole`, `size` is the maximum of the piece
    with its overlap, and the width is reduced where the piece would be too large. `InputError` is
    then raised if a vertex has too many neighbours.

    `labels` are the connected components of vertices, -1 for vertices in no piece. Components that
    fit are not cut; small components share a piece. Vertices of a piece are sorted.
    """
    from scipy.ndimage import value_indices

    degrees = np.diff(graph.indptr)
    if whole and degrees.max(initial=0) + 1 > size:
        vertex = int(degrees.argmax())
        raise InputError(
            "piece-too-small",
            f"Vertex {vertex} has {degrees[vertex]} neighbours, so no piece of {size} vertices can"
            " hold it",
            f"give a max_vertex_threshold above {degrees[vertex]}",
        )
    components = [members for (members,) in value_indices(labels, ignore_value=-1).values()]
    pieces = _grouped([each for each in components if len(each) <= size], size)
    for component in components:
        if len(component) <= size:
            continue
        local = _subgraph(graph, component)
        cells = _Cells(local, _CELLS_PER_PIECE * len(component) // size)
        waiting = cells.unions(_fitting_core(local, cells, size, width) if whole else size)[::-1]
        while waiting:
            core = waiting.pop()
            distances = _reached(local, core, width)
            # an overlap that fills the piece is narrowed only around small cores
            crowded = whole and np.isfinite(distances).sum() > size and (
                len(core) > max(_SMALLEST_CORE * size, 1) or (distances == 0.0).sum() > size
            )  # fmt: skip
            if len(core) > size or crowded:
                waiting += reversed(_parted(_subgraph(local, core), core, np.ones(len(core)), 0.5))
            else:
                limit = size if whole else None if most is None else len(core) + most
                pieces.append(component[_nearest(distances, limit)])
    return pieces


def owned_pieces(
    mesh: Mesh, graph: Graph, pieces: list[IntArray]
) -> tuple[tuple[IntArray, ...], list[IntArray], IntArray]:
    """Assign each vertex to the piece in which it is farthest from the cut.

    Pieces without assigned vertices are left out. The result is the vertices of each piece, without
    vertices of no face; the faces of each piece, shape (m_i, 3), as int32 indices within the piece;
    and the piece of each vertex, -1 for none.
    """
    piece_of = np.full(mesh.n_vertices, -1)
    deepest = np.full(mesh.n_vertices, -1.0)
    all_faces = mesh.proper_faces
    corners, starts = all_faces.ravel(), np.arange(0, all_faces.size + 1, 3)
    faces_at = sparse.csr_array(
        (np.ones(len(corners), dtype=np.int8), corners, starts),
        shape=(len(all_faces), mesh.n_vertices),
    ).tocsc()
    kept = []
    for number, piece in enumerate(pieces):
        depth = interior_depth(graph, piece)
        met, n_corners = np.unique(faces_at[:, piece].indices, return_counts=True)
        faces = np.searchsorted(piece, all_faces[met[n_corners == 3]])
        # remove vertices all of whose faces were cut off
        used, faces = np.unique(faces, return_inverse=True)
        piece, depth, faces = piece[used], depth[used], faces.reshape(-1, 3).astype(np.int32)
        better = depth > deepest[piece]
        piece_of[piece[better]] = number
        deepest[piece[better]] = depth[better]
        kept.append((piece, faces))
    numbers, owners = np.unique(piece_of, return_inverse=True)
    if numbers[0] < 0:
        numbers, owners = numbers[1:], owners - 1
    chosen = [kept[number] for number in numbers]
    return tuple(piece for piece, _ in chosen), [faces for _, faces in chosen], owners


def _nearest(distances: FloatArray, most: int | None) -> IntArray:
    """Return the `most` nearest vertices at finite distance, or all at distance 0, sorted."""
    reached = np.flatnonzero(np.isfinite(distances))
    if most is None or len(reached) <= most:
        return reached
    count = max(most, int(np.count_nonzero(distances == 0.0)))
    return np.sort(reached[np.argsort(distances[reached], kind="stable")[:count]])


def _grouped(components: list[IntArray], max_size: int) -> list[IntArray]:
    """Group components into pieces: each, from the largest, into the first piece with room."""
    groups: list[list[IntArray]] = []
    room: list[int] = []
    for component in sorted(components, key=len, reverse=True):
        fits = next((i for i, free in enumerate(room) if free >= len(component)), None)
        if fits is None:
            groups.append([])
            room.append(max_size)
            fits = len(groups) - 1
        groups[fits].append(component)
        room[fits] -= len(component)
    return [np.sort(np.concatenate(group)) for group in groups]


def _fitting_core(graph: Graph, cells: _Cells, size: int, width: float) -> float:
    """Estimate the size of cores that fill pieces of `size` vertices with their overlap.

    The rim of a disc of size c is proportional to √c, so the overlap adds the same amount to √c for
    all sizes. It is measured on some large cores.
    """
    trial = cells.unions(0.9 * size)
    trial = trial[:: max(1, len(trial) // _SAMPLES)]
    reached = [np.isfinite(_distances(graph, core, width)).sum() for core in trial]
    rim = np.sqrt(reached) - np.sqrt([*map(len, trial)])
    core = np.clip(0.96 * np.sqrt(size) - rim, 0.0, None) ** 2
    return max(float(np.quantile(core, 0.25)), _SMALLEST_CORE * size, 1.0)


class _Cells:
    """A connected graph condensed into small cells around random seeds."""

    def __init__(self, graph: Graph, n_cells: int) -> None:
        n = graph.shape[0]
        if n_cells > n // 4:
            self.graph = graph
            self.cell: npt.NDArray[np.integer[Any]] = np.arange(n)
            self.weights = np.ones(n)
            return
        seeds = np.sort(np.random.default_rng(0).choice(n, n_cells, replace=False))
        distances, _, nearest = dijkstra(
            graph, indices=seeds, min_only=True, return_predecessors=True
        )
        cell = np.searchsorted(seeds, nearest).astype(np.int32)
        tails = np.repeat(np.arange(n, dtype=np.int32), np.diff(graph.indptr))
        crossing = np.flatnonzero(cell[tails] < cell[graph.indices])
        a, b = tails[crossing], graph.indices[crossing]
        # distance of two cells: between their seeds, over the shortest crossing edge
        length = distances[a] + graph.data[crossing] + distances[b]
        order = np.argsort(length, kind="stable")
        keys = (cell[a] * np.int64(n_cells) + cell[b])[order]
        keys, first = np.unique(keys, return_index=True)
        ends = np.divmod(keys, n_cells)
        half = sparse.coo_array((length[order][first], ends), shape=(n_cells, n_cells))
        self.graph = sparse.csr_array(half + half.T)
        self.cell = cell
        self.weights = np.bincount(cell, minlength=n_cells).astype(np.float64)

    def unions(self, size: float) -> list[IntArray]:
        """Return sorted vertices of connected unions of cells, at most about `size` in each."""
        unions, waiting = [], [np.arange(len(self.weights))]
        while waiting:
            members = waiting.pop()
            n_parts = int(np.ceil(self.weights[members].sum() / size))
            if n_parts <= 1 or len(members) == 1:
                unions.append(members)
            else:
                share = (n_parts // 2) / n_parts
                part = _subgraph(self.graph, members)
                waiting += reversed(_parted(part, members, self.weights[members], share))
        by_cell = np.argsort(self.cell, kind="stable")
        start = np.concatenate([[0], np.cumsum(self.weights).astype(np.int64)])
        return [
            np.sort(np.concatenate([by_cell[start[i] : start[i + 1]] for i in members]))
            for members in unions
        ]


def _parted(graph: Graph, members: IntArray, weights: FloatArray, share: float) -> list[IntArray]:
    """Split the members of a graph in two; the first part has about `share` of the weight."""
    n_parts, part = connected_components(graph, directed=False)
    if n_parts > 1:
        # equal distances may create disconnected fragments, which are split off
        largest = np.bincount(part).argmax()
        return [members[part == largest], members[part != largest]]
    a = _distances(graph, [0]).argmax()
    from_a = _distances(graph, [a])
    from_b = _distances(graph, [from_a.argmax()])
    order = np.argsort(from_a - from_b, kind="stable")
    filled = np.cumsum(weights[order])
    at = int(np.searchsorted(filled, share * filled[-1])) + 1
    at = min(max(at, 1), len(members) - 1)
    return [np.sort(members[order[:at]]), np.sort(members[order[at:]])]


def _reached(graph: Graph, core: IntArray, width: float) -> FloatArray:
    """Compute the distance of every vertex from a core, infinite beyond `width`.

    It is 0 for neighbours of the core: they are always included, to complete its faces.
    """
    distances = _distances(graph, core, width)
    distances[graph[core].indices] = 0.0
    return distances


def _distances(graph: Graph, sources: Any, limit: float = np.inf) -> FloatArray:
    """Compute the distance of every vertex from the nearest source; infinite beyond `limit`."""
    return np.asarray(dijkstra(graph, indices=sources, min_only=True, limit=limit), np.float64)


def _subgraph(graph: Graph, members: IntArray) -> Graph:
    """Return the subgraph of `members`, increasing indices of vertices."""
    if len(members) == graph.shape[0]:
        return graph
    return sparse.csr_array(graph[members][:, members])
