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
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import written_whole
from meshmash_viewer.io.cache import EigenpairCache, default_cache_folder, folder_size
from meshmash_viewer.io.lock import FileLock
from meshmash_viewer.io.npy import create_rows, grow_rows, map_rows
from meshmash_viewer.io.stored_spectrum import (
    CHECKSUMS,
    MASS,
    META,
    RESIDUALS,
    ROWS,
    VALUES,
    StoredSpectrum,
    checksum,
    read_spectrum,
    verify_spectrum,
)

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh

__all__ = ["EigenpairStore", "StoreBusy", "StoredSpectrum"]

FloatArray = npt.NDArray[np.float64]

#: Raised whenever the files change their meaning, so that old ones are not found.
_FORMAT = 2
_PROBLEM = "problem.json"


class StoreBusy(InputError):
    """Another process is computing the same eigenpairs into the same folder."""


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
        if not (self.folder / VALUES).exists():
            return None
        try:
            spectrum = read_spectrum(self.folder, self.n_vertices)
            if check and spectrum is not None:
                verify_spectrum(self.folder, spectrum)
        except FileNotFoundError as fault:
            # Clearing moves a folder away whole: where some is left, some was taken out.
            if (self.folder / VALUES).exists():
                self.set_aside(f"{Path(fault.filename).name} is missing")
            return None
        except (OSError, ValueError, KeyError, TypeError) as fault:
            self.set_aside(str(fault))
            return None
        if check and spectrum is not None:
            self._cache.touch(self.folder)
        return spectrum

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
        if not (self.folder / VALUES).exists():
            with written_whole(self.folder / _PROBLEM) as part:
                part.write_text(json.dumps(self._description, indent=1), encoding="utf-8")
            create_rows(self.folder / ROWS, (k, self.n_vertices), np.float64)
            create_rows(self.folder / RESIDUALS, (k,), np.float64, np.nan)
            create_rows(self.folder / CHECKSUMS, (k,), np.uint32)
            # Last, because its presence makes the folder a store.
            create_rows(self.folder / VALUES, (k,), np.float64, np.nan)
        else:
            grow_rows(self.folder / ROWS, k)
            grow_rows(self.folder / RESIDUALS, k, np.nan)
            grow_rows(self.folder / CHECKSUMS, k)
            grow_rows(self.folder / VALUES, k, np.nan)
        rows = map_rows(self.folder / ROWS, "r+", (None, self.n_vertices))
        self._residuals = map_rows(self.folder / RESIDUALS, "r+", (None,))
        self._checksums = map_rows(self.folder / CHECKSUMS, "r+", (None,))
        self._values = map_rows(self.folder / VALUES, "r+", (None,))
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
                checksum(self._rows[start + i], value, residual)
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
        (self.folder / META).unlink(missing_ok=True)
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
            with written_whole(self.folder / MASS) as part, part.open("wb") as file:
                np.save(file, mass)
            meta = {
                "format": _FORMAT,
                "n_pairs": k,
                "certificate": decomposition.certificate.as_dict(),
                "timings": {key: float(value) for key, value in decomposition.timings.items()},
                "max_eigenvalue": max_eigenvalue,
                "mass_checksum": zlib.crc32(mass.tobytes()),
                "exhausted": k >= int(np.count_nonzero(decomposition.mass > 0)),
            }
            with written_whole(self.folder / META) as part:
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
