"""Approximate eigenfunctions of a large mesh within seconds, from a few thousand cells.

Seeds are spread over the surface and every vertex joins the seed that is nearest along edges.
Heat flows between two cells that touch; how easily, follows from the cotangent weights of the
edges that cross their border and from the distance of their centroids: a finite-volume Laplacian
of the cells, which also holds where a branch is so thin that its cells form a mere chain. Its
eigenvectors, interpolated between centroids, look like the true eigenfunctions long before those
are computed. They are pictures, not results: see `expected_error`.

The idea of coarse levels is that of Nasikun and Hildebrandt (2022), "The Hierarchical Subspace
Iteration Method for Laplace-Beltrami Eigenproblems", ACM Transactions on Graphics 41(2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import dijkstra

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback, Cancelled
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.split.partition import edge_graph
from meshmash_viewer.surface.space_curve import curve_order

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
SparseMatrix: TypeAlias = Any

#: Cells for each pair that is asked for, and the fewest and most of all.
_CELLS_PER_PAIR, _FEWEST, _MOST = 100, 2500, 8000
#: Cells that a component gets at least, if it gets any; one with fewer than three times as many
#: vertices gets one for each.
_CELLS_OF_COMPONENT = 30
#: Neighbouring cells that a vertex is interpolated from, besides its own.
_NEIGHBOURS = 8
#: Vertices that are looked at together.
_BLOCK = 1 << 16


@dataclass(frozen=True, eq=False)
class Preview:
    """Approximate eigenpairs, ascending.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
        In the inverse squared unit of the mesh.
    rows : ndarray of float32, shape (k, n)
        Of unit norm in M, orthogonal only roughly; NaN at unreferenced vertices.
    error : float
        Expected relative error of an eigenvalue.
    n_cells : int
        Number of cells that they were computed on.
    """

    eigenvalues: FloatArray
    rows: npt.NDArray[np.float32]
    error: float
    n_cells: int


def expected_error(n_cells: int, n_pairs: int) -> float:
    """Relative error of the eigenvalues, as found on meshes of all kinds.

    The cells' error grows with the number of waves across a cell, so with pairs over cells.
    """
    return 0.02 + 2.0 * n_pairs / max(n_cells, 1)


def preview_eigenpairs(
    mesh: Mesh,
    n_pairs: int = 50,
    *,
    n_cells: int | None = None,
    allocate: Callable[[int, int], npt.NDArray[np.float32]] | None = None,
    cancel: CancelCallback | None = None,
) -> Preview:
    """Approximate the lowest pairs of a mesh, one zero eigenvalue a component included.

    Fewer than asked for if the cells have no more. There are about 100 cells a pair, but 2500 to
    8000, unless given. ``allocate(k, n)`` returns where the rows are written, float32;
    `cancel` is asked between the steps, and `Cancelled` raised after it returns True.
    """
    if n_cells is None:
        n_cells = min(max(_CELLS_PER_PAIR * n_pairs, _FEWEST), _MOST)
    areas = mesh.vertex_areas
    seeds = _spread_seeds(mesh, areas, n_cells, n_pairs)
    _ask(cancel)
    cells = _nearest_seeds(mesh, seeds)
    _ask(cancel)
    _, centroids = _measure(mesh, areas, cells, seeds)
    cells = _rounded(mesh, cells, centroids)
    cell_areas, centroids = _measure(mesh, areas, cells, seeds)
    _ask(cancel)
    stiffness = _cell_stiffness(mesh, cells, centroids)
    _ask(cancel)
    labels = mesh.component_labels
    values, vectors = _cell_eigenpairs(stiffness, cell_areas, labels[seeds], n_pairs, cancel)
    _ask(cancel)
    n_null = min(mesh.n_components, n_pairs)
    count = min(len(values), n_pairs - n_null)
    shape = n_null + count, mesh.n_vertices
    rows = np.empty(shape, dtype=np.float32) if allocate is None else allocate(*shape)
    _write_constants(rows[:n_null], labels, areas)
    if count:
        _interpolate(rows[n_null:], mesh, cells, centroids, stiffness, vectors[:, :count], cancel)
        _normalise(rows[n_null:], areas)
    if not mesh.referenced.all():
        rows[:, ~mesh.referenced] = np.nan
    eigenvalues = np.concatenate([np.zeros(n_null), values[:count]])
    return Preview(eigenvalues, rows, expected_error(len(seeds), n_pairs), len(seeds))


def _ask(cancel: CancelCallback | None) -> None:
    if cancel is not None and cancel():
        raise Cancelled


# -- cells ------------------------------------------------------------------------------------


def _spread_seeds(mesh: Mesh, areas: FloatArray, n_cells: int, n_pairs: int) -> IntArray:
    """Vertices spread evenly over the area of each component that matters, shape (s,)."""
    labels = mesh.component_labels
    used = np.flatnonzero(labels >= 0)
    code = curve_order(mesh.vertices[used])
    # keys of 16 bits are sorted in linear time
    keys = ((code & 0x7FFF).astype(np.uint16), (code >> 15).astype(np.uint16), labels[used])
    used = used[np.lexsort(keys if mesh.n_components > 1 else keys[:2])]
    starts = np.flatnonzero(np.diff(labels[used], prepend=-1))
    stops = np.append(starts[1:], len(used))
    chosen = []
    total = float(areas.sum())
    # Weyl's estimate of the last eigenvalue that is asked for, with room for its error
    last = 4.0 * 4.0 * np.pi * n_pairs / total
    for start, stop in zip(starts, stops, strict=True):
        members = used[start:stop]
        places = mesh.vertices[members]
        length = float(np.linalg.norm(places.max(axis=0) - places.min(axis=0)))
        if stop - start < 3 or length <= 0.0 or (np.pi / (2.0 * length)) ** 2 > last:
            continue  # too small for a wave that low: its constant is all there is
        area = np.cumsum(areas[members])
        count = max(round(n_cells * area[-1] / total), _CELLS_OF_COMPONENT)
        if stop - start <= 3 * count:
            chosen.append(members)
            continue
        middles = (np.arange(count) + 0.5) * (area[-1] / count)
        chosen.append(np.unique(members[np.searchsorted(area, middles)]))
    return np.concatenate(chosen) if chosen else np.zeros(0, dtype=np.int64)


def _nearest_seeds(mesh: Mesh, seeds: IntArray) -> IntArray:
    """Index of the seed that is nearest along edges, shape (n,); -1 where none is reached."""
    if not len(seeds):
        return np.full(mesh.n_vertices, -1)
    _, _, nearest = dijkstra(
        edge_graph(mesh), indices=seeds, min_only=True, return_predecessors=True
    )
    number = np.full(mesh.n_vertices, -1)
    number[seeds] = np.arange(len(seeds))
    return np.where(nearest >= 0, number[np.maximum(nearest, 0)], -1)


def _measure(
    mesh: Mesh, areas: FloatArray, cells: IntArray, seeds: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Area and centroid of each cell, shapes (s,) and (s, 3)."""
    inside = cells >= 0
    members, weights = cells[inside], areas[inside]
    cell_areas = np.bincount(members, weights, len(seeds)).astype(np.float64)
    centroids = mesh.vertices[seeds].copy()  # where a cell has no area
    solid = cell_areas > 0.0
    for axis in range(3):
        moments = np.bincount(members, weights * mesh.vertices[inside, axis], len(seeds))
        centroids[solid, axis] = moments[solid] / cell_areas[solid]
    return cell_areas, centroids


