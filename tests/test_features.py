"""Features: sums of coefficients times squared eigenvectors."""

from __future__ import annotations

import json

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.features.filters import heat_kernel_bank
from meshmash_viewer.features.sums import Features, accumulate_features, compute_features
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigensolver import solve


@pytest.fixture(scope="module")
def decomposition(sphere):
    return solve(*cotangent_laplacian(sphere), 40)


@pytest.fixture
def features(decomposition) -> Features:
    bank = heat_kernel_bank([0.5, 1.0, 2.0])
    return compute_features(decomposition, bank, unit="nm", warn=False)


@pytest.mark.parametrize(("k", "n"), [(1, 5), (31, 100), (33, 16385), (70, 40000)])
def test_chunks_make_no_difference(rng, k, n):
    rows, coefficients = rng.standard_normal((k, n)), rng.standard_normal((6, k))
    expected = np.einsum("fk,kn->nf", coefficients, rows**2)
    actual = accumulate_features(rows, coefficients)
    np.testing.assert_allclose(actual, expected, atol=1e-11)
    assert actual.flags.c_contiguous


def test_rows_may_be_a_memory_map_of_float32(rng, tmp_path):
    rows = np.memmap(tmp_path / "rows", np.float32, "w+", shape=(50, 200))
    rows[:] = rng.standard_normal((50, 200))
    coefficients = rng.random((4, 50))
    expected = (rows.astype(np.float64) ** 2).T @ coefficients.T
    actual = accumulate_features(rows, coefficients)
    assert actual.dtype == np.float64
    np.testing.assert_allclose(actual, expected, rtol=1e-13)


def test_nan_rows_stay_nan_and_touch_nothing_else(rng):
    rows = rng.standard_normal((8, 30))
    clean = accumulate_features(rows, np.ones((2, 8)))
    rows[:, 4] = np.nan
    features = accumulate_features(rows, np.ones((2, 8)))
    assert np.isnan(features[4]).all()
    np.testing.assert_array_equal(np.delete(features, 4, 0), np.delete(clean, 4, 0))


@pytest.mark.parametrize("shape", [(8,), (3, 7), (8, 3), (1, 1, 8)])
def test_coefficients_of_a_wrong_shape_are_refused(shape):
    with raises("wrong-filter", "for 8 eigenvalues"):
        accumulate_features(np.ones((8, 5)), np.ones(shape))


def test_columns_and_units_follow_bank_and_mesh(decomposition):
    bank = heat_kernel_bank([0.2, 0.5])
    features = compute_features(decomposition, bank, unit="nm")
    assert features.columns == bank.columns
    assert (features.unit, features.kind) == ("nm⁻²", "hks")
    assert features.meta["parameter_unit"] == "nm²"
    assert features.meta["parameters"] == [0.2, 0.5]
    json.dumps(features.meta)
    direct = decomposition.eigenvectors**2 @ bank(decomposition.eigenvalues).T
    np.testing.assert_allclose(features.values, direct, rtol=1e-12)
    assert compute_features(decomposition, bank).unit == ""


def test_one_name_a_column():
    with raises("wrong-shape", "column"):
        Features(np.zeros((4, 2)), ("a",))


def test_a_component_is_remarked_on_where_its_features_are_out_of_proportion(three_spheres):
    labels, values = three_spheres.component_labels, np.ones((three_spheres.n_vertices, 2))
    assert Features(values, ("a", "b")).remarks(three_spheres) == []
    values[np.flatnonzero(labels == 0)[0], 1] = 1e9  # in the largest component
    assert Features(values, ("a", "b")).remarks(three_spheres) == []
    values[labels == 2, 1] = 1e7
    (remark,) = Features(values, ("a", "b")).remarks(three_spheres)
    assert "values are up to 10,000,000 times" in remark
    assert "on 1 tiny component (162 vertices)" in remark


def test_a_filter_that_lets_no_pair_through_keeps_what_has_no_value() -> None:
    rows = np.array([[1.0, np.nan, 2.0], [3.0, np.nan, 4.0]])
    sums = accumulate_features(rows, np.zeros((1, 2)))
    np.testing.assert_array_equal(sums, [[0.0], [np.nan], [0.0]])


def test_features_are_taken_as_arrays(features: Features) -> None:
    values = features.values
    assert np.asarray(features) is values
    assert np.asarray(features, np.float32).dtype == np.float32
    assert not np.shares_memory(np.array(features), values)
    np.testing.assert_array_equal(np.log(features), np.log(values))
    np.testing.assert_array_equal(np.column_stack([features, features[:, 0]])[:, :-1], values)
    np.testing.assert_array_equal(np.mean(features, axis=0), values.mean(axis=0))
    assert (features.shape, features.ndim, features.dtype) == (values.shape, 2, np.float64)
    assert len(features) == len([*features]) == len(values)
    for index in (3, slice(2, 9), (slice(None), -1), values[:, 0] > 0.3, [4, 1], (..., 0), (2, 1)):
        np.testing.assert_array_equal(features[index], values[index])
    for place, name in enumerate(features.columns):
        np.testing.assert_array_equal(features[name], values[:, place])
    with pytest.raises(KeyError, match="columns are hks_t=5"):
        features["hks"]


def test_features_are_a_frame_with_names(features: Features) -> None:
    pandas = pytest.importorskip("pandas")
    frame = features.to_frame()
    assert tuple(frame.columns) == features.columns
    np.testing.assert_array_equal(frame.to_numpy(), features.values)
    assert frame.attrs == {"unit": features.unit, "kind": "hks"}
    frame.iloc[0, 0] = -1.0
    assert features.values[0, 0] > 0.0
    named = pandas.DataFrame(features, columns=features.columns)
    np.testing.assert_array_equal(named[features.columns[1]], features.values[:, 1])
