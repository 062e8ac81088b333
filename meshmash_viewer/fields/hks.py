"""The heat kernel signature at one time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from msgspec import Meta

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.filter_responses import check_times, hks_times
from meshmash_viewer.features.filters import FilterBank, heat_kernel_bank
from meshmash_viewer.features.sums import sum_squares
from meshmash_viewer.features.truncation import percent
from meshmash_viewer.fields.bank_columns import BankFamily, estimated_pairs
from meshmash_viewer.fields.family import (
    MOST_COUNT,
    Answer,
    Cancel,
    Description,
    Family,
    Profile,
    Reading,
    Response,
    Samples,
    Table,
    evenly_in_log,
)
from meshmash_viewer.fields.live_tables import build_heat_table
from meshmash_viewer.fields.parameter import Positive, parameter
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, first_nonzero, grew
from meshmash_viewer.spectral.weyl import TOLERANCE, Target, required_eigenvalue, resolved_time
from meshmash_viewer.units import format_quantity, named_quantity

#: Number of times of the curve of a profile; the exported times are dots.
_FINE = 96


@dataclass(frozen=True)
class HeatKernelSignature(BankFamily):
    """``Σ_k exp(-λ_k t) φ_k²`` at a time t (Sun et al. 2009)."""

    name = "hks"
    label = "Heat kernel signature"
    page = "heat_kernel_signature"
    short = "HKS"
    tip = "Heat kernel signature"
    export = "hks"
    icon = '<path d="M4 4v16h16"/><path d="M6 6c2 8 6 11 13 11.5"/>'
    nouns = ("Time", "Times")
    facts: ClassVar[dict[str, str]] = {"hks_length_label": "Length √t"}
    counted = "scales"
    position = ("time",)
    ordered = ("t_min", "t_max")
    interval = 50
    logarithmic = (True, True, True)

    #: Diffusion time in squared length units; None is the middle of the range in log scale.
    time: float | None = parameter(None, Positive, power=2)
    #: Whether the range is chosen from the spectrum (Sun et al. 2009), not by `t_min` and `t_max`.
    automatic: bool = parameter(
        True,
        bool,
        text="Automatic, from the spectrum",
        tip="4 ln 10 / λ_max to 4 ln 10 / λ₂ (Sun et al. 2009)",
    )
    #: Range of times in squared length units when not automatic.
    t_min: float | None = parameter(
        None,
        Positive,
        power=2,
        text="Shortest time",
        option="t_min",
        metavar="T",
        help="shortest diffusion time (unit²); default: from the eigenvalues of each mesh, so give"
        " both times if columns of several meshes are to be compared",
    )
    t_max: float | None = parameter(
        None,
        Positive,
        power=2,
        text="Longest time",
        option="t_max",
        metavar="T",
        help="longest diffusion time (unit²)",
    )
    #: Number of times in the exported feature and on the profile plot.
    scales: int = parameter(
        32,
        Annotated[int, Meta(ge=1, le=MOST_COUNT)],
        tip="Columns of the exported feature, evenly spaced in log t",
    )

    @property
    def definition(self) -> str:
        return "Σ exp(−λt) φ²"

    def range(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return shortest and longest time, in squared length units.

        An end that is None is chosen from the spectrum; ends in the wrong order are swapped.
        """
        t_min, t_max = spectrum.time_range
        if not self.automatic:
            t_min = self.t_min or t_min
            t_max = self.t_max or t_max
        return (t_min, t_max) if t_min < t_max else (t_max, t_min)

    def time_in(self, spectrum: Eigenpairs) -> float:
        """Return the chosen time, or the middle of the range in log scale."""
        if self.time is not None:
            return self.time
        t_min, t_max = self.range(spectrum)
        return math.sqrt(t_min) * math.sqrt(t_max)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        t_min, t_max = self.range(spectrum)
        time = self.time_in(spectrum)
        return replace(self, time=time, t_min=t_min, t_max=t_max, automatic=False)

    def within(self, spectrum: Eigenpairs) -> Self:
        low, high = self.range(spectrum)
        inside = self.time is not None and low <= self.time <= high
        return self if inside else replace(self, time=None)

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        time = self.time_in(spectrum)
        length = format_quantity(time**0.5, unit)
        return Description(f"{self._written(spectrum, unit)} (√t = {length})", self.label)

    def _written(self, spectrum: Eigenpairs, unit: str) -> str:
        """Format the time, in a unit that suits the middle of the range."""
        like = math.prod(self.range(spectrum)) ** 0.5
        return f"t = {format_quantity(self.time_in(spectrum), unit, 2, like=like)}"

    def reading(self, spectrum: Eigenpairs, unit: str) -> Reading:
        time, (low, high) = self.time_in(spectrum), self.range(spectrum)
        title, facts = self._written(spectrum, unit), (format_quantity(time**0.5, unit),)
        unresolved, mesh = self.unresolved(spectrum), spectrum.mesh
        alone = time < resolved_from(spectrum)  # the time may be outside the range
        if mesh is None or (unresolved is None and not alone):
            return Reading(title, facts)
        start, end = unresolved or (0.0, 0.0)
        wanted, what, upto = low, "The hatched part", "up to "
        if alone:
            wanted, what, upto = time, "This time", ""
        missing = float(spectrum.missing_shares(heat_kernel_bank([wanted]), mesh.area)[0])
        if missing <= TOLERANCE:
            return Reading(title, facts)
        needed = required_eigenvalue(wanted)
        warning = (
            f"{what} misses {upto}about {percent(missing)} of the signature for want of "
            f"eigenpairs. It takes those up to λ = {format_quantity(needed, unit, -2)}, "
            f"{estimated_pairs(spectrum, needed)}."
        )
        target, limit = spectrum.within_resolution(Target("time", wanted))
        warning = f"{warning} {limit}".rstrip()
        length = math.log10(high) - math.log10(low)
        hatched = (end - start) / length if length > 0.0 else 0.0
        return Reading(title, facts, warning, target, hatched=hatched)

    # -- values -------------------------------------------------------------------------------

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer:
        time = self.time_in(spectrum)
        if table is not None and not spectrum.small and table.content.covers(time):
            if table.spectrum is spectrum:
                return Answer(table.content.at(time))
            if grew(table.spectrum, spectrum):
                return Answer(table.content.at(time), draft=True)
        decay = np.exp(-spectrum.eigenvalues * time)
        return Answer(np.asarray(sum_squares(spectrum.rows, decay[None])[0]))

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        covers = table is not None and table.content.covers(*self.range(spectrum))
        return covers and table is not None and table.spectrum is spectrum

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        content = build_heat_table(spectrum, self.range(spectrum), cancel)
        return Table(spectrum, self.at_rest(), content)

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        return grew(table.spectrum, spectrum)

    # -- plots --------------------------------------------------------------------------------

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response:
        time = self.time_in(spectrum)
        return Response((along, np.exp(-along * time)), 1.0 / time, "exp(−λt), ╌ λ = 1/t")

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        """Set the time to the inverse of an eigenvalue."""
        if not value > 0.0:
            return self
        low, high = self.range(spectrum)
        return replace(self, time=min(max(1.0 / value, low), high))

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile:
        axes = named_quantity("Time t", unit, 2), named_quantity("HKS", unit, -2)
        fine, dots = (self._samples(spectrum, count) for count in (_FINE, self.scales))
        return Profile(fine, dots, axes, self.unresolved(spectrum))

    def _samples(self, spectrum: Eigenpairs, count: int) -> Samples:
        times = np.geomspace(*self.range(spectrum), count)
        decay = np.exp(-np.outer(times, spectrum.eigenvalues))
        return Samples(np.log10(times), decay, logarithmic=True)

    def places(self, spectrum: Eigenpairs) -> FloatArray:
        if first_nonzero(spectrum) >= len(spectrum):
            return np.empty(0)
        return evenly_in_log(self.range(spectrum), max(self.scales, 2))

    def place(self, spectrum: Eigenpairs) -> float:
        return math.log10(self.time_in(spectrum))

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        if first_nonzero(spectrum) >= len(spectrum):
            return self
        low, high = self.range(spectrum)
        return replace(self, time=min(max(10.0**place, low), high))

    def unresolved(self, spectrum: Eigenpairs) -> tuple[float, float] | None:
        """Return the range of log t that the computed pairs do not resolve."""
        low, high = self.range(spectrum)
        resolved = resolved_from(spectrum)
        if resolved <= low * (1.0 + 1e-9):
            return None
        return math.log10(low), math.log10(min(resolved, high))

    # -- files --------------------------------------------------------------------------------

    @classmethod
    def exported(cls, n_columns: int | None = None, unit: str | None = None, **chosen: Any) -> Self:
        check_times(chosen.get("t_min"), chosen.get("t_max"))
        return super().exported(n_columns, unit, automatic=not chosen, **chosen)

    def bank(
        self, eigenvalues: FloatArray, area: float | None = None, bound: float | None = None
    ) -> FilterBank:
        return heat_kernel_bank(hks_times(eigenvalues, self.t_min, self.t_max, self.scales, area))

    def contents(self, spectrum: Eigenpairs, unit: str) -> str:
        low, high = self.range(spectrum)
        return (
            f"Times from {format_quantity(low, unit, 2)} to {format_quantity(high, unit, 2)},"
            f" lengths √t from {format_quantity(low**0.5, unit)} to"
            f" {format_quantity(high**0.5, unit)}."
        )

    def bank_script(self) -> str:
        return f"mv.heat_kernel_bank(np.geomspace({self.t_min!r}, {self.t_max!r}, {self.scales}))"

    def script(self, spectrum: Eigenpairs) -> list[str]:
        return [
            *super().script(spectrum),
            f"shown = mv.compute_features(decomposition, mv.heat_kernel_bank([{self.time!r}]))",
            "values = shown.values[:, 0]",
        ]


def resolved_from(spectrum: Eigenpairs) -> float:
    """Return the shortest time at which computed pairs give HKS within 1 %; 0 with all pairs.

    See `meshmash_viewer.spectral.weyl.resolved_time`. The automatic range begins above this time.
    """
    if 0 < spectrum.n_vertices <= len(spectrum):
        return 0.0
    return resolved_time(max(float(spectrum.eigenvalues[-1]), spectrum.known_to))
