"""Comparison of shapes by spectra and features."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from faults import raises

from meshmash_viewer.decompose import compute_hks
from meshmash_viewer.features.maps import reconstruct, spectral_coefficients
from meshmash_viewer.features.shape import (
    column_spread,
    feature_distance,
    low_pass_vertices,
    match_features,
    spectral_distance,
)
from meshmash_viewer.features.sums import Features
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import solve


@pytest.fixture(scope="module")
def whole_neuron(neuron):
    """Return all eigenpairs of the neuron."""
    return solve(*cotangent_laplacian(neuron, robust=True), neuron.n_vertices)


def test_all_eigenvectors_rebuild_every_function(neuron, whole_neuron, rng):
    used = neuron.referenced
    functions = rng.standard_normal((neuron.n_vertices, 2))
    functions[~used] = np.nan
    mass = cotangent_laplacian(neuron, robust=True)[1]
    coefficients = spectral_coefficients(whole_neuron.eigenvectors, mass, functions)
    rebuilt = reconstruct(whole_neuron.eigenvectors, coefficients)
    np.testing.assert_allclose(rebuilt[used], functions[used], atol=1e-9)
    assert np.isnan(rebuilt[~used]).all()
    # Parseval: the squared integral is the sum of squared coefficients
    integral = (whole_neuron.mass[used] * functions[used, 0] ** 2).sum()
    assert (coefficients[:, 0] ** 2).sum() == pytest.approx(integral, rel=1e-10)


def test_projections_of_a_wrong_shape_are_refused(neuron, whole_neuron):
    vectors, mass = whole_neuron.eigenvectors, whole_neuron.mass
    n, k = vectors.shape
    with raises("wrong-shape", "one number per vertex"):
        spectral_coefficients(vectors, mass, np.ones(n - 1))
    with raises("wrong-shape", "or its diagonal"):
        spectral_coefficients(vectors, mass[:-1], np.ones(n))
    with raises("not-diagonal", "not diagonal"):
        spectral_coefficients(vectors, cotangent_laplacian(neuron, robust=True)[0], np.ones(n))
    with raises("wrong-shape"):
        reconstruct(vectors, np.ones(k + 1))
    for shape in ((), (2, 3, 1)):
        with raises("wrong-shape"):
            reconstruct(vectors, np.ones(shape))
    with raises("wrong-shape"):
        reconstruct(vectors[0], np.ones(1))


def test_the_best_approximation_is_the_one_weighed_by_area(neuron, whole_neuron):
    used = neuron.referenced
    function = neuron.vertices[:, 0] - neuron.vertices[:, 0].mean()
    basis = whole_neuron.rows[:40, used].T
    root = np.sqrt(whole_neuron.mass[used])
    best = np.linalg.lstsq(root[:, None] * basis, root * function[used], rcond=None)[0]
    ours = spectral_coefficients(whole_neuron.eigenvectors[:, :40], whole_neuron.mass, function)
    np.testing.assert_allclose(ours, best, atol=1e-8 * np.abs(best).max())
    unweighted = basis.T @ function[used]
    assert np.abs(unweighted / np.linalg.norm(best)).max() < 0.1  # without M


def test_low_pass_with_all_pairs_is_the_mesh(neuron, whole_neuron):
    rebuilt = low_pass_vertices(neuron, whole_neuron, whole_neuron.n_components)
    np.testing.assert_allclose(rebuilt, neuron.vertices, atol=1e-6)


def test_low_pass_keeps_every_component_in_its_place(neuron, whole_neuron):
    mass, labels = whole_neuron.mass, neuron.component_labels
    for n in (1, 3, 20):
        rebuilt = low_pass_vertices(neuron, whole_neuron, n)
        assert np.isfinite(rebuilt).all()
        for component in range(neuron.n_components):
            part = labels == component
            np.testing.assert_allclose(
                np.average(rebuilt[part], axis=0, weights=mass[part]),
                np.average(neuron.vertices[part], axis=0, weights=mass[part]),
                atol=1e-5,
            )
        np.testing.assert_array_equal(rebuilt[labels < 0], neuron.vertices[labels < 0])


@pytest.mark.parametrize("n", [0, 41])
def test_low_pass_of_pairs_that_are_not_there(sphere, n):
    decomposition = solve(*cotangent_laplacian(sphere), 40)
    with raises("out-of-range", "1 to 40"):
        low_pass_vertices(sphere, decomposition, n)
    with raises("other-mesh"):
        low_pass_vertices(shapes.icosphere(1), decomposition, 3)


def test_distance_sees_shape_not_size_unit_pose_or_order(neuron, rng):
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    order = rng.permutation(neuron.n_vertices)
    place = np.argsort(order)
    same = Mesh(1e-3 * (neuron.vertices @ turn)[order], place[neuron.faces])
    assert spectral_distance(neuron, same, 40) < 1e-4
    assert spectral_distance(neuron, shapes.icosphere(3), 40) > 10.0


def test_distance_of_two_spheres_in_closed_form():
    small, large = shapes.icosphere(3, 1.0), shapes.icosphere(3, 2.0)
    assert spectral_distance(small, large, 25) < 1e-8
    gap = np.linalg.norm(shapes.sphere_eigenvalues(25) * (1.0 - 0.25))
    assert spectral_distance(small, large, 25, normalize=False) == pytest.approx(gap, rel=0.03)


def test_distance_refuses_what_cannot_be_compared(neuron, sphere):
    with raises("too-few-vertices", "A mesh has only 12 vertices"):
        spectral_distance(sphere, shapes.icosphere(0), 13)
    with raises("other-units", "in nm and no unit"):
        spectral_distance(neuron, sphere, 5, normalize=False)


def test_matching_finds_the_permutation(neuron, rng):
    order = rng.permutation(neuron.n_vertices)
    other = Mesh(neuron.vertices[order], np.argsort(order)[neuron.faces])
    arguments = {"max_eigenvalue": 4e-5, "n_components": 24}
    ours, theirs = compute_hks(neuron, **arguments), compute_hks(other, **arguments)
    matches = match_features(ours, theirs)
    used = neuron.referenced
    # Small components are equal, so only vertices of trunk and branch can be matched.
    trunk = neuron.component_labels == 0
    right = order[matches.indices[trunk]] == np.flatnonzero(trunk)
    assert right.mean() > 0.99
    np.testing.assert_array_equal(matches.indices[~used], -1)
    assert np.isnan(matches.scores[~used]).all()
    assert not matches.confident[~used].any()


def test_matching_agrees_with_all_pairs(rng):
    from scipy.spatial.distance import cdist

    a, b = rng.standard_normal((80, 6)), rng.standard_normal((90, 6))
    matches = match_features(Features(a, tuple("abcdef")), b, quantile=0.25)
    distances = cdist(a, b)
    np.testing.assert_array_equal(matches.indices, distances.argmin(axis=1))
    np.testing.assert_allclose(matches.scores, distances.min(axis=1))
    assert matches.confident.sum() == 20
    assert matches.scores[matches.confident].max() < matches.scores[~matches.confident].min()
    scaled = match_features(a * 1e-6, b * 1e-6, standardize=True)
    standard = cdist(a / column_spread(b), b / column_spread(b))
    np.testing.assert_allclose(scaled.scores, standard.min(axis=1))


def test_matching_refuses_what_does_not_fit():
    with raises("wrong-shape", "3 and 2 columns"):
        match_features(np.ones((4, 3)), np.ones((4, 2)))
    with raises("no-values", "no vertex with features"):
        match_features(np.ones((4, 3)), np.full((4, 3), np.nan))
    with raises("no-values", "no vertex with features"):
        match_features(np.full((4, 3), np.nan), np.ones((4, 3)))
    with raises("out-of-range"):
        match_features(np.ones((4, 3)), np.ones((4, 3)), quantile=10)
    with raises("wrong-shape", "one row per vertex"):
        match_features(np.ones(4), np.ones((4, 3)))


def test_spread_is_the_deviation_of_normal_values_and_ignores_a_few_that_are_far_out(rng):
    values = rng.standard_normal((20_000, 3)) * [1.0, 1e-9, 1e6] + [0.0, 1e-9, 0.0]
    clean = column_spread(values)
    np.testing.assert_allclose(clean, [1.0, 1e-9, 1e6], rtol=0.03)
    values[:800] *= 1e6
    np.testing.assert_allclose(column_spread(values), clean, rtol=0.1)
    mostly_zero = np.zeros((100, 2))
    mostly_zero[:5, 0] = 1.0
    np.testing.assert_allclose(column_spread(mostly_zero), [mostly_zero[:, 0].std(), 1.0])


def test_similarity_to_a_vertex(rng):
    values = rng.standard_normal((50, 4)) * [1.0, 1e-9, 1e6, 0.0] + [0, 0, 0, 5.0]
    values[7] = np.nan
    distance = feature_distance(values, 3)
    used = np.isfinite(values).all(axis=1)
    low, high = np.percentile(values[used, :3], (15.865525, 84.134475), axis=0)
    scale = np.append((high - low) / 2, 1.0)
    np.testing.assert_allclose(distance, np.linalg.norm((values - values[3]) / scale, axis=1))
    assert distance[3] == 0.0
    assert np.isnan(distance[7])
    plain = feature_distance(values, 3, standardize=False)
    np.testing.assert_allclose(plain, np.linalg.norm(values - values[3], axis=1))
    with raises("vertex-out-of-range", "no vertex 50"):
        feature_distance(values, 50)
    with raises("vertex-unused", "no face uses"):
        feature_distance(values, 7)
