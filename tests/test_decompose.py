"""Eigenpairs and features against closed forms, dense solutions and invariances."""

from __future__ import annotations

import inspect
from contextlib import nullcontext

import numpy as np
import pytest
import shapes
from faults import raises
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, splu
from tiers import slow_but

from meshmash_viewer import decompose
from meshmash_viewer.decompose import (
    compute_geometry_vectors,
    compute_hks,
    decompose_laplacian,
    decompose_laplacian_by_bands,
    decompose_mesh,
    spectral_geometry_filter,
)
from meshmash_viewer.errors import (
    ConstantFeaturesWarning,
    MeshWarning,
    TruncationWarning,
)
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigensolver import solve

#: Threshold per nm²: some 150 pairs of the neuron lie below.
THRESHOLD = 1e-4


@pytest.fixture(scope="module")
def matrices(neuron):
    return cotangent_laplacian(neuron, robust=True)


@pytest.fixture(scope="module")
def dense(neuron, matrices):
    """Return all eigenpairs of the neuron from LAPACK, with rows for referenced vertices only."""
    used = neuron.referenced
    stiffness, mass = matrices
    return eigh(stiffness.toarray()[np.ix_(used, used)], np.diag(mass.diagonal()[used]))


def assert_m_orthonormal(eigenvectors, mass, tolerance=1e-10):
    used = ~np.isnan(eigenvectors[:, 0])
    gram = eigenvectors[used].T @ (mass.diagonal()[used, None] * eigenvectors[used])
    assert np.abs(gram - np.eye(len(gram))).max() < tolerance


# Closed forms ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("robust", "radius"), [(False, 1.0), (True, 3.0)])
def test_sphere(robust, radius):
    mesh = shapes.icosphere(4, radius)
    eigenvalues, _ = decompose_mesh(mesh, 49, robust=robust)
    expected = shapes.sphere_eigenvalues(49, radius)
    assert eigenvalues[0] == 0.0
    np.testing.assert_allclose(eigenvalues[1:], expected[1:], rtol=0.02)
    coarse, _ = decompose_mesh(shapes.icosphere(3, radius), 49, robust=robust)
    gain = np.abs(coarse - expected)[1:16].max() / np.abs(eigenvalues - expected)[1:16].max()
    assert 3.0 < gain < 5.0  # second order: half the edge, a quarter of the error


def test_neumann_rectangle():
    errors = []
    for n in (30, 59):
        eigenvalues, _ = decompose_mesh(shapes.rectangle(n, n), 20, robust=False)
        expected = shapes.rectangle_eigenvalues(20)
        errors.append(np.abs(eigenvalues[1:] / expected[1:] - 1.0).max())
    assert errors[0] < 0.03
    assert errors[1] < 0.3 * errors[0]


def test_heat_kernel_signature_of_the_sphere():
    mesh = shapes.icosphere(4)
    times = np.geomspace(0.05, 2.0, 9)
    hks = compute_hks(mesh, max_eigenvalue=150.0, t_min=times[0], t_max=times[-1], n_components=9)
    degrees = np.arange(40)
    modes = (2 * degrees + 1) * np.exp(-np.outer(times, degrees * (degrees + 1)))
    expected = modes.sum(axis=1) / (4.0 * np.pi)
    # The kernel is the same at every vertex of the sphere.
    np.testing.assert_allclose(hks, np.broadcast_to(expected, hks.shape), rtol=0.02)


@pytest.mark.slow
def test_squares_of_the_whole_spectrum_sum_to_one_over_the_area(neuron, matrices):
    stiffness, mass = matrices
    eigenvalues, eigenvectors = decompose_laplacian(stiffness, mass, int(neuron.referenced.sum()))
    used = neuron.referenced
    assert len(eigenvalues) == used.sum()
    squares = (eigenvectors[used] ** 2).sum(axis=1)
    np.testing.assert_allclose(squares * mass.diagonal()[used], 1.0, rtol=1e-9)
    assert_m_orthonormal(eigenvectors, mass)
    bands = compute_geometry_vectors(matrices, 1.01 * eigenvalues[-1], 16)
    np.testing.assert_allclose(bands[used].sum(axis=1) * mass.diagonal()[used], 1.0, rtol=1e-9)


