"""Eigenvalues of small symmetric matrices in twice the precision of float64.

A number is the unevaluated sum of two float64, the second below the last digit of the first (Dekker
1971): about 32 decimal digits, on any machine, in NumPy alone. Small eigenvalues are accurate even
if matrix entries span 1 : 1e16. The errors of `numpy.linalg.eigvalsh` are 1e-16 of the largest
eigenvalue.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["EPS", "eigenvalues", "reduced_matrix"]

FloatArray = npt.NDArray[np.float64]
#: High and low part.
Pair = tuple[FloatArray, FloatArray]

#: Unit of the last digit.
EPS = 2.0**-104
#: Splits a float64 into two halves of 26 bits.
_SPLITTER = 2.0**27 + 1.0
#: Interior points that divide a bracket in each step of bisection.
_INNER = 7


def _sum(a: FloatArray, b: FloatArray) -> Pair:
    """Return a + b and its rounding error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def _halves(a: FloatArray) -> Pair:
    scaled = _SPLITTER * a
    high = scaled - (scaled - a)
    return high, a - high


def _product(a: FloatArray, b: FloatArray) -> Pair:
    """Return a · b and its rounding error."""
    value = a * b
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    return value, ((a1 * b1 - value) + a1 * b2 + a2 * b1) + a2 * b2


def _renormalised(high: FloatArray, low: FloatArray) -> Pair:
    total = high + low
    return total, low - (total - high)


def _add(x: Pair, y: Pair) -> Pair:
    high, error = _sum(x[0], y[0])
    low, rest = _sum(x[1], y[1])
    high, error = _renormalised(high, error + low)
    return _renormalised(high, error + rest)


def _negative(x: Pair) -> Pair:
    return -x[0], -x[1]


def _multiply(x: Pair, y: Pair) -> Pair:
    value, error = _product(x[0], y[0])
    return _renormalised(value, error + (x[0] * y[1] + x[1] * y[0]))


def _divide(x: Pair, y: Pair) -> Pair:
    first = x[0] / y[0]
    rest = _add(x, _negative(_multiply(y, (first, np.zeros_like(first)))))
    second = rest[0] / y[0]
    rest = _add(rest, _negative(_multiply(y, (second, np.zeros_like(second)))))
    high, low = _renormalised(first, second)
    return _renormalised(high, low + rest[0] / y[0])


def _root(x: Pair) -> Pair:
    """Return the square roots of nonnegative numbers."""
    start = np.sqrt(x[0])
    safe = np.where(start > 0.0, start, 1.0)
    rest = _add(x, _negative(_product(start, start)))
    return _renormalised(start, np.where(start > 0.0, rest[0] / (2.0 * safe), 0.0))


def _total(x: Pair) -> Pair:
    """Return the sum over the last axis, added pairwise."""
    high, low = x
    while (length := high.shape[-1]) > 1:
        half = length // 2
        added = _add(
            (high[..., :half], low[..., :half]),
            (high[..., half : 2 * half], low[..., half : 2 * half]),
        )
        if length % 2:
            added = (
                np.concatenate([added[0], high[..., -1:]], axis=-1),
                np.concatenate([added[1], low[..., -1:]], axis=-1),
            )
        high, low = added
    return high[..., 0], low[..., 0]


def _exact(values: npt.ArrayLike) -> Pair:
    high = np.asarray(values, dtype=np.float64)
    return high, np.zeros_like(high)


def reduced_matrix(stiffness: FloatArray, mass: FloatArray) -> Pair:
    """Return ``M^-1/2 L M^-1/2`` for L of shape (n, n) and a diagonal M of shape (n,)."""
    root = _root(_exact(mass))
    scale = _multiply((root[0][:, None], root[1][:, None]), (root[0][None], root[1][None]))
    return _divide(_exact(stiffness), scale)


