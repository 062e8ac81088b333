"""Truncation errors of sums: bound and estimate, compared with full dense spectra."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle
import warnings

import numpy as np
import pytest
import scipy.integrate
import shapes
from faults import raises
from tiers import slow_but

from meshmash_viewer.decompose import (
    compute_geometry_vectors,
    compute_hks,
    spectral_geometry_filter,
)
from meshmash_viewer.errors import ConstantFeaturesWarning, TruncationWarning
from meshmash_viewer.features.filters import (
    FilterBank,
    band_pass_bank,
    bspline_bank,
    gaussian_pyramid_bank,
    get_hks_filter,
    heat_kernel_bank,
    low_pass_bank,
    wave_kernel_bank,
)
from meshmash_viewer.features.formula import formula_bank
from meshmash_viewer.features.sums import compute_features, truncated_features
from meshmash_viewer.features.truncation import mean_shares, percent
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.certificate import Certificate
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.resolution import resolution_error
from meshmash_viewer.spectral.weyl import required_eigenvalue, resolved_time
from meshmash_viewer.units import NO_BREAK, plain_text

SHARES = (0.05, 0.2, 0.6)


def whole_spectrum(mesh) -> Eigenpairs:
    """Return all pairs, by a dense solution independent of the package's solver."""
    stiffness, mass = cotangent_laplacian(mesh, robust=True)
    diagonal = mass.diagonal()
    used = np.flatnonzero(diagonal)
    root = np.sqrt(diagonal[used])
    dense = stiffness.toarray()[np.ix_(used, used)] / np.outer(root, root)
    values, vectors = np.linalg.eigh(dense)
    rows = np.full((len(used), len(diagonal)), np.nan)
    rows[:, used] = vectors.T / root
    values = np.maximum(values, 0.0)
    proof = Certificate("dense", len(values), len(values))
    return Eigenpairs(values, rows, np.zeros(len(used)), proof, mass=diagonal)


def lowest(whole: Eigenpairs, count: int, dtype=np.float64) -> Eigenpairs:
    rows = whole.rows[:count].astype(dtype)
    return dataclasses.replace(whole, eigenvalues=whole.eigenvalues[:count], rows=rows)


@pytest.fixture(scope="module")
def wholes(sphere, rectangle, neuron) -> dict[str, Eigenpairs]:
    """Return full spectra of a sphere, a rectangle with boundary and a faulty neuron."""
    meshes = {"sphere": sphere, "rectangle": rectangle, "neuron": neuron}
    return {name: whole_spectrum(mesh) for name, mesh in meshes.items()}


def banks_at(eigenvalues: np.ndarray) -> dict[str, FilterBank]:
    """Return filters of every kind that reach beyond the last eigenvalue."""
    last = float(eigenvalues[-1])
    return {
        "hks": heat_kernel_bank(np.geomspace(0.3, 9.0, 8) / last),
        "wks": wave_kernel_bank(eigenvalues, 12),
        "geometry vectors": bspline_bank(0.0, 2.0 * last, 8),
        "two bands": bspline_bank(0.0, 2.0 * last, 2),
        "step": low_pass_bank(1.5 * last),
        "band": band_pass_bank(0.5 * last, 1.3 * last),
        "pyramid": gaussian_pyramid_bank([0.0, 1.0 / last]),
        "formula": formula_bank("exp(-t*x) * (x < c)", t=1.0 / last, c=[3.0 * last, 1.4 * last]),
    }


def estimates_and_errors(whole: Eigenpairs, count: int, bank: FilterBank):
    features = truncated_features(lowest(whole, count), bank)
    used = whole.mass > 0.0
    error = np.abs(truncated_features(whole, bank).values - features.values)[used]
    estimate, bound = features.truncation_at_vertices()
    assert np.isnan(estimate[~used]).all()
    return features, estimate[used], bound[used], error


# Bound and estimate against the truth ------------------------------------------------------------


@pytest.mark.parametrize("share", slow_but([0.2], SHARES))
@pytest.mark.parametrize("name", ["sphere", "rectangle", "neuron"])
def test_the_bound_is_above_the_error_and_the_estimate_at_every_vertex(wholes, name, share):
    whole = wholes[name]
    count = int(share * whole.n_components)
    for bank in banks_at(whole.eigenvalues[:count]).values():
        _, estimate, bound, error = estimates_and_errors(whole, count, bank)
        rounding = 1e-12 * error.max(initial=1e-300)
        assert (bound >= error - rounding).all(), bank.kind
        assert (bound >= estimate * (1.0 - 1e-9)).all(), bank.kind
        assert estimate.max() > 0.0


