"""The block Krylov basis: a true projection, also where its space has run out; Rayleigh–Ritz."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from test_eigensolver import torus
from test_eigensolver_hard import icosphere

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.engine import lanczos
from meshmash_viewer.spectral.engine.basis import BLOCK, KrylovBasis
from meshmash_viewer.spectral.engine.factorization import Factor, FactorizationError, order_pencil
from meshmash_viewer.spectral.engine.lanczos import Interval, measure_pairs, rotate_to_pairs
from meshmash_viewer.spectral.engine.orthogonality import orthonormalise, subtract
from meshmash_viewer.spectral.engine.pencil import reduce_pencil

STOP = np.zeros(1, dtype=np.uint8)


@pytest.mark.parametrize("known", [0, 100])
@pytest.mark.parametrize("seed", range(5))
def test_projection_is_that_of_the_inverse_beyond_the_end_of_the_krylov_space(
    known: int, seed: int
) -> None:
    # Some ten different eigenvalues: eight times that many dimensions can be reached from a block.
    stiffness, mass = icosphere(1)
    copies = 20
    ordered = order_pencil(
        reduce_pencil(sp.block_diag([stiffness] * copies).tocsc(), np.tile(mass.diagonal(), copies))
    )
    pencil = ordered.pencil
    values, columns = np.linalg.eigh(pencil.matrix.toarray())
    first = pencil.n_null
    # Known as well as a slice knows its pairs.
    noise = 1e-10 * np.random.default_rng(seed).standard_normal((known, pencil.n))
    found = np.linalg.qr((columns.T[first : first + known] + noise).T)[0].T
    shift = 0.55 * float(values[first + known + 1])
    factor = ordered.factor(shift, 0.01 * shift, STOP)
    basis = KrylovBasis(ordered, factor, np.ascontiguousarray(found), 240, (seed,), STOP)
    while basis.size < 200:
        basis.extend()

    rows = basis.rows[: basis.size]
    known_rows = np.concatenate([pencil.null_rows(first), found])
    assert np.abs(rows @ rows.T - np.eye(len(rows))).max() < 1e-6
    assert np.abs(rows @ known_rows.T).max() < 1e-6
    shifted = pencil.matrix.toarray() - factor.shift * np.eye(pencil.n)
    image = np.linalg.solve(shifted, rows.T)
    projection = np.tril(basis._projection[: basis.size, : basis.size])
    projection += np.tril(projection, -1).T
    scale = np.abs(projection).max()
    assert np.abs(rows @ image - projection).max() < 1e-6 * scale
    # Nothing but the next block is missing: what a Ritz pair's error is judged by.
    defect = image - rows.T @ projection
    defect -= known_rows.T @ (known_rows @ defect)
    following = basis.rows[basis.size : basis.size + BLOCK]
    defect[:, -BLOCK:] -= following.T @ basis._coupling.T
    assert np.abs(defect).max() < 1e-6 * scale


def test_a_basis_stops_when_asked() -> None:
    stiffness, mass = icosphere(2)
    ordered = order_pencil(reduce_pencil(stiffness, mass))
    stop = np.zeros(1, dtype=np.uint8)
    nothing = np.zeros((0, ordered.pencil.n))
    basis = KrylovBasis(ordered, ordered.factor(1.5, 0.1, stop), nothing, 40, (0,), stop)
    basis.extend()
    stop[0] = 1
    with pytest.raises(Cancelled):
        basis.extend()


@pytest.mark.parametrize("p", [3, 37, 100])
def test_rotation_takes_mixed_neighbours_apart(p: int) -> None:
    matrices, exact = torus(30, 26, 1.0, 1.2)
    ordered = order_pencil(reduce_pencil(*matrices))
    pencil = ordered.pencil
    truth, columns = np.linalg.eigh(pencil.matrix.toarray())
    random = np.random.default_rng(3)
    mixing = np.eye(p) + 1e-3 * random.standard_normal((p, p))
    rows = np.ascontiguousarray(mixing @ columns.T[1 : 1 + p])
    values, orthonormality = rotate_to_pairs(ordered, rows)
    np.testing.assert_allclose(values, truth[1 : 1 + p], rtol=1e-11)
    np.testing.assert_allclose(values * pencil.unit, exact[1 : 1 + p], rtol=1e-9)
    assert orthonormality < 1e-13
    assert measure_pairs(ordered, rows)[1].max() < 1e-9


def test_rotation_refuses_the_same_pair_twice() -> None:
    ordered = order_pencil(reduce_pencil(*torus(30, 26, 1.0, 1.2)[0]))
    row = np.linalg.eigh(ordered.pencil.matrix.toarray())[1].T[5]
    rows = np.stack([row, row + 1e-9 * np.roll(row, 1)])
    with pytest.raises(ArithmeticError, match="twice"):
        rotate_to_pairs(ordered, rows)


def test_a_pivot_that_vanishes_is_said() -> None:
    ordered = order_pencil(reduce_pencil(sp.csc_array([[1.0, -1.0], [-1.0, 1.0]]), np.ones(2)))
    on_the_diagonal = float(ordered.pencil.matrix.diagonal()[0])
    with pytest.raises(FactorizationError, match="a pivot vanished"):
        Factor(ordered, on_the_diagonal, STOP)


@pytest.mark.parametrize(("low", "tried"), [(-1.0, 3), (1.0, 1)])
def test_lowest_slice_takes_the_soundest_factor_near_its_shift(low: float, tried: int) -> None:
    errors = {5.0: 1e-13, 5.3: 3e-14, 4.7: 5e-14} if low < 0.0 else {5.0: 1e-13}
    width = 10.0
    made: list[float] = []

    class Ordered:
        def factor(self, shift: float, _nudge: float, _stop: Any) -> Any:
            made.append(round(shift, 9))
            return SimpleNamespace(shift=shift, error=errors[made[-1]])

    interval = Interval(0, low, low + width, 0, 50, 5.0)
    ordered: Any = Ordered()
    best = lanczos._factor(ordered, interval, np.zeros(1, dtype=np.uint8))
    assert len(made) == tried
    assert best.error == min(errors.values())


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


@pytest.mark.parametrize("p", [1, 11])
def test_rounding_is_that_of_the_entries_of_the_matrix_and_the_row(p: int) -> None:
    ordered = order_pencil(reduce_pencil(*icosphere(2)))
    pencil, random = ordered.pencil, np.random.default_rng(p)
    rows = random.standard_normal((p, pencil.n)) * 10.0 ** random.uniform(-3, 3, (p, 1))
    matrix = abs(pencil.matrix.toarray())
    half = 0.5 * np.finfo(np.float64).eps
    for row, found in zip(rows, lanczos._rounding(ordered, rows), strict=True):
        # Every product changed by half a unit in its last place, all in the worst direction.
        change = half * (matrix @ abs(row)) * pencil.root_mass
        size = np.linalg.norm(row * pencil.root_mass)
        assert found == pytest.approx(np.linalg.norm(change) / size, rel=1e-12, abs=0.0)
