from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.clustering import cluster_vertices, sample_faces
from meshmash_viewer.mesh import Mesh


def test_a_sphere_stays_a_sphere() -> None:
    sphere = shapes.icosphere(5)
    coarse = cluster_vertices(sphere.vertices, sphere.faces, 800)
    assert 400 < len(coarse.representatives) < 1600
    small = Mesh(sphere.vertices[coarse.representatives], coarse.faces)
    assert abs(small.area / (4 * np.pi) - 1) < 0.03
    # Faces keep their sense: nearly all of them look outwards.
    a, b, c = (small.vertices[small.faces[:, k]] for k in range(3))
    outwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0
    assert outwards.mean() > 0.98


def test_faces_are_sound(neuron: Mesh) -> None:
    coarse = cluster_vertices(neuron.vertices, neuron.faces, 300)
    chosen = coarse.representatives
    assert (np.diff(chosen) > 0).all()
    assert neuron.referenced[chosen].all()
    assert coarse.faces.min() >= 0
    assert coarse.faces.max() < len(chosen)
    a, b, c = coarse.faces.T
    assert ((a != b) & (b != c) & (c != a)).all()
    assert len(np.unique(coarse.faces, axis=0)) == len(coarse.faces)


def test_the_unit_changes_nothing(neuron: Mesh) -> None:
    mesh = neuron
    one = cluster_vertices(mesh.vertices, mesh.faces, 60)
    other = cluster_vertices(mesh.vertices / 1024.0, mesh.faces, 60)
    np.testing.assert_array_equal(one.representatives, other.representatives)
    np.testing.assert_array_equal(one.faces, other.faces)


@pytest.mark.parametrize("count", [1, 5, 10**6])
def test_any_count_will_do(count: int) -> None:
    sphere = shapes.icosphere(2)
    coarse = cluster_vertices(sphere.vertices, sphere.faces, count)
    assert 1 <= len(coarse.representatives) <= sphere.n_vertices
    if count == 10**6:
        assert len(coarse.representatives) == sphere.n_vertices
        assert len(coarse.faces) == sphere.n_faces


def test_sampled_faces_are_some_of_the_mesh_from_all_over_it() -> None:
    sphere = shapes.icosphere(5)
    some = sample_faces(sphere.faces, 1000)
    assert 500 < len(some.faces) <= 1000
    of_the_mesh = {tuple(face) for face in sphere.faces.tolist()}
    assert all(tuple(face) in of_the_mesh for face in some.representatives[some.faces].tolist())
    assert (np.diff(some.representatives) > 0).all()
    shown = sphere.vertices[some.representatives]
    distances = np.linalg.norm(sphere.vertices[:, None] - shown[None], axis=2).min(axis=1)
    assert distances.max() < 0.2
    np.testing.assert_array_equal(
        (whole := sample_faces(sphere.faces, 10**6)).representatives[whole.faces], sphere.faces
    )