@pytest.mark.parametrize("share", [0.05, 0.2])
@pytest.mark.parametrize("name", ["sphere", "rectangle", "neuron"])
def test_the_estimate_meets_the_median_error_of_heat_and_steps(wholes, name, share):
    whole = wholes[name]
    count = int(share * whole.n_components)
    for kind in ("hks", "step"):
        bank = banks_at(whole.eigenvalues[:count])[kind]
        _, estimate, _, error = estimates_and_errors(whole, count, bank)
        ratio = np.median(estimate, axis=0) / np.median(error, axis=0)
        assert (ratio > 1 / 3).all(), kind
        assert (ratio < 3).all(), kind


def test_the_law_ends_where_the_mesh_does(wholes):
    # With 60 % of the pairs, the law 1 / 4πt exp(-λt) alone far exceeds the true rest.
    whole = wholes["neuron"]
    count = int(0.6 * whole.n_components)
    time = 0.6 / whole.eigenvalues[count - 1]
    _, estimate, _, error = estimates_and_errors(whole, count, heat_kernel_bank([time]))
    plain = math.exp(-0.6) / (4.0 * math.pi * time)
    assert plain > 2.0 * np.median(error)
    assert 0.8 < np.median(estimate) / np.median(error) < 1.25


def test_adding_the_tail_leaves_less(wholes):
    for whole in wholes.values():
        count = int(0.1 * whole.n_components)
        bank = heat_kernel_bank(np.array([0.5, 1.0, 3.0]) / whole.eigenvalues[count - 1])
        with pytest.warns(TruncationWarning, match="are by more than 1 % an estimate"):
            added = compute_features(lowest(whole, count), bank, tail="weyl")
        features, estimate, _, error = estimates_and_errors(whole, count, bank)
        used = whole.mass > 0.0
        np.testing.assert_allclose(added.values[used], (features.values[used] + estimate))
        left = np.abs(truncated_features(whole, bank).values - added.values)[used]
        assert (np.median(left, axis=0) < 0.5 * np.median(error, axis=0)).all()
        assert added.meta["truncation"]["estimate_added"] is True


# Columns -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_columns_tell_the_median_and_the_largest_of_their_vertices(wholes, dtype):
    whole = wholes["neuron"]
    used = whole.mass > 0.0
    part = lowest(whole, 200, dtype)
    for bank in banks_at(part.eigenvalues).values():
        features = truncated_features(part, bank)
        truncation = features.truncation
        estimate, bound = (each[used] for each in features.truncation_at_vertices())
        whole_size = np.median(np.abs(features.values[used]), axis=0) + np.median(estimate, axis=0)
        for actual, expected in (
            (truncation.estimate, np.median(estimate, axis=0)),
            (truncation.largest_estimate, estimate.max(axis=0)),
            (truncation.bound, np.median(bound, axis=0)),
            (truncation.largest_bound, bound.max(axis=0)),
        ):
            np.testing.assert_allclose(actual, expected / whole_size, rtol=2e-3, atol=1e-12)
        assert truncation.flagged.tolist() == np.flatnonzero(truncation.estimate > 0.01).tolist()
        said = json.loads(json.dumps(features.meta["truncation"]))
        assert said["flagged"] == [bank.columns[at] for at in truncation.flagged]
        assert said["n_left_out"] == used.sum() - 200


def test_a_pair_dropped_on_purpose_is_not_missing(wholes):
    part = lowest(wholes["sphere"], 100)
    bank = heat_kernel_bank([0.05])
    kept, dropped = (
        truncated_features(part, bank, drop_first=drop).truncation.remainder
        for drop in (False, True)
    )
    np.testing.assert_allclose(dropped.left, kept.left)
    assert dropped.n_left == kept.n_left


def test_copies_of_the_last_eigenvalue_may_be_left_out(wholes):
    # These two are equal by symmetry; a band that ends at one of them contains both.
    whole = wholes["sphere"]
    count = 11
    ends = whole.eigenvalues[count - 1 : count + 1]
    assert ends[1] == pytest.approx(ends[0], rel=1e-9)
    bank = bspline_bank(0.0, float(ends.max()), 4)
    _, estimate, bound, error = estimates_and_errors(whole, count, bank)
    assert error[:, -1].max() > 0.01
    assert (bound >= error * (1.0 - 1e-9)).all()
    assert estimate[:, -1].max() < 1e-3 * error[:, -1].max()