def _rounded(mesh: Mesh, cells: IntArray, centroids: FloatArray) -> IntArray:
    """Let each vertex join the nearest centroid among its cell and the neighbours of that.

    Distances along edges depend on how edges run; straight ones give borders that are
    perpendicular to the line between two centroids, on which the flux between them relies.
    """
    near = _neighbours(_cell_stiffness(mesh, cells, centroids))
    joined = cells.copy()
    for part, candidates, squared in _candidates(mesh, cells, centroids, near):
        nearest = squared.argmin(axis=1)[:, None]
        joined[part] = np.take_along_axis(candidates, nearest, axis=1)[:, 0]
    joined[cells < 0] = -1
    return joined


def _candidates(
    mesh: Mesh, cells: IntArray, centroids: FloatArray, near: IntArray
) -> Iterator[tuple[slice, IntArray, FloatArray]]:
    """Blocks of vertices, the cells around each, and their centroids' squared distances, (m, 9).

    For a vertex in no cell they mean nothing.
    """
    for start in range(0, len(cells) if len(near) else 0, _BLOCK):
        part = slice(start, start + _BLOCK)
        candidates = near[cells[part]]
        squared = np.zeros(candidates.shape)
        outside = cells[part] < 0  # which may be anywhere
        for axis in range(3):
            places = np.where(outside, 0.0, mesh.vertices[part, axis])
            squared += (centroids[candidates, axis] - places[:, None]) ** 2
        yield part, candidates, squared


