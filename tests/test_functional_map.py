"""Functional maps and ZoomOut: copies of a shape, whose true correspondence is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapes
import trimesh
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.progress import Cancelled


def pairs_of(mesh: mv.Mesh, count: int = 60) -> mv.Decomposition:
    return mv.solve(*mv.cotangent_laplacian(mesh, robust=True), count)


def with_noise(mesh: mv.Mesh, noise: float) -> mv.Mesh:
    """Shift the vertices at random, by a share of the mean edge length."""
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1)
    shifts = np.random.default_rng(5).standard_normal(mesh.vertices.shape)
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


def test_the_matches_back_are_those_of_the_inverse_map() -> None:
    mesh = shapes.blob(3)
    copy, there = shapes.moved_copy(mv.Mesh(mesh.vertices * [1.0, 1.15, 0.9], mesh.faces))
    first, second = pairs_of(mesh, 40), pairs_of(copy, 40)
    found = mv.compare_shapes(first, second, refine=True)
    back = found.back.indices[there]  # of the copy of each vertex
    away = np.linalg.norm(mesh.vertices[back] - mesh.vertices, axis=1) / np.sqrt(mesh.area)
    assert away.mean() < 0.03


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
    found = mv.compare_shapes(pairs_of(copy, 40), pairs_of(loose, 40), refine=True)
    carried, x, score = found.carried((part, width))
    np.testing.assert_array_equal(carried.values, part.values[back])
    assert carried.labels == names
    np.testing.assert_allclose(x.values, loose.vertices[back, 0])
    assert (x.name, x.unit) == ("width", "mm")
    np.testing.assert_array_equal(score.values, found.forth.scores)
    again, _ = found.carried([carried], back=True)
    np.testing.assert_array_equal(again.values[:-1], part.values[:-1])
    assert again.values[-1] == carried.no_label  # the loose vertex


def test_what_cannot_be_mapped_is_refused() -> None:
    pairs = pairs_of(shapes.blob(2), 12)
    start = mv.functional_map(pairs, pairs, n_functions=6)
    with pytest.raises(mv.InputError, match="10 values"):
        start.carry(np.zeros(10))
    refusals: list[tuple[str, Callable[[], object]]] = [
        ("Vertex 162", lambda: mv.functional_map(pairs, pairs, landmarks=[[0, 162]])),
        ("Vertex -1", lambda: mv.functional_map(pairs, pairs, landmarks=[[-1, 0]])),
        ("pairs of vertices", lambda: mv.functional_map(pairs, pairs, landmarks=[0, 1])),
        ("pairs of vertices", lambda: mv.functional_map(pairs, pairs, landmarks=[[0.5, 1]])),
        ("at least two", lambda: mv.functional_map(pairs, pairs, n_functions=1)),
        ("step is 0", lambda: mv.zoomout(pairs, pairs, start, step=0)),
    ]
    for sentence, call in refusals:
        with pytest.raises(mv.InputError, match=sentence):
            call()
    with pytest.raises(Cancelled):
        mv.zoomout(pairs, pairs, start, cancel=lambda: True)