# Dense solutions ---------------------------------------------------------------------------------


def test_eigenpairs_agree_with_the_dense_solution(neuron, matrices, dense):
    eigenvalues, eigenvectors = decompose_laplacian(*matrices, n_components=120)
    values, vectors = dense
    components = neuron.n_components
    assert (eigenvalues[:components] == 0.0).all()
    np.testing.assert_allclose(
        eigenvalues[components:], values[components:120], rtol=1e-8, atol=0.0
    )
    assert_m_orthonormal(eigenvectors, matrices[1])
    # Compare subspaces, not bases, and cut the spectrum at a gap.
    gaps = np.diff(values[:121]) / values[1:121]
    cut = 60 + int(np.argmax(gaps[60:119])) + 1
    used = neuron.referenced
    overlap = vectors[:, :cut].T @ (
        matrices[1].diagonal()[used, None] * eigenvectors[used][:, :cut]
    )
    np.testing.assert_allclose(np.linalg.svd(overlap, compute_uv=False), 1.0, atol=1e-9)


def test_features_agree_with_the_dense_solution(neuron, matrices, dense):
    values, vectors = dense
    below = values <= THRESHOLD
    values, vectors = np.maximum(values[below], 0.0), vectors[:, below]
    used = neuron.referenced
    times = np.geomspace(1e5, 1e8, 12)
    expected = vectors**2 @ np.exp(-np.outer(values, times))
    hks = compute_hks(matrices, THRESHOLD, t_min=1e5, t_max=1e8, n_components=12)
    np.testing.assert_allclose(hks[used], expected, rtol=1e-6)
    bases = decompose.construct_bspline_basis(0.0, THRESHOLD, 10)
    expected = vectors**2 @ np.stack([basis(values) for basis in bases], axis=1)
    bands = compute_geometry_vectors(neuron, THRESHOLD, 10)
    np.testing.assert_allclose(bands[used], expected, rtol=1e-6, atol=1e-9 * expected.max())


def test_automatic_times_run_from_short_to_long(neuron, matrices, dense):
    values, vectors = dense
    count = int((values <= THRESHOLD).sum())
    hks = compute_hks(neuron, THRESHOLD, n_components=5)
    ends = 4.0 * np.log(10.0) / values[[count - 1, neuron.n_components]]
    squares, spectrum = vectors[:, :count] ** 2, np.maximum(values[:count], 0.0)
    for column, time in ((0, ends[0]), (-1, ends[1])):
        np.testing.assert_allclose(
            hks[neuron.referenced, column], squares @ np.exp(-spectrum * time), rtol=1e-6
        )


# Completeness ------------------------------------------------------------------------------------


def test_the_threshold_is_exact(matrices, dense):
    values = dense[0]
    for index in (8, 40, 77):
        middle = 0.5 * (values[index] + values[index + 1])
        found, _ = decompose_laplacian_by_bands(*matrices, middle)
        assert len(found) == index + 1
        assert found[-1] <= middle
    # fewer pairs than components, and a threshold of zero
    assert len(decompose_laplacian_by_bands(*matrices, 0.0)[0]) == 6
    assert len(decompose_laplacian(*matrices, n_components=2)[0]) == 2


@pytest.mark.parametrize("threshold", [-1e-9, -np.inf, np.nan])
def test_a_negative_threshold_is_refused(sphere, threshold):
    with raises("out-of-range", "max_eigenvalue is"):
        decompose_laplacian_by_bands(*cotangent_laplacian(sphere), threshold)


def test_more_than_all_is_all(sphere):
    for count in (642, 643, 10**6):
        above = pytest.warns(MeshWarning, match=f"{count:,} .* the mesh has 642, and all of them")
        with above if count > 642 else nullcontext():
            eigenvalues, eigenvectors = decompose_mesh(sphere, count)
        assert len(eigenvalues) == 642
        assert eigenvectors.shape == (642, 642)


