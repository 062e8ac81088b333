"""Eigenpairs on disk: written by one process, read by others, identified by content.

A spectrum is stored in a folder named after its mesh and operator (see
`meshmash_viewer.io.stored_spectrum`). Published data is never overwritten, so that it survives a
kill, a power failure and a resumed run. Disk blocks are allocated before rows are written, rows are
flushed before the file of their batch is written, and the certificate is written last. Batches that
fail their checksum are ignored, and computed again.
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

FloatArray = npt.NDArray[np.float64]

_LAPLACIAN = "laplacian.sealed"
#: Zeros written at a time.
_CHUNK = 1 << 20
#: Error codes of file systems that cannot allocate blocks in advance.
_NOT_SUPPORTED = (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS)


class StoreUnusable(InputError):
    """Nothing can be written to the cache folder; results have to be kept elsewhere."""


class StoreBusy(StoreUnusable):
    """Another process is computing the same eigenpairs into the same folder."""


class EigenpairStore:
    """The folder of one mesh and operator; made at the first write.

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
        #: Content of `PROBLEM`, for users who open the folder.
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
        #: All rows, mapped for writing, and the identity of their file, to detect a replaced one.
        self._rows: np.memmap[Any, np.dtype[np.float64]] | None = None
        self._opened: os.stat_result | None = None
        self._lost = False
        self._batches: list[Batch] = []

    @staticmethod
    def key(mesh: Mesh, operator: OperatorOptions) -> str:
        """Return the key of a mesh and operator, 32 hexadecimal digits."""
        options = json.dumps(asdict(operator), sort_keys=True)
        text = f"{FORMAT}|{mesh.n_vertices}|{mesh.content_hash}|{options}"
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    # Reading, by any process -----------------------------------------------------------------

    def load(self) -> StoredSpectrum | None:
        """Return the stored spectrum, or None without pairs; `faults` lists damaged ones.

        Rows are not compared with their checksums here, which is required before an export
        (`StoredSpectrum.damaged_batches`).
        """
        spectrum = read_spectrum(self.folder, self.folder.name, self.n_vertices)
        if spectrum.batches:
            try:
                _ = spectrum.rows  # mapped while the folder is there
            except (OSError, ValueError):
                return None  # just removed
            self._cache.touch(self.folder)
        return spectrum if spectrum.batches or spectrum.faults else None

    def laplacian(self) -> tuple[SparseMatrix, SparseMatrix] | None:
        """Return the stored L and M, or None; see `keep_laplacian`."""
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
        """Store the matrices, to save building them again; errors are ignored."""
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
        """Allocate k eigenvectors in place of the stored ones.

        Returns
        -------
        ndarray of float64, shape (k, n)
            Memory map to write the rows to; call `append` when some are final.

        Raises
        ------
        StoreUnusable
            If another process is writing to the same store, the disk is full, or the cache folder
            cannot be written.
        """
        return self.extend(k, n, np.zeros(0, dtype=np.int64))

    def extend(self, k: int, n: int | None, kept: npt.NDArray[np.int64]) -> FloatArray:
        """As `allocate`, but keep the stored eigenvectors with the indices `kept`.

        Batches with other indices below k are removed.
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
            # a new file, so that existing maps of the old one stay valid
            for name in (PROOF, ROWS):
                persistently(functools.partial((self.folder / name).unlink, missing_ok=True))
        path = self.folder / ROWS
        _make_room(path, highest * self.stored_rows.row_bytes)
        # of the open file, as it is compared: on Windows the device differs for the path
        with path.open("rb") as file:
            self._opened = os.fstat(file.fileno())
        self._lost = False
        self._rows = np.memmap(path, np.float64, "r+", shape=(highest, self.n_vertices))
        return self._rows[:k]

    @contextlib.contextmanager
    def _row_file(self) -> Iterator[IO[bytes]]:
        """Open the file of rows, unless it was removed or replaced."""
        with (self.folder / ROWS).open("r+b", buffering=0) as file:
            assert self._opened is not None
            if not os.path.samestat(os.fstat(file.fileno()), self._opened):
                raise FileNotFoundError(errno.ENOENT, "it was removed")
            yield file

    def append(self, start: int, eigenvalues: FloatArray, residuals: FloatArray) -> None:
        """Publish pairs whose rows have been written: ``start``, ``start + 1``, ...

        Pairs that were published before are unchanged.

        Parameters
        ----------
        start : int
            Index of the first one.
        eigenvalues, residuals : ndarray of float64, shape (b,)

        Raises
        ------
        StoreUnusable
            If the disk is full, or the folder was removed; the rows stay mapped.
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
        """Record that a run is complete, and release the lock.

        Parameters
        ----------
        decomposition : Decomposition
            Result of the solver; all of its pairs have been published.
        max_eigenvalue : float, optional
            The requested threshold, to recognize the same request later.

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
        """Prevent other processes from writing, until `close`.

        Raises
        ------
        StoreBusy
            If another process is writing.
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
        """Stop writing; published pairs stay, and a run can resume from them."""
        mapped, self._rows = self._rows is not None, None
        if mapped and not self._lost:  # else the rows may still be mapped elsewhere
            published = max((batch.stop for batch in self._batches), default=0)
            with contextlib.suppress(OSError), self._row_file() as file:
                file.truncate(published * self.stored_rows.row_bytes)  # not on all systems
        self._lock.release()

    @property
    def stored_rows(self) -> StoredRows:
        """The file of the rows."""
        return StoredRows(self.folder / ROWS, self.n_vertices)

    def _published(self, count: int) -> npt.NDArray[np.bool_]:
        """Return a mask of the published ones of the first pairs, shape (count,)."""
        published = np.zeros(count, dtype=bool)
        for batch in self._batches:
            published[batch.start : batch.stop] = True
        return published

    def _make_folder(self, size: int) -> None:
        """Make the folder, and free `size` bytes for it by removing older stores."""
        already = folder_size(self.folder)
        needed = max(0, size - already)
        self._cache.root.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(self._cache.root).free
        if needed < free + self._cache.size():  # else removing the others does not suffice
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
    """Make a file or extend it with zeros to `size` bytes, with disk blocks allocated.

    Raises
    ------
    OSError
        If the disk is full. Without allocated blocks, a write into the map would then crash the
        process.
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
