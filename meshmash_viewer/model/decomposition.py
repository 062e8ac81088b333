"""The decomposition of a mesh into its store: refused if it cannot fit, resumed if cut off."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.eigensolver import Decomposition, estimate_memory, solve
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.store import EigenpairStore, StoreBusy
from meshmash_viewer.io.stored_spectrum import ROWS
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.alignment import Alignment
from meshmash_viewer.model.cost import written_bytes
from meshmash_viewer.model.jobs import Channel, SpectrumGrew
from meshmash_viewer.model.previews import StoredPreview, open_preview
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.weyl import Target

__all__ = ["decompose", "find_known", "open_store", "refuse_what_cannot_fit"]

#: Seconds between two messages that the spectrum has grown; the first comes at once.
_GROWTH_SECONDS = 0.3
#: Share of the free memory that a run may take.
_SHARE = 0.9


def find_known(mesh: Mesh, operator: OperatorOptions) -> tuple[SpectrumGrew | None, str]:
    """Look for eigenpairs in the store, without computing any.

    Returns
    -------
    known : SpectrumGrew or None
    remark : str
        A sentence for the message bar if what was there is damaged, else empty.
    """
    store = EigenpairStore.open_or_create(mesh, operator)
    stored = store.load()
    known = None
    if stored is not None:
        bound = stored.meta.get("max_eigenvalue") or 0.0
        known = _grown(store, operator, stored.decomposition(), known_to=float(bound))
    return known, store.notice


def open_store(mesh: Mesh, operator: OperatorOptions, channel: Channel) -> EigenpairStore:
    """The store with the eigenpairs of a mesh: in the user's cache, or in this session's folder."""
    store = EigenpairStore.open_or_create(mesh, operator)
    if not (store.folder / ROWS).exists():
        own = EigenpairStore.open_or_create(mesh, operator, root=channel.folder / "eigenpairs")
        if (own.folder / ROWS).exists():
            return own
    return store


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
        If they cannot fit into memory or on the disk, or another process computes the same.
    Cancelled
        If the person asked to stop; the pairs that had converged stay in the store.
    """
    store = open_store(mesh, operator, channel)
    stored = store.load()
    remark = store.notice
    if stored is not None and (count := stored.covers(target)) is not None:
        bound = target.max_eigenvalue or 0.0
        return _grown(store, operator, stored.decomposition(count), known_to=bound)
    store, unwritable = _locked(store, mesh, operator, channel)
    with store:
        channel.report(Progress("operator", message="Building the Laplacian"))
        stiffness, mass = cotangent_laplacian(
            mesh, robust=operator.robust, mollify_factor=operator.mollify_factor
        )
        n, nnz = mesh.n_vertices, int(stiffness.nnz)
        free = free_memory()
        if target.n_components is not None:
            refuse_what_cannot_fit(n, nnz, target.n_components, free, mesh.n_components)
        known = None if stored is None else stored.decomposition()
        if known is not None:
            channel.send(_grown(store, operator, known, ended=False))
        preview = open_preview(mesh, channel) if known is None else None
        if preview is not None:
            channel.send(preview.alone(operator))
        growth = _Growth(store, operator, channel, known, preview, remark or unwritable)
        growth.mass = mass.diagonal()

        def allocate(k: int, n: int) -> npt.NDArray[Any]:
            # a threshold's count is known only now
            refuse_what_cannot_fit(n, nnz, k, free, mesh.n_components)
            return growth.allocate(k, n)

        try:
            decomposition = solve(
                stiffness,
                mass,
                target.n_components,
                max_eigenvalue=target.max_eigenvalue,
                known=known,
                allocate=allocate,
                on_pairs=growth.append,
                progress=channel.report,
                cancel=channel.cancelled,
            )
        except Cancelled:
            growth.tell()
            raise
        store.finish(decomposition, target.max_eigenvalue)
        alignment = growth.align(decomposition.rows, decomposition.eigenvalues)
        bound = target.max_eigenvalue or 0.0
        return _grown(store, operator, decomposition, alignment=alignment, known_to=bound)


def free_memory() -> int:
    """Bytes of memory that a new computation can have."""
    import psutil

    return int(psutil.virtual_memory().available)


def refuse_what_cannot_fit(n: int, nnz: int, k: int, free: int, n_null: int = 1) -> None:
    """Raise an `InputError` if k pairs of n vertices take more than the free memory.

    Parameters
    ----------
    n, nnz, k : int
        Vertices, entries of L, pairs.
    free : int
        Bytes that are free.
    n_null : int
        Components of the mesh.
    """

    def need(count: int) -> int:
        # Where memory is short the slices are computed one after the other.
        return estimate_memory(n, nnz, count, 1, n_null=n_null)

    k = min(k, n)
    needed = need(k)
    if needed <= _SHARE * free:
        return
    fitting = _largest(lambda count: need(count) <= _SHARE * free, k)
    way_out = f"ask for at most {fitting}" if fitting else "simplify the mesh"
    raise InputError(
        f"{k} eigenpairs of {n} vertices take about {written_bytes(needed)} of memory, and "
        f"{written_bytes(free)} are free: {way_out}, or close other programs."
    )


