"""Files of a stored spectrum, which any process can read and check.

The file of eigenvectors holds contiguous rows of float64 without a header, so that it is mapped as
one array. Published rows are final; more are appended, which leaves maps of the old length valid.

A batch is a range of rows in the file of eigenvectors, with a sealed file of their eigenvalues,
residuals and checksums, which is written once the rows are on the disk and never changed. The proof
is a separate sealed file that lists its batches; it is written last.
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

FloatArray = npt.NDArray[np.float64]

#: Files of a folder, in addition to those of the batches.
SEALED = ".sealed"
ROWS = "eigenvectors.f64"
PROOF = f"proof{SEALED}"

#: Threads that compare checksums, and bytes that each has in memory at a time.
_THREADS, _BLOCK = 2, 1 << 18
_BATCH = re.compile(r"pairs-(\d{6,})-(\d{6,})\.sealed")
#: Exceptions raised by reading a damaged or wrong file.
_UNUSABLE = (OSError, ValueError, KeyError, TypeError)
#: Relative tolerance of thresholds, as in the solver.
_THRESHOLD_MARGIN = 1e-11


@dataclass(frozen=True, eq=False)
class Compared:
    """Result of a comparison of the first rows of a file with their checksums.

    Parameters
    ----------
    checksums : ndarray of uint32, shape (k,)
        Checksums of the rows that agreed.
    state : tuple of int
        `StoredRows.state` at that time; the result is valid while it stays the same.
    """

    checksums: npt.NDArray[np.uint32]
    state: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class StoredRows:
    """Reference to rows in a file, which can be sent between processes.

    Parameters
    ----------
    path : Path
    n_vertices : int
        Length of a row.
    checksums : ndarray of uint32, shape (k,)
        CRC-32 of each row; empty if they need not be compared.
    """

    path: Path
    n_vertices: int
    checksums: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))

    @property
    def row_bytes(self) -> int:
        """Bytes of a row."""
        return 8 * self.n_vertices

    def map(self, count: int) -> FloatArray:
        """Map the first rows read-only, shape (count, n).

        Raises
        ------
        OSError, ValueError
            If there are fewer, or none.
        """
        return np.memmap(self.path, np.float64, "r", shape=(count, self.n_vertices))

    @property
    def state(self) -> tuple[int, ...]:
        """Identity, size and times of change of the file; empty if it cannot be read."""
        try:
            found = self.path.stat()
        except OSError:
            return ()
        return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns

    def damaged(self, indices: Iterable[int], cancel: CancelCallback | None = None) -> list[int]:
        """List those rows that cannot be read or do not agree with their checksums.

        Parameters
        ----------
        indices : iterable of int
        cancel : callable, optional
            Called before each row; once it returns True the remaining rows are not read.
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
        with ThreadPoolExecutor(_THREADS) as threads:  # zlib releases the interpreter lock
            whole = list(threads.map(is_whole, indices))
        return [index for index, flag in zip(indices, whole, strict=True) if not flag]


