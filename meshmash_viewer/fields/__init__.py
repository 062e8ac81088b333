"""Families of fields: one file each, listed here once.

Window, export, command line, sessions and the copied script read this table and know no family
by name. To add one: its file here, its controls in ``app/tabs``, and a line below.
"""

from __future__ import annotations

from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.fields.wks import WaveKernelSignature

__all__ = ["EXPORTS", "FAMILIES", "FEATURES"]

_LISTED: tuple[type[Family], ...] = (
    Eigenfunctions,
    HeatKernelSignature,
    GeometryVectors,
    WaveKernelSignature,
    Filters,
    Similarity,
    Distances,
    OwnMaps,
)

#: By name, as the window shows them; the first is shown unless another is chosen.
FAMILIES: dict[str, type[Family]] = {family.name: family for family in _LISTED}

#: Those that have columns, by name.
FEATURES: dict[str, type[Family]] = {
    name: family for name, family in FAMILIES.items() if family.counted
}

_WRITTEN = (*FEATURES.values(), *FAMILIES.values())

#: By kind of export, features before eigenpairs.
EXPORTS: dict[str, type[Family]] = {each.export: each for each in _WRITTEN if each.export}
