"""Predefined filters as functions of λ, with their supremum and integral beyond an eigenvalue.

Each class represents f functions. `meshmash_viewer.features.truncation` computes the truncation
error of a sum from the supremum and the integral over the part of the spectrum that was not
computed. Filters are plain data, so banks can be pickled. This module also checks parameters, and
chooses diffusion times from a spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, wrong_shape
from meshmash_viewer.spectral.weyl import weyl_eigenvalue
from meshmash_viewer.units import check_positive, counted, whole_number

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Eigenvalues below this share of the largest are zero within rounding.
ZERO_SHARE = 1e-10
#: Maximum number of columns of a filter bank.
MOST_FILTERS = 100_000
#: Relative difference up to which an eigenvalue equals the end of a range.
_ROUNDING = 1e-9


def count_zeros(eigenvalues: FloatArray) -> int:
    """Count ascending eigenvalues that are zero within rounding: one for each component."""
    largest = abs(float(eigenvalues[-1])) if len(eigenvalues) else 0.0
    return int(np.searchsorted(eigenvalues, ZERO_SHARE * largest, side="right"))


def first_nonzero_eigenvalue(eigenvalues: npt.ArrayLike) -> float:
    """Return the lowest eigenvalue that is not zero within rounding; `InputError` if all are."""
    spectrum = as_spectrum(eigenvalues)
    above = spectrum[spectrum > ZERO_SHARE * spectrum.max(initial=0.0)]
    if not len(above):
        raise InputError(
            "no-nonzero-eigenvalue",
            f"All eigenvalues are zero ({counted(len(spectrum), 'pair')}, one for each component)",
            "compute more pairs (--count, n_components=), merge components that touch (--repair"
            " merge_coincident_vertices), or keep the largest (--largest-component)",
        )
    return float(above.min())


def hks_time_range(eigenvalues: npt.ArrayLike, area: float | None = None) -> tuple[float, float]:
    """Return the range of times in which a heat kernel signature varies for this spectrum.

    The range is from ``4 ln 10 / λ_max`` to ``4 ln 10 / λ_2``, in squared unit of the mesh, with
    λ_2 the lowest eigenvalue above zero (Sun et al. 2009). At these times the highest and the
    lowest mode have decayed to 1e-4.

    If all eigenvalues are zero, the signature is constant, and the range is computed from the
    eigenvalues expected by Weyl's law for the `area` of the mesh; `InputError` without an `area`.
    """
    spectrum = as_spectrum(eigenvalues)
    if area is not None and not (spectrum > 0.0).any():
        spectrum = weyl_eigenvalue(area, 1) * np.arange(1.0, max(len(spectrum), 2) + 1.0)
    first = first_nonzero_eigenvalue(spectrum)
    decades = 4.0 * np.log(10.0)
    return float(decades / spectrum.max()), float(decades / first)


def hks_times(
    eigenvalues: npt.ArrayLike,
    t_min: float | None = None,
    t_max: float | None = None,
    n_scales: int = 32,
    area: float | None = None,
) -> FloatArray:
    """Return diffusion times, evenly spaced in log t, from short to long.

    `InputError` is raised if a bound is not positive, the bounds are out of order, or `n_scales` <
    1.

    Parameters
    ----------
    eigenvalues : array_like, shape (k,)
        The spectrum; used only if a bound is None.
    t_min, t_max : float, optional
        Bounds in squared unit of the mesh; None: the bound of `hks_time_range`.
    n_scales : int
        Number of times.
    area : float, optional
        See `hks_time_range`.

    Returns
    -------
    ndarray of float64, shape (n_scales,)

    Examples
    --------
    >>> hks_times([0.0, 2.0], t_min=1.0, t_max=100.0, n_scales=3)
    array([  1.,  10., 100.])
    """
    n_scales = whole_number(n_scales, "The number of time scales", MOST_FILTERS)
    check_times(t_min, t_max)
    if t_min is None or t_max is None:
        shortest, longest = hks_time_range(eigenvalues, area)
        low = shortest if t_min is None else t_min
        high = longest if t_max is None else t_max
        if low > high:
            fault = f"t_min ({low:.4g}) is above t_max ({high:.4g}), one of which is by default"
            raise InputError("bounds-swapped", fault, "give both")
        t_min, t_max = low, high
    return np.geomspace(t_min, t_max, n_scales)


def check_times(t_min: float | None, t_max: float | None) -> None:
    """Raise `InputError` for times that are not positive, or out of order."""
    for bound, name in ((t_min, "t_min"), (t_max, "t_max")):
        if bound is not None:
            check_positive(bound, name)
    if t_min is not None and t_max is not None and t_min > t_max:
        fault = f"t_min ({t_min:.4g}) is above t_max ({t_max:.4g})"
        raise InputError("bounds-swapped", fault, "swap them")


def as_spectrum(eigenvalues: npt.ArrayLike) -> FloatArray:
    """Return eigenvalues as an array of shape (k,)."""
    spectrum = np.asarray(eigenvalues, dtype=np.float64)
    if spectrum.ndim != 1:
        raise wrong_shape("Eigenvalues", spectrum.shape, "a 1-D array")
    return spectrum


def as_parameters(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return parameters, shape (f,); `InputError` if none, or one is negative or not finite."""
    try:
        parameters = np.array(values, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        parameters = np.empty(0)
    if parameters.ndim != 1 or not len(parameters):
        raise wrong_shape(f"Values of {name}", parameters.shape, "a 1-D list of at least one")
    if len(parameters) > MOST_FILTERS:
        fault = f"A column for each {name} would be {len(parameters):,} columns"
        raise InputError("too-many", fault, f"give at most {MOST_FILTERS:,}")
    if not (np.isfinite(parameters).all() and (parameters >= 0.0).all()):
        fault = f"A {name} is negative or not finite ({parameters.tolist()})"
        raise InputError("out-of-range", fault, "give numbers from 0")
    return parameters


def short_texts(parameters: FloatArray) -> list[str]:
    """Format parameters with three digits, or as many as distinguish all parameters."""
    for digits in range(3, 18):
        written = [f"{value:.{digits - 1}e}" for value in parameters]
        if len(set(written)) == len(set(parameters.tolist())):
            break
    return written


def checked_coefficients(returned: npt.ArrayLike, eigenvalues: FloatArray) -> FloatArray:
    """Check the result of a filter for k eigenvalues, shape (f, k) or (k,); return shape (f, k)."""
    given = np.asarray(returned)
    if given.dtype.kind not in "biuf":
        described = f"values of type {given.dtype}" if given.shape else repr(returned)[:60]
        raise wrong_filter(described)
    coefficients = given.astype(np.float64)
    if coefficients.shape == eigenvalues.shape:
        coefficients = coefficients[np.newaxis]  # a single filter as a 1-D array
    k = len(eigenvalues)
    if coefficients.ndim != 2 or coefficients.shape[1] != k:
        raise wrong_filter(f"shape {given.shape} for {k} eigenvalues")
    bad = np.argwhere(~np.isfinite(coefficients))
    if len(bad):
        at = f"{coefficients[tuple(bad[0])]} for the eigenvalue {eigenvalues[bad[0][-1]]:.4g}"
        raise wrong_filter(at)
    return coefficients


def wrong_filter(returned: str) -> InputError:
    """Return the fault of a filter that returned something else than finite numbers."""
    remedy = "let it return finite numbers, shape (n_filters, n_eigenvalues), for zero too"
    return InputError("wrong-filter", f"The filter returned {returned}", remedy)


@runtime_checkable
class TailedResponse(Protocol):
    """Filters with their suprema and integrals beyond an eigenvalue."""

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        """Compute values at eigenvalues of shape (k,): shape (f, k)."""
        ...

    def supremum(self, start: float) -> FloatArray:
        """Return the supremum of ``|h(λ)|`` over λ > start, shape (f,)."""
        ...

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        """Compute ``∫ h dλ`` from `start` to each of `ends`, shape (m,): shape (m, f)."""
        ...


@dataclass(frozen=True, eq=False)
class HeatResponse:
    """``exp(-λ t)`` for f times t, in squared unit."""

    times: FloatArray

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-np.outer(self.times, eigenvalues)))

    def supremum(self, start: float) -> FloatArray:
        return np.asarray(np.exp(-self.times * max(start, 0.0)))

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        start = max(start, 0.0)
        width = np.maximum(ends - start, 0.0)
        # At t = 0 the filter is 1, and its integral the length of the interval.
        times = np.where(self.times > 0.0, self.times, 1.0)
        inside = -np.expm1(-np.outer(width, times)) * np.exp(-start * times) / times
        return np.where(self.times > 0.0, inside, width[:, np.newaxis])