# Invariance --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scale", "tolerance"),
    [
        pytest.param(2.0**-30, 0.0, marks=pytest.mark.slow),
        (1e-9, 1e-8),
        pytest.param(1e6, 1e-8, marks=pytest.mark.slow),
    ],
)
def test_the_unit_of_the_mesh_scales_the_result(neuron, scale, tolerance):
    scaled = Mesh(neuron.vertices * scale, neuron.faces)
    values, vectors = decompose_mesh(neuron, 60)
    values_2, vectors_2 = decompose_mesh(scaled, 60)
    np.testing.assert_allclose(values_2 * scale**2, values, rtol=tolerance)
    # Sums of squares within multiplets are independent of the basis.
    np.testing.assert_allclose(
        np.nansum(vectors_2**2, axis=1) * scale**2,
        np.nansum(vectors**2, axis=1),
        rtol=10.0 * tolerance,
    )
    hks = compute_hks(neuron, THRESHOLD)
    hks_2 = compute_hks(scaled, THRESHOLD / scale**2)
    np.testing.assert_allclose(hks_2 * scale**2, hks, rtol=10.0 * tolerance + 1e-12)


@pytest.mark.slow
def test_order_of_vertices_and_pose_do_not_matter(neuron, rng):
    order = rng.permutation(neuron.n_vertices)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    faces = np.argsort(order)[neuron.faces][rng.permutation(neuron.n_faces)]
    moved = Mesh((neuron.vertices @ turn)[order] - 4e5, np.roll(faces, 1, axis=1))
    hks = compute_hks(neuron, THRESHOLD, n_components=8)
    np.testing.assert_allclose(compute_hks(moved, THRESHOLD, n_components=8), hks[order], rtol=1e-5)
    bands = compute_geometry_vectors(neuron, THRESHOLD, 6)
    np.testing.assert_allclose(
        compute_geometry_vectors(moved, THRESHOLD, 6),
        bands[order],
        rtol=1e-5,
        atol=1e-6 * np.nanmax(bands),
    )


def test_the_same_input_gives_the_same_bits_and_signs(neuron):
    first, second = (decompose_mesh(neuron, 40) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
    vectors = np.nan_to_num(first[1])
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(40)]
    assert (largest > 0.0).all()


def test_unreferenced_vertices_are_nan_and_change_nothing(sphere):
    vertices = np.insert(sphere.vertices, [0, 300, 642], 9.0, axis=0)
    kept = np.delete(np.arange(645), [0, 301, 644])
    loose = Mesh(vertices, kept[sphere.faces])
    values, vectors = decompose_mesh(loose, 30)
    expected, _ = decompose_mesh(sphere, 30)
    np.testing.assert_allclose(values, expected, rtol=1e-8, atol=1e-12)
    assert np.isnan(vectors[[0, 301, 644]]).all()
    assert np.isfinite(vectors[kept]).all()
    for features in (
        compute_hks(loose, 60.0),
        compute_geometry_vectors(loose, 60.0),
        spectral_geometry_filter(loose, lambda x: np.exp(-x)[None], 60.0),
    ):
        assert np.isnan(features[[0, 301, 644]]).all()
        assert np.isfinite(features[kept]).all()
    np.testing.assert_allclose(compute_hks(loose, 60.0)[kept], compute_hks(sphere, 60.0), rtol=1e-6)


# Options -----------------------------------------------------------------------------------------


def test_a_given_inverse_is_used(matrices, neuron):
    stiffness, mass = matrices
    used = np.flatnonzero(neuron.referenced)
    shift = -1e-7
    factor = splu(sparse.csc_matrix((stiffness - shift * mass).tocsc()[used][:, used]))
    calls = []

    def solve(column):
        calls.append(len(column))
        answer = np.zeros(neuron.n_vertices)
        answer[used] = factor.solve(np.ravel(column)[used])
        return answer

    inverse = LinearOperator(stiffness.shape, matvec=solve, dtype=np.float64)
    values, vectors = decompose_laplacian(stiffness, mass, 30, op_inv=inverse, sigma=shift)
    assert calls
    assert set(calls) == {neuron.n_vertices}
    expected, _ = decompose_laplacian(stiffness, mass, 30)
    np.testing.assert_allclose(values, expected, rtol=1e-8, atol=1e-18)
    assert_m_orthonormal(vectors, mass)


@pytest.mark.parametrize("sigma", [-1e-10, -1e-12, -3e-8, 0.0, None])
def test_a_shift_up_to_zero_gives_the_lowest_pairs(matrices, dense, sigma):
    values, _ = decompose_laplacian(*matrices, n_components=20, sigma=sigma, ncv=70, tol=1e-8)
    np.testing.assert_allclose(values[6:], dense[0][6:20], rtol=1e-8)


