"""Eigenpairs of a mesh: read from a store, resumed from a partial run, or computed.

The window and the command line use the same function. If the cache cannot be written, computed
pairs go to a second store or into memory, and a remark for the user is returned.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.truncation import asked_target
from meshmash_viewer.io.cache import EigenpairCache
from meshmash_viewer.io.store import EigenpairStore, StoreUnusable
from meshmash_viewer.progress import Progress
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.engine.request import Request

if TYPE_CHECKING:
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.progress import CancelCallback, ProgressCallback
    from meshmash_viewer.spectral.weyl import Target


def find_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    target: Target,
    spare: Path | None = None,
    *,
    count: int | None = None,
    cancel: CancelCallback | None = None,
) -> tuple[Eigenpairs | None, str]:
    """Return the stored eigenpairs of a request, without computing any, and a remark on damage.

    Returned are the leading pairs, at most `count`, before a batch with a row that does not agree
    with its checksum; None if there are none. `spare` is a second cache folder, used if it has more
    pairs than the user's. For `cancel`, see `EigenpairStore.load`. The remark is a sentence for the
    user, or "".
    """
    stores = _stores(mesh, operator, target, spare)
    found, damage, _ = _longest(stores, count, cancel)
    return None if found is None else _with_stored(_estimated(mesh, found), stores), damage


def last_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    target: Target | None,
    cancel: CancelCallback | None = None,
) -> tuple[Eigenpairs | None, str]:
    """Return what `find_eigenpairs` finds for a target or, if nothing, for the last one used."""
    for each in [*filter(None, [target]), *EigenpairStore.targets(mesh, operator)]:
        pairs, remark = find_eigenpairs(mesh, operator, each, cancel=cancel)
        if pairs is not None or remark:
            return pairs, remark
    return None, ""


def obtain_eigenpairs(
    mesh: Mesh,
    operator: OperatorOptions,
    request: Request,
    *,
    use_cache: bool = True,
    spare: Path | None = None,
) -> tuple[Eigenpairs, str]:
    """Return the eigenpairs of a mesh, and a remark on the store.

    The result depends on mesh, operator, and part of the spectrum alone. Missing pairs are computed
    and stored. At the start of a computation, `on_pairs` of the request
    is called with the stored pairs, which may be none. Rows in a file are mapped read-only.
    `use_cache` is whether the user's cache is used. `spare` is the cache folder to use if the
    user's cannot be written; without it, pairs are then in memory. The remark is a sentence for the
    user, or "".

    `InputError` is raised if the request is invalid or the pairs do not fit into memory, and
    `Cancelled` after `cancel` returned True; converged pairs stay in the store.
    """
    stores = _stores(mesh, operator, request.asked, spare) if use_cache else []
    if found := _answer(stores, request.cancel):
        return _estimated(mesh, found), ""

    keeper = _Keeper(stores, in_file=spare is not None)
    try:
        # another process may have computed the pairs before the lock was acquired
        pairs = _answer(stores, request.cancel) or keeper.run(mesh, operator, request)
        return _estimated(mesh, pairs), " ".join(keeper.remarks)
    finally:
        for store in stores:
            store.close()


def measure_errors(
    mesh: Mesh,
    pairs: Eigenpairs,
    *,
    use_cache: bool = True,
    spare: Path | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Eigenpairs:
    """Return pairs with errors measured on a finer mesh, and store these errors.

    On a large mesh, only those of the first `affordable_pairs` are measured. For `use_cache` and
    `spare` see `obtain_eigenpairs`, for exceptions `resolution_error`.
    """
    from meshmash_viewer.spectral.resolution import affordable_pairs, resolution_error

    count = affordable_pairs(mesh.n_vertices, pairs.eigenvalues)
    stores = _stores_of(mesh, pairs, spare) if use_cache else []
    for store in stores:
        # errors of fewer or more pairs may come from another number of divisions
        if len(known := store.measured_errors()) == count:
            return pairs.with_measured(known)
    errors = resolution_error(mesh, pairs.first(count), progress=progress, cancel=cancel)
    for store in stores:
        store.keep_errors(errors)
    return pairs.with_measured(errors)


def with_stored_errors(mesh: Mesh, pairs: Eigenpairs, spare: Path | None = None) -> Eigenpairs:
    """Return pairs with the errors that `measure_errors` has stored, if any."""
    return _with_stored(pairs, _stores_of(mesh, pairs, spare))


def _with_stored(pairs: Eigenpairs, stores: list[EigenpairStore]) -> Eigenpairs:
    longest = max((each.measured_errors() for each in stores), key=len)
    return pairs.with_measured(longest[: len(pairs.eigenvalues)])


def _stores_of(mesh: Mesh, pairs: Eigenpairs, spare: Path | None) -> list[EigenpairStore]:
    assert pairs.operator is not None
    assert pairs.target is not None
    return _stores(mesh, pairs.operator, pairs.target, spare)


def _estimated(mesh: Mesh, pairs: Eigenpairs) -> Eigenpairs:
    """Return pairs with estimated errors due to the mesh."""
    from meshmash_viewer.spectral.resolution import quick_error  # imports scipy

    return replace(pairs, mesh_errors=quick_error(mesh, pairs))


def stored_answer(mesh: Mesh, operator: OperatorOptions, request: Request) -> Eigenpairs | None:
    """Return the stored eigenpairs that answer a request; None if some are missing or damaged."""
    found = _answer(_stores(mesh, operator, request.asked, None), request.cancel)
    return None if found is None else _estimated(mesh, found)


def _stores(
    mesh: Mesh, operator: OperatorOptions, target: Target, spare: Path | None
) -> list[EigenpairStore]:
    store = EigenpairStore(mesh, operator, target)
    _tidy_once(store.folder.parent)
    if spare is None:
        return [store]
    return [store, EigenpairStore(mesh, operator, target, root=spare)]


@cache
def _tidy_once(root: Path) -> None:
    EigenpairCache(root).tidy()


def _answer(stores: list[EigenpairStore], cancel: CancelCallback | None) -> Eigenpairs | None:
    """Return stored pairs that answer a request; None if some are missing or damaged."""
    for store in stores:
        if store.is_complete:
            found = store.load(cancel=cancel)
            if found is not None and found.certificate.method != "none":
                return found
    return None


def _longest(
    stores: list[EigenpairStore], count: int | None, cancel: CancelCallback | None
) -> tuple[Eigenpairs | None, str, EigenpairStore | None]:
    """Return the pairs of the store with the most pairs, a remark on damage, and the store."""
    longest, source = None, None
    for store in stores:
        found = store.load(count, cancel)
        if found is not None and (longest is None or len(found) > len(longest)):
            longest, source = found, store
    damage = ", ".join(store.damage for store in stores if store.damage)
    if damage:
        damage = f"Damaged on the disk, in the stored spectrum of this mesh: {damage}."
        damage += " Computing these pairs again keeps the others."
    return longest, damage, source


class _Keeper:
    """Output of a run, to the first usable store or to memory.

    Stores are tried in their order, also when the current store fails. With `in_file`, memory is
    not used and an exception is raised instead, for pairs that another process must read.
    """

    def __init__(self, stores: list[EigenpairStore], in_file: bool) -> None:
        #: Sentences for the user on unusable or damaged stores.
        self.remarks: list[str] = []
        self._stores, self._left = stores, list(stores)
        self._in_file = in_file
        self._store: EigenpairStore | None = None
        self._take_next()

    def run(self, mesh: Mesh, operator: OperatorOptions, request: Request) -> Eigenpairs:
        """Compute the missing pairs, and return all pairs of the request."""
        from meshmash_viewer.laplacian import cotangent_laplacian
        from meshmash_viewer.spectral.cost import check_memory, free_memory
        from meshmash_viewer.spectral.eigensolver import Run

        n_vertices = mesh.n_vertices - len(mesh.unreferenced)
        target = asked_target(request.asked, mesh.area, n_vertices)
        free = free_memory()
        known, damage, source = _longest(self._stores, None, request.cancel)
        if damage:
            self.remarks.append(damage)
        if request.progress is not None:
            request.progress(Progress("operator", message="Building the Laplacian"))
        stiffness, mass = cotangent_laplacian(
            mesh, robust=operator.robust, mollify_factor=operator.mollify_factor
        )

        def fits(k: int) -> None:
            check_memory(mesh.n_vertices, int(stiffness.nnz), k, free, mesh.n_components)

        def allocate(k: int, n: int, n_kept: int) -> FloatArray:
            fits(k)
            rows, store = self._allocate(k, n, n_kept, source)
            if known is not None and store is not source:
                rows[:n_kept] = known.rows[:n_kept]
            return rows

        def publish(pairs: Eigenpairs) -> None:
            self._append(pairs)
            follow(self._mapped(pairs))

        def follow(pairs: Eigenpairs) -> None:
            if request.on_pairs is not None:
                request.on_pairs(replace(pairs, target=target, operator=operator))

        if request.n_components is not None:
            fits(request.n_components)
        first = known or Eigenpairs(np.zeros(0), np.zeros((0, mesh.n_vertices)), np.zeros(0))
        follow(Eigenpairs(first.eigenvalues, first.rows, first.residuals, mass=mass.diagonal()))
        # with the same slices for all callers
        solve = replace(request, known=known, early=True, allocate=allocate, on_pairs=publish)
        pairs = Run(stiffness, mass, solve).pairs()
        self._append(pairs)
        return replace(self._mapped(pairs), target=target, operator=operator)

    def _allocate(
        self, k: int, n: int, n_kept: int, source: EigenpairStore | None
    ) -> tuple[FloatArray, EigenpairStore | None]:
        """Allocate k rows in a store, or in memory; `source` keeps its first `n_kept` rows."""
        while (store := self._store) is not None:
            try:
                return store.allocate(k, n, n_kept if store is source else 0), store
            except StoreUnusable as fault:
                self._pass_over(fault)
        return np.empty((k, n)), None

    def _append(self, pairs: Eigenpairs) -> None:
        """Publish pairs in the store; if it fails, in the next store."""
        while self._store is not None:
            try:
                self._store.append(pairs)
                return
            except StoreUnusable as fault:
                self._pass_over(fault)

    def _mapped(self, pairs: Eigenpairs) -> Eigenpairs:
        """Return pairs with rows mapped read-only if they are in a file."""
        if self._store is None:
            return pairs
        return replace(pairs, rows=self._store.map(len(pairs)))

    def _take_next(self) -> None:
        """Lock the next usable store, if any."""
        self._store = self._left.pop(0) if self._left else None
        if self._store is not None:
            try:
                self._store.lock()
            except StoreUnusable as fault:
                self._pass_over(fault)

    def _pass_over(self, fault: StoreUnusable) -> None:
        """Add a remark on the unusable store, and take the next one."""
        if self._in_file and not self._left:
            raise fault
        what = "until the window is closed" if self._left else "only in memory"
        self.remarks.append(f"{fault} The eigenpairs are kept {what}.")
        self._take_next()
