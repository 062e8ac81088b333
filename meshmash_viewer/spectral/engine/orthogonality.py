"""Orthonormalisation of rows: of whole sets, and of blocks while a basis grows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshmash_viewer.arrays import FloatArray, blocks

#: Columns processed at a time, few enough to stay in the cache.
_CHUNK = 4096
#: Largest deviation of the Gram matrix of orthonormal rows from the identity.
_NORMAL = 1e-13
#: Smallest share of its norm that a row has orthogonal to those before it, if independent.
_INDEPENDENT = 0.3


def multiply_in_place(weights: FloatArray, rows: FloatArray, result: FloatArray) -> None:
    """Compute weights · rows into `result`, which may be the first of `rows`, shape (m, n)."""
    for part in blocks(rows.shape[1], _CHUNK):
        result[:, part] = weights @ rows[:, part]


def subtract(
    target: FloatArray,
    sources: Sequence[tuple[FloatArray, FloatArray]],
    against: Sequence[FloatArray],
) -> list[FloatArray]:
    """Subtract weights · rows for each source; return target · rowsᵀ for each set of rows.

    The target, shape (b, n), is changed in place, and read from memory only once.
    """
    products = [np.zeros((len(target), len(rows))) for rows in against]
    for part in blocks(target.shape[1], _CHUNK):
        own = target[:, part]
        for weights, rows in sources:
            own -= weights @ rows[:, part]
        for product, rows in zip(products, against, strict=True):
            product += own @ rows[:, part].T
    return products


def project_out(target: FloatArray, against: FloatArray) -> FloatArray:
    """Project orthonormal rows (m, n) out of the rows of `target` (b, n), in place.

    The inner products before the projection are returned, shape (b, m).
    """
    overlap = np.asarray(target @ against.T)
    subtract(target, [(overlap, against)], [])
    return overlap


def orthonormalise(rows: FloatArray) -> float:
    """Make nearly orthonormal rows (p, n) orthonormal, in place, by Cholesky's QR.

    The largest remaining defect of the inner products is returned. `ArithmeticError` is raised if
    the rows are far from independent.
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
    """Compute the Gram matrix of rows (p, n).

    `ArithmeticError` is raised if the rows are far from independent.
    """
    gram: FloatArray = np.asarray(rows @ rows.T)
    _independent_factor(gram)
    return gram


def _independent_factor(gram: FloatArray) -> FloatArray:
    """Compute the Cholesky factor of a Gram matrix; check that rows are independent."""
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
    """Orthonormalise rows (8, n) by Cholesky QR, up to twice, in place.

    Returns the factor with old block = lower · new block, and False if the block is rank deficient.
    `gram` is block · blockᵀ if it is known already.
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
