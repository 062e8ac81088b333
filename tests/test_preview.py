from __future__ import annotations

import numpy as np
import pytest
import shapes
from solved import spectrum_of

from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral import preview as preview_module
from meshmash_viewer.spectral.eigenpairs import Eigenpairs
from meshmash_viewer.spectral.preview import expected_error, preview_eigenpairs


def captured(mesh: Mesh, preview: Eigenpairs, n_exact: int) -> np.ndarray:
    """Return the norm of each previewed function's projection on the exact eigenfunctions."""
    _, mass = cotangent_laplacian(mesh, robust=True)
    used = mesh.referenced
    exact = spectrum_of(mesh, n_exact).rows[:, used] * mass.diagonal()[used]
    return np.linalg.norm(exact @ preview.rows[:, used].T.astype(np.float64), axis=0)


def test_sphere_has_its_degrees_with_all_their_copies() -> None:
    mesh = shapes.icosphere(5)
    preview = preview_eigenpairs(mesh, 16, n_cells=1500)
    degrees = np.repeat(np.arange(4), 2 * np.arange(4) + 1)
    np.testing.assert_allclose(
        preview.eigenvalues[1:], (degrees * (degrees + 1.0))[1:], rtol=2 * preview.error
    )
    assert preview.error == pytest.approx(expected_error(1500, 16), rel=0.1)
    assert captured(mesh, preview, 16).min() > 0.98


def test_rectangle_has_neumann_eigenvalues() -> None:
    mesh = shapes.rectangle(90, 60, 3.0, 2.0)
    preview = preview_eigenpairs(mesh, 20, n_cells=1000)
    i, j = np.meshgrid(np.arange(20), np.arange(20))
    exact = np.sort((np.pi**2 * ((i / 3.0) ** 2 + (j / 2.0) ** 2)).ravel())[:20]
    np.testing.assert_allclose(preview.eigenvalues[1:], exact[1:], rtol=2 * preview.error)


def test_thin_branches_are_chains_of_cells() -> None:
    # A tube much thinner than the length of a cell is a segment.
    path = np.linspace([0.0, 0.0, 0.0], [100.0, 0.0, 0.0], 2000)
    mesh = Mesh(*shapes.tube(path, np.full((len(path), 1), 0.3), around=6))
    preview = preview_eigenpairs(mesh, 8, n_cells=200)
    exact = (np.pi * np.arange(8) / 100.0) ** 2
    np.testing.assert_allclose(preview.eigenvalues[1:], exact[1:], rtol=0.05)


def test_dirty_components_all_have_their_constant(neuron: Mesh) -> None:
    count = neuron.n_components
    preview = preview_eigenpairs(neuron, count + 20)
    assert preview.rows.dtype == np.float32
    assert np.all(preview.eigenvalues[:count] == 0.0)
    assert np.all(preview.eigenvalues[count:] > 0.0)
    np.testing.assert_array_equal(np.isnan(preview.rows).any(axis=0), ~neuron.referenced)
    exact = spectrum_of(neuron, count + 20).eigenvalues[count:]
    error = np.abs(preview.eigenvalues[count:] / exact - 1.0)
    assert np.median(error) < 0.1


def test_rows_have_unit_norm_and_a_sign(rectangle: Mesh) -> None:
    preview = preview_eigenpairs(rectangle, 12, n_cells=300)
    _, mass = cotangent_laplacian(rectangle)
    rows = preview.rows.astype(np.float64)
    np.testing.assert_allclose(rows**2 @ mass.diagonal(), 1.0, rtol=1e-5)
    leading = np.abs(rows).argmax(axis=1)
    assert np.all(rows[np.arange(len(rows)), leading] > 0.0)


def test_unit_makes_no_difference(rectangle: Mesh) -> None:
    preview = preview_eigenpairs(rectangle, 12, n_cells=300)
    large = Mesh(rectangle.vertices * 2.0**20, rectangle.faces)
    scaled = preview_eigenpairs(large, 12, n_cells=300)
    np.testing.assert_allclose(scaled.eigenvalues * 2.0**40, preview.eigenvalues, rtol=1e-4)


def test_faces_without_area_and_a_component_at_one_place_take_no_part(rectangle: Mesh) -> None:
    n = rectangle.n_vertices
    vertices = np.concatenate([rectangle.vertices, np.full((3, 3), 5.0)])
    # Faces of three or two distant vertices on one side of the rectangle.
    side = np.flatnonzero(rectangle.vertices[:, 0] == rectangle.vertices[:, 0].min())
    first, middle, last = side[0], side[len(side) // 2], side[-1]
    more = [[first, middle, last], [first, last, last], [n, n + 1, n + 2]]
    preview = preview_eigenpairs(Mesh(vertices, [*rectangle.faces, *more]), 12, n_cells=300)
    alone = preview_eigenpairs(rectangle, 11, n_cells=300)
    assert preview.eigenvalues[:2].tolist() == [0.0, 0.0]
    assert np.isfinite(preview.rows).all()
    np.testing.assert_allclose(preview.eigenvalues[2:], alone.eigenvalues[1:], rtol=preview.error)


def test_it_can_be_given_up_and_says_how_good_it_is(
    sphere: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(preview_module, "solve", None)  # must not be called
        with pytest.raises(Cancelled):
            preview_eigenpairs(sphere, 5, cancel=lambda: True)
    assert expected_error(5000, 50) < expected_error(2000, 50) < 0.1
