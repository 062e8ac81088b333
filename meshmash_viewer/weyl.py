"""How many eigenvalues a surface has, and how long their waves are.

Weyl's law: a surface of area A has about ``A λ / 4π`` eigenvalues below λ, whatever its shape.
It is exact in the limit only. Along thin branches, nearly one-dimensional at long wavelengths, and
with many components the first hundred eigenvalues can lie ten times lower than it says, so every
number from here is to be shown as an estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from meshmash_viewer.errors import InputError

__all__ = [
    "TARGET_KINDS",
    "Target",
    "wavelength",
    "wavelength_eigenvalue",
    "weyl_count",
    "weyl_eigenvalue",
]

#: Sizes beyond this and its inverse are no lengths of meshes: their squares are no numbers.
_LARGEST = 1e150
#: What a `Target` can be.
TARGET_KINDS = ("count", "max_eigenvalue", "wavelength")


def weyl_count(area: float, eigenvalue: float) -> float:
    """Estimate how many eigenvalues lie below one: ``area * eigenvalue / 4π``."""
    return area * eigenvalue / (4.0 * math.pi)


def weyl_eigenvalue(area: float, count: float) -> float:
    """Estimate the eigenvalue below which `count` others lie: ``4π count / area``."""
    return 4.0 * math.pi * count / area


def wavelength(eigenvalue: float) -> float:
    """Length of a wave of this eigenvalue, ``2π / √λ``; infinite for zero."""
    return 2.0 * math.pi / math.sqrt(eigenvalue) if eigenvalue > 0.0 else math.inf


def wavelength_eigenvalue(length: float) -> float:
    """Eigenvalue of a wave of this length, ``(2π / length)²``."""
    return (2.0 * math.pi / length) ** 2


@dataclass(frozen=True, slots=True)
class Target:
    """How much of the spectrum is asked for.

    Parameters
    ----------
    kind : "count", "max_eigenvalue" or "wavelength"
        What `value` is: a number of eigenpairs, the largest eigenvalue to include (per squared
        unit), or the shortest wavelength to include (unit).
    value : float
        Positive; a whole number for a count.

    Raises
    ------
    InputError
        If the value is not positive and of a size whose square is a number, or a count is not a
        whole number.
    """

    kind: Literal["count", "max_eigenvalue", "wavelength"] = "count"
    value: float = 100

    def __post_init__(self) -> None:
        if self.kind not in TARGET_KINDS:
            raise InputError(f"A target is a count, a max_eigenvalue or a wavelength: {self.kind}.")
        name = {
            "count": "The number of eigenpairs",
            "max_eigenvalue": "The largest eigenvalue",
            "wavelength": "The shortest wavelength",
        }[self.kind]
        if not (math.isfinite(self.value) and self.value > 0.0):
            raise InputError(f"{name} is {self.value:g}: give a positive number.")
        if not 1.0 / _LARGEST <= self.value <= _LARGEST:
            raise InputError(f"{name} is {self.value:g}: no mesh has one of that size.")
        if self.kind == "count" and self.value != int(self.value):
            raise InputError(f"{name} is {self.value:g}: give a whole number.")

    @property
    def n_components(self) -> int | None:
        """Number of pairs asked for, or None where an eigenvalue bounds them."""
        return int(self.value) if self.kind == "count" else None

    @property
    def max_eigenvalue(self) -> float | None:
        """Largest eigenvalue asked for, per squared unit, or None where a count bounds them."""
        if self.kind == "count":
            return None
        return self.value if self.kind == "max_eigenvalue" else wavelength_eigenvalue(self.value)

    def estimated_count(self, area: float) -> float:
        """Number of pairs, by Weyl's law where it is not given."""
        bound = self.max_eigenvalue
        return float(self.value) if bound is None else weyl_count(area, bound)

    def estimated_eigenvalue(self, area: float) -> float:
        """Largest eigenvalue, per squared unit, by Weyl's law where it is not given."""
        bound = self.max_eigenvalue
        return weyl_eigenvalue(area, self.value) if bound is None else bound

    def estimated_wavelength(self, area: float) -> float:
        """Shortest wavelength, by Weyl's law where it is not given."""
        if self.kind == "wavelength":
            return float(self.value)
        return wavelength(self.estimated_eigenvalue(area))
