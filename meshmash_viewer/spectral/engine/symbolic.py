"""Structure of the factor: fill-reducing order, elimination tree, supernodes.

Found once for a matrix and used for every shift. A supernode is a run of columns with the same
rows below; its part of the factor is one dense block, which is what makes solves fast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from meshmash_viewer.spectral.engine.compilation import numba
from meshmash_viewer.spectral.engine.dissection import DissectionCrew, nested_dissection

__all__ = ["Structure", "analyse", "elimination_order"]

IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Structure:
    """Order and block structure of the factor of a symmetric matrix.

    Parameters
    ----------
    first : ndarray of int64, shape (s + 1,)
        First column of each supernode.
    row_start : ndarray of int64, shape (s + 1,)
        Where the rows of each supernode begin in `rows`; its own columns come first.
    rows : ndarray of int64
        Ascending row indices of all supernodes.
    block_start : ndarray of int64, shape (s + 1,)
        Where the dense block (rows x columns, C order) of each supernode begins.
    children : ndarray of int64, shape (s,)
        Number of children of each supernode in the supernodal elimination tree.
    lower_start, lower_rows, lower_source : ndarray of int64
        The lower triangle by columns; `lower_source` is the place of each entry in the data of
        the matrix.
    stack_size : int
        Entries of the largest stack of update matrices.
    front_size : int
        Rows of the largest front.
    matrix_start, matrix_index : ndarray of uint64
        Compressed structure of the matrix itself.
    """

    first: IndexArray
    row_start: IndexArray
    rows: IndexArray
    block_start: IndexArray
    children: IndexArray
    lower_start: IndexArray
    lower_rows: IndexArray
    lower_source: IndexArray
    stack_size: int
    front_size: int
    matrix_start: npt.NDArray[np.uint64]
    matrix_index: npt.NDArray[np.uint64]

    @cached_property
    def unsigned(self) -> tuple[npt.NDArray[np.uint64], ...]:
        """What a solve reads, with the unsigned indices its kernel is compiled for."""
        arrays = (self.first, self.row_start, self.rows, self.block_start)
        return tuple(array.astype(np.uint64) for array in arrays)

    @property
    def n(self) -> int:
        """Size of the matrix."""
        return len(self.lower_start) - 1

    @property
    def n_entries(self) -> int:
        """Stored entries of the factor."""
        return int(self.block_start[-1])


def fill_reducing_order(
    matrix: Any, poll: Callable[[], None] | None, crew: DissectionCrew | None
) -> IndexArray:
    """Nested dissection by METIS where it is installed, else minimum degree by SuperLU."""
    if find_spec("pymetis") is None:
        return _minimum_degree(matrix)
    n = matrix.shape[0]
    # The matrix is symmetric: its columns are its rows.
    column = np.repeat(np.arange(n), np.diff(matrix.indptr))
    off = column != matrix.indices
    starts = np.concatenate([[0], np.cumsum(np.bincount(column[off], minlength=n))])
    marks = np.ones(int(starts[-1]), dtype=np.int8)
    graph: Any = sp.csr_array((marks, matrix.indices[off], starts), shape=(n, n))
    return nested_dissection(graph, poll, crew).astype(np.int64)


def _minimum_degree(matrix: Any) -> IndexArray:
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


def elimination_order(
    matrix: Any,
    poll: Callable[[], None] | None = None,
    crew: DissectionCrew | None = None,
) -> IndexArray:
    """Fill-reducing order in which every subtree of the elimination tree is contiguous.

    What `poll` raises ends it.
    """
    order = fill_reducing_order(matrix, poll, crew)
    start = np.asarray(matrix.indptr, dtype=np.int64)
    index = np.asarray(matrix.indices, dtype=np.int64)
    return np.asarray(order[_postorder(_elimination_tree(start, index, order))])


def analyse(matrix: Any) -> Structure:
    """Find the blocks of the factor of a symmetric csc matrix in elimination order."""
    start = np.asarray(matrix.indptr, dtype=np.int64)
    index = np.asarray(matrix.indices, dtype=np.int64)
    parent = _elimination_tree(start, index, np.arange(len(start) - 1))
    lower_start, lower_rows, lower_source = _lower_triangle(start, index)
    counts = _column_counts(lower_start, lower_rows, parent)
    first = _supernodes(parent, counts)
    row_start, rows, children = _supernode_rows(first, lower_start, lower_rows)
    rows = _ascending(row_start, rows)
    height = np.diff(row_start)
    width = np.diff(first)
    return Structure(
        first=first,
        row_start=row_start,
        rows=rows,
        block_start=np.concatenate([[0], np.cumsum(height * width)]),
        children=children,
        lower_start=lower_start,
        lower_rows=lower_rows,
        lower_source=lower_source,
        stack_size=_largest_stack(height - width, children),
        front_size=int(height.max()),
        matrix_start=start.astype(np.uint64),
        matrix_index=index.astype(np.uint64),
    )


@numba.njit(cache=True, nogil=True)
def _elimination_tree(start, index, order):  # type: ignore[no-untyped-def]
    """Parents of the permuted matrix's columns (Liu 1986), -1 for roots."""
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
    """Columns in an order where every subtree is contiguous."""
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
def _lower_triangle(start, index):  # type: ignore[no-untyped-def]
    """Lower triangle by columns, and where each of its entries comes from."""
    n = len(start) - 1
    lower_start = np.zeros(n + 1, np.int64)
    for j in range(n):
        lower_start[j + 1] = lower_start[j]
        for p in range(start[j], start[j + 1]):
            if index[p] >= j:
                lower_start[j + 1] += 1
    lower_rows = np.empty(lower_start[n], np.int64)
    source = np.empty(lower_start[n], np.int64)
    q = 0
    for j in range(n):
        for p in range(start[j], start[j + 1]):
            if index[p] >= j:
                lower_rows[q] = index[p]
                source[q] = p
                q += 1
    return lower_start, lower_rows, source


