"""The field on the render: what was asked for, and its values at every vertex."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshmash_viewer.model.display import FieldKind, SimilarityBasis
from meshmash_viewer.model.limits import LimitPolicy, automatic_limits
from meshmash_viewer.model.ranges import band_range, hks_range, hks_time
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.units import format_quantity, power_unit, subscript

if TYPE_CHECKING:
    from meshmash_viewer.model.document import Document
    from meshmash_viewer.model.live import LiveFeatures

__all__ = ["Field", "FieldRequest", "compute_field", "request_of", "title_of"]


@dataclass(frozen=True)
class FieldRequest:
    """One field of one spectrum; equal requests give equal fields.

    Attributes that do not matter to `kind` are at their defaults, so that a change of them makes
    no difference.

    Parameters
    ----------
    spectrum : Spectrum
        Compared by identity.
    unit : str
        Length unit of the mesh.
    kind : FieldKind
    index : int
        Eigenfunction, counted from 0.
    flipped : bool
    time : float
        HKS time in squared length units.
    times : tuple of float
        Range of HKS times, shortest and longest.
    scales : int
        Number of times that similarity is measured in.
    band, band_count : int
        Band, counted from 0, and the number of them.
    eigenvalues : tuple of float
        Range of the bands, in inverse squared length units.
    vertex : int
        From which similarity is measured.
    basis : SimilarityBasis
    sample : ndarray of int64, optional
        Vertices that limits are taken over; makes no difference to the values.
    places : ndarray of float64, shape (n, 3), optional
        Coordinates of the mesh, which tell one mesh from another with as many vertices.
    """

    spectrum: Spectrum
    unit: str
    kind: FieldKind
    index: int = 0
    flipped: bool = False
    time: float = 0.0
    times: tuple[float, float] = (0.0, 0.0)
    scales: int = 0
    band: int = 0
    band_count: int = 0
    eigenvalues: tuple[float, float] = (0.0, 0.0)
    vertex: int = -1
    basis: SimilarityBasis = SimilarityBasis.HKS
    sample: npt.NDArray[np.int64] | None = field(default=None, compare=False, repr=False)
    places: npt.NDArray[np.float64] | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, eq=False)
class Field:
    """Values at every vertex, with all that is said about them.

    Parameters
    ----------
    values : ndarray of float32, shape (n,)
        In `unit`; NaN where a vertex is on no face.
    request : FieldRequest
        What they answer.
    title : str
        "Eigenfunction 5", "Heat kernel signature".
    quantity : str
        Which one, with its unit: "λ₅ = 1.2e-08 nm⁻²", "t = 3.1e+05 nm² (√t = 557 nm)".
    unit : str
        Of the values; empty for pure numbers and for meshes without a unit.
    signed : bool
        Whether zero is in the middle of the values rather than at their end.
    draft : bool
        Whether a better answer to the same request is on its way.
    ends : tuple of float, optional
        Smallest and largest value, NaN if one is, where they are known.
    """

    values: npt.NDArray[np.float32] = field(repr=False)
    request: FieldRequest = field(repr=False)
    title: str = ""
    quantity: str = ""
    unit: str = ""
    signed: bool = False
    draft: bool = False
    ends: tuple[float, float] | None = None
    _limits: dict[LimitPolicy, tuple[float, float]] = field(default_factory=dict, repr=False)

    def limits(self, policy: LimitPolicy | None) -> tuple[float, float]:
        """Limits of the colours under a policy, computed once.

        Parameters
        ----------
        policy : LimitPolicy or None
            None takes the one that suits the field.
        """
        policy = policy or automatic_limits(signed=self.signed)
        known = self._limits.get(policy)
        if known is None:
            known = self._limits[policy] = policy.limits(
                self.values, self.request.sample, self.ends
            )
        return known

    @property
    def complete(self) -> bool:
        """Whether there is a value at every vertex."""
        return self.request.spectrum.has_all_vertices

    @property
    def kind(self) -> FieldKind:
        """The family it belongs to."""
        return self.request.kind

    @property
    def index(self) -> int:
        """Eigenfunction, counted from 0."""
        return self.request.index

    @property
    def time(self) -> float:
        """HKS time in squared length units."""
        return self.request.time

    @property
    def band(self) -> int:
        """Band, counted from 0."""
        return self.request.band


def request_of(document: Document) -> FieldRequest | None:
    """Snapshot of what a document wants on its render; None while there is nothing to show."""
    spectrum, display, ready = document.spectrum, document.display, document.ready
    if spectrum is None or len(spectrum) == 0 or ready is None:
        return None
    unit, sample, places = ready.mesh.unit, ready.sample, ready.mesh.vertices
    if display.kind is FieldKind.HKS:
        return FieldRequest(
            spectrum,
            unit,
            FieldKind.HKS,
            time=hks_time(spectrum, display),
            times=hks_range(spectrum, display),
            sample=sample,
            places=places,
        )
    if display.kind is FieldKind.BAND:
        return FieldRequest(
            spectrum,
            unit,
            FieldKind.BAND,
            band=min(max(display.band, 0), display.band_count - 1),
            band_count=display.band_count,
            eigenvalues=band_range(spectrum, display),
            sample=sample,
            places=places,
        )
    if display.kind is FieldKind.SIMILARITY and display.similarity_vertex is not None:
        vertex = display.similarity_vertex
        if display.similarity_basis is SimilarityBasis.HKS:
            return FieldRequest(
                spectrum,
                unit,
                FieldKind.SIMILARITY,
                times=hks_range(spectrum, display),
                scales=display.hks_scales,
                vertex=vertex,
                sample=sample,
                places=places,
            )
        return FieldRequest(
            spectrum,
            unit,
            FieldKind.SIMILARITY,
            band_count=display.band_count,
            eigenvalues=band_range(spectrum, display),
            vertex=vertex,
            basis=SimilarityBasis.BANDS,
            sample=sample,
            places=places,
        )
    index = min(max(display.index, 0), len(spectrum) - 1)
    flipped = index in display.flipped
    return FieldRequest(
        spectrum,
        unit,
        FieldKind.EIGENFUNCTION,
        index=index,
        flipped=flipped,
        sample=sample,
        places=places,
    )


def compute_field(request: FieldRequest, live: LiveFeatures) -> Field | None:
    """Compute the values a request asks for.

    Parameters
    ----------
    request : FieldRequest
    live : LiveFeatures
        Tables that make features cheap; where it has none yet, the pairs are summed directly.

    Returns
    -------
    Field or None
        None if `live` has to be prepared first.
    """
    values: npt.NDArray[np.float32] | None
    ends: tuple[float, float] | None = None
    if request.kind is FieldKind.HKS:
        values, draft = live.heat_kernel(request)
    elif request.kind is FieldKind.BAND:
        values, draft = live.band(request)
    elif request.kind is FieldKind.SIMILARITY:
        values, draft = live.similarity(request)
    else:
        values, ends = eigenfunction(request)
        draft = not request.spectrum.is_exact(request.index)
    if values is None:
        return None
    return Field(
        values,
        request,
        title=title_of(request),
        quantity=_quantity(request),
        unit=_unit(request),
        signed=request.kind is FieldKind.EIGENFUNCTION,
        draft=draft,
        ends=ends,
    )


def eigenfunction(
    request: FieldRequest,
) -> tuple[npt.NDArray[np.float32], tuple[float, float]]:
    """One row of the spectrum in single precision, in the sign asked for.

    Returns
    -------
    values : ndarray of float32, shape (n,)
    ends : tuple of float
        Smallest and largest of them.
    """
    values = np.array(request.spectrum.shown_rows[request.index], dtype=np.float32)
    if request.flipped:
        np.negative(values, out=values)
    return values, (float(values.min()), float(values.max()))


def title_of(request: FieldRequest) -> str:
    """What the field asked for is called on the render."""
    if request.kind is FieldKind.EIGENFUNCTION:
        return f"Eigenfunction {request.index}"
    if request.kind is FieldKind.HKS:
        return "Heat kernel signature"
    if request.kind is FieldKind.BAND:
        return f"Geometry vector {request.band}"
    features = "heat kernel signature"
    if request.basis is SimilarityBasis.BANDS:
        features = "geometry vectors"
    return f"Distance in {features}"


def _quantity(request: FieldRequest) -> str:
    unit = request.unit
    if request.kind is FieldKind.EIGENFUNCTION:
        spectrum = request.spectrum
        name = "λ" + subscript(request.index)
        written = format_quantity(float(spectrum.eigenvalues[request.index]), unit, -2)
        if spectrum.is_exact(request.index):
            return f"{name} = {written}"
        # on the render too, and so on every picture that is made of it
        return f"{name} ≈ {written} · preview, within about {100.0 * spectrum.error:.0f} %"
    if request.kind is FieldKind.HKS:
        time = format_quantity(request.time, unit, 2)
        return f"t = {time} (√t = {format_quantity(request.time**0.5, unit)})"
    if request.kind is FieldKind.BAND:
        low, high = band_support(request)
        return f"λ from {format_quantity(low, '')} to {format_quantity(high, unit, -2)}"
    return f"from vertex {request.vertex:,}"


def band_support(request: FieldRequest) -> tuple[float, float]:
    """Eigenvalues between which the band asked for is not zero.

    Uniform cubic B-splines: each spans four intervals between knots, of which
    ``band_count - 3`` lie within the range.
    """
    low, high = request.eigenvalues
    step = (high - low) / max(request.band_count - 3, 1)
    first = low + (request.band - 3) * step
    return max(first, low), min(first + 4.0 * step, high)


def _unit(request: FieldRequest) -> str:
    """Unit of the values: eigenvectors are M-orthonormal, so φ² is per area."""
    if request.kind is FieldKind.EIGENFUNCTION:
        return power_unit(request.unit, -1)
    return "" if request.kind is FieldKind.SIMILARITY else power_unit(request.unit, -2)
