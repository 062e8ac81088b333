from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.decimation import cluster_vertices


def test_a_sphere_stays_a_sphere() -> None:
    sphere = shapes.icosphere(5)
    coarse = cluster_vertices(sphere.vertices, sphere.faces, 800)
    assert 400 < len(coarse.representatives) < 1600
    small = Mesh(sphere.vertices[coarse.representatives], coarse.faces)
    assert abs(small.area / (4 * np.pi) - 1) < 0.03
    # Faces keep their orientation: nearly all normals point outwards.
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


def test_what_falls_into_one_cell_has_no_face() -> None:
    ball = shapes.icosphere(1, 1e-6)
    coarse = cluster_vertices(*shapes.together(ball, shapes.moved(ball, 1.0)), 8)
    assert len(coarse.representatives) == 2
    assert coarse.faces.shape == (0, 3)


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


@pytest.mark.parametrize("count", [300, 1000])
def test_about_as_many_cells_are_met_as_asked_for_whatever_the_shape(count: int) -> None:
    line = np.linspace(0.0, 100.0, 900)
    path = np.stack([line, 0.0 * line, 0.0 * line], axis=1)
    thin = Mesh(*shapes.tube(path, np.full((900, 12), 1.0), around=12))
    for mesh in (thin, shapes.icosphere(5), shapes.rectangle(80, 60)):
        coarse = cluster_vertices(mesh.vertices, mesh.faces, count)
        assert 0.6 * count < len(coarse.representatives) < 1.6 * count
