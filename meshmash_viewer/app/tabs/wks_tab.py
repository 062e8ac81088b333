"""Controls of the wave kernel signature: which energy, and how many."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from meshmash_viewer.app.controls.facts import format_wavelength, show_note
from meshmash_viewer.app.controls.scale_marks import decade_marks
from meshmash_viewer.app.tabs.field_stepper import ColumnStepper
from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import format_quantity

__all__ = ["WksTab"]


class WksTab(ColumnStepper):
    """Step through the energies, evenly spaced in log λ; the slider marks decades of λ."""

    family = WaveKernelSignature
    icon = '<path d="M2 12c2 0 2-3 4-3s2 8 4 8 2-13 4-13 2 11 4 11 2-3 4-3"/>'
    one = "Energy"
    many = "Energies"
    tip = "Columns of the exported feature, evenly spaced in log λ"
    fact_labels: ClassVar[dict[str, str]] = {
        "wks_eigenvalue_label": "λ there",
        "wks_wavelength_label": "Wavelength there",
        "wks_width_label": "Width σ in ln λ",
        "wks_pairs_label": "Eigenpairs within σ",
    }

    def _describe(self, spectrum: Eigenpairs | None, unit: str) -> dict[str, str]:
        chosen = self._document.display[WaveKernelSignature]
        self.slider.set_marks(())
        if spectrum is None:
            return {}
        try:
            bands = chosen.bands(spectrum)
        except InputError as fault:
            show_note(self.missing_note, str(fault))
            return {}
        energy, width = float(bands.energies[chosen.column]), bands.deviation
        if chosen.count > 1:
            self.slider.set_marks(decade_marks(*np.exp(bands.energies[[0, -1]])))
        self.title.setText(f"ln λ = {energy:.4g}")
        ends = np.exp([energy - width, energy + width])
        first, last = np.searchsorted(spectrum.eigenvalues, ends)
        return {
            "wks_eigenvalue_label": format_quantity(float(np.exp(energy)), unit, -2),
            "wks_wavelength_label": format_wavelength(float(np.exp(energy)), unit),
            "wks_width_label": f"{width:.3g}",
            "wks_pairs_label": f"{last - first:,}",
        }
