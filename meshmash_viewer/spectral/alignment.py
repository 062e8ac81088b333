"""Alignment of exact eigenfunctions with approximate eigenfunctions shown before.

The sign of an eigenfunction is arbitrary, and so are orthogonal combinations within a multiplet.
When exact pairs replace a preview, the signs and combinations that change the render least are
chosen. Files contain the solver's choice; features do not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import blocks

FloatArray: TypeAlias = npt.NDArray[np.floating[Any]]

#: Relative gap up to which neighbouring eigenvalues belong to one multiplet.
MULTIPLET_GAP = 1e-6
#: Vertices at a time in the inner products.
_BLOCK = 1 << 16


@dataclass(frozen=True, eq=False)
class Alignment:
    """A block-diagonal orthogonal matrix."""

    #: First row of each block and its orthogonal matrix, of shape (1, 1) for a sign; rows in no
    #: block are unchanged.
    blocks: tuple[tuple[int, npt.NDArray[np.float64]], ...] = ()

    def block_of(self, index: int) -> tuple[int, npt.NDArray[np.float64]] | None:
        """Return the block that contains a row, or None."""
        for start, matrix in self.blocks:
            if start <= index < start + len(matrix):
                return start, matrix
        return None

    def sign(self, index: int) -> float | None:
        """Return 1 or -1 if at most the sign of a row changes; None within a rotated multiplet."""
        block = self.block_of(index)
        if block is None:
            return 1.0
        return float(np.sign(block[1][0, 0])) if block[1].size == 1 else None


def align(
    shown: FloatArray | ShownRows,
    rows: FloatArray | ShownRows,
    eigenvalues: npt.NDArray[np.float64],
    mass: npt.NDArray[np.float64],
    before: Alignment | None = None,
) -> Alignment:
    """Find signs and rotations that bring exact rows closest to the shown rows.

    Each multiplet among the first min(s, k) rows is multiplied by the nearest orthogonal matrix
    (Procrustes).

    `shown` are approximate rows, shape (s, n), NaN where unreferenced; `rows`, shape (>= k, n), and
    `eigenvalues` are the exact pairs; `mass` are the vertex areas. `before` is the result for fewer
    exact rows; its blocks are kept except the last one, whose multiplet may have grown.
    """
    blocks = list(before.blocks[:-1]) if before is not None else []
    known = blocks[-1][0] + len(blocks[-1][1]) if blocks else 0
    for start, stop in multiplets(eigenvalues, known, min(len(shown), len(eigenvalues))):
        products = _inner(rows[start:stop], shown[start:stop], mass)
        blocks.append((start, _nearest_orthogonal(products)))
    return Alignment(tuple(blocks))


def align_multiplets(
    shown: FloatArray,
    rows: FloatArray,
    eigenvalues: npt.NDArray[np.float64],
    mass: npt.NDArray[np.float64],
) -> Alignment:
    """Find rotations within multiplets that bring rows closest to the rows of another mesh.

    Each multiplet of `rows`, shape (>= k, n), is rotated towards the rows of `shown`, shape (s, n),
    that lie in its span, at any index; rows outside of multiplets are unchanged. The vertices of
    the two meshes correspond, and have areas `mass`.
    """
    blocks = []
    for start, stop in multiplets(eigenvalues, 0, len(eigenvalues)):
        if stop - start > 1:
            products = _inner(rows[start:stop], shown, mass)
            shares = np.square(products).sum(axis=0)
            within = np.sort(np.argsort(-shares, kind="stable")[: stop - start])
            products = np.pad(products[:, within], ((0, 0), (0, stop - start - len(within))))
            blocks.append((start, _nearest_orthogonal(products)))
    return Alignment(tuple(blocks))


def multiplets(
    eigenvalues: npt.NDArray[np.float64], start: int, stop: int
) -> Iterator[tuple[int, int]]:
    """Yield start and stop index of each run of nearly equal values in [start, stop)."""
    edges = np.flatnonzero(~_close_neighbours(eigenvalues)) + 1
    ends = [*edges[(edges > start) & (edges < stop)].tolist(), *([stop] if start < stop else [])]
    return zip([start, *ends[:-1]], ends, strict=False)


def _nearest_orthogonal(products: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the matrix with shown ≈ matrix @ rows, given the products ``rows M shownᵀ``."""
    left, _, right = np.linalg.svd(products)
    return np.asarray((left @ right).T)


def _close_neighbours(eigenvalues: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return whether each eigenvalue and the next belong to one multiplet, shape (k - 1,)."""
    # zeros of several components are one multiplet: they differ by rounding only
    floor = 1e-9 * np.max(eigenvalues, initial=0.0)
    return np.asarray(np.diff(eigenvalues) <= np.maximum(MULTIPLET_GAP * eigenvalues[1:], floor))


def _inner(
    rows: FloatArray, shown: FloatArray, mass: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the products ``rows M shownᵀ`` plus a tiny multiple of the identity."""
    total = np.zeros((len(rows), len(shown)))
    for part in blocks(rows.shape[1], _BLOCK):
        weighted = np.nan_to_num(np.asarray(rows[:, part], dtype=np.float64)) * mass[part]
        total += weighted @ np.nan_to_num(np.asarray(shown[:, part], dtype=np.float64)).T
    # The identity prevents a rotation of rows without overlap.
    return total + 1e-9 * np.eye(*total.shape)


class ShownRows:
    """Eigenfunctions as drawn: aligned exact rows, then the rows of `preview` from `n_exact` on.

    They are indexed like an array of shape (k, n): rows and vertices by an index, a slice or an
    array.
    """

    def __init__(
        self, exact: FloatArray, n_exact: int, preview: FloatArray | None, alignment: Alignment
    ) -> None:
        self._exact = exact
        self._n_exact = n_exact
        self._preview = preview
        self.alignment = alignment
        n_shown = n_exact if preview is None else max(len(preview), n_exact)
        self.shape = (n_shown, exact.shape[1])
        self.dtype = np.dtype(np.float64)
        self.size = self.shape[0] * self.shape[1]
        self.ndim = 2

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> FloatArray:
        rows, columns = key if isinstance(key, tuple) else (key, slice(None))
        indices = np.arange(self.shape[0])[rows]
        if indices.ndim == 0:
            return self._row(int(indices), columns)
        if not len(indices):
            return np.zeros((0, self.shape[1]))[:, columns]
        return np.stack([self._row(int(index), columns) for index in indices])

    def _row(self, index: int, columns: Any) -> FloatArray:
        if index >= self._n_exact:
            assert self._preview is not None
            return np.asarray(self._preview[index, columns])
        block = self.alignment.block_of(index)
        if block is None:
            return np.asarray(self._exact[index, columns])
        start, matrix = block
        weights = matrix[index - start]
        if len(weights) == 1:  # faster than the product below
            return np.asarray(weights[0] * self._exact[index, columns])
        within = self._exact[start : start + len(weights), columns]
        return np.asarray(np.tensordot(weights, within, axes=(0, 0)))