def test_a_proven_threshold_says_that_bands_up_to_it_are_whole(sphere):
    stiffness, mass = cotangent_laplacian(sphere)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compute_geometry_vectors((stiffness, mass), 30.0, 8)
        spectral_geometry_filter((stiffness, mass), low_pass_bank(25.0), 25.0)


@pytest.mark.parametrize("told", [False, True])
def test_what_is_missing_begins_where_the_count_ends(told):
    # The sixteen pairs of degrees 0 to 3 lie below 12.1, and the next at 20.
    stiffness, mass = cotangent_laplacian(shapes.icosphere(4))
    pairs = solve(stiffness, mass, max_eigenvalue=19.0)
    assert pairs.certificate.counted == len(pairs.eigenvalues) == 16
    features = truncated_features(pairs, heat_kernel_bank([0.1]), known_to=19.5 if told else None)
    end = 19.5 if told else pairs.certificate.bound
    assert end > 18.9
    missing = 1.0 / mass.diagonal() - (pairs.rows**2).sum(axis=0)
    _, bound = features.truncation_at_vertices()
    np.testing.assert_allclose(bound[:, 0], math.exp(-0.1 * end) * missing, rtol=1e-9)
    # A subset of pairs is known up to its last eigenvalue.
    some = dataclasses.replace(pairs, eigenvalues=pairs.eigenvalues[:9], rows=pairs.rows[:9])
    known_to = truncated_features(some, heat_kernel_bank([0.1])).truncation.known_to
    assert known_to == pytest.approx(pairs.eigenvalues[8], rel=1e-6)


def test_of_a_formula_that_ends_in_no_number_all_may_be_missing(wholes):
    pairs = lowest(wholes["sphere"], 30)
    last = float(pairs.eigenvalues[-1])
    missing = compute_features(pairs, formula_bank("sqrt(c - x)", c=1.01 * last), warn=False)
    np.testing.assert_allclose(missing.truncation.estimate, 1.0)


def test_filters_that_say_nothing_of_their_tail_have_no_truncation(wholes):
    bank = FilterBank("own", ("a",), np.ones(1), "t", 2, lambda x: np.exp(-1e-9 * x)[None])
    with pytest.warns(TruncationWarning, match="1 filter is not small at the last eigenvalue"):
        features = compute_features(lowest(wholes["sphere"], 30), bank)
    assert features.truncation is None
    assert features.meta["truncation"] is None
    with raises("no-estimate", "not known"):
        features.truncation_at_vertices()


def test_pairs_around_a_shift_have_none_either(sphere):
    pairs = solve(*cotangent_laplacian(sphere), 9, sigma=12.0)
    assert pairs.eigenvalues[0] > 1.0
    assert compute_features(pairs, heat_kernel_bank([0.1])).truncation is None


# Properties of the filters -----------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, 0.7, 2.0, 5.9, 6.1, 40.0])
def test_suprema_and_integrals_are_those_of_the_filters(start):
    spectrum = np.linspace(0.0, 6.0, 60)
    for bank in banks_at(spectrum).values():
        tail = pickle.loads(pickle.dumps(bank)).tail
        fine = np.linspace(np.nextafter(start, 99.0), 80.0, 40_001)
        values = bank.response(fine)
        supremum = tail.supremum(start)
        assert (supremum >= values.max(axis=1) - 1e-12).all(), bank.kind
        np.testing.assert_allclose(supremum, values.max(axis=1), rtol=1e-3, atol=5e-3)
        ends = np.array([start, start + 1.0, 80.0])
        for at, end in enumerate(ends):
            inside = fine <= end
            expected = scipy.integrate.trapezoid(values[:, inside], fine[inside], axis=1)
            np.testing.assert_allclose(tail.integral(start, ends)[at], expected, atol=0.01)


def test_the_mean_over_the_surface_needs_no_eigenvectors(wholes):
    whole = wholes["rectangle"]
    part, area = lowest(whole, 120), whole.mass.sum()
    for kind in ("hks", "geometry vectors", "step"):
        bank = banks_at(part.eigenvalues)[kind]
        features = truncated_features(part, bank)
        estimate, _ = features.truncation_at_vertices()
        missing, there = (whole.mass @ each for each in (estimate, features.values))
        shares = mean_shares(bank, part.eigenvalues, area, whole.n_components)
        np.testing.assert_allclose(shares, missing / (missing + there), atol=0.03)
        assert (mean_shares(bank, whole.eigenvalues, area, whole.n_components) == 0.0).all()
        # Less is missing if no more pairs lie below a known value.
        known = mean_shares(
            bank, part.eigenvalues, area, whole.n_components, 1.3 * part.eigenvalues[-1]
        )
        assert (known <= shares + 1e-15).all()
        assert (known < shares).any()
        # Nothing is known of other callables beyond the last eigenvalue.
        bare = dataclasses.replace(bank, response=lambda x, bank=bank: bank.response(x))
        assert (mean_shares(bare, part.eigenvalues, area, whole.n_components) == 0.0).all()


