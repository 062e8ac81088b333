"""Examples of the documentation of the functions, run as written there.

Only the name of the package is changed. The spectrum of the mesh contains the documented
eigenvalues (1e-10 to 1e-7). Documented times do not fit these eigenvalues and are replaced.
Projections are weighted by M, which the documents omit. Numbers are checked against a solution by
hand from the same eigenpairs; test_decompose checks them against closed forms.
"""

from __future__ import annotations

import numpy as np
import pytest
import pyvista
import shapes
from scipy.linalg import eigh
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from meshmash_viewer import (
    MeshStitcher,
    area_matrix,
    band_pass_bank,
    compute_geometry_vectors,
    compute_hks,
    compute_vertex_areas,
    cotangent_laplacian,
    decompose_mesh,
    gaussian_pyramid_bank,
    low_pass_bank,
    mesh_to_poly,
    solve,
    spectral_geometry_filter,
)
from meshmash_viewer.decompose import (
    construct_bspline_basis,
    construct_bspline_filter,
    decompose_laplacian,
    decompose_laplacian_by_bands,
    get_hks_filter,
)
from meshmash_viewer.errors import TruncationWarning
from meshmash_viewer.features.shape import low_pass_vertices, match_features, spectral_distance
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.mesh import as_mesh

#: Documented as 1e-6 and 1e-3; for eigenvalues up to 1e-8, heat spreads between these times.
T_MIN, T_MAX = 1e9, 1e12


@pytest.fixture(scope="module")
def mesh():
    """Return a non-manifold neuron in several pieces, large enough for eigenvalues below 1e-8."""
    neuron = shapes.neuron()
    for name in ("drop_degenerate_faces", "drop_unreferenced_vertices"):
        neuron = REPAIRS[name].apply(neuron)
    vertices = (neuron.vertices - neuron.vertices.mean(axis=0)) * 66.0
    return vertices, neuron.faces


@pytest.fixture(scope="module")
def matrices(mesh):
    return cotangent_laplacian(mesh, robust=True, mollify_factor=1e-5)


@pytest.fixture(scope="module")
def below(matrices):
    """Return the eigenpairs up to 1e-8 but the first, by the documented function."""
    pairs = spectral_geometry_filter(matrices)
    values = eigh(matrices[0].toarray(), matrices[1].toarray(), eigvals_only=True)
    assert len(pairs[0]) == (values <= 1e-8).sum() - 1
    return pairs


# Laplacian decomposition -------------------------------------------------------------------------


def test_area_matrix(mesh):
    M = area_matrix(mesh)
    areas = compute_vertex_areas(mesh)
    np.testing.assert_array_equal(M.diagonal(), areas)
    assert areas.sum() == pytest.approx(as_mesh(mesh).area)
    assert cotangent_laplacian(mesh)[0].shape == M.shape == (len(mesh[0]), len(mesh[0]))


def test_decomposition_of_a_mesh_and_of_its_matrices(mesh, matrices):
    evals, evecs = decompose_mesh(
        mesh, n_components=100, robust=True, mollify_factor=1e-5, tol=1e-10
    )
    assert evecs.shape == (len(mesh[0]), 100)
    assert evals[0] == 0.0  # "always 0"
    assert (np.diff(evals) >= 0).all()
    # "orthogonal with respect to the mass matrix M"
    np.testing.assert_allclose(evecs.T @ matrices[1] @ evecs, np.eye(100), atol=1e-10)
    L, M = matrices
    for prefactor in (None, "lu"):
        again, _ = decompose_laplacian(
            L, M, n_components=100, sigma=-1e-10, tol=1e-10, prefactor=prefactor
        )
        np.testing.assert_array_equal(evals, again)
    vertex_function = evecs[:, 7] - 2.0 * evecs[:, 30]
    coefficients = evecs.T @ (M @ vertex_function)  # the document leaves M out
    scale = np.abs(vertex_function).max()
    np.testing.assert_allclose(evecs @ coefficients, vertex_function, atol=1e-9 * scale)


@pytest.mark.slow
def test_band_by_band(matrices, below):
    eigenvalues, eigenvectors = decompose_laplacian_by_bands(
        *matrices, max_eigenvalue=1e-8, band_size=50, truncate_extra=True, verbose=True
    )
    np.testing.assert_allclose(eigenvalues[1:], below[0], rtol=1e-9)
    assert eigenvectors.shape[1] == len(eigenvalues) > 50


