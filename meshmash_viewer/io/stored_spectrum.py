"""A spectrum in a folder of the store: its files, read and checked by any process.

The file of eigenvectors holds rows of float64 one after the other and nothing else, so that whoever
reads maps one array. Rows that have been given out are final; more are added behind them, which
leaves maps of the old length valid.

Pairs come in batches. A batch is a run of rows in the file of eigenvectors and a sealed file with
their eigenvalues, residuals and checksums, written when the rows are on the disk and never changed.
The proof is a sealed file of its own that names the batches it speaks of; it is written last.
"""

from __future__ import annotations

import contextlib
import re
import zlib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.sealed import Damaged, read_sealed, write_sealed
from meshmash_viewer.progress import CancelCallback

if TYPE_CHECKING:
    from meshmash_viewer.spectral.certificate import Certificate
    from meshmash_viewer.spectral.eigensolver import Decomposition
    from meshmash_viewer.spectral.weyl import Target

__all__ = [
    "PROOF",
    "ROWS",
    "SEALED",
    "Batch",
    "Compared",
    "Proof",
    "StoredRows",
    "StoredSpectrum",
    "published_pairs",
    "read_spectrum",
    "write_batch",
    "write_proof",
]

FloatArray = npt.NDArray[np.float64]

#: Files of a folder, beside those of the batches.
SEALED = ".sealed"
ROWS = "eigenvectors.f64"
PROOF = f"proof{SEALED}"

#: Threads that compare checksums, and bytes that each has in memory at a time.
_THREADS, _BLOCK = 2, 1 << 18
_BATCH = re.compile(r"pairs-(\d{6,})-(\d{6,})\.sealed")
#: What reading raises of a file that is damaged, or whole but another one.
_UNUSABLE = (OSError, ValueError, KeyError, TypeError)
#: Equal up to rounding, as the solver takes a threshold.
_THRESHOLD_MARGIN = 1e-11


@dataclass(frozen=True, eq=False)
class Compared:
    """The first rows of a file, which agreed with their checksums while it was in some state.

    Parameters
    ----------
    checksums : ndarray of uint32, shape (k,)
    state : tuple of int
        See `StoredRows.state`: as long as it is the same, nobody has written to the file.
    """

    checksums: npt.NDArray[np.uint32]
    state: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class StoredRows:
    """Rows in a file, as they are told of between processes.

    Parameters
    ----------
    path : Path
    n_vertices : int
        Length of a row.
    checksums : ndarray of uint32, shape (k,)
        CRC-32 of each row, where they are to be compared with the file; empty for rows that have
        just been written.
    """

    path: Path
    n_vertices: int
    checksums: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))

    @property
    def row_bytes(self) -> int:
        """Bytes of a row."""
        return 8 * self.n_vertices

    def map(self, count: int) -> FloatArray:
        """The first rows, shape (count, n), mapped read-only.

        Raises
        ------
        OSError, ValueError
            If there are fewer, or none.
        """
        return np.memmap(self.path, np.float64, "r", shape=(count, self.n_vertices))

    @property
    def state(self) -> tuple[int, ...]:
        """Which file this is, its size and when it last changed; empty where it cannot be told."""
        try:
            found = self.path.stat()
        except OSError:
            return ()
        return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns

    def damaged(self, indices: Iterable[int], cancel: CancelCallback | None = None) -> list[int]:
        """Which of some rows do not agree with their checksums.

        Parameters
        ----------
        indices : iterable of int
        cancel : callable, optional
            Asked before each row; once it returns True the rest goes unread.

        Returns
        -------
        list of int
            Rows that cannot be read included.
        """

        def is_whole(index: int) -> bool:
            if cancel is not None and cancel():
                return True
            checksum, block = 0, memoryview(bytearray(_BLOCK))
            try:
                with self.path.open("rb") as file:
                    file.seek(index * self.row_bytes)
                    for left in range(self.row_bytes, 0, -_BLOCK):
                        part = block[:left]
                        if file.readinto(part) < len(part):
                            return False
                        checksum = zlib.crc32(part, checksum)
            except OSError:
                return False
            return bool(checksum == self.checksums[index])

        indices = list(indices)
        with ThreadPoolExecutor(_THREADS) as threads:  # zlib lets go of the interpreter's lock
            whole = list(threads.map(is_whole, indices))
        return [index for index, flag in zip(indices, whole, strict=True) if not flag]


@dataclass(frozen=True, eq=False)
class Batch:
    """Pairs that were given out together.

    Parameters
    ----------
    path : Path
        Its sealed file.
    start : int
        Index of the first.
    eigenvalues, residuals : ndarray of float64, shape (b,)
    checksums : ndarray of uint32, shape (b,)
        CRC-32 of the rows.
    seal : str
        Of the file, by which a proof names it.
    """

    path: Path
    start: int
    eigenvalues: FloatArray
    residuals: FloatArray
    checksums: npt.NDArray[np.uint32]
    seal: str

    @property
    def stop(self) -> int:
        """Index after the last pair."""
        return self.start + len(self.eigenvalues)

    @property
    def name(self) -> list[Any]:
        """How a proof names it."""
        return [self.start, self.stop, self.seal]