def _tridiagonal(matrix: Pair) -> tuple[Pair, Pair]:
    """Return diagonal, (n,), and squared off-diagonal, (n - 1,), of the tridiagonal form."""
    high, low = matrix[0].copy(), matrix[1].copy()
    n = len(high)
    diagonal, squares = _exact(np.zeros(n)), _exact(np.zeros(max(n - 1, 0)))
    for k in range(n - 1):
        diagonal[0][k], diagonal[1][k] = high[k, k], low[k, k]
        x = high[k + 1 :, k].copy(), low[k + 1 :, k].copy()
        square = _total(_multiply(x, x))
        squares[0][k], squares[1][k] = square
        if not square[0] > 0.0 or k == n - 2:
            continue
        length = _root((np.asarray(square[0]), np.asarray(square[1])))
        sign = -1.0 if x[0][0] < 0.0 else 1.0
        first = _add((x[0][:1], x[1][:1]), (sign * length[0], sign * length[1]))
        x[0][0], x[1][0] = first[0][0], first[1][0]
        # The reflection is I - beta x xᵀ.
        beta = _divide(_exact(2.0), _total(_multiply(x, x)))
        rest = high[k + 1 :, k + 1 :], low[k + 1 :, k + 1 :]
        image = _multiply(_total(_multiply(rest, (x[0][None], x[1][None]))), beta)
        share = _multiply(_multiply(_exact(0.5), beta), _total(_multiply(image, x)))
        image = _add(image, _negative(_multiply(share, x)))
        outer = _multiply((x[0][:, None], x[1][:, None]), (image[0][None], image[1][None]))
        outer = _add(outer, (outer[0].T, outer[1].T))
        high[k + 1 :, k + 1 :], low[k + 1 :, k + 1 :] = _add(rest, _negative(outer))
    diagonal[0][n - 1], diagonal[1][n - 1] = high[-1, -1], low[-1, -1]
    return diagonal, squares


def _count_below(diagonal: Pair, squares: Pair, at: FloatArray) -> npt.NDArray[np.int64]:
    """Count the eigenvalues of the tridiagonal matrix below each value (Sturm sequence)."""
    count = np.zeros(len(at), dtype=np.int64)
    smallest = EPS * max(float(np.abs(diagonal[0]).max()), 1e-290) * EPS
    q: Pair = _exact(np.ones(len(at)))
    for i in range(len(diagonal[0])):
        new = _add((diagonal[0][i : i + 1], diagonal[1][i : i + 1]), _exact(-at))
        if i:
            square = squares[0][i - 1 : i] + 0.0 * at, squares[1][i - 1 : i] + 0.0 * at
            new = _add(new, _negative(_divide(square, q)))
        vanished = np.abs(new[0]) < smallest
        q = np.where(vanished, -smallest, new[0]), np.where(vanished, 0.0, new[1])
        count += q[0] < 0.0
    return count


def eigenvalues(
    matrix: Pair, near: FloatArray, reach: float, wanted: FloatArray
) -> tuple[FloatArray, float]:
    """Compute all eigenvalues, ascending.

    Parameters
    ----------
    matrix : pair of ndarray, shape (n, n)
        Symmetric.
    near : ndarray, shape (n,)
        The eigenvalues in float64, ascending.
    reach : float
        Expected error of `near`. Brackets widen if the error is larger.
    wanted : ndarray, shape (n,)
        Tolerated error of each eigenvalue.

    Returns
    -------
    values : ndarray, shape (n,)
    error : float
        Rounding error of this arithmetic, in addition to `wanted`.
    """
    scale = float(np.abs(matrix[0]).max())
    if scale == 0.0:
        return np.zeros(len(near)), 0.0
    diagonal, squares = _tridiagonal(matrix)
    n = len(near)
    index = np.arange(n)
    low, high = near - reach, near + reach
    for _ in range(60):
        too_high = _count_below(diagonal, squares, low) > index
        too_low = _count_below(diagonal, squares, high) <= index
        if not (too_high.any() or too_low.any()):
            break
        reach *= 4.0
        low, high = np.where(too_high, near - reach, low), np.where(too_low, near + reach, high)
    parts = np.arange(1, _INNER + 1) / (_INNER + 1)
    for _ in range(60):
        wide = np.flatnonzero(high - low > wanted)
        wide = wide[np.nextafter(low[wide], np.inf) < high[wide]]
        if len(wide) == 0:
            break
        probes = low[wide, None] + parts * (high - low)[wide, None]
        below = _count_below(diagonal, squares, probes.ravel()).reshape(probes.shape)
        under = (below <= wide[:, None]).sum(axis=1)
        edges = np.column_stack([low[wide], probes, high[wide]])
        rows = np.arange(len(wide))
        low[wide], high[wide] = edges[rows, under], edges[rows, under + 1]
    return 0.5 * (low + high), 64.0 * n * EPS * float(np.abs(near).max() + reach)
