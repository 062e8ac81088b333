"""Rays with known hits, or with hits found face by face."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from tiers import slow

from meshmash_viewer.mesh import Mesh
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.surface.rays import Plane, RayTarget, curve_order


def _face_by_face(
    mesh: Mesh, start: np.ndarray, end: np.ndarray
) -> tuple[float, int]:  # fraction of the segment and face; infinite and -1 for none
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    way = np.broadcast_to(start - end, a.shape)
    system = np.stack([way, b - a, c - a], axis=2)
    share, u, v = np.linalg.solve(system, (start - a)[..., None])[..., 0].T
    met = (u >= 0) & (v >= 0) & (u + v <= 1) & (share >= 0) & (share <= 1)
    share = np.where(met, share, np.inf)
    return float(share.min()), int(np.argmin(share)) if met.any() else -1


@pytest.mark.parametrize(("count", "size"), [(300, 0.3), (4000, 0.1), slow(4000, 1.0)])
def test_a_soup_is_hit_where_its_faces_are_one_by_one(
    rng: np.random.Generator, count: int, size: float
) -> None:
    corners = rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    soup = Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    target = RayTarget(soup.vertices, soup.faces)
    hits = 0
    # four parallel rays in each direction
    ends = 3 * rng.normal(size=(25, 1, 2, 3)) + 0.5 * rng.normal(size=(25, 4, 1, 3))
    for start, end in ends.reshape(-1, 2, 3):
        share, face = _face_by_face(soup, start, end)
        hit = target.first_hit(start, end)
        if hit is None:
            assert face == -1
        else:
            hits += 1
            assert hit.face == face
            np.testing.assert_allclose(hit.point, start + share * (end - start), atol=1e-9)
    assert hits > 20


@pytest.mark.parametrize("level", [1, 5])
def test_the_near_side_of_a_sphere_is_hit_and_its_inside_from_within(level: int) -> None:
    sphere = shapes.icosphere(level)
    target = RayTarget(sphere.vertices, sphere.faces)
    for direction in np.vstack([np.eye(3), -np.eye(3), sphere.vertices[:20]]):
        outside = target.first_hit(3.0 * direction, -3.0 * direction)
        inside = target.first_hit(np.zeros(3), 3.0 * direction)
        for hit in (outside, inside):
            assert hit is not None
            radius = hit.point @ direction
            assert 0.7 < radius < 1.0 + 1e-9
            np.testing.assert_allclose(hit.point, radius * direction, atol=1e-9)
        assert target.first_hit(3.0 * direction, 1.1 * direction) is None


def test_a_flat_mesh_is_hit_at_its_edges_and_vertices_and_never_edge_on() -> None:
    flat = shapes.rectangle(20, 20, 1.0, 1.0)
    target = RayTarget(flat.vertices, flat.faces)
    up = np.array([0.0, 0.0, 1.0])
    places = np.vstack([flat.vertices, flat.vertices[flat.faces[:, :2]].mean(axis=1)])
    for place in places:
        hit = target.first_hit(place + up, place - up)
        assert hit is not None
        np.testing.assert_allclose(hit.point, place, atol=1e-12)
    assert target.first_hit(np.array([-1.0, 0.5, 0.0]), np.array([2.0, 0.5, 0.0])) is None


def test_far_from_the_origin_in_single_precision_nothing_falls_through() -> None:
    sphere = shapes.icosphere(4)
    points = (sphere.vertices + 1e3).astype(np.float32)
    target = RayTarget(points, sphere.faces)
    for vertex in points[::7].astype(np.float64):
        way = vertex - 1e3
        hit = target.first_hit(vertex + way, vertex - way)
        assert hit is not None
        np.testing.assert_allclose(hit.point, vertex, atol=1e-3)


def test_faces_without_area_are_passed_and_an_empty_mesh_is_missed() -> None:
    points = np.array([[0.0, 0, 1], [1, 0, 1], [0.5, 0, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    target = RayTarget(points, np.array([[0, 1, 2], [3, 4, 5]]))
    hit = target.first_hit(np.array([0.5, 0.0, 2.0]), np.array([0.5, 0.0, -2.0]))
    assert hit is not None
    assert hit.face == 1
    nothing = RayTarget(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert nothing.first_hit(np.zeros(3), np.ones(3)) is None


def test_vertices_behind_the_mesh_are_hidden_and_those_before_it_are_not() -> None:
    sphere = shapes.icosphere(3)
    target = RayTarget(sphere.vertices.astype(np.float32), sphere.faces)
    for eye in np.array([[1.0, 0, 0], [0, -1, 0], [0.6, 0, 0.8]]):
        depth = sphere.vertices @ eye
        assert all(target.hidden(vertex, eye) for vertex in np.flatnonzero(depth < -0.1))
        assert not any(target.hidden(vertex, eye) for vertex in np.flatnonzero(depth > 0.1))


def test_the_vertex_next_to_the_line_of_sight_is_seen() -> None:
    sphere = shapes.icosphere(3)
    target = RayTarget(sphere.vertices.astype(np.float32), sphere.faces)
    for vertex in range(0, sphere.n_vertices, 9):
        eye = sphere.vertices[vertex] / np.linalg.norm(sphere.vertices[vertex])
        assert target.seen_vertex(0.3 * eye, eye) == vertex
        aside = np.cross(eye, np.eye(3)[np.argmin(np.abs(eye))])
        assert target.seen_vertex(0.3 * eye + 2.0 * aside, eye) == -1


def test_what_is_cut_away_is_neither_hit_nor_hides(rng: np.random.Generator) -> None:
    sphere = shapes.icosphere(4)
    target = RayTarget(sphere.vertices, sphere.faces)
    normal = np.array([0.6, 0.0, -0.8])
    cut, eye = Plane(normal, 0.1), np.array([0.0, 0.0, 1.0])
    for x, y in rng.uniform(-0.6, 0.6, (50, 2)):
        heights = np.sqrt(1.0 - x * x - y * y) * np.array([1.0, -1.0])
        kept = [z for z in heights if normal @ [x, y, z] > 0.1]
        edge = min(abs(normal @ [x, y, z] - 0.1) for z in heights)
        vertex = target.seen_vertex(np.array([x, y, 0.0]), eye, cut)
        if edge > 0.1:
            assert (vertex >= 0) == bool(kept)
        if vertex >= 0:
            assert not cut.away(sphere.vertices[[vertex]])[0]
            if edge > 0.1:
                assert np.linalg.norm(sphere.vertices[vertex] - [x, y, kept[0]]) < 0.15
    below = int(sphere.vertices[:, 2].argmin())
    assert target.hidden(below, eye)
    assert not target.hidden(below, eye, cut)
    assert cut.kept(np.zeros(3), -normal) is None


def test_building_is_given_up_when_asked() -> None:
    sphere = shapes.icosphere(2)
    with pytest.raises(Cancelled):
        RayTarget(sphere.vertices, sphere.faces, lambda: True)


def test_neighbours_along_the_curve_are_neighbours_in_space(rng: np.random.Generator) -> None:
    points = rng.random((4000, 3))
    along = points[np.argsort(curve_order(points))]
    steps = np.linalg.norm(np.diff(along, axis=0), axis=1)
    assert np.median(steps) < 2.0 * 4000 ** (-1 / 3)
    assert len(np.unique(curve_order(points))) > 3980
    assert (curve_order(np.ones((5, 3))) == 0).all()


def test_corners_near_a_line_are_those_found_one_by_one(rng: np.random.Generator) -> None:
    sphere = shapes.icosphere(4)
    faces = sphere.faces[sphere.faces.min(axis=1) > 20]  # some vertices belong to no face
    target = RayTarget(sphere.vertices, faces)
    held = np.unique(faces)
    for radius in (0.0, 0.03, 0.2, 5.0):
        for _ in range(20):
            towards, across, along = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
            through = rng.normal(size=3)
            found = target.corners_near(through, np.array([across, along]), radius)
            offset = sphere.vertices - through
            away = np.linalg.norm(offset - np.outer(offset @ towards, towards), axis=1)
            assert np.all(np.diff(away[found]) >= -1e-12)
            assert set(found.tolist()) == set(held[away[held] <= radius].tolist())
