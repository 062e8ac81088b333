"""Components of one size that a pencil has many of, each solved alone by dense `eigh`.

Copies of a component share their eigenvalues, so that a mesh of 500 equal ones has eigenvalues of
multiplicity 1500. A block Krylov basis sees eight copies of an eigenvector at a time. Component by
component they cost next to nothing, and equal components are solved once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.spectral.engine.dense import component_pairs
from meshmash_viewer.spectral.engine.pencil import Pencil

FloatArray = npt.NDArray[np.float64]

#: Fewer components of one size than this are left to the Krylov basis.
_FEWEST = 16
#: Vertices of a component at most.
_LARGEST = 700
#: Solutions that cost less than this, in cubed vertices, always pay; others where there are so many
#: copies for each vertex of one.
_CHEAP, _COPIES_PER_VERTEX = 1e9, 0.125
#: Components whose matrices differ by less than this, relative to the largest entry, are equal.
_EQUAL = 1e-13
#: Solved components that another is compared with: the last so many.
_COMPARED = 4


@dataclass(frozen=True, eq=False)
class AlonePairs:
    """Pairs of an interval that lie on single components.

    Parameters
    ----------
    values : ndarray, shape (p,)
        Ascending.
    rows : ndarray, shape (q, n)
        Eigenvectors of the lowest q of them, as many as were asked for.
    vertices : ndarray of bool, shape (n,)
        Where these components are.
    orthonormality : float
        Largest defect of the rows' inner products.
    """

    values: FloatArray
    rows: FloatArray
    vertices: npt.NDArray[np.bool_]
    orthonormality: float


@dataclass(frozen=True, eq=False)
class _Kind:
    """Equal components: their pairs, and the vertices of each, shape (copies, c)."""

    values: FloatArray
    vectors: FloatArray
    places: npt.NDArray[np.int64]

    @cached_property
    def orthonormality(self) -> float:
        gram = self.vectors.T @ self.vectors
        return float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))


class RepeatedComponents:
    """The components of a pencil that are solved alone; most pencils have none.

    Parameters
    ----------
    pencil : Pencil
    highest : float
        Their eigenvalues up to this one are computed.
    """

    def __init__(self, pencil: Pencil, highest: float) -> None:
        self._n = pencil.n
        self._kinds = list(_kinds(pencil, highest))

    def count(self, high: float) -> int:
        """Number of their eigenvalues below a value, the null space not counted."""
        return sum(int((kind.values < high).sum()) * len(kind.places) for kind in self._kinds)

    def within(self, low: float, high: float, most: int | None = None) -> AlonePairs | None:
        """The pairs between two values, with rows for the lowest `most`; None without any."""
        values, kinds, columns, copies = [], [], [], []
        for at, kind in enumerate(self._kinds):
            inside = np.flatnonzero((kind.values > low) & (kind.values < high))
            count = len(kind.places)
            values.append(np.repeat(kind.values[inside], count))
            columns.append(np.repeat(inside, count))
            copies.append(np.tile(np.arange(count), len(inside)))
            kinds.append(np.full(count * len(inside), at))
        every = np.concatenate(values) if values else np.zeros(0)
        if not len(every):
            return None
        order = np.argsort(every, kind="stable")
        number, column, copy = (np.concatenate(each)[order] for each in (kinds, columns, copies))
        there = [self._kinds[i] for i in np.unique(number)]
        vertices = np.zeros(self._n, dtype=np.bool_)
        for kind in there:
            vertices[kind.places] = True
        rows = np.zeros((len(order) if most is None else min(most, len(order)), self._n))
        for row, i, j, which in zip(rows, number, column, copy, strict=False):
            row[self._kinds[i].places[which]] = self._kinds[i].vectors[:, j]
        defect = max(kind.orthonormality for kind in there)
        return AlonePairs(every[order], rows, vertices, defect)


def _kinds(pencil: Pencil, highest: float) -> Iterator[_Kind]:
    """Solve the components of each size that there are many of."""
    from scipy.sparse.csgraph import connected_components

    count, component = connected_components(pencil.matrix, directed=False)
    sizes = np.bincount(component, minlength=count)
    copies_of_size = np.bincount(sizes)
    # In the order of the mesh, in which copies have their vertices in the same order.
    order = np.lexsort((pencil.active, component))
    ends = np.cumsum(sizes)
    for size in np.flatnonzero(copies_of_size[: _LARGEST + 1] >= _FEWEST):
        if size > 1:
            which = np.flatnonzero(sizes == size)
            places = order[ends[which][:, np.newaxis] - size + np.arange(size)]
            yield from _solved(pencil, places, highest)


def _solved(pencil: Pencil, places: npt.NDArray[np.int64], highest: float) -> list[_Kind]:
    """The kinds of components of one size, shape (copies, c); none where they cost too much."""
    copies, size = places.shape
    matrix = sparse.csr_array(pencil.matrix[places.ravel()][:, places.ravel()])
    most = max(_CHEAP / size**3, copies if copies >= _COPIES_PER_VERTEX * size else 0)
    blocks: list[FloatArray] = []
    pairs: list[tuple[FloatArray, FloatArray]] = []
    members: list[list[int]] = []
    for at, place in enumerate(places):
        block = _block(matrix, at * size, size)
        back = _equal_to(block, blocks)
        if back is None:
            if len(pairs) + 1 > most:
                return []
            is_null = pencil.labels[place[0]] >= 0
            constant = pencil.null_direction[place] if is_null else None
            pairs.append(component_pairs(block, constant, highest))
            members.append([])
            blocks, back = [*blocks[1 - _COMPARED :], block], -1
        members[back].append(at)
    return [_Kind(*each, places[which]) for each, which in zip(pairs, members, strict=True)]


def _block(matrix: sparse.csr_array, start: int, size: int) -> FloatArray:
    """A dense diagonal block; its rows have no entries elsewhere."""
    bounds = matrix.indptr[start : start + size + 1]
    part = slice(bounds[0], bounds[-1])
    block = np.zeros((size, size))
    rows = np.repeat(np.arange(size), np.diff(bounds))
    block[rows, matrix.indices[part] - start] = matrix.data[part]
    return block


def _equal_to(block: FloatArray, blocks: list[FloatArray]) -> int | None:
    """Which of some blocks another is equal to, as an index from the end."""
    limit = _EQUAL * np.abs(block).max()
    for back in range(-1, -len(blocks) - 1, -1):
        if np.abs(block - blocks[back]).max() <= limit:
            return back
    return None
