"""Spectral filters of maps, compared with the dense product."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.errors import MissingValuesWarning
from meshmash_viewer.features.filters import heat_kernel_bank, low_pass_bank
from meshmash_viewer.features.map_spectrum import map_spectrum
from meshmash_viewer.features.maps import filter_map, reconstruct, spectral_coefficients
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.vertex_map import Label, VertexMap


@pytest.fixture(scope="module")
def pairs(rectangle: Mesh) -> Eigenpairs:
    return solve(*cotangent_laplacian(rectangle), 40)


def test_a_map_through_a_filter_is_the_dense_product(
    pairs: Eigenpairs, rng: np.random.Generator
) -> None:
    values = rng.standard_normal((pairs.rows.shape[1], 3))
    dense = (
        pairs.rows.T
        @ np.diag(np.exp(-0.1 * pairs.eigenvalues))
        @ pairs.rows
        @ np.diag(pairs.mass)
        @ values
    )
    for response in (heat_kernel_bank([0.1]), lambda x: np.exp(-0.1 * x)):
        np.testing.assert_allclose(filter_map(pairs, values, response), dense, atol=1e-12)
        one = filter_map(pairs, values[:, 1], response)
        np.testing.assert_allclose(one, dense[:, 1], atol=1e-12)


def test_a_low_pass_keeps_what_is_below_it_and_nothing_else(pairs: Eigenpairs) -> None:
    both = pairs.rows[2] + 3.0 * pairs.rows[30]
    between = 0.5 * (pairs.eigenvalues[2] + pairs.eigenvalues[30])
    smooth = filter_map(pairs, both, low_pass_bank(between))
    np.testing.assert_allclose(smooth, pairs.rows[2], atol=1e-9)
    flat = filter_map(pairs, np.full(len(both), 7.0), low_pass_bank(between))
    np.testing.assert_allclose(flat, 7.0)


@pytest.mark.parametrize("n_filters", [1, 2, 5])
@pytest.mark.parametrize("n_maps", [None, 1, 3])
def test_many_maps_through_many_filters(
    pairs: Eigenpairs, rng: np.random.Generator, n_filters: int, n_maps: int | None
) -> None:
    values = rng.standard_normal((pairs.rows.shape[1], *([] if n_maps is None else [n_maps])))
    bank = heat_kernel_bank(np.geomspace(0.01, 1.0, n_filters))
    found = filter_map(pairs, values, bank)
    assert found.shape == (*values.shape, *([] if n_filters == 1 else [n_filters]))
    for at, weights in enumerate(bank(pairs.eigenvalues)):
        dense = pairs.rows.T @ (weights[:, None] * pairs.rows) @ (pairs.mass * values.T).T
        one = found if n_filters == 1 else found[..., at]
        np.testing.assert_allclose(one, dense, atol=1e-12)


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_vertices_without_a_value_have_no_weight(pairs: Eigenpairs, missing: float) -> None:
    n = pairs.rows.shape[1]
    gaps, low = np.arange(0, n, 40), low_pass_bank(0.5 * pairs.eigenvalues[5])
    flat, wave = np.full(n, 7.0), pairs.rows[3] + 2.0
    holed = np.column_stack([flat, wave, flat])
    holed[gaps, :2] = missing
    with pytest.warns(MissingValuesWarning, match=f"{len(gaps)} of {n:,} vertices .* no weight"):
        found = filter_map(pairs, holed, low)
    np.testing.assert_allclose(found[:, [0, 2]], 7.0)
    # Interpolated values are far nearer to the missing values than the mean.
    assert np.abs(found[:, 1] - wave).max() < 0.1 * np.abs(wave - 2.0).max()
    with pytest.warns(MissingValuesWarning):
        coefficients = spectral_coefficients(pairs.eigenvectors, pairs.mass, holed)
    with pytest.warns(MissingValuesWarning):
        spectrum = map_spectrum(pairs, holed[:, 1])
    np.testing.assert_allclose(coefficients[:, 1], spectrum.coefficients, atol=1e-12)
    assert spectrum.share(pairs.n_components) <= 1.0


@pytest.mark.parametrize(
    ("call", "code", "word"),
    [
        (lambda p, f, h: filter_map(f, p, h), "wrong-type", "Pairs of filter_map(pairs, values,"),
        (
            lambda p, f, h: filter_map(h, f, p),
            "wrong-type",
            "have type FilterBank: give the result",
        ),
        (lambda p, f, h: filter_map(p, h, f), "wrong-type", "Last arguments of filter_map"),
        (lambda p, f, h: filter_map(p, h, h), "wrong-type", "or (1200, d), in this order"),
        (lambda p, f, h: filter_map(p, f, 3.0), "wrong-type", "type float: give a filter"),
        (lambda p, f, h: filter_map(p, f[:-1], h), "wrong-shape", "have shape (1199,)"),
        (lambda p, f, h: filter_map(p, f.astype(str), h), "wrong-type", "not of real numbers"),
        (lambda p, f, h: filter_map(p, f * 1j, h), "wrong-type", "not of real numbers"),
        (lambda p, f, h: filter_map(p, np.full_like(f, np.nan), h), "no-values", "no finite value"),
        (lambda p, f, h: filter_map(p, f, lambda x: x[1:]), "wrong-filter", "returned shape"),
        (lambda p, f, h: filter_map(p, f, lambda x: x * np.nan), "wrong-filter", "returned nan"),
        (lambda p, f, h: filter_map(p, f, lambda x: None), "wrong-filter", "returned None"),
        (lambda p, f, h: map_spectrum(f, p), "wrong-type", "Pairs of map_spectrum(pairs, values)"),
        (lambda p, f, h: map_spectrum(p, [f, f]), "wrong-shape", "one number per vertex"),
        (lambda p, f, h: spectral_coefficients(p, p.mass, f), "wrong-type", "such as `pairs.eig"),
        (lambda p, f, h: reconstruct(p.eigenvectors, [1.0, np.nan]), "not-finite", "t 1 is nan"),
    ],
)
def test_what_is_no_map_or_in_another_order_gets_a_sentence(
    pairs: Eigenpairs, call: Callable[..., object], code: str, word: str
) -> None:
    with raises(code, word):
        call(pairs, pairs.rows[3].copy(), low_pass_bank(1.0))


def test_a_map_with_a_name_is_a_map_and_labels_are_none(pairs: Eigenpairs) -> None:
    wave = pairs.rows[3]
    found = filter_map(pairs, VertexMap("wave", wave), low_pass_bank(1e9))
    np.testing.assert_allclose(found, wave, atol=1e-9)
    parts = VertexMap("parts", np.zeros(len(wave), dtype=int), (Label(0, "all", "#808080"),))
    with raises("labels-not-values", "not values of a function"):
        filter_map(pairs, parts, low_pass_bank(1e9))


def test_vertices_that_no_face_uses_have_no_say_and_no_value() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    mesh = Mesh(corners, faces)
    pairs = solve(*cotangent_laplacian(mesh), 4)
    found = filter_map(pairs, np.array([2.0, 2.0, 2.0, 2.0, np.nan]), lambda x: np.exp(-x))
    np.testing.assert_allclose(found, [2.0, 2.0, 2.0, 2.0, np.nan])
