"""Controls of each family of fields."""

from __future__ import annotations

from meshmash_viewer.app.tabs.form import FamilyForm, FamilyTab
from meshmash_viewer.app.tabs.map_tab import MapTab
from meshmash_viewer.app.tabs.pin_tabs import DistanceTab, SimilarityTab
from meshmash_viewer.app.tabs.spectral_tabs import EigenfunctionTab, FilterTab
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.filters import Filters
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.model.document import Document

#: Tabs of families with controls that a form does not have.
_OWN_TABS: dict[type[Family], type[FamilyTab]] = {
    Eigenfunctions: EigenfunctionTab,
    Filters: FilterTab,
    Similarity: SimilarityTab,
    Distances: DistanceTab,
    OwnMaps: MapTab,
}


def make_tab(document: Document, family: type[Family]) -> FamilyTab:
    """Return the controls of a family: its own tab, or a form."""
    return _OWN_TABS.get(family, FamilyForm)(document, family)
