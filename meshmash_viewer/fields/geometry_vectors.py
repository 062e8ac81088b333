"""Geometry vectors: eigenfunctions squared and summed in B-spline bands of the spectrum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.filter_responses import SplineResponse
from meshmash_viewer.features.filters import FilterBank, bspline_bank
from meshmash_viewer.fields.bank_columns import BankColumns, estimated_pairs
from meshmash_viewer.fields.family import Family, Reading, Response
from meshmash_viewer.fields.parameter import NotNegative, parameter
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, format_eigenvalue
from meshmash_viewer.spectral.weyl import Target, format_wavelength, weyl_eigenvalue
from meshmash_viewer.units import format_quantity, format_range, named_quantity

#: Number of samples on the support of a band.
_SAMPLES = 33


@dataclass(frozen=True)
class GeometryVectors(BankColumns):
    """One band of the spectrum (Litman & Bronstein 2014)."""

    name = "band"
    label = "Geometry vectors"
    page = "geometry_vectors"
    short = "Geometry vectors"
    tip = "Bands of the spectrum: cubic B-splines that sum to 1"
    export = "geometry-vectors"
    icon = '<path d="M2 19c4 0 4-13 7-13s3 13 7 13"/><path d="M8 19c4 0 4-13 7-13s3 13 7 13"/>'
    nouns = ("Band", "Bands")
    facts: ClassVar[dict[str, str]] = {
        "band_center_label": "Centre λ",
        "band_wavelength_label": "Wavelength there",
        "band_support_label": "Not zero between",
        "band_pairs_label": "Eigenpairs in it",
    }
    ordered = ("low", "high")

    #: Whether bands span the computed spectrum or the range `low` to `high`.
    automatic: bool = parameter(
        True,
        bool,
        text="Automatic, from 0 to the last λ",
        tip="The ends can be dragged on the spectrum, too",
    )
    #: Range of eigenvalues in inverse squared length units when not automatic.
    low: float | None = parameter(
        None, NotNegative, power=-2, text="Lowest eigenvalue", control="band_min_field"
    )
    high: float | None = parameter(
        None, NotNegative, power=-2, text="Highest eigenvalue", control="band_max_field"
    )

    def range(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return the ends of the range of bands, in inverse squared length units."""
        return self._ends(float(spectrum.eigenvalues[-1]))

    def _ends(self, top: float) -> tuple[float, float]:
        low, high = 0.0, top
        if not self.automatic:
            low = low if self.low is None else self.low
            high = high if self.high is None else self.high
        low, high = min(low, high), max(low, high)
        return (low, high) if low < high else (low, low + 1.0)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        low, high = self.range(spectrum)
        return replace(self, index=self.column, low=low, high=high, automatic=False)

    def between(self, low: float, high: float) -> Self:
        return replace(self, low=low, high=high, automatic=False)

    def title(self) -> str:
        return f"Geometry vector {self.index}"

    def quantity(self, spectrum: Eigenpairs, unit: str) -> str:
        (low, high), like = self.support(spectrum), float(spectrum.eigenvalues[-1])
        return f"λ from {format_range(low, high, unit, -2, word='to', like=like)}"

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        center = float(self.centers(spectrum)[self.column])
        start, end = self.support(spectrum)
        first, last = np.searchsorted(spectrum.eigenvalues, [start, end])
        like = float(spectrum.eigenvalues[-1])  # one unit for every λ of a spectrum
        facts = (
            format_eigenvalue(center, spectrum, unit),
            format_wavelength(center, unit),
            format_range(start, end, unit, -2, like=like),
            f"{last - first:,}",
        )
        return Reading(f"Band {self.column}", facts, *self._missing(spectrum, unit))

    def _missing(self, spectrum: Eigenpairs, unit: str) -> tuple[str, Target | None]:
        low, high = self.range(spectrum)
        known = max(float(spectrum.eigenvalues[-1]), spectrum.known_to)
        if high <= known * (1.0 + 1e-9) or 0 < spectrum.n_vertices <= len(spectrum):
            held = np.any((spectrum.eigenvalues >= low) & (spectrum.eigenvalues <= high))
            return "" if held else "No eigenpair lies in this range: every band is 0.", None
        text = (
            f"Bands above λ = {format_quantity(known, unit, -2)} need more eigenpairs,"
            f" {estimated_pairs(spectrum, high)}."
        )
        return text, Target("max_eigenvalue", high)

    # -- bands --------------------------------------------------------------------------------

    def centers(self, spectrum: Eigenpairs) -> FloatArray:
        """Return the eigenvalue in the middle of each band, shape (count,)."""
        return _bands(*self.range(spectrum), self.count)[0]

    def support(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return the range of eigenvalues in which the band is not zero."""
        return _support(*self.range(spectrum), self.count, self.column)

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response:
        centers, curves = _bands(*self.range(spectrum), self.count)
        handle = float(centers[self.column])
        ends = self.range(spectrum)
        return Response(curves[self.column], handle, f"band {self.column}", curves, ends)

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        return replace(self, index=int(np.argmin(np.abs(self.centers(spectrum) - value))))

    def axes(self, unit: str) -> tuple[str, str]:
        return "Band", named_quantity("Vector", unit, -2)

    # -- files --------------------------------------------------------------------------------

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        """Return the bands, if `automatic` from zero to `bound` or to the largest eigenvalue."""
        top = float(eigenvalues[-1]) if bound is None else bound
        if not top > 0.0 and area is not None:
            top = weyl_eigenvalue(area, len(eigenvalues))
        return bspline_bank(*self._ends(top), self.count)

    def contents(self, spectrum: Eigenpairs, unit: str) -> str:
        low, high = self.range(spectrum)
        return f"Bands of λ from {format_range(low, high, unit, -2, word='to', digits=4)}."

    def bank_script(self) -> str:
        return f"mv.bspline_bank({self.low!r}, {self.high!r}, {self.count})"


def _support(low: float, high: float, count: int, band: int) -> tuple[float, float]:
    """Return the range of eigenvalues in which a band is not zero."""
    # Uniform cubic B-splines: each spans at most four intervals between knots.
    degree = min(3, count - 1)
    spans = count - degree
    first, last = max(band - degree, 0) / spans, min(band + 1, spans) / spans
    return low + (high - low) * first, low + (high - low) * last


@lru_cache(maxsize=4)
def _bands(
    low: float, high: float, count: int
) -> tuple[FloatArray, tuple[tuple[FloatArray, FloatArray], ...]]:
    """Return the centres of bands, shape (count,), and the curve of each band on its support.

    Cached, since every step to another band needs them: they take 2 to 3 ms for 32 bands.
    """
    bank = bspline_bank(low, high, count)
    assert isinstance(bank.response, SplineResponse)
    places = [np.linspace(*_support(low, high, count, at), _SAMPLES) for at in range(count)]
    splines = zip(places, bank.response.bases, strict=True)
    return bank.parameters, tuple((each, spline(each)) for each, spline in splines)
