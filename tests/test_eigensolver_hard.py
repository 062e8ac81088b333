"""The eigensolver in difficult cases: multiplets, clusters, slivers, killed workers."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import time
from typing import Any

import numpy as np
import psutil
import pytest
import scipy.sparse as sp
from test_eigensolver import Matrices, check, dense, random_mesh, torus
from tiers import slow_but

from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.engine.factorization import order_pencil
from meshmash_viewer.spectral.engine.lanczos import find_pairs, run_slices
from meshmash_viewer.spectral.engine.pairs import Interval
from meshmash_viewer.spectral.engine.pencil import reduce_pencil
from meshmash_viewer.spectral.engine.plan import SpectrumPlan


def icosphere(subdivisions: int) -> Matrices:
    """Return the cotangent Laplacian and lumped mass of the unit icosphere."""
    import robust_laplacian
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    vertices, faces = np.array(sphere.vertices), np.array(sphere.faces)
    stiffness, mass = robust_laplacian.mesh_laplacian(vertices, faces)
    return stiffness, mass


def strip(n: int, split: float) -> Matrices:
    """Return two long chains whose eigenvalues differ relatively by `split`."""
    chain = sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    chain = sp.lil_array(chain)
    chain[0, 0] = chain[n - 1, n - 1] = 1.0
    both = sp.block_diag([chain, (1.0 + split) * chain]).tocsc()
    return both, sp.eye_array(2 * n)


def test_multiplets_of_the_sphere_at_slice_borders_are_whole() -> None:
    matrices = icosphere(4)
    decomposition = solve(*matrices, 15**2)  # degrees 0 to 14, multiplicity up to 29
    assert decomposition.complete
    assert decomposition.orthonormality < 1e-10
    degree = np.repeat(np.arange(15), 2 * np.arange(15) + 1)
    exact = degree * (degree + 1.0)
    # Linear elements have errors of order λ² h², too small to swap two degrees.
    np.testing.assert_allclose(decomposition.eigenvalues[1:], exact[1:], rtol=0.08)


@pytest.mark.parametrize(
    ("copies", "k"),
    # k ends within 150 copies of the fivefold eigenvalue, or 600 copies of the threefold.
    [(30, 170), pytest.param(200, 700, marks=pytest.mark.slow)],
)
def test_many_equal_spheres(copies: int, k: int) -> None:
    stiffness, mass = icosphere(1)
    many = sp.block_diag([stiffness] * copies).tocsc()
    masses = np.tile(mass.diagonal(), copies)
    exact = np.repeat(dense((stiffness, mass)), copies)
    exact[:copies] = 0.0
    decomposition = solve(many, masses, k)
    assert decomposition.complete
    np.testing.assert_allclose(decomposition.eigenvalues, exact[:k], rtol=1e-9, atol=1e-12)
    assert decomposition.orthonormality < 1e-10
    image = masses[:, None] * decomposition.eigenvectors
    defects = many @ decomposition.eigenvectors - image * decomposition.eigenvalues
    residuals = np.linalg.norm(defects, axis=0) / np.linalg.norm(image, axis=0)
    residuals[copies:] /= decomposition.eigenvalues[copies:]
    assert residuals.max() < 1e-9
    # Rows orthogonalized after the measurement have a bound as their residual.
    assert np.all(decomposition.residuals > 0.9 * residuals - 1e-12)
    assert decomposition.residuals.max() < 3e-9


def test_threshold_exactly_on_an_eigenvalue_keeps_all_its_copies() -> None:
    matrices = icosphere(3)
    values = solve(*matrices, 60).eigenvalues
    for last in (3, 8, 15, 24):
        decomposition = solve(*matrices, max_eigenvalue=float(values[last]))
        assert decomposition.n_components == last + 1
        assert decomposition.complete
        copies = np.count_nonzero(np.isclose(values, values[last], rtol=1e-9, atol=0.0))
        said = "which is included" if copies == 1 else f"whose {copies} copies are included"
        assert said in decomposition.certificate.remark


@pytest.mark.parametrize("off", slow_but([0.0], [0.0, 1e-13, 1e-9, 1e-6]))
def test_shift_on_an_eigenvalue_costs_no_digit(off: float) -> None:
    matrices = random_mesh(33)
    exact = dense(matrices)
    for index in (11, 23, 42, 65):
        sigma = float(exact[index] * (1.0 + off))
        nearest = np.sort(exact[np.argsort(np.abs(exact - sigma))[:12]])
        found = solve(*matrices, 12, sigma=sigma)
        np.testing.assert_allclose(found.eigenvalues, nearest, rtol=1e-9)
        assert found.residuals.max() < 1e-9


def test_pairs_a_billionth_apart_are_told_from_one() -> None:
    n = 1500
    matrices = strip(n, 1e-9)
    decomposition = solve(*matrices, 120)
    single = 4.0 * np.sin(0.5 * np.pi * np.arange(61) / n) ** 2
    exact = np.sort(np.concatenate([single, single * (1.0 + 1e-9)]))[:120]
    assert decomposition.complete
    floor = 3e-13 * 4.0
    np.testing.assert_allclose(decomposition.eigenvalues, exact, rtol=1e-10, atol=floor)
    assert decomposition.orthonormality < 1e-10


def test_mesh_of_slivers() -> None:
    import robust_laplacian

    rng = np.random.default_rng(3)
    points = rng.random((1500, 2)) * [1.0, 1e-4]
    from scipy.spatial import Delaunay

    faces = Delaunay(points * [1.0, 1e4]).simplices
    vertices = np.column_stack([points, np.zeros(1500)])
    matrices = robust_laplacian.mesh_laplacian(vertices, faces)
    decomposition = solve(*matrices, 60)
    assert decomposition.complete
    exact = dense(matrices)[:60]
    np.testing.assert_allclose(decomposition.eigenvalues[1:], exact[1:], rtol=1e-6)


@pytest.mark.slow
def test_all_but_one_pair_beyond_the_dense_size() -> None:
    matrices, exact = torus(52, 50, 1.0, 1.1)
    decomposition = solve(*matrices, 52 * 50 - 1)
    check(decomposition, exact[:-1])


def slice_of(matrices: Matrices, low: int, high: int) -> tuple[Any, list[Interval]]:
    """Return the pencil in elimination order, and its slices between two counts."""
    ordered = order_pencil(reduce_pencil(*matrices))
    plan = SpectrumPlan(ordered, lambda pairs: [pairs / 2] * 2)
    ends = plan.find(low, low + 5), plan.find(high, high + 5)
    return ordered, list(plan.slices(*ends))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_residuals_high_in_the_spectrum_are_small_against_their_slice(tolerance: float) -> None:
    # Eigenvectors of two slices are orthogonal only up to residual over distance of slices.
    ordered, intervals = slice_of(torus(50, 40, 1.0, 1.3)[0], 1000, 1060)
    interval = intervals[0]
    pairs = find_pairs(ordered, interval, tolerance)
    assert interval.high - interval.low < 0.05 * interval.low
    assert pairs.residuals.max() <= tolerance * (interval.high - interval.low)


def test_leaving_slices_ends_their_threads() -> None:
    ordered, intervals = slice_of(torus(50, 40, 1.0, 1.3)[0], 20, 240)
    threads = threading.active_count()
    slices = run_slices(ordered, 8 * intervals, 1e-10, 2)
    next(slices)
    slices.close()
    assert threading.active_count() == threads


@pytest.mark.slow
def test_cancel_at_random_moments_leaves_nothing_behind() -> None:
    matrices = random_mesh(22, copies=3)
    solve(*matrices, 200)  # Start threads before counting them.
    rng = np.random.default_rng(0)
    threads = threading.active_count()
    children = len(psutil.Process().children(recursive=True))
    cancelled = 0
    for _ in range(20):
        due = time.perf_counter() + float(rng.uniform(0.0, 0.3))
        try:
            solve(*matrices, 600, n_jobs=2, cancel=lambda due=due: time.perf_counter() > due)
        except Cancelled:
            cancelled += 1
    assert cancelled > 10
    gc.collect()
    # joblib's thread pool may need a moment to end.
    for _ in range(200):
        if threading.active_count() <= threads:
            break
        time.sleep(0.05)
    assert threading.active_count() <= threads
    assert len(psutil.Process().children(recursive=True)) == children


def run_for_ever(started: Any) -> None:
    stiffness, mass = torus(70, 60, 1.0, 1.0)[0]
    started.set()
    while True:
        solve(stiffness, mass, 500, n_jobs=2)


@pytest.mark.slow
def test_terminated_parent_leaves_no_process() -> None:
    context = multiprocessing.get_context("spawn")
    started = context.Event()
    process = context.Process(target=run_for_ever, args=(started,))
    process.start()
    assert started.wait(60)
    time.sleep(0.5)
    family = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGTERM)
    process.join(60)
    assert process.exitcode is not None
    _, alive = psutil.wait_procs(family, timeout=60)
    assert not alive