@numba.njit(cache=True, nogil=True)
def _largest_stack(below, children):  # type: ignore[no-untyped-def]
    """Entries of the update matrices that wait at once, at most."""
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
def _column_counts(lower_start, lower_rows, parent):  # type: ignore[no-untyped-def]
    """Entries of each column of the factor, diagonal included, by walking row subtrees."""
    n = len(parent)
    row_start = np.zeros(n + 1, np.int64)
    for p in range(len(lower_rows)):
        row_start[lower_rows[p] + 1] += 1
    for i in range(n):
        row_start[i + 1] += row_start[i]
    columns = np.empty(len(lower_rows), np.int64)
    fill = row_start[:-1].copy()
    for j in range(n):
        for p in range(lower_start[j], lower_start[j + 1]):
            i = lower_rows[p]
            columns[fill[i]] = j
            fill[i] += 1
    counts = np.ones(n, np.int64)
    mark = np.full(n, -1, np.int64)
    for i in range(n):
        mark[i] = i
        for p in range(row_start[i], row_start[i + 1]):
            j = columns[p]
            while mark[j] != i:
                mark[j] = i
                counts[j] += 1
                j = parent[j]
    return counts


@numba.njit(cache=True, nogil=True)
def _supernodes(parent, counts):  # type: ignore[no-untyped-def]
    """First columns of the supernodes, small ones merged where that stores few zeros."""
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
        # Merge with the supernode before as long as it is a child that ends where this begins.
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
    return first[: k + 1].copy()


@numba.njit(cache=True, nogil=True)
def _supernode_rows(first, lower_start, lower_rows):  # type: ignore[no-untyped-def]
    """Rows of each supernode, its own first, and how many children each has.

    Neither sorting nor assigning slices here: numba takes seconds to compile those.
    """
    n = len(lower_start) - 1
    s_count = len(first) - 1
    of_column = np.empty(n, np.int64)
    for s in range(s_count):
        for j in range(first[s], first[s + 1]):
            of_column[j] = s
    row_start = np.zeros(s_count + 1, np.int64)
    rows = np.empty(max(len(lower_rows), 16), np.int64)
    mark = np.full(n, -1, np.int64)
    head = np.full(s_count, -1, np.int64)
    after = np.full(s_count, -1, np.int64)
    children = np.zeros(s_count, np.int64)
    size = 0
    for s in range(s_count):
        begin = size
        if size + n > len(rows):
            grown = np.empty(2 * len(rows) + n, np.int64)
            for p in range(size):
                grown[p] = rows[p]
            rows = grown
        for j in range(first[s], first[s + 1]):
            mark[j] = s
            rows[size] = j
            size += 1
        below = size
        for j in range(first[s], first[s + 1]):
            for p in range(lower_start[j], lower_start[j + 1]):
                i = lower_rows[p]
                if mark[i] != s:
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
        row_start[s] = begin
        row_start[s + 1] = size
        if size > below:
            nearest = rows[below]
            for p in range(below, size):
                nearest = min(nearest, rows[p])
            parent = of_column[nearest]
            children[parent] += 1
            after[s] = head[parent]
            head[parent] = s
    return row_start, rows[:size].copy(), children


def _ascending(row_start: IndexArray, rows: IndexArray) -> IndexArray:
    """The rows of each supernode in ascending order."""
    shape = (len(row_start) - 1, int(rows.max()) + 1)
    marks = np.ones(len(rows), dtype=np.int8)
    lists: Any = sp.csr_array((marks, rows, row_start), shape=shape)
    lists.sort_indices()
    return np.asarray(lists.indices, dtype=np.int64)
