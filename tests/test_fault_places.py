"""Places of faults, and changes that repairs would make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapes
from shapes import together

import meshmash_viewer as mv
from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.fault_places import fault_places, repair_effect
from meshmash_viewer.health import first_repair, median_edge_length, mesh_health
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.vertex_map import VertexMap


def faulty() -> Mesh:
    """Return a large ball with a hole and a duplicate face, a small ball, two loose vertices."""
    large, small = shapes.icosphere(2), shapes.icosphere(1)
    faces = [large.faces[1:], large.faces[40:41], small.faces + large.n_vertices]
    vertices = [large.vertices, 0.2 * small.vertices + 2.0, [[5.0] * 3, [6.0] * 3]]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


COUNTS = {
    "boundary_edges": 3,
    "nonmanifold_edges": 3,
    "ambiguous_edges": 3,
    "degenerate_faces": 0,
    "duplicate_faces": 1,
    "disagreeing_edges": 0,
    "unreferenced_vertices": 2,
    "seam_vertices": 0,
    "coincident_vertices": 0,
}


@pytest.mark.parametrize(("fault", "count"), COUNTS.items())
def test_as_many_places_are_found_as_health_counts(fault: str, count: int) -> None:
    mesh = faulty()
    places = fault_places(mesh, fault)
    assert getattr(mesh_health(mesh), fault) == count
    assert len(places.parts) == count
    assert places.n_groups == (count if fault == "unreferenced_vertices" else min(count, 1))


def test_places_are_where_the_faults_are() -> None:
    mesh = faulty()
    hole, twice = set(shapes.icosphere(2).faces[0]), set(shapes.icosphere(2).faces[40])
    assert set(fault_places(mesh, "boundary_edges").parts.ravel()) == hole
    assert set(fault_places(mesh, "duplicate_faces").parts.ravel()) == twice
    assert set(fault_places(mesh, "nonmanifold_edges").parts.ravel()) == twice
    components = fault_places(mesh, "n_components")
    assert (components.n_groups, len(components.parts)) == (1, shapes.icosphere(1).n_faces)
    assert components.parts.min() == shapes.icosphere(2).n_vertices
    turned = mesh.faces.copy()
    turned[[5, 100]] = turned[[5, 100], ::-1]
    places = fault_places(Mesh(mesh.vertices, turned), "disagreeing_edges")
    assert (places.n_groups, places.describe(0)) == (2, "3 edges")


def test_seams_are_grouped_along_the_edges() -> None:
    ball = shapes.icosphere(2)
    side = ball.vertices[ball.faces].mean(axis=1)[:, 0] > 0.0
    vertices = np.concatenate([ball.vertices, ball.vertices])
    faces = np.concatenate([ball.faces[side], ball.faces[~side] + ball.n_vertices])
    mesh = mv.repair_mesh(Mesh(vertices, faces), "drop_unreferenced_vertices")
    places = fault_places(mesh, "seam_vertices")
    assert len(places.parts) == 2 * mesh_health(mesh).seam_vertices
    assert places.n_groups == 2, "either rim of the one seam"
    np.testing.assert_array_equal(fault_places(mesh, "coincident_vertices").parts, places.parts)


@pytest.mark.parametrize(
    ("repair", "effect"),
    [
        (
            "keep_largest_component",  # and the two vertices of no face
            "drops 1 of 2 components, 44 vertices (21.4 %), 80 faces (20 %), 3.65 % of the area",
        ),
        ("drop_duplicate_faces", "drops 1 face (0.25 %), 0.282 % of the area"),
        ("drop_unreferenced_vertices", "drops 2 vertices (0.971 %)"),
        ("orient_faces", ""),
    ],
)
def test_a_repair_is_described_before_it_is_made(repair: str, effect: str) -> None:
    assert repair_effect(faulty(), repair).replace("\u00a0", " ") == effect


def split(mesh: Mesh, n: int = 2) -> Mesh:
    """Cut a mesh into n layers, each with vertices of its own."""
    height = mesh.vertices[mesh.faces].mean(axis=1)[:, 0]
    layer = np.minimum(np.argsort(np.argsort(height)) * n // mesh.n_faces, n - 1)
    keys = layer[:, None] * mesh.n_vertices + mesh.faces
    used, faces = np.unique(keys, return_inverse=True)
    return Mesh(mesh.vertices[used % mesh.n_vertices], faces.reshape(-1, 3))


def moved(mesh: Mesh, by: float) -> Mesh:
    return shapes.moved(mesh, by, 0.0, 0.0)


def jittered(mesh: Mesh, size: float) -> Mesh:
    """Move each vertex by up to a fraction of the median edge."""
    steps = np.random.default_rng(3).uniform(-0.5, 0.5, (mesh.n_vertices, 3))
    return replace(mesh, vertices=mesh.vertices + size * median_edge_length(mesh) * steps)


BALL = shapes.icosphere(2)
BOOK = Mesh([[0, 0, 0], [0, 0, 1], *([np.cos(a), np.sin(a), 0] for a in range(5))],
            [[0, 1, 2 + page] for page in range(5)])  # fmt: skip
FAR = moved(shapes.icosphere(1), 5.0)


@pytest.mark.parametrize(
    ("mesh", "repair", "left"),
    [
        (split(BALL, BALL.n_faces), "merge_seams", 1),
        (split(moved(BALL, 1e7), 7), "merge_seams", 1),
        (Mesh(1e-9 * split(BALL, 7).vertices, split(BALL, 7).faces), "merge_seams", 1),
        (together(split(BALL, 5), Mesh(np.eye(3) + 9.0, [[0, 1, 1], [0, 1, 2]])), "merge_seams", 2),
        (jittered(split(moved(BALL, 1e3), 7), 1e-6), "merge_seams", 1),
        (jittered(split(BOOK, 5), 1e-6), "merge_coincident_vertices", 1),
        (jittered(split(BALL, 2), 1e-2), "keep_largest_component", 1),
        (together(BALL, BALL), "merge_coincident_vertices", 1),
        (together(BALL, FAR), "keep_largest_component", 1),
        (together(BALL, moved(BALL, 2.0 * BALL.vertices[:, 0].max())), "keep_largest_component", 1),
        (faulty(), "keep_largest_component", 1),
    ],
)  # fmt: skip
def test_pieces_that_touch_are_merged_before_any_is_dropped(mesh, repair, left) -> None:
    health = mesh_health(mesh)
    assert first_repair("keep_largest_component", health) == repair
    merges = repair != "keep_largest_component"
    assert (health.untouching_components < health.n_components) is merges
    if merges:
        with pytest.warns(
            MeshWarning, match=f"as components touch: repair with {repair} before it"
        ):
            mv.largest_component(mesh)
    repaired = mv.repair_mesh(mesh, repair)
    assert repaired.n_components == left
    if merges:
        assert repaired.area == pytest.approx(mesh.area, rel=1e-5)
        after = mesh_health(repaired)
        assert first_repair("keep_largest_component", after) == "keep_largest_component"


def test_dropping_flat_faces_opens_edges_and_merging_closes_them() -> None:
    flat = Mesh([[0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 2, 0]], [[0, 1, 2], [0, 1, 3]])
    said = repair_effect(flat, "drop_degenerate_faces")
    assert said.replace("\u00a0", " ") == "drops 1 face (50 %), opens 1 boundary edge"
    box = shapes.icosphere(1)
    soup = Mesh(box.vertices[box.faces].reshape(-1, 3), np.arange(3 * box.n_faces).reshape(-1, 3))
    assert repair_effect(soup, "merge_seams").replace("\u00a0", " ") == (
        "merges 79 of 80 components, 198 vertices (82.5 %), closes 240 boundary edges"
    )
    # half of a ball in two halves keeps the rim of the other half open
    halves = split(shapes.icosphere(2))
    rim = mesh_health(halves).boundary_edges // 2
    said = repair_effect(halves, "keep_largest_component")
    assert said.endswith(f"50\u00a0% of the area, opens {rim} boundary edges")


def test_a_map_that_a_repair_leaves_without_values_is_named() -> None:
    mesh = faulty()
    values = np.full(mesh.n_vertices, np.nan)
    values[shapes.icosphere(2).n_vertices :] = 1.0
    mesh = mesh.with_maps(VertexMap("small", values), VertexMap("x", mesh.vertices[:, 0]))
    with pytest.warns(MeshWarning, match="the map small has no value at the vertices"):
        kept = mv.repair_mesh(mesh, "keep_largest_component")
    assert [each.name for each in kept.maps] == ["x"]
