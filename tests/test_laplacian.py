"""The operators against the properties that define them."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from scipy import sparse
from scipy.linalg import eigh

from meshmash_viewer.errors import InputError
from meshmash_viewer.laplacian import (
    OperatorOptions,
    area_matrix,
    compute_vertex_areas,
    cotangent_laplacian,
)
from meshmash_viewer.mesh import Mesh


def close(actual, expected, tolerance):
    difference = abs(sparse.csc_array(actual) - sparse.csc_array(expected))
    assert difference.max() <= tolerance * abs(sparse.csc_array(expected)).max()


def test_cotangents_of_one_triangle():
    # Angles 90°, 60°, 30° at vertices 0, 1, 2.
    mesh = Mesh([[0.0, 0, 0], [1, 0, 0], [0, np.sqrt(3.0), 0]], [[0, 1, 2]])
    stiffness, mass = cotangent_laplacian(mesh)
    opposite = 0.5 / np.tan(np.radians([90.0, 60.0, 30.0]))
    dense = stiffness.toarray()
    np.testing.assert_allclose(dense[1, 2], -opposite[0], atol=1e-15)
    np.testing.assert_allclose(dense[0, 2], -opposite[1])
    np.testing.assert_allclose(dense[0, 1], -opposite[2])
    np.testing.assert_allclose(mass.diagonal(), np.sqrt(3.0) / 6.0)


def test_a_grid_of_right_triangles_is_the_five_point_stencil():
    stiffness, mass = cotangent_laplacian(shapes.rectangle(5, 5, 4.0, 4.0))
    middle = stiffness.toarray()[12].reshape(5, 5)
    expected = np.zeros((5, 5))
    expected[2, 2], expected[[1, 2, 2, 3], [2, 1, 3, 2]] = 4.0, -1.0
    np.testing.assert_allclose(middle, expected, atol=1e-14)
    assert mass.diagonal()[12] == pytest.approx(1.0)


@pytest.mark.parametrize("robust", [False, True])
def test_formats_symmetry_and_null_space(sphere, robust):
    stiffness, mass = cotangent_laplacian(sphere, robust=robust)
    assert isinstance(stiffness, sparse.csc_array)
    assert stiffness.has_sorted_indices
    assert isinstance(mass, sparse.dia_array)
    assert (abs(stiffness - stiffness.T)).max() == 0.0
    assert np.abs(stiffness.sum(axis=0)).max() < 1e-13
    assert mass.diagonal().sum() == pytest.approx(sphere.area, rel=1e-3)


@pytest.mark.parametrize("robust", [False, True])
def test_linear_functions_are_harmonic_inside_a_flat_mesh(rng, robust):
    flat = shapes.rectangle(12, 12)
    vertices = flat.vertices.copy()
    inside = (vertices[:, :2] > 1e-9).all(axis=1) & (vertices[:, 0] < 2) & (vertices[:, 1] < 1.5)
    vertices[inside, :2] += rng.uniform(-0.04, 0.04, (inside.sum(), 2))
    stiffness, _ = cotangent_laplacian((vertices, flat.faces), robust=robust, mollify_factor=0.0)
    np.testing.assert_allclose((stiffness @ vertices)[inside], 0.0, atol=1e-12)


def test_robust_is_the_plain_operator_on_a_delaunay_mesh(sphere):
    plain = cotangent_laplacian(sphere, robust=False)
    robust = cotangent_laplacian(sphere, robust=True, mollify_factor=0.0)
    close(robust[0], plain[0], 1e-12)
    close(robust[1], plain[1], 1e-12)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("scale", [2.0**-30, 2.0**20])
def test_scaling_by_a_power_of_two_changes_no_bit(neuron, robust, scale):
    mesh = neuron if robust else shapes.icosphere(2, 1.37)
    scaled = Mesh(mesh.vertices * scale, mesh.faces)
    (stiffness, mass), (stiffness_2, mass_2) = (
        cotangent_laplacian(each, robust=robust) for each in (mesh, scaled)
    )
    assert (stiffness != stiffness_2).nnz == 0
    np.testing.assert_array_equal(mass.diagonal() * scale**2, mass_2.diagonal())


def test_units_and_origins_change_rounding_only(neuron):
    stiffness, mass = cotangent_laplacian(neuron, robust=True)
    metres = cotangent_laplacian((neuron.vertices * 1e-9, neuron.faces), robust=True)
    moved = cotangent_laplacian((neuron.vertices + 3e5, neuron.faces), robust=True)
    close(metres[0], stiffness, 1e-9)
    close(metres[1] * 1e18, mass, 1e-9)
    close(moved[0], stiffness, 1e-7)
    close(moved[1], mass, 1e-7)


def test_the_order_of_vertices_and_faces_changes_rounding_only(neuron, rng):
    order = rng.permutation(neuron.n_vertices)
    number = np.argsort(order)
    faces = rng.permutation(number[neuron.faces])
    shuffled = Mesh(neuron.vertices[order], faces)
    stiffness, mass = cotangent_laplacian(neuron, robust=True)
    other, other_mass = cotangent_laplacian(shuffled, robust=True)
    assert stiffness.indices.dtype == other.indices.dtype == np.int32
    assert abs(other - stiffness[order][:, order]).max() < 1e-12 * abs(stiffness).max()
    np.testing.assert_allclose(other_mass.diagonal(), mass.diagonal()[order], rtol=1e-12)


def test_robust_takes_every_fault(neuron):
    stiffness, mass = cotangent_laplacian(neuron, robust=True)
    used = neuron.referenced
    assert np.isfinite(stiffness.data).all()
    assert (mass.diagonal()[used] > 0.0).all()
    assert (mass.diagonal()[~used] == 0.0).all()
    assert stiffness.shape == (neuron.n_vertices,) * 2
    assert (abs(stiffness)[~used].sum(), abs(stiffness)[:, ~used].sum()) == (0.0, 0.0)
    values = eigh(
        stiffness.toarray()[np.ix_(used, used)],
        np.diag(mass.diagonal()[used]),
        eigvals_only=True,
        subset_by_index=[0, 7],
    )
    # positive semi-definite, with one zero a component
    assert np.abs(values[:6]).max() < 1e-9 * values[6]
    assert values[6] > 0.0


def test_robust_takes_a_soup_of_zero_area_and_duplicate_faces(sphere):
    faces = np.concatenate([sphere.faces, sphere.faces[:50], sphere.faces[:5, [1, 0, 2]]])
    collapsed = np.concatenate([faces, [[3, 3, 4], [7, 7, 7]]])
    stiffness, mass = cotangent_laplacian((sphere.vertices, collapsed), robust=True)
    assert np.isfinite(stiffness.data).all()
    assert mass.diagonal().min() > 0.0


def test_plain_refuses_faces_without_area_and_names_one(neuron):
    with pytest.raises(InputError, match=r"Faces without area, 1 of .*robust=True") as caught:
        cotangent_laplacian(neuron)
    flat = neuron.faces[-1].tolist()
    assert str(flat) in str(caught.value)
    # areas need no cotangents
    assert area_matrix(neuron).diagonal().sum() == pytest.approx(neuron.area)


def test_mollification_must_be_enough():
    mesh = Mesh([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]])
    cotangent_laplacian(mesh, robust=True)
    with pytest.raises(InputError, match="mollify_factor"):
        cotangent_laplacian(mesh, robust=True, mollify_factor=-1.0)
    with pytest.raises(InputError, match="mollify_factor"):
        cotangent_laplacian(mesh, robust=True, mollify_factor=float("nan"))


def test_vertex_areas(neuron, sphere):
    areas = compute_vertex_areas(neuron)
    expected = np.zeros(neuron.n_vertices)
    np.add.at(expected, neuron.faces, neuron.face_areas[:, None] / 3.0)
    np.testing.assert_allclose(areas, expected, rtol=1e-12)
    np.testing.assert_array_equal(area_matrix(neuron).diagonal(), areas)
    robust = compute_vertex_areas(sphere, robust=True, mollify_factor=1e-6)
    np.testing.assert_allclose(robust, compute_vertex_areas(sphere), rtol=1e-4)


def test_documented_defaults():
    assert OperatorOptions() == OperatorOptions(robust=True, mollify_factor=1e-5)


def test_a_vertex_whose_faces_have_no_area_is_refused_unless_they_are_mollified() -> None:
    vertices = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 5, 5], [7, 5, 5]]
    faces = [[0, 1, 2], [3, 4, 5]]
    with pytest.raises(InputError, match=r"mollify_factor 0\.0 is too small"):
        cotangent_laplacian((vertices, faces), robust=True, mollify_factor=0.0)
    stiffness, mass = cotangent_laplacian((vertices, faces), robust=True)
    assert np.isfinite(stiffness.data).all()
    assert mass.diagonal().min() > 0.0
