"""What is computed once of the maps of a mesh, and kept: spectra, means, sums, labels of bands."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from meshmash_viewer.arrays import FloatArray
from meshmash_viewer.features.map_spectrum import MapSpectrum, band_edges
from meshmash_viewer.features.sums import fill_in_parts
from meshmash_viewer.fields.family import ColumnArray
from meshmash_viewer.fields.pair_table import PairTable
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.weyl import wavelength
from meshmash_viewer.units import format_quantity
from meshmash_viewer.vertex_map import Label, VertexMap

#: Key of the means of maps in `Mesh.derived`.
MEANS = "means of maps"
#: Key of the spectra of maps in `Mesh.derived`, with their pairs.
_PROJECTED = "spectra of maps"


def projected(
    spectrum: Eigenpairs,
) -> WeakKeyDictionary[VertexMap, tuple[Eigenpairs, MapSpectrum]]:
    """Return spectra by map: written in the computing thread, read in the main thread."""
    return WeakKeyDictionary() if spectrum.mesh is None else kept_by_map(spectrum.mesh, _PROJECTED)


def kept_by_map(mesh: Mesh, name: str) -> WeakKeyDictionary[VertexMap, Any]:
    """Return a cache by map.

    It is stored with the mesh, since entries refer to pairs, these to the mesh, and the mesh to the
    maps: in an object that outlives the mesh, entries would never be freed.
    """
    known: WeakKeyDictionary[VertexMap, Any] = mesh.derived.setdefault(name, WeakKeyDictionary())
    return known


def mean_over(mesh: Mesh, values: FloatArray) -> float:
    """Compute the mean over the surface where there are values."""
    weights = mesh.vertex_areas * np.isfinite(values)
    total = weights.sum()
    return float(weights @ np.nan_to_num(values) / total) if total > 0.0 else np.nan


class MapSums:
    """The spectrum of a map, and its sum over the lowest pairs, updated from the last one."""

    def __init__(self, spectrum: MapSpectrum, bands: ColumnArray | None) -> None:
        self.spectrum = spectrum
        self.bands = bands
        self._last: tuple[int, FloatArray | None] = 0, None
        #: Table of approximate filtered sums, once one has been requested.
        self.near: PairTable | None = None

    def up_to(self, count: int, rows: Any) -> ColumnArray:
        """Compute the sum over a number of pairs by adding or subtracting the difference."""
        known, total = self._last
        if total is None or abs(count - known) > count:
            known, total = 0, np.zeros(rows.shape[1])
        first, last = sorted((count, known))
        change = self.spectrum.coefficients[first:last] * (1.0 if count >= known else -1.0)
        shown = np.empty(len(total), dtype=np.float32)

        def fill(part: slice) -> None:
            total[part] += change @ rows[first:last, part]
            shown[part] = total[part]

        fill_in_parts(len(total), fill)
        self._last = count, total
        return shown


def band_labels(eigenvalues: FloatArray, unit: str) -> tuple[Label, ...]:
    """Return a label for each band, with its wavelengths, from yellow (long) to violet."""
    from matplotlib import colormaps

    edges = [wavelength(float(edge)) for edge in band_edges(eigenvalues)]
    shades = colormaps["viridis_r"](np.linspace(0.0, 1.0, max(len(edges) - 1, 1)), bytes=True)
    return tuple(
        Label(
            at,
            f"{format_quantity(edges[at], unit)} to {format_quantity(edges[at + 1], unit)}",
            "#" + "".join(f"{part:02x}" for part in shades[at][:3].tolist()),
        )
        for at in range(len(edges) - 1)
    )
