from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapes
from solved import spectrum_of

from meshmash_viewer.features.filter_responses import hks_time_range, hks_times
from meshmash_viewer.features.filters import bspline_bank, heat_kernel_bank
from meshmash_viewer.features.shape import feature_distance
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields import FEATURES
from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.geometry_vectors import GeometryVectors
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.fields.live_tables import build_heat_table
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.field import FieldRequest, LiveFeatures, expected_bytes
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


def direct(spectrum: Eigenpairs, coefficients: np.ndarray) -> np.ndarray:
    k = len(spectrum)
    return accumulate_features(spectrum.rows[:k], coefficients)


def hks_request(spectrum: Eigenpairs, time: float) -> FieldRequest:
    t_min, t_max = hks_time_range(spectrum.eigenvalues)
    return between(spectrum, time, t_min, t_max)


def between(spectrum: Eigenpairs, time: float, t_min: float, t_max: float) -> FieldRequest:
    family = HeatKernelSignature(time=time, t_min=t_min, t_max=t_max, automatic=False)
    return FieldRequest(spectrum, "", family)


def band_request(spectrum: Eigenpairs, band: int, count: int = 12) -> FieldRequest:
    family = GeometryVectors(index=band, count=count).resolved(spectrum, {})
    return FieldRequest(spectrum, "", family)


def similarity_request(
    spectrum: Eigenpairs, vertex: int = 77, times: tuple[float, float] | None = None, count: int = 8
) -> FieldRequest:
    t_min, t_max = times or hks_time_range(spectrum.eigenvalues)
    features = HeatKernelSignature(t_min=t_min, t_max=t_max, automatic=False, scales=count)
    return FieldRequest(spectrum, "", Similarity(vertex, "hks", features))


def answer(live: LiveFeatures, asked: FieldRequest) -> tuple[np.ndarray | None, bool]:
    found = live.compute(asked)
    return (None, True) if found is None else (found.values, found.draft)


def test_a_table_of_a_mesh_with_values_at_every_second_vertex_alone(rectangle: Mesh) -> None:
    small = spectrum_of(rectangle, 40)
    # So many vertices that the range of the values is taken from a sample.
    rows = np.full((40, 2 * 100_001), np.nan, dtype=np.float32)
    rows[:, 1::2] = np.resize(small.rows[:40], (40, 100_001))
    spectrum = replace(small, rows=rows)
    times = hks_time_range(spectrum.eigenvalues)
    time = float(np.sqrt(times[0] * times[1]))
    found = build_heat_table(spectrum, times).at(time)[1::2]
    wanted = (np.exp(-spectrum.eigenvalues * time) @ np.square(rows[:, 1::2].astype(float))).ravel()
    assert np.abs(found - wanted).max() <= 1e-3 * np.ptp(wanted)


@pytest.mark.parametrize("shape", ["rectangle", "neuron"])
def test_interpolated_hks_is_within_its_bound_of_the_direct_sum(
    shape: str, request: pytest.FixtureRequest
) -> None:
    spectrum = spectrum_of(request.getfixturevalue(shape), 150)
    times = hks_time_range(spectrum.eigenvalues)
    table = build_heat_table(spectrum, times)
    assert table.covers(times[0])
    assert table.covers(times[1])
    assert not table.covers(1e-3 * times[0])
    assert table.covers(*times)
    assert not table.covers(times[0], 1e3 * times[1])
    for time in np.geomspace(*times, 47):
        wanted = direct(spectrum, np.exp(-spectrum.eigenvalues * time)[None])[:, 0]
        found = table.at(time)
        assert found.dtype == np.float32
        rounding = 7e-8 * np.nanmax(wanted)  # of float32
        assert (
            np.nanmax(np.abs(found - wanted)) <= 1e-4 * np.ptp(wanted[~np.isnan(wanted)]) + rounding
        )


