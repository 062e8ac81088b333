"""Pairs from dense matrices: of small pencils, and of repeated components.

A mesh of 500 equal components has eigenvalues of multiplicity 1500, of which a block Krylov basis
finds eight copies at a time. Solving single components is faster; equal ones are solved once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.spectral.engine.pencil import Pencil, indefinite


class DenseSpectrum:
    """All pairs of a small pencil; `values`, shape (n,), begin with the zeros of the null space.

    Components are solved one by one, since their stiffness may differ by a factor of a million.
    `check` is called before each component; `InputError` is raised if an eigenvalue is negative by
    more than rounding.
    """

    def __init__(self, pencil: Pencil, check: Callable[[], None]) -> None:
        self._pencil = pencil
        count, component = connected_components(pencil.matrix, directed=False)
        places = np.split(
            np.argsort(component, kind="stable"),
            np.cumsum(np.bincount(component, minlength=count))[:-1],
        )
        values, columns, rows, starts = [np.zeros(0)], [np.zeros(0)], [np.zeros(0, int)], [0]
        for place in places:
            is_null = pencil.labels[place[0]] >= 0
            if is_null and len(place) == 1:
                continue
            check()
            matrix = pencil.matrix[place][:, place].toarray()
            constant = pencil.null_direction[place] if is_null else None
            found, vectors = component_pairs(matrix, constant)
            kept = len(found)
            values.append(found)
            columns.append(vectors.T.ravel())
            rows.append(np.tile(place, kept))
            starts.extend(starts[-1] + len(place) * np.arange(1, kept + 1))
        every = np.concatenate(values)
        order = np.argsort(every, kind="stable")
        parts = (np.concatenate(columns), np.concatenate(rows), np.array(starts))
        self._columns = sparse.csc_array(parts, shape=(pencil.n, len(every)))[:, order]
        lowest = float(every.min(initial=0.0))
        if lowest < -max(1e-6, 1e-9 * pencil.norm):
            raise indefinite(f"{lowest * pencil.unit:.4g}")
        self.values: FloatArray = np.concatenate([np.zeros(pencil.n_null), every[order]])

    def rows(self, chosen: npt.NDArray[np.intp]) -> FloatArray:
        """Return the eigenvectors of ascending indices, shape (k, n)."""
        n_null = self._pencil.n_null
        null, rest = chosen[chosen < n_null], chosen[chosen >= n_null]
        constants = self._pencil.null_rows(len(null) and int(null[-1]) + 1)[null]
        return np.concatenate([constants, self._columns[:, rest - n_null].toarray().T])


def component_pairs(
    matrix: FloatArray, constant: FloatArray | None, highest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Compute the pairs of a component's matrix, (c, c), up to `highest` or all, ascending.

    `constant` is the null vector if it is known; its pair is left out.
    """
    from scipy.linalg import eigh

    if constant is not None:
        # The zero is shifted above all other eigenvalues, so that it does not mix with the lowest.
        lift = 1.1 * np.abs(matrix).sum(axis=0).max()
        matrix = matrix + lift * np.outer(constant, constant)
    if highest is not None:
        values, vectors = eigh(matrix, subset_by_value=(-np.inf, highest))
        kept = len(values) - int(constant is not None and len(values) == len(matrix))
        return values[:kept], vectors[:, :kept]
    values, vectors = eigh(matrix, driver="evd")
    kept = len(matrix) - int(constant is not None)
    return values[:kept], vectors[:, :kept]


def dense_residuals(pencil: Pencil, values: FloatArray, rows: FloatArray) -> FloatArray:
    """Compute residuals ``‖Lφ - λMφ‖ / ‖Mφ‖`` in the reduced unit, shape (p,)."""
    weight = pencil.root_mass
    # In extended precision, where the platform has it, to measure less rounding.
    image = (pencil.matrix.astype(np.longdouble) @ rows.T.astype(np.longdouble)).T
    defect = np.asarray(image - values[:, None] * rows, dtype=np.float64) * weight
    sizes = np.linalg.norm(rows * weight, axis=1)
    return np.asarray(np.linalg.norm(defect, axis=1) / sizes)