def test_required_eigenvalues_and_resolved_times():
    assert resolved_time(required_eigenvalue(7.0)) == pytest.approx(7.0)
    # The missing share is exp(-λ t), slightly less than 1 %.
    assert 0.005 < math.exp(-required_eigenvalue(7.0) * 7.0) < 0.01
    assert resolved_time(0.0) == math.inf


# As many pairs as necessary ----------------------------------------------------------------------


def test_one_pair_beside_the_constant_is_no_spectrum_of_zeros(sphere):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", TruncationWarning)
        values = compute_hks(sphere, count=2, drop_first=True)
    assert np.isfinite(values).all()


def test_auto_takes_as_many_pairs_as_the_shortest_time_needs(sphere, wholes):
    times = np.geomspace(0.16, 1.0, 5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        features = compute_hks(sphere, t_min=0.16, t_max=1.0, n_components=5, count="auto")
    expected = truncated_features(wholes["sphere"], heat_kernel_bank(times)).values
    np.testing.assert_allclose(np.median(features / expected, axis=0), 1.0, atol=0.02)
    assert not np.allclose(features, expected, rtol=1e-6)  # only the necessary pairs


def test_warning_says_that_the_mesh_resolves_no_further_pairs():
    mesh = shapes.icosphere(3)
    with pytest.warns(TruncationWarning, match=r"does not converge.*resolves about 3\d pairs to 5"):
        compute_hks(mesh, count=400, t_min=1e-3, t_max=1.0)
    for few, surface in ((20, mesh), (400, cotangent_laplacian(mesh, robust=True))):
        with pytest.warns(TruncationWarning, match="go further up the spectrum"):
            compute_hks(surface, count=few, t_min=1e-3, t_max=1.0)


@pytest.mark.filterwarnings("ignore::meshmash_viewer.errors.TruncationWarning")
def test_auto_takes_no_pairs_that_the_mesh_does_not_resolve(sphere):
    pairs = solve(*cotangent_laplacian(sphere, robust=True), 60)
    resolved = int((np.abs(resolution_error(sphere, pairs)) < 0.05).sum())
    times = {"t_min": 1e-3, "t_max": 1.0, "n_components": 4}
    with pytest.warns(TruncationWarning, match=r"4 columns.*\s%\. The mesh resolves about 3\d"):
        features = compute_hks(sphere, count="auto", **times)
    counts = range(resolved - 4, resolved + 5)
    same = [np.allclose(compute_hks(sphere, count=k, **times), features) for k in counts]
    assert sum(same) == 1
    with pytest.warns(TruncationWarning, match="needs more than the 642 eigenpairs"):
        compute_hks(cotangent_laplacian(sphere, robust=True), count="auto", **times)


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        ({"count": "auto"}, "missing-argument", "give t_min"),
        ({"count": "all"}, "out-of-range", 'a number or "auto"'),
        ({"count": 0}, "out-of-range", "whole number"),
        ({"count": 5, "wavelength": 1.0}, "conflicting-arguments", "count and wavelength"),
        ({"count": 5, "max_eigenvalue": 2.0}, "conflicting-arguments", "max_eigenvalue and count"),
        (
            {"count": "auto", "t_min": 1.0, "max_eigenvalue": 2.0},
            "conflicting-arguments",
            "max_eigenvalue and count",
        ),
        ({"wavelength": -1.0}, "out-of-range", "positive"),
        ({"tail": "gauss"}, "unknown-name", "no tail 'gauss'"),
    ],
)
def test_extents_that_make_no_sense_are_refused(sphere, options, code, word):
    with raises(code, word):
        compute_hks(sphere, **options)


def test_the_tail_is_that_of_heat_kernel_signatures(wholes):
    with raises("conflicting-arguments", "not for geometry-vectors"):
        compute_features(lowest(wholes["sphere"], 9), bspline_bank(0.0, 9.0, 4), tail="weyl")


