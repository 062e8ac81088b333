"""Pairs from the rows of a Krylov basis: rotation, measurement and refinement."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.spectral.engine.basis import (
    BLOCK,
    independent_gram,
    multiply_in_place,
    orthonormalise,
    project_out,
)
from meshmash_viewer.spectral.engine.factorization import Factor, OrderedPencil
from meshmash_viewer.spectral.engine.pairs import ReducedPairs

#: Residuals above this multiple of the tolerance are refined.
_COARSE = 8.0
#: Maximum number of refinements.
_POLISHES = 3
#: Correction of rows above which they have to be orthonormalised again.
_SEEN = 1e-7
#: Number of products of A with rows held in memory.
_IMAGES = 8 * BLOCK


def rotate_to_pairs(ordered: OrderedPencil, rows: FloatArray) -> ReducedPairs:
    """Rotate nearly orthonormal rows (p, n) to Ritz vectors of A, in place (Rayleigh–Ritz).

    Rounding in the inverse mixes pairs of close eigenvalues; the rotation separates them. Returned
    are the pairs, ascending, without residuals. `ArithmeticError` is raised if the rows are far
    from independent.
    """
    from scipy.linalg import eigh

    p, n = rows.shape
    if p == 0:
        return ReducedPairs(np.zeros(0), rows, orthonormality=0.0)
    projection = np.empty((p, p))
    columns = np.zeros((n, BLOCK))
    images = np.empty((_IMAGES, n))
    for many in blocks(p, _IMAGES):
        for some in blocks(many.stop, BLOCK, many.start):
            columns[:, : some.stop - some.start] = rows[some].T
            image, at = ordered.multiply(columns), some.start - many.start
            ordered.fill_rows(image, images[at : at + BLOCK])
        projection[:, many] = rows @ images[: many.stop - many.start].T
    gram = independent_gram(rows)
    values, weights = eigh(projection, gram)
    multiply_in_place(np.ascontiguousarray(weights.T), rows, rows)
    return ReducedPairs(values, rows, orthonormality=orthonormalise(rows))


def measure_pairs(
    ordered: OrderedPencil, rows: FloatArray, exactly: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Compute Rayleigh quotients of normalised rows (p, n) and residuals in the M norm.

    With `exactly` products have twice the precision, and rows are rounded as in a division by the
    roots of the masses.
    """
    if exactly:
        root_mass = ordered.pencil.root_mass
        rows = rows / root_mass * root_mass
    p = len(rows)
    values, residuals = np.empty(p), np.empty(p)
    columns = np.zeros((ordered.pencil.n, BLOCK))
    for some in blocks(p, BLOCK):
        b = some.stop - some.start
        columns[:, :b] = rows[some].T
        quotients, sizes = ordered.quotients(columns, ordered.multiply(columns, exactly))
        values[some], residuals[some] = quotients[:b], sizes[:b]
    return values, residuals


def refine_pairs(
    ordered: OrderedPencil,
    factor: Factor,
    pairs: ReducedPairs,
    tolerance: float,
    lowest: bool,
) -> ReducedPairs:
    """Measure pairs, refine the rows of inaccurate pairs in place, and return all of them.

    `factor` has a shift near the eigenvalues; `tolerance` is the residual relative to the
    eigenvalue; `lowest` is True for the lowest pairs. `ArithmeticError` is raised if an eigenvalue
    is negative.
    """
    rows, orthonormality = pairs.rows, pairs.orthonormality or 0.0
    values, residuals = measure_pairs(ordered, rows)
    if lowest and values[0] < -max(1e-6, 1e-9 * ordered.pencil.norm):
        raise ArithmeticError(f"a negative eigenvalue, {values[0]:.6g}")
    refined = np.zeros(len(rows), dtype=bool)
    for attempt in range(_POLISHES):
        coarse = np.flatnonzero(residuals > _COARSE * tolerance * np.abs(values))
        if len(coarse) == 0:
            break
        if attempt == 1 and lowest:
            # A factor closer to the lowest eigenvalue damps components of neighbouring eigenvectors
            # too; it is seldom needed.
            below = -float(values[coarse[0]])
            factor = ordered.factor(below, 0.1 * below)
        gained = _polish(ordered, factor, rows, values, residuals, coarse)
        if len(gained) == 0:
            break
        orthonormality = max(orthonormality, _insert_refined(rows, gained))
        values, residuals = measure_pairs(ordered, rows)
        values[gained], residuals[gained] = measure_pairs(ordered, rows[gained], exactly=True)
        refined[gained] = True
    # Residuals in twice the precision do not contain the rounding of A and of the rows.
    residuals[refined] = np.hypot(residuals[refined], _rounding(ordered, rows[refined]))
    return ReducedPairs(values, rows, residuals, orthonormality)


