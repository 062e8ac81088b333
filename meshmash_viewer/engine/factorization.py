"""Factors of shifted copies of a symmetric matrix, and eigenvalue counts from their inertia.

Two kinds behind one face: compiled multifrontal factors that keep only L and release the
interpreter lock, and SuperLU's where numba is not installed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from meshmash_viewer.engine.dissection import DissectionCrew
from meshmash_viewer.engine.pencil import Pencil
from meshmash_viewer.engine.row_memory import allocate
from meshmash_viewer.progress import Cancelled

__all__ = ["Factor", "FactorizationError", "OrderedPencil", "StopFlag", "order_pencil"]

FloatArray = npt.NDArray[np.float64]
#: One byte, shared with running kernels; any other value than 0 stops them.
StopFlag = npt.NDArray[np.uint8]

#: Largest backward error of the probe solve that a factor may show.
_PROBE_TOLERANCE = 1e-9
#: Used arrays that are kept for the next slice.
_SPARE = 4


class FactorizationError(RuntimeError):
    """No usable factor near the wanted shift."""


class Factor(Protocol):
    """``A - shift I = L D Lᵀ`` without pivoting.

    Sylvester's law of inertia: the number of negative pivots in D is the number of eigenvalues
    of A below the shift.
    """

    shift: float
    count_below: int
    #: Backward error of a probe solve: it grows with every pivot that is nearly zero.
    error: float

    def solve(self, block: FloatArray) -> None:
        """Solve ``(A - shift I) X = block`` in place, shape (n, 8), C order."""


@dataclass(frozen=True, eq=False)
class OrderedPencil:
    """A pencil in elimination order, and what its factors have in common.

    Parameters
    ----------
    pencil : Pencil
        Its vertices are in elimination order.
    structure : Structure or None
        Blocks of the compiled factor; None where SuperLU factors.
    spare, lock
        Memory of bases that are done, and who may take from it.
    kept : dict
        Factors that were made to count and will be asked for again, by shift.
    """

    pencil: Pencil
    structure: Any
    spare: list[FloatArray] = field(default_factory=list, repr=False)
    lock: Any = field(default_factory=threading.Lock, repr=False)
    kept: dict[float, Factor] = field(default_factory=dict, repr=False)

    def factor(self, shift: float, nudge: float, stop: StopFlag) -> Factor:
        """Factor near a shift, moving it by `nudge` at most five times until it is sound.

        Raises
        ------
        FactorizationError
            If no shift gave a sound factor.
        Cancelled
            If `stop` was set.
        """
        kept = self.kept.pop(shift, None)
        if kept is not None:
            return kept
        kind = _SuperFactor if self.structure is None else _CompiledFactor
        for attempt in range(6):
            if stop[0]:
                raise Cancelled("stopped before a factorization")
            try:
                factor: Factor = kind(self, shift + attempt * nudge, stop)
            except FactorizationError:
                continue
            factor.error = _probe(self.pencil, factor)
            if factor.error < _PROBE_TOLERANCE:
                return factor
        raise FactorizationError(f"no stable factor near shift {shift:.6g}")

    def multiply(self, block: FloatArray, exactly: bool = False) -> FloatArray:
        """Return ``A @ block`` for shape (n, 8), if wanted with sums in twice the precision."""
        matrix = self.pencil.matrix
        if self.structure is None:
            if exactly:
                return np.asarray(matrix.astype(np.longdouble) @ block, dtype=np.float64)
            return np.asarray(matrix @ block)
        from meshmash_viewer.engine import kernels

        multiply = kernels.multiply_block_exactly if exactly else kernels.multiply_block
        start, index = self.structure.matrix_start, self.structure.matrix_index
        result = np.empty_like(block)
        multiply(start, index, matrix.data, block.reshape(-1), result.reshape(-1))
        return result

    def borrow(self, shape: tuple[int, int]) -> FloatArray:
        """An array for a basis, used before if there is one: fresh memory is slow to touch."""
        size = shape[0] * shape[1]
        with self.lock:
            fitting = [m for m in self.spare if size <= len(m) < 2 * size]
            if fitting:
                self.spare[:] = [m for m in self.spare if m is not fitting[0]]
        memory = fitting[0] if fitting else allocate(size + size // 8)
        return memory[:size].reshape(shape)

    def give_back(self, rows: FloatArray) -> None:
        """Return a borrowed array."""
        memory = rows.base
        if isinstance(memory, np.ndarray) and memory.ndim == 1 and memory.flags.writeable:
            with self.lock:
                self.spare.append(memory)
                del self.spare[:-_SPARE]

    def __getstate__(self) -> dict[str, Any]:
        """What a worker process needs."""
        return {"pencil": self.pencil, "structure": self.structure}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def quotients(self, block: FloatArray, images: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rayleigh quotients of normalised columns (n, 8), and residuals in the norm of M."""
        weight = self.pencil.root_mass
        if self.structure is None:
            values = np.einsum("ij,ij->j", block, images)
            defect = (images - block * values) * weight[:, None]
            sizes = np.linalg.norm(block * weight[:, None], axis=0)
            return values, np.linalg.norm(defect, axis=0) / np.where(sizes > 0.0, sizes, 1.0)
        from meshmash_viewer.engine.kernels import quotients_block

        values, residuals = np.zeros(8), np.zeros(8)
        quotients_block(block, images, weight, values, residuals)
        return values, residuals

    def subtract(
        self,
        target: FloatArray,
        sources: Sequence[tuple[FloatArray, FloatArray]],
        against: Sequence[FloatArray],
    ) -> list[FloatArray]:
        """Subtract weights · source for each source; then target · rowsᵀ for each set of rows.

        In place, for rows of shape (8, n): at most two sources, (weights, rows), and two sets.
        """
        if self.structure is None:
            for weights, rows in sources:
                target -= weights @ rows
            return [np.asarray(target @ rows.T) for rows in against]
        from meshmash_viewer.engine.kernels import subtract_rows

        nothing = np.zeros((len(target), 0)), target[:0]
        (w1, r1), (w2, r2) = [*sources, nothing, nothing][:2]
        products = [np.empty((len(target), len(rows))) for rows in against]
        (p1, a1), (p2, a2) = [*zip(products, against, strict=True), nothing, nothing][:2]
        w1, w2 = np.ascontiguousarray(w1), np.ascontiguousarray(w2)
        subtract_rows(target, r1, w1, r2, w2, a1, p1, a2, p2)
        return products

    def turn(self, target: FloatArray, lower: FloatArray) -> None:
        """target = lower · target for rows of shape (8, n), in place."""
        if self.structure is None:
            target[:] = lower @ target
            return
        from meshmash_viewer.engine.kernels import turn_rows

        turn_rows(target, np.ascontiguousarray(lower))

    def fill_columns(self, rows: FloatArray, columns: FloatArray) -> None:
        """Write rows of shape (8, n) into a block of shape (n, 8)."""
        if self.structure is None:
            columns[:] = rows.T
        else:
            from meshmash_viewer.engine.kernels import spread_rows

            spread_rows(rows, columns)

    def fill_rows(self, columns: FloatArray, rows: FloatArray) -> None:
        """Write a block of shape (n, 8) into rows of shape (8, n)."""
        if self.structure is None:
            rows[:] = columns.T
        else:
            from meshmash_viewer.engine.kernels import collect_rows

            collect_rows(columns, rows)

    def remove_null(self, block: FloatArray) -> None:
        """Project the null space out of a block of shape (n, 8), in place."""
        pencil = self.pencil
        if pencil.n_null == 0:
            return
        if self.structure is None:
            pencil.remove_null(block)
            return
        from meshmash_viewer.engine.kernels import remove_null_block

        sums = np.zeros((pencil.n_null, block.shape[1]))
        remove_null_block(pencil.labels, pencil.null_direction, sums, block)


