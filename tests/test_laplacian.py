"""Operators and their defining properties."""

from __future__ import annotations

import numpy as np
import pytest
import robust_laplacian
import shapes
import trimesh
from faults import raises
from scipy import sparse
from scipy.linalg import eigh

from meshmash_viewer.health import mesh_health, repair_mesh
from meshmash_viewer.laplacian import (
    area_matrix,
    compute_vertex_areas,
    cotangent_laplacian,
)
from meshmash_viewer.mesh import Mesh, mesh_to_poly


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


def test_without_ambiguous_edges_the_order_of_vertices_and_faces_changes_rounding_only(neuron, rng):
    neuron = repair_mesh(neuron, "drop_duplicate_faces", "drop_degenerate_faces")
    assert mesh_health(neuron).ambiguous_edges == 0
    order = rng.permutation(neuron.n_vertices)
    number = np.argsort(order)
    faces = rng.permutation(number[neuron.faces])
    shuffled = Mesh(neuron.vertices[order], faces)
    stiffness, mass = cotangent_laplacian(neuron, robust=True)
    other, other_mass = cotangent_laplacian(shuffled, robust=True)
    assert stiffness.indices.dtype == other.indices.dtype == np.int32
    assert abs(other - stiffness[order][:, order]).max() < 1e-12 * abs(stiffness).max()
    np.testing.assert_allclose(other_mass.diagonal(), mass.diagonal()[order], rtol=1e-12)


def _joined(first, second):
    """Return the arrays of both meshes in one."""
    vertices = np.concatenate([first[0], second[0]])
    return vertices, np.concatenate([first[1], second[1] + len(first[0])])


#: Changes of the vertices and faces of a mesh, given a random generator.
ARRAYS = {
    "as they are": lambda v, f, rng: (v, f),
    "faces in another order": lambda v, f, rng: (v, rng.permutation(f)),
    "other first corners": lambda v, f, rng: (v, np.roll(f, 1, axis=1)),
    "every second face reversed": lambda v, f, rng: (v, np.concatenate([f[::2], f[1::2, ::-1]])),
    "duplicates first": lambda v, f, rng: (v, np.concatenate([f[:200], f])),
    "each again, reversed": lambda v, f, rng: (v, rng.permutation(np.append(f, f[:, ::-1], 0))),
    "corners twice": lambda v, f, rng: (v, np.append([[3, 3, 4], [7, 7, 7], [8, 9, 8]], f, 0)),
    "faces without area": lambda v, f, rng: (np.append(v, v[f[:20, 0]], 0), np.append(
        f, np.column_stack([f[:20, 0], len(v) + np.arange(20), f[:20, 1]]), 0)),
    "random faces": lambda v, f, rng: (v, rng.integers(0, len(v), (len(f), 3))),
    "folded flat": lambda v, f, rng: (v * [1.0, 1.0, 0.0], f),
    "on a grid": lambda v, f, rng: (np.round(3.0 * v), f),
    "tiny": lambda v, f, rng: (v * 1e-60, f),
    "huge": lambda v, f, rng: (v * 1e60, f),
    "far away": lambda v, f, rng: (v + 6.378e6, f),
    "vertices in no face": lambda v, f, rng: (np.append([[1e70, 0, 0]], v, 0), f + 1),
    "two components": lambda v, f, rng: _joined((v, f), (v + 5.0, f)),
    "whole numbers": lambda v, f, rng: ((v * 1e6).astype(np.int32), f.astype(np.uint64)),
    "single precision": lambda v, f, rng: (v.astype(np.float32), f.astype(np.int16)),
    "column by column": lambda v, f, rng: (np.asfortranarray(v), np.asfortranarray(f)),
}  # fmt: skip


@pytest.mark.parametrize("change", ARRAYS.values(), ids=ARRAYS)
def test_robust_is_the_operator_of_the_library_for_the_same_arrays(rng, change):
    ball, waist = shapes.icosphere(2), shapes.icosphere(1, radius=0.8)
    # Three sheets share the edges of one face, and two of the sheets another vertex.
    vertices, faces = _joined((ball.vertices, ball.faces), (waist.vertices, waist.faces))
    faces[faces == faces[-1, 0]] = 11
    faces = np.append(faces, [[*ball.faces[0, :2], 170], [*ball.faces[0, :2], 180]], 0)
    vertices, faces = change(vertices, faces, rng)
    expected, areas = robust_laplacian.mesh_laplacian(vertices, faces)
    stiffness, mass = cotangent_laplacian((vertices, faces), robust=True)
    used = Mesh(vertices, faces).referenced
    close(stiffness[used][:, used], expected[used][:, used], 1e-10)
    close(mass.tocsr()[used][:, used], areas[used][:, used], 1e-10)


def test_robust_is_the_operator_of_the_library_for_other_kinds_of_meshes(neuron):
    faces = np.concatenate([neuron.faces, neuron.faces[:300]])
    soup = trimesh.Trimesh(neuron.vertices, faces, process=False)
    expected, _ = robust_laplacian.mesh_laplacian(neuron.vertices, faces)
    used = neuron.referenced
    for mesh in (soup, mesh_to_poly((neuron.vertices, faces)), Mesh(neuron.vertices, faces)):
        stiffness, _ = cotangent_laplacian(mesh, robust=True)
        close(stiffness[used][:, used], expected[used][:, used], 1e-10)


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
    # Positive semidefinite, with one zero for each component.
    assert np.abs(values[:6]).max() < 1e-9 * values[6]
    assert values[6] > 0.0


def test_plain_refuses_faces_without_area_and_names_one(neuron):
    with raises("no-area", "Faces without area, 1 of", "robust=True") as caught:
        cotangent_laplacian(neuron)
    flat = neuron.faces[-1].tolist()
    assert str(flat) in str(caught.value)
    # Areas need no cotangents.
    assert area_matrix(neuron).diagonal().sum() == pytest.approx(neuron.area)


def test_mollification_must_be_enough():
    mesh = Mesh([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]])
    cotangent_laplacian(mesh, robust=True)
    with raises("out-of-range", "mollify_factor"):
        cotangent_laplacian(mesh, robust=True, mollify_factor=-1.0)
    with raises("out-of-range", "mollify_factor"):
        cotangent_laplacian(mesh, robust=True, mollify_factor=float("nan"))


def test_vertex_areas(neuron, sphere):
    areas = compute_vertex_areas(neuron)
    expected = np.zeros(neuron.n_vertices)
    np.add.at(expected, neuron.faces, neuron.face_areas[:, None] / 3.0)
    np.testing.assert_allclose(areas, expected, rtol=1e-12)
    np.testing.assert_array_equal(area_matrix(neuron).diagonal(), areas)
    robust = compute_vertex_areas(sphere, robust=True, mollify_factor=1e-6)
    np.testing.assert_allclose(robust, compute_vertex_areas(sphere), rtol=1e-4)


def test_a_vertex_whose_faces_have_no_area_is_refused_unless_they_are_mollified() -> None:
    vertices = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5], [6, 5, 5], [7, 5, 5]]
    faces = [[0, 1, 2], [3, 4, 5]]
    with raises("not-solvable", "mollify_factor 0.0 is too small"):
        cotangent_laplacian((vertices, faces), robust=True, mollify_factor=0.0)
    stiffness, mass = cotangent_laplacian((vertices, faces), robust=True)
    assert np.isfinite(stiffness.data).all()
    assert mass.diagonal().min() > 0.0
