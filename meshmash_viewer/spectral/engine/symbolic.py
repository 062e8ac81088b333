"""Structure of the factor: fill-reducing order, elimination tree, supernodes.

The structure is computed once for a matrix and used for every shift. A supernode is a run of
columns with the same nonzero rows below, stored as one dense block, which makes solves fast.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from meshmash_viewer.spectral.engine.compiler import import_compiler

numba = import_compiler()

IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Structure:
    """Order and block structure of the factor of a symmetric matrix."""

    #: Shape (s + 1,): First column of each supernode.
    first: IndexArray
    #: Shape (s + 1,): Start of the rows of each supernode in `rows`; the first are its columns.
    row_start: IndexArray
    #: Ascending row indices of all supernodes.
    rows: IndexArray
    #: Shape (s + 1,): Start of the dense block (rows x columns, C order) of each supernode.
    block_start: IndexArray
    #: Shape (s,): Number of children of each supernode in the supernodal elimination tree.
    children: IndexArray
    #: Number of entries of the largest stack of update matrices.
    stack_size: int
    #: Number of rows of the largest front.
    front_size: int
    #: Column starts and row indices of the matrix in csc format.
    start: IndexArray
    index: IndexArray

    @cached_property
    def unsigned(self) -> tuple[npt.NDArray[np.uint64], ...]:
        """Index arrays of a solve, unsigned as its kernel requires."""
        arrays = (self.first, self.row_start, self.rows, self.block_start)
        return tuple(array.astype(np.uint64) for array in arrays)

    @cached_property
    def unsigned_matrix(self) -> tuple[npt.NDArray[np.uint64], ...]:
        """Index arrays of a product with the matrix, unsigned."""
        return self.start.astype(np.uint64), self.index.astype(np.uint64)

    @property
    def n_entries(self) -> int:
        """Number of stored entries of the factor."""
        return int(self.block_start[-1])


def _nested_dissection(matrix: Any) -> IndexArray:
    """Compute a fill-reducing order from the sparsity pattern by METIS."""
    import pymetis

    n = matrix.shape[0]
    # The matrix is symmetric: its columns are its rows.
    column = np.repeat(np.arange(n), np.diff(matrix.indptr))
    off = column != matrix.indices
    starts = np.concatenate([[0], np.cumsum(np.bincount(column[off], minlength=n))])
    graph = pymetis.CSRAdjacency(starts.astype(np.int32), matrix.indices[off].astype(np.int32))
    return np.asarray(pymetis.nested_dissection(graph)[0], dtype=np.int64)


def _minimum_degree(matrix: Any) -> IndexArray:
    """Compute a fill-reducing order by SuperLU."""
    from scipy.sparse.linalg import splu

    n = matrix.shape[0]
    pattern: Any = sp.csc_array(matrix)
    filled = pattern.copy()
    filled.data = np.full(filled.nnz, -1.0)
    filled = filled + sp.eye_array(n) * (float(np.diff(pattern.indptr).max()) + 2.0)
    factor = splu(
        sp.csc_array(filled),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(factor.perm_c).astype(np.int64)


def elimination_order(matrix: Any) -> IndexArray:
    """Compute a fill-reducing order with contiguous subtrees of the elimination tree.

    The method is nested dissection if METIS is installed, else minimum degree.
    """
    with_metis = find_spec("pymetis") is not None
    order = _nested_dissection(matrix) if with_metis else _minimum_degree(matrix)
    start = np.asarray(matrix.indptr, dtype=np.int64)
    index = np.asarray(matrix.indices, dtype=np.int64)
    return np.asarray(order[_postorder(_elimination_tree(start, index, order))])


def analyse(matrix: Any) -> Structure:
    """Find the blocks of the factor of a symmetric csc matrix in elimination order."""
    start = np.asarray(matrix.indptr, dtype=np.int64)
    index = np.asarray(matrix.indices, dtype=np.int64)
    parent = _elimination_tree(start, index, np.arange(len(start) - 1))
    first, height = _supernodes(parent, _column_counts(start, index, parent))
    row_start = np.concatenate([[0], np.cumsum(height)])
    rows, children = _supernode_rows(first, row_start, start, index)
    rows = _ascending(row_start, rows)
    width = np.diff(first)
    return Structure(
        first=first,
        row_start=row_start,
        rows=rows,
        block_start=np.concatenate([[0], np.cumsum(height * width)]),
        children=children,
        stack_size=_largest_stack(height - width, children),
        front_size=int(height.max()),
        start=start,
        index=index,
    )


@numba.njit(cache=True, nogil=True)
def _elimination_tree(start, index, order):  # type: ignore[no-untyped-def]
    """Compute the parent of each column of the permuted matrix (Liu 1986), -1 for a root."""
    n = len(order)
    place = np.empty(n, np.int64)
    for i in range(n):
        place[order[i]] = i
    parent = np.full(n, -1, np.int64)
    ancestor = np.full(n, -1, np.int64)
    for i in range(n):
        column = order[i]
        for p in range(start[column], start[column + 1]):
            j = place[index[p]]
            while j != -1 and j < i:
                following = ancestor[j]
                ancestor[j] = i
                if following == -1:
                    parent[j] = i
                j = following
    return parent


@numba.njit(cache=True, nogil=True)
def _postorder(parent):  # type: ignore[no-untyped-def]
    """Compute an order of columns in which every subtree is contiguous."""
    n = len(parent)
    head = np.full(n, -1, np.int64)
    after = np.full(n, -1, np.int64)
    for j in range(n - 1, -1, -1):
        if parent[j] != -1:
            after[j] = head[parent[j]]
            head[parent[j]] = j
    result = np.empty(n, np.int64)
    stack = np.empty(n, np.int64)
    k = 0
    for root in range(n):
        if parent[root] != -1:
            continue
        top = 0
        stack[0] = root
        while top >= 0:
            node = stack[top]
            child = head[node]
            if child == -1:
                top -= 1
                result[k] = node
                k += 1
            else:
                head[node] = after[child]
                top += 1
                stack[top] = child
    return result


@numba.njit(cache=True, nogil=True)
def _largest_stack(below, children):  # type: ignore[no-untyped-def]
    """Compute the maximum number of entries of pending update matrices."""
    pending = np.empty(len(below), np.int64)
    n_pending = 0
    stack = 0
    largest = 0
    for s in range(len(below)):
        for _ in range(children[s]):
            n_pending -= 1
            stack -= pending[n_pending]
        if below[s] > 0:
            pending[n_pending] = below[s] * below[s]
            stack += pending[n_pending]
            n_pending += 1
        largest = max(largest, stack)
    return largest


@numba.njit(cache=True, nogil=True)
def _column_counts(start, index, parent):  # type: ignore[no-untyped-def]
    """Count entries of each column of the factor, diagonal included, from row subtrees."""
    n = len(parent)
    counts = np.ones(n, np.int64)
    mark = np.full(n, -1, np.int64)
    for i in range(n):
        mark[i] = i
        for p in range(start[i], start[i + 1]):
            j = index[p]
            while j < i and mark[j] != i:
                mark[j] = i
                counts[j] += 1
                j = parent[j]
    return counts


@numba.njit(cache=True, nogil=True)
def _supernodes(parent, counts):  # type: ignore[no-untyped-def]
    """Find first columns and heights of supernodes; small ones are merged if few zeros arise."""
    n = len(parent)
    first = np.empty(n + 1, np.int64)
    height = np.empty(n + 1, np.int64)
    zeros = np.zeros(n + 1, np.float64)
    k = 0
    j = 0
    while j < n:
        end = j
        while end + 1 < n and parent[end] == end + 1 and counts[end] == counts[end + 1] + 1:
            end += 1
        first[k] = j
        height[k] = counts[j]
        zeros[k] = 0.0
        k += 1
        start = j
        j = end + 1
        # Merge with the previous supernode while it is a child that ends where this one begins.
        while k > 1 and start <= parent[start - 1] < j:
            width = start - first[k - 2]
            merged = height[k - 1] + width
            total_width = j - first[k - 2]
            added = zeros[k - 2] + zeros[k - 1] + width * (merged - height[k - 2])
            entries = merged * total_width
            if not (
                (total_width <= 4)
                or (total_width <= 16 and added < 0.4 * entries)
                or (total_width <= 48 and added < 0.15 * entries)
                or added < 0.05 * entries
            ):
                break
            k -= 1
            height[k - 1] = merged
            zeros[k - 1] = added
            start = first[k - 1]
    first[k] = n
    return first[: k + 1].copy(), height[:k].copy()


@numba.njit(cache=True, nogil=True)
def _supernode_rows(first, row_start, start, index):  # type: ignore[no-untyped-def]  # noqa: C901
    """Compute the rows of each supernode, its columns first, and its number of children.

    Sorting and slice assignment are avoided, since numba takes seconds to compile them.
    """
    n = len(start) - 1
    s_count = len(first) - 1
    of_column = np.empty(n, np.int64)
    for s in range(s_count):
        for j in range(first[s], first[s + 1]):
            of_column[j] = s
    rows = np.empty(row_start[s_count], np.int64)
    mark = np.full(n, -1, np.int64)
    head = np.full(s_count, -1, np.int64)
    after = np.full(s_count, -1, np.int64)
    children = np.zeros(s_count, np.int64)
    for s in range(s_count):
        size = row_start[s]
        for j in range(first[s], first[s + 1]):
            mark[j] = s
            rows[size] = j
            size += 1
        below = size
        for j in range(first[s], first[s + 1]):
            for p in range(start[j], start[j + 1]):
                i = index[p]
                if i > j and mark[i] != s:
                    mark[i] = s
                    rows[size] = i
                    size += 1
        child = head[s]
        while child != -1:
            for p in range(row_start[child], row_start[child + 1]):
                i = rows[p]
                if i >= first[s + 1] and mark[i] != s:
                    mark[i] = s
                    rows[size] = i
                    size += 1
            child = after[child]
        if size > below:
            nearest = rows[below]
            for p in range(below, size):
                nearest = min(nearest, rows[p])
            parent = of_column[nearest]
            children[parent] += 1
            after[s] = head[parent]
            head[parent] = s
    return rows, children


def _ascending(row_start: IndexArray, rows: IndexArray) -> IndexArray:
    """Sort the rows of each supernode."""
    shape = (len(row_start) - 1, int(rows.max()) + 1)
    marks = np.ones(len(rows), dtype=np.int8)
    lists: Any = sp.csr_array((marks, rows, row_start), shape=shape)
    lists.sort_indices()
    return np.asarray(lists.indices, dtype=np.int64)