@dataclass(frozen=True, eq=False)
class LogGaussianResponse:
    """``exp(-(e - log λ)² / 2 d²)`` for f energies e; 0 up to `floor`."""

    energies: FloatArray
    deviation: float
    floor: float

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        bands = np.zeros((len(self.energies), len(eigenvalues)))
        positive = eigenvalues > self.floor
        bands[:, positive] = self._gaussians(eigenvalues[positive])
        return bands

    def supremum(self, start: float) -> FloatArray:
        start = max(start, self.floor)
        return np.where(np.log(start) < self.energies, 1.0, self._gaussians(start)[:, 0])

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        start = max(start, self.floor)
        d = self.deviation
        # With u = log λ the integrand is a Gaussian with its centre shifted by d².
        centres = self.energies + d * d
        upper = ndtr((centres - np.log(start)) / d)
        lower = ndtr((centres - np.log(np.maximum(ends, start))[:, np.newaxis]) / d)
        whole = np.exp(self.energies + 0.5 * d * d) * d * np.sqrt(2.0 * np.pi)
        return np.asarray(whole * (upper - lower))

    def _gaussians(self, eigenvalues: npt.ArrayLike) -> FloatArray:
        distance = (self.energies[:, np.newaxis] - np.log(eigenvalues)) / self.deviation
        return np.asarray(np.exp(-0.5 * np.square(distance)))


