"""Pairs from dense matrices: of small pencils, and of repeated components.

A mesh of 500 equal components has eigenvalues of multiplicity 1500, of which a block Krylov basis
finds eight copies at a time. Solving single components is faster; equal ones are solved once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from operator import itemgetter
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.spectral.engine.pairs import ReducedPairs
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
            found = component_pairs(matrix, constant)
            values.append(found.values)
            columns.append(found.rows.ravel())
            rows.append(np.tile(place, len(found)))
            starts.extend(starts[-1] + len(place) * np.arange(1, len(found) + 1))
        every = np.concatenate(values)
        order = np.argsort(every, kind="stable")
        parts = (np.concatenate(columns), np.concatenate(rows), np.array(starts))
        self._columns = sparse.csc_array(parts, shape=(pencil.n, len(every)))[:, order]
        lowest = float(every.min(initial=0.0))
        if lowest < -max(1e-6, 1e-9 * pencil.norm):
            raise indefinite(f"{lowest * pencil.unit:.4g}")
        self.values: FloatArray = np.concatenate([np.zeros(pencil.n_null), every[order]])

    def pairs(self, chosen: npt.NDArray[np.intp]) -> ReducedPairs:
        """Return the pairs of ascending indices."""
        n_null = self._pencil.n_null
        null, rest = chosen[chosen < n_null], chosen[chosen >= n_null]
        constants = self._pencil.null_rows(len(null) and int(null[-1]) + 1)[null]
        rows = np.concatenate([constants, self._columns[:, rest - n_null].toarray().T])
        return ReducedPairs(self.values[chosen], rows)


def component_pairs(
    matrix: FloatArray, constant: FloatArray | None, highest: float | None = None
) -> ReducedPairs:
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
    else:
        values, vectors = eigh(matrix, driver="evd")
    kept = len(values) - int(constant is not None and len(values) == len(matrix))
    return ReducedPairs(values[:kept], vectors[:, :kept].T)


def dense_residuals(pencil: Pencil, pairs: ReducedPairs) -> FloatArray:
    """Compute residuals ``‖Lφ - λMφ‖ / ‖Mφ‖`` in the reduced unit, shape (p,)."""
    weight, rows = pencil.root_mass, pairs.rows
    # In extended precision, where the platform has it, to measure less rounding.
    image = (pencil.matrix.astype(np.longdouble) @ rows.T.astype(np.longdouble)).T
    defect = np.asarray(image - pairs.values[:, None] * rows, dtype=np.float64) * weight
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


#: Pairs of one of several equal components, and the vertices of each, shape (copies, c).
_Copies: TypeAlias = tuple[ReducedPairs, npt.NDArray[np.int64]]


class RepeatedComponents:
    """Components of a pencil that have many equal copies, with their pairs; most have none."""

    def __init__(self, pencil: Pencil) -> None:
        self._pencil = pencil
        self._solved: list[_Copies] = []

    def solve(self, highest: float) -> None:
        """Find these components, and compute their pairs up to an eigenvalue."""
        self._solved = list(_repeated(self._pencil, highest))

    def count(self, low: float, high: float) -> int:
        """Count the eigenvalues of these components between two values."""
        return sum(
            int(_inside(pairs, low, high).sum()) * len(places) for pairs, places in self._solved
        )

    def vertices(self, low: float, high: float) -> npt.NDArray[np.bool_] | None:
        """Return the mask (n,) of components with pairs between two values; None without pairs."""
        if not self.count(low, high):
            return None
        vertices = np.zeros(self._pencil.n, dtype=np.bool_)
        for pairs, places in self._solved:
            vertices[places] |= _inside(pairs, low, high).any()
        return vertices

    def within(self, low: float, high: float, most: int | None = None) -> ReducedPairs:
        """Return the pairs between two values, at most the lowest `most`; rows are zero outside."""
        each = [
            (pairs.values[i], pairs.rows[i], place, pairs.orthonormality or 0.0)
            for pairs, places in self._solved
            for i in np.flatnonzero(_inside(pairs, low, high))
            for place in places
        ]
        chosen = sorted(each, key=itemgetter(0))[:most]
        rows = np.zeros((len(chosen), self._pencil.n))
        for row, (_, vector, place, _) in zip(rows, chosen, strict=True):
            row[place] = vector
        defect = max(pair[3] for pair in each)
        return ReducedPairs(np.array([pair[0] for pair in chosen]), rows, orthonormality=defect)


def _inside(pairs: ReducedPairs, low: float, high: float) -> npt.NDArray[np.bool_]:
    return np.asarray((pairs.values > low) & (pairs.values < high))


def _repeated(pencil: Pencil, highest: float) -> Iterator[_Copies]:
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


def _solved(pencil: Pencil, places: npt.NDArray[np.int64], highest: float) -> list[_Copies]:
    """Solve components of one size, `places` (copies, c); return [] if this costs too much."""
    copies, size = places.shape
    matrix = sparse.csr_array(pencil.matrix[places.ravel()][:, places.ravel()])
    most = max(_CHEAP / size**3, copies if copies >= _COPIES_PER_VERTEX * size else 0)
    blocks: list[FloatArray] = []
    pairs: list[ReducedPairs] = []
    members: list[list[int]] = []
    for at, place in enumerate(places):
        block = _block(matrix, at * size, size)
        back = _equal_to(block, blocks)
        if back is None:
            if len(pairs) + 1 > most:
                return []
            is_null = pencil.labels[place[0]] >= 0
            constant = pencil.null_direction[place] if is_null else None
            found = component_pairs(block, constant, highest)
            gram = found.rows @ found.rows.T
            defect = float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))
            pairs.append(replace(found, orthonormality=defect))
            members.append([])
            blocks, back = [*blocks[1 - _COMPARED :], block], -1
        members[back].append(at)
    return [(each, places[which]) for each, which in zip(pairs, members, strict=True)]


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
