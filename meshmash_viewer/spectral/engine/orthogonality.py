"""Keeping rows orthonormal: whole sets at the end, and blocks while a basis grows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Columns of rows that a product works on at once: they stay in the cache between its two ends.
_STRETCH = 4096
#: Rows whose Gram matrix is this near the identity count as orthonormal.
_NORMAL = 1e-13
#: A row that keeps less than this of its length, next to those before it, is one of them again.
_INDEPENDENT = 0.3


def _stretches(n: int) -> Iterator[slice]:
    return (slice(start, start + _STRETCH) for start in range(0, n, _STRETCH))


def multiply_in_place(weights: FloatArray, rows: FloatArray, result: FloatArray) -> None:
    """result = weights · rows, where `result` may be the first of `rows`, shape (m, n)."""
    for part in _stretches(rows.shape[1]):
        result[:, part] = weights @ rows[:, part]


def subtract(
    target: FloatArray,
    sources: Sequence[tuple[FloatArray, FloatArray]],
    against: Sequence[FloatArray],
) -> list[FloatArray]:
    """Subtract weights · rows for each of the sources; then target · rowsᵀ for each set of rows.

    The target, shape (b, n), is changed in place, and read from memory once for all of it.
    """
    products = [np.zeros((len(target), len(rows))) for rows in against]
    for part in _stretches(target.shape[1]):
        own = target[:, part]
        for weights, rows in sources:
            own -= weights @ rows[:, part]
        for product, rows in zip(products, against, strict=True):
            product += own @ rows[:, part].T
    return products


def project_out(target: FloatArray, against: FloatArray) -> FloatArray:
    """Take the directions of orthonormal rows (m, n) off the rows of `target` (b, n), in place.

    Returns
    -------
    ndarray, shape (b, m)
        Inner products before.
    """
    overlap = np.asarray(target @ against.T)
    subtract(target, [(overlap, against)], [])
    return overlap


def orthonormalise(rows: FloatArray) -> float:
    """Make nearly orthonormal rows (p, n) orthonormal, in place, by Cholesky's QR.

    Returns
    -------
    float
        Largest inner product between two rows as they are now, lengths' defect included.

    Raises
    ------
    ArithmeticError
        If the rows are far from independent.
    """
    for _ in range(3):
        gram = rows @ rows.T
        defect = float(np.abs(gram - np.eye(len(gram))).max(initial=0.0))
        if defect < _NORMAL:
            break
        inverse: FloatArray = np.asarray(np.linalg.inv(_independent_factor(gram)))
        multiply_in_place(inverse, rows, rows)
    return defect


def independent_gram(rows: FloatArray) -> FloatArray:
    """Inner products of rows (p, n) with each other.

    Raises
    ------
    ArithmeticError
        If the rows are far from independent.
    """
    gram: FloatArray = np.asarray(rows @ rows.T)
    _independent_factor(gram)
    return gram


def _independent_factor(gram: FloatArray) -> FloatArray:
    """Cholesky's factor of inner products; no row keeps little next to those before it."""
    try:
        lower: FloatArray = np.asarray(np.linalg.cholesky(gram))
    except np.linalg.LinAlgError:
        lower = np.zeros((1, 1))
    if not np.diagonal(lower).min() > _INDEPENDENT:
        raise ArithmeticError("the same eigenvector was found twice")
    return lower


def orthonormalise_block(
    block: FloatArray, gram: FloatArray | None = None
) -> tuple[FloatArray, bool]:
    """Cholesky QR of rows (8, n), up to twice, in place: old block = returned lower · new block.

    `gram` is block · blockᵀ where it is known already. False if the block has lost rank.
    """
    total = np.eye(len(block))
    if gram is None:
        gram = block @ block.T
    for _ in range(2):
        try:
            lower = np.asarray(np.linalg.cholesky(gram))
        except np.linalg.LinAlgError:
            return total, False
        if not np.diagonal(lower).min() ** 2 > 1e-13 * np.trace(gram):
            return total, False
        multiply_in_place(np.linalg.inv(lower), block, block)
        total = total @ lower
        gram = block @ block.T
        if np.abs(gram - np.eye(len(gram))).max() < _NORMAL:
            break
    return total, True
