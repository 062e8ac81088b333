"""Properties that all families of fields share."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pytest
from solved import spectrum_of

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import bspline_bank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields import EXPORTS, FAMILIES, FEATURES
from meshmash_viewer.fields.bank_columns import BankFamily
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.family import Family
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.maps import OwnMaps
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import LiveFeatures
from meshmash_viewer.spectral.eigenpairs import Eigenpairs

CHOSEN = {name: family() for name, family in FAMILIES.items()}
WITH_PROFILES = [
    name
    for name, family in FAMILIES.items()
    if family.export and family.profile is not Family.profile
]


@dataclass
class Asked:
    spectrum: Eigenpairs
    family: Family


@pytest.fixture(scope="module")
def spectrum(rectangle: Mesh) -> Eigenpairs:
    return spectrum_of(rectangle, 60)


def shown(spectrum: Eigenpairs, family: Family, live: LiveFeatures) -> np.ndarray:
    found = live.compute(Asked(spectrum, family.resolved(spectrum, CHOSEN)))
    assert found is not None
    return found.values


def test_the_curve_of_a_band_ends_where_its_support_does(spectrum: Eigenpairs) -> None:
    family = replace(GeometryVectors(), count=9)
    for index in range(9):
        band = replace(family, index=index)
        curve, _ = band.response(spectrum, spectrum.eigenvalues).curve
        assert (curve[0], curve[-1]) == pytest.approx(band.support(spectrum))


def test_a_table_lets_go_of_the_rows_it_was_made_from(spectrum: Eigenpairs) -> None:
    family = GeometryVectors().resolved(spectrum, CHOSEN)
    table = family.prepare(spectrum, None)
    again = replace(spectrum, rows=np.array(spectrum.rows))
    assert family.prepared(again, table)
    family.compute(again, table)
    assert table.spectrum is again


@pytest.mark.parametrize("name", WITH_PROFILES)
def test_a_profile_is_the_fields_at_its_vertex(spectrum: Eigenpairs, name: str) -> None:
    family, vertex = FAMILIES[name](), 77
    profile = family.profile(spectrum, "")
    assert profile is not None
    places, heights = profile.dots.values(spectrum.rows[:60, vertex])
    heights = 10.0**heights if family.logarithmic[1] else heights
    live = LiveFeatures()
    for prepared in (False, True):
        for at in {0, min(7, len(places) - 1), len(places) - 1}:
            there = family.at_place(spectrum, places[at])
            assert there.place(spectrum) == pytest.approx(places[at])
            assert shown(spectrum, there, live)[vertex] == pytest.approx(
                heights[at], rel=2e-4, abs=1e-6 * np.abs(heights).max()
            ), f"place {at}, {prepared=}"
        live.prepare(Asked(spectrum, family.resolved(spectrum, CHOSEN)))


@pytest.mark.parametrize("name", list(FEATURES))
def test_what_is_exported_is_what_is_shown(spectrum: Eigenpairs, name: str) -> None:
    family = FEATURES[name].exported(9)
    values = spectrum.eigenvalues
    bank = family.resolved(spectrum, CHOSEN).bank(values)
    wanted = accumulate_features(spectrum.rows[:60], bank(values))
    there = family.step(spectrum, -1000)
    for column in range(9):
        found = shown(spectrum, there, LiveFeatures())
        np.testing.assert_allclose(found, wanted[:, column], rtol=1e-5)
        after = there.step(spectrum, 1)
        assert (after == there) == (column == 8), "a step is a column, and stops at the end"
        there = after


@pytest.mark.parametrize("name", list(FEATURES))
def test_a_filter_is_held_where_it_is(spectrum: Eigenpairs, name: str) -> None:
    family = FEATURES[name]().step(spectrum, 5)
    along = np.linspace(0.0, float(spectrum.eigenvalues[-1]), 50)
    response = family.response(spectrum, along)
    assert response is not None
    again = family.step(spectrum, -2).at_eigenvalue(spectrum, response.handle)
    assert again.place(spectrum) == pytest.approx(family.place(spectrum))
    eigenvalues, heights = response.curve
    other = family.step(spectrum, -3).response(spectrum, along)
    assert heights.shape == eigenvalues.shape
    assert np.isfinite(heights).all()
    assert not np.array_equal(other.curve[1], heights) or other.handle < response.handle


@pytest.mark.parametrize("family", [*FAMILIES.values(), *EXPORTS.values()])
def test_zeros_alone_are_no_reason_to_stumble(family: type[Family]) -> None:
    zeros = Eigenpairs(np.zeros(3), np.ones((3, 5)), np.zeros(3))
    chosen = family()
    assert chosen.step(zeros, 1).within(zeros) is not None
    assert chosen.resolved(zeros, CHOSEN).at_rest() == chosen.resolved(zeros, CHOSEN).at_rest()
    if isinstance(chosen, BankFamily):
        for area in (None, 3.0):
            with suppress(InputError):  # zeros alone define no range of times
                assert np.isfinite(chosen.bank(zeros.eigenvalues, area)(zeros.eigenvalues)).all()


def test_bands_sampled_on_their_supports_are_the_filter(spectrum: Eigenpairs) -> None:
    low, high = 10.0, 70.0
    for count in (1, 2, 3, 4, 5, 32):
        bank = bspline_bank(low, high, count)
        bands = GeometryVectors(0, count).between(low, high)
        assert bands.centers(spectrum) == pytest.approx(bank.parameters)
        for band, curve in enumerate(bands.response(spectrum, np.zeros(0)).others):
            places, heights = curve
            assert heights == pytest.approx(bank(places)[band], abs=1e-9), f"{band} of {count}"
            fine = np.linspace(low, high, 1001)
            start, end = replace(bands, index=band).support(spectrum)
            outside = (fine < start - 1e-9) | (fine > end + 1e-9)
            assert np.abs(bank(fine)[band][outside]).max(initial=0.0) < 1e-12


def test_the_profile_of_eigenfunctions_is_their_values_as_shown(spectrum: Eigenpairs) -> None:
    chosen, vertex = Eigenfunctions(flipped=frozenset({6})), 77
    profile = chosen.profile(spectrum, "")
    assert profile is not None
    places, heights = profile.dots.values(spectrum.rows[:20, vertex])
    wanted = spectrum.rows[:20, vertex].copy()
    wanted[6] *= -1.0
    np.testing.assert_allclose(heights, wanted[: len(heights)])
    assert len(places) == len(heights) >= 20


def test_a_time_outside_the_range_is_forgotten_and_one_inside_kept(spectrum: Eigenpairs) -> None:
    low, high = HeatKernelSignature().range(spectrum)
    for time in (low, 0.5 * (low + high), high):
        assert HeatKernelSignature(time=time).within(spectrum).time == time
    for time in (0.9 * low, 1.1 * high):
        assert HeatKernelSignature(time=time).within(spectrum).time is None


def test_a_table_of_fewer_pairs_serves_until_the_next_is_built(spectrum: Eigenpairs) -> None:
    """A table of fewer pairs gives a draft; a table of another spectrum gives no values."""
    fewer = replace(
        spectrum,
        eigenvalues=spectrum.eigenvalues[:40],
        rows=spectrum.rows[:40],
        residuals=spectrum.residuals[:40],
    )
    other = replace(spectrum, eigenvalues=1.1 * spectrum.eigenvalues)
    table = Similarity(vertex=5).resolved(fewer, CHOSEN).prepare(fewer, None)
    for asked, draft in ((fewer, False), (spectrum, True)):
        answer = Similarity(vertex=5).resolved(asked, CHOSEN).compute(asked, table)
        assert answer is not None
        assert answer.draft == draft
        assert answer.values[5] == answer.values.min() == 0.0
    assert Similarity(vertex=5).resolved(other, CHOSEN).compute(other, table) is None


def test_exact_pairs_come_before_those_of_a_preview(spectrum: Eigenpairs) -> None:
    """Exact pairs replace the first preview pairs; the result is sorted and marked as preview."""
    preview = replace(
        spectrum, eigenvalues=0.9 * spectrum.eigenvalues, rows=-spectrum.rows, n_exact=0
    )
    few = replace(
        spectrum,
        eigenvalues=spectrum.eigenvalues[:20],
        rows=spectrum.rows[:20],
        residuals=spectrum.residuals[:20],
    )
    both = few.before(preview)
    assert both.preview
    assert both.n_exact == 20
    assert (np.diff(both.eigenvalues) >= 0.0).all()
    np.testing.assert_array_equal(both.eigenvalues[:20], few.eigenvalues)
    np.testing.assert_array_equal(both.rows[:20], few.rows)
    np.testing.assert_array_equal(both.rows[20:], preview.rows[20:])
    assert np.isnan(both.residuals[20:]).all()


@pytest.mark.parametrize("name", ["band", "wks"])
def test_there_is_no_profile_of_a_null_space(name: str) -> None:
    zeros = Eigenpairs(np.zeros(3), np.ones((3, 5)), np.zeros(3))
    assert FEATURES[name]().profile(zeros, "") is None


@pytest.mark.parametrize("measure", ["biharmonic", "commute", "diffusion"])
def test_nothing_is_at_a_distance_in_another_component(three_spheres: Mesh, measure: str) -> None:
    some = replace(spectrum_of(three_spheres, 40), mesh=three_spheres)
    vertex = int(np.flatnonzero(three_spheres.component_labels == 1)[0])
    family = Distances(vertex=vertex, measure=measure).resolved(some, CHOSEN)
    values = shown(some, family, LiveFeatures())
    here = three_spheres.component_labels == 1
    assert np.isnan(values[~here]).all()
    assert np.isfinite(values[here]).all()


@pytest.mark.parametrize("name", FAMILIES)
def test_a_field_says_what_it_is(name: str) -> None:
    family = FAMILIES[name]()
    if isinstance(family, OwnMaps):
        views = ("pairs", "residual", "filter", "band")
        assert len({replace(family, view=view).definition for view in views} - {""}) == 4
        family = replace(family, chosen="Mean curvature")
    assert family.definition
