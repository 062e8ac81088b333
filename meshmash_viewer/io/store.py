"""Eigenpairs on disk: written by one process while others look, found again by content.

A spectrum lives in a folder named after its mesh and operator (see
`meshmash_viewer.io.stored_spectrum`). What has been published there is never written again, so
neither a kill nor a power cut nor a run that goes on from it can take it away. Blocks of the disk
are allocated before rows are written, rows are flushed before their batch names them, and the
proof comes last. What fails a check is left out alone, and computed again.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import json
import os
import shutil
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import persistently, written_whole
from meshmash_viewer.io.cache import (
    DEFAULT_CAP,
    FORMAT,
    PROBLEM,
    EigenpairCache,
    FileLock,
    folder_size,
)
from meshmash_viewer.io.sealed import read_sealed, write_sealed
from meshmash_viewer.io.stored_spectrum import (
    PROOF,
    ROWS,
    Batch,
    Proof,
    StoredRows,
    StoredSpectrum,
    read_spectrum,
    write_batch,
    write_proof,
)

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions, SparseMatrix
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.eigensolver import Decomposition

__all__ = ["EigenpairStore", "StoreBusy", "StoreUnusable", "StoredSpectrum"]

FloatArray = npt.NDArray[np.float64]

_LAPLACIAN = "laplacian.sealed"
#: Zeros written at a time.
_CHUNK = 1 << 20
#: What a file system answers that cannot allocate blocks beforehand.
_NOT_SUPPORTED = (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS)


class StoreUnusable(InputError):
    """Nothing can be kept in the cache folder; what is computed has to be kept elsewhere."""


class StoreBusy(StoreUnusable):
    """Another process is computing the same eigenpairs into the same folder."""


class EigenpairStore:
    """The folder of one mesh under one operator; made when something is written into it.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    root : str or Path, optional
        Cache folder; None for the user's.
    cap : int
        Bytes that the whole cache may hold.
    """

    def __init__(
        self,
        mesh: Mesh,
        operator: OperatorOptions,
        root: str | Path | None = None,
        cap: int = DEFAULT_CAP,
    ) -> None:
        self._cache = EigenpairCache(root, cap)
        key = self.key(mesh, operator)
        self.folder = self._cache.root / key
        self.n_vertices = mesh.n_vertices
        #: For people who look into the folder.
        self._description = {
            "format": FORMAT,
            "mesh": {
                "name": mesh.name,
                "hash": mesh.content_hash,
                "unit": mesh.unit,
                "n_vertices": mesh.n_vertices,
                "n_faces": mesh.n_faces,
            },
            "operator": asdict(operator),
        }
        self._lock = FileLock(self._cache.lock_path(key))
        #: All rows, mapped for writing, and what tells their file from one that took its place.
        self._rows: np.memmap[Any, np.dtype[np.float64]] | None = None
        self._opened: os.stat_result | None = None
        self._lost = False
        self._batches: list[Batch] = []

    @staticmethod
    def key(mesh: Mesh, operator: OperatorOptions) -> str:
        """32 hexadecimal digits that tell one mesh and operator from all others."""
        options = json.dumps(asdict(operator), sort_keys=True)
        text = f"{FORMAT}|{mesh.n_vertices}|{mesh.content_hash}|{options}"
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    # Reading, by any process -----------------------------------------------------------------

    def load(self) -> StoredSpectrum | None:
        """What is there, or None without a pair; see `StoredSpectrum.faults` for what is not.

        Rows are not compared with their checksums here: whoever lets numbers out of the program
        does so (`StoredSpectrum.damaged_batches`).
        """
        spectrum = read_spectrum(self.folder, self.folder.name, self.n_vertices)
        if spectrum.batches:
            try:
                _ = spectrum.rows  # mapped while the folder is there
            except (OSError, ValueError):
                return None  # cleared, this moment
            self._cache.touch(self.folder)
        return spectrum if spectrum.batches or spectrum.faults else None

    def laplacian(self) -> tuple[SparseMatrix, SparseMatrix] | None:
        """L and M as they were kept, or None; see `keep_laplacian`."""
        from scipy import sparse

        n = self.n_vertices
        try:
            arrays = read_sealed(self.folder / _LAPLACIAN, self.folder.name).arrays
            columns = arrays["data"], arrays["indices"], arrays["indptr"]
            stiffness = sparse.csc_array(columns, shape=(n, n))
            return stiffness, sparse.diags_array(arrays["areas"], shape=(n, n))
        except (OSError, ValueError, KeyError):
            return None

    # Writing, by the one process that holds the lock -----------------------------------------

    def keep_laplacian(self, stiffness: SparseMatrix, mass: SparseMatrix) -> None:
        """Keep the matrices, which take as long to build as many a pair; no loss if that fails."""
        arrays = {
            "data": stiffness.data,
            "indices": stiffness.indices,
            "indptr": stiffness.indptr,
            "areas": mass.diagonal(),
        }
        with contextlib.suppress(OSError):
            self._make_folder(sum(array.nbytes for array in arrays.values()))
            write_sealed(self.folder / _LAPLACIAN, self.folder.name, {}, arrays)

    def allocate(self, k: int, n: int | None = None) -> FloatArray:
        """Make room for k eigenvectors in place of what is there.

        Returns
        -------
        ndarray of float64, shape (k, n)
            Memory map to write the rows into; call `append` when some are final.

        Raises
        ------
        StoreUnusable
            If another process is writing into the same store, the disk has no room, or the cache
            folder cannot be written.
        """
        return self.extend(k, n, np.zeros(0, dtype=np.int64))

    def extend(self, k: int, n: int | None, kept: npt.NDArray[np.int64]) -> FloatArray:
        """Make room for k eigenvectors, of which those of the indices `kept` are there already.

        Batches with other indices below k are dropped. As `allocate` otherwise.
        """
        n = self.n_vertices if n is None else n
        if n != self.n_vertices:
            raise ValueError(f"a row has {self.n_vertices} values, not {n}")
        self.lock()
        try:
            return self._with_room(k, set(kept.tolist()))
        except OSError as fault:
            self.close()
            raise self._unusable(fault) from fault
        except BaseException:
            self.close()
            raise

    def _with_room(self, k: int, kept: set[int]) -> FloatArray:
        there = read_spectrum(self.folder, self.folder.name, self.n_vertices)
        self._batches = [
            batch
            for batch in there.batches
            if kept and kept.issuperset(range(batch.start, min(batch.stop, k)))
        ]
        if not self._published(k)[list(kept)].all():
            raise FileNotFoundError(errno.ENOENT, "it was removed")
        highest = max([k, *(batch.stop for batch in self._batches)])
        self._make_folder(8 * highest * self.n_vertices)
        named = {batch.path for batch in self._batches}
        for path in self.folder.glob("pairs-*"):
            if path not in named:
                persistently(functools.partial(path.unlink, missing_ok=True))
        if not kept:
            # A new file: whoever has mapped the old one goes on with that.
            for name in (PROOF, ROWS):
                persistently(functools.partial((self.folder / name).unlink, missing_ok=True))
        path = self.folder / ROWS
        _make_room(path, highest * self.stored_rows.row_bytes)
        # by a handle, as it is compared: Windows numbers devices otherwise by the path
        with path.open("rb") as file:
            self._opened = os.fstat(file.fileno())
        self._lost = False
        self._rows = np.memmap(path, np.float64, "r+", shape=(highest, self.n_vertices))
        return self._rows[:k]

    @contextlib.contextmanager
    def _row_file(self) -> Iterator[IO[bytes]]:
        """The file of rows, unless it has been taken away."""
        with (self.folder / ROWS).open("r+b", buffering=0) as file:
            assert self._opened is not None
            if not os.path.samestat(os.fstat(file.fileno()), self._opened):
                raise FileNotFoundError(errno.ENOENT, "it was removed")
            yield file

    def append(self, start: int, eigenvalues: FloatArray, residuals: FloatArray) -> None:
        """Publish pairs whose rows have been written: ``start``, ``start + 1``, ...

        Pairs that were published before are left as they are.

        Parameters
        ----------
        start : int
            Index of the first of them.
        eigenvalues, residuals : ndarray of float64, shape (b,)

        Raises
        ------
        StoreUnusable
            If the disk has no room for more, or the folder has gone; the rows stay mapped.
        """
        assert self._rows is not None, "allocate comes before append"
        stop = start + len(eigenvalues)
        published = self._published(stop)[start:]
        if published.all():
            return
        if published.any():
            raise ValueError(f"some of the pairs {start} to {stop - 1} were published before")
        try:
            checksums = np.array([zlib.crc32(r) for r in self._rows[start:stop]], dtype=np.uint32)
            self._rows.flush()
            with self._row_file() as file:
                os.fsync(file.fileno())
            batch = write_batch(
                self.folder, self.folder.name, start, eigenvalues, residuals, checksums
            )
        except OSError as fault:
            raise self._lose(fault) from fault
        self._batches.append(batch)

    def finish(self, decomposition: Decomposition, max_eigenvalue: float | None = None) -> None:
        """Record that a run is complete, and let other processes write.

        Parameters
        ----------
        decomposition : Decomposition
            What the solver returned; all of its pairs have been published.
        max_eigenvalue : float, optional
            The threshold asked for, which the next request may ask for again.

        Raises
        ------
        StoreUnusable
            See `append`.
        """
        k = decomposition.n_components
        assert self._published(k).all(), "append comes before finish"
        try:
            mass = np.asarray(decomposition.mass, dtype=np.float64)
            proof = Proof(
                n_pairs=k,
                batches=[batch.name for batch in self._batches if batch.start < k],
                certificate=decomposition.certificate,
                max_eigenvalue=max_eigenvalue,
                exhausted=k >= int(np.count_nonzero(mass > 0)),
                timings={key: float(value) for key, value in decomposition.timings.items()},
                mass=mass,
            )
            write_proof(self.folder, self.folder.name, proof)
            self._cache.touch(self.folder)
        except OSError as fault:
            raise self._lose(fault) from fault
        finally:
            self.close()

    def lock(self) -> None:
        """Keep other processes from writing, until `close`.

        Raises
        ------
        StoreBusy
            If another process is at it.
        StoreUnusable
            If the cache folder cannot be written.
        """
        try:
            acquired = self._lock.acquire()
        except OSError as fault:
            raise self._unusable(fault) from fault
        if not acquired:
            raise StoreBusy("Another process is computing the eigenpairs of this mesh.")

    def close(self) -> None:
        """Stop writing; what has converged stays and can be resumed."""
        mapped, self._rows = self._rows is not None, None
        if mapped and not self._lost:  # else whoever has mapped the rows goes on with them
            published = max((batch.stop for batch in self._batches), default=0)
            with contextlib.suppress(OSError), self._row_file() as file:
                file.truncate(published * self.stored_rows.row_bytes)  # not on all systems
        self._lock.release()

    @property
    def stored_rows(self) -> StoredRows:
        """Where the rows are."""
        return StoredRows(self.folder / ROWS, self.n_vertices)

    def _published(self, count: int) -> npt.NDArray[np.bool_]:
        """Which of the first pairs have been published, shape (count,)."""
        published = np.zeros(count, dtype=bool)
        for batch in self._batches:
            published[batch.start : batch.stop] = True
        return published

    def _make_folder(self, size: int) -> None:
        """Make the folder, and room for so many bytes in it by removing what is older."""
        already = folder_size(self.folder)
        needed = max(0, size - already)
        self._cache.root.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(self._cache.root).free
        if needed < free + self._cache.size():  # else the others would go for nothing
            self._cache.evict(keep=self.folder.name, room_for=needed)
            free = shutil.disk_usage(self._cache.root).free
        if needed > free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / PROBLEM).exists():
            with written_whole(self.folder / PROBLEM) as part:
                part.write_text(json.dumps(self._description, indent=1), encoding="utf-8")

    def _lose(self, fault: OSError) -> StoreUnusable:
        self._lost = True
        return self._unusable(fault)

    def _unusable(self, fault: OSError) -> StoreUnusable:
        return StoreUnusable(
            f"Nothing can be kept in the cache folder {self._cache.root}"
            f" ({(fault.strerror or str(fault)).lower()})."
        )

    def __enter__(self) -> EigenpairStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _make_room(path: Path, size: int) -> None:
    """Lengthen a file to so many bytes by zeros, or make it; blocks of the disk are behind them.

    Raises
    ------
    OSError
        If the disk is full. Without the blocks a full disk would end the process, by a signal
        where it writes into a map.
    """
    with path.open("ab", buffering=0) as file:
        before = file.tell()
        try:
            _fill(file, before, size - before)
            os.fsync(file.fileno())
        except BaseException:
            file.truncate(before)
            raise


def _fill(file: IO[bytes], start: int, size: int) -> None:
    if size > 0 and hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), start, size)
        except OSError as fault:
            if fault.errno not in _NOT_SUPPORTED:
                raise
        else:
            return
    zeros = bytes(min(max(size, 0), _CHUNK))
    while size > 0:
        size -= file.write(zeros[:size])
