"""Approximate eigenfunctions of a large mesh within seconds, from a few thousand cells.

Seeds are spread over the surface, and every vertex belongs to the cell of the seed that is nearest
along edges. The finite-volume Laplacian of the cells has conductances between neighbouring cells,
from the cotangent weights of the edges that cross their border and the distance of their centroids.
This Laplacian is valid also on thin branches, where cells form a chain. Its eigenvectors,
interpolated between centroids, approximate the eigenfunctions for display (see `expected_error`).

Coarse levels follow Nasikun and Hildebrandt (2022), "The Hierarchical Subspace Iteration Method for
Laplace-Beltrami Eigenproblems", ACM Transactions on Graphics 41(2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import dijkstra

from meshmash_viewer.arrays import FloatArray, IntArray, blocks
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.split.partition import edge_graph
from meshmash_viewer.surface.rays import curve_order

SparseMatrix: TypeAlias = Any

#: Cells for each requested pair, and the smallest and largest number of cells.
_CELLS_PER_PAIR, _FEWEST, _MOST = 100, 2500, 8000
#: Minimum number of cells of a component that has cells. A component with at most three vertices
#: for each cell has one cell for each vertex instead.
_CELLS_OF_COMPONENT = 30
#: Neighbouring cells from which a vertex is interpolated, besides its own.
_NEIGHBOURS = 8
#: Vertices processed at a time.
_BLOCK = 1 << 16


def expected_error(n_cells: int, n_pairs: int) -> float:
    """Return the relative error of the eigenvalues, an empirical fit over many meshes.

    The error grows with the number of waves across a cell, and so with pairs over cells.
    """
    return 0.02 + 2.0 * n_pairs / max(n_cells, 1)


def preview_eigenpairs(
    mesh: Mesh,
    n_pairs: int = 50,
    *,
    n_cells: int | None = None,
    allocate: Callable[[int, int], npt.NDArray[np.float32]] | None = None,
    cancel: CancelCallback | None = None,
) -> Eigenpairs:
    """Approximate the lowest pairs of a mesh, including one zero eigenvalue for each component.

    Rows are float32, of unit norm in M, and roughly orthogonal. Fewer pairs than requested are
    returned if the cells have no more. `n_cells` is by default 100 for each pair, limited to 2500
    to 8000. ``allocate(k, n)`` returns the float32 array for the rows; `cancel` is called between
    the steps, and `Cancelled` is raised if it returns True.
    """
    if n_cells is None:
        n_cells = min(max(_CELLS_PER_PAIR * n_pairs, _FEWEST), _MOST)
    areas = mesh.vertex_areas
    seeds = _spread_seeds(mesh, areas, n_cells, n_pairs)
    check_cancelled(cancel)
    cells = _nearest_seeds(mesh, seeds)
    check_cancelled(cancel)
    _, centroids = _measure(mesh, areas, cells, seeds)
    cells = _rounded(mesh, cells, centroids)
    cell_areas, centroids = _measure(mesh, areas, cells, seeds)
    check_cancelled(cancel)
    stiffness = _cell_stiffness(mesh, cells, centroids)
    check_cancelled(cancel)
    labels = mesh.component_labels
    values, vectors = _cell_eigenpairs(stiffness, cell_areas, labels[seeds], n_pairs, cancel)
    check_cancelled(cancel)
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
    error = expected_error(len(seeds), n_pairs)
    return Eigenpairs(eigenvalues, rows, np.full(len(rows), np.nan), n_exact=0, error=error)


# -- cells ------------------------------------------------------------------------------------


def _spread_seeds(mesh: Mesh, areas: FloatArray, n_cells: int, n_pairs: int) -> IntArray:
    """Spread vertices evenly over the area of each component that is large enough, shape (s,)."""
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
    # four times Weyl's estimate of the last requested eigenvalue, a margin for its error
    last = 4.0 * 4.0 * np.pi * n_pairs / total
    for start, stop in zip(starts, stops, strict=True):
        members = used[start:stop]
        places = mesh.vertices[members]
        length = float(np.linalg.norm(places.max(axis=0) - places.min(axis=0)))
        if stop - start < 3 or length <= 0.0 or (np.pi / (2.0 * length)) ** 2 > last:
            continue  # too small for a wave below the last eigenvalue: only its constant is needed
        area = np.cumsum(areas[members])
        count = max(round(n_cells * area[-1] / total), _CELLS_OF_COMPONENT)
        if stop - start <= 3 * count:
            chosen.append(members)
            continue
        middles = (np.arange(count) + 0.5) * (area[-1] / count)
        chosen.append(np.unique(members[np.searchsorted(area, middles)]))
    return np.concatenate(chosen) if chosen else np.zeros(0, dtype=np.int64)


def _nearest_seeds(mesh: Mesh, seeds: IntArray) -> IntArray:
    """Find the seed nearest to each vertex along edges, shape (n,); -1 without a seed."""
    number = np.full(mesh.n_vertices, -1)
    if not len(seeds):
        return number
    _, _, nearest = dijkstra(
        edge_graph(mesh), indices=seeds, min_only=True, return_predecessors=True
    )
    number[seeds] = np.arange(len(seeds))
    return np.where(nearest >= 0, number[np.maximum(nearest, 0)], -1)


def _measure(
    mesh: Mesh, areas: FloatArray, cells: IntArray, seeds: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Compute area and centroid of each cell, shapes (s,) and (s, 3)."""
    inside = cells >= 0
    members, weights = cells[inside], areas[inside]
    cell_areas = np.bincount(members, weights, len(seeds)).astype(np.float64)
    centroids = mesh.vertices[seeds].copy()  # of cells without area
    solid = cell_areas > 0.0
    for axis in range(3):
        moments = np.bincount(members, weights * mesh.vertices[inside, axis], len(seeds))
        centroids[solid, axis] = moments[solid] / cell_areas[solid]
    return cell_areas, centroids