#: Minimum number of components of one size; fewer are solved with the Krylov basis.
_FEWEST = 16
#: Maximum number of vertices of such a component.
_LARGEST = 700
#: Maximum total cost, in cubed vertices, of components of one size, and ratio of their number to
#: the vertices of one component from which they are solved at any cost.
_CHEAP, _COPIES_PER_VERTEX = 1e9, 0.125
#: Relative difference below which matrices of components are equal.
_EQUAL = 1e-13
#: Number of solved components that the next component is compared with.
_COMPARED = 4


@dataclass(frozen=True, eq=False)
class AlonePairs:
    """Pairs of an interval whose eigenvectors are zero outside one component."""

    #: Shape (p,): Ascending.
    values: FloatArray
    #: Shape (q, n): Eigenvectors of the lowest q pairs, as many as requested.
    rows: FloatArray
    #: Shape (n,): Mask of the vertices of these components.
    vertices: npt.NDArray[np.bool_]
    #: Largest defect of the rows' inner products.
    orthonormality: float


@dataclass(frozen=True, eq=False)
class _Kind:
    """Equal components: the pairs of one, and the vertices of each, shape (copies, c)."""

    values: FloatArray
    vectors: FloatArray
    places: npt.NDArray[np.int64]

    @cached_property
    def orthonormality(self) -> float:
        gram = self.vectors.T @ self.vectors
        return float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))


class RepeatedComponents:
    """Repeated components of a pencil, solved up to an eigenvalue; most pencils have none."""

    def __init__(self, pencil: Pencil, highest: float) -> None:
        self._n = pencil.n
        self._kinds = list(_kinds(pencil, highest))

    def count(self, high: float) -> int:
        """Count the nonzero eigenvalues of these components below a value."""
        return sum(int((kind.values < high).sum()) * len(kind.places) for kind in self._kinds)

    def within(self, low: float, high: float, most: int | None = None) -> AlonePairs | None:
        """Return the pairs between two values, with the lowest `most` rows; None without pairs."""
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
    """Solve the components of each repeated size."""
    count, component = connected_components(pencil.matrix, directed=False)
    sizes = np.bincount(component, minlength=count)
    copies_of_size = np.bincount(sizes)
    repeated = np.flatnonzero(copies_of_size[: _LARGEST + 1] >= _FEWEST)
    if not len(repeated):
        return
    # Vertices in the order of the mesh, which is the same in copies.
    order = np.lexsort((pencil.active, component))
    ends = np.cumsum(sizes)
    for size in repeated:
        if size > 1:
            which = np.flatnonzero(sizes == size)
            places = order[ends[which][:, np.newaxis] - size + np.arange(size)]
            yield from _solved(pencil, places, highest)


def _solved(pencil: Pencil, places: npt.NDArray[np.int64], highest: float) -> list[_Kind]:
    """Solve components of one size, `places` (copies, c); return [] if this costs too much."""
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
    """Return a dense diagonal block, whose rows have no entries outside the block."""
    bounds = matrix.indptr[start : start + size + 1]
    part = slice(bounds[0], bounds[-1])
    block = np.zeros((size, size))
    rows = np.repeat(np.arange(size), np.diff(bounds))
    block[rows, matrix.indices[part] - start] = matrix.data[part]
    return block


def _equal_to(block: FloatArray, blocks: list[FloatArray]) -> int | None:
    """Return the negative index of the last of `blocks` that equals `block`, or None."""
    limit = _EQUAL * np.abs(block).max()
    for back in range(-1, -len(blocks) - 1, -1):
        if np.abs(block - blocks[back]).max() <= limit:
            return back
    return None