@dataclass(frozen=True, eq=False)
class Proof:
    """What a run that ended said of itself.

    Parameters
    ----------
    n_pairs : int
        The lowest so many pairs are proven.
    batches : list
        Those that they are in, as `Batch.name`.
    certificate : Certificate
    max_eigenvalue : float, optional
        The threshold that was asked for.
    exhausted : bool
        Whether these are all that the mesh has.
    timings : dict of float
    mass : ndarray of float64, shape (n,)
        Diagonal of the mass matrix.
    """

    n_pairs: int
    batches: list[list[Any]]
    certificate: Certificate
    max_eigenvalue: float | None
    exhausted: bool
    timings: dict[str, float]
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class StoredSpectrum:
    """The eigenpairs that a store holds.

    Parameters
    ----------
    path : Path
        File of the rows.
    n_vertices : int
    batches : sequence of Batch
        Ascending, without overlap.
    proof : Proof, optional
        Of the run that ended last.
    faults : tuple of str
        What was found to be damaged, in words.
    """

    path: Path
    n_vertices: int
    batches: Sequence[Batch]
    proof: Proof | None = None
    faults: tuple[str, ...] = ()

    @cached_property
    def eigenvalues(self) -> FloatArray:
        """Shape (k,), up to the highest that is there; NaN where one is missing."""
        return self._joined("eigenvalues", np.nan)

    @cached_property
    def residuals(self) -> FloatArray:
        """Relative residuals, shape (k,); NaN where a pair is missing."""
        return self._joined("residuals", np.nan)

    @cached_property
    def stored_rows(self) -> StoredRows:
        """Where the rows are, with their checksums."""
        checksums = self._joined("checksums", 0).astype(np.uint32)
        return StoredRows(self.path, self.n_vertices, checksums)

    @property
    def checked_rows(self) -> StoredRows:
        """Where the rows are, once they have been compared with their checksums."""
        return StoredRows(self.path, self.n_vertices)

    @cached_property
    def rows(self) -> FloatArray:
        """Read-only map of shape (k, n); it stays valid while the store grows."""
        return self.stored_rows.map(len(self.eigenvalues))

    @property
    def n_converged(self) -> int:
        """Number of leading pairs that are there, without a gap."""
        return _leading(self.batches)

    @property
    def n_proven(self) -> int:
        """Number of leading pairs that belong to a run that ended."""
        proof = self.proof
        if proof is None:
            return 0
        return min(proof.n_pairs, _leading([b for b in self.batches if b.name in proof.batches]))

    @property
    def is_exhausted(self) -> bool:
        """Whether the proven pairs are all that the mesh has."""
        proof = self._whole_proof
        return proof is not None and proof.exhausted

    @property
    def _whole_proof(self) -> Proof | None:
        """The proof, unless some of its pairs have been lost since."""
        proof = self.proof
        return proof if proof is not None and self.n_proven == proof.n_pairs else None

    def covers(self, target: Target) -> int | None:
        """How many leading pairs answer a request; None if some have yet to be computed."""
        n_proven = self.n_proven
        if target.n_components is not None:
            if target.n_components <= n_proven:
                return target.n_components
            return n_proven if self.is_exhausted else None
        bound = target.max_eigenvalue
        assert bound is not None
        proven = self.eigenvalues[:n_proven]
        count = int(np.searchsorted(proven, bound * (1 + _THRESHOLD_MARGIN), side="right"))
        proof = self._whole_proof
        threshold = None if proof is None else proof.max_eigenvalue
        known_to = -np.inf if threshold is None else threshold
        if count < n_proven or bound <= known_to or self.is_exhausted:
            return count
        return None

    def decomposition(self, count: int | None = None) -> Decomposition:
        """The first `count` pairs as the solver would return them.

        Parameters
        ----------
        count : int, optional
            None for all that there are, as `known` of a run that goes on from there: with
            eigenvalues of NaN where some are missing.
        """
        from meshmash_viewer.spectral.certificate import Certificate
        from meshmash_viewer.spectral.eigensolver import Decomposition

        k = len(self.eigenvalues) if count is None else count
        proof = self.proof if 0 < k <= self.n_proven else None
        return Decomposition(
            eigenvalues=self.eigenvalues[:k],
            rows=self.rows[:k],
            residuals=self.residuals[:k],
            certificate=Certificate("none") if proof is None else proof.certificate,
            timings={} if proof is None else dict(proof.timings),
            mass=np.zeros(0) if self.proof is None else self.proof.mass,
        )

    def damaged_batches(
        self,
        count: int | None = None,
        cancel: CancelCallback | None = None,
        compared: Compared | None = None,
    ) -> list[Batch]:
        """Compare rows with their checksums; the batches of those that do not agree.

        Parameters
        ----------
        count : int, optional
            How many leading pairs are looked at; None for all.
        cancel : callable, optional
            Once it returns True the rest goes unread.
        compared : Compared, optional
            Rows that need not be read again where the file is still in the same state.
        """
        unread = np.isfinite(self.eigenvalues[:count])
        if compared is not None and compared.state and compared.state == self.stored_rows.state:
            k = min(len(unread), len(compared.checksums))
            unread[:k] &= self.stored_rows.checksums[:k] != compared.checksums[:k]
        known = np.flatnonzero(unread)
        damaged = self.stored_rows.damaged(known.tolist(), cancel)
        return [b for b in self.batches if any(b.start <= index < b.stop for index in damaged)]

    def without(self, batches: Sequence[Batch]) -> StoredSpectrum:
        """What is left of it without some batches, and says so."""
        if not batches:
            return self
        said = tuple(f"eigenpairs {b.start} to {b.stop - 1}" for b in batches)
        kept = [batch for batch in self.batches if batch not in batches]
        return replace(self, batches=kept, faults=self.faults + said)

    def _joined(self, name: str, fill: float) -> npt.NDArray[Any]:
        length = self.batches[-1].stop if self.batches else 0
        joined = np.full(length, fill)
        for batch in self.batches:
            joined[batch.start : batch.stop] = getattr(batch, name)
        return joined