def test_eigenvectors_on_the_mesh(mesh):
    poly = mesh_to_poly(mesh)
    assert isinstance(poly, pyvista.PolyData)
    poly["eigenfunction"] = mesh[0][:, 0]
    assert poly.n_points == len(poly["eigenfunction"])


def test_mesh_filtering(mesh, matrices):
    _, evecs = decompose_mesh(mesh, n_components=50)
    vertices, M, k = mesh[0], matrices[1], 10
    smoothed = evecs[:, :k] @ (evecs[:, :k].T @ (M @ vertices))  # the document leaves M out
    ours = low_pass_vertices(mesh, solve(*matrices, 50), k)
    np.testing.assert_allclose(ours, smoothed, atol=1e-6 * np.abs(vertices).max())

    def error(rebuilt):
        return np.sqrt((M @ (rebuilt - vertices) ** 2).sum())

    assert error(evecs @ (evecs.T @ (M @ vertices))) < error(smoothed) < error(0.0 * vertices)
    # Without M the shape is lost: the error exceeds the size of the coordinates.
    assert error(evecs[:, :k] @ (evecs[:, :k].T @ vertices)) > 2.0 * error(smoothed)


def test_shape_analysis(mesh):
    other = mesh[0] * [1.0, 1.0, 1.5], mesh[1]
    evals1, evals2 = (decompose_mesh(each, n_components=100)[0] for each in (mesh, other))
    distance = np.linalg.norm(evals1 - evals2)
    assert spectral_distance(mesh, other, 100, normalize=False) == pytest.approx(distance)


# Spectral filtering ------------------------------------------------------------------------------


def my_filter(eigenvalues):
    n_filters = 10
    coefs = np.zeros((n_filters, len(eigenvalues)))
    for i in range(n_filters):
        sigma = 1e-9 * (2**i)
        coefs[i] = np.exp(-eigenvalues / sigma)
    return coefs


def lowpass_filter(eigenvalues, cutoff=1e-9):
    response = (eigenvalues < cutoff).astype(float)
    return response[np.newaxis, :]


def bandpass_filter(eigenvalues, low=1e-10, high=1e-9):
    response = ((eigenvalues >= low) & (eigenvalues <= high)).astype(float)
    return response[np.newaxis, :]


def gaussian_pyramid(eigenvalues, n_scales=8):
    scales = np.geomspace(1e-10, 1e-8, n_scales)
    coefs = np.exp(-np.outer(scales, eigenvalues))
    return coefs


@pytest.mark.filterwarnings("ignore:.*not small at the last:UserWarning")
@pytest.mark.parametrize("filter_", [my_filter, lowpass_filter, bandpass_filter, gaussian_pyramid])
def test_filters(mesh, below, filter_):
    features = spectral_geometry_filter(
        mesh, filter=filter_, max_eigenvalue=1e-8, band_size=50, truncate_extra=True,
        drop_first=True, decomposition_dtype=np.float64, robust=True, verbose=True,
    )  # fmt: skip
    expected = below[1] ** 2 @ filter_(below[0]).T
    np.testing.assert_allclose(features, expected, rtol=1e-9, atol=1e-24)


def test_the_same_patterns_as_ready_banks(mesh, below):
    for bank, filter_ in (
        (low_pass_bank(1e-9), lowpass_filter),
        (band_pass_bank(1e-10, 1e-9), bandpass_filter),
    ):
        expected = below[1] ** 2 @ filter_(below[0]).T
        np.testing.assert_allclose(spectral_geometry_filter(mesh, filter=bank), expected, rtol=1e-9)
    # exp(-1e8 λ) is still 0.37 at the documented threshold of 1e-8
    with pytest.warns(TruncationWarning, match="gaussian_s=1.00e.08"):
        spectral_geometry_filter(mesh, filter=gaussian_pyramid_bank(np.geomspace(1e8, 1e10, 8)))


