"""Family of maps: values per vertex, curvatures, and their expansion in eigenpairs."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Self

import numpy as np
from msgspec import Meta

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.errors import InputError, unknown
from meshmash_viewer.features.filter_responses import TailedResponse
from meshmash_viewer.features.map_spectrum import (
    MapSpectrum,
    dominant_bands,
    project,
)
from meshmash_viewer.fields.family import (
    Answer,
    Cancel,
    ColumnArray,
    Description,
    Family,
    Profile,
    Response,
    Samples,
    Table,
)
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.live_tables import (
    MEANS,
    MapSums,
    band_labels,
    build_pair_table,
    kept_by_map,
    mean_over,
    projected,
    summed,
)
from meshmash_viewer.fields.parameter import MOST_INDEX, Finite, Name, parameter
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs, grew, same_pairs
from meshmash_viewer.surface.curvature import DIRECTION_FAULT
from meshmash_viewer.units import counted, format_range, format_share, power_unit
from meshmash_viewer.vertex_map import VertexMap

#: Maps of every mesh: power of length in their unit, name of the public function, and formula.
CURVATURES: dict[str, tuple[int, str, str]] = {
    "Mean curvature": (-1, "mean_curvature", "(κ₁ + κ₂) / 2"),
    "Gaussian curvature": (-2, "gaussian_curvature", "κ₁ κ₂"),
}
#: Views of a map.
VIEWS = {
    "map": "Map",
    "pairs": "From pairs",
    "residual": "Residual",
    "filter": "Filtered",
    "band": "Dominant band",
}
_FORMULAS = {
    "pairs": "Σ φ φᵀ M f",
    "residual": "f − Σ φ φᵀ M f",
    "filter": "Σ h(λ) φ φᵀ M f",
    "band": "octave of λ with the largest |Σ φ φᵀ M f|",
}
#: Smallest missing share of a filtered map that is displayed.
_SAID = 1e-3
#: Views that depend on the number of pairs.
SUMS = ("pairs", "residual")


@lru_cache(maxsize=16)  # called several times per slider step
def _passed(chosen: Filters, last: float) -> float:
    """Return the supremum of a resolved filter beyond an eigenvalue, in up to 0.7 ms."""
    response = chosen.bank(np.array([last])).response
    assert isinstance(response, TailedResponse)
    return float(response.supremum(last)[0])


@dataclass(frozen=True)
class OwnMaps(Family):
    """One map of the mesh, or its expansion in eigenpairs."""

    name = "map"
    label = "Own maps"
    page = "maps"
    short = "Own maps"
    tip = "Values per vertex from a file, and the curvature of the mesh"
    icon = '<path d="M3 6l6-2 6 2 6-2v14l-6 2-6-2-6 2z"/><path d="M9 4v14M15 6v14"/>'
    position = ("pairs", "view", "filter", "centred", "colors")
    own = ("chosen",)
    response_label = "Relative energy"
    response_noun = "Map"
    response_decades = 6
    tailed = True
    interval = 250

    #: Name of the map; if it does not exist, the first map is used.
    chosen: str = parameter(
        "",
        Name,
        option="map_name",
        metavar="NAME",
        help="name of a map of the mesh or of a file, or of a curvature",
    )
    #: A key of `VIEWS`: the map, its sum over the lowest pairs, the residual, the sum with the
    #: filter of `Filters`, or the strongest band at each vertex.
    view: str = parameter(
        "map",
        str,
        labels=VIEWS,
        option="view",
        offered=("map", "pairs", "band"),
        help="map: the map itself, each map is a column; pairs: its sum over the lowest pairs, a"
        " column for each number of pairs; band: the dominant band at each vertex",
    )
    #: Number of the lowest pairs.
    pairs: int = parameter(30, Annotated[int, Meta(ge=1, le=MOST_INDEX)])
    #: Automatic limits, by name, of maps that are copies of fields: low, high, 1 if logarithmic,
    #: and 1 if signed.
    colors: tuple[tuple[str, tuple[float, ...]], ...] = parameter(
        (), dict[str, tuple[Finite, Finite, Finite, Finite]]
    )
    #: The map, set by `resolved`; None for a curvature, which is computed on demand.
    shown: VertexMap | None = None
    #: The filter of a filtered map, set by `resolved`.
    filter: Filters | None = None
    #: Whether the values exclude the mean of the map, set by `resolved`.
    centred: bool = False

    # -- choices ------------------------------------------------------------------------------

    @property
    def definition(self) -> str:
        if self.view != "map":
            return _FORMULAS[self.view]
        return CURVATURES[self.chosen][2] if self.chosen in CURVATURES and not self.shown else ""

    @property
    def needs_pairs(self) -> bool:
        return False

    @property
    def of_pairs(self) -> bool:
        return self.view != "map"

    @property
    def signed(self) -> bool:
        if self.view == "band":
            return False
        return self.centred or self._map_signed

    @property
    def _kept(self) -> tuple[float, ...]:
        """Entry of the map in `colors`; empty without one."""
        return () if self.shown is None else dict(self.colors).get(self.chosen, ())

    @property
    def limits_key(self) -> str:
        return f"{self.name}:{self.chosen}"

    @property
    def given_limits(self) -> tuple[float, float, bool] | None:
        if not self._kept or self.view == "band":
            return None
        low, high, logarithmic, _ = self._kept
        return low, high, bool(logarithmic)

    @property
    def _map_signed(self) -> bool:
        if self._kept:
            return bool(self._kept[3])
        return self.chosen in CURVATURES if self.shown is None else self.shown.signed

    def limits_of(self, spectrum: Eigenpairs) -> tuple[ColumnArray, bool] | None:
        """Return the values of the map, which determine the limits of all views except bands."""
        shown = self.vertex_map(spectrum) if self.view in (*SUMS, "filter") else None
        return None if shown is None else (shown.shown, self._map_signed)

    def resolved(self, spectrum: Eigenpairs, chosen: Mapping[str, Family]) -> Self:
        maps = {} if spectrum.mesh is None else {each.name: each for each in spectrum.mesh.maps}
        names = [*maps, *CURVATURES]
        name = self.chosen if self.chosen in names else names[0]
        shown = maps.get(name)
        # other views need pairs, and values instead of labels
        view = self.view if len(spectrum) and not (shown and shown.labels) else "map"
        pairs = self.within(spectrum).pairs if view in SUMS else 1
        passed = chosen.get(Filters.name) if view == "filter" else None
        through = passed.resolved(spectrum, chosen) if isinstance(passed, Filters) else None
        # a filter that removes more than half of the constant centres the values
        centred = view == "residual" or (
            through is not None and bool(abs(through.weights(spectrum)[0]) < 0.5)
        )
        return replace(
            self,
            chosen=name,
            view=view,
            pairs=pairs,
            shown=shown,
            filter=through,
            centred=centred,
        )

    def within(self, spectrum: Eigenpairs) -> Self:
        return replace(self, pairs=min(max(self.pairs, 1), max(len(spectrum), 1)))

    def step(self, spectrum: Eigenpairs, steps: int) -> Self:
        """Change the number of pairs of a sum; in other views, select another map."""
        if self.view in SUMS and len(spectrum):
            return replace(self, pairs=self.within(spectrum).pairs + steps).within(spectrum)
        own = () if spectrum.mesh is None else spectrum.mesh.maps
        names = [*(each.name for each in own), *CURVATURES]
        at = names.index(self.resolved(spectrum, {}).chosen)
        return replace(self, chosen=names[min(max(at + steps, 0), len(names) - 1)])

    # -- values -------------------------------------------------------------------------------

    def describe(self, spectrum: Eigenpairs, unit: str) -> Description:
        quantity = self._quantity(spectrum, unit)
        caption = quantity if self.view in SUMS else self.chosen
        view = "" if self.view in ("map", "pairs") else f", {VIEWS[self.view].lower()}"
        title = self.chosen + view
        if self.view == "band":
            labels = band_labels(spectrum.eigenvalues, unit)
            return Description(quantity, title, 0, caption=caption, labels=labels)
        if self.shown is None:
            return Description(quantity, title, CURVATURES[self.chosen][0], caption=caption)
        labels = self.shown.labels if self.view == "map" else ()
        return Description(quantity, title, 0, self.shown.unit, caption, labels)

    def _quantity(self, spectrum: Eigenpairs, unit: str) -> str:
        known = self.map_spectrum(spectrum)
        if self.view in SUMS:
            share = math.nan if known is None else known.varying_share(self.pairs)
            word = "from"
            if self.view == "residual":
                share, word = 1.0 - share, "without"
            text = f"{word} {counted(self.pairs, 'pair')}"
            return text if known is None else f"{text}: {format_share(share)} of what varies"
        pairs = counted(len(spectrum), "pair")
        if self.filter is not None:
            text = f"with {pairs} through {self.filter.describe(spectrum, unit).quantity}"
            share = self.missing(spectrum)[1]
            if not share >= _SAID:
                return text
            return f"{text}: up to {format_share(share)} of what varies is missing"
        if self.view == "band":
            return f"from {pairs}, in {len(band_labels(spectrum.eigenvalues, unit))} octaves of λ"
        shown = self.vertex_map(spectrum)
        if shown is None:
            return ""
        if shown.labels:
            return counted(len(shown.labels), "label")
        text = format_range(*shown.range, shown.unit, word="to", digits=4)
        signed = self.shown is None and CURVATURES[self.chosen][1] == "mean_curvature"
        if signed and spectrum.mesh is not None and spectrum.mesh.derived.get(DIRECTION_FAULT):
            return f"{text}, unreliable: faces do not agree on which side is outside"
        return text

    def compute(self, spectrum: Eigenpairs, table: Table | None) -> Answer | None:
        """Compute values; a draft, or None, until the spectrum of the map is computed."""
        ready = self.prepared(spectrum, table)
        if self.view == "map":
            return Answer(self._shown_map(spectrum).shown, not ready)
        if table is None or not (ready or self.serves(spectrum, table)):
            return None
        content: MapSums = table.content
        if self.view == "band":
            assert content.bands is not None
            return Answer(content.bands, not ready)
        if self.filter is not None:
            weights = self.filter.weights(spectrum)[: len(content.spectrum)]
            if content.near is not None:
                answer = content.near.answer(weights, spectrum.rows)
                return replace(answer, draft=answer.draft or not ready)
            return Answer(summed(weights, spectrum.rows, content.spectrum.coefficients), not ready)
        total = content.up_to(min(self.pairs, len(content.spectrum)), spectrum.rows)
        if self.view == "residual":
            total = self._shown_map(spectrum).shown - total
        return Answer(total, not ready)

    def prepared(self, spectrum: Eigenpairs, table: Table | None) -> bool:
        if not len(spectrum) or self._labelled:
            return True
        if table is None or not table.holds(self.at_rest(), spectrum):
            return False
        if self.filter is not None and not spectrum.small:
            near = table.content.near
            return near is not None and bool(near.rests(self.filter.weights(spectrum)))
        return self.view != "band" or table.content.bands is not None

    def prepare(self, spectrum: Eigenpairs, cancel: Cancel, before: Table | None = None) -> Table:
        if before is not None and before.holds(self.at_rest(), spectrum):
            return self._resting(before, cancel)
        values = self._shown_map(spectrum)
        mass = spectrum.vertex_areas
        found = project(spectrum.eigenvalues, spectrum.rows, mass, values.values, cancel)
        projected(spectrum)[values] = spectrum, found
        bands = None
        if self.view == "band":
            strongest = dominant_bands(found, spectrum.rows, cancel).astype(np.float32)
            nowhere = (strongest < 0) | ~np.isfinite(values.shown)
            bands = np.where(nowhere, np.float32(np.nan), strongest)
        return self._resting(Table(spectrum, self.at_rest(), MapSums(found, bands)), cancel)

    def _resting(self, table: Table, cancel: Cancel) -> Table:
        """Add to a table the exact sum of the present filter, and a `PairTable`."""
        if self.filter is not None and not table.spectrum.small:
            content, spectrum = table.content, table.spectrum
            near = content.near or build_pair_table(spectrum, cancel, content.spectrum.coefficients)
            content.near = near.rest(self.filter.weights(spectrum), spectrum.rows, cancel)
        return table

    def serves(self, spectrum: Eigenpairs, table: Table) -> bool:
        known: OwnMaps = table.family  # type: ignore[assignment]
        same = (known.chosen, known.shown) == (self.chosen, self.shown)
        has_bands = self.view != "band" or table.content.bands is not None
        return same and has_bands and grew(table.spectrum, spectrum)

    @property
    def _labelled(self) -> bool:
        return self.shown is not None and bool(self.shown.labels)

    def vertex_map(self, spectrum: Eigenpairs) -> VertexMap | None:
        """Return the map; None for a curvature that has not been computed."""
        resolved = self if self.shown is not None else self.resolved(spectrum, {})
        if resolved.shown is not None or spectrum.mesh is None:
            return resolved.shown
        return spectrum.mesh.derived.get((resolved.chosen, spectrum.mesh.unit))

    def map_spectrum(self, spectrum: Eigenpairs) -> MapSpectrum | None:
        """Return the coefficients of the map for a spectrum; None until they are computed."""
        shown = self.vertex_map(spectrum)
        found = None if shown is None else projected(spectrum).get(shown)
        if shown is None or found is None or not same_pairs(found[0], spectrum):
            return None
        projected(spectrum)[shown] = spectrum, found[1]  # identical spectra are compared faster
        return found[1]

    def missing(self, spectrum: Eigenpairs) -> tuple[float, float]:
        """Return bounds of the part of a filtered map f beyond the K computed pairs.

        Returns
        -------
        passed : float
            The supremum of the filter |h| beyond the last eigenvalue.
        share : float
            Bound of its squared norm, relative to the map without its mean: with f_K the sum over
            the pairs, ``‖h(L) (f - f_K)‖ <= passed ‖f - f_K‖``. Both are NaN without coefficients.
        """
        known = self.map_spectrum(spectrum)
        if known is None or self.filter is None:
            return math.nan, math.nan
        passed = _passed(replace(self.filter, count=1), float(spectrum.eigenvalues[-1]))
        return passed, min(passed**2 * (1.0 - known.varying_share(len(known))), 1.0)

    def mean(self, spectrum: Eigenpairs) -> float:
        """Return the area-weighted mean of the map where it has values.

        NaN before the map is first shown, for labels, and without values on the surface.
        """
        shown, mesh = self.vertex_map(spectrum), spectrum.mesh
        if shown is None or mesh is None:
            return np.nan
        return float(kept_by_map(mesh, MEANS).get(shown, np.nan))

    def _shown_map(self, spectrum: Eigenpairs) -> VertexMap:
        """Return the map; a curvature is computed on first use."""
        known, mesh = self.vertex_map(spectrum), spectrum.mesh
        if known is None:
            from meshmash_viewer.surface import curvature  # loads SciPy

            assert mesh is not None
            power, function, _ = CURVATURES[self.chosen]
            values = getattr(curvature, function)(mesh)
            known = VertexMap(self.chosen, values, unit=power_unit(mesh.unit, power))
            mesh.derived[self.chosen, mesh.unit] = known
        means = {} if mesh is None else kept_by_map(mesh, MEANS)
        if mesh is not None and not known.labels and known not in means:
            means[known] = mean_over(mesh, known.values)
        return known

    # -- plots --------------------------------------------------------------------------------

    def response(self, spectrum: Eigenpairs, along: FloatArray) -> Response | None:
        """Return the spectrum |ΦᵀMf|² of the map, a line for each pair, relative to the largest."""
        known = self.map_spectrum(spectrum)
        if known is None:
            return None
        squares = np.square(known.coefficients)
        largest = max(float(squares[known.n_zeros :].max(initial=0.0)), 1e-300)
        heights = 1.0 + np.log10(np.maximum(squares / largest, 1e-300)) / self.response_decades
        lines = np.zeros((len(squares), 3))
        lines[:, 1] = np.clip(heights, 0.0, 1.0)
        count = self.within(spectrum).pairs
        legend = f"|Φᵀ M f|², f = {html.escape(self.resolved(spectrum, {}).chosen)}"
        held = None if self.view == "filter" else float(known.eigenvalues[count - 1])
        curve = np.repeat(known.eigenvalues, 3), lines.ravel()
        return Response(curve, held, legend)

    def at_eigenvalue(self, spectrum: Eigenpairs, value: float) -> Self:
        """Select the number of pairs up to an eigenvalue."""
        count = int(np.searchsorted(spectrum.eigenvalues, value * (1.0 + 1e-9), side="right"))
        return self._summed(count).within(spectrum)

    def place(self, spectrum: Eigenpairs) -> float:
        return float(self.within(spectrum).pairs - 1)

    def at_place(self, spectrum: Eigenpairs, place: float) -> Self:
        return self._summed(round(place) + 1).within(spectrum)

    def _summed(self, pairs: int) -> Self:
        return replace(self, view=self.view if self.view in SUMS else "pairs", pairs=pairs)

    def profile(self, spectrum: Eigenpairs, unit: str) -> Profile | None:
        """Return the profile: the contribution of each pair at a vertex."""
        known = self.map_spectrum(spectrum)
        if known is None:
            return None
        both = Samples(np.arange(len(known), dtype=np.float64), known.coefficients)
        return Profile(both, both, ("Index", "Share of the map"))

    # -- files --------------------------------------------------------------------------------

    def check_mesh(self, mesh: Mesh) -> None:
        names = [*(each.name for each in mesh.maps), *CURVATURES]
        if self.chosen and self.chosen not in names:
            raise unknown("map", self.chosen, names)
        shown = next((each for each in mesh.maps if each.name == (self.chosen or names[0])), None)
        if self.view != "map" and shown is not None and shown.labels:
            fault = f"{shown.name} contains labels, which have no expansion in eigenpairs"
            raise InputError("labels-not-values", fault, "omit --view, or choose another map")

    def script(self, spectrum: Eigenpairs) -> list[str]:
        if self.shown is None:
            lines = [f"values = mv.{CURVATURES[self.chosen][1]}(mesh)"]
        else:
            lines = [f"values = mesh.map_named({self.chosen!r}).values"]
        if self.view == "map":
            return lines
        lines.append("spectrum = mv.map_spectrum(decomposition, values)")
        if self.view == "band":
            return [*lines, "values = mv.dominant_bands(spectrum, decomposition.rows)"]
        if self.filter is not None:
            return [
                *lines,
                f"filtered = {replace(self.filter, count=1).bank_script()}(spectrum.eigenvalues)[0]"
                " * spectrum.coefficients",
                "values = mv.reconstruct(decomposition.eigenvectors, filtered)",
            ]
        left = "values - " if self.view == "residual" else ""
        return [
            *lines,
            f"print(spectrum.share({self.pairs}), spectrum.residual({self.pairs}))",
            f"lowest = spectrum.coefficients[:{self.pairs}]",
            f"values = {left}mv.reconstruct(decomposition.eigenvectors, lowest)",
        ]
