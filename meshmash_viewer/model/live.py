"""Features of the displayed spectrum at a cost that does not grow with the number of pairs.

A request is answered from a table where there is one, and by the direct sum where there is not;
`LiveFeatures.prepare` builds the table that makes the next requests of its kind cheap. Both may
be called from different threads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.model.display import FieldKind, SimilarityBasis
from meshmash_viewer.model.heat_table import HeatTable, build_heat_table
from meshmash_viewer.model.similarity import SimilarityTable, build_similarity_table
from meshmash_viewer.model.spectrum import Spectrum
from meshmash_viewer.model.squares import sum_squares
from meshmash_viewer.progress import CancelCallback

if TYPE_CHECKING:
    from meshmash_viewer.features.filters import FilterBank
    from meshmash_viewer.model.field import FieldRequest

__all__ = ["LiveFeatures", "expected_bytes"]

ColumnArray: TypeAlias = npt.NDArray[np.float32]

#: Numbers read (pairs times vertices) by a direct sum that nobody feels.
_SMALL = 3_000_000
#: Columns of a usual heat table, of 16 bits, and fields in use at one time: the one drawn, the one
#: before it, the one being computed, the one that may be asked for next.
_HEAT_COLUMNS, _FIELDS = 58, 4


def expected_bytes(n_vertices: int, band_count: int = 32) -> int:
    """Bytes that a window holds for fields and live features of a mesh.

    ``4 n (58 / 2 + bands + 32 / 2 + 4)``: heat table in 16 bits, band table, similarity table
    (at most one column a feature, in 16 bits), fields. Eigenpairs are mapped from the store and
    are not counted.
    """
    columns = _HEAT_COLUMNS // 2 + band_count + (max(band_count, 32) + 1) // 2 + _FIELDS
    return 4 * n_vertices * columns


class LiveFeatures:
    """Answers feature requests; holds one table of each kind."""

    def __init__(self) -> None:
        # Each is replaced as a whole, so that no lock is needed to read it.
        self._heat: HeatTable | None = None
        self._bands: tuple[FieldRequest, ColumnArray] | None = None
        self._similarity: tuple[FieldRequest, SimilarityTable] | None = None

    @property
    def nbytes(self) -> int:
        """Bytes that the tables hold."""
        heat, bands, similarity = self._heat, self._bands, self._similarity
        return (
            (heat.nbytes if heat else 0)
            + (bands[1].nbytes if bands else 0)
            + (similarity[1].nbytes if similarity else 0)
        )

    @property
    def heat_table(self) -> HeatTable | None:
        """The table of the heat kernel signature."""
        return self._heat

    def forget(self) -> None:
        """Drop all tables, as when another mesh is opened."""
        self._heat = self._bands = self._similarity = None

    # -- answers ------------------------------------------------------------------------------

    def heat_kernel(self, request: FieldRequest) -> tuple[ColumnArray, bool]:
        """HKS at one time, shape (n,), and whether a better answer is on its way."""
        spectrum, time, table = request.spectrum, request.time, self._heat
        if table is not None and table.covers(time):
            if table.spectrum is spectrum:
                return table.at(time), False
            if _grew(table.spectrum, spectrum) and spectrum.rows.size > _SMALL:
                return table.at(time), True
        decay = np.exp(-spectrum.eigenvalues * time)
        return np.asarray(sum_squares(spectrum.rows, decay[None])[0]), False

    def band(self, request: FieldRequest) -> tuple[ColumnArray, bool]:
        """One geometry vector, shape (n,), and whether a better answer is on its way."""
        bands = self._bands
        if bands is not None and _same_bands(bands[0], request):
            self._bands = (request, bands[1])  # next time it is the very same spectrum
            return bands[1][request.band], False
        response = _bank(request).response(request.spectrum.eigenvalues)
        weights = response[request.band : request.band + 1]
        return np.asarray(sum_squares(request.spectrum.rows, weights)[0]), False

    def similarity(self, request: FieldRequest) -> tuple[ColumnArray | None, bool]:
        """Feature distance from one vertex, shape (n,), and whether it will get better.

        None until `prepare` has been called: there is no quick way without a table.
        """
        known = self._similarity
        if known is not None:
            if _same_features(known[0], request):
                self._similarity = (request, known[1])
                return known[1].from_vertex(request.vertex), False
            if _grew(known[0].spectrum, request.spectrum) and known[0].basis is request.basis:
                return known[1].from_vertex(request.vertex), True
        return None, True

    # -- tables -------------------------------------------------------------------------------

    def prepared(self, request: FieldRequest) -> bool:
        """Whether `prepare` has nothing to do for a request."""
        if request.kind is FieldKind.HKS:
            heat = self._heat
            return (
                heat is not None
                and heat.spectrum is request.spectrum
                and heat.covers(*request.times)
            )
        if request.kind is FieldKind.BAND:
            return self._bands is not None and _same_bands(self._bands[0], request)
        if request.kind is FieldKind.SIMILARITY:
            return self._similarity is not None and _same_features(self._similarity[0], request)
        return True

    def prepare(self, request: FieldRequest, cancel: CancelCallback | None = None) -> None:
        """Build the table for requests like this one, unless it is there.

        Raises
        ------
        Cancelled
            If `cancel` said so; the table before it is kept or dropped, never half new.
        """
        spectrum = request.spectrum
        if self.prepared(request):
            return
        if request.kind is FieldKind.HKS:
            known = self._heat
            if known is not None and not _grew(known.spectrum, spectrum):
                known = self._heat = None  # before the new one takes room
            self._heat = build_heat_table(spectrum, request.times, known, cancel)
        elif request.kind is FieldKind.BAND:
            self._bands = None
            response = _bank(request).response(spectrum.eigenvalues)
            rows = sum_squares(spectrum.rows, response, cancel=cancel)
            self._bands = (request, np.asarray(rows))
        elif request.kind is FieldKind.SIMILARITY:
            bank = _bank(request)
            table = build_similarity_table(spectrum, bank.response, cancel)
            self._similarity = (request, table)


def _bank(request: FieldRequest) -> FilterBank:
    from meshmash_viewer.features.filters import bspline_bank, heat_kernel_bank, hks_times

    by_time = request.kind is FieldKind.SIMILARITY and request.basis is SimilarityBasis.HKS
    if by_time:
        times = hks_times(request.spectrum.eigenvalues, *request.times, request.scales)
        return heat_kernel_bank(times)
    return bspline_bank(*request.eigenvalues, request.band_count)


def _grew(old: Spectrum, new: Spectrum) -> bool:
    """Whether one spectrum is the other before it grew."""
    count = len(old)
    return (
        count <= len(new)
        and old.preview == new.preview
        and old.operator == new.operator
        and old.rows.shape[1] == new.rows.shape[1]
        and bool(np.array_equal(old.eigenvalues, new.eigenvalues[:count]))
        and bool(np.array_equal(old.rows[count - 1], new.rows[count - 1], equal_nan=True))
    )


def _same(known: FieldRequest, request: FieldRequest) -> bool:
    """Whether two requests are about the same pairs, be it that their proof has come since."""
    if known.spectrum is request.spectrum:
        return True
    return len(known.spectrum) == len(request.spectrum) and _grew(known.spectrum, request.spectrum)


def _same_bands(known: FieldRequest, request: FieldRequest) -> bool:
    return (known.band_count, known.eigenvalues) == (
        request.band_count,
        request.eigenvalues,
    ) and _same(known, request)


def _same_features(known: FieldRequest, request: FieldRequest) -> bool:
    return (known.basis, known.times, known.scales, known.band_count, known.eigenvalues) == (
        request.basis,
        request.times,
        request.scales,
        request.band_count,
        request.eigenvalues,
    ) and _same(known, request)
