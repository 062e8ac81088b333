"""Parameters of filters: checks, and times chosen from a spectrum."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError
from meshmash_viewer.spectral.weyl import weyl_eigenvalue
from meshmash_viewer.units import whole_number

#: Eigenvalues below this share of the largest are zero within rounding.
ZERO_SHARE = 1e-10


def count_zeros(eigenvalues: FloatArray) -> int:
    """Count eigenvalues (ascending) that are zero within rounding: one for each component."""
    largest = abs(float(eigenvalues[-1])) if len(eigenvalues) else 0.0
    return int(np.searchsorted(eigenvalues, ZERO_SHARE * largest, side="right"))


def first_nonzero_eigenvalue(eigenvalues: npt.ArrayLike) -> float:
    """Return the lowest eigenvalue that is not zero within rounding; `InputError` without one."""
    spectrum = as_spectrum(eigenvalues)
    above = spectrum[spectrum > ZERO_SHARE * spectrum.max(initial=0.0)]
    if not len(above):
        raise InputError(
            "All eigenvalues are zero, one for each connected component, so times and "
            "energies cannot be chosen from them: compute more pairs (max_eigenvalue is per "
            "squared unit of the mesh), or give t_min and t_max."
        )
    return float(above.min())


def hks_time_range(eigenvalues: npt.ArrayLike, area: float | None = None) -> tuple[float, float]:
    """Return the range of times in which a heat kernel signature varies for this spectrum.

    ``4 ln 10 / λ_max`` and ``4 ln 10 / λ_2``, λ_2 the lowest above zero (Sun et al. 2009), in
    squared unit of the mesh: where the highest and the lowest mode have decayed to 1e-4.

    If all eigenvalues are zero, the range is that of the eigenvalues expected by Weyl's law for
    the `area` of the mesh, in which the signature is constant; `InputError` is raised without one.
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
        Bounds in squared unit of the mesh; None takes that of `hks_time_range`.
    n_scales : int
        Number of times.
    area : float, optional
        See `hks_time_range`.

    Returns
    -------
    ndarray of float64, shape (n_scales,)

    Examples
    --------
    >>> mv.hks_times([0.0, 2.0], t_min=1.0, t_max=100.0, n_scales=3)
    array([  1.,  10., 100.])
    """
    n_scales = whole_number(n_scales, "The number of time scales")
    check_times(t_min, t_max)
    if t_min is None or t_max is None:
        shortest, longest = hks_time_range(eigenvalues, area)
        if t_min is not None and t_min > longest:
            raise InputError(
                f"t_min ({t_min:.4g}) is above {longest:.4g}, the longest time that these"
                " eigenvalues suggest for t_max: give t_max too."
            )
        if t_max is not None and t_max < shortest:
            raise InputError(
                f"t_max ({t_max:.4g}) is below {shortest:.4g}, the shortest time that these"
                " eigenvalues suggest for t_min: give t_min too, or more eigenpairs."
            )
        t_min = shortest if t_min is None else t_min
        t_max = longest if t_max is None else t_max
    return np.geomspace(t_min, t_max, n_scales)


def check_times(t_min: float | None, t_max: float | None) -> None:
    """Raise `InputError` for times that are not positive, or out of order."""
    for bound, name in ((t_min, "t_min"), (t_max, "t_max")):
        if bound is not None and not (np.isfinite(bound) and bound > 0.0):
            raise InputError(f"{name} is {bound:g}: give a positive time, or none.")
    if t_min is not None and t_max is not None and t_min > t_max:
        raise InputError(f"t_min ({t_min:.4g}) is above t_max ({t_max:.4g}): swap them.")


def as_spectrum(eigenvalues: npt.ArrayLike) -> FloatArray:
    """Return eigenvalues as an array of shape (k,)."""
    spectrum = np.asarray(eigenvalues, dtype=np.float64)
    if spectrum.ndim != 1:
        raise InputError(f"Eigenvalues have shape {spectrum.shape}: give a 1-D array.")
    return spectrum


def as_parameters(values: npt.ArrayLike, name: str) -> FloatArray:
    """Return one or more finite, nonnegative values, shape (f,); `name` is for messages."""
    parameters = np.array(values, dtype=np.float64)
    if parameters.ndim != 1 or not len(parameters):
        raise InputError(f"Give a 1-D list of at least one {name}.")
    if not (np.isfinite(parameters).all() and (parameters >= 0.0).all()):
        raise InputError(f"A {name} is negative or not finite: {parameters.tolist()}.")
    return parameters


def short_text(parameters: FloatArray, index: int) -> str:
    """Format a parameter with three digits, or as many as distinguish all of them."""
    for digits in range(3, 18):
        written = [f"{value:.{digits - 1}e}" for value in parameters]
        if len(set(written)) == len(set(parameters.tolist())):
            break
    return written[index]


def checked_coefficients(returned: npt.ArrayLike, eigenvalues: FloatArray) -> FloatArray:
    """Check the result of a filter for k eigenvalues, shape (f, k) or (k,); return shape (f, k)."""
    given = np.asarray(returned)
    if given.dtype.kind not in "biuf":
        described = f"values of type {given.dtype}" if given.shape else repr(returned)[:60]
        raise InputError(
            f"The filter returned {described}: let it return real numbers, shape "
            "(n_filters, n_eigenvalues)."
        )
    coefficients = given.astype(np.float64)
    if coefficients.shape == eigenvalues.shape:
        coefficients = coefficients[np.newaxis]  # one filter without its axis
    k = len(eigenvalues)
    if coefficients.ndim != 2 or coefficients.shape[1] != k:
        raise InputError(
            f"The filter returned shape {given.shape} for {k} eigenvalues: it has to return one "
            "row of coefficients a filter, shape (n_filters, n_eigenvalues)."
        )
    bad = np.argwhere(~np.isfinite(coefficients))
    if len(bad):
        raise InputError(
            f"The filter returned {coefficients[tuple(bad[0])]} for the eigenvalue "
            f"{eigenvalues[bad[0][-1]]:.4g}: let it return finite numbers for every eigenvalue, "
            "zero included."
        )
    return coefficients
