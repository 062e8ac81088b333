"""All eigenpairs of the reduced problem in one interval, by shifted block Lanczos.

Grimes, Lewis & Simon 1994: the inverse ``(A - σ)^-1`` maps the eigenvalues around the shift to
the ends of its spectrum, where a block Krylov basis finds them first. The number of pairs in the
interval is known from inertia beforehand, so the iteration ends when that many have converged,
not when it looks finished.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshmash_viewer.engine.factorization import Factor, OrderedPencil, StopFlag
from meshmash_viewer.progress import Cancelled

__all__ = ["Interval", "IntervalPairs", "find_pairs", "measure_pairs", "orthonormalise"]

FloatArray = npt.NDArray[np.float64]

_BLOCK = 8
#: Columns of the basis that a product works on at once.
_STRETCH = 16384
#: Both newest blocks are orthogonalised against the whole basis every this many steps; three
#: lose copies without a sign.
_REORTHOGONALISE = 2
#: Blocks whose Gram matrix is this near the identity count as orthonormal.
_NORMAL = 1e-13
#: Runs that end with nothing new before the interval is given up.
_PATIENCE = 6
#: An eigenvalue nearer to the shift than this, in mean spacings, drowns the others in its rounding.
_NEAR = 1e-3
#: How far the shift is then moved, in mean spacings, and how often at most.
_MOVE, _MOVES = 0.3, 5


@dataclass(frozen=True)
class Interval:
    """A stretch of the spectrum and what it holds.

    Parameters
    ----------
    index : int
        Number of the slice, lowest first.
    low, high : float
        Ends, in the reduced problem; neither is an eigenvalue.
    first : int
        Number of eigenvalues below `low`, null space included.
    owed : int
        Number of eigenvalues inside, the null space not counted.
    """

    index: int
    low: float
    high: float
    first: int
    owed: int


@dataclass(frozen=True, eq=False)
class IntervalPairs:
    """The pairs of an interval.

    Parameters
    ----------
    interval : Interval
    values : ndarray, shape (p,)
        Rayleigh quotients, ascending up to rounding.
    residuals : ndarray, shape (p,)
        ``‖Lφ - λMφ‖ / ‖Mφ‖`` in the reduced unit.
    rows : ndarray, shape (p, n)
        Orthonormal, in elimination order.
    columns_solved : int
        Right-hand sides that were solved for.
    """

    interval: Interval
    values: FloatArray
    residuals: FloatArray
    rows: FloatArray
    columns_solved: int


def find_pairs(
    ordered: OrderedPencil, interval: Interval, tolerance: float, stop: StopFlag
) -> IntervalPairs:
    """Find the pairs that an interval owes.

    Parameters
    ----------
    ordered : OrderedPencil
    interval : Interval
    tolerance : float
        Wanted residual relative to the eigenvalue.
    stop : ndarray of uint8, shape (1,)
        Set from outside to make this raise `Cancelled`.

    Raises
    ------
    ArithmeticError
        If the pairs stay out of reach.
    """
    width = interval.high - interval.low
    factor = ordered.factor(0.5 * (interval.low + interval.high), 0.03 * width, stop)
    n, owed = ordered.pencil.n, interval.owed
    found_values = np.zeros(0)
    found = np.zeros((0, n))
    solved = 0
    fruitless = 0
    moves = 0
    every = _REORTHOGONALISE
    spacing = width / max(owed, 1)
    for attempt in range(40 + owed):
        missing = owed - len(found_values)
        if missing <= 0:
            break
        basis = _Basis(ordered, factor, interval, found, tolerance, stop, every)
        try:
            values, rows = basis.run(missing, seed=(interval.first, interval.owed, attempt))
            ordered.give_back(basis.rows)
        except ArithmeticError:
            # The basis lost its orthogonality and gave a pair twice.
            values, rows = np.zeros(0), np.zeros((0, n))
            every = 1
        solved += basis.columns_solved
        if moves < _MOVES and np.any(np.abs(values - factor.shift) < _NEAR * spacing):
            moves += 1
            factor = ordered.factor(factor.shift + _MOVE * spacing, 0.03 * width, stop)
            found_values, found = np.zeros(0), np.zeros((0, n))
            continue
        fruitless = fruitless + 1 if len(values) == 0 else 0
        if fruitless == _PATIENCE:
            break
        found_values = np.concatenate([found_values, values])
        if len(found):
            for _ in range(2):
                rows -= (rows @ found.T) @ found
                orthonormalise(rows)
            found = np.concatenate([found, rows])
        else:
            found = rows
    if len(found_values) != owed:
        raise ArithmeticError(
            f"{len(found_values)} of {owed} eigenvalues found between "
            f"{interval.low:.6g} and {interval.high:.6g}"
        )
    del basis
    order = np.argsort(found_values, kind="stable")
    rows = found[order] if np.any(order[1:] < order[:-1]) else found
    values, residuals = measure_pairs(ordered, rows)
    coarse = np.flatnonzero(residuals > tolerance * np.abs(values))
    if len(coarse):
        if interval.low < 0.0:
            factor = ordered.factor(-1.0, -0.1, stop)
        _polish(ordered, factor, rows, values, coarse)
        values, residuals = measure_pairs(ordered, rows)
    return IntervalPairs(interval, values, residuals, rows, solved)


def _polish(
    ordered: OrderedPencil,
    factor: Factor,
    rows: FloatArray,
    values: FloatArray,
    coarse: npt.NDArray[np.int64],
) -> None:
    """Rid some rows of the rounding that the basis left in them, by one inverse iteration.

    That rounding is spread over the whole spectrum, and A magnifies it by its norm: next to the
    smallest eigenvalues it is what bounds the residual. The inverse damps it again, best from a
    shift below zero, where the factor is as stable as Cholesky's. What stays is the rounding of
    the entries themselves, about eps ‖A‖ / λ.
    """
    for start in range(0, len(coarse), _BLOCK):
        some = coarse[start : start + _BLOCK]
        distance = values[some] - factor.shift
        given = np.zeros((rows.shape[1], _BLOCK))
        given[:, : len(some)] = (rows[some] * distance[:, None]).T
        better = given.copy()
        factor.solve(better)
        defect = given - ordered.multiply(better) + factor.shift * better
        factor.solve(defect)
        better += defect
        ordered.remove_null(better)
        rows[some] = better[:, : len(some)].T
    orthonormalise(rows)


class _Basis:
    """A block Krylov basis of the deflated inverse, and its projection T."""

    def __init__(
        self,
        ordered: OrderedPencil,
        factor: Factor,
        interval: Interval,
        found: FloatArray,
        tolerance: float,
        stop: StopFlag,
        every: int,
    ) -> None:
        self.every = every
        self.ordered, self.factor, self.interval = ordered, factor, interval
        self.found, self.tolerance, self.stop = found, tolerance, stop
        self.columns_solved = 0
        self.n = ordered.pencil.n
        self.free = self.n - ordered.pencil.n_null - len(found)

    def run(self, missing: int, seed: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Build the basis until the missing pairs have converged or nothing new comes."""
        b = _BLOCK
        # A copy that was missed may lie at an end of the interval, and cost as much as the rest.
        capacity = min(4 * self.interval.owed + 20 * b, b * max(self.free // b, 1))
        self.random = np.random.default_rng(seed)
        self.rows = self.ordered.borrow((capacity + 2 * b, self.n))
        self.columns = np.empty((self.n, b))
        self.projection = np.zeros((capacity + 2 * b, capacity + 2 * b))
        self._start()
        coupling = np.zeros((b, b))
        usual = min(int(2.3 * missing) + 4 * b, capacity)
        # Early looks are for multiple eigenvalues, of which a basis sees eight copies at most.
        check = min(10 * b, usual)
        stagnant = 0
        before = (-1, -1)
        size = 0
        while True:
            coupling = self._extend(size, coupling)
            size += b
            full = size + b > capacity
            if size < check and not full:
                continue
            mu, small, errors = self._ritz(size, coupling)
            theta = self.factor.shift + 1.0 / mu
            inside = (theta > self.interval.low) & (theta < self.interval.high)
            # After one more implicit solve the residual is this, whatever the norm of A.
            # Against the width, so that pairs of distant slices are orthogonal to as much.
            width = self.interval.high - self.interval.low
            wanted = self.tolerance * np.clip(np.abs(theta), 1e-3, width)
            floor = 1e-15 * np.linalg.norm(coupling) / mu**2
            ratio = errors / mu**2 / np.maximum(wanted, floor)
            n_inside, good = int(inside.sum()), int((inside & (ratio <= 1.0)).sum())
            stagnant = stagnant + 1 if (n_inside, good) == before else 0
            before = (n_inside, good)
            # All that is inside has converged, yet fewer than owed: other copies of multiple
            # eigenvalues are invisible to this basis.
            copies_left = n_inside == good < missing and good > 0 and stagnant >= 2
            if good > missing:
                raise ArithmeticError("more pairs converged than there are")
            if good == missing or full or copies_left:
                chosen = np.flatnonzero(inside & (ratio <= 1.0))
                chosen = chosen[np.argsort(theta[chosen], kind="stable")]
                return self._vectors(size, chosen, mu, small, coupling)
            check = size + (b if 0 < good == n_inside else 2 * b)
            if good < n_inside or good == 0:
                check = max(check, min(usual, 3 * size // 2))

    def _start(self) -> None:
        first = self.rows[:_BLOCK]
        self._apply(self.random.standard_normal((_BLOCK, self.n)), first)
        for _ in range(2):
            first[:] = np.linalg.qr(first.T)[0].T

    def _apply(self, block: FloatArray, result: FloatArray) -> None:
        """The deflated inverse times rows of shape (8, n)."""
        if self.stop[0]:
            raise Cancelled("stopped inside a slice")
        columns = self.columns
        self.ordered.fill_columns(block, columns)
        self.factor.solve(columns)
        self.ordered.remove_null(columns)
        self.columns_solved += _BLOCK
        self.ordered.fill_rows(columns, result)
        if len(self.found):
            result -= (result @ self.found.T) @ self.found

    def _extend(self, size: int, coupling: FloatArray) -> FloatArray:
        """One Lanczos step from the block at `size`; gives the coupling to the next block.

        The inner products of one pass over the vectors are what the next subtracts.
        """
        b, rows = _BLOCK, self.rows
        apply = self.ordered.subtract
        this, new = rows[size : size + b], rows[size + b : size + 2 * b]
        local = rows[max(size - b, 0) : size + b]
        nothing = rows[:0]
        self._apply(this, new)
        repair = np.zeros((b, len(local)))
        if size:
            repair[:, :b] = coupling.T
        repair = apply(new, local, repair, local)
        diagonal = repair[:, -b:].copy()
        repair[:, :-b] = 0.0
        if size and (size // b) % self.every == self.every - 1:
            apply(new, local, repair, nothing)
            newest, earlier = rows[size : size + 2 * b], rows[:size]
            overlap = newest @ earlier.T
            for start in range(0, self.n, _STRETCH):
                part = slice(start, start + _STRETCH)
                newest[:, part] -= overlap @ earlier[:, part]
            self._orthonormalise(this)
            local = this
            repair = apply(new, nothing, np.zeros((b, 0)), this)
        else:
            repair = apply(new, local, repair, local)
        diagonal += repair[:, -b:]
        at, after = slice(size, size + b), slice(size + b, size + 2 * b)
        self.projection[at, at] = 0.5 * (diagonal + diagonal.T)
        gram = apply(new, local, repair, new)
        following, ok = self._orthonormalise(new, gram)
        if not ok:
            following = self._replace_lost(new, size + b)
        self.projection[after, at] = following.T
        return following

    def _orthonormalise(
        self, block: FloatArray, gram: FloatArray | None = None
    ) -> tuple[FloatArray, bool]:
        """Cholesky QR, up to twice, in place: old block = returned lower · new block.

        `gram` is block · blockᵀ where it is known already. False if the block has lost rank.
        """
        total = np.eye(len(block))
        nothing, none = self.rows[:0], np.zeros((len(block), 0))
        if gram is None:
            gram = self.ordered.subtract(block, nothing, none, block)
        for _ in range(2):
            try:
                lower = np.asarray(np.linalg.cholesky(gram))
            except np.linalg.LinAlgError:
                return total, False
            if not np.diagonal(lower).min() ** 2 > 1e-13 * np.trace(gram):
                return total, False
            self.ordered.turn(block, np.linalg.inv(lower))
            total = total @ lower
            gram = self.ordered.subtract(block, nothing, none, block)
            if np.abs(gram - np.eye(len(gram))).max() < _NORMAL:
                break
        return total, True

    def _replace_lost(self, new: FloatArray, size: int) -> FloatArray:
        """Where the Krylov space has run out, go on with fresh directions, uncoupled."""
        scale = max(float(np.abs(np.diagonal(self.projection)[:size]).max()), 1e-300)
        directions, triangle = np.linalg.qr(new.T)
        following = triangle.T.copy()
        lost = np.abs(np.diagonal(triangle)) < 1e-10 * scale
        following[:, lost] = 0.0
        new[:] = directions.T
        new[lost] = self.random.standard_normal((int(lost.sum()), self.n))
        basis = self.rows[:size]
        for _ in range(3):
            columns = self.columns
            self.ordered.fill_columns(new, columns)
            self.ordered.remove_null(columns)
            self.ordered.fill_rows(columns, new)
            new -= (new @ self.found.T) @ self.found
            new -= (new @ basis.T) @ basis
            directions, triangle = np.linalg.qr(new.T)
            new[:] = (directions * np.sign(np.diagonal(triangle))).T
        return following

    def _ritz(self, size: int, coupling: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ritz values of the inverse, their coordinates, and ‖coupling · last block‖."""
        b = _BLOCK
        projected = self.projection[:size, :size]
        mu, small = np.linalg.eigh(projected, UPLO="L")
        errors = np.linalg.norm(coupling.T @ small[size - b :], axis=0)
        mu = np.where(np.abs(mu) < 1e-100, 1e-100, mu)
        return mu, small, errors

    def _vectors(
        self,
        size: int,
        chosen: npt.NDArray[np.int64],
        mu: FloatArray,
        small: FloatArray,
        coupling: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Ritz values and rows of the chosen pairs, after one implicit application."""
        b = _BLOCK
        if len(chosen) == 0:
            return np.zeros(0), np.zeros((0, self.n))
        weights = np.empty((len(chosen), size + b))
        weights[:, :size] = small[:, chosen].T
        weights[:, size:] = (coupling.T @ small[size - b :, chosen]).T / mu[chosen, None]
        # Pairs of an inverse are nearly of length 1 already; the weights' length makes them so.
        weights /= np.linalg.norm(weights, axis=1)[:, None]
        found = self.ordered.borrow((len(chosen), self.n))
        np.matmul(weights, self.rows[: size + b], out=found)
        orthonormalise(found)
        return self.factor.shift + 1.0 / mu[chosen], found


def measure_pairs(ordered: OrderedPencil, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rayleigh quotients of normalised rows (p, n) and their residuals in the norm of M."""
    p = len(rows)
    values, residuals = np.empty(p), np.empty(p)
    columns = np.zeros((ordered.pencil.n, _BLOCK))
    for start in range(0, p, _BLOCK):
        stop = min(start + _BLOCK, p)
        b = stop - start
        columns[:, :b] = rows[start:stop].T
        quotients, sizes = ordered.quotients(columns, ordered.multiply(columns))
        values[start:stop] = quotients[:b]
        residuals[start:stop] = sizes[:b]
    return values, residuals


def orthonormalise(rows: FloatArray, sweeps: int = 1) -> None:
    """Replace rows, shape (p, n), by the nearest orthonormal ones (Löwdin), in place.

    Raises
    ------
    ArithmeticError
        If the rows are far from independent.
    """
    for _ in range(sweeps):
        gram = rows @ rows.T
        if np.abs(gram - np.eye(len(gram))).max(initial=0.0) < _NORMAL:
            return
        values, turn = np.linalg.eigh(gram)
        if len(values) and values[0] < 0.1:
            raise ArithmeticError("the same eigenvector was found twice")
        mend = (turn / np.sqrt(values)) @ turn.T
        for start in range(0, rows.shape[1], _STRETCH):
            part = slice(start, start + _STRETCH)
            rows[:, part] = mend @ rows[:, part]
