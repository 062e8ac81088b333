"""Cache of stored spectra: size limit, removal of old stores, and the file of published pairs."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from filelock import FileLock

from meshmash_viewer.io.atomic import LEFT_OVER, cache_folder, discard, written_whole
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

#: Version of the file format and of the operator; stores of other versions are not used.
FORMAT = 7
#: File that describes a store; its modification time is the time of the store's last use.
PROBLEM = "problem.json"
#: Files of a store with its eigenvectors, and with all other published data.
ROWS, PAIRS = "eigenvectors.f64", "pairs.sealed"
#: Errors of eigenvalues measured on a finer mesh, in NumPy's format.
ERRORS = "mesh_errors.npy"

#: Default maximum size of the cache in bytes: 300 pairs of eight meshes of a million vertices.
DEFAULT_CAP = 20_000_000_000

_KEY = re.compile(r"[0-9a-f]{32}")
_REMOVED = re.compile(r"removed-[0-9a-f]{32}-\d+")
#: Seconds without use after which stores of other versions are removed.
_FORGOTTEN = 7 * 86_400.0


def default_cache_folder() -> Path:
    """Return the user's folder of stored spectra."""
    return cache_folder() / "eigenpairs"


def folder_size(folder: Path) -> int:
    """Return the size of a folder on the disk in bytes; holes in sparse files count as 0."""
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                status = os.stat(os.path.join(place, name))
            except FileNotFoundError:
                continue  # deleted meanwhile
            blocks = getattr(status, "st_blocks", None)
            total += status.st_size if blocks is None else min(512 * blocks, status.st_size)
    return total


class EigenpairCache:
    """All stores in one folder, by default the user's cache, of at most `cap` bytes in total."""

    def __init__(self, root: str | Path | None = None, cap: int = DEFAULT_CAP) -> None:
        self.root = default_cache_folder() if root is None else Path(root)
        self.cap = cap

    def lock_path(self, key: str) -> Path:
        """Return the lock file of the store `key`, locked while the store is written."""
        return self.root / "locks" / f"{key}.lock"

    def stores(self) -> list[Path]:
        """List the folders of all stores, least recently used first."""
        if not self.root.is_dir():
            return []
        found = [entry for entry in self.root.iterdir() if _KEY.fullmatch(entry.name)]
        return sorted(found, key=lambda folder: (_last_used(folder), folder.name))

    def size(self) -> int:
        """Return the size on the disk in bytes."""
        return folder_size(self.root)

    def clear(self) -> int:
        """Remove all stores except those being written; return the number of bytes freed."""
        before = self.size()
        for folder in self.stores():
            self._remove(folder)
        self.tidy()
        return before - self.size()

    def evict(self, keep: str | None = None, room_for: int = 0) -> None:
        """Remove the least recently used stores, except `keep`, until `room_for` bytes fit."""
        excess = self.size() + room_for - self.cap
        for folder in self.stores():
            if excess <= 0:
                return
            if folder.name != keep:
                excess -= self._remove(folder)

    def touch(self, folder: Path) -> None:
        """Set the time of last use of a store to now, if the store can be written."""
        with contextlib.suppress(OSError):  # removed meanwhile, or not writable
            os.utime(folder / PROBLEM)

    def tidy(self) -> None:
        """Remove partial files of killed processes, and stores of other versions."""
        with contextlib.suppress(OSError):
            for entry in list(self.root.iterdir()):
                if _REMOVED.fullmatch(entry.name):
                    shutil.rmtree(entry, ignore_errors=True)
        for folder in self.stores():
            self._remove(folder, only_if=_tidy_store)

    def _remove(self, folder: Path, only_if: Callable[[Path], bool] = Path.exists) -> int:
        """Remove a store if a condition holds once it is locked; return the bytes freed."""
        # errors: the store is being written, is another user's, or was removed meanwhile
        with contextlib.suppress(OSError), FileLock(self.lock_path(folder.name), timeout=0):
            if only_if(folder):
                size = folder_size(folder)
                # renamed first, so that a partly removed store is never read
                place = self.root / f"removed-{folder.name}-{time.time_ns()}"
                folder.rename(place)
                shutil.rmtree(place, ignore_errors=True)
                return size
        return 0


