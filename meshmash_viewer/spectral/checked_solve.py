"""Eigenpairs for the documented functions: arguments, precision, progress bar and memory."""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.errors import InputError, UnprovenWarning, of_mesh
from meshmash_viewer.laplacian import SparseMatrix
from meshmash_viewer.progress import ProgressBar, ProgressCallback
from meshmash_viewer.spectral.engine.request import Allocate
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import whole_number

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigensolver import Decomposition

Array: TypeAlias = npt.NDArray[np.floating[Any]]

#: The documented default of the descriptors' `max_eigenvalue`.
DEFAULT_MAX_EIGENVALUE = 1e-8
#: Share of the free memory that eigenvectors may take before they go to a temporary file.
_MEMORY_SHARE = 0.25


def solve_and_warn(
    stiffness: SparseMatrix,
    mass: SparseMatrix,
    *,
    dtype: npt.DTypeLike | None = None,
    verbose: int = False,
    unit: str = "",
    name: str = "",
    mask: str = "",
    stacklevel: int = 3,
    progress: ProgressCallback | None = None,
    **options: Any,
) -> Decomposition:
    """Call `meshmash_viewer.spectral.eigensolver.solve` with a progress bar and a warning.

    The null space of a float32 Laplacian, which rounding destroys, is restored first. `dtype` is
    that of the eigenvectors, None that of `stiffness`; `verbose` draws a progress bar on stderr and
    prints the certificate in the mesh's `unit` at the end; `name` is the mesh's in a
    warning, `mask` the part of it that is solved (see `Eigenpairs.on_mask`), and `stacklevel` that
    of the warning; `progress` receives every report.

    `UnprovenWarning` is issued if the certificate is not complete.
    """
    from tqdm import tqdm

    from meshmash_viewer.spectral.eigensolver import solve

    single = getattr(stiffness, "dtype", None) == np.float32
    if single:
        stiffness = _with_exact_null_space(stiffness)
    if dtype is None:
        dtype = np.float32 if single else np.float64
    with ProgressBar("eigenpairs", progress) if verbose else nullcontext(progress) as reports:
        result = solve(stiffness, mass, dtype=dtype, progress=reports, **options).on_mask(mask)
    if verbose:
        tqdm.write(result.proof(unit), file=sys.stderr)
    if not result.complete:
        text = f"{of_mesh(name)}{result.proof(unit)}"
        warnings.warn(text, UnprovenWarning, stacklevel=stacklevel)
    return result


def _with_exact_null_space(stiffness: SparseMatrix) -> SparseMatrix:
    """Restore the zero row sums of a Laplacian that was rounded to float32.

    Constants are its null space; with an error of 1e-7 of the largest eigenvalue they would mix
    with the lowest eigenfunctions. Rows that do not sum to zero even in float32 are unchanged.
    """
    exact = sparse.csr_array(stiffness).astype(np.float64)
    excess = np.asarray(exact.sum(axis=1)).ravel()
    size = np.asarray(abs(exact).sum(axis=1)).ravel()
    rounding = np.abs(excess) <= 64.0 * np.finfo(np.float32).eps * size
    return sparse.csc_array(exact - sparse.diags_array(np.where(rounding, excess, 0.0)))


def check_bands(max_eigenvalue: float, band_size: int) -> None:
    """Raise `InputError` for a negative threshold or an empty band."""
    if not max_eigenvalue >= 0.0:
        raise InputError(
            f"max_eigenvalue is {max_eigenvalue}: no eigenvalue of a Laplacian is negative, "
            "give a positive number."
        )
    whole_number(band_size, "band_size")


def chosen_extent(
    max_eigenvalue: float, count: int | str | None, wavelength: float | None
) -> tuple[int | None, float | None]:
    """Return the number of pairs and the threshold, one of which is None.

    `InputError` is raised if more than one of the three is given, or a value is out of range.
    """
    refuse_two_extents(max_eigenvalue, count, wavelength)
    if count is not None:
        if isinstance(count, str):
            raise InputError(f'count is {count!r}: give a whole number from 1, or "auto".')
        return whole_number(count, "count"), None
    if wavelength is not None:
        return None, Target("wavelength", wavelength).max_eigenvalue
    return None, max_eigenvalue


def refuse_two_extents(
    max_eigenvalue: float, count: int | str | None, wavelength: float | None
) -> None:
    """Raise `InputError` if more than one of the three limits of a spectrum is given."""
    given = {
        "max_eigenvalue": max_eigenvalue != DEFAULT_MAX_EIGENVALUE,
        "count": count is not None,
        "wavelength": wavelength is not None,
    }
    names = [name for name, is_given in given.items() if is_given]
    if len(names) > 1:
        raise InputError(f"{' and '.join(names)} are given: give only one of them.")


@contextmanager
def scratch_rows(dtype: np.dtype[Any]) -> Iterator[Allocate]:
    """Provide an allocator of rows, shape (k, n), in memory if they fit, else in a temporary file.

    The rows are deleted when the context is left.
    """
    with ExitStack() as files:

        def allocate(k: int, n: int, n_kept: int) -> Array:
            import psutil

            size = k * n * dtype.itemsize
            if size <= _MEMORY_SHARE * psutil.virtual_memory().available:
                return np.empty((k, n), dtype=dtype)
            file = files.enter_context(tempfile.TemporaryFile(prefix="meshmash-viewer-"))
            return np.memmap(file, dtype=dtype, mode="w+", shape=(k, n))

        yield allocate