def order_pencil(
    pencil: Pencil,
    poll: Callable[[], None] | None = None,
    crew: DissectionCrew | None = None,
) -> OrderedPencil:
    """Put a pencil in elimination order and analyse its factor.

    `poll` is called several times a second while that takes long; what it raises ends it. A crew
    that was started early saves its start; it is closed.
    """
    try:
        from meshmash_viewer.engine.symbolic import analyse, elimination_order
    except ImportError:  # without numba SuperLU orders and factors
        return OrderedPencil(pencil, None)
    ordered = pencil.permuted(elimination_order(pencil.matrix, poll, crew))
    return OrderedPencil(ordered, analyse(ordered.matrix))


class _CompiledFactor:
    """Supernodal LDLᵀ by the kernels."""

    error = np.inf

    def __init__(self, ordered: OrderedPencil, shift: float, stop: StopFlag) -> None:
        from meshmash_viewer.engine.multifrontal import factor_numeric

        structure = ordered.structure
        self.shift = shift
        self._structure = structure
        self._blocks = np.empty(structure.n_entries)
        self._inverse = np.empty(ordered.pencil.n)
        outcome = factor_numeric(
            ordered.pencil.matrix.data,
            shift,
            structure.first,
            structure.row_start,
            structure.rows,
            structure.block_start,
            structure.children,
            structure.lower_start,
            structure.lower_rows,
            structure.lower_source,
            structure.stack_size,
            structure.front_size,
            self._blocks,
            self._inverse,
            stop,
        )
        if outcome == -2:
            raise Cancelled("stopped inside a factorization")
        if outcome < 0:
            raise FactorizationError(f"a pivot vanished at shift {shift:.6g}")
        self.count_below = int(outcome)

    def solve(self, block: FloatArray) -> None:
        from meshmash_viewer.engine.multifrontal import solve_block

        structure = self._structure.unsigned
        solve_block(*structure, self._blocks, self._inverse, block.reshape(-1))


class _SuperFactor:
    """SuperLU's factor in symmetric mode."""

    error = np.inf

    def __init__(self, ordered: OrderedPencil, shift: float, stop: StopFlag) -> None:
        from scipy.sparse.linalg import splu

        matrix = ordered.pencil.matrix
        self.shift = shift
        shifted = sp.csc_array(matrix - shift * sp.eye_array(matrix.shape[0], format="csc"))
        try:
            self._lu = splu(
                shifted,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as fault:  # an exactly zero pivot
            raise FactorizationError(str(fault)) from fault
        if not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            raise FactorizationError(f"the factor at shift {shift:.6g} was pivoted")
        self.count_below = int(np.count_nonzero(self._lu.U.diagonal() < 0.0))

    def solve(self, block: FloatArray) -> None:
        block[:] = self._lu.solve(block)


def _probe(pencil: Pencil, factor: Factor) -> float:
    """Backward error of a solve with a fixed right-hand side."""
    n = pencil.n
    block = np.zeros((n, 8))
    block[:, 0] = probe = np.cos(np.arange(n, dtype=np.float64))
    factor.solve(block)
    answer = block[:, 0].copy()
    defect = pencil.matrix @ answer - factor.shift * answer - probe
    size = abs(answer)
    scale = pencil.magnitudes @ size + abs(factor.shift) * size + abs(probe)
    return float(np.linalg.norm(defect) / np.linalg.norm(scale))