def _rounded(mesh: Mesh, cells: IntArray, centroids: FloatArray) -> IntArray:
    """Assign each vertex to the nearest centroid among its cell and the neighbours of that cell.

    Distances along edges depend on the direction of edges. Euclidean distances give borders
    perpendicular to the line between two centroids, as the flux formula assumes.
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
    """Yield blocks of m vertices, 9 cells around each, and squared distances to these, (m, 9).

    The values are undefined for vertices in no cell.
    """
    for part in blocks(len(cells) if len(near) else 0, _BLOCK):
        candidates = near[cells[part]]
        squared = np.zeros(candidates.shape)
        outside = cells[part] < 0
        for axis in range(3):
            places = np.where(outside, 0.0, mesh.vertices[part, axis])
            squared += (centroids[candidates, axis] - places[:, None]) ** 2
        yield part, candidates, squared


def _cell_stiffness(mesh: Mesh, cells: IntArray, centroids: FloatArray) -> SparseMatrix:
    """Build the finite-volume Laplacian of the cells, csr, shape (s, s), no unit.

    For a function that is linear along the line between two centroids, the flux across the border
    is the sum of cotangent weight times difference over the edges that cross the border. This sum
    divided by the distance of the centroids is the weight of the two cells.
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
        # difference of the linear function along the edge; 0 within a cell
        change = _products(u - v, between) / np.maximum(_products(between, between), 1e-300)
        flows.append((0.5 * cotangents * change, one, other))
    weights, a, b = (np.concatenate(part) for part in zip(*flows, strict=True))
    flow = coo_array((weights, (a, b)), shape=(n, n)).tocsr()
    flow = (flow + flow.T).tocsr()
    # Obtuse faces can make the weight of a short border negative: it is set to 0, except between
    # cells of one vertex, whose weights are the exact cotangent weights.
    single = np.bincount(cells[cells >= 0], minlength=n) == 1
    both = flow.tocoo()
    both.data[(both.data < 0.0) & ~(single[both.row] & single[both.col])] = 0.0
    both.eliminate_zeros()
    return (diags_array(np.asarray(both.sum(axis=1)).ravel()) - both).tocsr()


def _products(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", one, other))


# -- eigenpairs -------------------------------------------------------------------------------


def _cell_eigenpairs(
    stiffness: SparseMatrix,
    cell_areas: FloatArray,
    components: IntArray,
    n_pairs: int,
    cancel: CancelCallback | None,
) -> tuple[FloatArray, FloatArray]:
    """Compute eigenpairs of the cells above the null space: shapes (k,) and (s, k)."""
    n_null = len(np.unique(components))
    count = min(n_pairs + n_null, len(components))
    if count <= n_null:
        return np.zeros(0), np.zeros((len(components), 0))
    found = solve(stiffness, cell_areas, count, tol=1e-6, n_jobs=1, cancel=cancel)
    above = found.eigenvalues > 1e-9 * found.eigenvalues[-1]
    vectors = np.nan_to_num(found.rows[above].T)
    return found.eigenvalues[above], np.ascontiguousarray(vectors)


def _write_constants(rows: npt.NDArray[np.float32], labels: IntArray, areas: FloatArray) -> None:
    """Write the null space: a constant of unit norm on each component, zero elsewhere."""
    used = labels >= 0
    component_areas = np.bincount(labels[used], areas[used])
    rows[:] = 0.0
    for component in np.flatnonzero(component_areas[: len(rows)]):  # without area the norm is 0
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
    """Interpolate from the surrounding centroids to vertices, into `rows` of shape (k, n).

    The weight of a centroid is a smooth function that is 0 where the set of centroids changes.
    """
    near = _neighbours(stiffness)
    values = vectors.astype(np.float32)
    rows[:] = 0.0
    for part, candidates, squared in _candidates(mesh, cells, centroids, near):
        check_cancelled(cancel)
        reach = 1.05 * squared.max(axis=1, keepdims=True) + 1e-300
        weights = (1.0 - squared / reach) ** 2 / (squared + 1e-3 * reach)
        # padding repeats the last candidate
        weights[candidates == np.roll(candidates, 1, axis=1)] = 0.0
        weights[cells[part] < 0] = 0.0
        total = weights.sum(axis=1, keepdims=True)
        weights /= np.where(total > 0.0, total, 1.0)
        starts = candidates.shape[1] * np.arange(len(candidates) + 1)
        entries = weights.ravel().astype(np.float32), candidates.ravel(), starts
        average = csr_array(entries, shape=(len(candidates), len(values)))
        rows[:, part] = (average @ values).T


def _neighbours(stiffness: SparseMatrix) -> IntArray:
    """Return each cell and its neighbours of largest weight, shape (s, 9).

    Rows with fewer neighbours are padded with the cell itself.
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
    """Scale rows to unit norm in M, the entry of largest magnitude positive, as the solver does."""
    for row in rows:
        norm = float(np.sqrt(np.sum(areas * np.square(row, dtype=np.float64))))
        largest = row[int(np.argmax(np.abs(row)))]
        row *= np.copysign(1.0 / norm if norm > 0.0 else 1.0, largest)
