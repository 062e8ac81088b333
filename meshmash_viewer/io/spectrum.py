"""Eigenpairs of a mesh: read from a store, resumed from a partial run, or computed.

The window and the command line use the same function. Where the cache cannot be written, pairs are
computed into a second store or into memory, and a remark says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.cache import EigenpairCache
from meshmash_viewer.io.store import EigenpairStore, StoreUnusable
from meshmash_viewer.io.stored_spectrum import Batch, StoredRows, StoredSpectrum
from meshmash_viewer.progress import CancelCallback, Cancelled, Progress, ProgressCallback

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions, SparseMatrix
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.spectral.eigensolver import Decomposition
    from meshmash_viewer.spectral.weyl import Target

#: ``(n, nnz, k)``: raises `InputError` if k pairs of n vertices cannot be computed here.
FitCheck: TypeAlias = Callable[[int, int, int], None]
FloatArray: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Obtained:
    """Eigenpairs of a mesh, and the file of their rows.

    Parameters
    ----------
    decomposition : Decomposition
        Its rows are mapped read-only if they are in a file.
    stored : StoredRows, optional
        That file; None for rows in memory.
    remark : str
        A sentence for the user about the store, or "".
    """

    decomposition: Decomposition
    stored: StoredRows | None = None
    remark: str = ""


class Follower(Protocol):
    """Receiver of eigenpairs while they are computed."""

    def begin(self, known: Obtained | None, mass: FloatArray) -> None:
        """Start with the known leading pairs, if any, and the diagonal of M, shape (n,)."""
        ...

    def grow(
        self, stored: StoredRows | None, rows: FloatArray, values: FloatArray, residuals: FloatArray
    ) -> None:
        """Receive all final leading pairs; `rows`, shape (k, n), has room for all k requested."""
        ...


def find_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    spare: Path | None = None,
    *,
    count: int = 0,
) -> StoredSpectrum | None:
    """Return the stored eigenpairs of a mesh, or None, without computing any.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    spare : Path, optional
        A second cache folder, which is used if it holds more pairs than the user's.
    count : int
        Number of leading pairs that are compared with their checksums (2 s for a million vertices
        and 300 pairs). Pairs that are not compared must not be exported.
    """
    return _most(_stores(mesh, operator, spare), count, None)


def obtain_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    target: Target,
    *,
    use_cache: bool = True,
    spare: Path | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
    follower: Follower | None = None,
    check: FitCheck | None = None,
    n_jobs: int | None = None,
) -> Obtained:
    """Return the eigenpairs of a mesh: stored ones, and computed ones that are then stored.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    target : Target
        Number of pairs, or largest eigenvalue.
    use_cache : bool
        Whether to read from and write to the user's cache.
    spare : Path, optional
        Cache folder used when the user's cannot be written; without it memory is used.
    progress, cancel : callable, optional
        As for `meshmash_viewer.spectral.eigensolver.solve`.
    follower : Follower, optional
    check : callable, optional
        Called before the computation begins, and again when the number of pairs is known.
    n_jobs : int, optional
        Number of slices computed at a time.

    Raises
    ------
    InputError
        If the target is invalid, or the pairs do not fit into memory.
    Cancelled
        If `cancel` returned True; converged pairs stay in the store.
    """
    stores = _stores(mesh, operator, spare) if use_cache else []
    for store in stores:
        stored = store.load()
        count = None if stored is None else stored.covers(target)
        if stored is not None and count is not None and not _damaged(stored, count, cancel):
            return _leading(stored, count)

    from meshmash_viewer.spectral.eigensolver import solve

    with _Keeper(stores, in_file=spare is not None) as keeper:
        known = _most(stores, None, cancel)
        count = None if known is None else known.covers(target)
        if known is not None and count is not None:  # computed by another process meanwhile
            return _leading(known, count)
        known = keeper.resume(known)
        if progress is not None:
            progress(Progress("operator", message="Building the Laplacian"))
        stiffness, mass = keeper.laplacian(mesh, operator)

        def fits(k: int) -> None:
            if check is not None:
                check(mesh.n_vertices, int(stiffness.nnz), k)

        if target.n_components is not None:
            fits(min(target.n_components, mesh.n_vertices))
        if follower is not None:
            there = known is not None and known.n_converged
            leading = _leading(known, known.n_converged) if known is not None and there else None
            follower.begin(leading, mass.diagonal())

        def extend(k: int, n: int, kept: npt.NDArray[np.int64]) -> FloatArray:
            fits(k)
            return keeper.extend(k, n, kept)

        def publish(start: int, eigenvalues: FloatArray, residuals: FloatArray) -> None:
            keeper.append(start, eigenvalues, residuals)
            if follower is not None:
                stop = start + len(eigenvalues)
                follower.grow(
                    keeper.stored, keeper.rows, keeper.eigenvalues[:stop], keeper.residuals[:stop]
                )

        decomposition = solve(
            stiffness,
            mass,
            target.n_components,
            max_eigenvalue=target.max_eigenvalue,
            known=None if known is None else known.decomposition(),
            allocate=lambda k, n: extend(k, n, np.zeros(0, dtype=np.int64)),
            extend=extend,
            on_pairs=publish,
            early=follower is not None,
            progress=progress,
            cancel=cancel,
            n_jobs=n_jobs,
        )
        return keeper.finish(decomposition, target.max_eigenvalue)


def _leading(stored: StoredSpectrum, count: int) -> Obtained:
    return Obtained(stored.decomposition(count), stored.checked_rows)


def _stores(mesh: Mesh, operator: OperatorOptions, spare: Path | None) -> list[EigenpairStore]:
    store = EigenpairStore(mesh, operator)
    _tidy_once(store.folder.parent)
    if spare is None:
        return [store]
    return [store, EigenpairStore(mesh, operator, root=spare)]


@cache
def _tidy_once(root: Path) -> None:
    EigenpairCache(root).tidy()


def _damaged(
    stored: StoredSpectrum, count: int | None, cancel: CancelCallback | None
) -> list[Batch]:
    damaged = stored.damaged_batches(count, cancel)
    if cancel is not None and cancel():
        raise Cancelled  # maybe before all rows were compared
    return damaged


def _most(
    stores: list[EigenpairStore], count: int | None, cancel: CancelCallback | None
) -> StoredSpectrum | None:
    """Load the store with most pairs; compare its first `count` rows (None: all) to checksums."""
    found = [stored for store in stores if (stored := store.load()) is not None]
    if not found:
        return None
    stored = max(found, key=lambda each: int(np.isfinite(each.eigenvalues).sum()))
    return stored.without(_damaged(stored, count, cancel))


def damage_remark(faults: Sequence[str]) -> str:
    """Describe the damage of a store, or return ""; see `StoredSpectrum.faults`."""
    if not faults:
        return ""
    return (
        f"Damaged on the disk, in the stored spectrum of this mesh: {', '.join(faults)}."
        " Only that is computed again."
    )


class _Keeper:
    """Output of a run: into the first usable store, or into memory.

    Parameters
    ----------
    stores : list of EigenpairStore
        Tried in this order, at first and whenever one fails.
    in_file : bool
        Whether pairs must be in a file, because another process reads them.
    """

    def __init__(self, stores: list[EigenpairStore], in_file: bool) -> None:
        self.remarks: list[str] = []
        self.rows: FloatArray = np.zeros((0, 0))
        self.eigenvalues: FloatArray = np.zeros(0)
        self.residuals: FloatArray = np.zeros(0)
        self._known: StoredSpectrum | None = None
        self._all = stores
        self._left = list(stores)
        self._in_file = in_file
        self._store: EigenpairStore | None = None
        self._there: FloatArray = self.rows  # the rows in that store
        self._take_next()

    def __enter__(self) -> _Keeper:
        return self

    def __exit__(self, *_: object) -> None:
        for store in self._all:
            store.close()

    @property
    def stored(self) -> StoredRows | None:
        """The file with the rows; None where they are in memory."""
        return None if self._store is None else self._store.stored_rows

    def resume(self, known: StoredSpectrum | None) -> StoredSpectrum | None:
        """Resume from known pairs; return them, or None if there are none."""
        self._known = known if known is not None and known.batches else None
        if known is not None and known.faults:
            self.remarks.append(damage_remark(known.faults))
        return self._known

    def laplacian(self, mesh: Mesh, operator: OperatorOptions) -> tuple[SparseMatrix, SparseMatrix]:
        """Return L and M, from the store or newly built."""
        from meshmash_viewer.laplacian import cotangent_laplacian

        for store in self._all:
            kept = store.laplacian()
            if kept is not None:
                return kept
        built = cotangent_laplacian(
            mesh, robust=operator.robust, mollify_factor=operator.mollify_factor
        )
        if self._store is not None:
            self._store.keep_laplacian(*built)
        return built

    def extend(self, k: int, n: int, kept: npt.NDArray[np.int64]) -> FloatArray:
        """Allocate k rows; those at the indices `kept` hold the known pairs."""
        self.eigenvalues, self.residuals = np.full(k, np.nan), np.full(k, np.nan)
        store, known = self._store, self._known
        in_place = known is not None and store is not None and store.folder == known.path.parent
        if store is not None:
            try:
                self._there = store.extend(k, n, kept if in_place else kept[:0])
            except StoreUnusable as fault:
                self._take_next(fault, (k, n))
                in_place = False
        self.rows = np.empty((k, n)) if self._store is None else self._there
        if known is not None and not in_place:
            for index in kept:
                self.rows[index] = known.rows[index]
        return self.rows

    def append(self, start: int, eigenvalues: FloatArray, residuals: FloatArray) -> None:
        """Store pairs whose rows have become final."""
        stop = start + len(eigenvalues)
        self.eigenvalues[start:stop], self.residuals[start:stop] = eigenvalues, residuals
        self._publish(start, stop)

    def _publish(self, start: int, stop: int) -> None:
        """Publish pairs in the store; if it fails, all pairs up to them in the next store."""
        while self._store is not None:
            if self._there is not self.rows:
                self._there[start:stop] = self.rows[start:stop]
            try:
                self._store.append(start, self.eigenvalues[start:stop], self.residuals[start:stop])
                return
            except StoreUnusable as fault:
                self._take_next(fault, self.rows.shape)
                start = 0

    def _take_next(
        self, fault: StoreUnusable | None = None, room: tuple[int, ...] | None = None
    ) -> None:
        """Lock the next usable store with room; record why the one before cannot be used."""
        self._store = None
        while True:
            if fault is not None:
                if self._in_file and not self._left:
                    raise fault
                what = "until the window is closed" if self._left else "only in memory"
                self.remarks.append(f"{fault} The eigenpairs are kept {what}.")
            if not self._left:
                return
            store = self._left.pop(0)
            try:
                store.lock()
                if room is not None:
                    self._there = store.allocate(*room)
            except StoreUnusable as another:
                fault = another
            else:
                self._store = store
                return

    def finish(self, decomposition: Decomposition, max_eigenvalue: float | None) -> Obtained:
        """Store the certificate, and return all pairs."""
        while (store := self._store) is not None:
            try:
                store.finish(decomposition, max_eigenvalue)
            except StoreUnusable as fault:
                self._take_next(fault, self.rows.shape)
                self._publish(0, len(self.rows))
                continue
            mapped = store.stored_rows.map(decomposition.n_components)
            decomposition = replace(decomposition, rows=mapped)
            break
        return Obtained(decomposition, self.stored, " ".join(self.remarks))
