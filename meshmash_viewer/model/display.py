"""What is looked at: which field, at which index, time or band, and in which colours."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

from psygnal import SignalGroupDescriptor

from meshmash_viewer.model.limits import LimitPolicy

__all__ = ["MOST_BANDS", "MOST_SCALES", "Display", "FieldKind", "SimilarityBasis"]

#: Most times of a heat kernel signature, and most bands, that can be asked for.
MOST_SCALES, MOST_BANDS = 1024, 512


class FieldKind(StrEnum):
    """The families of fields that can be on the render."""

    EIGENFUNCTION = "eigenfunction"
    HKS = "hks"
    BAND = "band"
    SIMILARITY = "similarity"


class SimilarityBasis(StrEnum):
    """The features in which "similar to this" measures distance."""

    HKS = "hks"
    BANDS = "bands"


@dataclass
class Display:
    """Evented choices of what is drawn; every change of an attribute emits ``events.<name>``.

    Parameters
    ----------
    kind : FieldKind
    index : int
        Eigenfunction on the render, counted from 0.
    flipped : frozenset of int
        Indices of eigenfunctions drawn with the other sign.
    playing : bool
        Whether the index (or time, or band) advances by itself.
    time : float or None
        HKS time in squared length units; None is the middle of the range in log scale.
    hks_automatic : bool
        Whether the range comes from the spectrum (Sun et al. 2009) or from the next two.
    hks_t_min, hks_t_max : float or None
        Range of times in squared length units when not automatic.
    hks_scales : int
        Number of times in the exported feature and on the profile plot.
    band : int
        B-spline band on the render, counted from 0.
    band_count : int
    band_automatic : bool
        Whether bands span the whole computed spectrum or the next two.
    band_min, band_max : float or None
        Range of eigenvalues in inverse squared length units when not automatic.
    similarity_vertex : int or None
        Vertex from which distance in feature space is measured.
    similarity_basis : SimilarityBasis
    nodal_lines : bool
    diverging_colormap, sequential_colormap : str
        Colour map names (matplotlib's) for signed and for non-negative fields.
    limits : LimitPolicy or None
        None takes the policy that suits the field's kind.
    """

    events: ClassVar[SignalGroupDescriptor] = SignalGroupDescriptor()

    kind: FieldKind = FieldKind.EIGENFUNCTION
    index: int = 1
    flipped: frozenset[int] = field(default_factory=frozenset)
    playing: bool = False
    time: float | None = None
    hks_automatic: bool = True
    hks_t_min: float | None = None
    hks_t_max: float | None = None
    hks_scales: int = 32
    band: int = 0
    band_count: int = 32
    band_automatic: bool = True
    band_min: float | None = None
    band_max: float | None = None
    similarity_vertex: int | None = None
    similarity_basis: SimilarityBasis = SimilarityBasis.HKS
    nodal_lines: bool = False
    diverging_colormap: str = "RdBu_r"
    sequential_colormap: str = "viridis"
    limits: LimitPolicy | None = None
