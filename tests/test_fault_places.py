"""Places of faults, and changes that repairs would make."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

import meshmash_viewer as mv
from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.fault_places import fault_places, repair_effect
from meshmash_viewer.health import mesh_health
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
        ("keep_largest_component", "drops 1 component, 42 vertices, 80 faces"),
        ("drop_duplicate_faces", "drops 1 face"),
        ("drop_unreferenced_vertices", "drops 2 vertices"),
        ("orient_faces", ""),
    ],
)
def test_a_repair_is_described_before_it_is_made(repair: str, effect: str) -> None:
    mesh = faulty()
    health = mesh_health(mesh)
    said = repair_effect(mesh, repair, health)
    if repair == "keep_largest_component":
        assert said == "drops 1 component, 44 vertices, 80 faces", "the loose ones, too"
    else:
        assert said == effect


def test_dropping_flat_faces_opens_edges_and_merging_closes_them() -> None:
    flat = Mesh([[0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 2, 0]], [[0, 1, 2], [0, 1, 3]])
    assert repair_effect(flat, "drop_degenerate_faces", mesh_health(flat)) == (
        "drops 1 face, opens 1 edge"
    )
    box = shapes.icosphere(1)
    soup = Mesh(box.vertices[box.faces].reshape(-1, 3), np.arange(3 * box.n_faces).reshape(-1, 3))
    effect = repair_effect(soup, "merge_seams", mesh_health(soup))
    assert effect == "merges 198 vertices, closes 240 edges"


def test_a_map_that_a_repair_leaves_without_values_is_named() -> None:
    mesh = faulty()
    values = np.full(mesh.n_vertices, np.nan)
    values[shapes.icosphere(2).n_vertices :] = 1.0
    mesh = mesh.with_maps(VertexMap("small", values), VertexMap("x", mesh.vertices[:, 0]))
    with pytest.warns(MeshWarning, match="the map small has no value at the vertices"):
        kept = mv.repair_mesh(mesh, "keep_largest_component")
    assert [each.name for each in kept.maps] == ["x"]
