"""Factors of shifted copies of a symmetric matrix, and eigenvalue counts from their inertia."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine.pencil import Pencil
from meshmash_viewer.spectral.engine.repeated import RepeatedComponents

FloatArray = npt.NDArray[np.float64]
#: One byte, shared with running kernels; any other value than 0 stops them.
StopFlag = npt.NDArray[np.uint8]

#: Largest backward error of the probe solve that a factor may show.
_PROBE_TOLERANCE = 1e-9
#: Parts of a nudge by which a shift is moved, as powers of ten.
_POWERS = (-6, -4, -2, -1, 0)


class FactorizationError(RuntimeError):
    """No usable factor near the wanted shift."""


@dataclass(eq=False)
class OrderedPencil:
    """A pencil in elimination order, and what its factors have in common.

    Parameters
    ----------
    pencil : Pencil
        Its vertices are in elimination order.
    structure : Structure
        Blocks of the factor.
    kept : dict
        Factors that were made to count and will be asked for again, by shift.
    steps : int
        Blocks that iterations have solved for so far: how far they are.
    repeated : RepeatedComponents, optional
        Components whose pairs are known.
    """

    pencil: Pencil
    structure: Any
    kept: dict[float, Factor] = field(default_factory=dict, repr=False)
    steps: int = 0
    repeated: RepeatedComponents | None = None

    def solve_repeated(self, highest: float) -> None:
        """Compute the pairs up to a value on components of which there are many."""
        self.repeated = RepeatedComponents(self.pencil, highest)

    def factor(self, shift: float, nudge: float, stop: StopFlag) -> Factor:
        """Factor at a shift or, where a pivot vanishes, beside it.

        Any shift may meet a pivot that is nearly zero, though no eigenvalue is near. It is then
        moved to both sides, by a nudge at most, the least first: 1e-6 of it, 1e-5 and so on.

        Parameters
        ----------
        shift : float
        nudge : float
            How far it may be moved.
        stop : ndarray of uint8, shape (1,)

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
        moves = [0.0, *(side * nudge * 10.0**power for power in _POWERS for side in (1.0, -1.0))]
        for move in moves:
            if stop[0]:
                raise Cancelled("stopped before a factorization")
            factor = self.factor_at(shift + move, stop)
            if factor is not None:
                return factor
        raise FactorizationError(f"no stable factor near shift {shift:.6g}")

    def factor_at(self, shift: float, stop: StopFlag) -> Factor | None:
        """Factor at this shift and no other; None if a pivot vanishes or nearly does."""
        try:
            factor = Factor(self, shift, stop)
        except FactorizationError:
            return None
        return factor if factor.error < _PROBE_TOLERANCE else None

    def multiply(
        self, block: FloatArray, exactly: bool = False, magnitudes: bool = False
    ) -> FloatArray:
        """``A @ block`` or ``|A| @ block``, (n, 8), if wanted with sums in twice the precision."""
        from meshmash_viewer.spectral.engine import kernels

        multiply = kernels.multiply_block_exactly if exactly else kernels.multiply_block
        matrix = self.pencil.magnitudes if magnitudes else self.pencil.matrix
        result = np.empty_like(block)
        places = self.structure.unsigned_matrix
        multiply(*places, matrix.data, block.reshape(-1), result.reshape(-1))
        return result

    def quotients(self, block: FloatArray, images: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rayleigh quotients of normalised columns (n, 8), and residuals in the norm of M."""
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
    """Put a pencil in elimination order and analyse its factor."""
    from meshmash_viewer.spectral.engine.symbolic import analyse, elimination_order

    ordered = pencil.permuted(elimination_order(pencil.matrix))
    return OrderedPencil(ordered, analyse(ordered.matrix))


class Factor:
    """``A - shift I = L D Lᵀ`` without pivoting, in blocks [1]_.

    Sylvester's law of inertia: the number of negative pivots in D is the number of eigenvalues
    of A below the shift.

    Parameters
    ----------
    ordered : OrderedPencil
    shift : float
    stop : ndarray of uint8, shape (1,)

    Attributes
    ----------
    count_below : int
        Number of eigenvalues below the shift.
    error : float
        Backward error of a probe solve: it grows with every pivot that is nearly zero.
    blur : float
        How far that moves eigenvalues near the shift, to first order.

    Raises
    ------
    FactorizationError
        If a pivot vanished.
    Cancelled
        If `stop` was set.

    References
    ----------
    .. [1] Duff, I. S. and Reid, J. K. (1983). "The Multifrontal Solution of Indefinite Sparse
       Symmetric Linear Equations." ACM Transactions on Mathematical Software 9(3).
    """

    def __init__(self, ordered: OrderedPencil, shift: float, stop: StopFlag) -> None:
        from meshmash_viewer.spectral.engine.multifrontal import factor_numeric

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
            structure.start,
            structure.index,
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
        self.error, self.blur = self._probe(ordered.pencil)

    def solve(self, block: FloatArray) -> None:
        """Solve ``(A - shift I) X = block`` in place, shape (n, 8), C order."""
        from meshmash_viewer.spectral.engine.multifrontal import solve_block

        structure = self._structure.unsigned
        solve_block(*structure, self._blocks, self._inverse, block.reshape(-1))

    def _probe(self, pencil: Pencil) -> tuple[float, float]:
        """Error and blur of a solve with a fixed right-hand side, beside the known null space."""
        n = pencil.n
        block = np.zeros((n, 8))
        probe = np.cos(np.arange(n, dtype=np.float64))
        pencil.remove_null(probe)
        block[:, 0] = probe
        # A useless factor may overflow here; its error is then no number, and below no bound.
        with np.errstate(over="ignore", invalid="ignore"):
            self.solve(block)
            answer = block[:, 0]
            pencil.remove_null(answer)
            defect = pencil.matrix @ answer - self.shift * answer - probe
            size = abs(answer)
            scale = pencil.magnitudes @ size + abs(self.shift) * size + abs(probe)
            error = np.linalg.norm(defect) / np.linalg.norm(scale)
            # To first order an eigenvalue moves by yᵀ E y, and the answer is rich in those y.
            return float(error), float(size @ abs(defect) / (size @ size))
