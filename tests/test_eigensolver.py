"""The eigensolver against closed forms, dense solutions and invariances."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import scipy.linalg
import scipy.sparse as sp
import shapes
from faults import raises
from scipy.sparse.csgraph import connected_components
from tiers import slow_but

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.progress import Cancelled, Progress
from meshmash_viewer.spectral.cost import estimate_memory
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.eigensolver import solve

Matrices = tuple[Any, Any]
N_POINTS = 800


def ring(n: int, length: float) -> Any:
    """Return second differences on a circle of n points."""
    step = length / n
    shape = sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    matrix = sp.lil_array(shape)
    matrix[0, n - 1] = matrix[n - 1, 0] = -1.0
    return sp.csr_array(matrix) / step**2


def torus(nx: int, ny: int, a: float, b: float) -> tuple[Matrices, npt.NDArray[np.float64]]:
    """Return (L, M) of a flat torus a x b by finite differences, and all exact eigenvalues."""
    cell = a * b / (nx * ny)
    pencil = sp.kron(ring(nx, a), sp.eye_array(ny)) + sp.kron(sp.eye_array(nx), ring(ny, b))
    one = (2 * nx / a * np.sin(np.pi * np.arange(nx) / nx)) ** 2
    two = (2 * ny / b * np.sin(np.pi * np.arange(ny) / ny)) ** 2
    exact = np.sort((one[:, None] + two[None, :]).ravel())
    return (sp.csc_array(pencil * cell), sp.diags_array(np.full(nx * ny, cell))), exact


def random_mesh(seed: int, copies: int = 1) -> Matrices:
    """Return an irregular weighted graph Laplacian with uneven masses, in several components."""
    rng = np.random.default_rng(seed)
    blocks, masses = [], []
    for _ in range(copies):
        points = rng.random((N_POINTS, 2))
        from scipy.spatial import Delaunay

        triangles = Delaunay(points).simplices
        i = triangles[:, [0, 1, 2]].ravel()
        j = triangles[:, [1, 2, 0]].ravel()
        weights = np.exp(rng.normal(0.0, 1.0, len(i)))
        adjacency = sp.coo_array((weights, (i, j)), shape=(N_POINTS, N_POINTS)).tocsr()
        adjacency = adjacency + adjacency.T
        blocks.append(sp.diags_array(adjacency.sum(axis=1)) - adjacency)
        masses.append(np.exp(rng.normal(-7.0, 1.0, N_POINTS)))
    return sp.csc_array(sp.block_diag(blocks)), sp.diags_array(np.concatenate(masses))


def dense(matrices: Matrices) -> npt.NDArray[np.float64]:
    """Return all eigenvalues, sorted, from a dense matrix for each connected component."""
    stiffness, mass = sp.csr_array(matrices[0]), matrices[1].diagonal()
    n_components, component = connected_components(stiffness)
    values = []
    for number in range(n_components):
        kept = np.flatnonzero(component == number)
        scale = 1.0 / np.sqrt(mass[kept])
        block = stiffness[kept][:, kept].toarray()
        values.append(scipy.linalg.eigvalsh(scale[:, None] * block * scale))
    return np.sort(np.concatenate(values))


def check(decomposition: Eigenpairs, exact: npt.NDArray[np.float64]) -> None:
    """Check eigenvalues, residuals, orthonormality and certificate."""
    assert decomposition.complete
    floor = 1e-9 * exact[exact > 1e-9 * exact[-1]][:1].sum()
    np.testing.assert_allclose(decomposition.eigenvalues, exact, rtol=1e-9, atol=floor)
    assert decomposition.residuals.max() < 1e-9
    assert decomposition.orthonormality < 1e-10


def test_torus_multiplicities_match_the_closed_form() -> None:
    matrices, exact = torus(40, 40, 1.0, 1.0)  # four- and eightfold eigenvalues
    for k in (1, 7, 49, 150):
        decomposition = solve(*matrices, k)
        check(decomposition, exact[:k])
        assert decomposition.rows.shape == (k, 1600)


def test_threshold_counts_first_and_keeps_exactly_what_is_below() -> None:
    matrices, exact = torus(60, 50, 3.0, 2.0)
    for threshold in (exact[20] * 1.001, exact[101], exact[0]):
        decomposition = solve(*matrices, max_eigenvalue=float(threshold))
        # Allow for rounding of the closed form: thresholds equal a multiple eigenvalue.
        check(decomposition, exact[exact <= threshold * (1 + 1e-12)])
        assert (decomposition.eigenvalues <= threshold).all()


def test_pairs_nearest_an_interior_shift() -> None:
    matrices, exact = torus(50, 41, 1.0, 1.1)
    for sigma in (exact[300] * 1.0007, exact[3] * 0.9):
        nearest = np.sort(exact[np.argsort(np.abs(exact - sigma), kind="stable")[:25]])
        decomposition = solve(*matrices, 25, sigma=float(sigma))
        check(decomposition, nearest)
        from_below = decomposition.certificate.low is None
        assert from_below == (nearest[0] == 0.0), "the lowest pairs have no lower end"


@pytest.mark.slow
def test_many_components_have_an_exact_null_space() -> None:
    matrices = random_mesh(1, copies=5)
    decomposition = solve(*matrices, 60)
    check(decomposition, np.concatenate([np.zeros(5), dense(matrices)[5:60]]))
    assert (decomposition.eigenvalues[:5] == 0.0).all()
    fewer = solve(*matrices, 3)  # fewer pairs than the null space
    check(fewer, np.zeros(3))


@pytest.mark.slow
@pytest.mark.parametrize("copies", [1, 2])
def test_whole_spectrum_and_all_but_one(copies: int) -> None:
    matrices = random_mesh(2, copies=copies)
    n = N_POINTS * copies
    exact = dense(matrices)
    exact[:copies] = 0.0
    for k in (n - 1, n, n + 50):
        check(solve(*matrices, k), exact[: min(k, n)])
    check(solve(*matrices, max_eigenvalue=float(2.0 * exact[-1])), exact)


def test_small_problems_are_dense() -> None:
    matrices, exact = torus(5, 4, 1.0, 1.0)
    check(solve(*matrices, 4), exact[:4])
    check(solve(*matrices, 1000), exact)


def test_bits_depend_neither_on_the_run_nor_on_the_number_of_jobs() -> None:
    matrices = random_mesh(4, copies=2)
    first, *others = (solve(*matrices, 300, n_jobs=jobs) for jobs in (1, 1, 2, 3))
    for other in others:
        assert other.rows.tobytes() == first.rows.tobytes()
        assert other.eigenvalues.tobytes() == first.eigenvalues.tobytes()
        assert other.residuals.tobytes() == first.residuals.tobytes()


def test_every_sparse_kind_and_a_mass_vector_are_taken() -> None:
    stiffness, mass = random_mesh(7)
    reference = solve(stiffness, mass, 10).eigenvalues
    for kind in (sp.csr_matrix, sp.coo_matrix, sp.csc_array, sp.lil_array):
        np.testing.assert_array_equal(solve(kind(stiffness), kind(mass), 10).eigenvalues, reference)
    # Entries stored in two parts, as in assembly face by face.
    csr = sp.csr_array(stiffness)
    halves = np.repeat(0.5 * csr.data, 2), np.repeat(csr.indices, 2), 2 * csr.indptr
    in_parts = solve(sp.csr_array(halves, shape=csr.shape), mass, 10).eigenvalues
    np.testing.assert_array_equal(in_parts, reference)
    for given in (mass.diagonal(), mass.toarray()):
        np.testing.assert_array_equal(solve(stiffness, given, 10).eigenvalues, reference)


@pytest.mark.parametrize("kept", slow_but([9], [1, 9, 20, 31, 70]))
def test_what_is_known_is_not_touched(kept: int) -> None:
    # Every eigenvalue is double: some known pairs end between two equal eigenvalues.
    matrices = random_mesh(8, copies=2)
    exact = dense(matrices)
    exact[:2] = 0.0
    known = solve(*matrices, 70).first(kept)
    arrays = []

    def allocate(k: int, n: int, n_kept: int) -> npt.NDArray[np.float64]:
        assert n_kept == kept
        arrays.append(np.zeros((k, n)))
        arrays[0][:kept] = known.rows[:kept]
        return arrays[0]

    more = solve(*matrices, 140, known=known, allocate=allocate)
    assert more.rows is arrays[0]
    check(more, exact[:140])
    np.testing.assert_array_equal(more.rows[:kept], known.rows[:kept])
    np.testing.assert_array_equal(more.eigenvalues[:kept], known.eigenvalues)
    np.testing.assert_array_equal(more.residuals[:kept], known.residuals)
    copied = solve(*matrices, 140, known=known)
    np.testing.assert_array_equal(copied.rows, more.rows)
    fewer = max(kept - 3, 1)
    check(solve(*matrices, fewer, known=known), exact[:fewer])


def test_known_pairs_of_a_small_mesh_are_not_touched() -> None:
    matrices = random_mesh(3)
    known = solve(*matrices, 40)
    more = solve(*matrices, 700, known=known)
    exact = dense(matrices)
    exact[0] = 0.0
    check(more, exact[:700])
    np.testing.assert_array_equal(more.rows[:40], known.rows)


def test_known_pairs_of_another_problem_are_not_believed() -> None:
    matrices = cotangent_laplacian(shapes.blob(2))
    order = np.random.default_rng(0).permutation(matrices[0].shape[0])
    # The eigenvalues are the same in another order of vertices, the vectors are not.
    renumbered = [sp.csc_array(matrix)[order][:, order] for matrix in matrices]
    exact = dense(matrices)
    exact[0] = 0.0
    for other in (renumbered, (matrices[0] * 1.01, matrices[1]), random_mesh(10)):
        check(solve(*matrices, 60, known=solve(*other, 40)), exact[:60])


def test_pairs_arrive_in_order_and_final() -> None:
    matrices = random_mesh(11)
    rows: list[npt.NDArray[np.float64]] = []
    starts: list[int] = []

    def allocate(k: int, n: int, n_kept: int) -> npt.NDArray[np.float64]:
        assert n_kept == 0
        rows.append(np.full((k, n), np.inf))
        return rows[0]

    def arrived(pairs: Eigenpairs) -> None:
        assert len(pairs) > sum(starts)
        assert np.isfinite(rows[0][: len(pairs)]).all()
        starts.append(len(pairs) - sum(starts))
        pairs.eigenvalues[:] = pairs.residuals[:] = -1.0  # The receiver may change its arrays.

    reports: list[Progress] = []
    decomposition = solve(
        *matrices, 250, allocate=allocate, on_pairs=arrived, progress=reports.append
    )
    assert len(rows) == 1
    assert decomposition.rows is rows[0]
    assert sum(starts) == 250
    assert (decomposition.eigenvalues >= 0.0).all()
    assert (decomposition.residuals >= 0.0).all()
    assert reports[-1].converged == reports[-1].total == 250
    assert [r.converged for r in reports] == sorted(r.converged for r in reports)


@pytest.mark.parametrize("patience", [0, 1, 2, 5])
def test_cancel_is_heard(patience: int) -> None:
    asked = 0

    def cancel() -> bool:
        nonlocal asked
        asked += 1
        return asked > patience

    with pytest.raises(Cancelled):
        solve(*random_mesh(13), 200, cancel=cancel)


def test_where_pairs_of_a_given_inverse_begin_is_said_in_the_unit_of_the_mesh() -> None:
    from scipy.sparse.linalg import LinearOperator, splu

    stiffness, mass = random_mesh(14)
    mass = 1e6 * mass
    exact = dense((stiffness, mass))
    sigma = 0.5 * float(exact[20] + exact[21])
    solver = splu(sp.csc_matrix(stiffness - sigma * mass)).solve
    inverse = LinearOperator(stiffness.shape, matvec=solver, dtype=np.float64)
    decomposition = solve(stiffness, mass, 8, sigma=sigma, op_inv=inverse)
    first = int(np.argsort(np.abs(exact - sigma))[:8].min())
    np.testing.assert_allclose(decomposition.eigenvalues, exact[first : first + 8], rtol=1e-8)
    low, bound = decomposition.certificate.low, decomposition.certificate.bound
    assert low is not None
    assert bound is not None
    assert exact[first - 1] < low < exact[first]
    assert exact[first + 7] < bound < exact[first + 8]


def test_nonsense_is_refused_in_a_sentence() -> None:
    L, M = random_mesh(15)
    across = M.toarray()
    across[3, 8] = across[8, 3] = 1e-9
    asymmetry = sp.coo_array(([1e9], ([0], [1])), shape=L.shape)
    few = np.where(np.arange(N_POINTS) < 9, 0.0, 1.0)
    for code, word, arguments, options in (
        ("conflicting-arguments", "Neither or both", (L, M), {}),
        ("conflicting-arguments", "Neither or both", (L, M, 5), {"max_eigenvalue": 1.0}),
        ("out-of-range", "n_components is 0", (L, M, 0), {}),
        ("out-of-range", "max_eigenvalue is -1", (L, M), {"max_eigenvalue": -1.0}),
        ("out-of-range", "sigma is nan", (L, M, 5), {"sigma": np.nan}),
        ("unknown-name", "float64, float32", (L, M, 5), {"dtype": np.int32}),
        ("not-finite", "at vertex 0", (L * np.nan, M, 5), {}),
        ("wrong-type", "complex128", (L * 1j, M, 5), {}),
        ("wrong-shape", "(n, n)", (None, M, 5), {}),
        ("not-semidefinite", "give -L", (-L, M, 5), {}),
        ("not-finite", "negative", (L, -M, 5), {}),
        ("not-diagonal", "area_matrix", (L, L, 5), {}),
        ("not-diagonal", "area_matrix", (L, across, 5), {}),
        ("wrong-shape", f"shape (5,): give ({N_POINTS}, {N_POINTS})", (L, np.ones(5), 5), {}),
        ("wrong-shape", "shape (5, 5)", (L, sp.eye_array(5), 5), {}),
        ("no-area", "mass matrix is zero", (L * 0.0, np.zeros(N_POINTS), 5), {}),
        ("no-area", "(first: [0, 1, 2])", (L, few, 5), {}),
        ("not-symmetric", "vertices 0 and 1", (L + asymmetry, M, 5), {}),
    ):  # fmt: skip
        with raises(code, word):
            solve(*arguments, **options)


def test_proof_is_one_line_and_memory_grows_with_pairs() -> None:
    proof = solve(*random_mesh(16), 30).proof()
    assert "30 pairs · complete (" in proof
    assert "\n" not in proof
    assert estimate_memory(10_000, 70_000, 300) > estimate_memory(10_000, 70_000, 100) > 0
    # A small pencil needs a dense matrix and its eigenvectors. Many small components need one dense
    # matrix each.
    assert estimate_memory(650, 4_500, 10) > 2 * 8 * 650**2
    assert estimate_memory(100_000, 700_000, 100_000, n_null=99_900) < 100_000**2 * 8.1
    many = estimate_memory(10_000, 70_000, 100, n_null=64)
    assert estimate_memory(10_000, 70_000, 64, n_null=64) < many
    assert many < estimate_memory(10_000, 70_000, 100)


def test_the_bound_of_the_count_carries_the_unit_of_the_mesh() -> None:
    result = solve(*random_mesh(16), 30)
    assert re.search(r"below [.0-9×⁰-⁹⁻]+\)", result.proof())
    assert re.search(r"below [.0-9]+\sµ?m?m⁻²\)", result.proof("mm"))


def test_a_certificate_says_what_it_lacks() -> None:
    proven = solve(*random_mesh(0), 5).certificate
    assert proven.complete
    assert proven.lacks == ()
    for change, said in (
        ({"residual": 1e-3, "residual_index": 2}, "residual of 0.001 (pair 2) above"),
        ({"orthonormality": 0.3}, "orthonormality of 0.3 above"),
        ({"orthonormality": np.nan}, "orthonormality of nan above"),
        ({"method": "inertia", "found": proven.counted - 1, "bound": 1.0}, "found of"),
        ({"method": "none"}, "no count"),
    ):
        wanting = replace(proven, **change)
        assert not wanting.complete
        assert said in wanting.lacks[0]
        assert f"not proven complete: {wanting.lacks[0]}" in wanting.sentence(5)
        assert ("worst residual" in wanting.sentence(5)) == (wanting.method != "none")


def test_rows_in_float32_take_smaller_slices_and_less_memory() -> None:
    matrices, exact = torus(60, 50, 1.0, 1.3)
    fine, coarse = solve(*matrices, 150), solve(*matrices, 150, dtype=np.float32)
    assert coarse.rows.dtype == np.float32
    assert coarse.eigenvalues.dtype == np.float64
    assert coarse.orthonormality < 1e-5
    assert coarse.complete
    np.testing.assert_allclose(coarse.eigenvalues[1:], exact[1:150], rtol=1e-8)
    assert coarse.residuals.max() < 1e-6
    assert coarse.rows.nbytes == fine.rows.nbytes // 2
    for workers in (1, 2):
        whole = estimate_memory(300_000, 2_100_000, 300, workers)
        assert estimate_memory(300_000, 2_100_000, 300, workers, dtype=np.float32) < 0.75 * whole


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_what_memory_held_before_is_not_read(dtype: type) -> None:
    stiffness, mass = torus(30, 26, 1.0, 1.2)[0]
    # Two vertices of no face, whose entries are not computed.
    stiffness = sp.block_diag([stiffness, sp.csc_array((2, 2))]).tocsc()
    masses = np.append(mass.diagonal() if hasattr(mass, "diagonal") else mass, [0.0, 0.0])

    def allocate(k: int, n: int, n_kept: int) -> np.ndarray:
        rows = np.empty((k, n), dtype=dtype)
        # Converting a signalling NaN is an invalid operation, which warns.
        rows.view(np.uint32)[:] = 0x7F800001
        return rows

    decomposition = solve(stiffness, masses, 80, dtype=dtype, allocate=allocate)
    assert decomposition.complete
    assert np.isnan(decomposition.rows[:, -2:]).all()
    assert np.isfinite(decomposition.rows[:, :-2]).all()


def test_the_time_told_lies_within_the_time_taken() -> None:
    began = time.perf_counter()
    told = solve(*random_mesh(3), 10).timings
    assert 0.0 < told["total"] <= time.perf_counter() - began
    assert all(seconds >= 0.0 for seconds in told.values())
