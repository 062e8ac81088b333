"""A spectrum in a folder of the store: its files, read and checked by any process."""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.npy import map_rows

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition
    from meshmash_viewer.weyl import Target

__all__ = [
    "CHECKSUMS",
    "MASS",
    "META",
    "RESIDUALS",
    "ROWS",
    "VALUES",
    "StoredSpectrum",
    "checksum",
    "read_spectrum",
    "verify_spectrum",
]

FloatArray = npt.NDArray[np.float64]

#: Files of a folder.
ROWS = "eigenvectors.npy"
VALUES = "eigenvalues.npy"
RESIDUALS = "residuals.npy"
CHECKSUMS = "checksums.npy"
MASS = "mass.npy"
META = "meta.json"

#: A row's checksum covers this many blocks of so many values: cheap, yet holes are seen.
_BLOCKS, _BLOCK_VALUES = 16, 64
#: Equal up to rounding, as the solver takes a threshold.
_THRESHOLD_MARGIN = 1e-11


@dataclass(frozen=True, eq=False)
class StoredSpectrum:
    """The leading eigenpairs that a store holds.

    Parameters
    ----------
    eigenvalues : ndarray of float64, shape (k,)
    rows : ndarray of float64, shape (k, n)
        Read-only memory map; it stays valid while the store grows.
    residuals : ndarray of float64, shape (k,)
        Relative residuals.
    n_proven : int
        How many of them belong to a finished run; the others have converged in a run that was
        cut off or is still going on.
    meta : dict
        What the finished run said of itself; empty if there is none.
    mass : ndarray of float64, shape (n,), optional
        Diagonal of the mass matrix; None without a finished run.
    """

    eigenvalues: FloatArray
    rows: FloatArray
    residuals: FloatArray
    n_proven: int
    meta: dict[str, Any]
    mass: FloatArray | None

    @property
    def n_converged(self) -> int:
        """Number of pairs k."""
        return len(self.eigenvalues)

    @property
    def complete(self) -> bool:
        """Whether all of them are proven, with none missing in between."""
        return self.n_proven == self.n_converged and self.decomposition().complete

    @property
    def proof(self) -> str:
        """The proof line of all of them (see `Decomposition.proof`)."""
        return self.decomposition().proof()

    @property
    def is_exhausted(self) -> bool:
        """Whether the proven pairs are all that the mesh has."""
        return bool(self.meta.get("exhausted", False))

    def covers(self, target: Target) -> int | None:
        """How many leading pairs answer a request; None if some have yet to be computed."""
        proven = self.eigenvalues[: self.n_proven]
        if target.n_components is not None:
            if target.n_components <= self.n_proven:
                return target.n_components
            return self.n_proven if self.is_exhausted else None
        bound = target.max_eigenvalue
        assert bound is not None
        count = int(np.searchsorted(proven, bound * (1 + _THRESHOLD_MARGIN), side="right"))
        threshold = self.meta.get("max_eigenvalue")
        known_to = -np.inf if threshold is None else float(threshold)
        if count < self.n_proven or bound <= known_to or self.is_exhausted:
            return count
        return None

    def decomposition(self, count: int | None = None) -> Decomposition:
        """The first `count` pairs as the solver would return them.

        Parameters
        ----------
        count : int, optional
            None for all that have converged, as `known` of a run that goes on from there.
        """
        from meshmash_viewer.certificate import Certificate
        from meshmash_viewer.eigensolver import Decomposition

        k = self.n_converged if count is None else count
        proven = 0 < k <= self.n_proven
        certificate = Certificate("none")
        if proven:
            certificate = Certificate.from_dict(self.meta["certificate"])
        return Decomposition(
            eigenvalues=self.eigenvalues[:k],
            rows=self.rows[:k],
            residuals=self.residuals[:k],
            certificate=certificate,
            timings=dict(self.meta.get("timings", {})) if proven else {},
            mass=np.zeros(0) if self.mass is None else self.mass,
        )


def read_spectrum(folder: Path, n_vertices: int) -> StoredSpectrum | None:
    """What is in a folder; None without a single pair.

    Raises
    ------
    OSError, ValueError, KeyError, TypeError
        If a file is missing, cannot be read, or does not go with the others.
    """
    meta: dict[str, Any] = {}
    if (folder / META).exists():
        meta = json.loads((folder / META).read_text(encoding="utf-8"))
    # Eigenvalues first: rows and residuals that they publish are there by then.
    values = np.array(map_rows(folder / VALUES, "r", (None,)))
    rows = map_rows(folder / ROWS, "r", (None, n_vertices))
    residuals = map_rows(folder / RESIDUALS, "r", (None,))
    missing = np.flatnonzero(np.isnan(values))
    converged = int(missing[0]) if len(missing) else len(values)
    if len(rows) < converged or len(residuals) < converged:
        raise ValueError("its arrays differ in length")
    n_proven = int(meta.get("n_pairs", 0))
    if n_proven > converged:
        raise ValueError(f"it promises {n_proven} eigenpairs and holds {converged}")
    if not converged:
        return None
    mass = None
    if meta:
        mass = map_rows(folder / MASS, "r", (n_vertices,))
    return StoredSpectrum(
        values[:converged],
        rows[:converged],
        np.array(residuals[:converged]),
        n_proven,
        meta,
        mass,
    )


def verify_spectrum(folder: Path, spectrum: StoredSpectrum) -> None:
    """Compare a spectrum with its checksums.

    Raises
    ------
    ValueError
        If something is damaged.
    """
    values = spectrum.eigenvalues
    if np.any(np.diff(values) < -1e-9 * np.abs(values[1:])):
        raise ValueError("its eigenvalues are out of order")
    checksums = map_rows(folder / CHECKSUMS, "r", (None,))
    for index, row in enumerate(spectrum.rows):
        found = checksum(row, values[index], spectrum.residuals[index])
        if found != checksums[index]:
            raise ValueError(f"eigenpair {index} is damaged")
    said = spectrum.meta.get("mass_checksum")
    if (
        spectrum.mass is not None
        and said is not None
        and zlib.crc32(spectrum.mass.tobytes()) != said
    ):
        raise ValueError("its mass matrix is damaged")


def checksum(row: FloatArray, eigenvalue: float, residual: float) -> int:
    """Of an eigenpair with its residual: of blocks of the row, as it is much to read."""
    n = len(row)
    if n <= _BLOCKS * _BLOCK_VALUES:
        sampled = np.ascontiguousarray(row)
    else:
        begins = np.linspace(0, n - _BLOCK_VALUES, _BLOCKS).astype(np.int64)
        sampled = np.concatenate([row[begin : begin + _BLOCK_VALUES] for begin in begins])
    pair = np.array([eigenvalue, residual], dtype=np.float64)
    return zlib.crc32(pair.tobytes(), zlib.crc32(sampled.tobytes()))
