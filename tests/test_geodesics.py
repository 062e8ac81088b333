"""Distances within a radius on a plane, a sphere and around a slit, and selections by lasso."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.surface.kernels import in_picture, project, visible
from meshmash_viewer.surface.masks import (
    Geodesics,
    Projection,
    lasso,
    prepared,
    within_polygon,
)
from meshmash_viewer.surface.rays import RayTarget


def test_a_disc_of_a_plane_is_exact() -> None:
    plane = shapes.rectangle(40, 30)
    centre = int(np.linalg.norm(plane.vertices - plane.vertices.mean(axis=0), axis=1).argmin())
    true = np.linalg.norm(plane.vertices - plane.vertices[centre], axis=1)
    vertices, distances = Geodesics(plane.vertices, plane.faces).within(np.array([centre]), 0.5)
    assert np.array_equal(np.sort(vertices), np.flatnonzero(true <= 0.5))
    np.testing.assert_allclose(distances, true[vertices], atol=1e-6)


@pytest.mark.parametrize("radius", [0.3, 1.0, 2.5])
def test_a_disc_of_a_sphere(radius: float) -> None:
    ball = shapes.icosphere(4)
    true = np.arccos(np.clip(ball.vertices @ ball.vertices[0], -1.0, 1.0))
    vertices, distances = Geodesics(ball.vertices, ball.faces).within(np.array([0]), radius)
    assert np.abs(distances - true[vertices]).max() < 0.01 * radius
    differing = np.setxor1d(vertices, np.flatnonzero(true <= radius))
    assert (np.abs(true[differing] - radius) < 0.01 * radius).all()


def test_what_cannot_be_passed_is_gone_around() -> None:
    plane = shapes.rectangle(41, 31, 2.0, 1.5)
    x, y = plane.vertices[:, 0] - 1.0, plane.vertices[:, 1] - 0.75
    wall = (np.abs(x) < 0.03) & (y < 0.5)
    source = int(np.hypot(x + 0.25, y).argmin())
    reach = Geodesics(plane.vertices, plane.faces)
    vertices, _ = reach.within(np.array([source]), 0.5, ~wall)
    assert (x[vertices] < 0.0).all()
    vertices, _ = reach.within(np.array([source]), 1.5, ~wall)
    assert (x[vertices] > 0.0).any()


def test_the_discs_of_a_stroke_are_those_of_its_sources() -> None:
    """Except within 5 % of the border; vertices nearer to earlier sources are not visited again."""
    ball = shapes.icosphere(5)
    reach, radius, away = Geodesics(ball.vertices, ball.faces), 0.25, np.full(ball.n_vertices, 9.0)
    way = [int(ball.vertices[:, 0].argmax())]
    for angle in np.linspace(0.05, 3.0, 60):
        place = [np.cos(angle), np.sin(angle) * np.cos(angle), np.sin(angle) ** 2]
        way.append(int((ball.vertices @ place).argmax()))
    known, chosen, visited, whole = reach.unreached(), np.zeros(ball.n_vertices, np.bool_), 0, 0
    for source in way:
        found, _ = reach.within(np.array([source]), radius, None, known)
        chosen[found] = True
        vertices, distances = reach.within(np.array([source]), 1.1 * radius)
        away[vertices] = np.minimum(away[vertices], distances)
        visited, whole = visited + len(found), whole + len(vertices)
    assert chosen[away <= 0.95 * radius].all()
    assert not chosen[away > 1.05 * radius].any()
    assert visited < 0.65 * whole


def seen_of(mesh: Mesh, scale: float = 100.0) -> np.ndarray:
    return (scale * mesh.vertices).astype(np.float32)


def box(size: float) -> np.ndarray:
    return size * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def test_a_polygon_takes_what_is_inside_to_a_pixel() -> None:
    points = np.random.default_rng(0).uniform(-60.0, 60.0, (5000, 2))
    triangle = np.array([[-50.0, -40.0], [45.0, -20.0], [0.0, 50.0]])
    turned = np.roll(triangle, -1, axis=0) - triangle
    away = points[:, None] - triangle
    cross = turned[:, 0] * away[..., 1] - turned[:, 1] * away[..., 0]
    depth = (cross / np.linalg.norm(turned, axis=1)).min(axis=1)  # in pixels, positive inside
    inside = within_polygon(points, triangle)
    sure = np.abs(depth) > 1.0
    assert np.array_equal(inside[sure], depth[sure] > 0.0)
    assert not within_polygon(points, triangle + 500.0).any()
    assert not within_polygon(points, np.array([[1000.0, 0.0]])).any()


def test_only_the_front_of_a_ball_is_visible() -> None:
    ball = shapes.icosphere(4)
    seen, chosen = seen_of(ball), np.ones(ball.n_vertices, dtype=np.bool_)
    found = visible(seen, ball.faces, ball.vertices[:, 2], chosen, chosen)
    assert np.array_equal(found, ball.vertices[:, 2] > 0.0)


@pytest.mark.parametrize("subdivisions", [0, 4])
def test_a_ball_behind_another_is_hidden(subdivisions: int) -> None:
    """The front ball may have few large faces, with corners far apart."""
    back, front = shapes.icosphere(4), shapes.icosphere(subdivisions, radius=2.0)
    both = Mesh(
        np.concatenate([back.vertices, front.vertices + np.array([0.0, 0.0, 6.0])]),
        np.concatenate([back.faces, front.faces + back.n_vertices]),
    )
    chosen = within_polygon(seen_of(both), box(110.0))
    facing = both.vertex_normals[:, 2]
    assert chosen[: back.n_vertices].all()
    drawn, seen = np.ones_like(chosen), seen_of(both)
    assert not visible(seen, both.faces, facing, chosen, drawn)[: back.n_vertices].any()
    beside = both.vertices + np.where(np.arange(both.n_vertices) < back.n_vertices, 4.0, 0.0)[
        :, None
    ] * [1.0, 0.0, 0.0]
    seen = (100.0 * beside).astype(np.float32)
    chosen = within_polygon(seen, box(110.0) + np.array([400.0, 0.0]))
    found = visible(seen, both.faces, facing, chosen, drawn)[: back.n_vertices]
    differing = found != (facing[: back.n_vertices] > 0.0)
    assert (np.abs(facing[: back.n_vertices][differing]) < 1e-6).all()  # on the silhouette


def test_small_faces_may_be_left_out_of_a_lasso() -> None:
    """A ball of large and small faces covers another, whose vertices are not in the lasso."""
    back, front = shapes.icosphere(5), shapes.icosphere(3, radius=2.0)
    stretched = np.where(front.vertices[:, :1] > 0.0, 1.0, 0.3) * front.vertices
    both = Mesh(
        np.concatenate([back.vertices, stretched + np.array([0.0, 0.0, 6.0])]),
        np.concatenate([back.faces, front.faces + back.n_vertices]),
    )
    points = both.vertices.astype(np.float32)
    target = RayTarget(points, both.faces)
    edges = both.vertices[both.faces] - both.vertices[np.roll(both.faces, 1, axis=1)]
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    normals = both.vertex_normals.astype(np.float32)
    for pixel in (0.02, 0.05, 0.2, 1e-9):
        large = target.larger_faces(3.0 * pixel)
        left_out = len(both.faces) - len(large)
        kept = {tuple(face) for face in large}
        assert all(tuple(face) in kept for face in both.faces[longest > 3.0 * pixel])
        seen = Projection(points, normals, np.eye(3), np.zeros(3), pixel, (50.0, 50.0))
        around = 50.0 + box(min(0.9 / pixel, 1000.0))
        found = [lasso(both, seen, around, None, False, each) for each in (target, None)]
        assert np.array_equal(*found)
        assert left_out == 0 if pixel < 1e-3 else left_out > len(both.faces) // 3


def test_a_first_lasso_compiles_nothing_once_strokes_are_prepared() -> None:
    ball = shapes.icosphere(2)
    prepared(ball)
    known = [len(loop.signatures) for loop in (project, in_picture, visible)]
    points, normals = (each.astype(np.float32) for each in (ball.vertices, ball.vertex_normals))
    seen = Projection(points, normals, np.eye(3), np.zeros(3), 0.02, (50.0, 50.0))
    around = np.array([[-9.0, -9.0], [109.0, -9.0], [109.0, 109.0], [-9.0, 109.0]])
    back = ball.vertices[:, 2] < -0.5
    target = RayTarget(points, ball.faces)
    for hidden in (None, back):
        for each in (None, target):
            chosen = lasso(ball, seen, around, hidden, False, each)
            assert np.array_equal(chosen, seen.facing > 0.0)
    assert [len(loop.signatures) for loop in (project, in_picture, visible)] == known
