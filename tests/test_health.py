"""Faults of a mesh: counts and repairs."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from faults import raises
from shapes import moved, signed_volume, together

from meshmash_viewer.health import (
    REPAIRS,
    largest_component,
    median_edge_length,
    mesh_health,
    repair_mesh,
)
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.samples import sample_path

FAULTS = (
    "boundary_edges",
    "nonmanifold_edges",
    "ambiguous_edges",
    "degenerate_faces",
    "duplicate_faces",
    "unreferenced_vertices",
    "coincident_vertices",
)


def test_a_clean_closed_mesh_has_no_faults(sphere):
    health = mesh_health(sphere)
    assert all(getattr(health, fault) == 0 for fault in FAULTS)
    assert (health.n_vertices, health.n_faces) == (642, 1280)
    assert (health.n_components, health.largest_component) == (1, 642)
    assert health.area == sphere.area


def test_edges_agree_with_counting_by_hand(neuron):
    faces_of_edge: dict[tuple[int, int], int] = {}
    for face in neuron.faces.tolist():
        for i, j in ((0, 1), (1, 2), (2, 0)):
            edge = (min(face[i], face[j]), max(face[i], face[j]))
            faces_of_edge[edge] = faces_of_edge.get(edge, 0) + 1
    counts = np.array(list(faces_of_edge.values()))
    health = mesh_health(neuron)
    assert health.boundary_edges == (counts == 1).sum()
    assert health.nonmanifold_edges == (counts > 2).sum()


def _spread(mesh, rng):
    """Return the largest relative change of L under permutations of the faces."""
    stiffness, _ = cotangent_laplacian(mesh, robust=True)
    orders = (Mesh(mesh.vertices, rng.permutation(mesh.faces)) for _ in range(8))
    others = (cotangent_laplacian(other, robust=True)[0] for other in orders)
    return max(abs(other - stiffness).max() for other in others) / abs(stiffness).max()


#: Third corners of the faces around the edge 01.
_AROUND = {
    "three directions": ([2, 3, 4], 0),
    "two opposite directions": ([2, 3, 5], 0),
    "a duplicate": ([2, 3, 3], 1),
    "one folded onto another": ([2, 3, 6], 1),
    "one without area": ([2, 3, 7], 1),
    "a duplicate and no third direction": ([2, 2], 0),
}


@pytest.mark.parametrize(("corners", "count"), _AROUND.values(), ids=_AROUND)
@pytest.mark.parametrize("scale", [1e-9, 3e5])
def test_edges_whose_faces_have_no_order_of_their_own_are_counted(corners, count, scale):
    vertices = np.array(
        [[0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.4, -0.5, 1], [0.2, -0.5, -1], [0.6, -1, 0],
         [0.1, -0.9, 1.8], [0.5, 0, 0]]
    )  # fmt: skip
    turn = np.linalg.qr(vertices[:3] + np.eye(3))[0]
    faces = [[0, 1, corner] if at % 2 else [1, 0, corner] for at, corner in enumerate(corners)]
    mesh = Mesh(scale * (vertices @ turn + 0.7), faces)
    health = mesh_health(mesh)
    assert (health.ambiguous_edges, health.nonmanifold_edges) == (count, int(len(corners) > 2))


def test_only_where_edges_are_ambiguous_does_the_robust_operator_depend_on_the_order(rng):
    found = set()
    for grid in (False, True) * 10:
        vertices = rng.integers(0, 3, (9, 3)) if grid else rng.normal(size=(9, 3))
        faces = np.array([rng.permutation(9)[:3] for _ in range(12)])
        mesh = Mesh(vertices, faces)
        ambiguous, spread = mesh_health(mesh).ambiguous_edges > 0, _spread(mesh, rng)
        assert ambiguous or spread < 1e-9
        found.add((ambiguous, spread > 1e-3))
    assert found >= {(True, True), (False, False)}


def test_triangle_soup_is_counted_and_merged(sphere):
    soup = Mesh(sphere.vertices[sphere.faces].reshape(-1, 3), np.arange(3840).reshape(-1, 3))
    health = mesh_health(soup)
    assert health.coincident_vertices == 3840 - 642
    assert health.n_components == 1280
    merged = REPAIRS["merge_coincident_vertices"].apply(soup)
    assert all(getattr(mesh_health(merged), fault) == 0 for fault in FAULTS)
    assert merged.n_vertices == 642
    assert merged.area == pytest.approx(sphere.area, rel=1e-14)


def test_a_needle_is_flat_in_any_unit():
    needle = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-14, 0], [0.0, 1, 0]])
    for scale in (1e-9, 1.0, 1e9):
        mesh = Mesh(needle * scale, [[0, 1, 2], [0, 1, 3]])
        assert mesh_health(mesh).degenerate_faces == 1


#: Two adjacent triangles, a separate triangle, and three degenerate faces.
SPOILED = Mesh(
    [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5], [9, 0, 0], [9, 1, 0], [8, 1, 0]],
    [[4, 4, 0], [0, 1, 2], [2, 2, 2], [0, 2, 3], [1, 3, 1], [5, 6, 7], [1, 2, 0]],
)


@pytest.mark.parametrize(
    ("name", "faces", "vertices"),
    [
        ("drop_degenerate_faces", [1, 3, 5, 6], range(8)),
        ("drop_duplicate_faces", [0, 1, 2, 3, 4, 5], range(8)),
        ("drop_unreferenced_vertices", [1, 3, 5, 6], [0, 1, 2, 3, 5, 6, 7]),
        ("keep_largest_component", [1, 3, 6], [0, 1, 2, 3]),
        ("merge_coincident_vertices", range(7), range(8)),
    ],
)
def test_repairs_keep_the_right_faces_where_some_have_a_corner_twice(name, faces, vertices):
    mended = REPAIRS[name].apply(SPOILED)
    np.testing.assert_array_equal(mended.vertices, SPOILED.vertices[list(vertices)])
    np.testing.assert_array_equal(
        mended.vertices[mended.faces], SPOILED.vertices[SPOILED.faces[list(faces)]]
    )


def test_faults_are_counted_where_some_faces_have_a_corner_twice():
    health = mesh_health(SPOILED)
    assert (health.degenerate_faces, health.duplicate_faces) == (3, 1)
    assert (health.unreferenced_vertices, health.n_components) == (1, 2)
    assert health.largest_component == 4
    # The diagonal has three faces, each side of the square one or two, the other edges one.
    assert (health.boundary_edges, health.nonmanifold_edges) == (5, 1)


def test_coincident_vertices_are_merged_into_the_first_of_each_place():
    vertices = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]]
    mesh = Mesh(vertices, [[0, 1, 2], [3, 5, 4], [6, 5, 2]])
    assert mesh_health(mesh).coincident_vertices == 3
    merged = REPAIRS["merge_coincident_vertices"].apply(mesh)
    np.testing.assert_array_equal(merged.vertices, np.array(vertices)[[0, 1, 2, 5]])
    np.testing.assert_array_equal(merged.faces, [[0, 1, 2], [1, 3, 2], [1, 3, 2]])


def test_a_face_is_flat_by_its_longest_edge():
    vertices = [[0.0, 0, 0], [1, 0, 0], [0.1, 5e-13, 0], [0.1, 5e-12, 0]]
    mesh = Mesh(vertices, [[0, 1, 2], [0, 1, 3]])
    np.testing.assert_array_equal(mesh.degenerate_faces, [True, False])


@pytest.mark.parametrize("name", REPAIRS)
def test_each_repair_leaves_nothing_of_what_it_counts(neuron, name):
    repair = REPAIRS[name]
    mended = repair.apply(neuron)
    assert repair.label
    assert repair.count(mesh_health(mended)) == 0
    assert mended.unit == "nm"
    assert mended.name == neuron.name
    # A second repair changes nothing.
    assert REPAIRS[name].apply(mended).content_hash == mended.content_hash


def test_all_repairs_make_a_mesh_for_the_plain_operator(neuron):
    mesh = neuron
    for repair in REPAIRS.values():
        mesh = repair.apply(mesh)
    cotangent_laplacian(mesh, robust=False)
    assert mesh.n_components == 1


def test_a_repair_that_would_leave_nothing_is_refused():
    mesh = Mesh(np.diag([1.0, 1.0, 1.0]) * 1e-3, [[0, 1, 2]])
    assert REPAIRS["drop_duplicate_faces"].apply(mesh).n_faces == 1
    needle = Mesh([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-14, 0]], [[0, 1, 2]])
    with raises("no-faces", "leave no face"):
        REPAIRS["drop_degenerate_faces"].apply(needle)


def test_a_flat_face_far_from_the_origin_is_still_flat():
    # Rounding of the coordinates gives the face a height of about 1e-11.
    vertices = np.array([[0.1, 0.2, 0.3], [100.7, 30.1, 5.9], [0.0, 0, 0], [3.0, 50, 7]])
    vertices[2] = 0.3 * vertices[0] + 0.7 * vertices[1]
    far = np.array([250_000.0, 180_000.0, 90_000.0])
    mesh = Mesh(vertices + far, [[0, 1, 2], [0, 1, 3]])
    np.testing.assert_array_equal(mesh.degenerate_faces, [True, False])


def test_repairs_by_name_and_the_largest_component(neuron):
    largest = largest_component(neuron)
    assert mesh_health(largest).n_components == 1
    assert largest.n_vertices == mesh_health(neuron).largest_component
    mended = repair_mesh(neuron, "drop_unreferenced_vertices", "drop_duplicate_faces")
    health = mesh_health(mended)
    assert (health.unreferenced_vertices, health.duplicate_faces) == (0, 0)
    assert repair_mesh(neuron) is neuron
    with raises("unknown-name"):
        repair_mesh(neuron, "polish")


def test_the_median_edge():
    # sides of 1, 1 and √2 in each of the two triangles
    square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3], [0, 0, 1]])
    assert median_edge_length(square) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["dendrite", "neuron"])
def test_the_sample_neurons_are_one_closed_surface_in_nm(name: str) -> None:
    mesh = read_mesh(sample_path(name))
    health = mesh_health(mesh)
    faults = health.boundary_edges, health.nonmanifold_edges, health.degenerate_faces
    assert (health.n_components, faults, mesh.unit) == (1, (0, 0, 0), "nm")
    assert mesh.n_vertices - len(mesh.faces) // 2 == 2  # no handle


# -- seams -------------------------------------------------------------------------------------


def _split(mesh: Mesh, chunk: np.ndarray) -> Mesh:
    """Return a mesh whose chunks share no vertices, as of a surface stored in chunks."""
    vertices, faces, start = [], [], 0
    for each in np.unique(chunk):
        part = mesh.faces[chunk == each]
        used, numbered = np.unique(part, return_inverse=True)
        vertices.append(mesh.vertices[used])
        faces.append(numbered.reshape(-1, 3) + start)
        start += len(used)
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def _octants(mesh: Mesh) -> np.ndarray:
    middle = mesh.vertices[mesh.faces].mean(axis=1) - mesh.vertices.mean(axis=0)
    return (middle > 0.0) @ [1, 2, 4]


CHUNKS = {
    "octants of a ball": lambda: (shapes.icosphere(3), _octants),
    "every face of a ball": lambda: (shapes.icosphere(2), lambda mesh: np.arange(mesh.n_faces)),
    "strips of a plane": lambda: (
        shapes.rectangle(9, 7), lambda mesh: np.arange(mesh.n_faces) // 12
    ),
    "random chunks of a ball": lambda: (
        shapes.icosphere(3),
        lambda mesh: np.random.default_rng(0).integers(0, 5, mesh.n_faces),
    ),
    "octants turned over": lambda: (
        Mesh(shapes.icosphere(2).vertices, shapes.icosphere(2).faces[:, ::-1]), _octants
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CHUNKS.values(), ids=CHUNKS)
@pytest.mark.parametrize("shift", [1e6])
def test_chunks_become_the_surface_that_they_were(case, shift):
    whole, chunk_of = case()
    whole = Mesh(whole.vertices + shift, whole.faces)
    chunks = _split(whole, chunk_of(whole))
    health = mesh_health(chunks)
    assert health.seam_vertices == health.coincident_vertices > 0
    merged = repair_mesh(chunks, "merge_seams")
    for name in ("n_vertices", "n_components", "boundary_edges", "nonmanifold_edges"):
        assert getattr(mesh_health(merged), name) == getattr(mesh_health(whole), name)
    assert mesh_health(merged).coincident_vertices == 0
    assert merged.area == pytest.approx(whole.area, rel=1e-12)


def _box(shift: float) -> Mesh:
    import trimesh

    box = trimesh.creation.box()
    return moved(Mesh(box.vertices, box.faces), shift, 0.0, 0.0)


PLANE = shapes.rectangle(5, 5, 4.0, 4.0)
#: A vertical square whose lower edge lies within `PLANE`.
WALL = Mesh(PLANE.vertices[:, [0, 2, 1]] + [0.0, 2.0, 0.0], PLANE.faces)
TOUCHING = {
    "balls at one vertex": together(
        shapes.icosphere(2), moved(shapes.icosphere(2), *2.0 * shapes.icosphere(2).vertices[0])
    ),
    "a ball twice": together(shapes.icosphere(2), shapes.icosphere(2)),
    "a ball and its inside": together(
        shapes.icosphere(2), Mesh(shapes.icosphere(2).vertices, shapes.icosphere(2).faces[:, ::-1])
    ),
    "a plane twice": together(PLANE, PLANE),
    "a plane and its back": together(PLANE, Mesh(PLANE.vertices, PLANE.faces[:, ::-1])),
    "planes that share a corner": together(PLANE, moved(PLANE, 4.0, 4.0, 0.0)),
    "a wall on a plane": together(PLANE, WALL),
    "boxes with a common side": together(_box(0.0), _box(1.0)),
    "three sheets at one edge": together(
        PLANE, moved(PLANE, 4.0, 0.0, 0.0),
        Mesh(PLANE.vertices[:, [2, 1, 0]] + [4.0, 0.0, 0.0], PLANE.faces),
    ),
}  # fmt: skip


@pytest.mark.parametrize("mesh", TOUCHING.values(), ids=TOUCHING)
def test_sheets_that_touch_stay_apart(mesh):
    health = mesh_health(mesh)
    assert health.coincident_vertices > 0
    assert health.seam_vertices == 0
    assert repair_mesh(mesh, "merge_seams") == mesh
    assert repair_mesh(mesh, "merge_coincident_vertices").n_vertices < mesh.n_vertices


def test_two_chunked_sheets_that_touch_are_two():
    """Seams of two sheets at one place: chunks are joined within each sheet only."""
    ball = shapes.icosphere(3)
    other = moved(ball, *2.0 * ball.vertices[0])
    both = together(_split(ball, _octants(ball)), _split(other, _octants(other)))
    merged = repair_mesh(both, "merge_seams")
    health = mesh_health(merged)
    assert (health.n_vertices, health.n_components, health.boundary_edges) == (1284, 2, 0)
    assert health.coincident_vertices == 1
    assert mesh_health(repair_mesh(both, "merge_coincident_vertices")).n_components == 1


# -- directions --------------------------------------------------------------------------------


def _turned(mesh: Mesh, which: np.ndarray) -> Mesh:
    return Mesh(mesh.vertices, np.where(which[:, None], mesh.faces[:, ::-1], mesh.faces))


def _disagreeing_by_hand(mesh: Mesh) -> int:
    ways: dict[tuple[int, int], list[bool]] = {}
    for face in mesh.faces.tolist():
        for i, j in ((0, 1), (1, 2), (2, 0)):
            a, b = face[i], face[j]
            ways.setdefault((min(a, b), max(a, b)), []).append(a > b)
    return sum(len(each) == 2 and each[0] == each[1] for each in ways.values())


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("shift", [1e6])
def test_a_closed_surface_looks_outwards(share: float, shift: float):
    ball = shapes.icosphere(3)
    which = np.random.default_rng(1).random(ball.n_faces) < share
    mesh = _turned(moved(ball, shift, -shift, shift), which)
    health = mesh_health(mesh)
    assert health.disagreeing_edges == _disagreeing_by_hand(mesh)
    # Faces that are all reversed agree, too: a whole mesh may face inwards by intent.
    expected = int(which.sum()) if 0 < which.sum() < ball.n_faces else 0
    assert health.reversed_faces == expected
    oriented = repair_mesh(mesh, "orient_faces")
    after = mesh_health(oriented)
    assert (after.disagreeing_edges, after.reversed_faces) == (0, 0)
    sign = -1.0 if share == 1.0 else 1.0
    assert signed_volume(moved(oriented, -shift, shift, -shift)) == pytest.approx(
        sign * signed_volume(ball)
    )


@pytest.mark.parametrize("share", [0.1, 0.4, 0.7])
def test_on_an_open_surface_the_larger_area_stays(share: float):
    sheet = shapes.rectangle(20, 15)
    which = np.random.default_rng(2).random(sheet.n_faces) < share
    oriented = repair_mesh(_turned(sheet, which), "orient_faces")
    up = np.sign(oriented.vertex_normals[:, 2])
    larger = sheet.face_areas[which].sum() > sheet.area / 2.0
    assert (up == (-1.0 if larger else 1.0) * np.sign(sheet.vertex_normals[0, 2])).all()


def _strip(count: int, twists: int) -> Mesh:
    """Return a ring of squares, which has one side only if `twists` is odd."""
    angle = 2.0 * np.pi * np.arange(count) / count
    half = 0.3 * np.array([-1.0, 1.0])[:, None]
    lean = 0.5 * twists * angle
    radius = 1.0 + half * np.cos(lean)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), half * np.sin(lean)], -1)
    low = np.arange(count)
    following = (low + 1) % count
    swapped = (following == 0) & (twists % 2 == 1)
    a, b, c, d = low, low + count, following + count * swapped, following + count * ~swapped
    faces = np.concatenate([np.column_stack([a, c, d]), np.column_stack([a, d, b])])
    return Mesh(points.reshape(-1, 3), faces)


def test_a_surface_with_one_side_has_no_direction():
    strip = _strip(24, 1)
    health = mesh_health(strip)
    assert health.disagreeing_edges > 0
    assert health.reversed_faces == 0
    assert repair_mesh(strip, "orient_faces") == strip
    # Other components are still oriented.
    ring = _strip(24, 2)
    both = together(strip, moved(_turned(ring, np.arange(ring.n_faces) < 5), 5.0, 0.0, 0.0))
    assert mesh_health(both).reversed_faces == 5
    after = mesh_health(repair_mesh(both, "orient_faces"))
    assert after.disagreeing_edges == health.disagreeing_edges


def test_directions_do_not_cross_edges_of_many_faces():
    """Three half planes at one edge have no disagreeing edge, whatever their orientation."""
    mesh = repair_mesh(TOUCHING["three sheets at one edge"], "merge_coincident_vertices")
    for way in range(8):
        which = np.repeat([way & 1, way & 2, way & 4], PLANE.n_faces) > 0
        assert mesh_health(_turned(mesh, which)).disagreeing_edges == 0


def test_a_duplicate_face_does_not_disagree():
    mesh = Mesh(
        PLANE.vertices, np.concatenate([PLANE.faces, PLANE.faces[:3], PLANE.faces[3:5, ::-1]])
    )
    health = mesh_health(mesh)
    assert (health.duplicate_faces, health.disagreeing_edges, health.reversed_faces) == (5, 0, 0)