def _cell_stiffness(mesh: Mesh, cells: IntArray, centroids: FloatArray) -> SparseMatrix:
    """Finite-volume Laplacian of the cells, csr, shape (s, s), no unit.

    For a function that is linear along the line between two centroids, the flux across the
    border is the sum over edges that cross it of cotangent weight times difference. That sum
    over the distance of the centroids is the weight of the two cells.
    """
    n, (p, q, r) = len(centroids), cells[mesh.faces.T]
    crossed = ((p != q) | (q != r)) & (p >= 0) & (q >= 0) & (r >= 0) & (mesh.face_areas > 0.0)
    faces, areas = mesh.faces[crossed], mesh.face_areas[crossed]
    corners, places = cells[faces], mesh.vertices[faces]
    flows = []
    for first in range(3):
        second, third = (first + 1) % 3, (first + 2) % 3
        u, v = (places[:, other] - places[:, first] for other in (second, third))
        cotangents = 0.5 * _products(u, v) / areas
        one, other = corners[:, second], corners[:, third]
        between = centroids[one] - centroids[other]
        # how much such a function differs along the edge; not at all within a cell
        change = _products(u - v, between) / np.maximum(_products(between, between), 1e-300)
        flows.append((0.5 * cotangents * change, one, other))
    weights, a, b = (np.concatenate(part) for part in zip(*flows, strict=True))
    flow = coo_array((weights, (a, b)), shape=(n, n)).tocsr()
    flow = (flow + flow.T).tocsr()
    # Obtuse faces may turn a short border negative, and heat does not flow uphill. Among single
    # vertices these are the cotangent weights themselves, which are right as they are.
    single = np.bincount(cells[cells >= 0], minlength=n) == 1
    both = flow.tocoo()
    both.data[(both.data < 0.0) & ~(single[both.row] & single[both.col])] = 0.0
    both.eliminate_zeros()
    return (diags_array(np.asarray(both.sum(axis=1)).ravel()) - both).tocsr()


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Inner product of each row of one with that of the other."""
    return np.asarray(np.einsum("ij,ij->i", one, other))


# -- eigenpairs -------------------------------------------------------------------------------


def _cell_eigenpairs(
    stiffness: SparseMatrix,
    cell_areas: FloatArray,
    components: IntArray,
    n_pairs: int,
    cancel: CancelCallback | None,
) -> tuple[FloatArray, FloatArray]:
    """Eigenpairs of the cells above the null space: (k,) and (s, k)."""
    n_null = len(np.unique(components))
    wanted = min(n_pairs + n_null, len(components))
    if wanted <= n_null:
        return np.zeros(0), np.zeros((len(components), 0))
    found = solve(stiffness, diags_array(cell_areas), wanted, tol=1e-6, n_jobs=1, cancel=cancel)
    above = found.eigenvalues > 1e-9 * found.eigenvalues[-1]
    vectors = np.nan_to_num(found.rows[above].T)
    return found.eigenvalues[above], np.ascontiguousarray(vectors)


def _write_constants(rows: npt.NDArray[np.float32], labels: IntArray, areas: FloatArray) -> None:
    """The null space: one constant of unit norm a component, zero elsewhere."""
    used = labels >= 0
    component_areas = np.bincount(labels[used], areas[used])
    rows[:] = 0.0
    for component in np.flatnonzero(component_areas[: len(rows)]):  # without area it has no norm
        rows[component, labels == component] = component_areas[component] ** -0.5


def _interpolate(
    rows: npt.NDArray[np.float32],
    mesh: Mesh,
    cells: IntArray,
    centroids: FloatArray,
    stiffness: SparseMatrix,
    vectors: FloatArray,
    cancel: CancelCallback | None,
) -> None:
    """Write values at vertices between those at the centroids around them, shape (k, n).

    The weight of a centroid is smooth, highest there, and zero where a candidate comes and goes.
    """
    near = _neighbours(stiffness)
    values = vectors.astype(np.float32)
    rows[:] = 0.0
    for part, candidates, squared in _candidates(mesh, cells, centroids, near):
        _ask(cancel)
        reach = 1.05 * squared.max(axis=1, keepdims=True) + 1e-300
        weights = (1.0 - squared / reach) ** 2 / (squared + 1e-3 * reach)
        # where there are fewer candidates the last one is repeated
        weights[candidates == np.roll(candidates, 1, axis=1)] = 0.0
        weights[cells[part] < 0] = 0.0
        total = weights.sum(axis=1, keepdims=True)
        weights /= np.where(total > 0.0, total, 1.0)
        starts = candidates.shape[1] * np.arange(len(candidates) + 1)
        entries = weights.ravel().astype(np.float32), candidates.ravel(), starts
        average = csr_array(entries, shape=(len(candidates), len(values)))
        rows[:, part] = (average @ values).T


def _neighbours(stiffness: SparseMatrix) -> IntArray:
    """Each cell and the neighbours it exchanges most with, shape (s, 9).

    Where there are fewer, the last one is repeated; next to itself, so that it can be told.
    """
    n = stiffness.shape[0]
    matrix = stiffness.tocoo()
    off = matrix.row != matrix.col
    rows, columns, strength = matrix.row[off], matrix.col[off], matrix.data[off]
    order = np.lexsort((strength, rows))  # stiffness is negative off the diagonal
    rows, columns = rows[order].astype(np.int64), columns[order].astype(np.int64)
    rank = np.arange(len(rows)) - np.searchsorted(rows, rows)
    near = np.repeat(np.arange(n, dtype=np.int64)[:, None], 1 + _NEIGHBOURS, axis=1)
    kept = rank < _NEIGHBOURS
    near[rows[kept], 1 + rank[kept]] = columns[kept]
    return near


def _normalise(rows: npt.NDArray[np.float32], areas: FloatArray) -> None:
    """Unit norm in M, and the entry of largest magnitude positive, as the solver has it."""
    for row in rows:
        norm = float(np.sqrt(np.sum(areas * np.square(row, dtype=np.float64))))
        largest = row[int(np.argmax(np.abs(row)))]
        row *= np.copysign(1.0 / norm if norm > 0.0 else 1.0, largest)
