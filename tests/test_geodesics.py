"""Geodesic distances against closed forms and bounds, and selections by lasso."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import shapes
from faults import raises
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import Delaunay
from tiers import slow

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.split.partition import edge_graph
from meshmash_viewer.surface.geodesics import (
    GeodesicSolver,
    geodesic_distance,
    nearest_distance,
)
from meshmash_viewer.surface.kernels import in_picture, project, visible
from meshmash_viewer.surface.masks import (
    Projection,
    lasso,
    prepared,
    within_polygon,
)
from meshmash_viewer.surface.rays import RayTarget


def square(n: int, jitter: float = 0.0) -> Mesh:
    """Return the unit square of n by n vertices; inner vertices are moved by shares of an edge."""
    x = np.arange(n) / (n - 1.0)
    places = np.stack(np.meshgrid(x, x, indexing="ij"), axis=2).reshape(-1, 2)
    inner = ((places > 0.0) & (places < 1.0)).all(axis=1)
    moves = np.random.default_rng(2).uniform(-jitter, jitter, places.shape) / (n - 1.0)
    places += inner[:, None] * moves
    return Mesh(np.column_stack([places, np.zeros(len(places))]), Delaunay(places).simplices)


def tube(rings: int, around: int = 8) -> Mesh:
    """Return an open tube with edges of length 1, along z from 0."""
    turn = 2.0 * np.pi * np.arange(around) / around
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) / (2.0 * np.sin(np.pi / around))
    z = np.repeat(np.arange(rings, dtype=float), around)
    here = np.arange((rings - 1) * around)
    beside = here - here % around + (here + 1) % around
    faces = [[here, beside, here + around], [beside, beside + around, here + around]]
    vertices = np.column_stack([np.tile(ring, (rings, 1)), z])
    return Mesh(vertices, np.concatenate([np.stack(each, axis=1) for each in faces]))


def check_bounds(mesh: Mesh, found: npt.NDArray[np.float64], vertex: int) -> None:
    """Distances are between the straight line and the path along edges."""
    straight = np.linalg.norm(mesh.vertices - mesh.vertices[vertex], axis=1)
    edges = dijkstra(edge_graph(mesh), indices=vertex)
    reached = np.isfinite(edges)
    assert np.array_equal(np.isfinite(found), reached)
    assert (found[reached] >= straight[reached]).all()
    assert (found[reached] <= edges[reached] * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 3e5])
def test_along_a_ball_of_2562_vertices(scale: float) -> None:
    ball = shapes.icosphere(4)
    moved = Mesh(scale * ball.vertices + 7.0 * scale, ball.faces)
    true = scale * np.arccos(np.clip(ball.vertices @ ball.vertices[11], -1.0, 1.0))
    found = geodesic_distance(moved, 11)
    assert found[11] == 0.0
    assert np.abs(found - true).max() < 0.004 * scale


def test_the_error_is_of_second_order() -> None:
    errors = []
    for level in (3, 4, 5):
        ball = shapes.icosphere(level)
        true = np.arccos(np.clip(ball.vertices @ ball.vertices[100], -1.0, 1.0))
        errors.append(np.abs(geodesic_distance(ball, 100) - true).max())
    assert errors[0] > 2.5 * errors[1] > 6.25 * errors[2]


@pytest.mark.parametrize("rings", [200, slow(4000)])
def test_a_tube_of_any_length(rings: int) -> None:
    mesh = tube(rings)
    z = mesh.vertices[:, 2]
    far = z >= 5.0
    found = nearest_distance(mesh, np.flatnonzero(z == 0.0))
    np.testing.assert_allclose(found[far], z[far], rtol=1e-4)
    found = geodesic_distance(mesh, 0)
    np.testing.assert_allclose(found[8 * 6 :: 8], z[8 * 6 :: 8], rtol=1e-6)
    check_bounds(mesh, found, 0)


@pytest.mark.parametrize(
    ("n", "jitter", "within"), [(25, 0.0, 1e-6), (50, 0.0, 1e-6), (25, 0.4, 1e-3), (50, 0.4, 1e-3)]
)
def test_a_unit_square_from_a_corner(n: int, jitter: float, within: float) -> None:
    mesh = square(n, jitter)
    wanted = np.linalg.norm(mesh.vertices, axis=1)
    assert np.abs(geodesic_distance(mesh, 0) - wanted).max() < within


def test_other_components_change_no_bit() -> None:
    ball = shapes.icosphere(4)
    alone = geodesic_distance(ball, 100)
    small = shapes.icosphere(0, radius=1e-3)
    places = np.random.default_rng(0).uniform(3.0, 900.0, (100, 3))
    others = [shapes.moved(small, *place) for place in places]
    mesh = shapes.together(*others[:60], ball, *others[60:])
    found = geodesic_distance(mesh, 820)
    assert np.array_equal(found[720 : 720 + ball.n_vertices], alone)
    assert np.isnan(found[:720]).all()
    assert np.isnan(found[720 + ball.n_vertices :]).all()


def test_around_a_hole_and_over_a_saddle() -> None:
    """A path bends at the corners of a hole, and at a vertex with angles above 2π."""
    sheet = square(41)
    middle = sheet.vertices[sheet.faces].mean(axis=1)
    outside = (np.abs(middle - 0.5)[:, :2] > 0.25).any(axis=1)
    holed = Mesh(sheet.vertices, sheet.faces[outside])
    found = geodesic_distance(holed, 20)  # in the middle of a side, facing the hole
    across = 2.0 * np.hypot(0.25, 0.25) + 0.5
    assert found[40 * 41 + 20] == pytest.approx(across, rel=5e-3)
    check_bounds(holed, found, 20)
    turn = 2.0 * np.pi * np.arange(12) / 12
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.where(np.arange(12) % 2, 1.0, -1.0)])
    faces = [[0, 1 + k, 1 + (k + 1) % 12] for k in range(12)]
    saddle = Mesh(np.concatenate([np.zeros((1, 3)), rim]), np.array(faces))
    assert geodesic_distance(saddle, 1)[7] == pytest.approx(2.0 * np.sqrt(2.0))


def messy() -> Mesh:
    """Return three sheets at an edge, with faces without area, duplicates and lonely vertices."""
    sheet = square(9, 0.3)
    sheets = [sheet.vertices, sheet.vertices[:, [0, 2, 1]], -sheet.vertices]
    vertices = np.concatenate([*sheets, [[5.0, 5.0, 5.0], [0.0, 0.0, 0.0]]])
    faces = np.concatenate([sheet.faces + k * 81 for k in range(3)])
    axis = np.arange(9) * 9
    faces[faces < 162] = np.where(
        np.isin(faces[faces < 162] - 81, axis), faces[faces < 162] - 81, faces[faces < 162]
    )
    more = [[0, 9, 18], [9, 9, 18], [0, 0, 0], [162, 0, 244], faces[3], faces[3][::-1]]
    return Mesh(vertices, np.concatenate([faces, np.array(more)]))


@pytest.mark.parametrize("vertex", [0, 40, 120, 200])
def test_bounds_on_a_mesh_with_every_fault(vertex: int) -> None:
    mesh = messy()
    found = geodesic_distance(mesh, vertex)
    check_bounds(mesh, found, vertex)
    assert np.isnan(found[243])
    assert np.isnan(geodesic_distance(mesh, 243)).all()


def test_columns_and_the_nearest_of_several() -> None:
    ball = shapes.icosphere(3)
    columns = geodesic_distance(ball, [1, 2, 3])
    assert columns.shape == (ball.n_vertices, 3)
    assert np.array_equal(columns[:, 1], geodesic_distance(ball, 2))
    assert geodesic_distance(ball, [5]).shape == (ball.n_vertices, 1)
    nearest = nearest_distance(ball, [1, 2, 3])
    assert np.abs(nearest - columns.min(axis=1)).max() < 0.01
    with raises("no-vertices"):
        nearest_distance(ball, [])
    with raises("vertex-out-of-range", "There is no vertex 642"):
        nearest_distance(ball, [3, 642])


def test_a_disc_of_a_plane_is_exact() -> None:
    plane = shapes.rectangle(40, 30)
    centre = int(np.linalg.norm(plane.vertices - plane.vertices.mean(axis=0), axis=1).argmin())
    true = np.linalg.norm(plane.vertices - plane.vertices[centre], axis=1)
    vertices, distances = GeodesicSolver(plane).within(np.array([centre]), 0.5)
    assert np.array_equal(np.sort(vertices), np.flatnonzero(true <= 0.5))
    np.testing.assert_allclose(distances, true[vertices], atol=1e-6)


@pytest.mark.parametrize("radius", [0.3, 1.0, 2.5])
def test_a_disc_of_a_sphere(radius: float) -> None:
    ball = shapes.icosphere(4)
    true = np.arccos(np.clip(ball.vertices @ ball.vertices[0], -1.0, 1.0))
    vertices, distances = GeodesicSolver(ball).within(np.array([0]), radius)
    assert np.abs(distances - true[vertices]).max() < 0.01 * radius
    differing = np.setxor1d(vertices, np.flatnonzero(true <= radius))
    assert (np.abs(true[differing] - radius) < 0.01 * radius).all()


def test_what_cannot_be_passed_is_gone_around() -> None:
    plane = shapes.rectangle(41, 31, 2.0, 1.5)
    x, y = plane.vertices[:, 0] - 1.0, plane.vertices[:, 1] - 0.75
    wall = (np.abs(x) < 0.03) & (y < 0.5)
    source = int(np.hypot(x + 0.25, y).argmin())
    reach = GeodesicSolver(plane)
    vertices, _ = reach.within(np.array([source]), 0.5, ~wall)
    assert (x[vertices] < 0.0).all()
    vertices, _ = reach.within(np.array([source]), 1.5, ~wall)
    assert (x[vertices] > 0.0).any()


def test_the_discs_of_a_stroke_are_those_of_its_sources() -> None:
    """Except within 5 % of the border; vertices nearer to earlier sources are not visited again."""
    ball = shapes.icosphere(5)
    reach, radius, away = GeodesicSolver(ball), 0.25, np.full(ball.n_vertices, 9.0)
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
    assert visited < 0.7 * whole


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
    both = shapes.together(back, shapes.moved(front, 0.0, 0.0, 6.0))
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
    both = shapes.together(back, shapes.moved(Mesh(stretched, front.faces), 0.0, 0.0, 6.0))
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
