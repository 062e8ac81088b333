"""From reduced pairs to final ones: scaling, signs, agreement of neighbours, proof.

Pairs of different slices are orthogonal only as far as their residuals and their distance make
them; what is missing is taken off against the slice before, which is already final.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.engine.lanczos import orthonormalise
from meshmash_viewer.engine.pencil import Pencil

__all__ = ["Allocate", "Output", "PairsCallback", "fix_sign"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
#: ``(k, n) -> array of shape (k, n)`` that the rows are written into.
Allocate: TypeAlias = Callable[[int, int], npt.NDArray[np.floating[Any]]]
#: ``(start, eigenvalues, residuals)`` of pairs whose rows have just become final.
PairsCallback: TypeAlias = Callable[[int, FloatArray, FloatArray], None]

#: Inner products of neighbouring slices below this stay as they are.
_TOUCHING = 1e-13


class Output:
    """The arrays of a decomposition while they fill, lowest pair first.

    Parameters
    ----------
    pencil : Pencil
        In the vertex order of the rows that will come.
    k : int
        Number of pairs to come.
    dtype : dtype
        Of the rows.
    ceiling : float, optional
        Eigenvalues that rounding put above a threshold are brought back to it.
    allocate : callable, optional
    """

    def __init__(
        self,
        pencil: Pencil,
        k: int,
        dtype: np.dtype[Any],
        ceiling: float | None,
        allocate: Allocate | None,
    ) -> None:
        shape = (k, pencil.n_all)
        self.pencil, self.ceiling = pencil, ceiling
        self.eigenvalues, self.residuals = np.zeros(k), np.zeros(k)
        self.rows = np.empty(shape, dtype=dtype) if allocate is None else allocate(*shape)
        if self.rows.shape != shape:
            raise ValueError(f"allocate gave {self.rows.shape} for {shape}")
        self.written = 0
        self.orthonormality = 0.0
        self._before: FloatArray = np.zeros((0, pencil.n))
        self._inverse_root_mass = 1.0 / pencil.root_mass
        self._random = np.random.default_rng(1)
        self._mixture = np.zeros((8, pencil.n))

    @property
    def total(self) -> int:
        """Number of pairs in the end."""
        return len(self.eigenvalues)

    def write(self, values: FloatArray, residuals: FloatArray, rows: FloatArray) -> slice:
        """Finish pairs of the reduced problem and write them behind those that are there.

        Parameters
        ----------
        values : ndarray, shape (p,)
        residuals : ndarray, shape (p,)
            In the reduced unit, not relative.
        rows : ndarray, shape (p, n)
            Orthonormal.
        """
        pencil = self.pencil
        rows = self._agree(rows)
        count = min(len(values), self.total - self.written)
        values, residuals, rows = values[:count], residuals[:count], rows[:count]
        place = slice(self.written, self.written + count)
        eigenvalues = values * pencil.unit
        if self.ceiling is not None:
            eigenvalues = np.minimum(eigenvalues, self.ceiling)
        self.eigenvalues[place] = eigenvalues
        self.residuals[place] = residuals / np.where(values > pencil.noise, values, 1.0)
        final = np.zeros(pencil.n_all)
        without_mass = np.ones(pencil.n_all, dtype=bool)
        without_mass[pencil.active] = False
        for i, row in enumerate(rows):
            final[pencil.active] = row * self._inverse_root_mass
            fix_sign(final)
            self.rows[self.written + i] = final
        if pencil.n < pencil.n_all:
            self.rows[place, without_mass] = np.nan
        self._measure(rows, self.rows[place])
        self.written += count
        return place

    def _agree(self, rows: FloatArray) -> FloatArray:
        """Take off what the rows still share with those of the slice before."""
        if len(self._before) == 0:
            return rows
        shared = rows @ self._before.T
        if np.abs(shared).max(initial=0.0) > 0.5:
            raise ArithmeticError("two slices found the same eigenvector")
        if np.abs(shared).max(initial=0.0) < _TOUCHING:
            return rows
        for start in range(0, rows.shape[1], 4096):
            part = slice(start, start + 4096)
            rows[:, part] -= shared @ self._before[:, part]
        orthonormalise(rows)
        return rows

    def _measure(self, rows: FloatArray, written: npt.NDArray[np.floating[Any]]) -> None:
        """Inner products among the rows, with their neighbours, and with all before those.

        The last are measured through eight random sums of rows: the size of a row of inner
        products, which is at least the largest of them.
        """
        if len(rows) == 0:
            return
        if written.dtype != np.float64:
            rows = np.asarray(written[:, self.pencil.active], dtype=np.float64)
            rows *= self.pencil.root_mass
        gram = rows @ rows.T
        gram[np.diag_indices(len(rows))] -= 1.0
        shared = rows @ self._before.T
        far = np.linalg.norm(rows @ self._mixture.T, axis=1) / np.sqrt(8.0)
        worst = [np.abs(part).max(initial=0.0) for part in (gram, shared, far)]
        self.orthonormality = max(self.orthonormality, *map(float, worst))
        signs = self._random.choice([-1.0, 1.0], size=(8, len(self._before)))
        self._mixture += signs @ self._before
        self._before = rows


def fix_sign(row: npt.NDArray[np.floating[Any]]) -> None:
    """Turn a row in place so that its entry of largest magnitude is positive.

    Of entries whose magnitudes agree to 1e-6 the first decides, so that rounding does not.
    """
    size = np.abs(row)
    leading = int(np.argmax(size >= (1.0 - 1e-6) * size.max(initial=0.0)))
    if row[leading] < 0.0:
        np.negative(row, out=row)
