"""Controls of the geometry vectors: how many B-spline bands, over which range, and which one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from meshmash_viewer.app.controls.facts import estimated_pairs, format_wavelength, show_note
from meshmash_viewer.app.controls.layout import Part
from meshmash_viewer.app.tabs.field_stepper import ColumnStepper
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.units import format_quantity, format_range, power_unit

__all__ = ["BandTab"]


class BandTab(ColumnStepper):
    """Step through the bands; their number and range are those of the exported feature."""

    family = GeometryVectors
    icon = '<path d="M2 19c4 0 4-13 7-13s3 13 7 13"/><path d="M8 19c4 0 4-13 7-13s3 13 7 13"/>'
    one = "Band"
    many = "Bands"
    tip = "Columns of the exported feature; cubic B-splines that sum to 1"
    ends = "low", "high"
    fact_labels: ClassVar[dict[str, str]] = {
        "band_center_label": "Centre λ",
        "band_wavelength_label": "Wavelength there",
        "band_support_label": "Not zero between",
        "band_pairs_label": "Eigenpairs in it",
    }

    def _range_parts(self) -> tuple[Part, ...]:
        return (
            self._make_range_box(
                ("band_automatic_check", "band_min_field", "band_max_field"),
                ("Automatic, from 0 to λ_max", "Lowest", "Highest"),
                "eigenvalue",
                "The ends can be dragged on the spectrum, too",
            ),
        )

    def _describe(self, spectrum: Eigenpairs | None, unit: str) -> dict[str, str]:
        chosen, between = self._document.display[GeometryVectors], self._range()
        bounds = 0.0, self._document.translation().bounds[1]
        written = power_unit(unit, -2)
        self.range_box.show_range(between, written, bounds, automatic=chosen.automatic)
        if spectrum is None or between is None:
            return {}
        self._mark_missing(spectrum, between, unit)
        center = float(chosen.centers(spectrum)[chosen.column])
        start, end = chosen.support(spectrum)
        first, last = np.searchsorted(spectrum.eigenvalues, [start, end])
        return {
            "band_center_label": format_quantity(center, unit, -2),
            "band_wavelength_label": format_wavelength(center, unit),
            "band_support_label": format_range(start, end, unit, -2),
            "band_pairs_label": f"{last - first:,}",
        }

    def _mark_missing(self, spectrum: Eigenpairs, between: tuple[float, float], unit: str) -> None:
        low, high = between
        known = max(float(spectrum.eigenvalues[-1]), spectrum.known_to)
        if high <= known * (1.0 + 1e-9) or 0 < spectrum.n_vertices <= len(spectrum):
            held = np.any((spectrum.eigenvalues >= low) & (spectrum.eigenvalues <= high))
            text = "" if held else "No eigenpair lies in this range: every band is 0."
            show_note(self.missing_note, text)
            return
        mesh = self._document.mesh
        pairs = f", {estimated_pairs(spectrum, mesh.area, high)}" if mesh is not None else ""
        show_note(
            self.missing_note,
            f"Bands above λ = {format_quantity(known, unit, -2)} need more eigenpairs{pairs}.",
        )
