"""The eigenpairs of a mesh: found in the store, resumed where a run stopped, or computed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from meshmash_viewer.io.store import EigenpairStore, StoredSpectrum
from meshmash_viewer.progress import CancelCallback, Progress, ProgressCallback

if TYPE_CHECKING:
    from meshmash_viewer.eigensolver import Decomposition, PairsCallback
    from meshmash_viewer.laplacian import OperatorOptions
    from meshmash_viewer.mesh import Mesh
    from meshmash_viewer.weyl import Target

__all__ = ["FitCheck", "find_spectrum", "obtain_spectrum"]

#: ``(n, nnz, k)``: raises where k pairs of n vertices cannot be computed on this machine.
FitCheck: TypeAlias = Callable[[int, int, int], None]


def find_spectrum(store: EigenpairStore, target: Target) -> Decomposition | None:
    """Proven eigenpairs that answer a request, without computing any; None if there are none."""
    stored = store.load()
    return None if stored is None else _answer(stored, target)


def _answer(stored: StoredSpectrum, target: Target) -> Decomposition | None:
    count = stored.covers(target)
    return None if count is None else stored.decomposition(count)


def obtain_spectrum(
    mesh: Mesh,
    operator: OperatorOptions,
    target: Target,
    store: EigenpairStore | None = None,
    *,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
    on_pairs: PairsCallback | None = None,
    check: FitCheck | None = None,
    n_jobs: int | None = None,
) -> Decomposition:
    """Eigenpairs of a mesh, through its store if there is one.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    target : Target
        How many pairs, or up to where.
    store : EigenpairStore, optional
        Looked into first, and written to while computing; None keeps all in memory.
    progress, cancel : callable, optional
        As for `meshmash_viewer.eigensolver.solve`.
    on_pairs : callable, optional
        ``(start, eigenvalues, residuals)``, called after these pairs are in the store.
    check : callable, optional
        Asked before the computation begins, and again when the number of pairs is known.
    n_jobs : int, optional
        Processes for the solver.

    Returns
    -------
    Decomposition
        Its rows map the store read-only where there is one.

    Raises
    ------
    StoreBusy
        If another process is computing into the same store.
    InputError
        If the request makes no sense or cannot fit.
    Cancelled
        If `cancel` said so; what has converged stays in the store.
    """
    stored = None if store is None else store.load()
    found = None if stored is None else _answer(stored, target)
    if found is not None:
        return found

    from meshmash_viewer.eigensolver import solve
    from meshmash_viewer.laplacian import cotangent_laplacian

    if store is not None:
        store.lock()
    try:
        if progress is not None:
            progress(Progress("operator", message="Building the Laplacian"))
        stiffness, mass = cotangent_laplacian(
            mesh, robust=operator.robust, mollify_factor=operator.mollify_factor
        )

        def fits(k: int) -> None:
            if check is not None:
                check(mesh.n_vertices, int(stiffness.nnz), k)

        def allocate(k: int, n: int) -> Any:
            fits(k)
            return np.empty((k, n)) if store is None else store.allocate(k, n)

        def publish(start: int, eigenvalues: Any, residuals: Any) -> None:
            if store is not None:
                store.append(start, eigenvalues, residuals)
            if on_pairs is not None:
                on_pairs(start, eigenvalues, residuals)

        if target.n_components is not None:
            fits(min(target.n_components, mesh.n_vertices))
        decomposition = solve(
            stiffness,
            mass,
            target.n_components,
            max_eigenvalue=target.max_eigenvalue,
            known=None if stored is None else stored.decomposition(),
            allocate=allocate,
            on_pairs=publish,
            progress=progress,
            cancel=cancel,
            n_jobs=n_jobs,
        )
        if store is not None:
            store.finish(decomposition, target.max_eigenvalue)
    finally:
        if store is not None:
            store.close()
    return decomposition
