"""Cubic B-splines on uniform knots that sum to one: the bands of the geometry vectors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.units import whole_number

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

__all__ = ["clamped_knots", "construct_bspline_basis"]

FloatArray: TypeAlias = npt.NDArray[np.float64]

_DEGREE = 3


def construct_bspline_basis(e_min: float, e_max: float, n_components: int) -> list[BSpline[Any]]:
    """Make cubic B-splines on uniform knots that sum to one on [e_min, e_max] and are 0 outside.

    Parameters
    ----------
    e_min, e_max : float
        Range of eigenvalues, per squared unit.
    n_components : int
        Number of splines. Four are needed for the third degree; fewer get the highest degree
        that there is: parabolas for 3, straight lines for 2, a constant for 1.

    Returns
    -------
    list of scipy.interpolate.BSpline
        Ascending; to be evaluated anywhere.

    Raises
    ------
    InputError
        If the range is empty or `n_components` < 1.
    """
    from scipy.interpolate import BSpline

    n_components = whole_number(n_components, "The number of B-splines")
    low, high = float(e_min), float(e_max)
    if not (np.isfinite(low) and np.isfinite(high) and high > low):
        raise InputError(
            f"B-splines need a finite range of eigenvalues with e_max above e_min, not {low:g} to "
            f"{high:g}."
        )
    degree = min(_DEGREE, n_components - 1)
    # SciPy continues the outermost polynomials beyond the knots. A further interval at each end
    # on which all coefficients are zero makes that continuation zero. Splines hold from the left
    # of an interval, so the range is closed at e_max by ending it one rounding unit later.
    end = float(np.nextafter(high, np.inf))
    inner = clamped_knots(low, end, n_components, degree)
    outer = np.full(degree + 1, 1.0)
    knots = np.concatenate([(low - (high - low)) * outer, inner, (end + (high - low)) * outer])
    bases = []
    for component in range(n_components):
        coefficients = np.zeros(n_components + 2 * (degree + 1))
        coefficients[degree + 1 + component] = 1.0
        bases.append(BSpline(knots, coefficients, degree, extrapolate=True))
    return bases


def clamped_knots(low: float, high: float, n_components: int, degree: int) -> FloatArray:
    """Uniform knots with both ends repeated, shape (n_components + degree + 1,)."""
    spans = n_components - degree
    between = low + (high - low) * np.arange(1, spans) / spans
    return np.concatenate([np.full(degree + 1, low), between, np.full(degree + 1, high)])
