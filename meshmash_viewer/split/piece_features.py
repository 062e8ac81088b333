"""Features of a piece of a mesh, and what they miss on the whole of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.features.truncation import Truncation, measure_truncation
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.split.partition import Piece
from meshmash_viewer.split.stitcher import MeshStitcher


class StitchedFeatures(NamedTuple):
    """Features of a whole mesh, computed in pieces."""

    #: Shape (n, f).
    values: FloatArray
    truncation: Truncation | None
    #: Relative differences where pieces meet, shape (s, f), and their medians, 0 without any.
    seams: FloatArray
    seam_median: FloatArray


@dataclass(frozen=True)
class PieceFeatures:
    """Computes features of a piece; it goes to other processes.

    It returns the columns, and two more: the sum of all squares, and the mass of each vertex.
    """

    operator: OperatorOptions
    max_eigenvalue: float
    bank: FilterBank
    drop_first: bool
    dtype: npt.DTypeLike = np.float64
    #: Threads of the solver; with a given number results are the same on any machine.
    n_jobs: int | None = None

    def __call__(self, piece: Piece) -> FloatArray:
        from meshmash_viewer.spectral.eigensolver import solve

        stiffness, mass = cotangent_laplacian(
            piece, self.operator.robust, self.operator.mollify_factor
        )
        top = self.max_eigenvalue
        pairs = solve(stiffness, mass, max_eigenvalue=top, dtype=self.dtype, n_jobs=self.n_jobs)
        if not pairs.complete:
            raise ArithmeticError(pairs.proof())
        coefficients = self.bank(pairs.eigenvalues)
        density = np.zeros(pairs.rows.shape[1])
        values = accumulate_features(pairs.rows, coefficients, density)
        if self.drop_first:
            values -= np.outer(piece.first, coefficients[:, 0])
        return np.column_stack([values, density, pairs.mass])

    def on(
        self,
        stitcher: MeshStitcher,
        done: Callable[[IntArray, FloatArray], None] = lambda vertices, rows: None,
        *,
        progress: ProgressCallback | None = None,
        cancel: CancelCallback | None = None,
    ) -> StitchedFeatures:
        """Compute features of all pieces, and stitch them; see `MeshStitcher.apply`."""
        results = stitcher.apply(
            self,
            stitch=False,
            done=lambda vertices, rows: done(vertices, rows[:, :-2]),
            progress=progress,
            cancel=cancel,
        )
        seams = stitcher.seams([rows[:, :-2] for rows in results])
        *columns, density, mass = stitcher.stitch_features(results).T
        values = np.stack(columns, axis=1)
        truncation = self._truncation(values, density, np.nan_to_num(mass))
        median = np.median(seams, axis=0) if len(seams) else seams.sum(axis=0)
        return StitchedFeatures(values, truncation, seams, median)

    def _truncation(
        self, values: FloatArray, density: FloatArray, mass: FloatArray
    ) -> Truncation | None:
        """Return what the pairs beyond `max_eigenvalue` would add, from the stitched columns."""
        used, top = mass > 0.0, self.max_eigenvalue
        n_pairs = max(round(float(mass[used] @ density[used])), 1)
        pairs = np.full(n_pairs, top)
        return measure_truncation(
            values, self.bank, pairs, density, mass, precision=self.dtype, known_to=top
        )
