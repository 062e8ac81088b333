"""The scale-invariant heat kernel signature at one frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from meshmash_viewer.arrays import FloatArray, blocks
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filter_responses import first_nonzero_eigenvalue
from meshmash_viewer.features.sums import Features, sum_squares
from meshmash_viewer.fields.bank_columns import ColumnCount, Columns
from meshmash_viewer.fields.family import ColumnArray, Description, Profile, Samples
from meshmash_viewer.fields.parameter import parameter
from meshmash_viewer.progress import CancelCallback
from meshmash_viewer.spectral.cost import check_room
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero

if TYPE_CHECKING:
    from meshmash_viewer.mesh import Mesh

#: Period of the first frequency in ln t: 24 octaves of time (Bronstein & Kokkinos 2010).
_PERIOD = 24.0 * math.log(2.0)
#: First and last time, as λt of the highest and of the lowest pair; HKS is constant outside.
_BEFORE, _AFTER = 1e-5, 40.0
#: Number of vertices whose signatures at all times are in memory together.
_BLOCK = 1 << 15


def invariant_columns(
    eigenvalues: FloatArray, rows: Any, count: int, cancel: CancelCallback | None = None
) -> FloatArray:
    """Compute ``|∫ d ln HKS / d ln t · exp(-iω ln t) d ln t|``, shape (count, n).

    Scaling a mesh shifts HKS in ln t and multiplies it by a constant. The derivative of the
    logarithm removes the constant, the absolute value of the Fourier transform removes the shift.
    Frequencies are ``ω = 2π j / (24 ln 2)`` for j from 0. Rows have shape (>= k, n).
    `InputError` is raised if all eigenvalues are zero.
    """
    # at least three samples per period of the highest frequency, so that sums approximate integrals
    step = math.log(2.0) * min(0.5, 8.0 / count)
    first, last = first_nonzero_eigenvalue(eigenvalues), float(eigenvalues[-1])
    n_times = math.ceil(math.log(_AFTER / first / (_BEFORE / last)) / step) + 1
    needed = 24.0 * n_times * len(eigenvalues) + 16.0 * n_times * count
    check_room(f"{count:,} columns at {n_times:,} times", needed, "take fewer (--n-components)")
    places = step * np.arange(n_times)
    exponents = np.outer(_BEFORE / last * np.exp(places), np.maximum(eigenvalues, 0.0))
    decay = np.exp(-exponents)
    weights = np.concatenate([decay, -exponents * decay])
    waves = step * np.exp(-2j * np.pi / _PERIOD * np.outer(np.arange(count), places))
    found = np.empty((count, rows.shape[1]))
    for part in blocks(rows.shape[1], _BLOCK):
        sums = sum_squares(rows[: len(eigenvalues), part], weights, np.float64, cancel)
        found[:, part] = np.abs(waves @ (sums[n_times:] / sums[:n_times]))
    return found


def scale_invariant_hks(pairs: Eigenpairs, count: int) -> Features:
    """Compute the scale-invariant heat kernel signature, dimensionless."""
    values = invariant_columns(pairs.eigenvalues, pairs.rows, count).T
    names = tuple(f"sihks_{at}" for at in range(count))
    return Features(values, names, kind="sihks", meta={"frequencies_per": "24 octaves of time"})


@dataclass(frozen=True)
class ScaleInvariantHKS(Columns):
    """Fourier transform of the derivative of ln HKS by ln t (Bronstein & Kokkinos 2010)."""

    name = "sihks"
    label = "Scale-invariant heat kernel signature"
    page = "scale_invariant_hks"
    short = "SI-HKS"
    tip = "Heat kernel signature that is equal on a mesh of another size"
    icon = '<path d="M3 20h18"/><path d="M5 20V6M9 20v-9M13 20v-6M17 20v-3M21 20v-1"/>'
    nouns = ("Frequency", "Frequencies")
    export = "sihks"

    count: int = parameter(6, ColumnCount)

    @property
    def definition(self) -> str:
        return "|F[∂ ln HKS / ∂ ln t]|(ω)"

    def quantity(self, spectrum: Eigenpairs, unit: str) -> str:
        return f"ω = {2.0 * math.pi * self.column / _PERIOD:.3g}"

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        return Description(self.quantity(spectrum, unit), self.label, power=0)

    def columns(self, spectrum: Eigenpairs, cancel: CancelCallback | None = None) -> ColumnArray:
        values = invariant_columns(spectrum.eigenvalues, spectrum.rows, self.count, cancel)
        return values.astype(np.float32)

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        if first_nonzero(spectrum) >= len(spectrum):
            return None
        both = _AtVertex(self.places(spectrum), spectrum.eigenvalues)
        return Profile(both, both, ("Frequency", "SI-HKS"))

    # -- files --------------------------------------------------------------------------------

    def compute_features(
        self, pairs: Eigenpairs | None, mesh: Mesh, bound: float | None = None, **summed: Any
    ) -> Features:
        """Compute the exported columns, for which no truncation error is known."""
        assert pairs is not None
        if summed.get("drop_first"):
            fault = "--drop-first is not for sihks, which needs the first pair"
            raise InputError("conflicting-arguments", fault)
        return scale_invariant_hks(pairs, self.count)

    def exported_columns(self, spectrum: Eigenpairs, unit: str) -> tuple[tuple[str, ...], str]:
        first_nonzero_eigenvalue(spectrum.eigenvalues)
        names = tuple(f"sihks_{at}" for at in range(self.count))
        return names, "Frequencies in 24 octaves of time, pure numbers."

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [
            "from meshmash_viewer.fields.sihks import scale_invariant_hks",
            f"features = scale_invariant_hks(decomposition, {self.count})",
            f"values = features.values[:, {self.column}]",
        ]


@dataclass(frozen=True, eq=False)
class _AtVertex(Samples):
    """Samples of the signature; `coefficients` are the eigenvalues, shape (k,)."""

    def values(self, at_vertex: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows: FloatArray = np.asarray(at_vertex, dtype=np.float64)[:, np.newaxis]
        known = self.coefficients[: len(rows)]
        if not known[-1] > 0.0:
            return np.empty(0), np.empty(0)
        return self.places, invariant_columns(known, rows, len(self.places))[:, 0]