def test_bspline_basis_and_filters(mesh):
    bases = construct_bspline_basis(0.0, 1e-8, 32)
    values = np.stack([basis(np.linspace(0, 1e-8, 100)) for basis in bases])
    assert values.shape == (32, 100)
    assert (values.max(axis=1) > 0.5).all()
    np.testing.assert_allclose(values.sum(axis=0), 1.0)
    filter_func = construct_bspline_filter(e_min=0.0, e_max=1e-8, n_components=32)
    geometry_vectors = compute_geometry_vectors(
        mesh, max_eigenvalue=1e-8, n_components=32, band_size=50, drop_first=True, robust=True,
        decomposition_dtype=np.float64, verbose=True,
    )  # fmt: skip
    features = spectral_geometry_filter(mesh, filter=filter_func, max_eigenvalue=1e-8)
    np.testing.assert_allclose(features, geometry_vectors, rtol=1e-9)


# Heat kernel signature ---------------------------------------------------------------------------


def test_hks_basic_usage(mesh):
    hks = compute_hks(
        mesh, max_eigenvalue=1e-8, t_min=None, t_max=None, n_components=32, robust=True,
        verbose=True,
    )  # fmt: skip
    assert hks.shape == (len(mesh[0]), 32)
    # Heat is concentrated first and spreads later.
    trunk = as_mesh(mesh).component_labels == 0
    assert hks[trunk, 0].std() > 3.0 * hks[trunk, -1].std()
    assert (np.diff(hks, axis=1) <= 0.0).all()
    distances, _ = KDTree(hks).query(hks, k=5)
    assert distances[:, 0].max() == 0.0
    for options in (
        {"truncate_extra": True},
        {"decomposition_dtype": np.float32},
        {"robust": True, "mollify_factor": 1e-5},
    ):
        again = compute_hks(mesh, max_eigenvalue=1e-8, n_components=32, **options)
        np.testing.assert_allclose(again, hks, rtol=1e-5)


def test_hks_at_given_times_and_by_hand(mesh, matrices):
    filter_func = get_hks_filter(t_min=T_MIN, t_max=T_MAX, n_scales=32, dtype=np.float64)
    hks = spectral_geometry_filter(
        mesh, filter=filter_func, max_eigenvalue=1e-8, drop_first=True, robust=True
    )
    direct = compute_hks(mesh, t_min=T_MIN, t_max=T_MAX, drop_first=True)
    np.testing.assert_allclose(hks, direct, rtol=1e-12)
    cached = spectral_geometry_filter(matrices, filter=filter_func, max_eigenvalue=1e-8)
    np.testing.assert_allclose(cached, hks, rtol=1e-9)
    time = np.geomspace(T_MIN, T_MAX, 32)[20]
    single = compute_hks(mesh, t_min=time, t_max=time, n_components=1, drop_first=True)
    np.testing.assert_allclose(single[:, 0], hks[:, 20], rtol=1e-9)


def test_shape_matching(mesh, rng):
    vertices1, faces1 = mesh
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    hks1, hks2 = (
        compute_hks((vertices, faces1), max_eigenvalue=1e-8, n_components=64, robust=True)
        for vertices in (vertices1, vertices1 @ turn)
    )
    distances = cdist(hks1, hks2, metric="euclidean")
    trunk = as_mesh(mesh).component_labels == 0
    assert (np.argmin(distances, axis=1) == np.arange(len(hks1)))[trunk].mean() > 0.99
    ours, scores = match_features(hks1, hks2), distances.min(axis=1)
    np.testing.assert_allclose(ours.scores, scores, rtol=1e-4, atol=1e-4 * hks1.max() ** 2)
    assert ours.confident.sum() >= len(hks1) // 10
    assert ours.scores[ours.confident].max() <= ours.scores[~ours.confident].min(initial=np.inf)


@pytest.mark.slow
def test_splitting_large_meshes(mesh):
    stitcher = MeshStitcher(mesh, n_jobs=1)  # documented: -1, all cores
    stitcher.split_mesh(max_vertex_threshold=800)  # documented: 20_000
    hks = stitcher.apply(
        lambda m: compute_hks(m, max_eigenvalue=1e-8, n_components=32, t_min=T_MIN, t_max=T_MAX),
        stitch=True,
    )
    whole = compute_hks(mesh, max_eigenvalue=1e-8, n_components=32, t_min=T_MIN, t_max=T_MAX)
    # At short times, pieces give the features of the whole.
    assert np.median(np.abs(hks[:, 0] - whole[:, 0]) / whole[:, 0]) < 0.1
