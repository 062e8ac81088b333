"""Filter banks: functions of the eigenvalue that define feature columns.

A bank maps k eigenvalues to coefficients of shape (f, k); column f of the features is then
``Σ_k coefficients[f, k] φ_k²`` (see `meshmash_viewer.features.sums`). Banks are plain data, so they
can be pickled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filter_responses import (
    MOST_FILTERS,
    HeatResponse,
    LogGaussianResponse,
    SplineResponse,
    StepResponse,
    TailedResponse,
    as_parameters,
    as_spectrum,
    check_times,
    first_nonzero_eigenvalue,
    hks_times,
    short_texts,
    wave_bands,
    wave_response,
)
from meshmash_viewer.spectral.cost import check_room
from meshmash_viewer.units import counted, whole_number

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


#: Function from eigenvalues, shape (k,), to coefficients, shape (f, k).
SpectralFilter: TypeAlias = Callable[[FloatArray], FloatArray]

#: Degree of the B-splines.
_DEGREE = 3


@dataclass(frozen=True, eq=False)
class FilterBank:
    """Named filters; calling the bank with k eigenvalues returns coefficients of shape (f, k).

    Parameters
    ----------
    kind : str
        Kind of the features: "hks", "geometry-vectors", "wks", "low-pass", ...
    columns : tuple of str
        Name of each of the f columns.
    parameters : ndarray of float64, shape (f,)
        Parameter of each column: a time, a centre, a cutoff.
    parameter_name : str
        Symbol of the parameter, for an axis label.
    parameter_power : int
        Unit of the parameter as a power of that of the mesh: 2 for a time, -2 for an eigenvalue.
    response : callable
        Function from eigenvalues, shape (k,), to values, shape (f, k). If it is a
        `meshmash_viewer.features.filter_responses.TailedResponse`, as for all predefined filters,
        the truncation error of features can be estimated.
    normalised : bool
        Whether each filter is divided by its sum over the given eigenvalues.

    Examples
    --------
    >>> bank = mv.heat_kernel_bank([1.0, 2.0])
    >>> bank.kind, bank.columns
    ('hks', ('hks_t=1.00e+00', 'hks_t=2.00e+00'))
    >>> bank([0.0, 1.0]).round(3)
    array([[1.   , 0.368],
           [1.   , 0.135]])
    """

    kind: str
    columns: tuple[str, ...]
    parameters: FloatArray
    parameter_name: str
    parameter_power: int
    response: SpectralFilter
    normalised: bool = False

    @property
    def n_filters(self) -> int:
        """Number of columns."""
        return len(self.columns)

    def __call__(self, eigenvalues: npt.ArrayLike) -> FloatArray:
        """Compute coefficients of shape (f, k) for k eigenvalues, a 1-D array."""
        values = self.response(as_spectrum(eigenvalues))
        if self.normalised:
            totals = self.totals(values)[:, np.newaxis]
            np.divide(values, totals, out=values, where=totals > 0.0)
        return values

    def totals(self, values: FloatArray) -> FloatArray:
        """Return the divisors, shape (f,), for values of `response`, shape (f, k)."""
        return values.sum(axis=1) if self.normalised else np.ones(len(values))

    @property
    def tail(self) -> TailedResponse | None:
        """The response if it is a `TailedResponse`, else None."""
        return self.response if isinstance(self.response, TailedResponse) else None


def heat_kernel_bank(times: npt.ArrayLike) -> FilterBank:
    """Make the filters of the heat kernel signature, ``exp(-λ t)`` [1]_.

    `InputError` is raised if a time is negative or not finite, or there are no times.

    Parameters
    ----------
    times : array_like, shape (f,), or a number
        Diffusion times in squared unit of the mesh; heat spreads over a length of about ``√t``.

    References
    ----------
    .. [1] Sun, J., Ovsjanikov, M. and Guibas, L. (2009). "A Concise and Provably Informative
       Multi-Scale Signature Based on Heat Diffusion." Computer Graphics Forum 28(5).

    Examples
    --------
    >>> mv.heat_kernel_bank([1.0, 2.0])([0.0, 1.0]).round(3)
    array([[1.   , 0.368],
           [1.   , 0.135]])
    """
    scales = as_parameters(times, "diffusion time")
    columns = tuple(f"hks_t={each}" for each in short_texts(scales))
    return FilterBank("hks", columns, scales, "t", 2, HeatResponse(scales))


def wave_kernel_bank(
    eigenvalues: npt.ArrayLike,
    n_energies: int = 100,
    width: float = 7.0,
    *,
    energies: npt.ArrayLike | None = None,
    sigma: float | None = None,
) -> FilterBank:
    """Make the filters of the wave kernel signature: Gaussian bands in log λ with unit sum [1]_.

    `InputError` is raised if the spectrum does not have two different eigenvalues above zero; if an
    energy is repeated, or its exponential is not finite; or if the deviation is not positive, is
    too large for the range, or is missing for a single energy.

    Parameters
    ----------
    eigenvalues : array_like, shape (k,)
        The spectrum that sets the range of energies; zero eigenvalues are ignored.
    n_energies : int
        Number of columns. Their centres are evenly spaced in log λ, from two standard deviations
        above the first nonzero eigenvalue to two below the last.
    width : float
        Standard deviation of the bands, in steps between neighbouring bands.
    energies : array_like, shape (f,), optional
        Centres of the bands, as natural logarithms of eigenvalues per squared unit, in place of
        `n_energies` evenly spaced centres.
    sigma : float, optional
        Standard deviation of the bands in log λ, in place of `width`.

    References
    ----------
    .. [1] Aubry, M., Schlickewei, U. and Cremers, D. (2011). "The Wave Kernel Signature: A
       Quantum Mechanical Approach to Shape Analysis." ICCV Workshops.

    Examples
    --------
    >>> eigenvalues = np.array([0.0, 2.0, 6.0, 12.0])
    >>> bank = mv.wave_kernel_bank(eigenvalues, n_energies=3)
    >>> bank(eigenvalues).sum(axis=1)
    array([1., 1., 1.])
    >>> bank = mv.wave_kernel_bank(eigenvalues, energies=np.log([2.0, 12.0]), sigma=0.1)
    >>> bank(eigenvalues).round(3)
    array([[0., 1., 0., 0.],
           [0., 0., 0., 1.]])
    """
    if energies is None:
        response = wave_response(eigenvalues, n_energies, width, sigma)
    else:
        floor = 0.5 * first_nonzero_eigenvalue(eigenvalues)
        response = LogGaussianResponse(*wave_bands(energies, width, sigma), floor)
    centers = np.exp(response.energies)
    columns = tuple(f"wks_λ={each}" for each in short_texts(centers))
    return FilterBank("wks", columns, centers, "λ", -2, response, normalised=True)


def bspline_bank(e_min: float, e_max: float, n_components: int) -> FilterBank:
    """Make the filters of geometry vectors: cubic B-splines over λ that sum to one [1]_.

    `InputError` is raised if the range is empty or `n_components` < 1.

    Parameters
    ----------
    e_min, e_max : float
        Range of eigenvalues, per squared unit; all bands are 0 outside the range. Eigenvalues that
        equal `e_max` to a relative difference of 1e-9 are inside.
    n_components : int
        Number of bands.

    References
    ----------
    .. [1] Litman, R. and Bronstein, A. M. (2014). "Learning Spectral Descriptors for Deformable
       Shape Correspondence." IEEE TPAMI 36(1).

    Examples
    --------
    >>> bands = mv.bspline_bank(0.0, 12.0, 5)([0.0, 2.0, 6.0])
    >>> bands.sum(axis=0)
    array([1., 1., 1.])
    """
    bases = tuple(construct_bspline_basis(e_min, e_max, n_components))
    digits = max(2, len(str(len(bases) - 1)))
    columns = tuple(f"band_{i:0{digits}d}" for i in range(len(bases)))
    degree = bases[0].k
    # Centres are Greville points: means of inner knots.
    knots = _clamped_knots(float(e_min), float(e_max), len(bases), degree)
    if degree:
        centres = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(len(bases))])
    else:
        centres = np.array([0.5 * (e_min + e_max)])
    response = SplineResponse(bases, float(e_min), float(e_max))
    return FilterBank("geometry-vectors", columns, centres, "λ", -2, response)


def low_pass_bank(cutoff: float) -> FilterBank:
    """Make one column with weight 1 for all eigenvalues below `cutoff` (per squared unit).

    Examples
    --------
    >>> mv.low_pass_bank(5.0)([0.0, 2.0, 6.0])
    array([[1., 1., 0.]])
    """
    bound = as_parameters([cutoff], "cutoff")
    columns = (f"low_pass_λ<{short_texts(bound)[0]}",)
    response = StepResponse(-np.inf, bound[0], closed=False)
    return FilterBank("low-pass", columns, bound, "λ", -2, response)


def band_pass_bank(low: float, high: float) -> FilterBank:
    """Make one column with weight 1 for all eigenvalues from `low` to `high`, both included.

    Examples
    --------
    >>> mv.band_pass_bank(2.0, 6.0)([0.0, 2.0, 6.0, 12.0])
    array([[0., 1., 1., 0.]])
    """
    bounds = as_parameters([low, high], "bound of a band")
    if low > high:
        fault = f"The band from {low:g} to {high:g} is empty"
        raise InputError("bounds-swapped", fault, "swap its bounds")
    columns = (f"band_pass_λ={'..'.join(short_texts(bounds))}",)
    centre = np.array([bounds.mean()])
    response = StepResponse(bounds[0], bounds[1], closed=True)
    return FilterBank("band-pass", columns, centre, "λ", -2, response)


def gaussian_pyramid_bank(scales: npt.ArrayLike) -> FilterBank:
    """Make Gaussian smoothing filters: ``exp(-s λ)``, of variance 2 s along the surface.

    Parameters
    ----------
    scales : array_like, shape (f,)
        Scales s, in squared unit of the mesh.

    Examples
    --------
    >>> mv.gaussian_pyramid_bank([0.0, 1.0])([0.0, 2.0]).round(3)
    array([[1.   , 1.   ],
           [1.   , 0.135]])
    """
    variances = as_parameters(scales, "scale")
    columns = tuple(f"gaussian_s={each}" for each in short_texts(variances))
    response = HeatResponse(variances)
    return FilterBank("gaussian-pyramid", columns, variances, "s", 2, response)


def get_hks_filter(
    t_max: float | None = None,
    t_min: float | None = None,
    n_scales: int = 32,
    dtype: npt.DTypeLike = np.float64,
) -> Callable[[npt.ArrayLike], npt.NDArray[Any]]:
    """Make the filter of the heat kernel signature.

    Parameters
    ----------
    t_max, t_min : float, optional
        Longest and shortest time, in squared unit of the mesh; None: chosen from the given
        eigenvalues by `hks_time_range`. If all eigenvalues are zero, all coefficients are 1.
    n_scales : int
        Number of times.
    dtype : dtype
        Type of the coefficients.

    Returns
    -------
    callable
        Function from eigenvalues, shape (k,), to coefficients, shape (n_scales, k), by ascending
        time; picklable.

    Examples
    --------
    >>> heat = mv.get_hks_filter(t_max=2.0, t_min=1.0, n_scales=2)
    >>> heat([0.0, 1.0]).round(3)
    array([[1.   , 0.368],
           [1.   , 0.135]])
    """
    # Raise before the decomposition.
    n_scales = whole_number(n_scales, "The number of time scales", MOST_FILTERS)
    check_times(t_min, t_max)
    return HeatKernelFilter(t_min, t_max, n_scales, np.dtype(dtype))


def construct_bspline_basis(e_min: float, e_max: float, n_components: int) -> list[BSpline[Any]]:
    """Make cubic B-splines on uniform knots that sum to one on [e_min, e_max] and are 0 outside.

    `InputError` is raised if the range is empty or `n_components` < 1.

    Parameters
    ----------
    e_min, e_max : float
        Range of eigenvalues, per squared unit.
    n_components : int
        Number of splines. Fewer than four splines have a lower degree: quadratic for 3, linear for
        2, constant for 1.

    Returns
    -------
    list of scipy.interpolate.BSpline
        Splines from low to high eigenvalues; they can be evaluated at any eigenvalue.

    Examples
    --------
    >>> splines = mv.construct_bspline_basis(0.0, 12.0, 5)
    >>> float(sum(spline(2.0) for spline in splines).round(6))
    1.0
    """
    from scipy.interpolate import BSpline

    n_components = whole_number(n_components, "The number of B-splines", MOST_FILTERS)
    fewer = "take fewer (--n-components, n_components=)"
    check_room(f"{counted(n_components, 'B-spline')}", 8.0 * n_components**2, fewer)
    low, high = float(e_min), float(e_max)
    if not (np.isfinite(low) and np.isfinite(high) and high > low):
        fault = f"The eigenvalues of B-splines are from {low:g} to {high:g}"
        raise InputError("bounds-swapped", fault, "give a finite range, with e_max above e_min")
    degree = min(_DEGREE, n_components - 1)
    # An additional interval at each end with zero coefficients makes SciPy's extrapolation zero.
    # Intervals are open at their right end, so the range ends one rounding unit after e_max.
    end = float(np.nextafter(high, np.inf))
    inner = _clamped_knots(low, end, n_components, degree)
    outer = np.full(degree + 1, 1.0)
    knots = np.concatenate([(low - (high - low)) * outer, inner, (end + (high - low)) * outer])
    bases = []
    for component in range(n_components):
        coefficients = np.zeros(n_components + 2 * (degree + 1))
        coefficients[degree + 1 + component] = 1.0
        bases.append(BSpline(knots, coefficients, degree, extrapolate=True))
    return bases


def _clamped_knots(low: float, high: float, n_components: int, degree: int) -> FloatArray:
    """Return uniform knots with both ends repeated, shape (n_components + degree + 1,)."""
    spans = n_components - degree
    between = low + (high - low) * np.arange(1, spans) / spans
    return np.concatenate([np.full(degree + 1, low), between, np.full(degree + 1, high)])


def construct_bspline_filter(
    e_min: float, e_max: float, n_components: int
) -> Callable[[npt.ArrayLike], FloatArray]:
    """Make a function that evaluates `construct_bspline_basis`: the filter of geometry vectors.

    Returns
    -------
    callable
        Function from eigenvalues, shape (k,), to coefficients, shape (n_components, k); picklable.

    Examples
    --------
    >>> bands = mv.construct_bspline_filter(0.0, 12.0, 5)
    >>> bands([0.0, 2.0, 6.0]).shape
    (5, 3)
    """
    return bspline_bank(e_min, e_max, n_components)


@dataclass(frozen=True)
class HeatKernelFilter:
    """Heat kernel whose times may depend on the eigenvalues; result of `get_hks_filter`."""

    t_min: float | None
    t_max: float | None
    n_scales: int
    dtype: np.dtype[Any]

    def __call__(self, eigenvalues: npt.ArrayLike) -> npt.NDArray[Any]:
        """Compute coefficients of shape (n_scales, k) for k eigenvalues."""
        spectrum = as_spectrum(eigenvalues)
        bank = self.bank(spectrum)
        if bank is None:
            # exp(-λ t) is 1 at all times.
            return np.ones((self.n_scales, len(spectrum)), dtype=self.dtype)
        return bank(spectrum).astype(self.dtype)

    def bank(self, eigenvalues: FloatArray) -> FilterBank | None:
        """Return the filters with their times; None if all eigenvalues are zero."""
        chosen = self.t_min is None or self.t_max is None
        if chosen and not (eigenvalues > 0.0).any():
            return None
        return heat_kernel_bank(hks_times(eigenvalues, self.t_min, self.t_max, self.n_scales))
