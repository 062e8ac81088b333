"""The wave kernel signature: eigenfunctions squared and summed in bands of log λ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from meshmash_viewer.fields.bank_columns import BankColumns
from meshmash_viewer.fields.family import FloatArray
from meshmash_viewer.fields.spectrum import Spectrum
from meshmash_viewer.units import format_quantity

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank

__all__ = ["WaveKernelSignature"]


@dataclass(frozen=True)
class WaveKernelSignature(BankColumns):
    """Gaussian bands of log λ, each with unit sum (Aubry et al. 2011).

    Parameters
    ----------
    index, count : int
        Energy, counted from 0, and their number.
    """

    name: ClassVar[str] = "wks"
    label: ClassVar[str] = "Wave kernel signature"
    export: ClassVar[str] = "wks"

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        """See `Family.bank`."""
        from meshmash_viewer.features.filters import wave_kernel_bank

        return wave_kernel_bank(eigenvalues, self.count)

    def contents(self, spectrum: Spectrum, unit: str) -> str:
        """See `Family.contents`."""
        energies = self.bank(spectrum.eigenvalues).parameters
        low, high = format_quantity(energies[0], ""), format_quantity(energies[-1], unit, -2)
        return f"Energies λ from {low} to {high}."
