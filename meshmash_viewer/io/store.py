"""Eigenpairs on disk: written by one process while others look, found again by content.

A spectrum lives in a folder named after its mesh and operator. Eigenvectors are the rows of a
memory-mapped array, so that whoever computes writes each number once and whoever shows maps the
same pages. An eigenvalue is written after its row and so publishes it; `meta.json` comes last and
turns "converged" into "proven complete". What fails a check is set aside, never used.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import written_whole
from meshmash_viewer.io.cache import EigenpairCache, default_cache_folder, folder_size
from meshmash_viewer.io.lock import FileLock
from meshmash_viewer.io.npy import create_rows, grow_rows, map_rows

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.weyl import Target

__all__ = ["EigenpairStore", "StoreBusy", "StoredSpectrum"]

FloatArray = npt.NDArray[np.float64]

#: Raised whenever the files change their meaning, so that old ones are not found.
_FORMAT = 1
_ROWS, _VALUES, _RESIDUALS, _CHECKSUMS = (
    "eigenvectors.npy",
    "eigenvalues.npy",
    "residuals.npy",
    "checksums.npy",
)
_MASS, _META, _PROBLEM = "mass.npy", "meta.json", "problem.json"
#: A row's checksum covers this many blocks of so many values: cheap, yet holes are seen.
_BLOCKS, _BLOCK_VALUES = 16, 64
#: Equal up to rounding, as the solver takes a threshold.
_THRESHOLD_MARGIN = 1e-11


class StoreBusy(InputError):
    """Another process is computing the same eigenpairs into the same folder."""


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
        return self.n_proven == self.n_converged and bool(self.meta.get("complete", False))

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
        from meshmash_viewer.eigensolver import Decomposition

        k = self.n_converged if count is None else count
        proven = 0 < k <= self.n_proven
        certificate = "interrupted before the count"
        if proven:
            certificate = str(self.meta.get("certificate", ""))
            if k < self.n_proven:
                certificate = f"the first {k} of {self.n_proven}: {certificate}"
        return Decomposition(
            eigenvalues=self.eigenvalues[:k],
            rows=self.rows[:k],
            residuals=self.residuals[:k],
            orthonormality=float(self.meta.get("orthonormality", np.nan)) if proven else np.nan,
            complete=proven and bool(self.meta.get("complete", False)),
            certificate=certificate,
            timings=dict(self.meta.get("timings", {})) if proven else {},
            mass=np.zeros(0) if self.mass is None else self.mass,
        )


class EigenpairStore:
    """The folder of one mesh under one operator.

    Parameters
    ----------
    folder : Path
        Where it is; made when something is written.
    n_vertices : int
        Length of an eigenvector.
    description : dict
        Mesh and operator, for people who look into the folder.
    cache : EigenpairCache
        The cache it is part of.

    Attributes
    ----------
    notice : str
        A sentence for the user if something had to be set aside, else empty.
    """

    def __init__(
        self, folder: Path, n_vertices: int, description: dict[str, Any], cache: EigenpairCache
    ) -> None:
        self.folder = folder
        self.n_vertices = n_vertices
        self.notice = ""
        self._description = description
        self._cache = cache
        self._lock = FileLock(cache.lock_path(folder.name))
        self._rows: FloatArray | None = None
        self._values: FloatArray | None = None
        self._residuals: FloatArray | None = None
        self._checksums: npt.NDArray[np.uint32] | None = None

    @staticmethod
    def key(mesh: Mesh, operator: OperatorOptions) -> str:
        """32 hexadecimal digits that tell one mesh and operator from all others."""
        options = json.dumps(asdict(operator), sort_keys=True)
        text = f"{_FORMAT}|{mesh.content_hash}|{options}"
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @classmethod
    def open_or_create(
        cls,
        mesh: Mesh,
        operator: OperatorOptions,
        root: str | Path | None = None,
        cap: int | None = None,
    ) -> EigenpairStore:
        """Store of a mesh under an operator; nothing is written before `allocate`.

        Parameters
        ----------
        mesh : Mesh
        operator : OperatorOptions
        root : str or Path, optional
            Cache folder; None for the user's.
        cap : int, optional
            Bytes that the whole cache may hold; None for the default.
        """
        folder = default_cache_folder() if root is None else Path(root)
        cache = EigenpairCache(folder) if cap is None else EigenpairCache(folder, cap)
        description = {
            "format": _FORMAT,
            "mesh": {
                "name": mesh.name,
                "hash": mesh.content_hash,
                "unit": mesh.unit,
                "n_vertices": mesh.n_vertices,
                "n_faces": mesh.n_faces,
            },
            "operator": asdict(operator),
        }
        key = cls.key(mesh, operator)
        return cls(cache.root / key, mesh.n_vertices, description, cache)

    # Reading, by any process -----------------------------------------------------------------

    @property
    def converged(self) -> int:
        """Number of leading pairs that are final and readable."""
        spectrum = self.load(check=False)
        return 0 if spectrum is None else spectrum.n_converged

    def load(self, check: bool = True) -> StoredSpectrum | None:
        """What is there, or None.

        Parameters
        ----------
        check : bool
            Whether to compare checksums; a window that follows a running computation has no need
            to. A store that fails is set aside, and `notice` says so.
        """
        if not (self.folder / _VALUES).exists():
            return None
        try:
            spectrum = self._map()
            if check and spectrum is not None:
                self._verify(spectrum)
        except FileNotFoundError as fault:
            # Clearing moves a folder away whole: where some is left, some was taken out.
            if (self.folder / _VALUES).exists():
                self.set_aside(f"{Path(fault.filename).name} is missing")
            return None
        except (OSError, ValueError, KeyError, TypeError) as fault:
            self.set_aside(str(fault))
            return None
        if check and spectrum is not None:
            self._cache.touch(self.folder)
        return spectrum

    def _map(self) -> StoredSpectrum | None:
        meta: dict[str, Any] = {}
        if (self.folder / _META).exists():
            meta = json.loads((self.folder / _META).read_text(encoding="utf-8"))
        # Eigenvalues first: rows and residuals that they publish are there by then.
        values = np.array(map_rows(self.folder / _VALUES, "r", (None,)))
        rows = map_rows(self.folder / _ROWS, "r", (None, self.n_vertices))
        residuals = map_rows(self.folder / _RESIDUALS, "r", (None,))
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
            mass = map_rows(self.folder / _MASS, "r", (self.n_vertices,))
        return StoredSpectrum(
            values[:converged],
            rows[:converged],
            np.array(residuals[:converged]),
            n_proven,
            meta,
            mass,
        )

    def _verify(self, spectrum: StoredSpectrum) -> None:
        values = spectrum.eigenvalues
        if np.any(np.diff(values) < -1e-9 * np.abs(values[1:])):
            raise ValueError("its eigenvalues are out of order")
        checksums = map_rows(self.folder / _CHECKSUMS, "r", (None,))
        for index, row in enumerate(spectrum.rows):
            found = _checksum(row, values[index], spectrum.residuals[index])
            if found != checksums[index]:
                raise ValueError(f"eigenpair {index} is damaged")
        said = spectrum.meta.get("mass_checksum")
        if (
            spectrum.mass is not None
            and said is not None
            and zlib.crc32(spectrum.mass.tobytes()) != said
        ):
            raise ValueError("its mass matrix is damaged")

    # Writing, by the one process that holds the lock -----------------------------------------

    def allocate(self, k: int, n: int | None = None) -> FloatArray:
        """Make room for k eigenvectors, keeping what is there.

        Returns
        -------
        ndarray of float64, shape (k, n)
            Memory map to write the rows into; call `append` when some are final.

        Raises
        ------
        StoreBusy
            If another process is writing into the same store.
        InputError
            If the disk has no room, or the cache folder cannot be written.
        """
        n = self.n_vertices if n is None else n
        if n != self.n_vertices:
            raise ValueError(f"a row has {self.n_vertices} values, not {n}")
        self.lock()
        try:
            return self._make_room(k)
        except OSError as fault:
            self.close()
            raise InputError(
                f"The cache folder {self._cache.root} cannot be written ({fault.strerror}); free"
                " the disk or give yourself permission, or compute without a cache."
            ) from fault
        except BaseException:
            self.close()
            raise

    def _make_room(self, k: int) -> FloatArray:
        already = folder_size(self.folder) if self.folder.exists() else 0
        needed = max(0, 8 * k * self.n_vertices - already)
        self._cache.root.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(self._cache.root).free
        if needed < free + self._cache.size():  # else the others would go for nothing
            self._cache.evict(keep=self.folder.name, room_for=needed)
            free = shutil.disk_usage(self._cache.root).free
        if needed > free:
            raise InputError(
                f"{k} eigenpairs need {needed / 1e9:.1f} GB in {self._cache.root}, whose disk has"
                f" {free / 1e9:.1f} GB free; free some, or ask for fewer eigenpairs."
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / _VALUES).exists():
            with written_whole(self.folder / _PROBLEM) as part:
                part.write_text(json.dumps(self._description, indent=1), encoding="utf-8")
            create_rows(self.folder / _ROWS, (k, self.n_vertices), np.float64)
            create_rows(self.folder / _RESIDUALS, (k,), np.float64, np.nan)
            create_rows(self.folder / _CHECKSUMS, (k,), np.uint32)
            # Last, because its presence makes the folder a store.
            create_rows(self.folder / _VALUES, (k,), np.float64, np.nan)
        else:
            grow_rows(self.folder / _ROWS, k)
            grow_rows(self.folder / _RESIDUALS, k, np.nan)
            grow_rows(self.folder / _CHECKSUMS, k)
            grow_rows(self.folder / _VALUES, k, np.nan)
        rows = map_rows(self.folder / _ROWS, "r+", (None, self.n_vertices))
        self._residuals = map_rows(self.folder / _RESIDUALS, "r+", (None,))
        self._checksums = map_rows(self.folder / _CHECKSUMS, "r+", (None,))
        self._values = map_rows(self.folder / _VALUES, "r+", (None,))
        self._rows = rows
        return rows[:k]

    def append(self, start: int, eigenvalues: FloatArray, residuals: FloatArray) -> None:
        """Publish pairs whose rows have been written: ``start``, ``start + 1``, ...

        Parameters
        ----------
        start : int
            Index of the first of them.
        eigenvalues, residuals : ndarray of float64, shape (b,)
        """
        assert self._rows is not None, "allocate comes before append"
        assert self._values is not None
        assert self._residuals is not None
        assert self._checksums is not None
        stop = start + len(eigenvalues)
        found = np.array(
            [
                _checksum(self._rows[start + i], value, residual)
                for i, (value, residual) in enumerate(zip(eigenvalues, residuals, strict=True))
            ],
            dtype=np.uint32,
        )
        if (
            np.array_equal(found, self._checksums[start:stop])
            and not np.isnan(self._values[start:stop]).any()
        ):
            return  # the same pairs as before
        # Other numbers in the place of proven ones: the proof does not speak of them.
        (self.folder / _META).unlink(missing_ok=True)
        self._values[start:stop] = np.nan
        self._checksums[start:stop] = found
        self._residuals[start:stop] = residuals
        self._values[start:stop] = eigenvalues

    def finish(self, decomposition: Decomposition, max_eigenvalue: float | None = None) -> None:
        """Record that a run is complete, and let other processes write.

        Parameters
        ----------
        decomposition : Decomposition
            What the solver returned; rows it did not write in place are copied.
        max_eigenvalue : float, optional
            The threshold asked for, which the next request may ask for again.
        """
        k = decomposition.n_components
        if self._rows is None or len(self._rows) < k:
            self.allocate(k)
        assert self._rows is not None
        try:
            for i in range(k):
                if not np.shares_memory(decomposition.rows[i], self._rows[i]):
                    self._rows[i] = decomposition.rows[i]
            self.append(0, decomposition.eigenvalues, decomposition.residuals)
            mass = np.asarray(decomposition.mass, dtype=np.float64)
            with written_whole(self.folder / _MASS) as part, part.open("wb") as file:
                np.save(file, mass)
            meta = {
                "format": _FORMAT,
                "n_pairs": k,
                "complete": bool(decomposition.complete),
                "certificate": decomposition.certificate,
                "orthonormality": float(decomposition.orthonormality),
                "timings": {key: float(value) for key, value in decomposition.timings.items()},
                "max_eigenvalue": max_eigenvalue,
                "mass_checksum": zlib.crc32(mass.tobytes()),
                "exhausted": k >= int(np.count_nonzero(decomposition.mass > 0)),
            }
            with written_whole(self.folder / _META) as part:
                part.write_text(json.dumps(meta, indent=1), encoding="utf-8")
            self._cache.touch(self.folder)
        finally:
            self.close()

    def lock(self) -> None:
        """Keep other processes from writing, until `close`.

        Raises
        ------
        StoreBusy
            If another process is at it.
        """
        try:
            acquired = self._lock.acquire()
        except OSError as fault:
            raise InputError(
                f"The cache folder {self._cache.root} cannot be written ({fault.strerror}); give"
                " yourself permission, or compute without a cache."
            ) from fault
        if not acquired:
            raise StoreBusy(
                "Another process is computing the eigenpairs of this mesh; wait for it to finish,"
                " or compute without the cache."
            )

    def close(self) -> None:
        """Stop writing; what has converged stays and can be resumed."""
        self._rows = self._values = self._residuals = self._checksums = None
        self._lock.release()

    def set_aside(self, reason: str) -> None:
        """Move a damaged store out of the way, unless another process is writing into it."""
        if not self._lock.acquire():
            return
        try:
            moved = self._cache.set_aside(self.folder)
        except FileNotFoundError:
            return  # cleared in between
        finally:
            self.close()
        self.notice = (
            f"The stored eigenpairs of this mesh were damaged ({reason}); they were moved to"
            f" {moved} and are computed again."
        )

    def __enter__(self) -> EigenpairStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _checksum(row: FloatArray, eigenvalue: float, residual: float) -> int:
    n = len(row)
    if n <= _BLOCKS * _BLOCK_VALUES:
        sampled = np.ascontiguousarray(row)
    else:
        begins = np.linspace(0, n - _BLOCK_VALUES, _BLOCKS).astype(np.int64)
        sampled = np.concatenate([row[begin : begin + _BLOCK_VALUES] for begin in begins])
    pair = np.array([eigenvalue, residual], dtype=np.float64)
    return zlib.crc32(pair.tobytes(), zlib.crc32(sampled.tobytes()))