@dataclass(frozen=True, eq=False)
class Batch:
    """Pairs that were published together.

    Parameters
    ----------
    path : Path
        The sealed file.
    start : int
        Index of the first pair.
    eigenvalues, residuals : ndarray of float64, shape (b,)
    checksums : ndarray of uint32, shape (b,)
        CRC-32 of the rows.
    seal : str
        Digest of the file, by which a proof refers to it.
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
        """Reference to the batch in a proof."""
        return [self.start, self.stop, self.seal]


@dataclass(frozen=True, eq=False)
class Proof:
    """Record of a complete run.

    Parameters
    ----------
    n_pairs : int
        Number of lowest pairs that are certified.
    batches : list
        Their batches, as `Batch.name`.
    certificate : Certificate
    max_eigenvalue : float, optional
        The requested threshold.
    exhausted : bool
        Whether these are all pairs of the mesh.
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
        Record of the last complete run.
    faults : tuple of str
        Descriptions of damaged parts.
    """

    path: Path
    n_vertices: int
    batches: Sequence[Batch]
    proof: Proof | None = None
    faults: tuple[str, ...] = ()

    @cached_property
    def eigenvalues(self) -> FloatArray:
        """Eigenvalues up to the highest stored one, shape (k,); NaN for missing ones."""
        return self._joined("eigenvalues", np.nan)

    @cached_property
    def residuals(self) -> FloatArray:
        """Relative residuals, shape (k,); NaN where a pair is missing."""
        return self._joined("residuals", np.nan)

    @cached_property
    def stored_rows(self) -> StoredRows:
        """The file of the rows, with their checksums."""
        checksums = self._joined("checksums", 0).astype(np.uint32)
        return StoredRows(self.path, self.n_vertices, checksums)

    @property
    def checked_rows(self) -> StoredRows:
        """The file of the rows, after they have been compared with their checksums."""
        return StoredRows(self.path, self.n_vertices)

    @cached_property
    def rows(self) -> FloatArray:
        """Read-only map of shape (k, n); it stays valid while the store grows."""
        return self.stored_rows.map(len(self.eigenvalues))

    @property
    def n_converged(self) -> int:
        """Number of leading pairs that are stored without a gap."""
        return _leading(self.batches)

    @property
    def n_proven(self) -> int:
        """Number of leading pairs of a complete run."""
        proof = self.proof
        if proof is None:
            return 0
        return min(proof.n_pairs, _leading([b for b in self.batches if b.name in proof.batches]))

    @property
    def is_exhausted(self) -> bool:
        """Whether the certified pairs are all pairs of the mesh."""
        proof = self._whole_proof
        return proof is not None and proof.exhausted

    @property
    def _whole_proof(self) -> Proof | None:
        """The proof, unless some of its pairs are missing."""
        proof = self.proof
        return proof if proof is not None and self.n_proven == proof.n_pairs else None

    def covers(self, target: Target) -> int | None:
        """Return the number of leading pairs that answer a target; None if some are missing."""
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
        """Return the first `count` pairs as the solver would.

        Parameters
        ----------
        count : int, optional
            None for all stored pairs, to resume a run; missing eigenvalues are then NaN.
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
        """Compare rows with their checksums; return the batches with rows that do not agree.

        Parameters
        ----------
        count : int, optional
            Number of leading pairs to compare; None for all.
        cancel : callable, optional
            Once it returns True the remaining rows are not read.
        compared : Compared, optional
            Rows that are not read again if the state of the file is the same.
        """
        unread = np.isfinite(self.eigenvalues[:count])
        if compared is not None and compared.state and compared.state == self.stored_rows.state:
            k = min(len(unread), len(compared.checksums))
            unread[:k] &= self.stored_rows.checksums[:k] != compared.checksums[:k]
        known = np.flatnonzero(unread)
        damaged = self.stored_rows.damaged(known.tolist(), cancel)
        return [b for b in self.batches if any(b.start <= index < b.stop for index in damaged)]

    def without(self, batches: Sequence[Batch]) -> StoredSpectrum:
        """Return the spectrum without some batches, which are added to `faults`."""
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
    """Return the index after the highest pair in files of these names."""
    matches = (_BATCH.fullmatch(name) for name in names)
    return max((int(match[2]) for match in matches if match is not None), default=0)


def read_spectrum(folder: Path, key: str, n_vertices: int) -> StoredSpectrum:
    """Read the intact batches and the proof in the folder of a store; rows are not read."""
    path, names, size = folder / ROWS, list[str](), 0
    with contextlib.suppress(OSError):  # removed, or never made
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
            continue  # removed meanwhile
        except _UNUSABLE:
            faults.append(f"eigenpairs {start} to {stop - 1}")
        else:
            batches.append(batch)
    proof = None
    try:
        proof = _read_proof(folder / PROOF, key)
    except (FileNotFoundError, NotADirectoryError):
        pass  # no complete run
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
    """Write the file of a batch whose rows are on the disk."""
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
    """Write the record of a complete run."""
    content = {**vars(proof), "certificate": proof.certificate.as_dict()}
    write_sealed(folder / PROOF, key, content, {"mass": content.pop("mass")})


def _read_proof(path: Path, key: str) -> Proof:
    from meshmash_viewer.spectral.certificate import Certificate

    sealed = read_sealed(path, key)
    content = {**sealed.content, "mass": sealed.arrays["mass"]}
    content["certificate"] = Certificate.from_dict(content["certificate"])
    return Proof(**content)
