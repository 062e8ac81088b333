"""The wave kernel signature at one energy: sums of squared eigenfunctions in bands of log λ."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.filter_responses import LogGaussianResponse, wave_response
from meshmash_viewer.features.filters import FilterBank, wave_kernel_bank
from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.fields.family import Reading, Response
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero, format_eigenvalue
from meshmash_viewer.spectral.weyl import format_wavelength
from meshmash_viewer.units import format_number, format_range, named_quantity, power_unit


@dataclass(frozen=True)
class WaveKernelSignature(BankColumns):
    """One Gaussian band of log λ, with unit sum (Aubry et al. 2011)."""

    name = "wks"
    label = "Wave kernel signature"
    page = "wave_kernel_signature"
    short = "WKS"
    tip = "Wave kernel signature, at energies evenly spaced in log λ"
    export = "wks"
    icon = '<path d="M2 12c2 0 2-3 4-3s2 8 4 8 2-13 4-13 2 11 4 11 2-3 4-3"/>'
    nouns = ("Energy", "Energies")
    facts: ClassVar[dict[str, str]] = {
        "wks_eigenvalue_label": "λ there",
        "wks_wavelength_label": "Wavelength there",
        "wks_width_label": "Width σ in ln λ",
        "wks_pairs_label": "Eigenpairs within σ",
    }
    interval = 100
    logarithmic = (False, False, True)

    def quantity(self, spectrum: Eigenpairs, unit: str) -> str:
        energy = self.place(spectrum)
        written = format_eigenvalue(np.exp(energy), spectrum, unit)
        return f"ln λ = {format_number(energy)} (λ = {written})"

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        bands = self.bands(spectrum)
        energy, width = float(bands.energies[self.column]), bands.deviation
        first, last = np.searchsorted(
            spectrum.eigenvalues, np.exp([energy - width, energy + width])
        )
        low, high = np.exp(bands.energies[[0, -1]])
        facts = (
            format_eigenvalue(np.exp(energy), spectrum, unit),
            format_wavelength(float(np.exp(energy)), unit),
            format_number(width, 3),
            f"{last - first:,}",
        )
        decades = (float(low), float(high)) if self.count > 1 else None
        return Reading(f"ln λ = {format_number(energy)}", facts, decades=decades)

    @property
    def definition(self) -> str:
        return "Σ h(λ) φ² / Σ h(λ), h = exp(−(e − ln λ)² / 2σ²)"

    def bands(self, spectrum: Eigenpairs) -> LogGaussianResponse:
        """Return the bands without normalisation, with energies and a width in ln λ."""
        return wave_response(spectrum.eigenvalues, self.count)

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        return self.bands(spectrum).energies

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response | None:
        known = spectrum.eigenvalues[first_nonzero(spectrum) :]
        if not len(known) or not np.log(known[-1]) > np.log(known[0]):
            return None  # no range of energies
        bands = self.bands(spectrum)
        others = tuple((along, each) for each in bands(along))
        energy = float(bands.energies[self.column])
        legend = f"energy {self.column}"
        return Response(others[self.column], float(np.exp(energy)), legend, others)

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        return self.at_place(spectrum, np.log(value)) if value > 0.0 else replace(self, index=0)

    def axes(self, unit: str) -> tuple[str, str]:
        # a logarithm has no unit: state the unit of λ
        energy = f"Energy ln λ, λ in {power_unit(unit, -2)}" if unit else "Energy ln λ"
        return energy, named_quantity("WKS", unit, -2)

    # -- files --------------------------------------------------------------------------------

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        return wave_kernel_bank(eigenvalues, self.count)

    def contents(self, spectrum: Eigenpairs, unit: str) -> str:
        low, high = np.exp(self.places(spectrum)[[0, -1]])
        return f"Energies λ from {format_range(low, high, unit, -2, word='to')}."

    def bank_script(self) -> str:
        return f"mv.wave_kernel_bank(decomposition.eigenvalues, {self.count})"
