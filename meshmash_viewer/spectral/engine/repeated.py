"""Dense solution of components of which a pencil has many of the same size.

Copies of a component have the same eigenvalues, so that a mesh of 500 equal ones has eigenvalues of
multiplicity 1500. A block Krylov basis finds eight copies of an eigenvector at a time. Solved one
by one they take little time, and equal components are solved once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.spectral.engine.dense import component_pairs
from meshmash_viewer.spectral.engine.pencil import Pencil

#: Minimum number of components of one size; fewer are solved with the Krylov basis.
_FEWEST = 16
#: Maximum number of vertices of a component.
_LARGEST = 700
#: Total cost, in cubed vertices, up to which all are solved; beyond it they are solved if there are
#: so many copies for each vertex of one.
_CHEAP, _COPIES_PER_VERTEX = 1e9, 0.125
#: Relative difference below which matrices of components are equal.
_EQUAL = 1e-13
#: Number of previously solved components that another is compared with.
_COMPARED = 4


@dataclass(frozen=True, eq=False)
class AlonePairs:
    """Pairs of an interval that lie on single components."""

    #: Shape (p,): Ascending.
    values: FloatArray
    #: Shape (q, n): Eigenvectors of the lowest q of them, as many as requested.
    rows: FloatArray
    #: Shape (n,): Mask of these components.
    vertices: npt.NDArray[np.bool_]
    #: Largest defect of the rows' inner products.
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
    """Components of a pencil that are solved one by one, up to an eigenvalue; most have none."""

    def __init__(self, pencil: Pencil, highest: float) -> None:
        self._n = pencil.n
        self._kinds = list(_kinds(pencil, highest))

    def count(self, high: float) -> int:
        """Count their eigenvalues below a value, the null space excluded."""
        return sum(int((kind.values < high).sum()) * len(kind.places) for kind in self._kinds)

    def within(self, low: float, high: float, most: int | None = None) -> AlonePairs | None:
        """Return the pairs between two values, with rows for the lowest `most`, or None."""
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
        used = [self._kinds[i] for i in np.unique(number)]
        vertices = np.zeros(self._n, dtype=np.bool_)
        for kind in used:
            vertices[kind.places] = True
        rows = np.zeros((len(order) if most is None else min(most, len(order)), self._n))
        for row, i, j, which in zip(rows, number, column, copy, strict=False):
            row[self._kinds[i].places[which]] = self._kinds[i].vectors[:, j]
        defect = max(kind.orthonormality for kind in used)
        return AlonePairs(every[order], rows, vertices, defect)


def _kinds(pencil: Pencil, highest: float) -> Iterator[_Kind]:
    """Solve the components of each size of which there are many."""
    from scipy.sparse.csgraph import connected_components

    count, component = connected_components(pencil.matrix, directed=False)
    sizes = np.bincount(component, minlength=count)
    copies_of_size = np.bincount(sizes)
    repeated = np.flatnonzero(copies_of_size[: _LARGEST + 1] >= _FEWEST)
    if not len(repeated):
        return
    # In the vertex order of the mesh, which is the same for copies.
    order = np.lexsort((pencil.active, component))
    ends = np.cumsum(sizes)
    for size in repeated:
        if size > 1:
            which = np.flatnonzero(sizes == size)
            places = order[ends[which][:, np.newaxis] - size + np.arange(size)]
            yield from _solved(pencil, places, highest)


def _solved(pencil: Pencil, places: npt.NDArray[np.int64], highest: float) -> list[_Kind]:
    """Solve components of one size, shape (copies, c); return none if that costs too much."""
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
    """Return a dense diagonal block; its rows have no entries elsewhere."""
    bounds = matrix.indptr[start : start + size + 1]
    part = slice(bounds[0], bounds[-1])
    block = np.zeros((size, size))
    rows = np.repeat(np.arange(size), np.diff(bounds))
    block[rows, matrix.indices[part] - start] = matrix.data[part]
    return block


def _equal_to(block: FloatArray, blocks: list[FloatArray]) -> int | None:
    """Find the block equal to another; return its index from the end, or None."""
    limit = _EQUAL * np.abs(block).max()
    for back in range(-1, -len(blocks) - 1, -1):
        if np.abs(block - blocks[back]).max() <= limit:
            return back
    return None
