"""Curvature against the closed forms of sphere, cylinder and torus."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

import meshmash_viewer as mv
from meshmash_viewer.surface.curvature import mixed_areas


def torus(count: int, far: float = 2.0, near: float = 0.7) -> tuple[mv.Mesh, np.ndarray]:
    """Return a torus of two radii, and the angle of each vertex around its tube."""
    u, v = np.meshgrid(*(np.linspace(0.0, 2.0 * np.pi, n, False) for n in (2 * count, count)))
    u, v = u.ravel(), v.ravel()
    ring = far + near * np.cos(v)
    vertices = np.column_stack([ring * np.cos(u), ring * np.sin(u), near * np.sin(v)])
    index = np.arange(2 * count**2).reshape(count, 2 * count)
    a, b = index, np.roll(index, -1, axis=1)
    c, d = np.roll(index, -1, axis=0), np.roll(np.roll(index, -1, axis=0), -1, axis=1)
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    return mv.Mesh(vertices, faces), v


@pytest.mark.parametrize("radius", [1e-3, 1.0, 250.0])
def test_a_sphere_is_curved_by_its_radius(radius: float) -> None:
    mesh = shapes.icosphere(4, radius)
    np.testing.assert_allclose(mv.mean_curvature(mesh), 1.0 / radius, rtol=4e-3)
    np.testing.assert_allclose(mv.gaussian_curvature(mesh), 1.0 / radius**2, rtol=2e-2)
    inside_out = mv.Mesh(mesh.vertices, mesh.faces[:, ::-1])
    np.testing.assert_allclose(mv.mean_curvature(inside_out), -1.0 / radius, rtol=4e-3)


def test_a_torus_is_curved_both_ways() -> None:
    """Errors fall with the square of the edge length."""
    far, near = 2.0, 0.7
    errors = []
    for count in (24, 48):
        mesh, v = torus(count, far, near)
        ring = far + near * np.cos(v)
        mean = (far + 2.0 * near * np.cos(v)) / (2.0 * near * ring)
        gauss = np.cos(v) / (near * ring)
        errors.append(
            [
                np.abs(mv.mean_curvature(mesh) - mean).max() / np.abs(mean).max(),
                np.abs(mv.gaussian_curvature(mesh) - gauss).max() / np.abs(gauss).max(),
            ]
        )
    assert max(errors[1]) < 1e-2
    assert (np.array(errors[0]) > 3.5 * np.array(errors[1])).all()


def test_a_cylinder_is_curved_one_way_and_has_an_edge() -> None:
    radius, n, rows = 3.0, 64, 9
    angle, height = np.meshgrid(np.arange(n) * 2.0 * np.pi / n, np.arange(rows) * 0.3)
    vertices = np.column_stack(
        [radius * np.cos(angle.ravel()), radius * np.sin(angle.ravel()), height.ravel()]
    )
    index = np.arange(n * rows).reshape(rows, n)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    mesh = mv.Mesh(vertices, faces)
    inside = slice(n, -n)
    mean, gauss = mv.mean_curvature(mesh), mv.gaussian_curvature(mesh)
    np.testing.assert_allclose(mean[inside], 0.5 / radius, rtol=2e-3)
    np.testing.assert_allclose(gauss[inside], 0.0, atol=1e-12)
    for values in (mean, gauss):
        assert np.isnan(values[[*range(n), *range(-n, 0)]]).all()


def test_what_is_wrong_with_a_mesh_does_not_spread() -> None:
    """A stray vertex has no curvature; a face without area changes nothing."""
    mesh = shapes.icosphere(2)
    vertices = np.vstack([mesh.vertices, [9.0, 9.0, 9.0]])
    faces = np.vstack([mesh.faces, [0, 0, 1]])
    for curvature in (mv.mean_curvature, mv.gaussian_curvature):
        found = curvature(mv.Mesh(vertices, faces))
        assert np.isnan(found[-1])
        np.testing.assert_allclose(found[:-1], curvature(mesh), rtol=1e-12)
        moved = mv.Mesh(vertices[:-1] + 1e5, mesh.faces)
        np.testing.assert_allclose(curvature(moved), curvature(mesh), rtol=1e-5)


@pytest.mark.parametrize("share", [0.01, 0.3])
def test_mean_curvature_says_that_faces_disagree(share: float) -> None:
    ball = shapes.icosphere(3)
    which = np.random.default_rng(0).random(ball.n_faces) < share
    mesh = mv.Mesh(ball.vertices, np.where(which[:, None], ball.faces[:, ::-1], ball.faces))
    edges = mv.mesh_health(mesh).disagreeing_edges
    with pytest.warns(mv.MeshWarning, match=f"outside at {edges:,} edges.*by the repair orient_f"):
        mv.mean_curvature(mesh)
    mv.gaussian_curvature(mesh)  # independent of the orientation
    oriented = mv.repair_mesh(mesh, "orient_faces")
    np.testing.assert_allclose(mv.mean_curvature(oriented), 1.0, rtol=1e-2)


def test_a_surface_with_one_side_is_not_to_be_repaired() -> None:
    strip = mv.Mesh(
        [[0, 0, 0], [1, 0, 0], [2, 1, 0], [1, 2, 1], [0, 1, 1]],
        [[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 0], [4, 0, 1]],
    )
    with pytest.warns(mv.MeshWarning, match="one side only"):
        mv.mean_curvature(strip)


def test_mixed_areas_are_those_by_which_curvatures_divide() -> None:
    mesh, _ = torus(20)
    areas = mixed_areas(mesh)
    assert areas.sum() == pytest.approx(mesh.area, rel=1e-12)
    assert (mv.gaussian_curvature(mesh) * areas).sum() == pytest.approx(0.0, abs=1e-9)
    # A corner of an equilateral triangle has a third of the area, a right angle a half.
    equilateral = [[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]]
    np.testing.assert_allclose(mixed_areas((equilateral, [[0, 1, 2]])), np.sqrt(3.0) / 12.0)
    right = [[0, 0, 0], [4, 0, 0], [0, 3, 0], [9, 9, 9]]
    np.testing.assert_allclose(mixed_areas((right, [[0, 1, 2]])), [3.0, 1.5, 1.5, 0.0])
    obtuse = [[0, 0, 0], [4, 0, 0], [-3, 1, 0]]
    np.testing.assert_allclose(mixed_areas((obtuse, [[0, 1, 2]])), [1.0, 0.5, 0.5])
    acute = np.array([[0, 0, 0], [4, 0, 0], [1, 3, 0.0]])
    centre = np.array([2.0, 1.0, 0.0])  # of the circumcircle
    cells = [
        sum(
            0.5
            * np.linalg.norm(np.cross((acute[i] + acute[j]) / 2.0 - acute[i], centre - acute[i]))
            for j in range(3)
            if j != i
        )
        for i in range(3)
    ]
    np.testing.assert_allclose(mixed_areas((acute, [[0, 1, 2]])), cells)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_mixed_areas_sum_to_the_area_of_any_mesh(scale: float, neuron: mv.Mesh) -> None:
    mesh = mv.Mesh(neuron.vertices * scale, neuron.faces)
    areas = mixed_areas(mesh)
    assert areas.sum() == pytest.approx(mesh.area, rel=1e-9)
    assert (areas[mesh.unreferenced] == 0.0).all()
    assert (areas[mesh.referenced] >= 0.0).all()