def test_a_band_beyond_where_the_law_ends_may_be_missing_as_a_whole(wholes):
    whole = wholes["neuron"]
    beyond = 0.9 * float(whole.eigenvalues[-1])
    few = lowest(whole, 9)
    told = compute_features(few, band_pass_bank(beyond, 2.0 * beyond), warn=False).truncation
    assert told is not None
    assert told.estimate.tolist() == [1.0]


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.954, "95 %"), (0.0142, "1.4 %"), (0.096, "9.6 %"), (0.0, "0 %"), (0.996, "99.6 %")],
)
def test_a_share_has_as_many_digits_as_it_is_worth(share: float, text: str) -> None:
    assert percent(share) == text.replace(" ", NO_BREAK)


@pytest.mark.parametrize("drop_first", [False, True])
def test_of_all_pairs_nothing_is_missing_whatever_the_filters(drop_first: bool) -> None:
    L, M = cotangent_laplacian(shapes.icosphere(2))
    pairs = solve(L, M, 162)
    top = pairs.eigenvalues[-1]
    for bank in (
        heat_kernel_bank([0.0, 1e-6, 1.0]),
        gaussian_pyramid_bank([0.0, 1e-4]),
        bspline_bank(0.0, 3.0 * top, 6),
        wave_kernel_bank(pairs.eigenvalues, 5),
        low_pass_bank(10.0 * top),
        band_pass_bank(0.5 * top, 2.0 * top),
    ):
        found = compute_features(pairs, bank, drop_first=drop_first)  # warnings are errors
        assert found.missing == ""
        estimate, bound = found.truncation_at_vertices()
        assert (estimate.max(), bound.max(), found.truncation.flagged.size) == (0.0, 0.0, 0)


def _said(mesh, filter_, **how):
    """Return the truncation warnings of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        spectral_geometry_filter(mesh, filter_, 40.0, drop_first=False, **how)
    return [str(each.message) for each in caught if each.category is TruncationWarning]


@pytest.mark.parametrize("time", slow_but([0.03], [1e-3, 0.03, 0.5]))
def test_the_hks_filter_warns_as_compute_hks_does(sphere, time):
    ball = dataclasses.replace(sphere, name="ball")
    (said,) = _said(ball, get_hks_filter(t_min=0.5 * time, t_max=2.0, n_scales=5)) or [""]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        compute_hks(ball, 40.0, t_min=0.5 * time, t_max=2.0, n_components=5)
    (wanted,) = [str(each.message) for each in caught] or [""]
    assert said == wanted
    assert said.startswith("ball: ") == (time < 0.5)
    assert caught == [] or caught[0].filename == __file__


#: Filter functions for all eigenvalues below 40, with a part of the expected warning.
OPEN_ENDS = {
    "all": (np.ones_like, "1 filter is not small"),
    "fast decay": (lambda x: np.exp(-0.2 * x), ""),
    "rising": (lambda x: x, "up to 100 %"),
    "high pass": (lambda x: (x > 20.0).astype(float), "1 filter is not small"),
    "low pass": (lambda x: (x < 20.0).astype(float), ""),
    "negative": (lambda x: -np.ones((1, len(x))), "up to 100 %"),
    "one of two": (lambda x: np.exp(-np.outer([0.01, 1.0], x)), "1 of 2 filters is not small"),
    "relative": (lambda x: np.exp(-x / x.max()), "up to 37 %"),
    "changes what it gets": (lambda x: np.exp(0.0 * np.multiply(x, 0.0, out=x)), "1 filter is not"),
}


@pytest.mark.parametrize("name", slow_but(["fast decay", "rising", "one of two"], OPEN_ENDS))
def test_any_filter_that_is_not_small_at_the_last_eigenvalue_is_said(sphere, name):
    filter_, wanted = OPEN_ENDS[name]
    said = _said(sphere, filter_)
    assert len(said) == bool(wanted)
    assert wanted in plain_text("".join(said))
    # All pairs of a small mesh leave nothing out.
    small = shapes.icosphere(1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectral_geometry_filter(small, filter_, 1e9, drop_first=False)


def test_warnings_begin_with_the_name_of_the_mesh(sphere):
    named, bare = (dataclasses.replace(sphere, name=name) for name in ("ball", ""))
    assert _said(named, np.ones_like)[0].startswith("ball: 1 filter is")
    assert _said(bare, np.ones_like)[0].startswith("1 filter is")
    assert _said((sphere.vertices, sphere.faces), np.ones_like)[0].startswith("1 filter is")
    for compute in (compute_hks, compute_geometry_vectors):
        with pytest.warns(ConstantFeaturesWarning, match="^ball: Only zero"):
            compute(named, 1e-3)
