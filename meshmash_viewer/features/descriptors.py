"""Descriptors of the vertices of a mesh, computed from its eigenpairs in one call.

Descriptors have the unit of φ²: one over the squared unit of the mesh. The functions can also be
imported from `meshmash_viewer.decompose`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import sparse

from meshmash_viewer.errors import ConstantFeaturesWarning, InputError, TruncationWarning, of_mesh
from meshmash_viewer.features.filter_responses import (
    MOST_FILTERS,
    check_times,
    checked_coefficients,
)
from meshmash_viewer.features.filters import (
    FilterBank,
    HeatKernelFilter,
    bspline_bank,
    get_hks_filter,
)
from meshmash_viewer.features.sums import accumulate_features, truncated_features
from meshmash_viewer.features.truncation import (
    check_tail,
    sufficient_target,
    warn_of_open_end,
    warn_of_truncation,
)
from meshmash_viewer.laplacian import OperatorOptions, SparseMatrix, cotangent_laplacian
from meshmash_viewer.mesh import Mesh, as_mesh, mask_text, masked
from meshmash_viewer.progress import CancelCallback, ProgressCallback
from meshmash_viewer.spectral.cost import check_columns
from meshmash_viewer.spectral.eigensolver import (
    DEFAULT_MAX_EIGENVALUE,
    check_bands,
    chosen_extent,
    refuse_two_extents,
    scratch_rows,
    solve_and_warn,
)
from meshmash_viewer.spectral.weyl import Target, required_eigenvalue, weyl_eigenvalue
from meshmash_viewer.split.partition import Piece
from meshmash_viewer.units import whole_number

if TYPE_CHECKING:
    from meshmash_viewer.spectral.eigenpairs import Eigenpairs
    from meshmash_viewer.spectral.engine.request import Allocate

Array: TypeAlias = npt.NDArray[np.floating[Any]]
#: A mesh in any accepted form, or its matrices ``(L, M)``.
MeshOrMatrices: TypeAlias = Any
Filter: TypeAlias = Callable[[npt.NDArray[np.float64]], npt.ArrayLike]
#: Function that returns a filter for the eigenvalues used.
FilterMaker: TypeAlias = Callable[[npt.NDArray[np.float64]], FilterBank | Filter]

#: Largest residual relative to λ for float64; it is larger for float32.
_TOLERANCE = 1e-12
#: Number of eigenpairs suggested in a warning.
_USEFUL_COUNT = 100


def spectral_geometry_filter(
    mesh: MeshOrMatrices,
    filter: Filter | None = None,
    max_eigenvalue: float = 1e-8,
    band_size: int = 50,
    truncate_extra: bool = True,
    drop_first: bool = True,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    verbose: int = False,
    *,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Any:
    """Compute ``F[v, f] = Σ_k filter(λ)[f, k] φ_k(v)²`` over all eigenpairs up to a threshold.

    `InputError` is raised if the threshold is negative, or the filter returns a wrong shape or
    values that are not finite.

    Parameters
    ----------
    mesh : MeshLike or pair of sparse matrices
        A mesh of n vertices, or its matrices (L, M), shape (n, n).
    filter : callable, optional
        Called once with all eigenvalues, a 1-D array of shape (k,); returns coefficients of
        shape (n_filters, k). None: return the eigenpairs.
    max_eigenvalue, band_size, truncate_extra
        See `decompose_laplacian_by_bands`.
    drop_first : bool
        Leave out only the first pair, even if several eigenvalues are zero. On a piece of a
        `MeshStitcher`, the first pair of the whole mesh is left out.
    decomposition_dtype : dtype
        Type of the eigenvectors and of the result. float64, or None: residuals are at most 1e-12,
        or as small as rounding allows. float32: residuals are at most 1e-7, and eigenvectors take
        half the memory.
    robust, mollify_factor
        See `meshmash_viewer.laplacian.cotangent_laplacian`.
    verbose : int
        1 draws a progress bar on stderr.
    mask : array_like of bool, shape (n,), optional
        Vertices to compute on; the result is NaN elsewhere. See `Mesh.masked`.
    progress, cancel : callable, optional
        See `meshmash_viewer.progress`.

    Returns
    -------
    ndarray, shape (n, n_filters)
        NaN at unreferenced vertices. With ``filter=None``: a tuple of eigenvalues, shape (k,),
        and eigenvectors, shape (n, k).

    Warns
    -----
    ConstantFeaturesWarning
        If only zero eigenvalues lie below the threshold, for example because it was chosen for
        another unit. The features are then correct, but constant on each component.
    TruncationWarning
        For a filter of this package: if the truncation error of a column exceeds 1 %, by the
        estimate of `meshmash_viewer.features.truncation`. For another function: if its value at the
        last eigenvalue exceeds 1 % of its largest. There is no warning if all eigenpairs of the
        mesh are used. Warnings begin with the name of the mesh, if it has one.

    Notes
    -----
    Eigenvectors that would take a large part of the free memory are written to a temporary file
    (in ``TMPDIR``), and read once, a few rows at a time.

    Examples
    --------
    >>> low = mv.spectral_geometry_filter(ball, mv.low_pass_bank(7.0), max_eigenvalue=10.0)
    >>> low.shape
    (642, 1)
    """
    check_bands(max_eigenvalue, band_size)
    computation = _Computation(
        masked(mesh, mask), decomposition_dtype, drop_first, robust, mollify_factor, verbose,
        progress, cancel, mask is not None,
    )  # fmt: skip
    if filter is None:
        result = computation.solve(None, max_eigenvalue, None, stacklevel=4)
        start = int(drop_first)
        return result.eigenvalues[start:], result.eigenvectors[:, start:]
    return computation.features(None, max_eigenvalue, lambda _: filter)


def compute_hks(
    mesh: MeshOrMatrices,
    max_eigenvalue: float = 1e-8,
    t_max: float | None = None,
    t_min: float | None = None,
    n_components: int = 32,
    band_size: int = 50,
    truncate_extra: bool = False,
    drop_first: bool = False,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    verbose: int = False,
    *,
    count: int | Literal["auto"] | None = None,
    wavelength: float | None = None,
    tail: Literal["weyl"] | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Array:
    """Compute the heat kernel signature, ``Σ_k exp(-λ_k t) φ_k(v)²``, at a range of times.

    See `spectral_geometry_filter` for other parameters, and `heat_kernel_bank`.

    `InputError` is raised if an argument is invalid.

    Parameters
    ----------
    max_eigenvalue : float
        Largest eigenvalue to use. Times below ``5 / max_eigenvalue`` require a larger one.
    t_max, t_min : float, optional
        Longest and shortest time, in squared unit of the mesh; None: chosen from the spectrum by
        `meshmash_viewer.features.filter_responses.hks_time_range`.
    n_components : int
        Number of times, evenly spaced in log t.
    count : int or "auto", optional
        Number of eigenpairs, in place of `max_eigenvalue`; at most the number of vertices. "auto"
        requires `t_min`, and uses enough pairs that the estimated truncation error of every column
        is below 1 %, but none that the mesh does not resolve to 5 %.
    wavelength : float, optional
        Shortest wavelength ``2π / √λ`` to use, in unit of the mesh, in place of `max_eigenvalue`.
    tail : {None, "weyl"}
        "weyl" adds the estimated truncation error, see `meshmash_viewer.features.truncation`.

    Returns
    -------
    ndarray, shape (n, n_components)
        Columns from short to long times; one over squared unit.

    Warns
    -----
    TruncationWarning
        If the estimated truncation error of a column exceeds 1 %, or if "auto" used all pairs that
        the mesh resolves, or has, and they are not sufficient.

    Examples
    --------
    >>> hks = mv.compute_hks(ball, 40.0, t_min=0.5, t_max=50.0, n_components=3)
    >>> hks[0].round(2)
    array([0.19, 0.08, 0.08])
    >>> round(1 / float(ball.area), 2)
    0.08
    """
    n_scales = whole_number(n_components, "n_components", MOST_FILTERS)
    check_times(t_min, t_max)
    check_tail(tail, "hks")
    check_bands(max_eigenvalue, band_size)
    computation = _Computation(
        masked(mesh, mask), decomposition_dtype, drop_first, robust, mollify_factor, verbose,
        progress, cancel, mask is not None,
    )  # fmt: skip
    check_columns(computation.matrices[0].shape[0], n_scales)

    def bank(_: npt.NDArray[np.float64]) -> Filter:
        return get_hks_filter(t_max, t_min, n_scales)

    if count == "auto":
        if t_min is None:
            fault = 'count="auto" takes as many eigenpairs as the shortest time needs'
            raise InputError("missing-argument", fault, "give t_min")
        refuse_two_extents(max_eigenvalue, count, wavelength)
        return computation.features(None, None, bank, tail, t_min)
    return computation.features(*chosen_extent(max_eigenvalue, count, wavelength), bank, tail)


def compute_geometry_vectors(
    mesh: MeshOrMatrices,
    max_eigenvalue: float = 1e-8,
    n_components: int = 32,
    band_size: int = 50,
    truncate_extra: bool = False,
    drop_first: bool = False,
    robust: bool = True,
    mollify_factor: float = 1e-5,
    decomposition_dtype: npt.DTypeLike | None = np.float64,
    verbose: int = False,
    *,
    count: int | Literal["auto"] | None = None,
    wavelength: float | None = None,
    mask: npt.ArrayLike | None = None,
    progress: ProgressCallback | None = None,
    cancel: CancelCallback | None = None,
) -> Array:
    """Compute ``Σ_k B_f(λ_k) φ_k(v)²`` for cubic B-splines over ``[0, max_eigenvalue]``.

    See `spectral_geometry_filter` for other parameters, and `bspline_bank`.

    `InputError` is raised if `max_eigenvalue` is not positive and finite, or an argument is
    invalid.

    Parameters
    ----------
    max_eigenvalue : float
        End of the range of eigenvalues, which the bands divide evenly.
    n_components : int
        Number of bands.
    count : int or "auto", optional
        Number of eigenpairs, at most the number of vertices; their largest eigenvalue replaces
        `max_eigenvalue`. "auto" is the same as None: all pairs up to `max_eigenvalue`, where the
        bands end.
    wavelength : float, optional
        Shortest wavelength ``2π / √λ``, in unit of the mesh, in place of `max_eigenvalue`.

    Returns
    -------
    ndarray, shape (n, n_components)
        Columns from low to high eigenvalues, in one over squared unit; their sum is ``Σ_k φ_k²``.

    Examples
    --------
    >>> bands = mv.compute_geometry_vectors(ball, max_eigenvalue=40.0, n_components=8)
    >>> bands.shape
    (642, 8)
    """
    n_bands = whole_number(n_components, "n_components", MOST_FILTERS)
    check_bands(max_eigenvalue, band_size)
    if count == "auto":
        refuse_two_extents(DEFAULT_MAX_EIGENVALUE, count, wavelength)
        count = None
    n_pairs, bound = chosen_extent(max_eigenvalue, count, wavelength)
    if bound is not None:
        bspline_bank(0.0, bound, n_bands)  # raises before the decomposition
    computation = _Computation(
        masked(mesh, mask), decomposition_dtype, drop_first, robust, mollify_factor, verbose,
        progress, cancel, mask is not None,
    )  # fmt: skip
    check_columns(computation.matrices[0].shape[0], n_bands)

    def bank(eigenvalues: npt.NDArray[np.float64]) -> FilterBank:
        last = float(eigenvalues[-1]) if len(eigenvalues) else 0.0
        return bspline_bank(0.0, last if bound is None else bound, n_bands)

    return computation.features(n_pairs, bound, bank)


@dataclass(frozen=True, eq=False)
class _Computation:
    """A mesh and options, and the computation shared by the functions of this module."""

    mesh: MeshOrMatrices
    precision: npt.DTypeLike | None
    drop_first: bool
    robust: bool
    mollify_factor: float
    verbose: int
    progress: ProgressCallback | None
    cancel: CancelCallback | None
    is_masked: bool

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of eigenvectors and features."""
        return np.dtype(np.float64 if self.precision is None else self.precision)

    @property
    def name(self) -> str:
        """Name of the mesh, for warnings."""
        return self.mesh.name if isinstance(self.mesh, Mesh) else ""

    @property
    def _is_matrices(self) -> bool:
        return isinstance(self.mesh, (tuple, list)) and sparse.issparse(self.mesh[0])

    @cached_property
    def matrices(self) -> tuple[SparseMatrix, SparseMatrix]:
        given = self.mesh
        if self._is_matrices:
            return given[0], given[1]
        return cotangent_laplacian(given, robust=self.robust, mollify_factor=self.mollify_factor)

    def solve(
        self,
        n_components: int | None,
        max_eigenvalue: float | None,
        allocate: Allocate | None,
        stacklevel: int = 5,
    ) -> Eigenpairs:
        """Compute eigenpairs by their number or up to a threshold."""
        stiffness, mass = self.matrices
        return solve_and_warn(
            stiffness,
            mass,
            n_components=n_components,
            max_eigenvalue=max_eigenvalue,
            tol=_TOLERANCE,
            dtype=self.dtype,
            allocate=allocate,
            verbose=self.verbose,
            unit=self.mesh.unit if isinstance(self.mesh, Mesh) else "",
            name=self.name,
            mask=mask_text(self.mesh) if self.is_masked else "",
            stacklevel=stacklevel,
            progress=self.progress,
            cancel=self.cancel,
        )

    @cached_property
    def surface(self) -> tuple[float, int]:
        """Area, and number of vertices with area."""
        mass = np.asarray(self.matrices[1].diagonal(), dtype=np.float64)
        return float(mass.sum()), int(np.count_nonzero(mass))

    def features(
        self,
        n_components: int | None,
        max_eigenvalue: float | None,
        make: FilterMaker,
        tail: Literal["weyl"] | None = None,
        time: float | None = None,
    ) -> Array:
        """Compute features, shape (n, f), and warn of their truncation error if it is known.

        `time` is the shortest time if the number of pairs is to be chosen for it, else None.
        """
        with scratch_rows(self.dtype) as allocate:
            limit = ""
            if time is None:
                result = self.solve(n_components, max_eigenvalue, allocate)
            else:
                result, limit = self._resolved(time, allocate)
            # On a piece, the first pair of the whole mesh is left out: its square is smaller.
            whole = self.mesh.first if self.drop_first and isinstance(self.mesh, Piece) else None
            start = int(self.drop_first and whole is None)
            eigenvalues = result.eigenvalues[start:]
            if time is None and not eigenvalues.any():
                _warn_of_zeros(max_eigenvalue, result, self.name)
            made, truncation = make(eigenvalues), None
            if isinstance(made, HeatKernelFilter):
                made = made.bank(eigenvalues) or made
            ended = result.n_components == self.surface[1]
            if isinstance(made, FilterBank) and made.tail is not None and len(eigenvalues):
                features = truncated_features(
                    result,
                    made,
                    drop_first=start == 1,
                    dtype=self.dtype,
                    tail=tail,
                    known_to=result.known_to or None,
                )
                values, truncation = features.values, features.truncation
                coefficients = made(eigenvalues)
            else:
                coefficients = checked_coefficients(made(eigenvalues.copy()), eigenvalues)
                values = accumulate_features(result.rows[start:], coefficients)
                if not ended and eigenvalues.any():
                    warn_of_open_end(coefficients, eigenvalues, 4, name=self.name)
            if whole is not None:
                values -= np.outer(whole, coefficients[:, 0])
            values[result.mass == 0.0] = np.nan
            if time is not None and ended and result.eigenvalues[-1] < required_eigenvalue(time):
                few = f"{of_mesh(self.name)}the shortest time needs more than the"
                few += f" {result.n_components:,} eigenpairs of this mesh."
                warnings.warn(few, TruncationWarning, stacklevel=3)
            if truncation is not None and len(truncation.flagged):
                limit = limit or self._estimated(result).exhausted
        warn_of_truncation(truncation, stacklevel=4, name=self.name, limit=limit)
        return values.astype(self.dtype, copy=False)

    def _resolved(self, time: float, allocate: Allocate) -> tuple[Eigenpairs, str]:
        """Compute the resolved pairs of those that a time needs, see `resolved_pairs`."""
        from meshmash_viewer.spectral.resolution import resolved_pairs

        def solve(target: Target) -> Eigenpairs:
            found = self.solve(target.n_components, target.max_eigenvalue, allocate, 7)
            return self._estimated(found)

        target = sufficient_target(time, *self.surface)
        # pieces with limits of their own would differ at the seams
        if self._is_matrices or isinstance(self.mesh, Piece):
            return solve(target), ""
        return resolved_pairs(target, *self.surface, solve)

    def _estimated(self, pairs: Eigenpairs) -> Eigenpairs:
        """Return pairs with `mesh_errors`; without, for matrices."""
        if self._is_matrices:
            return pairs
        from meshmash_viewer.spectral.resolution import quick_error

        known = replace(pairs, operator=OperatorOptions(self.robust, self.mollify_factor))
        return replace(known, mesh_errors=quick_error(as_mesh(self.mesh), known))


def _warn_of_zeros(max_eigenvalue: float | None, result: Eigenpairs, name: str) -> None:
    useful = weyl_eigenvalue(float(result.mass.sum()), _USEFUL_COUNT)
    within = (
        "are among the requested eigenpairs"
        if max_eigenvalue is None
        else f"lie below max_eigenvalue ({max_eigenvalue:.4g})"
    )
    warnings.warn(
        f"{of_mesh(name)}Only zero eigenvalues, one for each connected component, {within}, so the "
        f"features are constant on each: about {_USEFUL_COUNT} eigenpairs of this mesh lie below "
        f"{useful:.2g} per squared unit of its coordinates.",
        ConstantFeaturesWarning,
        stacklevel=4,
    )
