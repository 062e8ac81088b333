"""Table of families of fields.

Window, export, command line, sessions and the copied script use this table; none of them refers to
a family by name. To add a family, add its file to this folder and a line below; its
controls are made from its parameters. Other packages add families by entry points.
"""

from __future__ import annotations

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.fields.bank_columns import FEATURES as FEATURES
from meshmash_viewer.fields.bank_columns import BankColumns, BankFamily
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.sihks import ScaleInvariantHKS
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.fields.wks import WaveKernelSignature
from meshmash_viewer.plug_ins import plug_ins, warn

_LISTED: tuple[type[Family], ...] = (
    Eigenfunctions,
    HeatKernelSignature,
    GeometryVectors,
    WaveKernelSignature,
    ScaleInvariantHKS,
    Filters,
    Similarity,
    Distances,
    OwnMaps,
)


def _check_plug_in(name: str, family: type[BankColumns]) -> None:
    if not (isinstance(family, type) and issubclass(family, BankColumns)):
        raise TypeError("it is not a subclass of BankColumns")
    texts = [getattr(family, each, None) for each in ("name", "label", "short", "tip", "export")]
    if texts[0] != name or not all(isinstance(each, str) and each for each in texts):
        raise TypeError("its name is not that of its entry point, or a text is missing")
    options = any(each.option for each in family.declared().values())
    if options or family.export in {each.export for each in _LISTED}:
        raise TypeError("it has options, or is exported as another family is")
    some = np.arange(8.0)
    made = family(index=0, count=3).bank(some)(some)
    if made.shape != (3, 8):
        raise TypeError(f"its bank makes shape {made.shape} of 3 columns and 8 eigenvalues")


#: Families by name, in the order of the window; the first one is the default.
FAMILIES: dict[str, type[Family]] = {family.name: family for family in _LISTED}
for _plug_in in plug_ins("fields", FAMILIES, _check_plug_in).values():
    try:
        FAMILIES[_plug_in.name] = _plug_in.load()
    except InputError as _fault:
        warn(_fault)

FEATURES.update((name, each) for name, each in FAMILIES.items() if issubclass(each, BankFamily))

_WRITTEN = (*FEATURES.values(), *FAMILIES.values())

#: Families by kind of export, features before eigenpairs.
EXPORTS: dict[str, type[Family]] = {each.export: each for each in _WRITTEN if each.export}