def _polish(
    ordered: OrderedPencil,
    factor: Factor,
    rows: FloatArray,
    values: FloatArray,
    residuals: FloatArray,
    coarse: npt.NDArray[np.int64],
) -> npt.NDArray[np.int64]:
    """Refine some rows, in place, by one inverse iteration; return the indices of improved rows.

    Rounding errors of the basis, spread over the whole spectrum and magnified by the norm of A,
    limit the residuals of the smallest eigenvalues. The inverse damps these errors; with a shift
    below zero, as close to zero as the smallest eigenvalue, it damps components of neighbouring
    eigenvectors too. The solution is refined with defects in twice the precision. The rounding of
    entries remains, about eps ‖A‖ / λ: 1e-9 in float64 for the first eigenfunction of a neuron of a
    hundred thousand vertices. Rows that do not improve are unchanged.
    """
    gained: list[npt.NDArray[np.int64]] = []
    for part in blocks(len(coarse), BLOCK):
        some = coarse[part]
        given = np.zeros((rows.shape[1], BLOCK))
        given[:, : len(some)] = (rows[some] * (values[some] - factor.shift)[:, None]).T
        better = given.copy()
        factor.solve(better)
        defect = given - ordered.multiply(better, exactly=True) + factor.shift * better
        factor.solve(defect)
        better += defect
        ordered.remove_null(better)
        candidates = np.ascontiguousarray(better[:, : len(some)].T)
        candidates /= np.linalg.norm(candidates, axis=1)[:, None]
        gains = measure_pairs(ordered, candidates, exactly=True)[1] < 0.7 * residuals[some]
        rows[some[gains]] = candidates[gains]
        gained.append(some[gains])
    return np.concatenate(gained)


def _insert_refined(rows: FloatArray, some: npt.NDArray[np.int64]) -> float:
    """Make refined rows orthonormal, and the other, less accurate rows orthogonal to them.

    Returns the largest defect of the inner products.
    """
    pure = rows[some]
    orthonormalise(pure)
    rows[some] = 0.0
    shared = project_out(rows, pure)
    rows[some] = pure
    if np.abs(shared).max() > _SEEN:
        return orthonormalise(rows)
    overlap = pure @ rows.T
    overlap[np.arange(len(some)), some] -= 1.0
    return float(np.abs(overlap).max())


def _rounding(ordered: OrderedPencil, rows: FloatArray) -> FloatArray:
    """Compute the contribution of the rounding of A and of rows to residuals, shape (p,).

    Residuals in twice the precision are exact for the rounded A and rows only.
    """
    sizes = np.empty(len(rows))
    weight = ordered.pencil.root_mass[:, None]
    columns = np.zeros((ordered.pencil.n, BLOCK))
    for part in blocks(len(rows), BLOCK):
        some = np.abs(rows[part]).T
        width = some.shape[1]
        columns[:, :width] = some
        image = ordered.multiply(columns, magnitudes=True)[:, :width] * weight
        sizes[part] = np.linalg.norm(image, axis=0) / np.linalg.norm(some * weight, axis=0)
    return np.asarray(0.5 * np.finfo(np.float64).eps * sizes)