def _largest(fits: Callable[[int], bool], bound: int) -> int:
    """The largest count from 0 to bound that fits, 0 if none does."""
    low, high = 0, bound
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(middle) else (low, middle - 1)
    return low


def _locked(
    store: EigenpairStore, mesh: Mesh, operator: OperatorOptions, channel: Channel
) -> tuple[EigenpairStore, str]:
    """A store that can be written, and what there is to say if it is not the user's cache."""
    try:
        store.lock()
    except StoreBusy:
        raise
    except InputError as fault:
        own = EigenpairStore.open_or_create(mesh, operator, root=channel.folder / "eigenpairs")
        own.lock()
        return own, f"{fault} These eigenpairs are kept until the window is closed."
    return store, ""


class _Growth:
    """Writes pairs to the store as they become final, and tells the window now and then."""

    def __init__(
        self,
        store: EigenpairStore,
        operator: OperatorOptions,
        channel: Channel,
        known: Decomposition | None,
        preview: StoredPreview | None,
        remark: str,
    ) -> None:
        self._store = store
        self._operator = operator
        self._channel = channel
        self._preview = preview
        self._alignment: Alignment | None = None
        self.mass = np.zeros(0)
        self._remark = remark
        self._time = -_GROWTH_SECONDS
        # A solve that goes on from known pairs reports these again; the window has them already.
        self._told = 0 if known is None else known.n_components
        self._converged = 0
        self._eigenvalues = np.zeros(0)
        self._residuals = np.zeros(0)
        self._rows: npt.NDArray[Any] = np.zeros((0, 0))

    def allocate(self, k: int, n: int) -> npt.NDArray[Any]:
        self._eigenvalues, self._residuals = np.zeros(k), np.zeros(k)
        self._rows = self._store.allocate(k, n)
        return self._rows

    def append(
        self, start: int, eigenvalues: npt.NDArray[np.float64], residuals: npt.NDArray[np.float64]
    ) -> None:
        self._converged = start + len(eigenvalues)
        self._eigenvalues[start : self._converged] = eigenvalues
        self._residuals[start : self._converged] = residuals
        self._store.append(start, eigenvalues, residuals)
        if time.monotonic() - self._time >= _GROWTH_SECONDS:
            self.tell()

    def tell(self) -> None:
        """Tell the window of all pairs that it does not know."""
        if self._converged <= self._told or not self._eigenvalues.any():
            return  # a null space alone is nothing to look at
        self._told, self._time = self._converged, time.monotonic()
        eigenvalues = self._eigenvalues[: self._told].copy()
        residuals = self._residuals[: self._told].copy()
        alignment = self.align(self._rows, eigenvalues)
        preview = self._preview
        if preview is not None and len(preview.eigenvalues) <= self._told:
            preview = None  # nothing of it is needed any more
        if preview is not None:
            eigenvalues, residuals = preview.before(eigenvalues, residuals)
        self._channel.send(
            SpectrumGrew(
                self._store.folder / ROWS,
                eigenvalues,
                residuals,
                total=len(self._eigenvalues),
                operator=self._operator,
                preview_path=None if preview is None else preview.path,
                n_exact=self._told,
                error=0.0 if preview is None else preview.error,
                alignment=alignment,
                remark=self._remark,
            )
        )
        self._remark = ""

    def align(
        self, rows: npt.NDArray[np.floating[Any]], eigenvalues: npt.NDArray[np.float64]
    ) -> Alignment | None:
        """Turn exact rows to what is shown, if a preview is."""
        if self._preview is not None:
            self._alignment = self._preview.align(rows, eigenvalues, self.mass, self._alignment)
        return self._alignment


def _grown(
    store: EigenpairStore,
    operator: OperatorOptions,
    decomposition: Decomposition,
    *,
    ended: bool = True,
    alignment: Alignment | None = None,
    known_to: float = 0.0,
) -> SpectrumGrew:
    return SpectrumGrew(
        store.folder / ROWS,
        np.array(decomposition.eigenvalues),
        np.array(decomposition.residuals),
        total=decomposition.n_components if ended else 0,
        certificate=decomposition.certificate if ended else None,
        operator=operator,
        alignment=alignment,
        known_to=known_to if ended and decomposition.complete else 0.0,
    )
