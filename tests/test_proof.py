"""Certificates of eigenpairs: proofs, measured residuals, and refusals with a message."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import shapes
from faults import raises
from test_eigensolver import dense, random_mesh, torus
from tiers import slow_but

from meshmash_viewer.decompose import compute_hks, decompose_laplacian_by_bands
from meshmash_viewer.errors import InputError
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.computation import Computation


def path_graph(n: int, periodic: bool) -> Any:
    ring = sp.lil_array((n, n))
    for i in range(n if periodic else n - 1):
        j = (i + 1) % n
        ring[i, i] += 1.0
        ring[j, j] += 1.0
        ring[i, j] -= 1.0
        ring[j, i] -= 1.0
    return sp.csr_array(ring)


def grid(rows: int, columns: int, periodic: bool = False) -> Any:
    """Return the Laplacian of a grid graph; a periodic grid of 4 × 6 has integer eigenvalues."""
    across = sp.kron(path_graph(rows, periodic), sp.eye_array(columns))
    return sp.csr_array(across + sp.kron(sp.eye_array(rows), path_graph(columns, periodic)))


def with_edge(laplacian: Any, weight: float, i: int = 5, j: int = 6) -> Any:
    edge = ([weight, weight, -weight, -weight], ([i, j, i, j], [i, j, j, i]))
    return sp.csr_array(laplacian + sp.coo_array(edge, shape=laplacian.shape))


def icosahedra(copies: int) -> tuple[Any, Any]:
    """Return matrices of icosahedra of slightly increasing size."""
    one = shapes.icosphere(0)
    scales = 1.0 + 0.03 * np.arange(copies)
    vertices = np.concatenate(
        [one.vertices * scale + [4.0 * i * scale, 0.0, 0.0] for i, scale in enumerate(scales)]
    )
    faces = np.concatenate([one.faces + 12 * i for i in range(copies)])
    return cotangent_laplacian((vertices, faces))


def reduced_spectrum(stiffness: Any, mass: Any) -> np.ndarray:
    root = np.sqrt(mass.diagonal() if hasattr(mass, "diagonal") and mass.ndim == 2 else mass)
    return scipy.linalg.eigvalsh(sp.csr_array(stiffness).toarray() / root[:, None] / root)


# Thresholds ----------------------------------------------------------------------------------


@pytest.mark.parametrize("threshold", slow_but([0.0, 2.0], [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]))
def test_integer_thresholds_of_a_periodic_grid(threshold: float) -> None:
    laplacian, n = grid(30, 40, periodic=True), 1200
    exact = reduced_spectrum(laplacian, np.ones(n))
    values, vectors = decompose_laplacian_by_bands(laplacian, sp.eye_array(n), threshold)
    assert len(values) == np.count_nonzero(exact <= threshold + 1e-9)
    np.testing.assert_allclose(values, exact[: len(values)], atol=1e-10)
    np.testing.assert_allclose(laplacian @ vectors, vectors * values, atol=1e-8)


def test_a_threshold_on_a_diagonal_entry() -> None:
    stiffness, mass = torus(40, 36, 1.0, 1.2)[0]
    weights = mass.diagonal() if hasattr(mass, "diagonal") and mass.ndim == 2 else mass
    entries = np.sort(stiffness.diagonal() / weights)
    exact = dense((stiffness, mass))
    for threshold in (entries[0] * 0.125, exact[200], float(np.nextafter(exact[37], 0.0))):
        result = solve(stiffness, mass, max_eigenvalue=threshold)
        below = np.count_nonzero(exact <= threshold * (1.0 - 1e-9))
        upto = np.count_nonzero(exact <= threshold * (1.0 + 1e-9))
        assert result.n_components in (below, upto)
        assert result.complete


@pytest.mark.slow
def test_no_pair_below_a_threshold_between_copies_is_lost() -> None:
    stiffness, mass = icosahedra(59)
    exact = reduced_spectrum(stiffness, mass)
    rng = np.random.default_rng(0)
    chosen = rng.choice(exact[60:], 12, replace=False)
    for threshold in (0.5911739745509992, *chosen, *np.nextafter(chosen, 0.0)):
        result = solve(stiffness, mass, max_eigenvalue=float(threshold))
        below = np.count_nonzero(exact < threshold * (1.0 - 1e-9))
        upto = np.count_nonzero(exact < threshold * (1.0 + 1e-9))
        assert result.n_components in (below, upto)
        assert result.complete
        np.testing.assert_allclose(result.eigenvalues, exact[: result.n_components], atol=1e-9)
        if upto > below:
            assert "the threshold is an eigenvalue" in result.proof()


def test_the_last_eigenvalue_as_threshold_gives_the_same_pairs_again() -> None:
    stiffness, mass = torus(40, 36, 1.0, 1.0)[0]
    exact = dense((stiffness, mass))
    first = solve(stiffness, mass, 60)
    again = solve(stiffness, mass, max_eigenvalue=first.eigenvalues[-1])
    copies = np.count_nonzero(exact <= first.eigenvalues[-1] * (1.0 + 1e-9))
    assert again.n_components == copies
    np.testing.assert_allclose(again.eigenvalues[:60], first.eigenvalues, rtol=1e-9)


@pytest.mark.parametrize("factor", slow_but([1.01], [1.01, 1.5, 3.0, 1e12]))
def test_a_threshold_above_the_spectrum_gives_all_pairs(factor: float) -> None:
    stiffness, mass = random_mesh(2)
    exact = dense((stiffness, mass))
    result = solve(stiffness, mass, max_eigenvalue=factor * exact[-1])
    assert result.n_components == len(exact)
    assert result.complete
    np.testing.assert_allclose(result.eigenvalues[1:], exact[1:], rtol=1e-8)
    nearest = solve(stiffness, mass, 7, sigma=factor * exact[-1])
    np.testing.assert_allclose(nearest.eigenvalues, exact[-7:], rtol=1e-8)


def test_signatures_of_a_plane_of_unit_cells() -> None:
    plane = shapes.rectangle(31, 31, 30.0, 30.0)
    features = compute_hks(plane, max_eigenvalue=2.0, n_components=3)
    assert np.isfinite(features).all()


# The null space ------------------------------------------------------------------------------


@pytest.mark.parametrize("lift", slow_but([3e-8, 1e-4], [3e-8, 1e-6, 1e-4, 1e-2]))
@pytest.mark.parametrize("weight", [0.0, 1e6, 1e8])
def test_no_zero_where_there_is_none(lift: float, weight: float) -> None:
    n = 1600
    lifted = sp.csr_array(with_edge(grid(40, 40), weight) + lift * sp.eye_array(n))
    result = solve(lifted, np.ones(n), 4)
    np.testing.assert_allclose(result.eigenvalues[0], lift, atol=1e-15 * (1.0 + weight), rtol=1e-6)
    row = result.rows[0]
    residual = np.linalg.norm(lifted @ row - result.eigenvalues[0] * row) / (
        result.eigenvalues[0] * np.linalg.norm(row)
    )
    # Rounding of the measurement in float64, from the stiffest product.
    rounding = 1e-15 * (8.0 + weight) / lift
    np.testing.assert_allclose(result.residuals[0], residual, rtol=0.5, atol=rounding)
    assert result.complete == (result.residuals.max() <= 1e-6)


def test_a_weak_spring_holds_the_whole_grid() -> None:
    n, spring = 900, 1e-7
    held = grid(30, 30).tolil()
    held[7, 7] += spring
    result = solve(sp.csr_array(held), np.ones(n), 3)
    np.testing.assert_allclose(result.eigenvalues[0], spring / n, rtol=1e-4)


def test_null_residuals_are_measured() -> None:
    stiffness, mass = cotangent_laplacian(shapes.three_spheres(3), robust=True)
    result = solve(stiffness, mass, 6)
    assert np.count_nonzero(result.eigenvalues == 0.0) == 3
    spacing = 4.0 * np.pi / mass.diagonal().sum()
    for row, residual in zip(result.rows[:3], result.residuals[:3], strict=True):
        true = np.linalg.norm(stiffness @ row) / np.linalg.norm(mass @ row) / spacing
        # The solver uses the power of two next to the spacing as its unit.
        np.testing.assert_allclose(residual, true, rtol=0.5, atol=1e-14)


def test_only_the_null_vectors_asked_for_are_made() -> None:
    n_triangles = 4000
    rng = np.random.default_rng(0)
    soup = rng.normal(size=(3 * n_triangles, 3)), np.arange(3 * n_triangles).reshape(-1, 3)
    matrices = cotangent_laplacian(soup)
    solve(*matrices, 10)  # compile first
    tracemalloc.start()
    result = solve(*matrices, 10)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert result.complete
    assert not result.eigenvalues.any()
    assert peak < 0.1 * 8 * 3 * n_triangles * n_triangles


def test_vertices_that_only_mass_holds_are_zeros_of_their_own() -> None:
    laplacian = sp.block_diag([grid(30, 30), sp.csr_array((2, 2))]).tocsr()
    laplacian.eliminate_zeros()
    exact = reduced_spectrum(laplacian, np.ones(902))
    result = solve(laplacian, np.ones(902), 8)
    assert result.complete
    np.testing.assert_allclose(result.eigenvalues, exact[:8], atol=1e-12)
    alone = solve(sp.csr_array((5000, 5000)), np.ones(5000), 3)
    assert alone.complete
    assert not alone.eigenvalues.any()


# Refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [20, pytest.param(40, marks=pytest.mark.slow)])
def test_an_indefinite_laplacian_is_refused(n: int) -> None:
    with raises("not-semidefinite", "negative eigenvalue"):
        solve(sp.csr_array(grid(n, n) - 0.5 * sp.eye_array(n * n)), np.ones(n * n), 5)


def test_extremes_are_refused_in_a_sentence() -> None:
    with raises("beyond-floating-point", "range of floating-point"):
        solve(grid(30, 30), np.full(900, 1e-310), 5)
    with raises("beyond-floating-point", "range of floating-point"):
        solve(1e20 * grid(30, 30), np.where(np.arange(900) == 7, 1e-300, 1.0), 5)
    # With an edge of weight 1e16, float64 has no digits left for other edges.
    assert not solve(with_edge(grid(30, 30), 1e16), np.ones(900), 5).complete
    with raises("not-symmetric", "not symmetric"):
        solve(grid(30, 30) + sp.coo_array(([1e-4], ([0], [1])), shape=(900, 900)), np.ones(900), 5)


def test_slivers_whose_vectors_are_not_orthonormal_are_not_called_complete() -> None:
    rng = np.random.default_rng(3)
    flat = shapes.rectangle(31, 31)
    squeezed = flat.vertices * [1.0, 1.0, 1.0]
    squeezed[:, 1] *= np.where(rng.random(len(squeezed)) < 0.5, 1e-9, 1.0)
    try:
        result = solve(*cotangent_laplacian((squeezed, flat.faces)), 120)
    except InputError:
        return
    rows = result.rows * np.sqrt(result.mass)
    orthonormality = np.abs(rows @ rows.T - np.eye(len(rows))).max()
    assert result.complete <= bool(orthonormality < 1e-7)


# A given inverse -----------------------------------------------------------------------------


@pytest.mark.parametrize("side", [12, 30])
def test_a_given_inverse_finds_the_pairs_and_a_poor_one_loses_none(
    side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from scipy.sparse.linalg import LinearOperator, splu

    n, sigma = side * side, -0.01
    laplacian = grid(side, side)
    exact = reduced_spectrum(laplacian, np.ones(n))
    factor = splu(sp.csc_array(laplacian - sigma * sp.eye_array(n)))
    calls = 0

    def apply(column: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return np.asarray(factor.solve(column))

    good = LinearOperator((n, n), matvec=apply, dtype=np.float64)
    with monkeypatch.context() as alone:  # prevent all other methods
        for name in ("_dense", "_sliced"):
            alone.setattr(Computation, name, None)
        result = solve(laplacian, np.ones(n), 12, sigma=sigma, op_inv=good)
    assert calls
    assert result.complete
    np.testing.assert_allclose(result.eigenvalues, exact[:12], atol=1e-10)

    low = np.linalg.eigh(laplacian.toarray())[1][:, 3:6]

    def blind(column: np.ndarray) -> np.ndarray:
        answer = np.asarray(factor.solve(column))
        return answer - low @ (low.T @ answer)  # hides these three eigenvectors

    poor = LinearOperator((n, n), matvec=blind, dtype=np.float64)
    result = solve(laplacian, np.ones(n), 12, sigma=sigma, op_inv=poor)
    assert result.complete
    np.testing.assert_allclose(result.eigenvalues, exact[:12], atol=1e-10)
    with raises("wrong-shape", "shape"):
        solve(laplacian, np.ones(n), 12, op_inv=np.eye(n - 1))
    with raises("missing-argument", "op_inv requires n_components"):
        solve(laplacian, np.ones(n), max_eigenvalue=0.1, op_inv=good)


# Verification --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matrices() -> tuple[Any, Any]:
    return torus(60, 50, 1.0, 1.3)[0]


@pytest.fixture(scope="module")
def proven(matrices: tuple[Any, Any]) -> Eigenpairs:
    return solve(*matrices, 90)


def part(result: Eigenpairs, kept: np.ndarray, **changed: Any) -> Eigenpairs:
    return replace(
        result,
        eigenvalues=changed.get("eigenvalues", result.eigenvalues[kept]),
        rows=changed.get("rows", result.rows[kept]),
        residuals=result.residuals[kept],
    )


def test_verify_agrees_with_the_solver(proven: Eigenpairs, matrices: tuple[Any, Any]) -> None:
    for request in ({"n_components": 40}, {"max_eigenvalue": proven.eigenvalues[50] * 1.01}):
        result = solve(*matrices, **request)
        again = result.verify(*matrices)
        assert again.complete, again.lacks
        assert again.residual < 10.0 * result.certificate.residual + 1e-12
        assert again.orthonormality < 1e-9
    around = solve(*matrices, 20, sigma=float(proven.eigenvalues[60]) * 1.001)
    assert around.verify(*matrices).complete
    alone = solve(*matrices, 1, sigma=float(proven.eigenvalues[60]) * 1.001)
    assert alone.verify(*matrices).complete
    small = random_mesh(0)
    assert solve(*small, 30).verify(*small).complete
    assert solve(*small, 10**6).verify(*small).complete


def test_verify_sees_what_is_wrong(proven: Eigenpairs, matrices: tuple[Any, Any]) -> None:
    everything = np.arange(90)
    lost = part(proven, np.delete(everything, 33))
    assert "found of" in lost.verify(*matrices).lacks[0]
    twice = part(proven, np.sort(np.append(everything[:-1], 33)))
    assert any("orthonormality" in said for said in twice.verify(*matrices).lacks)
    values = proven.eigenvalues.copy()
    values[10] *= 1.0 + 1e-4
    assert "residual" in part(proven, everything, eigenvalues=values).verify(*matrices).lacks[0]
    rows = proven.rows.copy()
    rows[20, 7] += 0.1
    assert not part(proven, everything, rows=rows).verify(*matrices).complete
    with raises("other-mesh", "matrices that were decomposed"):
        proven.verify(*random_mesh(0))


def test_pairs_around_a_shift_that_are_not_the_lowest_are_verified_as_such() -> None:
    n = 900
    path = path_graph(n, periodic=False)
    exact = 2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n)
    shift = float(0.4 * exact[8] + 0.6 * exact[9])
    found = solve(path, sp.identity(n, format="csc"), n_components=12, sigma=shift)
    nearest = np.sort(exact[np.argsort(np.abs(exact - shift))[:12]])
    np.testing.assert_allclose(found.eigenvalues, nearest, rtol=1e-9, atol=1e-12)
    checked = found.verify(path, sp.identity(n, format="csc"))
    assert found.complete
    assert checked.complete, checked
    assert checked.residual <= 2.0 * found.certificate.residual + 1e-13


def test_a_shift_far_above_the_spectrum_gives_the_largest() -> None:
    n = 60
    path = path_graph(n, periodic=False)
    exact = 2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n)
    found = solve(path, sp.identity(n, format="csc"), n_components=5, sigma=1e17)
    np.testing.assert_allclose(found.eigenvalues, exact[-5:], rtol=1e-12)
