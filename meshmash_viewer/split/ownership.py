"""Assignment of vertices to pieces: each to the one in which it is farthest from the cut."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.split.partition import Graph, interior_depth

IntArray: TypeAlias = npt.NDArray[np.int64]


def owned_pieces(
    mesh: Mesh, graph: Graph, pieces: list[IntArray]
) -> tuple[tuple[IntArray, ...], list[IntArray], IntArray]:
    """Find the faces of each piece, and the piece of each vertex.

    Parameters
    ----------
    mesh : Mesh
    graph : sparse array, shape (n, n)
        Its edges, see `edge_graph`.
    pieces : list of ndarray of int
        Sorted vertices of each piece.

    Returns
    -------
    pieces : tuple of ndarray of int
        Vertices of each piece to which a vertex is assigned, without those of no face.
    faces : list of ndarray of int, each of shape (m_i, 3)
        Indices within the piece.
    owners : ndarray of int, shape (n,)
        Piece of each vertex, -1 for none.
    """
    piece_of = np.full(mesh.n_vertices, -1)
    deepest = np.full(mesh.n_vertices, -1.0)
    faces_of_mesh = mesh.faces[mesh.distinct_corners]
    face = np.repeat(np.arange(len(faces_of_mesh)), 3)
    faces_at = sparse.csc_array(
        (np.ones(face.size, dtype=np.int8), (face, faces_of_mesh.ravel())),
        shape=(len(faces_of_mesh), mesh.n_vertices),
    )
    kept = []
    for number, piece in enumerate(pieces):
        depth = interior_depth(graph, piece)
        met, n_corners = np.unique(faces_at[:, piece].indices, return_counts=True)
        faces = np.searchsorted(piece, faces_of_mesh[met[n_corners == 3]])
        # Remove vertices of which all faces were cut off.
        used = np.zeros(len(piece), dtype=np.bool_)
        used[faces] = True
        renumbered = np.cumsum(used) - 1
        piece, depth, faces = piece[used], depth[used], renumbered[faces]
        better = depth > deepest[piece]
        piece_of[piece[better]] = number
        deepest[piece[better]] = depth[better]
        kept.append((piece, faces))
    # Leave out pieces without assigned vertices.
    numbers, owners = np.unique(piece_of, return_inverse=True)
    if numbers[0] < 0:
        numbers, owners = numbers[1:], owners - 1
    chosen = [kept[number] for number in numbers]
    return tuple(piece for piece, _ in chosen), [faces for _, faces in chosen], owners
