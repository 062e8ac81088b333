"""Neck widths of parts of a surface, by level sets of a harmonic function."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.surface.edges import side_codes

if TYPE_CHECKING:
    from meshmash_viewer.mesh import Mesh

#: Number of level sets that are measured.
_LEVELS = 64
#: Share of the area of a part, nearest to where it joins the rest, that cuts run through.
_NEAR = 0.5
#: Relative residual, and most steps, of the solution.
_PRECISION, _STEPS = 1e-7, 10_000


def neck_widths(mesh: Mesh, parts: IntArray, n_parts: int) -> FloatArray:
    """Measure the shortest cut that separates each of some parts from the rest of the surface.

    The cuts are 64 level sets of the function that is 1 on the rest, 0 on the half of the area of
    the part that is farthest from it along edges, and harmonic between them. Each consists of
    closed curves on the triangles, or of curves that end at open edges. So the width is never below
    that of the shortest cut through this half of the part, and above where that is no level set.

    `parts`, shape (n,), is the part of each vertex, -1 for none. The widths, shape (n_parts,), are
    in the unit of the mesh; NaN where a part does not join the rest.
    """
    of_corners = parts[mesh.faces]
    touched = (of_corners >= 0).any(axis=1) & mesh.distinct_corners
    joins = touched & (of_corners != of_corners[:, :1]).any(axis=1)
    joined = np.zeros(n_parts + 1, dtype=np.bool_)
    joined[of_corners[joins]] = True
    joined[-1] = False  # where -1 has gone
    widths = np.full(n_parts, np.nan)
    if joined.any():
        faces = mesh.faces[touched & joined[of_corners].any(axis=1)]
        parts = np.where(joined[parts], parts, -1)
        near = _near(mesh, faces, parts)
        values = _harmonic(mesh, faces[near[faces].any(axis=1)], parts, near)
        lengths = _cut_lengths(mesh.vertices, faces, parts, values, n_parts)
        widths[joined[:-1]] = lengths[joined[:-1]]
    return widths


def _near(mesh: Mesh, faces: IntArray, parts: IntArray) -> npt.NDArray[np.bool_]:
    """Find the vertices of the near half of each part, shape (n,)."""
    from scipy.sparse.csgraph import dijkstra

    n = mesh.n_vertices
    low, high = np.divmod(np.unique(side_codes(faces, n) >> 1), n)
    lengths = np.linalg.norm(mesh.vertices[low] - mesh.vertices[high], axis=1)
    lengths = np.maximum(lengths, np.finfo(np.float64).tiny)  # a zero would be no edge
    within = parts[low] == parts[high]
    # The rest of each part is node n: an edge leads from it to each vertex at a border.
    ends, across = np.append(low[~within], high[~within]), np.tile(lengths[~within], 2)
    nearest = np.full(n, np.inf)
    np.minimum.at(nearest, ends, across)
    border = np.flatnonzero(np.isfinite(nearest) & (parts >= 0))
    rows = np.concatenate([low[within], high[within], np.full(len(border), n)])
    columns = np.concatenate([high[within], low[within], border])
    weights = np.concatenate([lengths[within], lengths[within], nearest[border]])
    graph = sparse.csr_array((weights, (rows, columns)), shape=(n + 1, n + 1))
    distances = dijkstra(graph, indices=[n])[0, :n]

    inside = np.flatnonzero(parts >= 0)
    order = inside[np.lexsort((distances[inside], parts[inside]))]
    areas, of_part = mesh.vertex_areas[order], parts[order]
    total = np.bincount(of_part, areas)
    before = np.cumsum(total) - total
    near = np.zeros(n, dtype=np.bool_)
    nearest_half = np.cumsum(areas) - before[of_part] <= _NEAR * total[of_part]
    near[order] = nearest_half & (areas > 0.0)  # faces without area have no Laplacian
    return near


def _harmonic(
    mesh: Mesh, faces: IntArray, parts: IntArray, near: npt.NDArray[np.bool_]
) -> FloatArray:
    """Solve for the values at the near vertices of all parts; 0 at the others, shape (n,)."""
    from scipy.sparse.linalg import cg

    values = np.zeros(mesh.n_vertices)
    unknown = np.flatnonzero(near)
    if len(unknown):
        around = mesh.vertices, faces
        rows = cotangent_laplacian(around, robust=True)[0].tocsr()[unknown].tocoo()
        other = parts[unknown[rows.row]] != parts[rows.col]
        known = -np.bincount(rows.row[other], rows.data[other], len(unknown))
        place = np.full(mesh.n_vertices, -1)
        place[unknown] = np.arange(len(unknown))
        kept = ~other & near[rows.col]
        matrix = sparse.csr_array(
            (rows.data[kept], (rows.row[kept], place[rows.col[kept]])), shape=(len(unknown),) * 2
        )
        scale = sparse.diags_array(1.0 / matrix.diagonal())
        # any function has closed level sets: one that has not converged makes no width too small
        values[unknown] = cg(matrix, known, rtol=_PRECISION, maxiter=_STEPS, M=scale)[0]
    return values


def _cut_lengths(
    vertices: FloatArray, faces: IntArray, parts: IntArray, values: FloatArray, n_parts: int
) -> FloatArray:
    """Measure the level sets of the function of each part; return the shortest, (n_parts,)."""
    cuts = []
    of_corners = parts[faces]
    for corner in range(3):  # each part of a face once
        own = of_corners[:, corner]
        first = (own >= 0) & (of_corners[:, :corner] != own[:, None]).all(axis=1)
        at = np.where(of_corners == own[:, None], values[faces], 1.0)
        first &= at.max(axis=1) > at.min(axis=1)
        cuts.append((faces[first], own[first], at[first]))
    faces, own, at = (np.concatenate(each) for each in zip(*cuts, strict=True))
    shortest = np.full(n_parts, np.inf)
    for level in (np.arange(_LEVELS) + 0.5) / _LEVELS:
        above = at > level
        count = above.sum(axis=1)
        crossed = np.flatnonzero((count == 1) | (count == 2))
        # the corner that is alone on its side of the level
        alone = np.argmax(above[crossed] == (count[crossed] == 1)[:, None], axis=1)
        points = []
        for step in (1, 2):
            tip = (alone + step) % 3
            start, end = at[crossed, alone], at[crossed, tip]
            share = ((level - start) / (end - start))[:, None]
            tail_at, tip_at = vertices[faces[crossed, alone]], vertices[faces[crossed, tip]]
            points.append(tail_at + share * (tip_at - tail_at))
        lengths = np.linalg.norm(points[0] - points[1], axis=1)
        sums = np.bincount(own[crossed], lengths, n_parts)
        shortest = np.where(sums > 0.0, np.minimum(shortest, sums), shortest)
    return shortest
