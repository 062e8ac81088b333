"""Weyl's law: numbers of eigenvalues, wavelengths and diffusion times of a surface.

A surface of area A has about ``A λ / 4π`` eigenvalues below λ, independent of its shape. The law is
asymptotic: with thin branches or many components the first hundred eigenvalues can be ten times
lower, so all numbers computed here are displayed as estimates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import unknown
from meshmash_viewer.units import check_number, check_positive, format_quantity, whole_number

#: Share of a feature that may be missing, due to too few eigenpairs, before it is flagged.
TOLERANCE = 0.01
#: Factor that increases the predicted eigenvalue, since columns differ from their mean.
_MARGIN = 1.1
#: Largest value of a target, whose square does not overflow; the inverse is the smallest value.
_LARGEST = 1e150
#: Smallest and largest eigenvalue relative to Weyl's estimates of the first and the last.
_BELOW, _ABOVE = 1e-6, 1e3
#: Kinds of `Target`, and their names in messages.
TARGET_KINDS = {
    "count": "The number of eigenpairs",
    "max_eigenvalue": "The largest eigenvalue",
    "wavelength": "The shortest wavelength",
    "time": "The shortest time",
}


def weyl_count(area: float, eigenvalue: float) -> float:
    """Estimate the number of eigenvalues below a value: ``area * eigenvalue / 4π``.

    Examples
    --------
    >>> round(weyl_count(4 * np.pi, 110.0))
    110
    """
    return area * eigenvalue / (4.0 * math.pi)


def weyl_eigenvalue(area: float, count: float) -> float:
    """Estimate the value below which `count` eigenvalues lie: ``4π count / area``.

    Examples
    --------
    >>> weyl_eigenvalue(4 * np.pi, 110)
    110.0
    """
    return 4.0 * math.pi * count / area


def wavelength(eigenvalue: float) -> float:
    """Return the wavelength of an eigenvalue, ``2π / √λ``; infinite for zero."""
    return 2.0 * math.pi / math.sqrt(eigenvalue) if eigenvalue > 0.0 else math.inf


def format_wavelength(eigenvalue: float, unit: str) -> str:
    """Write the wavelength of an eigenvalue; "∞" for a zero mode."""
    length = wavelength(eigenvalue)
    return format_quantity(length, unit) if math.isfinite(length) else "∞"


def wavelength_eigenvalue(length: float) -> float:
    """Return the eigenvalue of a wavelength, ``(2π / length)²``."""
    return (2.0 * math.pi / length) ** 2


def resolved_time(eigenvalue: float) -> float:
    """Return the shortest time at which pairs up to an eigenvalue give HKS within `TOLERANCE`.

    On a nearly flat surface HKS is ``1 / 4πt``; a share of ``exp(-λ t)`` is missing.
    """
    return -_MARGIN * math.log(TOLERANCE) / eigenvalue if eigenvalue > 0.0 else math.inf


def required_eigenvalue(time: float) -> float:
    """Return the largest eigenvalue required for a time: the inverse of `resolved_time`."""
    return -_MARGIN * math.log(TOLERANCE) / time


@dataclass(frozen=True, slots=True)
class Target:
    """The requested part of the spectrum.

    `InputError` is raised if the value is not positive or its square overflows, or a count is not a
    whole number.
    """

    #: Meaning of `value`: a number of eigenpairs, the largest eigenvalue to include (per squared
    #: unit), the shortest wavelength to include (unit), or the shortest time at which the heat
    #: kernel signature is to be resolved within `TOLERANCE` (squared unit).
    kind: Literal["count", "max_eigenvalue", "wavelength", "time"] = "count"
    #: Positive; a whole number for a count.
    value: float = 100

    def __post_init__(self) -> None:
        if self.kind not in TARGET_KINDS:
            raise unknown("target", self.kind, TARGET_KINDS)
        name = TARGET_KINDS[self.kind]
        check_positive(self.value, name)
        check_number(self.value, name, 1.0 / _LARGEST, _LARGEST)
        if self.kind == "count":
            whole_number(self.value, name)
        # plain Python numbers, for JSON
        plain = int(self.value) if self.kind == "count" else float(self.value)
        object.__setattr__(self, "value", plain)

    @property
    def n_components(self) -> int | None:
        """Requested number of pairs; None for a target of another kind."""
        return int(self.value) if self.kind == "count" else None

    @property
    def max_eigenvalue(self) -> float | None:
        """Largest requested eigenvalue, per squared unit; None for a count."""
        if self.kind == "count":
            return None
        if self.kind == "time":
            return required_eigenvalue(self.value)
        return self.value if self.kind == "max_eigenvalue" else wavelength_eigenvalue(self.value)


@dataclass(frozen=True, eq=False)
class Translation:
    """Conversion between count, largest eigenvalue, wavelength and time for one mesh.

    Within the known eigenvalues the result is exact. Beyond them Weyl's law is applied from the
    last known eigenvalue on, which removes its error below that, up to the number of vertices.
    """

    #: Area of the surface, positive, in squared length units.
    area: float
    #: Shape (k,): Known eigenvalues, ascending and complete from the first; may be empty.
    eigenvalues: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    #: Number of vertices, which is the total number of pairs.
    n_vertices: float = math.inf
    #: Value up to which the known eigenvalues are complete.
    known_to: float = 0.0

    def eigenvalue(self, target: Target) -> tuple[float, bool]:
        """Return the largest eigenvalue of a target, and whether it is exact."""
        bound = target.max_eigenvalue
        if bound is not None:
            return bound, True
        count, known = self.count(target)[0], len(self.eigenvalues)
        if count <= known:
            return max(float(self.eigenvalues[count - 1]), 0.0), True
        return self._last + weyl_eigenvalue(self.area, count - known), False

    def wavelength(self, target: Target) -> tuple[float, bool]:
        """Return the shortest wavelength of a target, and whether it is exact."""
        if target.kind == "wavelength":
            return float(target.value), True
        eigenvalue, exact = self.eigenvalue(target)
        return wavelength(eigenvalue), exact

    def time(self, target: Target) -> tuple[float, bool]:
        """Return the shortest time resolved by a target, and whether it is exact."""
        if target.kind == "time":
            return float(target.value), True
        eigenvalue, exact = self.eigenvalue(target)
        return resolved_time(eigenvalue), exact

    def count(self, target: Target) -> tuple[int, bool]:
        """Return the number of eigenpairs of a target, and whether it is exact."""
        bound, known = target.max_eigenvalue, len(self.eigenvalues)
        if bound is None:
            return int(min(target.value, self.n_vertices)), True
        if known and (bound < float(self.eigenvalues[-1]) or known >= self.n_vertices):
            return int(np.searchsorted(self.eigenvalues, bound, side="right")), True
        if bound <= self.known_to:
            return known, True
        beyond = weyl_count(self.area, bound - self._last)
        estimated = max(1, math.floor(known + beyond + 0.5))
        return int(min(estimated, self.n_vertices)), False

    @property
    def bounds(self) -> tuple[float, float]:
        """Safe lower and upper bound of all nonzero eigenvalues of the mesh."""
        if not self.area > 0.0:
            return 1e-140, 1e140
        last = min(self.n_vertices, 1e140)
        low = min(max(_BELOW * weyl_eigenvalue(self.area, 1), 1e-140), 1e140)
        return low, min(max(_ABOVE * weyl_eigenvalue(self.area, last), low), 1e140)

    @property
    def _last(self) -> float:
        last = float(self.eigenvalues[-1]) if len(self.eigenvalues) else 0.0
        return max(last, self.known_to)
