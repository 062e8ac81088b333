"""Division of the graph of a mesh into overlapping pieces of bounded size, along geodesics.

Every vertex is in the core of exactly one piece. A piece consists of its core and all vertices
within a given distance of the core, so that the cut does not affect results on the core.

Large components are first condensed into small cells (nearest seed by edge distance), then bisected
recursively: with two distant ends a and b, a vertex belongs to the half of a if d_a − d_b is small.
Both halves are connected: the half of a contains the shortest path from a to each of its vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.errors import InputError
from meshmash_viewer.mesh import Mesh

Graph: TypeAlias = "sparse.csr_array[Any]"

#: Number of cells in a piece. More cells follow geodesics better; fewer are bisected faster.
_CELLS_PER_PIECE = 64
#: Number of cores that are widened to estimate the maximum size of cores.
_SAMPLES = 8
#: Smallest share of a piece to which cores are bisected to make room for the overlap. Where the
#: mesh is so dense that the overlap alone fills the piece, the overlap is narrower instead.
_SMALLEST_CORE = 0.25
#: Edges measured at a time.
_EDGES = 65536


class Piece(tuple[FloatArray, IntArray]):
    """``(vertices, faces)`` of a piece, with `faces` as indices into its vertices.

    `first`, shape (n_i,), is the square of the first eigenvector of the whole mesh at these
    vertices: one over the area of the first component on this component, and 0 on all others.
    """

    first: FloatArray

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray, first: FloatArray) -> Piece:
        """Create a piece from its arrays."""
        piece = cls((vertices, faces))
        piece.first = first
        return piece


def edge_graph(mesh: Mesh) -> Graph:
    """Build the symmetric graph of edge lengths, shape (n, n), in the unit of `mesh`.

    Edges of zero length get a tiny positive length, because a stored zero is not an edge.
    """
    n, faces = mesh.n_vertices, mesh.proper_faces
    sides = np.empty((3, len(faces)), dtype=np.int64)
    for side, key in enumerate(sides):
        a, b = faces[:, side], faces[:, side - 1]
        np.minimum(a, b, out=key)
        key *= n
        key += np.maximum(a, b)
    # Equivalent to np.unique, which takes ten times as long here.
    keys = sides.ravel()
    keys.sort()
    keys = keys[np.append(True, keys[1:] != keys[:-1])]
    del sides
    starts = np.searchsorted(keys, np.arange(n + 1) * n).astype(np.int32)
    lengths, ends = np.empty(len(keys)), np.empty(len(keys), dtype=np.int32)
    for part in blocks(len(keys), _EDGES):
        a, b = np.divmod(keys[part], n)
        lengths[part] = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
        ends[part] = b
    del keys  # free its memory before the graph takes twice as much
    np.maximum(lengths, 1e-9 * lengths.max(initial=0.0), out=lengths)
    half = sparse.csr_array((lengths, ends, starts), shape=(n, n))
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
    graph: Graph, labels: IntArray, max_size: int, width: float
) -> list[IntArray]:
    """Cut a graph from `edge_graph` into overlapping pieces of at most `max_size` sorted vertices.

    `labels` are the connected components of vertices, -1 for vertices in no piece. The `width` of
    the overlap, in the unit of the graph, is reduced where the piece would be too large; the
    overlap always contains all neighbours of the core. Components that fit are not cut; small
    components share a piece. `InputError` is raised if a vertex has too many neighbours.
    """
    degrees = np.diff(graph.indptr)
    if degrees.max(initial=0) + 1 > max_size:
        vertex = int(degrees.argmax())
        raise InputError(
            f"Vertex {vertex} has {degrees[vertex]} neighbours, so no piece of {max_size} vertices "
            f"can hold it: give a max_vertex_threshold above {degrees[vertex]}."
        )

    def cut(local: Graph, cells: _Cells) -> list[IntArray]:
        # a trial without overlap estimates the size of cores whose overlap fits
        trial = cells.unions(0.9 * max_size)
        trial = trial[:: max(1, len(trial) // _SAMPLES)]
        reached = [np.isfinite(_distances(local, core, width)).sum() for core in trial]
        sizes = np.stack([[*map(len, trial)], reached], axis=1)
        cores = cells.unions(_fitting_core(sizes, max_size))
        return _widened(local, cores, partial(_within, local, max_size=max_size, width=width))

    return _pieces(graph, labels, max_size, cut)


def widened_cores(
    graph: Graph, labels: IntArray, core_size: int, width: float, most: int | None = None
) -> list[IntArray]:
    """Cut a graph into cores of at most `core_size` vertices, and widen each by `width`.

    See `overlapping_pieces`. Only the `most` nearest vertices are added to a core, but always all
    its neighbours.
    """

    def cut(local: Graph, cells: _Cells) -> list[IntArray]:
        def widen(core: IntArray) -> IntArray | None:
            if len(core) > core_size:
                return None
            distances = _reached(local, core, width)
            return _nearest(distances, None if most is None else len(core) + most)

        return _widened(local, cells.unions(core_size), widen)

    return _pieces(graph, labels, core_size, cut)


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
    faces_of_mesh = mesh.proper_faces
    corners = faces_of_mesh.ravel().astype(np.int32)
    starts = np.arange(0, len(corners) + 1, 3, dtype=np.int32)
    faces_at = sparse.csr_array(
        (np.ones(len(corners), dtype=np.int8), corners, starts),
        shape=(len(faces_of_mesh), mesh.n_vertices),
    ).tocsc()
    del corners, starts
    kept = []
    for number, piece in enumerate(pieces):
        depth = interior_depth(graph, piece)
        met, n_corners = np.unique(faces_at[:, piece].indices, return_counts=True)
        faces = np.searchsorted(piece, faces_of_mesh[met[n_corners == 3]])
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


def _pieces(
    graph: Graph, labels: IntArray, size: int, cut: Callable[[Graph, _Cells], list[IntArray]]
) -> list[IntArray]:
    """Group components of at most `size` vertices, and cut larger components."""
    sizes = np.bincount(labels[labels >= 0])
    order = np.argsort(labels, kind="stable")[np.count_nonzero(labels < 0) :]
    components = np.split(order, np.cumsum(sizes)[:-1]) if len(sizes) else []
    pieces = _grouped([each for each in components if len(each) <= size], size)
    for component in components:
        if len(component) > size:
            local = _subgraph(graph, component)
            cells = _Cells(local, _CELLS_PER_PIECE * len(component) // size)
            pieces += [component[piece] for piece in cut(local, cells)]
    return pieces


def _widened(
    graph: Graph, cores: list[IntArray], widen: Callable[[IntArray], IntArray | None]
) -> list[IntArray]:
    """Widen cores; cores for which `widen` returns None are bisected first."""
    pieces, waiting = [], cores[::-1]
    while waiting:
        core = waiting.pop()
        piece = widen(core)
        if piece is None:
            weights = np.ones(len(core))
            waiting += reversed(_parted(_subgraph(graph, core), core, weights, 0.5))
        else:
            pieces.append(piece)
    return pieces


def _within(graph: Graph, core: IntArray, max_size: int, width: float) -> IntArray | None:
    """Return the core and vertices within `width`; None if the core has to be bisected first."""
    if len(core) > max_size:
        return None
    distances = _reached(graph, core, width)
    if np.isfinite(distances).sum() > max_size and (
        len(core) > max(_SMALLEST_CORE * max_size, 1) or (distances == 0.0).sum() > max_size
    ):
        return None
    return _nearest(distances, max_size)


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


def _fitting_core(sizes: IntArray, max_size: int) -> float:
    """Estimate the size of cores that fill a piece with overlap.

    `sizes`, shape (s, 2), are of cores without and with overlap. The rim of a disc of size c is
    proportional to √c, so the overlap adds the same amount to √c for all sizes.
    """
    rim = np.diff(np.sqrt(sizes), axis=1)
    core = np.clip(0.96 * np.sqrt(max_size) - rim, 0.0, None) ** 2
    return max(float(np.quantile(core, 0.25)), _SMALLEST_CORE * max_size, 1.0)


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
        by_pair = np.lexsort((length, cell[b], cell[a]))
        keys = (cell[a] * np.int64(n_cells) + cell[b])[by_pair]
        keys, first = np.unique(keys, return_index=True)
        half = sparse.coo_array(
            (length[by_pair][first], np.divmod(keys, n_cells)), shape=(n_cells, n_cells)
        )
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