def wave_response(
    eigenvalues: npt.ArrayLike,
    n_energies: int = 100,
    width: float = 7.0,
    sigma: float | None = None,
) -> LogGaussianResponse:
    """Make the filters of `wave_kernel_bank` without normalisation."""
    spectrum = as_spectrum(eigenvalues)
    n_energies = whole_number(n_energies, "The number of energies", MOST_FILTERS)
    check_positive(width, "The width of the energy bands")
    first = first_nonzero_eigenvalue(spectrum)
    low, high = float(np.log(first)), float(np.log(spectrum.max()))
    if not high > low:
        fault = "The wave kernel needs two different eigenvalues above zero"
        raise InputError("too-few-pairs", fault, "compute more eigenpairs")
    # As in the paper, the outermost centres are two deviations inside the range, and the deviation
    # is a multiple of the step between centres.
    if sigma is None:
        sigma = width * (high - low) / (n_energies - 1 + 4.0 * width)
    else:
        check_positive(sigma, "The sigma of the energy bands")
        if 4.0 * sigma >= high - low:
            span = f"the eigenvalues reach over {high - low:.4g} in log λ"
            remedy = "give less than a quarter of that, or the energies too"
            raise InputError("out-of-range", f"sigma is {sigma:g}, and {span}", remedy)
    step = (high - low - 4.0 * sigma) / max(n_energies - 1, 1)
    energies = np.asarray(low + 2.0 * sigma + step * np.arange(n_energies), dtype=np.float64)
    return LogGaussianResponse(energies, sigma, 0.5 * first)


