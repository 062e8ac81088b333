"""Factors of shifted copies of a symmetric matrix, and eigenvalue counts from their inertia."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.dense import RepeatedComponents
from meshmash_viewer.spectral.engine.pencil import Pencil

#: One byte, shared with running kernels; any value other than 0 stops them.
StopFlag = npt.NDArray[np.uint8]

#: Largest allowed backward error of the probe solve.
_PROBE_TOLERANCE = 1e-9
#: Exponents of ten in the multiples of the nudge by which a shift is moved.
_POWERS = (-6, -4, -2, -1, 0)


class FactorizationError(RuntimeError):
    """No usable factor near the requested shift."""


@dataclass(eq=False)
class OrderedPencil:
    """A pencil in elimination order, with the symbolic structure of its factors."""

    #: The pencil, whose vertices are in elimination order.
    pencil: Pencil
    #: Block structure of the factors.
    structure: Any
    stop: StopFlag = field(default_factory=lambda: np.zeros(1, dtype=np.uint8))
    #: Factors of counts that will be reused, by shift.
    kept: dict[float, Factor] = field(default_factory=dict, repr=False)
    #: Number of blocks solved so far, a measure of progress.
    steps: int = 0

    @cached_property
    def repeated(self) -> RepeatedComponents:
        """Components solved separately, none until `RepeatedComponents.solve` is called."""
        return RepeatedComponents(self.pencil)

    def factor(self, shift: float, nudge: float) -> Factor:
        """Return a factor at a shift or, if a pivot vanishes, close to it.

        A pivot may be nearly zero even if no eigenvalue is near. The shift is then moved to both
        sides by 1e-6 `nudge`, 1e-4 `nudge` and so on, up to `nudge`.

        `FactorizationError` is raised if no shift gives a stable factor, and `Cancelled` if `stop`
        is set.
        """
        kept = self.kept.pop(shift, None)
        if kept is not None:
            return kept
        moves = [0.0, *(side * nudge * 10.0**power for power in _POWERS for side in (1.0, -1.0))]
        for move in moves:
            if self.stop[0]:
                raise Cancelled("stopped before a factorization")
            factor = self.factor_at(shift + move)
            if factor is not None:
                return factor
        raise FactorizationError(f"no stable factor near shift {shift:.6g}")

    def factor_at(self, shift: float) -> Factor | None:
        """Return a factor at exactly this shift, or None if a pivot nearly vanishes."""
        try:
            factor = Factor(self, shift)
        except FactorizationError:
            return None
        return factor if factor.error < _PROBE_TOLERANCE else None

    def multiply(
        self, block: FloatArray, exactly: bool = False, magnitudes: bool = False
    ) -> FloatArray:
        """Compute ``A @ block`` or ``|A| @ block``, (n, 8), optionally in twice the precision."""
        from meshmash_viewer.spectral.engine import kernels

        multiply = kernels.multiply_block_exactly if exactly else kernels.multiply_block
        matrix = self.pencil.magnitudes if magnitudes else self.pencil.matrix
        result = np.empty_like(block)
        places = self.structure.unsigned_matrix
        multiply(*places, matrix.data, block.reshape(-1), result.reshape(-1))
        return result

    def quotients(self, block: FloatArray, images: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute Rayleigh quotients of normalised columns (n, 8), and residuals in the M norm."""
        from meshmash_viewer.spectral.engine.kernels import quotients_block

        values, residuals = np.zeros(8), np.zeros(8)
        quotients_block(block, images, self.pencil.root_mass, values, residuals)
        return values, residuals

    def fill_rows(self, columns: FloatArray, rows: FloatArray) -> None:
        """Write a block of shape (n, 8) into rows of shape (8, n)."""
        from meshmash_viewer.spectral.engine.kernels import collect_rows

        collect_rows(columns, rows)

    def remove_null(self, block: FloatArray) -> None:
        """Project the null space out of a block of shape (n, 8), in place."""
        from meshmash_viewer.spectral.engine.kernels import remove_null_block

        pencil = self.pencil
        if pencil.n_null:
            sums = np.zeros((pencil.n_null, block.shape[1]))
            remove_null_block(pencil.labels, pencil.null_direction, sums, block)


def order_pencil(pencil: Pencil) -> OrderedPencil:
    """Permute a pencil to elimination order and analyse the structure of its factor."""
    from meshmash_viewer.spectral.engine.symbolic import analyse, elimination_order

    ordered = pencil.permuted(elimination_order(pencil.matrix))
    return OrderedPencil(ordered, analyse(ordered.matrix))


class Factor:
    """Factorization ``A - shift I = L D Lᵀ`` without pivoting, in dense blocks [1]_.

    `count_below` is the number of eigenvalues of A below the shift: by Sylvester's law of inertia,
    the number of negative pivots in D. `error` is the backward error of a probe solve, which grows
    if a pivot is nearly zero; `blur` is the first-order change of eigenvalues near the shift due to
    this error. `FactorizationError` is raised if a pivot vanishes, `Cancelled` if `stop` is set.

    References
    ----------
    .. [1] Duff, I. S. and Reid, J. K. (1983). "The Multifrontal Solution of Indefinite Sparse
       Symmetric Linear Equations." ACM Transactions on Mathematical Software 9(3).
    """

    def __init__(self, ordered: OrderedPencil, shift: float) -> None:
        from meshmash_viewer.spectral.engine.multifrontal import factor_numeric

        structure = ordered.structure
        self.shift = shift
        self._structure = structure
        self._blocks = np.empty(structure.n_entries)
        self._inverse = np.empty(ordered.pencil.n)
        outcome = factor_numeric(
            ordered.pencil.matrix.data, shift, structure.first, structure.row_start,
            structure.rows, structure.block_start, structure.children, structure.start,
            structure.index, structure.stack_size, structure.front_size, self._blocks,
            self._inverse, ordered.stop,
        )  # fmt: skip
        if outcome == -2:
            raise Cancelled("stopped inside a factorization")
        if outcome < 0:
            raise FactorizationError(f"a pivot vanished at shift {shift:.6g}")
        self.count_below = int(outcome)
        self.error, self.blur = self._probe(ordered.pencil)

    def solve(self, block: FloatArray) -> None:
        """Solve ``(A - shift I) X = block`` in place, shape (n, 8), C order."""
        from meshmash_viewer.spectral.engine.multifrontal import solve_block

        structure = self._structure.unsigned
        solve_block(*structure, self._blocks, self._inverse, block.reshape(-1))

    def _probe(self, pencil: Pencil) -> tuple[float, float]:
        """Return `error` and `blur`, by a solve with a right-hand side free of the null space."""
        n = pencil.n
        block = np.zeros((n, 8))
        probe = np.cos(np.arange(n, dtype=np.float64))
        pencil.remove_null(probe)
        block[:, 0] = probe
        # An unstable factor may overflow; its error is then NaN or infinite.
        with np.errstate(over="ignore", invalid="ignore"):
            self.solve(block)
            answer = block[:, 0]
            pencil.remove_null(answer)
            defect = pencil.matrix @ answer - self.shift * answer - probe
            size = abs(answer)
            scale = pencil.magnitudes @ size + abs(self.shift) * size + abs(probe)
            error = np.linalg.norm(defect) / np.linalg.norm(scale)
            # To first order an eigenvalue moves by yᵀ E y, with y the eigenvectors near the shift.
            return float(error), float(size @ abs(defect) / (size @ size))
