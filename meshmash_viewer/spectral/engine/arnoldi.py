"""Eigenpairs by SciPy's ARPACK with an inverse given by the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import wrong_shape
from meshmash_viewer.spectral.engine.basis import orthonormalise
from meshmash_viewer.spectral.engine.pairs import Interval, ReducedPairs
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.request import Request

#: Number of additional pairs that are computed.
_EXTRA = 6


def pairs_around(
    pencil: Pencil, request: Request, check: Callable[[], None]
) -> ReducedPairs | None:
    """Compute the pairs of a request with `op_inv`; return None if ARPACK finds too few.

    A few additional pairs are computed, so that the counted interval can end in the widest gap
    after the last requested pair. `Interval.first` is the number of pairs found in the interval
    below the first requested one.
    """
    assert request.n_components is not None
    wanted, n_rest = request.n_components, pencil.n - pencil.n_null
    asked = min(wanted + _EXTRA, n_rest - 1)
    if asked < 1 or wanted >= pencil.n_null + asked:
        return None
    found, rows = _pairs_of_inverse(pencil, request.op_inv, asked, request.ncv, check)
    values = np.concatenate([np.zeros(pencil.n_null), found])
    shift = (request.target or 0.0) / pencil.unit
    distance = np.abs(values - shift)
    order = np.argsort(distance, kind="stable")
    # Beyond the farthest pair found other pairs are unknown, so zeros farther away are ignored.
    order = order[distance[order] <= distance[pencil.n_null :].max(initial=0.0)]
    if len(order) <= wanted:
        return None
    away = distance[order]
    last = wanted - 1 + int(np.argmax(np.diff(away[wanted - 1 :])))
    radius = 0.5 * float(away[last] + away[last + 1])
    chosen = np.sort(order[:wanted])
    null, rest = chosen[chosen < pencil.n_null], chosen[chosen >= pencil.n_null]
    rows = np.concatenate([pencil.null_rows(wanted)[null], rows[rest - pencil.n_null]])
    orthonormalise(rows)
    low, high = max(shift - radius, 0.0), shift + radius
    first = int(np.count_nonzero(order[: last + 1] < chosen[0]))
    interval = Interval(low, high, first, last + 1, shift)
    return ReducedPairs(values[chosen], rows, interval=interval)


def _pairs_of_inverse(
    pencil: Pencil, inverse: Any, k: int, ncv: int | None, check: Callable[[], None]
) -> tuple[FloatArray, FloatArray]:
    """Compute eigenvalues (k,), ascending, and rows (k, n) beyond the null space.

    Fewer are returned if some do not converge. The pairs are those nearest the σ of `inverse`,
    ``(L - σ M)^-1``, shape (n_all, n_all); `ncv` is the size of the Krylov basis; `check` is called
    before each application of the inverse.
    """
    from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigsh

    n = pencil.n
    if np.shape(inverse) != (pencil.n_all, pencil.n_all):
        raise wrong_shape("op_inv and L", np.shape(inverse), f"({pencil.n_all}, {pencil.n_all})")

    def apply(column: FloatArray) -> FloatArray:
        check()
        inner = column.reshape(n).copy()
        pencil.remove_null(inner)
        # (A - s)^-1 = unit M^1/2 (L - sigma M)^-1 M^1/2 on the active vertices.
        whole = np.zeros(pencil.n_all)
        whole[pencil.active] = pencil.root_mass * inner
        answer = np.asarray(inverse @ whole).ravel()[pencil.active] * pencil.root_mass
        answer *= pencil.unit
        pencil.remove_null(answer)
        return answer

    start = np.random.default_rng(0).standard_normal(n)
    pencil.remove_null(start)
    operator = LinearOperator((n, n), matvec=apply, dtype=np.float64)
    basis = min(n, max(ncv or 0, 2 * k + 20))
    columns: Any
    try:
        _, columns = eigsh(operator, k=k, which="LM", v0=start, ncv=basis, tol=1e-13)
    except ArpackNoConvergence as fault:
        columns = fault.eigenvectors
    except ArpackError:
        columns = np.zeros((n, 0))
    rows = np.ascontiguousarray(columns.T)
    if not np.isfinite(rows).all():
        rows = rows[:0]
    orthonormalise(rows)
    small = rows @ (pencil.matrix @ rows.T)
    values, rotation = np.linalg.eigh(0.5 * (small + small.T))
    return values, rotation.T @ rows