def test_prefactor_is_lu_or_nothing(matrices, sphere):
    plain, factored = (
        decompose_laplacian(*matrices, n_components=20, prefactor=prefactor)
        for prefactor in (None, "lu")
    )
    np.testing.assert_array_equal(plain[0], factored[0])
    for prefactor in ("ilu", "LU", True):
        with raises("unknown-name"):
            decompose_mesh(sphere, 5, prefactor=prefactor)


def test_single_precision(neuron, matrices):
    exact = decompose_laplacian_by_bands(*matrices, THRESHOLD)
    values, vectors = spectral_geometry_filter(
        neuron, None, THRESHOLD, drop_first=False, decomposition_dtype=np.float32
    )
    assert vectors.dtype == np.float32
    np.testing.assert_allclose(values, exact[0], rtol=1e-6, atol=1e-15)
    single = compute_hks(neuron, THRESHOLD, decomposition_dtype=np.float32)
    double = compute_hks(neuron, THRESHOLD, decomposition_dtype=None)
    assert (single.dtype, double.dtype) == (np.float32, np.float64)
    np.testing.assert_allclose(single, double, rtol=1e-5)


def test_single_precision_matrices_keep_their_null_space(matrices, dense):
    stiffness, mass = (matrix.astype(np.float32) for matrix in matrices)
    values, vectors = decompose_laplacian(stiffness, mass, n_components=60)
    assert vectors.dtype == np.float32
    assert (values[:6] == 0.0).all()
    np.testing.assert_allclose(values[6:], dense[0][6:60], rtol=1e-4)


@pytest.mark.parametrize("kind", slow_but(["coo"], ["csr", "csc", "coo", "lil", "bsr"]))
def test_any_kind_of_sparse_pair_is_taken(matrices, kind):
    stiffness, mass = matrices
    expected = compute_hks(matrices, 1e-5, n_components=4)
    as_arrays = stiffness.asformat(kind), mass.asformat(kind)
    as_matrices = (
        sparse.csr_matrix(stiffness).asformat(kind),
        sparse.csr_matrix(mass).asformat(kind),
    )
    for pair in (as_arrays, as_matrices, list(as_arrays)):
        np.testing.assert_allclose(compute_hks(pair, 1e-5, n_components=4), expected, rtol=1e-9)
    geometry = compute_geometry_vectors(as_matrices, 1e-5, 4)
    np.testing.assert_allclose(geometry, compute_geometry_vectors(matrices, 1e-5, 4), rtol=1e-9)


# Filters -----------------------------------------------------------------------------------------


def test_a_filter_sees_each_eigenvalue_once_in_one_dimension(neuron, matrices):
    seen = []

    def filter_(eigenvalues):
        assert eigenvalues.ndim == 1
        seen.append(eigenvalues.copy())
        eigenvalues[:] = 0.0  # A filter may change its copy.
        return np.ones((3, len(eigenvalues)))

    with pytest.warns(TruncationWarning, match="neuron: 3 filters are not small"):
        features = spectral_geometry_filter(neuron, filter_, THRESHOLD, drop_first=False)
    values, vectors = decompose_laplacian_by_bands(*matrices, THRESHOLD)
    assert len(seen) == 1
    np.testing.assert_allclose(seen[0], values, rtol=1e-12)
    assert features.shape == (neuron.n_vertices, 3)
    np.testing.assert_allclose(features[:, 2], (vectors**2).sum(axis=1), rtol=1e-9)


def test_filters_are_normalised_over_the_whole_spectrum(neuron):
    """A filter gets all eigenvalues in one call, whatever the band size."""

    def relative(eigenvalues):
        return (eigenvalues / eigenvalues.sum())[None]

    with pytest.warns(TruncationWarning):
        small, large = (
            spectral_geometry_filter(neuron, relative, THRESHOLD, band_size=size)
            for size in (5, 500)
        )
    np.testing.assert_allclose(small, large, rtol=1e-8)