def test_few_vertices_with_a_huge_signature_cost_the_others_nothing(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    rows = np.array(spectrum.rows)
    specks = [3, 70]
    rows[:, specks] *= 1e4
    rows[:, 11] = np.nan
    spiked = Eigenpairs(spectrum.eigenvalues, rows, spectrum.residuals)
    times = hks_time_range(spectrum.eigenvalues)
    table = build_heat_table(spiked, times)
    others = np.setdiff1d(np.arange(rows.shape[1]), [*specks, 11])
    for time in np.geomspace(*times, 7):
        wanted = direct(spiked, np.exp(-spectrum.eigenvalues * time)[None])[:, 0]
        found = table.at(time)
        np.testing.assert_allclose(found[specks], wanted[specks], rtol=1e-4)
        assert np.isnan(found[11])
        calm = wanted[others]
        assert np.abs(found[others] - calm).max() <= 1e-4 * np.ptp(calm) + 7e-8 * calm.max()


def test_scale_makes_no_difference(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    small = Eigenpairs(spectrum.eigenvalues * 1e18, spectrum.rows * 1e9, spectrum.residuals)
    times = hks_time_range(spectrum.eigenvalues)
    table = build_heat_table(spectrum, times)
    other = build_heat_table(small, (times[0] * 1e-18, times[1] * 1e-18))
    middle = np.sqrt(times[0] * times[1])
    np.testing.assert_allclose(other.at(middle * 1e-18), table.at(middle) * 1e18, rtol=1e-4)


def test_spectrum_without_scale_has_a_constant_signature(sphere: Mesh) -> None:
    spectrum = spectrum_of(sphere, 1)
    table = build_heat_table(spectrum, (1.0, 10.0))
    np.testing.assert_allclose(table.at(3.0), 1.0 / sphere.area, rtol=1e-5)


def test_unreferenced_vertices_stay_grey(neuron: Mesh) -> None:
    assert not neuron.referenced.all()
    spectrum = spectrum_of(neuron, 100)
    live = LiveFeatures()
    times = hks_time_range(spectrum.eigenvalues)
    asked = hks_request(spectrum, times[1])
    for _ in range(2):
        values, _ = answer(live, asked)
        np.testing.assert_array_equal(np.isfinite(values), neuron.referenced)
        live.prepare(asked)
        assert live.prepared(asked)


def test_time_outside_the_table_is_summed_directly(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 40)
    live = LiveFeatures()
    live.prepare(hks_request(spectrum, 1.0))
    for time in (0.0, 1e-9, 1e9):
        values, draft = answer(live, hks_request(spectrum, time))
        wanted = direct(spectrum, np.exp(-spectrum.eigenvalues * time)[None])[:, 0]
        np.testing.assert_allclose(values, wanted, rtol=1e-6)
        assert not draft


def test_bands_are_the_same_with_and_without_a_table(neuron: Mesh) -> None:
    spectrum = spectrum_of(neuron, 100)
    live = LiveFeatures()
    bank = bspline_bank(0.0, float(spectrum.eigenvalues[-1]), 12)
    wanted = direct(spectrum, bank(spectrum.eigenvalues))
    for prepared in (False, True):
        for band in (0, 5, 11):
            asked = band_request(spectrum, band)
            assert live.prepared(asked) is prepared
            values, _ = answer(live, asked)
            np.testing.assert_allclose(values, wanted[:, band], rtol=1e-5)
        live.prepare(band_request(spectrum, 3))
    assert not live.prepared(band_request(spectrum, 3, count=13))


@pytest.mark.parametrize("basis", list(FEATURES))
def test_similarity_is_the_distance_in_feature_space(neuron: Mesh, basis: str) -> None:
    spectrum = spectrum_of(neuron, 100)
    values = spectrum.eigenvalues
    basic = FEATURES[basis].exported(16)
    bank = basic.bank(values)
    features = direct(spectrum, bank(values))
    live = LiveFeatures()
    for vertex in (0, 777):
        family = Similarity(vertex, basis).resolved(spectrum, {basis: basic})
        asked = FieldRequest(spectrum, "", family)
        if not live.prepared(asked):
            assert answer(live, asked) == (None, True)
            live.prepare(asked)
        found, draft = answer(live, asked)
        assert found is not None
        wanted = feature_distance(features, vertex)
        assert not draft
        assert found[vertex] == 0.0
        assert np.nanmax(np.abs(found - wanted)) < 4e-3 * np.nanmax(wanted)


def test_similarity_holds_on_a_neuron_among_specks(rectangle: Mesh) -> None:
    """Features of small components, thousands of times larger, do not affect other vertices."""
    small = shapes.icosphere(1)
    specks = [Mesh(1e-3 * small.vertices + [5.0 + at, 0.0, 0.0], small.faces) for at in range(4)]
    vertices, faces, n = [rectangle.vertices], [rectangle.faces], rectangle.n_vertices
    for speck in specks:
        vertices.append(speck.vertices)
        faces.append(speck.faces + n)
        n += speck.n_vertices
    mesh = Mesh(np.concatenate(vertices), np.concatenate(faces))
    spectrum = spectrum_of(mesh, 60)
    times = (0.01, 1.0)
    bank = heat_kernel_bank(np.geomspace(*times, 16))
    live = LiveFeatures()
    asked = similarity_request(spectrum, 77, times, 16)
    live.prepare(asked)
    found, _ = answer(live, asked)
    assert found is not None
    wanted = feature_distance(direct(spectrum, bank(spectrum.eigenvalues)), 77)
    body = slice(0, rectangle.n_vertices)
    assert np.abs(found[body] - wanted[body]).max() < 4e-3 * wanted[body].max()
    assert 0.1 < np.median(wanted[body]) < 100.0


def n_bytes(live: LiveFeatures) -> int:
    """Return the bytes of the arrays in all tables."""
    contents = [table.content for table in live.tables.values()]
    parts = [part for each in contents for part in getattr(each, "__dict__", {"": each}).values()]
    return sum(part.nbytes for part in parts if isinstance(part, np.ndarray))


def test_tables_are_counted_dropped_and_can_be_given_up(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    live = LiveFeatures()
    asked = hks_request(spectrum, 1.0)
    with pytest.raises(Cancelled):
        live.prepare(asked, cancel=lambda: True)
    assert not live.prepared(asked)
    live.prepare(asked)
    live.prepare(band_request(spectrum, 0))
    assert 0 < n_bytes(live) <= expected_bytes(rectangle.n_vertices)
    live.forget()
    assert not live.tables


def test_tables_outlast_the_proof_of_the_same_pairs(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    live = LiveFeatures()
    live.prepare(band_request(spectrum, 0))
    proven = replace(spectrum, certificate=Certificate("dense", len(spectrum), len(spectrum)))
    assert live.prepared(band_request(proven, 1))
    answer(live, band_request(proven, 1))
    other = replace(spectrum, eigenvalues=spectrum.eigenvalues[:59])
    assert not live.prepared(band_request(other, 1))


def other_pairs(spectrum: Eigenpairs) -> Eigenpairs:
    """Return as many other pairs, like those of another mesh or operator."""
    rows = np.ascontiguousarray(spectrum.rows[:, ::-1])
    return replace(spectrum, rows=rows, eigenvalues=1.3 * spectrum.eigenvalues)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(other_pairs, id="other pairs"),
        pytest.param(
            lambda s: replace(s, rows=np.ascontiguousarray(s.rows[:, ::-1])), id="other rows"
        ),
        pytest.param(lambda s: replace(s, n_exact=0), id="a preview"),
        pytest.param(lambda s: replace(s, operator=OperatorOptions(robust=False)), id="operator"),
        pytest.param(
            lambda s: replace(s, eigenvalues=s.eigenvalues[:50], rows=s.rows[:50]), id="fewer"
        ),
    ],
)
def test_no_table_answers_for_another_spectrum(rectangle: Mesh, change: Any) -> None:
    spectrum = spectrum_of(rectangle, 60)
    times = hks_time_range(spectrum.eigenvalues)
    live = LiveFeatures()
    for asked in (
        hks_request(spectrum, times[1]),
        band_request(spectrum, 3),
        similarity_request(spectrum),
    ):
        live.prepare(asked)
    other = change(spectrum)

    heat = hks_request(other, times[1])
    assert not live.prepared(heat)
    values, draft = answer(live, heat)
    wanted = direct(other, np.exp(-other.eigenvalues * times[1])[None])[:, 0]
    np.testing.assert_allclose(values, wanted, rtol=1e-5)
    assert not draft

    band = replace(band_request(spectrum, 3), spectrum=other)
    assert not live.prepared(band)
    bank = band.family.bank(spectrum.eigenvalues)
    wanted = direct(other, bank(other.eigenvalues))[:, 3]
    np.testing.assert_allclose(answer(live, band)[0], wanted, rtol=1e-5)

    similar = replace(similarity_request(spectrum), spectrum=other)
    assert not live.prepared(similar)
    assert answer(live, similar) == (None, True)
    live.prepare(similar)
    bank = heat_kernel_bank(hks_times(other.eigenvalues, *hks_time_range(spectrum.eigenvalues), 8))
    wanted = feature_distance(direct(other, bank(other.eigenvalues)), 77)
    found, draft = answer(live, similar)
    assert found is not None
    assert not draft
    assert np.abs(found - wanted).max() < 4e-3 * wanted.max()


def test_a_table_of_fewer_pairs_answers_for_more_as_a_draft_alone() -> None:
    mesh = shapes.icosphere(5)  # so large that a direct sum is slow
    rng = np.random.default_rng(5)
    values = np.sort(rng.random(320)) * 300.0
    rows = rng.standard_normal((320, mesh.n_vertices)).astype(np.float32)
    whole = Eigenpairs(values, rows, np.zeros(320))
    part = Eigenpairs(values[:200], rows, np.zeros(200))
    live = LiveFeatures()
    time = hks_time_range(values)[1]
    asked = hks_request(part, time)
    live.prepare(asked)
    live.prepare(similarity_request(part))
    # A table of fewer pairs is a draft, displayed until the sum over all is computed.
    assert answer(live, asked)[1] is False
    assert answer(live, hks_request(whole, time))[1] is True
    assert answer(live, similarity_request(whole))[1] is True
    wanted = direct(whole, np.exp(-values * time)[None])[:, 0]
    live.prepare(hks_request(whole, time))
    live.prepare(similarity_request(whole))
    found, draft = answer(live, hks_request(whole, time))
    assert not draft
    assert np.abs(found - wanted).max() <= 2e-4 * wanted.max()
    assert answer(live, similarity_request(whole))[1] is False
    basis = {"band": GeometryVectors()}
    bands = replace(similarity_request(whole), family=Similarity(77, "band").resolved(whole, basis))
    assert answer(live, bands) == (None, True)


def test_each_table_counts_its_bytes(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    n, live, seen = rectangle.n_vertices, LiveFeatures(), [0]
    assert not live.tables
    asked = (hks_request(spectrum, 1.0), band_request(spectrum, 0), similarity_request(spectrum))
    for one in asked:
        live.prepare(one)
        seen.append(n_bytes(live))
    heat, bands, similarity = np.diff(seen)
    table = live.tables.get("hks")
    assert table is not None
    assert heat >= table.content.columns.nbytes >= 4 * n
    assert bands == 4 * n * 12
    assert 4 * n <= similarity <= 4 * n * 8
    live.forget()
    assert live.tables.get("hks") is None


def test_expected_bytes_are_what_is_documented() -> None:
    for count in (8, 32, 100):
        columns = 40 + count + max(count, 32) / 2 + 4
        assert expected_bytes(1000, count) == 4 * 1000 * columns


def test_what_needs_no_table_is_prepared(rectangle: Mesh) -> None:
    spectrum, live = spectrum_of(rectangle, 60), LiveFeatures()
    asked = FieldRequest(spectrum, "", Eigenfunctions(4))
    assert live.prepared(asked)
    live.prepare(asked)
    assert not live.tables
    for one in (hks_request(spectrum, 1.0), band_request(spectrum, 0)):
        assert not live.prepared(one)
    live.prepare(hks_request(spectrum, 1.0))
    assert not live.prepared(similarity_request(spectrum))
    far = between(spectrum, 1.0, 1e-6, 1e6)
    assert not live.prepared(far)
    live.prepare(far)
    assert live.prepared(far)
    assert live.prepared(hks_request(spectrum, 1.0))


def test_a_vertex_far_from_all_others_knows_its_distances(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    rows = np.array(spectrum.rows)
    specks = [3, 70, 400]
    rows[:, specks] *= np.array([100.0, 150.0, 150.0])
    rows[:, 11] = np.nan
    spiked = replace(spectrum, rows=rows)
    asked = similarity_request(spiked, times=(0.01, 1.0))
    live = LiveFeatures()
    live.prepare(asked)
    features = direct(spiked, heat_kernel_bank(np.geomspace(0.01, 1.0, 8))(spiked.eigenvalues))
    for vertex in (3, 70, 77):
        found, _ = answer(live, similarity_request(spiked, vertex, (0.01, 1.0)))
        assert found is not None
        wanted = feature_distance(features, vertex)
        assert found[vertex] == 0.0
        assert np.isnan(found[11])
        np.testing.assert_allclose(found[specks], wanted[specks], rtol=1e-2, atol=1e-3)
        assert np.nanmax(np.abs(found - wanted)) < 1e-2 * np.nanmax(wanted)


def test_at_times_when_nothing_is_left_the_signature_is_that_of_the_null_space(
    rectangle: Mesh,
) -> None:
    spectrum = spectrum_of(rectangle, 60)
    live = LiveFeatures()
    asked = between(spectrum, 1e5, 1e-2, 1e6)  # exp(-λ t) is 0 long before
    live.prepare(asked)
    values, draft = answer(live, asked)
    assert not draft
    np.testing.assert_allclose(values, 1.0 / rectangle.area, rtol=1e-5)


@pytest.mark.parametrize("died", [55.0, 77.5, 110.0])
def test_a_signature_that_is_dying_is_tabled_without_a_warning(
    rectangle: Mesh, died: float
) -> None:
    """Where exp(-λ₂ t) underflows single precision, there is no division by a zero step."""
    spectrum = spectrum_of(rectangle, 30)
    times = np.array([1.0, died]) / spectrum.eigenvalues[1]
    table = build_heat_table(spectrum, (times[0], times[1]))
    wanted = direct(spectrum, np.exp(-spectrum.eigenvalues * times[1])[None])[:, 0]
    np.testing.assert_allclose(table.at(times[1]), wanted, rtol=1e-6)


def test_a_vertex_without_values_does_not_make_the_same_pairs_others(rectangle: Mesh) -> None:
    """Pairs are compared by their values, and NaN equals NaN at a vertex on no face."""
    spectrum = spectrum_of(rectangle, 60)
    rows = np.array(spectrum.rows)
    rows[:, 11] = np.nan
    before = replace(spectrum, rows=rows, certificate=Certificate("none"))
    proven = replace(before, rows=rows.copy(), certificate=spectrum.certificate)
    live = LiveFeatures()
    for make in (lambda which: band_request(which, 0), similarity_request):
        live.prepare(make(before))
        assert live.prepared(make(proven))
        other = replace(proven, rows=2.0 * rows)
        assert not live.prepared(make(other))


def test_pairs_without_a_value_anywhere_have_a_table_of_none(rectangle: Mesh) -> None:
    spectrum = spectrum_of(rectangle, 60)
    empty = replace(spectrum, rows=np.full_like(spectrum.rows, np.nan))
    times = hks_time_range(spectrum.eigenvalues)
    assert np.isnan(build_heat_table(empty, times).at(times[1])).all()
