"""Features of a mesh from features of its pieces, with truncation errors."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from joblib import effective_n_jobs
from joblib._parallel_backends import LokyBackend
from joblib.parallel import get_active_backend

from meshmash_viewer.arrays import FloatArray, IntArray
from meshmash_viewer.features.filters import FilterBank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.features.truncation import Truncation, measure_truncation
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback
from meshmash_viewer.spectral.cost import free_memory, memory_of_run
from meshmash_viewer.spectral.weyl import weyl_count
from meshmash_viewer.split.partition import Piece
from meshmash_viewer.split.stitcher import MeshStitcher

#: Memory of a process without its piece, in bytes, and share of free memory for processes.
_PROCESS_BYTES, _SHARE = 170e6, 0.8


class StitchedFeatures(NamedTuple):
    """Features of a whole mesh, computed in pieces."""

    #: Shape (n, f).
    values: FloatArray
    truncation: Truncation | None
    #: Relative differences where pieces meet, shape (s, f), and their medians, 0 without cuts.
    seams: FloatArray
    seam_median: FloatArray


@dataclass(frozen=True)
class PieceFeatures:
    """Function that computes features of a piece, possibly in another process.

    A call returns the columns of features, and two more columns: the sum of the squared
    eigenvectors, and the mass of each vertex.
    """

    operator: OperatorOptions
    max_eigenvalue: float
    bank: FilterBank
    drop_first: bool
    dtype: npt.DTypeLike = np.float64
    #: Threads of the solver; with a fixed number, results are the same on any machine.
    n_jobs: int | None = None

    def __call__(self, piece: Piece) -> FloatArray:
        from meshmash_viewer.spectral.eigensolver import solve

        stiffness, mass = cotangent_laplacian(
            piece, self.operator.robust, self.operator.mollify_factor
        )
        _release_freed()
        top = self.max_eigenvalue
        pairs = solve(stiffness, mass, max_eigenvalue=top, dtype=self.dtype, n_jobs=self.n_jobs)
        if not pairs.complete:
            raise ArithmeticError(pairs.proof())
        coefficients = self.bank(pairs.eigenvalues)
        density = np.zeros(pairs.rows.shape[1])
        values = accumulate_features(pairs.rows[:], coefficients, density)
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
        stitching, seaming = stitcher.stitching(), stitcher.seaming()
        jobs = self._fitting(stitcher)
        report = _said(progress, jobs)
        for number, rows in stitcher.each(self, n_jobs=jobs, progress=report, cancel=cancel):
            stitching.add(number, rows)
            seaming.add(number, rows[:, :-2])
            piece = stitcher.pieces[number]
            own = stitcher.submesh_mapping[piece] == number
            done(piece[own], rows[own, :-2])
            del rows  # free the memory before the next piece
        whole, seams = stitching.values(), seaming.differences()
        values, density, mass = whole[:, :-2], whole[:, -2], whole[:, -1]
        # only pairs above `max_eigenvalue` contribute to the truncation error
        mass, top = np.nan_to_num(mass), self.max_eigenvalue
        n_pairs = max(round(float(mass[mass > 0.0] @ density[mass > 0.0])), 1)
        truncation = measure_truncation(
            values, self.bank, np.full(n_pairs, top), density, mass,
            precision=self.dtype, known_to=top,
        )  # fmt: skip
        median = np.median(seams, axis=0) if len(seams) else seams.sum(axis=0)
        return StitchedFeatures(values, truncation, seams, median)

    def _fitting(self, stitcher: MeshStitcher) -> int | None:
        """Return the number of processes that fit into memory; None if all requested ones fit."""
        active, _ = get_active_backend()
        jobs = effective_n_jobs(stitcher.n_jobs)
        if jobs == 1 or stitcher.client is not None or not isinstance(active, LokyBackend):
            return None
        areas = stitcher.mesh.vertex_areas
        lean = np.dtype(self.dtype) == np.float32
        needed = [
            _PROCESS_BYTES + memory_of_run(
                len(piece), 7 * len(piece),
                round(weyl_count(float(areas[piece].sum()), self.max_eigenvalue)), 1, lean=lean,
            )
            for piece in stitcher.pieces
        ]  # fmt: skip
        largest = np.cumsum(sorted(needed, reverse=True)[:jobs])
        fitting = int(np.searchsorted(largest, _SHARE * free_memory()))
        return max(fitting, 1) if fitting < len(largest) else None


def _release_freed() -> None:
    """Return freed memory to the system on Linux, where glibc would keep most of it."""
    if sys.platform == "linux":
        getattr(ctypes.CDLL(None), "malloc_trim", int)(0)


def _said(progress: ProgressCallback | None, jobs: int | None) -> ProgressCallback | None:
    """Add the number of processes to messages if memory limits it."""
    if progress is None or jobs is None:
        return progress

    def report(each: Progress) -> None:
        progress(replace(each, message=f"{each.message}, {jobs} at a time for want of memory"))

    return report