def test_no_filter_returns_pairs_and_drops_exactly_one(neuron, matrices):
    everything = spectral_geometry_filter(matrices, max_eigenvalue=1e-5, drop_first=False)
    rest = spectral_geometry_filter(matrices, max_eigenvalue=1e-5)
    np.testing.assert_array_equal(rest[0], everything[0][1:])
    np.testing.assert_array_equal(rest[1], everything[1][:, 1:])
    assert (rest[0][:5] == 0.0).all()
    dropped = compute_hks(neuron, 1e-5, drop_first=True, t_min=1e6, t_max=1e7)
    whole = compute_hks(neuron, 1e-5, t_min=1e6, t_max=1e7)
    np.testing.assert_allclose(
        whole - dropped, np.repeat(everything[1][:, :1] ** 2, 32, axis=1), atol=1e-18
    )


@pytest.mark.parametrize(
    ("filter_", "words"),
    [
        (lambda x: np.ones((2, 3)), "for 30 eigenvalues"),
        (lambda x: np.where(x > 0, 1.0, np.inf)[None], "returned inf for the eigenvalue 0:"),
        (lambda x: None, "returned None"),
        (lambda x: np.exp(1j * x)[None], "returned values of type complex128"),
    ],
)
def test_filters_that_return_nonsense_are_told_so(neuron, filter_, words):
    with raises("wrong-filter", words):
        spectral_geometry_filter(neuron, filter_, 1.1e-5, drop_first=False)


def test_a_threshold_of_another_unit_is_explained(three_spheres):
    """On a mesh of size 1, only zero eigenvalues lie below the documented 1e-8."""
    with pytest.warns(
        ConstantFeaturesWarning, match="about 100 eigenpairs of this mesh lie below 34 per"
    ):
        hks = compute_hks(three_spheres)
    np.testing.assert_allclose(hks, 3.0 / three_spheres.area, rtol=1e-3)
    for times in ({"t_min": 1.0}, {"t_max": 1.0}):
        with pytest.warns(ConstantFeaturesWarning, match="Only zero eigenvalues"):
            hks = compute_hks(three_spheres, n_components=2, **times)
        np.testing.assert_allclose(hks, 3.0 / three_spheres.area, rtol=1e-3)
    with pytest.warns(ConstantFeaturesWarning, match="Only zero eigenvalues"):
        bands = compute_geometry_vectors(three_spheres, n_components=3)
    np.testing.assert_allclose(bands[:, 0], 3.0 / three_spheres.area, rtol=1e-3)
    eigenvalues, eigenvectors = spectral_geometry_filter(three_spheres)
    assert (eigenvalues.shape, eigenvectors.shape) == ((2,), (486, 2))


def test_an_empty_sum_is_zero(sphere):
    loose = Mesh(np.append(sphere.vertices, [[3.0, 3.0, 3.0]], axis=0), sphere.faces)
    for function in (compute_hks, compute_geometry_vectors):
        with pytest.warns(ConstantFeaturesWarning, match="Only zero eigenvalues"):
            features = function(loose, n_components=4, drop_first=True)
        assert features.shape == (643, 4)
        assert (features[:-1] == 0.0).all()
        assert np.isnan(features[-1]).all()
    eigenvalues, eigenvectors = spectral_geometry_filter(sphere)
    assert (eigenvalues.shape, eigenvectors.shape) == ((0,), (642, 0))


# Long runs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "compute",
    [
        lambda mesh, **how: decompose_laplacian(*cotangent_laplacian(mesh), 30, **how),
        lambda mesh, **how: decompose_mesh(mesh, 30, **how),
        lambda mesh, **how: decompose_laplacian_by_bands(*cotangent_laplacian(mesh), 40.0, **how),
        lambda mesh, **how: spectral_geometry_filter(mesh, max_eigenvalue=40.0, **how),
        lambda mesh, **how: compute_hks(mesh, 40.0, t_min=0.2, t_max=1.0, **how),
        lambda mesh, **how: compute_hks(mesh, t_min=0.2, t_max=1.0, count="auto", **how),
        lambda mesh, **how: compute_geometry_vectors(mesh, 40.0, **how),
    ],
)
def test_whatever_computes_tells_how_far_it_is_and_hears_that_it_is_to_stop(sphere, compute):
    reports = []
    compute(sphere, progress=reports.append)
    assert reports[-1].fraction == 1.0
    assert reports[-1].converged == reports[-1].total >= 25
    with pytest.raises(Cancelled):
        compute(sphere, cancel=lambda: True)


