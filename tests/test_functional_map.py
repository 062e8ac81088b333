"""Functional maps and ZoomOut on copies of a shape with known correspondence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapes
import trimesh
from faults import raises
from tiers import slow, slow_but

import meshmash_viewer as mv
from meshmash_viewer.features.functional_map import FunctionalMap
from meshmash_viewer.features.shape import Matches
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigenpairs import Eigenpairs


@cache
def pairs_of(mesh: mv.Mesh, count: int = 60) -> Eigenpairs:
    return mv.solve(*mv.cotangent_laplacian(mesh, robust=True), count)


def with_noise(mesh: mv.Mesh, noise: float, seed: int = 5) -> mv.Mesh:
    """Return a mesh with random vertex shifts, relative to the mean edge length."""
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    shifts = np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    return mv.Mesh(mesh.vertices + noise * edge.mean() * shifts, mesh.faces)


@pytest.mark.parametrize(
    ("noise", "level"), [(0.0, 3), slow(0.02, 3), (0.05, 3), slow(0.05, 4), slow(0.0, 5)]
)
def test_a_turned_permuted_and_noisy_copy_is_matched(noise: float, level: int) -> None:
    mesh = shapes.blob(level)
    copy, there = shapes.moved_copy(with_noise(mesh, noise))
    first, second = pairs_of(mesh), pairs_of(copy)
    start = mv.functional_map(first, second, n_functions=20)
    found = mv.zoomout(first, second, start)
    assert found.matrix.shape == (60, 60)
    assert np.mean(found.matches.indices == there) >= 0.99
    assert np.mean(found.matches.indices == there) >= np.mean(start.matches.indices == there)


def test_the_map_of_a_shape_to_itself_is_the_identity() -> None:
    pairs = pairs_of(shapes.blob(3), 30)
    found = mv.functional_map(pairs, pairs, n_functions=20)
    np.testing.assert_allclose(found.matrix, np.eye(20), atol=1e-6)
    np.testing.assert_array_equal(found.matches.indices, np.arange(642))
    np.testing.assert_allclose(found.matches.scores, 0.0, atol=1e-4)


def test_a_landmark_distinguishes_the_sides_of_a_symmetric_shape() -> None:
    box = trimesh.creation.box((1, 2, 3)).subdivide().subdivide().subdivide()
    mesh = mv.Mesh(box.vertices, box.faces)
    copy, there = shapes.moved_copy(mesh)
    first, second = pairs_of(mesh, 40), pairs_of(copy, 40)
    corner = int(np.argmax(mesh.vertices.sum(axis=1)))
    without = mv.zoomout(first, second, mv.functional_map(first, second, n_functions=20))
    start = mv.functional_map(first, second, landmarks=[[corner, there[corner]]], n_functions=20)
    found = mv.zoomout(first, second, start)
    assert np.mean(without.matches.indices == there) < 0.5
    assert np.mean(found.matches.indices == there) >= 0.99


def found_with(mesh: mv.Mesh, copy: mv.Mesh, count: int = 40, functions: int = 15) -> FunctionalMap:
    """Return the refined map between two meshes, with vertices matched by position."""
    first, second = pairs_of(mesh, count), pairs_of(copy, count)
    start = mv.functional_map(first, second, n_functions=functions, meshes=(mesh, copy))
    return mv.zoomout(first, second, start, meshes=(mesh, copy))


SYMMETRIC, ODD = shapes.blob(3, symmetric=True), shapes.blob(3)


@pytest.mark.parametrize("seed", slow_but([1], [1, 2, 3]))
def test_a_noisy_copy_of_a_symmetric_shape_is_matched_by_its_orientation(seed: int) -> None:
    copy, there = shapes.moved_copy(with_noise(SYMMETRIC, 0.05, seed), seed=seed)
    found = found_with(SYMMETRIC, copy)
    assert np.mean(found.matches.indices == there) >= 0.99
    assert (found.mirrored, found.remark) == (False, "")
    assert found.determined == 1.0
    moved = SYMMETRIC.vertices @ found.rigid[:3, :3].T + found.rigid[:3, 3]
    away = np.linalg.norm(moved - copy.vertices[there], axis=1) / np.sqrt(copy.area)
    np.testing.assert_allclose(found.matches.scores, away, atol=0.01)
    assert away.max() < 0.02
    # Eigenpairs alone do not distinguish left from right.
    first, second = pairs_of(SYMMETRIC, 40), pairs_of(copy, 40)
    blind = mv.zoomout(first, second, mv.functional_map(first, second, n_functions=20))
    assert np.mean(blind.matches.indices == there) < 0.9


def test_the_orientation_alone_distinguishes_left_and_right() -> None:
    bent = mv.Mesh(SYMMETRIC.vertices * [1.05, 0.97, 1.0], SYMMETRIC.faces)
    copy, there = shapes.moved_copy(bent)
    first, second = pairs_of(SYMMETRIC, 40), pairs_of(copy, 40)
    start = mv.functional_map(first, second, n_functions=15, meshes=(SYMMETRIC, copy))
    found = mv.zoomout(first, second, start)
    assert found.rigid is None  # no match by position
    places = SYMMETRIC.vertices[np.argsort(there)[found.matches.indices]]
    away = np.linalg.norm(places - SYMMETRIC.vertices, axis=1) / np.sqrt(SYMMETRIC.area)
    assert away.mean() < 0.03


def test_a_mirror_image_without_a_symmetry_is_matched_and_said() -> None:
    mirrored = mv.Mesh(ODD.vertices * [-1.0, 1.0, 1.0], ODD.faces[:, ::-1])
    copy, there = shapes.moved_copy(with_noise(mirrored, 0.05))
    found = found_with(ODD, copy)
    assert found.mirrored
    assert "reverses left and right" in found.remark
    assert np.linalg.det(found.rigid) < 0.0
    assert np.mean(found.matches.indices == there) >= 0.99
    turned_in, there = shapes.moved_copy(mv.Mesh(ODD.vertices, ODD.faces[:, ::-1]))
    found = found_with(ODD, turned_in)
    assert not found.mirrored
    np.testing.assert_array_equal(found.matches.indices, there)


@pytest.mark.parametrize(
    "axes", slow_but([(1.0, 1.0, 2.0)], [(1.0, 1.5, 2.0), (1.0, 1.0, 2.0), (1.0, 1.0, 1.0)])
)
def test_what_a_symmetry_leaves_undecided_is_said(axes: tuple[float, float, float]) -> None:
    ball = shapes.icosphere(3)
    mesh = mv.Mesh(ball.vertices * axes, ball.faces)
    found = found_with(mesh, shapes.moved_copy(with_noise(mesh, 0.05))[0])
    assert found.determined < 0.5
    assert "equally good" in found.remark


def test_a_noisy_copy_of_a_faulty_dendrite_is_matched() -> None:
    mesh = shapes.neuron(debris=0)
    copy, there = shapes.moved_copy(with_noise(mesh, 0.03))  # The noise is as large as some edges.
    found, used = found_with(mesh, copy).matches.indices, pairs_of(mesh, 40).mass > 0.0
    assert np.mean(found[used] == there[used]) >= 0.99
    assert (found[~used] == -1).all()


def test_maps_labels_and_features_are_carried() -> None:
    mesh = shapes.blob(3)
    copy, there = shapes.moved_copy(mesh)
    loose = mv.Mesh(np.vstack([copy.vertices, [[0.0, 0.0, 0.0]]]), copy.faces)
    more = mv.Mesh(np.vstack([[[9.0, 9.0, 9.0]], mesh.vertices]), mesh.faces + 1)
    first, second = pairs_of(more, 40), pairs_of(loose, 40)
    found = mv.zoomout(first, second, mv.functional_map(first, second, n_functions=20))
    assert found.matches.indices[0] == -1
    assert np.isnan(found.matches.scores[0])
    np.testing.assert_array_equal(found.matches.indices[1:], there)
    heights = loose.vertices[:, 2].copy()
    np.testing.assert_array_equal(found.carry(heights)[1:], copy.vertices[there, 2])
    assert np.isnan(found.carry(heights)[0])
    labels = np.arange(len(heights), dtype=np.uint8)
    assert found.carry(labels)[0] == -1
    np.testing.assert_array_equal(found.carry(labels)[1:], labels[there])
    assert found.carry(np.stack([heights, heights], axis=1)).shape == (643, 2)


def test_maps_of_compared_shapes_are_carried_both_ways() -> None:
    mesh = shapes.blob(3)
    copy, there = shapes.moved_copy(mesh)
    back = np.argsort(there)
    loose = mv.Mesh(np.vstack([mesh.vertices, [[9.0, 9.0, 9.0]]]), mesh.faces)
    names = (mv.Label(3, "top", "#4477aa"), mv.Label(0, "bottom", "#ee6677"))
    high, low = loose.vertices[:, 2] > 0.2, loose.vertices[:, 2] < 0.0
    part = mv.VertexMap("part", np.where(high, 3, np.where(low, 0, 7)), labels=names)
    width = mv.VertexMap("width", loose.vertices[:, 0], unit="mm")
    pairs = pairs_of(copy, 40), pairs_of(loose, 40)
    found = mv.compare_shapes(*pairs, refine=True, meshes=(copy, loose))
    assert found.is_moved_copy
    carried, x, score = found.carried((part, width))
    np.testing.assert_array_equal(carried.values, part.values[back])
    assert carried.labels == names
    np.testing.assert_allclose(x.values, loose.vertices[back, 0])
    assert (x.name, x.unit) == ("width", "mm")
    np.testing.assert_array_equal(score.values, found.forth.scores)
    again, _ = found.carried([carried], back=True)
    np.testing.assert_array_equal(again.values[:-1], part.values[:-1])
    assert again.values[-1] == carried.no_label  # the loose vertex


def test_a_copy_with_noise_of_a_fifth_of_an_edge_is_matched_by_position() -> None:
    """A rigid fit after refinement matches a copy with noise of 0.2 edges.

    The functional map matches 37 % of the vertices. Its fit is rejected: the root mean square
    distance is 0.39 edges, and that of random points on the surface √5 / 6 = 0.37.
    """
    copy, there = shapes.moved_copy(with_noise(ODD, 0.12))
    found = found_with(ODD, copy)
    assert np.mean(found.matches.indices == there) > 0.98
    assert found.rigid is not None


def test_what_cannot_be_mapped_is_refused() -> None:
    pairs = pairs_of(shapes.blob(2), 12)
    start = mv.functional_map(pairs, pairs, n_functions=6)
    with raises("other-mesh", "10 values"):
        start.carry(np.zeros(10))
    refusals: list[tuple[str, str, Callable[[], object]]] = [
        (
            "vertex-unused",
            "Vertex 162",
            lambda: mv.functional_map(pairs, pairs, landmarks=[[0, 162]]),
        ),
        (
            "vertex-unused",
            "Vertex -1",
            lambda: mv.functional_map(pairs, pairs, landmarks=[[-1, 0]]),
        ),
        ("wrong-shape", "pairs of", lambda: mv.functional_map(pairs, pairs, landmarks=[0, 1])),
        ("wrong-shape", "pairs of", lambda: mv.functional_map(pairs, pairs, landmarks=[[0.5, 1]])),
        ("too-few-pairs", "at least two", lambda: mv.functional_map(pairs, pairs, n_functions=1)),
        ("other-mesh", "162 vertices", lambda: mv.functional_map(pairs, pairs, meshes=(ODD, ODD))),
        ("out-of-range", "step is 0", lambda: mv.zoomout(pairs, pairs, start, step=0)),
    ]
    for code, word, call in refusals:
        with raises(code, word):
            call()
    with pytest.raises(Cancelled):
        mv.zoomout(pairs, pairs, start, cancel=lambda: True)


def with_island(mesh: mv.Mesh) -> mv.Mesh:
    """Return a mesh with an island of three vertices, numbered last."""
    edge = np.linalg.norm(mesh.vertices[mesh.faces[0, 0]] - mesh.vertices[mesh.faces[0, 1]])
    island = mesh.vertices.max(axis=0) + edge * np.array([[1, 0, 0], [2, 0, 0], [1, 1, 0]])
    faces = [[mesh.n_vertices + at for at in range(3)]]
    return mv.Mesh(np.vstack([mesh.vertices, island]), np.vstack([mesh.faces, faces]))


@pytest.mark.parametrize("on", slow_but(["both"], ["first", "second", "both"]))
def test_an_island_of_three_vertices_changes_no_other_match(on: str) -> None:
    bent, there = shapes.moved_copy(mv.Mesh(ODD.vertices * [1.1, 0.95, 1.0], ODD.faces))

    def matched(mesh: mv.Mesh, other: mv.Mesh) -> np.ndarray:
        pairs = pairs_of(mesh, 40), pairs_of(other, 40)
        found = mv.compare_shapes(*pairs, refine=True, meshes=(mesh, other))
        assert found.doubt == ""
        assert (found.forth.indices[ODD.n_vertices :] == -1).all()
        return found.forth.indices[: ODD.n_vertices]

    plain = matched(ODD, bent)
    island = matched(
        ODD if on == "second" else with_island(ODD), bent if on == "first" else with_island(bent)
    )
    places = ODD.vertices[np.argsort(there)]
    away = np.linalg.norm(places[plain] - places[island], axis=1) / np.sqrt(ODD.area)
    assert np.mean(plain == there) > 0.5
    assert away.mean() < 0.02


@pytest.mark.parametrize(("columns", "count"), [(12, 200), slow(32, 60), slow(100, 60)])
def test_broad_bands_of_many_pairs_determine_the_map(columns: int, count: int) -> None:
    mesh = shapes.blob(3)
    copy, there = shapes.moved_copy(mv.Mesh(mesh.vertices * [1.0, 1.05, 1.1], mesh.faces))
    first, second = pairs_of(mesh, count), pairs_of(copy, count)
    bank = mv.wave_kernel_bank(first.eigenvalues * first.mass.sum(), columns)
    found = mv.compare_shapes(first, second, bank, refine=True, meshes=(mesh, copy))
    assert found.functional is not None
    assert found.functional.determined == 1.0
    assert np.mean(found.forth.indices == there) > 0.5


def test_a_match_in_doubt_is_said_and_not_carried() -> None:
    ball = shapes.icosphere(3)
    pairs = pairs_of(ball, 40)
    height = mv.VertexMap("height", ball.vertices[:, 2])
    with pytest.warns(mv.MeshWarning, match="equally good"):
        found = mv.compare_shapes(pairs, pairs, refine=True)
    with raises("match-in-doubt", "equally good"):
        found.carried([height])
    with raises("match-in-doubt", "equally good"):
        found.functional.carry(height.values)
    few = replace(
        mv.compare_shapes(pairs, pairs, vertices=np.arange(642)),
        given=False,
        forth=Matches.of(642, np.arange(642), np.arange(642) % 60, np.zeros(642)),
    )
    assert few.doubt == "642 vertices match only 60 vertices of the other"
    with raises("match-in-doubt", "only 60"):
        few.carried([height])
    assert replace(few, given=True).carried([height])


def test_a_match_by_index_includes_vertices_outside_of_the_mask() -> None:
    mesh = shapes.blob(3)
    half = mesh.masked(mesh.vertices[:, 2] > 0.0)
    found = mv.compare_shapes(
        pairs_of(half, 20), pairs_of(mesh, 20), vertices=mv.corresponding_vertices(half, mesh)
    )
    label = mv.VertexMap("label", np.arange(642.0))
    carried, score = found.carried([label])
    np.testing.assert_array_equal(carried.values, label.values)
    assert np.isnan(score.values[mesh.vertices[:, 2] < -0.2]).all()
