"""Maps through a filter of the spectrum, against the dense product."""

from __future__ import annotations

import numpy as np
import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.filters import heat_kernel_bank, low_pass_bank, wave_kernel_bank
from meshmash_viewer.features.smoothing import filter_map
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import Decomposition, solve


@pytest.fixture(scope="module")
def pairs(rectangle: Mesh) -> Decomposition:
    return solve(*cotangent_laplacian(rectangle), 40)


def test_a_map_through_a_filter_is_the_dense_product(
    pairs: Decomposition, rng: np.random.Generator
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


def test_a_low_pass_keeps_what_is_below_it_and_nothing_else(pairs: Decomposition) -> None:
    both = pairs.rows[2] + 3.0 * pairs.rows[30]
    between = 0.5 * (pairs.eigenvalues[2] + pairs.eigenvalues[30])
    smooth = filter_map(pairs, both, low_pass_bank(between))
    np.testing.assert_allclose(smooth, pairs.rows[2], atol=1e-9)
    flat = filter_map(pairs, np.full(len(both), 7.0), low_pass_bank(between))
    np.testing.assert_allclose(flat, 7.0)


def test_a_map_takes_one_filter(pairs: Decomposition) -> None:
    with pytest.raises(InputError, match="filter of one column"):
        filter_map(pairs, pairs.rows[0], wave_kernel_bank(pairs.eigenvalues, 4))


def test_vertices_that_no_face_uses_have_no_say_and_no_value() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    mesh = Mesh(corners, faces)
    pairs = solve(*cotangent_laplacian(mesh), 4)
    found = filter_map(pairs, np.array([2.0, 2.0, 2.0, 2.0, np.nan]), lambda x: np.exp(-x))
    np.testing.assert_allclose(found, [2.0, 2.0, 2.0, 2.0, np.nan])