def _tidy_store(folder: Path) -> bool:
    """Remove partial files in a locked store; return whether the whole store can be removed."""
    try:
        about = json.loads((folder / PROBLEM).read_bytes())
        n_vertices, version = int(about["mesh"]["n_vertices"]), about["format"]
    except (OSError, ValueError, KeyError, TypeError):
        version = None
    if version != FORMAT:
        return time.time() - _last_used(folder) / 1e9 > _FORGOTTEN
    names = [path.name for path in folder.iterdir()]
    for name in names:
        if name.startswith(LEFT_OVER):
            discard(folder / name)
    with contextlib.suppress(ValueError, KeyError, TypeError):  # the next read reports damage
        found = Published.read(folder / PAIRS, folder.name) if PAIRS in names else Published()
        published = 8 * n_vertices * len(found)
        rows = folder / ROWS
        if rows.exists() and rows.stat().st_size > published:
            os.truncate(rows, published)  # allocated for pairs that were not computed
    return PAIRS not in names


def _last_used(folder: Path) -> int:
    for path in (folder / PROBLEM, folder):
        with contextlib.suppress(OSError):
            return path.stat().st_mtime_ns
    return 0


_MAGIC = b"meshmash-viewer sha256 "
_FIRST_LINE = len(_MAGIC) + 64 + 1
#: Name of the JSON among the arrays.
_ABOUT = "about.json"
#: Attributes that are arrays, of the pairs and of the batches.
_OF_PAIRS = ("eigenvalues", "residuals", "mass")
_OF_BATCHES = ("checksums", "stops", "defects")


class Damaged(ValueError):
    """A file does not agree with its checksum, or belongs to another store."""


@dataclass(frozen=True, eq=False)
class Published:
    """Published leading pairs of a store without their eigenvectors, and their batches.

    The data are in one file, which is replaced atomically and never changed in place. Its first
    line contains the SHA-256 of the rest, a NumPy archive. The archive contains the arrays, and
    JSON with the other attributes and the key of the store.
    """

    #: Without rows, certificate (see `is_complete`) and timings until the run is complete.
    pairs: Eigenpairs = field(
        default_factory=lambda: Eigenpairs(np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    )
    #: Shape (k,): CRC-32 of each row.
    checksums: npt.NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    #: Shape (b,): Number of pairs up to the end of each batch, and their orthonormality.
    stops: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    defects: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def is_complete(self) -> bool:
        """Whether the run is complete."""
        return self.pairs.certificate.method != "none"

    def first(self, count: int) -> Published:
        """Return the data on the batches within the first `count` pairs."""
        if count >= len(self):
            return self
        n_batches = int(np.searchsorted(self.stops, count, side="right"))
        count = int(self.stops[n_batches - 1]) if n_batches else 0
        pairs = self.pairs
        kept = pairs.eigenvalues[:count], pairs.rows, pairs.residuals[:count]
        return Published(
            Eigenpairs(*kept, mass=pairs.mass),
            self.checksums[:count],
            self.stops[:n_batches],
            self.defects[:n_batches],
        )

    def write(self, path: Path, key: str) -> None:
        """Write the data to a file of the store `key`."""
        pairs = self.pairs
        about = {
            "certificate": asdict(pairs.certificate),
            "timings": {name: float(value) for name, value in pairs.timings.items()},
            "known_to": pairs.known_to,
            "key": key,
        }
        text = json.dumps(about, allow_nan=False).encode()
        members: dict[str, Any] = {name: getattr(pairs, name) for name in _OF_PAIRS}
        members |= {name: getattr(self, name) for name in _OF_BATCHES}
        with written_whole(path) as part, part.open("w+b") as file:
            file.write(bytes(_FIRST_LINE))
            np.savez(file, **members | {_ABOUT: np.array(text)})
            file.seek(_FIRST_LINE)
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            file.seek(0)
            file.write(_first_line(digest))

    @classmethod
    def read(cls, path: Path, key: str) -> Published:
        """Read a file of the store `key`.

        `Damaged` is raised if the file does not agree with its checksum, or belongs to another
        store; `OSError` if it cannot be read.
        """
        with path.open("rb") as file:
            first = file.read(_FIRST_LINE)
            if first != _first_line(hashlib.file_digest(file, "sha256").hexdigest()):
                raise Damaged(f"{path.name} does not agree with its checksum")
            file.seek(_FIRST_LINE)
            with np.load(file) as archive:
                content = dict(archive)
        about = json.loads(content.pop(_ABOUT).item())
        if about.pop("key") != key:
            raise Damaged(f"{path.name} belongs to another mesh")
        about["certificate"] = Certificate(**about["certificate"])
        batches = [content.pop(name) for name in _OF_BATCHES]
        return cls(Eigenpairs(rows=np.zeros((0, 0)), **content, **about), *batches)


def _first_line(digest: str) -> bytes:
    return _MAGIC + digest.encode() + b"\n"
