"""The eigenpairs of a mesh: found in a store, resumed where a run stopped, or computed.

One function for whoever wants eigenpairs, window and command line alike. Where the cache cannot
serve they are computed all the same, into a second store or into memory, and a remark says so.
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

__all__ = [
    "Eigenpairs",
    "FitCheck",
    "Follower",
    "damage_remark",
    "find_eigenpairs",
    "obtain_eigenpairs",
]

#: ``(n, nnz, k)``: raises where k pairs of n vertices cannot be computed on this machine.
FitCheck: TypeAlias = Callable[[int, int, int], None]
FloatArray: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """Eigenpairs of a mesh, and where they are.

    Parameters
    ----------
    decomposition : Decomposition
        Its rows are mapped read-only where they are in a file.
    stored : StoredRows, optional
        That file; None where they are in memory.
    remark : str
        A sentence for the user where there is something to say of the store, else empty.
    """

    decomposition: Decomposition
    stored: StoredRows | None = None
    remark: str = ""


class Follower(Protocol):
    """Whoever shows eigenpairs while they are computed."""

    def begin(self, known: Eigenpairs | None, mass: FloatArray) -> None:
        """The computation starts from known leading pairs (if any); the diagonal of M, (n,)."""
        ...

    def grow(
        self, stored: StoredRows | None, rows: FloatArray, values: FloatArray, residuals: FloatArray
    ) -> None:
        """So many leading pairs are final; `rows`, shape (k, n), is all that will be."""
        ...


def find_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    spare: Path | None = None,
    *,
    count: int = 0,
) -> StoredSpectrum | None:
    """What is stored of the eigenpairs of a mesh, or None; nothing is computed.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    spare : Path, optional
        A second cache folder, which is looked into if the user's holds less.
    count : int
        How many leading pairs are compared with their checksums, two seconds for a million vertices
        and 300 pairs. No other number may leave the program.
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
) -> Eigenpairs:
    """Eigenpairs of a mesh, through the store.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    target : Target
        How many pairs, or up to where.
    use_cache : bool
        Whether to look into the user's cache and add to it.
    spare : Path, optional
        Cache folder for what the user's cannot take; without it memory.
    progress, cancel : callable, optional
        As for `meshmash_viewer.spectral.eigensolver.solve`.
    follower : Follower, optional
    check : callable, optional
        Asked before the computation begins, and again when the number of pairs is known.
    n_jobs : int, optional
        Slices at a time.

    Raises
    ------
    InputError
        If the request makes no sense or cannot fit.
    Cancelled
        If `cancel` said so; what has converged stays in the store.
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
        if known is not None and count is not None:  # by another process, meanwhile
            return _leading(known, count)
        known = keeper.go_on_from(known)
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


def _leading(stored: StoredSpectrum, count: int) -> Eigenpairs:
    return Eigenpairs(stored.decomposition(count), stored.checked_rows)


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
        raise Cancelled  # maybe before all was looked at
    return damaged


def _most(
    stores: list[EigenpairStore], count: int | None, cancel: CancelCallback | None
) -> StoredSpectrum | None:
    """What the store with most pairs holds; the first `count` of them, None for all, checked."""
    found = [stored for store in stores if (stored := store.load()) is not None]
    if not found:
        return None
    stored = max(found, key=lambda each: int(np.isfinite(each.eigenvalues).sum()))
    return stored.without(_damaged(stored, count, cancel))


def damage_remark(faults: Sequence[str]) -> str:
    """Say what of a store is damaged, if anything; see `StoredSpectrum.faults`."""
    if not faults:
        return ""
    return (
        f"Damaged on the disk, of what is stored of this mesh: {', '.join(faults)}."
        " Only that is computed again."
    )


class _Keeper:
    """Where the pairs of a run go: into the first store that can take them, or into memory.

    Parameters
    ----------
    stores : list of EigenpairStore
        Tried one after the other, now and whenever one fails.
    in_file : bool
        Whether memory is of no use, because another process is to read the pairs.
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

    def go_on_from(self, known: StoredSpectrum | None) -> StoredSpectrum | None:
        """Keep these pairs as they are; those that there are."""
        self._known = known if known is not None and known.batches else None
        if known is not None and known.faults:
            self.remarks.append(damage_remark(known.faults))
        return self._known

    def laplacian(self, mesh: Mesh, operator: OperatorOptions) -> tuple[SparseMatrix, SparseMatrix]:
        """L and M, as they were kept or built."""
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
        """Room for k rows, of which those of the indices `kept` are there."""
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
        """Keep pairs whose rows have become final."""
        stop = start + len(eigenvalues)
        self.eigenvalues[start:stop], self.residuals[start:stop] = eigenvalues, residuals
        self._publish(start, stop)

    def _publish(self, start: int, stop: int) -> None:
        """Publish pairs in the store, or all up to them in the next that can take them."""
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
        """Lock the next store that can be, and has room; say why the one before can't be used."""
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

    def finish(self, decomposition: Decomposition, max_eigenvalue: float | None) -> Eigenpairs:
        """All pairs with their proof, where they are."""
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
        return Eigenpairs(decomposition, self.stored, " ".join(self.remarks))
