"""Use of the pairs of an earlier run, if they solve the problem and none of them is missing."""

from __future__ import annotations

import numpy as np

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.factorization import FactorizationError, OrderedPencil
from meshmash_viewer.spectral.engine.pairs import ReducedPairs
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.plan import SpectrumPlan
from meshmash_viewer.spectral.engine.refinement import measure_pairs

#: Largest residual, relative to the eigenvalue, of an accepted pair.
_RESIDUAL = 1e-6
#: Rows measured at a time.
_ROWS = 32
#: Number of last known pairs among which the widest gap is chosen as border.
_TAIL = 16
#: Relative distance below which neighbouring eigenvalues are equal.
_EQUAL = 1e-7
#: Smallest share of the norm of a known row that lies in the span of its slice.
_INSIDE = 1.0 - 1e-6


def fits(known: Eigenpairs, pencil: Pencil) -> bool:
    """Whether shape, dtype and null space of pairs are those of a problem."""
    if not len(known) or known.rows.dtype != np.float64 or known.rows.shape[1] != pencil.n_all:
        return False
    null = pencil.null_rows(len(known))
    return np.allclose(_rows(known, pencil, slice(len(null))), null, rtol=0.0, atol=1e-9)


def solves(known: Eigenpairs, ordered: OrderedPencil) -> bool:
    """Whether each pair solves a problem."""
    pencil = ordered.pencil
    return fits(known, pencil) and all(
        _solves(known, ordered, part) for part in blocks(len(known), _ROWS, pencil.n_null)
    )


def _solves(known: Eigenpairs, ordered: OrderedPencil, part: slice) -> bool:
    rows = _rows(known, ordered.pencil, part)
    values, residuals = measure_pairs(ordered, rows)
    limit = _RESIDUAL * np.maximum(values, 1e-3)
    # Written so that NaN fails as well.
    unit = np.abs(np.linalg.norm(rows, axis=1) - 1.0) < 1e-6
    small = np.abs(values - known.eigenvalues[part] / ordered.pencil.unit) <= limit
    return bool((unit & small & (residuals <= limit)).all())


def agree(known: Eigenpairs, pencil: Pencil, values: FloatArray) -> bool:
    """Whether known eigenvalues equal the first of all `values`, except for rounding."""
    m = min(len(values), len(known))
    limit = _RESIDUAL * np.maximum(np.abs(values[:m]), 1e-3)
    return bool((np.abs(values[:m] - known.eigenvalues[:m] / pencil.unit) <= limit).all())


def agree_with_counts(known: Eigenpairs, plan: SpectrumPlan, pencil: Pencil, most: int) -> bool:
    """Whether counts contradict neither index nor number of the first `most` known pairs.

    Counted are eigenvalues below the last pair and its copies, and below a value in a wide gap
    near the end, which does not separate copies of a multiple eigenvalue.
    """
    values = known.eigenvalues[:most] / pencil.unit
    index = np.arange(pencil.n_null + 1, len(values))
    gaps = values[index] - values[index - 1]
    wide = np.flatnonzero(gaps > _EQUAL * values[index])
    if len(wide) == 0:
        return True
    try:
        below_last = plan.settle(float(values[-1]), -1.0, wide=True)
        if plan.count(below_last) != index[wide[-1]]:
            return False
        last = wide[wide >= len(index) - _TAIL] if wide[-1] >= len(index) - _TAIL else wide[-1:]
        at = index[last[np.argmax(gaps[last])]]
        border = plan.settle(0.5 * float(values[at - 1] + values[at]))
    except FactorizationError:
        return False
    return bool(border < values[at] and plan.count(border) == at)


def complement(known: Eigenpairs, pencil: Pencil, part: slice, pairs: ReducedPairs) -> ReducedPairs:
    """Return the unknown ones of all `pairs` of a slice, which contains a part of the known pairs.

    They are ascending; their rows span the orthogonal complement of the known rows in the span of
    the rows of the slice. `ArithmeticError` is raised if a known row is outside.
    """
    inner = pairs.rows @ _rows(known, pencil, part).T
    left, sizes, _ = np.linalg.svd(inner, full_matrices=True)
    if sizes.min(initial=1.0) < _INSIDE:
        raise ArithmeticError("a known eigenvector does not lie in the slice of its eigenvalue")
    rest = left[:, part.stop - part.start :]
    found, rotation = np.linalg.eigh(rest.T @ (pairs.values[:, None] * rest))
    return ReducedPairs(found, np.asarray((rest @ rotation).T @ pairs.rows))


def _rows(known: Eigenpairs, pencil: Pencil, part: slice) -> FloatArray:
    """Return rows of the reduced problem, shape (p, n)."""
    found = np.asarray(known.rows[part], dtype=np.float64)
    return np.ascontiguousarray(found[:, pencil.active]) * pencil.root_mass
