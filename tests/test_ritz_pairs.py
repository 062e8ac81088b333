"""Rayleigh–Ritz pairs: rotation, orthonormality, quotients and residuals by definition."""

from __future__ import annotations

import numpy as np
import pytest
from test_eigensolver import torus

from meshmash_viewer.spectral.engine.basis import orthonormalise, subtract
from meshmash_viewer.spectral.engine.factorization import order_pencil
from meshmash_viewer.spectral.engine.pencil import reduce_pencil
from meshmash_viewer.spectral.engine.refinement import measure_pairs, rotate_to_pairs


@pytest.mark.parametrize("p", [3, 37, 100])
def test_rotation_takes_mixed_neighbours_apart(p: int) -> None:
    matrices, exact = torus(30, 26, 1.0, 1.2)
    ordered = order_pencil(reduce_pencil(*matrices))
    pencil = ordered.pencil
    truth, columns = np.linalg.eigh(pencil.matrix.toarray())
    random = np.random.default_rng(3)
    mixing = np.eye(p) + 1e-3 * random.standard_normal((p, p))
    rows = np.ascontiguousarray(mixing @ columns.T[1 : 1 + p])
    pairs = rotate_to_pairs(ordered, rows)
    np.testing.assert_allclose(pairs.values, truth[1 : 1 + p], rtol=1e-11)
    np.testing.assert_allclose(pairs.values * pencil.unit, exact[1 : 1 + p], rtol=1e-9)
    assert pairs.orthonormality is not None
    assert pairs.orthonormality < 1e-13
    assert measure_pairs(ordered, rows)[1].max() < 1e-9


def test_rotation_refuses_the_same_pair_twice() -> None:
    ordered = order_pencil(reduce_pencil(*torus(30, 26, 1.0, 1.2)[0]))
    row = np.linalg.eigh(ordered.pencil.matrix.toarray())[1].T[5]
    rows = np.stack([row, row + 1e-9 * np.roll(row, 1)])
    with pytest.raises(ArithmeticError, match="twice"):
        rotate_to_pairs(ordered, rows)


def test_what_is_subtracted_and_multiplied_is_that_of_the_definition() -> None:
    random = np.random.default_rng(5)
    rows, target = random.standard_normal((40, 9001)), random.standard_normal((8, 9001))
    weights = random.standard_normal((8, 5)), random.standard_normal((8, 11))
    wanted = target - weights[0] @ rows[:5] - weights[1] @ rows[9:20]
    sources = [(weights[0], rows[:5]), (weights[1], rows[9:20])]
    products = subtract(target, sources, [rows[3:6], target])
    np.testing.assert_allclose(target, wanted, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(products[0], wanted @ rows[3:6].T, rtol=1e-10)
    np.testing.assert_allclose(products[1], wanted @ wanted.T, rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("p", [1, 8, 11])
@pytest.mark.parametrize("exactly", [False, True])
def test_quotients_and_residuals_are_those_of_the_definition(p: int, exactly: bool) -> None:
    ordered = order_pencil(reduce_pencil(*torus(12, 10, 1.0, 1.2)[0]))
    pencil = ordered.pencil
    rows = np.random.default_rng(p).standard_normal((p, pencil.n))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    values, residuals = measure_pairs(ordered, rows.copy(), exactly)
    images = rows @ pencil.matrix.toarray()
    np.testing.assert_allclose(values, np.sum(rows * images, axis=1), rtol=1e-12)
    defects = (images - values[:, None] * rows) * pencil.root_mass
    sizes = np.linalg.norm(rows * pencil.root_mass, axis=1)
    np.testing.assert_allclose(residuals, np.linalg.norm(defects, axis=1) / sizes, rtol=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("size", [1e-12, 1e-6, 0.1])
def test_rows_are_made_orthonormal_whatever_the_sign_of_their_products(
    sign: float, size: float
) -> None:
    random = np.random.default_rng(7)
    rows = np.ascontiguousarray(np.linalg.qr(random.standard_normal((9000, 3)))[0].T)
    span = rows.copy()
    rows[1] += sign * size * rows[0]
    rows[2] *= 1.0 + sign * size
    assert orthonormalise(rows) < 1e-13
    assert np.abs(rows @ rows.T - np.eye(3)).max() < 1e-13
    np.testing.assert_allclose(np.linalg.svd(rows @ span.T, compute_uv=False), 1.0, rtol=1e-12)
    rows[2] = rows[0] + 0.2 * rows[1]
    with pytest.raises(ArithmeticError, match="twice"):
        orthonormalise(rows)