def test_verbose_draws_on_stderr_and_ends_with_the_proof(neuron, capsys):
    reports = []
    compute_hks(neuron.in_unit("nm"), 1e-5, verbose=True, progress=reports.append)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "pairs · complete" in printed.err
    assert "µm⁻²)" in printed.err
    assert reports
    compute_hks(neuron, 1e-5)
    assert capsys.readouterr().err == ""


# The documented interface ------------------------------------------------------------------------

SIGNATURES = {
    "decompose_laplacian": "L, M, n_components=100, op_inv=None, sigma=-1e-10, tol=1e-10, "
    "ncv=None, prefactor=None",
    "decompose_mesh": "mesh, n_components=100, op_inv=None, sigma=-1e-10, tol=1e-10, robust=True, "
    "mollify_factor=1e-05, prefactor=None",
    "decompose_laplacian_by_bands": "L, M, max_eigenvalue=1e-09, band_size=50, "
    "truncate_extra=True, verbose=False",
    "spectral_geometry_filter": "mesh, filter=None, max_eigenvalue=1e-08, band_size=50, "
    "truncate_extra=True, drop_first=True, decomposition_dtype=float64, robust=True, "
    "mollify_factor=1e-05, verbose=False",
    "compute_hks": "mesh, max_eigenvalue=1e-08, t_max=None, t_min=None, n_components=32, "
    "band_size=50, truncate_extra=False, drop_first=False, robust=True, mollify_factor=1e-05, "
    "decomposition_dtype=float64, verbose=False",
    "compute_geometry_vectors": "mesh, max_eigenvalue=1e-08, n_components=32, band_size=50, "
    "truncate_extra=False, drop_first=False, robust=True, mollify_factor=1e-05, "
    "decomposition_dtype=float64, verbose=False",
    "get_hks_filter": "t_max=None, t_min=None, n_scales=32, dtype=float64",
    "construct_bspline_basis": "e_min, e_max, n_components",
    "construct_bspline_filter": "e_min, e_max, n_components",
}


@pytest.mark.parametrize("name", SIGNATURES)
def test_names_order_and_defaults_are_the_documented_ones(name):
    written = []
    for parameter in inspect.signature(getattr(decompose, name)).parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY:
            assert parameter.default is None
            continue
        default = parameter.default
        if default is parameter.empty:
            written.append(parameter.name)
        elif isinstance(default, type):
            written.append(f"{parameter.name}={default.__name__}")
        else:
            written.append(f"{parameter.name}={default!r}")
    assert ", ".join(written) == SIGNATURES[name]


def test_the_mollification_asked_for_is_the_one_of_the_operator() -> None:
    ball = shapes.icosphere(2)
    mesh = Mesh(ball.vertices * [1.0, 1.0, 1e-3], ball.faces)  # slivers, to be mollified
    times = {"t_min": 0.4, "t_max": 1.0, "n_components": 3}
    operators = [cotangent_laplacian(mesh, robust=True, mollify_factor=f)[0] for f in (1e-5, 0.3)]
    assert abs(operators[0] - operators[1]).max() > 1e-3
    for factor in (1e-5, 0.3):
        matrices = cotangent_laplacian(mesh, robust=True, mollify_factor=factor)
        wanted = compute_hks(matrices, max_eigenvalue=50.0, **times)
        found = compute_hks(mesh, max_eigenvalue=50.0, mollify_factor=factor, **times)
        np.testing.assert_array_equal(found, wanted)
    plain = compute_hks(cotangent_laplacian(mesh), max_eigenvalue=50.0, **times)
    found = compute_hks(mesh, max_eigenvalue=50.0, robust=False, **times)
    np.testing.assert_array_equal(found, plain)


def test_a_decomposition_says_what_its_stages_took() -> None:
    matrices = cotangent_laplacian(shapes.icosphere(4))
    timings = solve(*matrices, 30).timings
    assert {"matrices", "order", "count", "slices", "output", "total"} <= timings.keys()
    stages = [seconds for stage, seconds in timings.items() if stage != "total"]
    assert min(stages) >= 0.0
    assert timings["total"] >= max(stages)