def _leading(batches: Sequence[Batch]) -> int:
    stop = 0
    for batch in batches:
        if batch.start != stop:
            break
        stop = batch.stop
    return stop


def published_pairs(names: Iterable[str]) -> int:
    """Index after the highest pair that files of these names publish."""
    matches = (_BATCH.fullmatch(name) for name in names)
    return max((int(match[2]) for match in matches if match is not None), default=0)


def read_spectrum(folder: Path, key: str, n_vertices: int) -> StoredSpectrum:
    """What is in a folder, as far as it is whole; rows are not looked at.

    Parameters
    ----------
    folder : Path
    key : str
        Of the store.
    n_vertices : int
    """
    path, names, size = folder / ROWS, list[str](), 0
    with contextlib.suppress(OSError):  # cleared, or never there
        names = sorted(entry.name for entry in folder.iterdir())
        size = path.stat().st_size
    batches: list[Batch] = []
    faults: list[str] = []
    for name in names:
        if (match := _BATCH.fullmatch(name)) is None:
            continue
        start, stop = int(match[1]), int(match[2])
        try:
            sealed = read_sealed(folder / name, key)
            batch = Batch(folder / name, start, **sealed.arrays, seal=sealed.seal)
            if sealed.content["pairs"] != [start, stop]:
                raise Damaged(f"{name} is another one")
            if stop * 8 * n_vertices > size:
                raise Damaged(f"{ROWS} ends before")
            if batches and not _follows(batches[-1], batch):
                raise Damaged("it is out of order")
        except FileNotFoundError:
            continue  # cleared in between
        except _UNUSABLE:
            faults.append(f"eigenpairs {start} to {stop - 1}")
        else:
            batches.append(batch)
    proof = None
    try:
        proof = _read_proof(folder / PROOF, key)
    except (FileNotFoundError, NotADirectoryError):
        pass  # no run has ended
    except _UNUSABLE:
        faults.append("their proof")
    else:
        named = {(start, stop) for start, stop, _ in proof.batches}
        there = {(batch.start, batch.stop) for batch in batches}
        lost = sorted(named - there)
        said = (f"eigenpairs {start} to {stop - 1}" for start, stop in lost)
        faults += [text for text in said if text not in faults]
    return StoredSpectrum(path, n_vertices, batches, proof, tuple(faults))


def _follows(before: Batch, batch: Batch) -> bool:
    last, first = before.eigenvalues[-1], batch.eigenvalues[0]
    return batch.start >= before.stop and bool(first >= last - 1e-9 * abs(last))


def write_batch(
    folder: Path,
    key: str,
    start: int,
    eigenvalues: FloatArray,
    residuals: FloatArray,
    checksums: npt.NDArray[np.uint32],
) -> Batch:
    """Publish pairs whose rows are on the disk."""
    stop = start + len(eigenvalues)
    path = folder / f"pairs-{start:06d}-{stop:06d}.sealed"
    arrays: dict[str, npt.NDArray[Any]] = {
        "eigenvalues": eigenvalues,
        "residuals": residuals,
        "checksums": checksums,
    }
    seal = write_sealed(path, key, {"pairs": [start, stop]}, arrays)
    return Batch(path, start, **arrays, seal=seal)


def write_proof(folder: Path, key: str, proof: Proof) -> None:
    """Record what a run that ended says of itself."""
    content = {**vars(proof), "certificate": proof.certificate.as_dict()}
    write_sealed(folder / PROOF, key, content, {"mass": content.pop("mass")})


def _read_proof(path: Path, key: str) -> Proof:
    from meshmash_viewer.spectral.certificate import Certificate

    sealed = read_sealed(path, key)
    content = {**sealed.content, "mass": sealed.arrays["mass"]}
    content["certificate"] = Certificate.from_dict(content["certificate"])
    return Proof(**content)