def wave_bands(
    energies: npt.ArrayLike, width: float, sigma: float | None
) -> tuple[FloatArray, float]:
    """Check the given energies of `wave_kernel_bank`; return them, and the standard deviation."""
    try:
        centres = np.array(energies, dtype=np.float64)
    except (TypeError, ValueError):
        centres = np.empty(0)
    with np.errstate(over="ignore", under="ignore"):
        places = np.exp(centres)
    if centres.ndim != 1 or not len(centres) or not np.isfinite(places).all() or not places.all():
        few = np.array2string(centres, precision=4, threshold=6, edgeitems=2, separator=", ")
        wanted = "a 1-D list of at least one natural logarithm of an eigenvalue"
        raise InputError("out-of-range", f"Energies are {few}", f"give {wanted}")
    if len(np.unique(centres)) < len(centres):
        raise InputError("conflicting-arguments", "An energy is given twice", "give each once")
    if sigma is None:
        check_positive(width, "The width of the energy bands")
        if len(centres) == 1:
            fault = "A single energy has no step that its width could follow"
            raise InputError("missing-argument", fault, "give sigma")
        sigma = width * float(np.ptp(centres)) / (len(centres) - 1)
    check_positive(sigma, "The sigma of the energy bands")
    return centres, float(sigma)


@dataclass(frozen=True, eq=False)
class SplineResponse:
    """B-splines on ``[low, high]``, 0 outside; `high` is inside, within rounding."""

    bases: tuple[BSpline[Any], ...]
    low: float
    high: float

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        # a converted or recomputed last eigenvalue may exceed the end by rounding
        at_end = np.isclose(eigenvalues, self.high, rtol=_ROUNDING, atol=0.0)
        inside = np.where(at_end, self.high, eigenvalues)
        return np.stack([np.asarray(basis(inside)) for basis in self.bases])

    def supremum(self, start: float) -> FloatArray:
        if start >= self.high:
            return np.zeros(len(self.bases))
        start = max(start, self.low)
        largest = []
        for basis in self.bases:
            # The maximum of a piecewise polynomial is at an end, a knot or a zero of its slope.
            places = np.concatenate([basis.t, _flat_places(basis)])
            places = places[(places > start) & (places <= self.high)]
            largest.append(basis(np.append(places, [start, self.high])).max())
        return np.array(largest)

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        start = min(max(start, self.low), self.high)
        ends = np.clip(ends, start, self.high)
        columns = []
        for basis in self.bases:
            sums = basis.antiderivative()
            columns.append(sums(ends) - sums(start))
        return np.asarray(np.maximum(np.stack(columns, axis=1), 0.0))


@dataclass(frozen=True, eq=False)
class StepResponse:
    """One filter, 1 from `low` to `high` (included if `closed`) and 0 elsewhere."""

    low: float
    high: float
    closed: bool

    def __call__(self, eigenvalues: FloatArray) -> FloatArray:
        below = eigenvalues <= self.high if self.closed else eigenvalues < self.high
        return ((eigenvalues >= self.low) & below).astype(np.float64)[np.newaxis]

    def supremum(self, start: float) -> FloatArray:
        return np.array([1.0 if start < self.high else 0.0])

    def integral(self, start: float, ends: FloatArray) -> FloatArray:
        start = max(start, self.low)
        return np.maximum(np.minimum(ends, self.high) - start, 0.0)[:, np.newaxis]


def _flat_places(basis: BSpline[Any]) -> FloatArray:
    """Return the zeros of the derivative of a spline, except on constant pieces."""
    from scipy.interpolate import PPoly

    if basis.k < 2:
        return np.zeros(0)
    pieces: PPoly[Any] = PPoly.from_spline(basis)  # type: ignore[arg-type]  # accepts any spline
    roots = np.asarray(pieces.derivative().roots(), dtype=np.float64)
    return roots[np.isfinite(roots)]
