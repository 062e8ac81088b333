"""Examples of the documentation of the functions, run as written there.

Only the name of the package is changed. The spectrum of the mesh contains the documented
eigenvalues (1e-10 to 1e-7). Documented times do not fit these eigenvalues and are replaced.
Projections are weighted by M, which the documents omit. Plots are reduced to their data.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from tiers import slow

from meshmash_viewer.errors import TruncationWarning
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.mesh import as_mesh


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
    from meshmash_viewer import cotangent_laplacian

    return cotangent_laplacian(mesh, robust=True)


@pytest.fixture(scope="module")
def count(matrices):
    """Return the number of eigenpairs up to 1e-8, by a dense solution."""
    from scipy.linalg import eigh

    values = eigh(matrices[0].toarray(), matrices[1].toarray(), eigvals_only=True)
    return int((values <= 1e-8).sum())


def n_vertices(mesh):
    return len(mesh[0])


# Laplacian decomposition -------------------------------------------------------------------------


def test_cotangent_weights(mesh):
    from meshmash_viewer import cotangent_laplacian

    L, M = cotangent_laplacian(mesh)
    n = n_vertices(mesh)
    assert L.shape == M.shape == (n, n)
    L, M = cotangent_laplacian(mesh, robust=True, mollify_factor=1e-5)
    assert L.shape == M.shape == (n, n)


def test_area_matrix(mesh):
    from meshmash_viewer import area_matrix, compute_vertex_areas

    M = area_matrix(mesh)
    areas = compute_vertex_areas(mesh)
    np.testing.assert_array_equal(M.diagonal(), areas)
    assert areas.sum() == pytest.approx(as_mesh(mesh).area)


def test_basic_decomposition(mesh):
    from meshmash_viewer import decompose_mesh

    eigenvalues, eigenvectors = decompose_mesh(mesh, n_components=100, robust=True)
    assert eigenvalues.shape == (100,)
    assert eigenvectors.shape == (n_vertices(mesh), 100)
    eigenvalues, eigenvectors = decompose_mesh(
        mesh, n_components=100, robust=True, mollify_factor=1e-5, tol=1e-10
    )
    assert (np.diff(eigenvalues) >= 0).all()
    fiedler = eigenvectors[:, 1]
    geometric_modes = eigenvectors[:, 2:20]
    assert fiedler.shape == (n_vertices(mesh),)
    assert geometric_modes.shape == (n_vertices(mesh), 18)
    evals, _ = decompose_mesh(mesh, n_components=50, robust=True)
    np.testing.assert_allclose(evals, eigenvalues[:50], rtol=1e-8, atol=1e-20)


def test_direct_decomposition(mesh):
    from meshmash_viewer.decompose import decompose_laplacian
    from meshmash_viewer.laplacian import cotangent_laplacian

    L, M = cotangent_laplacian(mesh, robust=True)
    eigenvalues, _ = decompose_laplacian(L, M, n_components=100, sigma=-1e-10, tol=1e-10)
    again, _ = decompose_laplacian(L, M, n_components=100, sigma=-1e-10, tol=1e-10, prefactor="lu")
    np.testing.assert_array_equal(eigenvalues, again)

    L, M = cotangent_laplacian(mesh)
    eigenvalues, eigenvectors = decompose_laplacian(L, M, n_components=50)
    assert f"First 5 eigenvalues: {eigenvalues[:5]}".endswith("[0. 0. 0. 0. 0.]")
    assert f"Eigenvalue range: [{eigenvalues.min()}, ".endswith("[0.0, ")
    assert eigenvalues.max() > 0.0
    assert eigenvectors.shape[1] == 50


@pytest.mark.slow
def test_band_by_band(mesh, count):
    from meshmash_viewer import cotangent_laplacian
    from meshmash_viewer.decompose import decompose_laplacian_by_bands

    L, M = cotangent_laplacian(mesh, robust=True)
    eigenvalues, eigenvectors = decompose_laplacian_by_bands(
        L, M, max_eigenvalue=1e-8, band_size=50, truncate_extra=True, verbose=True
    )
    assert len(eigenvalues) == count > 50
    assert eigenvalues.max() <= 1e-8
    assert eigenvectors.shape == (n_vertices(mesh), count)


def test_spectrum_plots(mesh):
    from meshmash_viewer import decompose_mesh

    evals, _ = decompose_mesh(mesh, n_components=100)
    assert evals[0] == 0.0  # "always 0"
    assert np.isfinite(np.log10(evals[as_mesh(mesh).n_components :])).all()


def test_eigenvectors_on_the_mesh(mesh, matrices):
    import pyvista as pv

    from meshmash_viewer import decompose_mesh, mesh_to_poly

    evals, evecs = decompose_mesh(mesh, n_components=20)
    poly = mesh_to_poly(mesh)
    assert isinstance(poly, pv.PolyData)
    for i in [1, 5, 10, 19]:
        poly_copy = poly.copy()
        poly_copy["eigenfunction"] = evecs[:, i]
        np.testing.assert_array_equal(poly_copy["eigenfunction"], evecs[:, i])
        assert f"Eigenvector {i} (λ={evals[i]:.6f})"
    assert poly.n_points == n_vertices(mesh)
    # "orthogonal with respect to the mass matrix M"
    np.testing.assert_allclose(evecs.T @ matrices[1] @ evecs, np.eye(20), atol=1e-10)


def test_data_types(mesh):
    from meshmash_viewer import cotangent_laplacian, decompose_laplacian

    L, M = cotangent_laplacian(mesh, robust=True)
    exact, _ = decompose_laplacian(L, M, n_components=100)
    L = L.astype(np.float32)
    M = M.astype(np.float32)
    evals, evecs = decompose_laplacian(L, M, n_components=100)
    assert evecs.dtype == np.float32
    zeros = as_mesh(mesh).n_components
    assert (evals[:zeros] == 0.0).all()
    np.testing.assert_allclose(evals[zeros:], exact[zeros:], rtol=1e-4)


def test_mesh_filtering(mesh, matrices):
    from meshmash_viewer import decompose_mesh, solve
    from meshmash_viewer.features.shape import low_pass_vertices

    _, evecs = decompose_mesh(mesh, n_components=50)
    vertices, faces = mesh
    M = matrices[1]
    k = 10
    coeffs = evecs[:, :k].T @ (M @ vertices)  # the document leaves M out
    smoothed_vertices = evecs[:, :k] @ coeffs
    smoothed_mesh = (smoothed_vertices, faces)
    assert as_mesh(smoothed_mesh).n_vertices == n_vertices(mesh)
    ours = low_pass_vertices(mesh, solve(*matrices, 50), k)
    np.testing.assert_allclose(ours, smoothed_vertices, atol=1e-6 * np.abs(vertices).max())

    def error(rebuilt):
        return np.sqrt((M @ (rebuilt - vertices) ** 2).sum())

    assert error(evecs @ (evecs.T @ (M @ vertices))) < error(smoothed_vertices)
    assert error(smoothed_vertices) < error(np.zeros_like(vertices))
    # Without M the shape is lost: the error exceeds the size of the coordinates.
    assert error(evecs[:, :k] @ (evecs[:, :k].T @ vertices)) > 2.0 * error(smoothed_vertices)


def test_reconstructing_a_function(mesh, matrices):
    from meshmash_viewer.decompose import decompose_mesh

    _, eigenvectors = decompose_mesh(mesh, n_components=100, robust=True)
    vertex_function = eigenvectors[:, 7] - 2.0 * eigenvectors[:, 30]
    coefficients = eigenvectors.T @ (matrices[1] @ vertex_function)  # the document leaves M out
    reconstructed = eigenvectors @ coefficients
    scale = np.abs(vertex_function).max()
    np.testing.assert_allclose(reconstructed, vertex_function, atol=1e-9 * scale)


def test_shape_analysis(mesh):
    from meshmash_viewer import decompose_mesh
    from meshmash_viewer.features.shape import spectral_distance

    vertices, faces = mesh
    mesh1, mesh2 = mesh, (vertices * [1.0, 1.0, 1.5], faces)
    evals1, _ = decompose_mesh(mesh1, n_components=100)
    evals2, _ = decompose_mesh(mesh2, n_components=100)
    distance = np.linalg.norm(evals1 - evals2)
    assert distance > 1e-9
    assert spectral_distance(mesh1, mesh2, 100, normalize=False) == pytest.approx(distance)


# Spectral filtering ------------------------------------------------------------------------------


def my_filter(eigenvalues):
    n_filters = 10
    coefs = np.zeros((n_filters, len(eigenvalues)))
    for i in range(n_filters):
        sigma = 1e-9 * (2**i)
        coefs[i] = np.exp(-eigenvalues / sigma)
    return coefs


@pytest.mark.filterwarnings("ignore:.*not small at the last:UserWarning")
def test_custom_filter(mesh, capsys):
    from meshmash_viewer.decompose import spectral_geometry_filter

    features = spectral_geometry_filter(
        mesh,
        filter=my_filter,
        max_eigenvalue=1e-8,
        band_size=50,
        truncate_extra=True,
        drop_first=True,
        decomposition_dtype=np.float64,
        robust=True,
        verbose=True,
    )
    assert features.shape == (n_vertices(mesh), 10)
    eigenvalues, eigenvectors = spectral_geometry_filter(
        mesh, filter=None, max_eigenvalue=1e-8, drop_first=True, robust=True, verbose=True
    )
    expected = eigenvectors**2 @ my_filter(eigenvalues).T
    np.testing.assert_allclose(features, expected, rtol=1e-9)
    assert "complete" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:.*not small at the last:UserWarning")
def test_precision(mesh):
    from meshmash_viewer.decompose import spectral_geometry_filter

    fast_features = spectral_geometry_filter(
        mesh, filter=my_filter, decomposition_dtype=np.float32, max_eigenvalue=1e-8
    )
    accurate_features = spectral_geometry_filter(
        mesh, filter=my_filter, decomposition_dtype=np.float64, max_eigenvalue=1e-8
    )
    np.testing.assert_allclose(fast_features, accurate_features, rtol=1e-4)


@pytest.mark.filterwarnings("ignore:.*not small at the last:UserWarning")
def test_filtering_patterns(mesh, count):
    from meshmash_viewer.decompose import spectral_geometry_filter

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

    smooth_features = spectral_geometry_filter(mesh, filter=lowpass_filter)
    band_features = spectral_geometry_filter(mesh, filter=bandpass_filter)
    multiscale_features = spectral_geometry_filter(mesh, filter=gaussian_pyramid)
    eigenvalues, eigenvectors = spectral_geometry_filter(mesh)
    assert len(eigenvalues) == count - 1
    for features, filter_ in (
        (smooth_features, lowpass_filter),
        (band_features, bandpass_filter),
        (multiscale_features, gaussian_pyramid),
    ):
        expected = eigenvectors**2 @ filter_(eigenvalues).T
        np.testing.assert_allclose(features, expected, rtol=1e-9, atol=1e-24)
    assert 0.0 < band_features.sum() < smooth_features.sum()


def test_the_same_patterns_as_ready_banks(mesh):
    from meshmash_viewer import (
        band_pass_bank,
        gaussian_pyramid_bank,
        low_pass_bank,
        spectral_geometry_filter,
    )

    for bank in (low_pass_bank(1e-9), band_pass_bank(1e-10, 1e-9)):
        assert spectral_geometry_filter(mesh, filter=bank).shape == (n_vertices(mesh), 1)
    # exp(-1e8 λ) is still 0.37 at the documented threshold of 1e-8
    with pytest.warns(TruncationWarning, match="gaussian_s=1.00e.08"):
        pyramid = spectral_geometry_filter(
            mesh, filter=gaussian_pyramid_bank(np.geomspace(1e8, 1e10, 8))
        )
    assert pyramid.shape == (n_vertices(mesh), 8)


def test_bspline_basis():
    from meshmash_viewer.decompose import construct_bspline_basis

    bases = construct_bspline_basis(0.0, 1e-8, 32)
    eigenvalues = np.linspace(0, 1e-8, 100)
    total = np.zeros(100)
    for basis in bases:
        values = basis(eigenvalues)
        assert 0.5 < values.max() <= 1.0
        total += values
    assert len(bases) == 32
    np.testing.assert_allclose(total, 1.0)


def test_bspline_filters(mesh):
    from meshmash_viewer.decompose import (
        compute_geometry_vectors,
        construct_bspline_filter,
        spectral_geometry_filter,
    )

    filter_func = construct_bspline_filter(e_min=0.0, e_max=1e-8, n_components=32)
    geometry_vectors = compute_geometry_vectors(
        mesh,
        max_eigenvalue=1e-8,
        n_components=32,
        band_size=50,
        drop_first=True,
        robust=True,
        decomposition_dtype=np.float64,
        verbose=True,
    )
    assert geometry_vectors.shape == (n_vertices(mesh), 32)
    features = spectral_geometry_filter(mesh, filter=filter_func, max_eigenvalue=1e-8)
    np.testing.assert_allclose(features, geometry_vectors, rtol=1e-9)

    filter_func = construct_bspline_filter(0.0, 1e-8, 64)
    features = spectral_geometry_filter(mesh, filter=filter_func, max_eigenvalue=1e-8)
    assert features.shape == (n_vertices(mesh), 64)


@pytest.mark.slow
def test_geometry_vectors_of_a_wider_range(mesh):
    from meshmash_viewer.decompose import compute_geometry_vectors

    geom_features = compute_geometry_vectors(
        mesh, max_eigenvalue=1e-7, n_components=128, robust=True
    )
    assert geom_features.shape == (n_vertices(mesh), 128)
    assert np.isfinite(geom_features).all()


# Heat kernel signature ---------------------------------------------------------------------------

#: Documented as 1e-6 and 1e-3; for eigenvalues up to 1e-8, heat spreads between these times.
T_MIN, T_MAX = 1e9, 1e12


def test_hks_basic_usage(mesh):
    from scipy.spatial import KDTree

    from meshmash_viewer import compute_hks

    hks = compute_hks(
        mesh,
        max_eigenvalue=1e-8,
        t_min=None,
        t_max=None,
        n_components=32,
        robust=True,
        verbose=True,
    )
    assert hks.shape == (n_vertices(mesh), 32)
    local_hks, global_hks = hks[:, 0], hks[:, -1]
    # Heat is concentrated first and spreads later.
    trunk = as_mesh(mesh).component_labels == 0
    assert local_hks[trunk].std() > 3.0 * global_hks[trunk].std()
    assert (np.diff(hks, axis=1) <= 0.0).all()
    distances, indices = KDTree(hks).query(hks, k=5)
    assert distances[:, 0].max() == 0.0
    assert indices.shape == (n_vertices(mesh), 5)


def test_hks_time_scales(mesh):
    from meshmash_viewer import compute_hks

    hks = compute_hks(mesh, t_min=T_MIN, t_max=T_MAX, n_components=64, max_eigenvalue=1e-8)
    scales = np.geomspace(T_MIN, T_MAX, 64)
    assert hks.shape == (n_vertices(mesh), len(scales))
    single = compute_hks(mesh, t_min=scales[20], t_max=scales[20], n_components=1)
    np.testing.assert_allclose(single[:, 0], hks[:, 20], rtol=1e-9)


def test_hks_by_hand(mesh):
    from meshmash_viewer import compute_hks
    from meshmash_viewer.decompose import get_hks_filter, spectral_geometry_filter

    filter_func = get_hks_filter(t_min=T_MIN, t_max=T_MAX, n_scales=32, dtype=np.float64)
    hks = spectral_geometry_filter(
        mesh, filter=filter_func, max_eigenvalue=1e-8, drop_first=True, robust=True
    )
    direct = compute_hks(mesh, t_min=T_MIN, t_max=T_MAX, drop_first=True)
    np.testing.assert_allclose(hks, direct, rtol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        slow({"band_size": 100}),
        {"truncate_extra": True},
        {"decomposition_dtype": np.float32},
        slow({"decomposition_dtype": np.float64}),
        slow({"drop_first": False}),
        {"robust": True, "mollify_factor": 1e-5},
    ],
)
def test_hks_advanced_parameters(mesh, options):
    from meshmash_viewer import compute_hks

    hks = compute_hks(mesh, max_eigenvalue=1e-8, n_components=32, **options)
    default = compute_hks(mesh, max_eigenvalue=1e-8, n_components=32)
    np.testing.assert_allclose(hks, default, rtol=1e-5)


@pytest.mark.slow
def test_hks_of_a_wider_range(mesh, capsys):
    from meshmash_viewer.decompose import compute_hks

    hks_features = compute_hks(
        mesh, max_eigenvalue=1e-7, n_components=64, robust=True, verbose=True
    )
    assert hks_features.shape == (n_vertices(mesh), 64)
    assert "complete" in capsys.readouterr().err


def test_shape_matching(mesh, rng):
    from scipy.spatial.distance import cdist

    from meshmash_viewer import compute_hks
    from meshmash_viewer.features.shape import match_features

    vertices1, faces1 = mesh
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    vertices2, faces2 = vertices1 @ turn, faces1
    mesh1 = (vertices1, faces1)
    mesh2 = (vertices2, faces2)
    hks1 = compute_hks(mesh1, max_eigenvalue=1e-8, n_components=64, robust=True)
    hks2 = compute_hks(mesh2, max_eigenvalue=1e-8, n_components=64, robust=True)
    distances = cdist(hks1, hks2, metric="euclidean")
    correspondences = np.argmin(distances, axis=1)
    trunk = as_mesh(mesh).component_labels == 0
    assert (correspondences == np.arange(len(hks1)))[trunk].mean() > 0.99
    match_scores = np.min(distances, axis=1)
    confident_matches = match_scores < np.percentile(match_scores, 10)
    # Scores of a rotated copy are rounding: equal scores may lie on both sides of the percentile.
    assert confident_matches.sum() <= len(hks1) // 10 + 1

    ours = match_features(hks1, hks2)
    np.testing.assert_allclose(ours.scores, match_scores, rtol=1e-4, atol=1e-4 * hks1.max() ** 2)
    assert ours.confident.sum() >= len(hks1) // 10
    assert ours.scores[ours.confident].max() <= ours.scores[~ours.confident].min(initial=np.inf)


def test_scales_to_plot(mesh):
    from meshmash_viewer import compute_hks

    hks = compute_hks(mesh, n_components=32, max_eigenvalue=1e-8)
    scale_indices = [0, 4, 8, 12, 16, 20, 24, 28]
    for index in scale_indices:
        assert np.isfinite(hks[:, index]).all()
        assert np.ptp(hks[:, index]) > 0.0


@pytest.mark.slow
def test_splitting_large_meshes(mesh):
    from meshmash_viewer import MeshStitcher, compute_hks

    stitcher = MeshStitcher(mesh, n_jobs=1)  # documented: -1, all cores
    stitcher.split_mesh(max_vertex_threshold=800)  # documented: 20_000
    hks = stitcher.apply(
        lambda m: compute_hks(m, max_eigenvalue=1e-8, n_components=32),
        stitch=True,
    )
    assert hks.shape == (n_vertices(mesh), 32)
    assert np.isfinite(hks).all()

    # Default times differ between pieces; given times make pieces comparable to the whole.
    hks = stitcher.apply(
        lambda m: compute_hks(m, max_eigenvalue=1e-8, n_components=32, t_min=T_MIN, t_max=T_MAX),
    )
    whole = compute_hks(mesh, max_eigenvalue=1e-8, n_components=32, t_min=T_MIN, t_max=T_MAX)
    # At short times, pieces give the features of the whole.
    error = np.abs(hks[:, 0] - whole[:, 0]) / whole[:, 0]
    assert np.median(error) < 0.1


@pytest.mark.slow
def test_caching_the_laplacian(mesh):
    from meshmash_viewer import cotangent_laplacian
    from meshmash_viewer.decompose import get_hks_filter, spectral_geometry_filter

    L, M = cotangent_laplacian(mesh, robust=True)
    filter1 = get_hks_filter(t_min=T_MIN, t_max=T_MAX, n_scales=32)
    hks1 = spectral_geometry_filter((L, M), filter=filter1, max_eigenvalue=1e-8)
    filter2 = get_hks_filter(t_min=10 * T_MIN, t_max=10 * T_MAX, n_scales=64)
    hks2 = spectral_geometry_filter((L, M), filter=filter2, max_eigenvalue=1e-7)
    assert (hks1.shape[1], hks2.shape[1]) == (32, 64)
    np.testing.assert_allclose(
        hks1, spectral_geometry_filter(mesh, filter=filter1, max_eigenvalue=1e-8), rtol=1e-9
    )
