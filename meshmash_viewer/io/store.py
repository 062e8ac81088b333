"""Stores of eigenpairs on the disk, which one process writes and other processes read.

A store is a folder named by hashes of its mesh and operator, and of what was asked for. So the
pairs of a request depend on nothing but the request: not on pairs that were stored for another
request, nor on interruptions, since a resumed run repeats the plan of an uninterrupted one, except
for complete batches. A store has two data files. The first
contains the eigenvectors, contiguous rows of float64 without a header, so that they can be mapped.
The second (see `meshmash_viewer.io.cache`) contains the eigenvalues, residuals and checksums of the
published rows. It is replaced atomically after new rows have been flushed to the disk, and
published rows are not written again. Published pairs therefore survive a kill, a power failure and
a resumed run. A store has the leading batches of the spectrum: from the batch of the first damaged
row on, pairs are computed again.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock, Timeout

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.truncation import asked_target
from meshmash_viewer.io.atomic import make_room, persistently, written_whole
from meshmash_viewer.io.cache import (
    DEFAULT_CAP,
    ERRORS,
    FORMAT,
    PAIRS,
    PROBLEM,
    ROWS,
    EigenpairCache,
    Published,
    folder_size,
)
from meshmash_viewer.progress import CancelCallback, check_cancelled
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import Target

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh


#: Number of threads that compute checksums, and bytes that each thread reads at a time.
_THREADS, _BLOCK = 2, 1 << 18
#: Exceptions raised by reading a damaged or wrong file.
_UNUSABLE = (OSError, ValueError, KeyError, TypeError)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class StoreUnusable(InputError):
    """The cache folder cannot be written."""


class StoreBusy(StoreUnusable):
    """Another process is writing to the same store."""


class EigenpairStore:
    """Stored eigenpairs of one request, in a folder that is made at the first write.

    The request is the part `target` of the spectrum of a mesh and operator. The folder is in the
    cache folder `root`, by default the user's, of at most `cap` bytes. `damage` names damaged pairs
    found by `is_complete` or `load`: "eigenpairs 20 to 39", or "".
    """

    def __init__(
        self,
        mesh: Mesh,
        operator: OperatorOptions,
        target: Target,
        root: str | Path | None = None,
        cap: int = DEFAULT_CAP,
    ) -> None:
        self._cache = EigenpairCache(root, cap)
        self.target = asked_target(target, mesh.area, mesh.n_vertices - len(mesh.unreferenced))
        key = self.key(mesh, operator, self.target)
        self.folder = self._cache.root / key
        self.n_vertices = mesh.n_vertices
        self._operator = operator
        #: Content of the file `PROBLEM`; only format, n_vertices and target are read again.
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
            "target": asdict(self.target),
        }
        self._lock = FileLock(self._cache.lock_path(key), timeout=0, thread_local=False)
        self.damage = ""
        #: Published data on the intact pairs.
        self._published = Published()
        #: All rows, mapped for writing, and the status of their file, to detect a replaced file.
        self._rows: np.memmap[Any, np.dtype[np.float64]] | None = None
        self._opened: os.stat_result | None = None
        self._lost = False

    @staticmethod
    def key(mesh: Mesh, operator: OperatorOptions, target: Target | None = None) -> str:
        """Return the key of a request, 32 hexadecimal digits, or the 20 of mesh and operator."""
        options = json.dumps(asdict(operator), sort_keys=True)
        problem = f"{FORMAT}|{mesh.n_vertices}|{mesh.content_hash}|{options}"
        asked = "" if target is None else _hash(f"{target.kind}|{target.value!r}")[:12]
        return _hash(problem)[:20] + asked

    @classmethod
    def targets(cls, mesh: Mesh, operator: OperatorOptions) -> list[Target]:
        """Return what was asked for on a mesh and operator in the user's cache, last use first."""
        key, found = cls.key(mesh, operator), []
        for folder in reversed(EigenpairCache().stores()):
            if folder.name.startswith(key):
                with contextlib.suppress(*_UNUSABLE):  # removed meanwhile, or another version
                    found.append(Target(**json.loads((folder / PROBLEM).read_bytes())["target"]))
        return found

    # Reading, by any process -----------------------------------------------------------------

    @property
    def is_complete(self) -> bool:
        """Whether all pairs of the request are stored; checksums of rows are not compared."""
        self._read()
        return self._published.is_complete

    def load(
        self, count: int | None = None, cancel: CancelCallback | None = None
    ) -> Eigenpairs | None:
        """Return the stored pairs, at most `count`; None if there are none.

        If a row is damaged, the pairs of the batches before it are returned, without certificate.
        Checksums of 300 pairs of a million vertices take two seconds. `cancel` is called before
        each row; if it returns True, `Cancelled` is raised.
        """
        self._read()
        stored = len(self._published)
        wanted = stored if count is None else min(count, stored)
        intact = self._intact(wanted, cancel)
        if intact < wanted:
            self._leave_out(intact, stored)
        found = self._published
        wanted = min(wanted, len(found))
        try:
            rows = self.map(wanted) if wanted else None
        except (OSError, ValueError):  # the file was just removed
            rows = None
        if rows is None:
            return None
        self._cache.touch(self.folder)
        pairs = replace(found.pairs, rows=rows, target=self.target, operator=self._operator)
        if found.is_complete:
            pairs = replace(pairs, total=len(found))
        else:
            part = Certificate("none", orthonormality=float(found.defects[-1]))
            pairs = replace(pairs, certificate=part, total=self.target.n_components or 0)
        return pairs if wanted == len(found) else pairs.first(wanted)

    def _read(self) -> None:
        """Read the published data, without the eigenvectors."""
        self._published, self.damage = Published(), ""
        try:
            found = Published.read(self.folder / PAIRS, self.folder.name)
            size = (self.folder / ROWS).stat().st_size if len(found) else 0
        except (FileNotFoundError, NotADirectoryError):
            if (self.folder / PAIRS).exists():
                self.damage = "all eigenvectors"
        except _UNUSABLE:
            self.damage = "all eigenpairs"
        else:
            self._published = found
            there = size // (8 * self.n_vertices)
            if there < len(found):
                self._leave_out(there, len(found))

    def _leave_out(self, start: int, stop: int) -> None:
        """Leave out the batch of the pair `start`, and later ones."""
        self._published = self._published.first(start)
        self.damage = self.damage or f"eigenpairs {len(self._published)} to {stop - 1}"

    def _intact(self, count: int, cancel: CancelCallback | None) -> int:
        """Return the number of rows, up to `count`, before the first damaged one."""
        row_bytes, checksums = 8 * self.n_vertices, self._published.checksums

        def is_intact(index: int) -> bool:
            check_cancelled(cancel)
            checksum, block = 0, memoryview(bytearray(_BLOCK))
            try:
                with (self.folder / ROWS).open("rb") as file:
                    file.seek(index * row_bytes)
                    for left in range(row_bytes, 0, -_BLOCK):
                        part = block[:left]
                        if file.readinto(part) < len(part):
                            return False
                        checksum = zlib.crc32(part, checksum)
            except OSError:
                return False
            return bool(checksum == checksums[index])

        with ThreadPoolExecutor(_THREADS) as threads:  # zlib releases the interpreter lock
            intact = list(threads.map(is_intact, range(count)))
        return intact.index(False) if False in intact else count

    def map(self, count: int) -> FloatArray:
        """Return a read-only memory map of the first rows, shape (count, n)."""
        return np.memmap(self.folder / ROWS, np.float64, "r", shape=(count, self.n_vertices))

    def measured_errors(self) -> FloatArray:
        """Return the errors last given to `keep_errors`, shape (m,); empty if there are none."""
        try:
            found = np.load(self.folder / ERRORS)
        except _UNUSABLE:
            return np.zeros(0)
        is_intact = found.ndim == 1 and found.dtype == np.float64 and np.isfinite(found).all()
        return found if is_intact else np.zeros(0)

    def keep_errors(self, errors: FloatArray) -> None:
        """Store errors of leading eigenvalues, measured on a finer mesh, instead of fewer errors.

        The mesh determines them, so that they remain valid if pairs are added or lost.
        """
        if not self.folder.exists() or len(errors) < len(self.measured_errors()):
            return
        with (
            contextlib.suppress(OSError),  # they can be measured again
            written_whole(self.folder / ERRORS) as part,
            part.open("wb") as file,  # `np.save` would append .npy to a name
        ):
            np.save(file, errors)

    # Writing, by the process with the lock ---------------------------------------------------

    def allocate(self, k: int, n: int | None = None, n_kept: int = 0) -> FloatArray:
        """Allocate k eigenvectors, and return a memory map of shape (k, n) for writing them.

        The first `n_kept` of the pairs last returned by `load` are kept. If `n_kept` is less than
        k, all other stored pairs are removed. Call `append` whenever further rows are final.
        `StoreUnusable` is raised if another process is writing to the same store, the disk is full,
        or the cache folder cannot be written.
        """
        assert n in (None, self.n_vertices)
        self.lock()
        try:
            return self._with_room(k, n_kept)
        except OSError as fault:
            self.close()
            raise self._unusable(fault) from fault
        except BaseException:
            self.close()
            raise

    def _with_room(self, k: int, n_kept: int) -> FloatArray:
        path = self.folder / ROWS
        if n_kept and not path.exists():
            raise FileNotFoundError(errno.ENOENT, "it was removed")
        if n_kept < k:
            self._published = self._published.first(n_kept)
        highest = max(k, len(self._published))
        self._make_folder(8 * highest * self.n_vertices)
        if not n_kept:
            # a new file, so that existing maps of the old one stay valid
            for name in (PAIRS, ROWS):
                persistently((self.folder / name).unlink, True)
        elif self.damage:
            # before rows from the damaged one on are overwritten
            self._published.write(self.folder / PAIRS, self.folder.name)
        make_room(path, 8 * highest * self.n_vertices)
        # `fstat`, as `stat` of a path gives another device on Windows
        with path.open("rb") as file:
            self._opened = os.fstat(file.fileno())
        self._lost = False
        self._rows = np.memmap(path, np.float64, "r+", shape=(highest, self.n_vertices))
        return self._rows[:k]

    @contextlib.contextmanager
    def _row_file(self) -> Iterator[IO[bytes]]:
        """Open the file of rows; raise `FileNotFoundError` if it was removed or replaced."""
        with (self.folder / ROWS).open("r+b", buffering=0) as file:
            assert self._opened is not None
            if not os.path.samestat(os.fstat(file.fileno()), self._opened):
                raise FileNotFoundError(errno.ENOENT, "it was removed")
            yield file

    def append(self, pairs: Eigenpairs) -> None:
        """Publish the pairs that are not yet published, and a certificate.

        `pairs` are all leading pairs. Their rows are copied unless they are in the memory that
        `allocate` returned. A certificate completes the run: the lock is released. `StoreUnusable`
        is raised if the disk is full, or the folder was removed; the rows stay mapped.
        """
        start, stop = len(self._published), len(pairs)
        if self._rows is None:
            self.allocate(max(pairs.total, stop))
            start = 0
        rows, published = self._rows, self._published
        assert rows is not None
        is_proven = pairs.certificate.method != "none"
        try:
            if stop > start:
                if not np.may_share_memory(rows, pairs.rows):
                    rows[start:stop] = pairs.rows[start:stop]
                checksums = [zlib.crc32(row) for row in rows[start:stop]]
                rows.flush()
                with self._row_file() as file:
                    os.fsync(file.fileno())
                published = replace(
                    published,
                    checksums=np.append(published.checksums, np.array(checksums, dtype=np.uint32)),
                    stops=np.append(published.stops, stop),
                    defects=np.append(published.defects, pairs.certificate.orthonormality),
                )
            if stop > start or is_proven:
                published = replace(published, pairs=replace(pairs, rows=np.zeros((0, 0))))
                with self._row_file():
                    published.write(self.folder / PAIRS, self.folder.name)
        except OSError as fault:
            self._lost = True
            raise self._unusable(fault) from fault
        self._published = published
        if is_proven:
            self._cache.touch(self.folder)
            self.close()

    def lock(self) -> None:
        """Lock the store until `close`, so that no other process writes to it.

        `StoreBusy` is raised if another process is writing, and `StoreUnusable` if the cache folder
        cannot be written.
        """
        try:
            self._lock.acquire()
        except Timeout:
            what = "Another process is computing the eigenpairs of this mesh"
            raise StoreBusy("store-busy", what) from None
        except OSError as fault:
            raise self._unusable(fault) from fault

    def close(self) -> None:
        """Release the lock and the memory map; a later run can resume from the published pairs."""
        mapped, self._rows = self._rows is not None, None
        if mapped and not self._lost:  # after a failure, callers may still use the map
            with contextlib.suppress(OSError), self._row_file() as file:
                file.truncate(8 * len(self._published) * self.n_vertices)  # fails on some systems
        self._lock.release(force=True)

    def _make_folder(self, size: int) -> None:
        """Make the folder, and remove older stores until `size` bytes fit."""
        already = folder_size(self.folder)
        needed = max(0, size - already)
        self._cache.root.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(self._cache.root).free
        if needed < free + self._cache.size():  # else removing all would not suffice
            self._cache.evict(keep=self.folder.name, room_for=needed)
            free = shutil.disk_usage(self._cache.root).free
        if needed > free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / PROBLEM).exists():
            with written_whole(self.folder / PROBLEM) as part:
                part.write_text(json.dumps(self._description, indent=1), encoding="utf-8")

    def _unusable(self, fault: OSError) -> StoreUnusable:
        reason = (fault.strerror or str(fault)).lower()
        what = f"Eigenpairs cannot be stored in the cache folder {self._cache.root} ({reason})"
        return StoreUnusable("not-writable", what)

    def __enter__(self) -> EigenpairStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
