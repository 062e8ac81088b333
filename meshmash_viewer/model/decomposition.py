"""The decomposition of a mesh into its store: refused if it cannot fit, resumed where it stopped."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.eigensolver import Decomposition, estimate_memory, solve
from meshmash_viewer.errors import InputError

try:
    from meshmash_viewer.io.store import EigenpairStore
except ImportError:
    from meshmash_viewer.model.interim_store import EigenpairStore
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.jobs import Channel, SpectrumGrew
from meshmash_viewer.progress import Progress
from meshmash_viewer.weyl import Target

__all__ = ["decompose", "find_known", "refuse_what_cannot_fit"]

#: Seconds between two messages that the spectrum has grown; the first comes at once.
_GROWTH_SECONDS = 0.3
#: Share of the free memory or disk that a run may take.
_SHARE = 0.9


def find_known(mesh: Mesh, operator: OperatorOptions) -> SpectrumGrew | None:
    """Look for eigenpairs in the store, without computing any."""
    store = EigenpairStore.open_or_create(mesh, operator)
    stored = store.load()
    if stored is None or not len(stored.eigenvalues):
        return None
    return _grown(store, operator, stored.eigenvalues, stored.residuals, stored)


def decompose(
    mesh: Mesh, operator: OperatorOptions, target: Target, channel: Channel
) -> SpectrumGrew:
    """Compute eigenpairs into the store of a mesh, or take what is there.

    Parameters
    ----------
    mesh : Mesh
    operator : OperatorOptions
    target : Target
    channel : Channel
        Gets a `SpectrumGrew` whenever pairs have become final.

    Returns
    -------
    SpectrumGrew
        All that were asked for, with their proof.

    Raises
    ------
    InputError
        If they cannot fit into memory or on the disk.
    Cancelled
        If the person asked to stop; the pairs that had converged stay in the store.
    """
    store = EigenpairStore.open_or_create(mesh, operator)
    stored = store.load()
    if stored is not None and stored.complete and _suffices(stored.eigenvalues, target, mesh):
        count = _asked(stored.eigenvalues, target)
        return _grown(store, operator, stored.eigenvalues[:count], stored.residuals[:count], stored)
    channel.report(Progress("operator", message="Building the Laplacian"))
    stiffness, mass = cotangent_laplacian(
        mesh, robust=operator.robust, mollify_factor=operator.mollify_factor
    )
    nnz = int(stiffness.nnz)
    if target.n_components is not None:
        refuse_what_cannot_fit(mesh.n_vertices, nnz, target.n_components, store.folder)
    growth = _Growth(store, operator, channel)

    def allocate(k: int, n: int) -> npt.NDArray[Any]:
        refuse_what_cannot_fit(n, nnz, k, store.folder)
        return growth.allocate(k, n)

    decomposition = solve(
        stiffness,
        mass,
        target.n_components,
        max_eigenvalue=target.max_eigenvalue,
        known=_as_decomposition(stored) if stored is not None else None,
        allocate=allocate,
        on_pairs=growth.append,
        progress=channel.report,
        cancel=channel.cancelled,
    )
    store.finish(decomposition)
    return SpectrumGrew(
        store.folder / "eigenvectors.npy",
        decomposition.eigenvalues,
        decomposition.residuals,
        total=decomposition.n_components,
        complete=True,
        proof=decomposition.proof(),
        operator=operator,
    )


def refuse_what_cannot_fit(n: int, nnz: int, k: int, folder: Path) -> None:
    """Raise an `InputError` if k pairs of n vertices exceed the free memory or disk.

    Parameters
    ----------
    n, nnz, k : int
        Vertices, entries of L, pairs.
    folder : Path
        On the disk that the pairs go to.
    """
    import psutil

    k = min(k, n)
    limits = (
        (
            "memory",
            _SHARE * psutil.virtual_memory().available,
            lambda k: estimate_memory(n, nnz, k),
        ),
        ("disk", _SHARE * shutil.disk_usage(folder).free, lambda k: 8 * n * k),
    )
    for name, free, needed in limits:
        if needed(k) <= free:
            continue
        fitting = _largest(lambda count: needed(count) <= free, k)
        way_out = f"ask for at most {fitting} pairs" if fitting else "simplify the mesh or split it"
        raise InputError(
            f"{k} eigenpairs of {n} vertices take about {written_bytes(needed(k))} of {name} and "
            f"{written_bytes(free / _SHARE)} are free: {way_out}, or make room."
        )


def _largest(fits: Any, bound: int) -> int:
    """The largest count from 0 to bound that fits."""
    low, high = 0, bound
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(middle) else (low, middle - 1)
    return low


class _Growth:
    """Writes pairs to the store as they become final, and tells the window now and then."""

    def __init__(self, store: EigenpairStore, operator: OperatorOptions, channel: Channel) -> None:
        self._store = store
        self._operator = operator
        self._channel = channel
        self._told = -_GROWTH_SECONDS
        self._eigenvalues = np.zeros(0)
        self._residuals = np.zeros(0)

    def allocate(self, k: int, n: int) -> npt.NDArray[Any]:
        self._eigenvalues, self._residuals = np.zeros(k), np.zeros(k)
        return self._store.allocate(k, n)

    def append(
        self, start: int, eigenvalues: npt.NDArray[np.float64], residuals: npt.NDArray[np.float64]
    ) -> None:
        stop = start + len(eigenvalues)
        self._eigenvalues[start:stop] = eigenvalues
        self._residuals[start:stop] = residuals
        self._store.append(start, eigenvalues, residuals)
        now = time.monotonic()
        if now - self._told < _GROWTH_SECONDS:
            return
        self._told = now
        self._channel.send(
            SpectrumGrew(
                self._store.folder / "eigenvectors.npy",
                self._eigenvalues[:stop].copy(),
                self._residuals[:stop].copy(),
                total=len(self._eigenvalues),
                operator=self._operator,
            )
        )


def _suffices(eigenvalues: npt.NDArray[np.float64], target: Target, mesh: Mesh) -> bool:
    if target.n_components is not None:
        return len(eigenvalues) >= min(target.n_components, int(mesh.referenced.sum()))
    assert target.max_eigenvalue is not None
    # the pair above the threshold shows that none below it is missing
    return len(eigenvalues) > 0 and bool(eigenvalues[-1] > target.max_eigenvalue)


def _asked(eigenvalues: npt.NDArray[np.float64], target: Target) -> int:
    if target.n_components is not None:
        return min(target.n_components, len(eigenvalues))
    return int(np.searchsorted(eigenvalues, target.max_eigenvalue, side="right"))


def _grown(
    store: EigenpairStore,
    operator: OperatorOptions,
    eigenvalues: npt.NDArray[np.float64],
    residuals: npt.NDArray[np.float64],
    stored: Any,
) -> SpectrumGrew:
    return SpectrumGrew(
        store.folder / "eigenvectors.npy",
        np.array(eigenvalues),
        np.array(residuals),
        total=len(eigenvalues),
        complete=stored.complete,
        proof=stored.proof,
        operator=operator,
    )


def _as_decomposition(stored: Any) -> Decomposition:
    return Decomposition(
        eigenvalues=stored.eigenvalues,
        rows=stored.rows[: len(stored.eigenvalues)],
        residuals=stored.residuals,
        orthonormality=float("nan"),
        complete=stored.complete,
        certificate="",
        mass=stored.mass,
    )
