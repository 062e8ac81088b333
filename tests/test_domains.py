"""Domains: mean features, their graph, and the pipeline that finds domains."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import shapes
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.pieces import (
    CondensedHKS,
    aggregate_features,
    condense_mesh_to_graph,
    expand_features,
)
from meshmash_viewer.samples import sample_path
from meshmash_viewer.split.domains import ward_domains
from meshmash_viewer.split.partition import edge_graph
from meshmash_viewer.surface.decimation import decimated

pytest.importorskip("fast_simplification")
#: Options for several pieces and a short run.
QUICK: dict[str, Any] = {
    "max_vertex_threshold": 900, "t_min": 1e5, "t_max": 2e6, "max_eigenvalue": 2e-6,
    "n_components": 6,
}  # fmt: skip


def condensed(mesh: Any, **arguments: Any) -> CondensedHKS:
    with warnings.catch_warnings(action="ignore", category=mv.TruncationWarning):
        return mv.condensed_hks_pipeline(mesh, **{**QUICK, **arguments})


def as_bytes(found: CondensedHKS) -> list[bytes]:
    tables = (found.condensed_features, found.condensed_nodes, found.condensed_edges)
    arrays = [found.labels, found.simple_labels, found.mapping, found.simple_mesh.vertices]
    return [np.asarray(each).tobytes() for each in (*arrays, *tables, found.seams)]


@pytest.fixture(scope="module")
def sample() -> Mesh:
    return mv.read_mesh(sample_path("neuron"))


@pytest.fixture(scope="module")
def found(sample: Mesh) -> CondensedHKS:
    return condensed(sample, n_jobs=1)


@pytest.fixture(scope="module")
def patches(sphere: Mesh) -> np.ndarray:
    """Return domains 0 to 4 of a sphere, with some vertices in no domain."""
    labels = np.digitize(sphere.vertices[:, 2], [-0.6, -0.2, 0.2, 0.6]).astype(np.int64)
    labels[sphere.vertices[:, 0] > 0.9] = -1
    return labels


# Means and the graph --------------------------------------------------------------------------


def test_means_are_those_of_a_loop(sphere: Mesh, patches: np.ndarray) -> None:
    values = np.stack([sphere.vertices[:, 0], np.arange(sphere.n_vertices) ** 0.5], axis=1)
    values[::7, 1] = np.nan
    areas = sphere.vertex_areas
    means = aggregate_features(values, patches, areas)
    assert means.index.tolist() == [-1, 0, 1, 2, 3, 4]
    assert np.isnan(means.loc[-1]).all()
    for domain in range(5):
        for column in range(2):
            has = (patches == domain) & np.isfinite(values[:, column])
            expected = np.average(values[has, column], weights=areas[has])
            assert means.loc[domain, column] == pytest.approx(expected, rel=1e-12)
    expanded = expand_features(means, patches)
    for vertex in range(0, sphere.n_vertices, 13):
        row = means.loc[patches[vertex]].to_numpy()
        np.testing.assert_array_equal(expanded.loc[vertex].to_numpy(), row)
    alone = expand_features(means.to_numpy()[1:, 0], patches)
    np.testing.assert_array_equal(alone, expanded[0].to_numpy())


def test_domains_without_weight_have_the_plain_mean_and_absent_ones_none() -> None:
    means = aggregate_features([1.0, 3.0, 5.0, 9.0], [0, 0, 2, 2], [0.0, 0.0, 1.0, 3.0])
    np.testing.assert_array_equal(means[0], [np.nan, 2.0, np.nan, 8.0])


MESH = shapes.icosphere(1)


@pytest.mark.parametrize(
    ("call", "code", "word"),
    [
        (lambda: aggregate_features(np.ones(3), [0, 1]), "not-labels", "for each of 3 vertices"),
        (lambda: aggregate_features(np.ones(2), [0.0, 1.0]), "not-labels", "type float64"),
        (lambda: aggregate_features(np.ones(2), [0, -2]), "not-labels", "from -1 (none)"),
        (lambda: aggregate_features(np.ones(2), [0, 1], [1, -1]), "wrong-shape", "numbers from 0"),
        (lambda: expand_features([1.0, 2.0], [0, 5]), "no-column", "Domain 5"),
        (lambda: condense_mesh_to_graph(MESH, np.full(42, -1)), "no-labels", "all labels are -1"),
        (lambda: condense_mesh_to_graph(MESH, np.zeros(42, int), [1, 2]), "out-of-range", "x, y"),
    ],
)  # fmt: skip
def test_what_does_not_match_is_one_sentence(call: Any, code: str, word: str) -> None:
    with raises(code, word) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_the_graph_is_that_of_a_loop(sphere: Mesh, patches: np.ndarray) -> None:
    nodes, edges = condense_mesh_to_graph(sphere, patches, nuc_point=[0.0, 0.0, 5.0])
    lengths: dict[tuple[int, int], float] = {}
    mesh_edges: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for face in sphere.faces:
        corners = sphere.vertices[face]
        a, b, c = (np.linalg.norm(corners[i] - corners[i - 1]) for i in range(3))
        radius = 0.5 * np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        radius /= 0.5 * (a + b + c)
        for i in range(3):
            ends = sorted((int(patches[face[i]]), int(patches[face[i - 1]])))
            if ends[0] >= 0 and ends[0] != ends[1]:
                key = ends[0], ends[1]
                lengths[key] = lengths.get(key, 0.0) + radius
                side = sorted((int(face[i]), int(face[i - 1])))
                mesh_edges.setdefault(key, set()).add((side[0], side[1]))
    pairs = list(zip(edges["source"], edges["target"], strict=True))
    assert pairs == sorted(lengths)
    np.testing.assert_allclose(edges["boundary_length"], [lengths[each] for each in pairs])
    assert edges["count"].tolist() == [len(mesh_edges[each]) for each in pairs]
    for domain in range(5):
        own, areas = patches == domain, sphere.vertex_areas
        place = np.average(sphere.vertices[own], axis=0, weights=areas[own])
        np.testing.assert_allclose(nodes.loc[domain, ["x", "y", "z"]], place, atol=1e-12)
        assert nodes["area"][domain] == pytest.approx(areas[own].sum())
        assert nodes["n_vertices"][domain] == own.sum()
        away = np.linalg.norm(place - [0.0, 0.0, 5.0])
        assert nodes["distance_to_nucleus"][domain] == pytest.approx(away)


def test_sums_of_the_graph_are_those_of_the_mesh(found: CondensedHKS) -> None:
    nodes, edges = found.condensed_nodes, found.condensed_edges
    assert nodes["area"].sum() == pytest.approx(found.simple_mesh.area, rel=1e-12)
    assert nodes["n_vertices"].sum() == found.simple_mesh.n_vertices
    assert (nodes["component_area"] == nodes["component_area"][0]).all()
    # Domains in the opposite order give the same lengths.
    reversed_ = found.n_domains - 1 - found.simple_labels
    again = condense_mesh_to_graph(found.simple_mesh, reversed_)[1]
    back = {
        (found.n_domains - 1 - b, found.n_domains - 1 - a): length
        for a, b, length in again[["source", "target", "boundary_length"]].itertuples(index=False)
    }
    for source, target, length in edges[["source", "target", "boundary_length"]].itertuples(
        index=False
    ):
        assert back[source, target] == pytest.approx(length, rel=1e-12)


# Decimation -----------------------------------------------------------------------------------


def test_a_domain_in_two_components_has_that_of_its_lowest_vertex() -> None:
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    mesh = shapes.together(small, shapes.moved(large, 9.0))
    nodes, _ = condense_mesh_to_graph(mesh, np.zeros(mesh.n_vertices, dtype=int))
    assert nodes["component_n_vertices"].tolist() == [small.n_vertices]


def test_decimation_far_from_the_origin_is_as_exact() -> None:
    pytest.importorskip("fast_simplification")
    ball, away = shapes.icosphere(3), 4e6
    simple, mapping = decimated(Mesh(ball.vertices + away, ball.faces), 0.5)
    np.testing.assert_allclose(np.linalg.norm(simple.vertices - away, axis=1), 1.0, atol=0.1)
    np.testing.assert_allclose(simple.vertices[mapping], ball.vertices + away, rtol=0.0, atol=0.4)


def test_decimation_keeps_components_and_the_map_of_vertices(three_spheres: Mesh) -> None:
    simple, mapping = decimated(three_spheres, 0.5)
    assert simple.n_faces == pytest.approx(0.5 * three_spheres.n_faces, rel=0.02)
    assert simple.n_components == 3
    assert simple.referenced.all()
    np.testing.assert_array_equal(simple.component_labels[mapping], three_spheres.component_labels)
    apart = np.linalg.norm(simple.vertices[mapping] - three_spheres.vertices, axis=1)
    edges = edge_graph(three_spheres).data
    assert apart.max() < 5.0 * edges.max()
    same, identity = decimated(three_spheres, 0.0)
    np.testing.assert_array_equal(identity, np.arange(three_spheres.n_vertices))
    np.testing.assert_array_equal(same.faces, three_spheres.faces)


def test_vertices_that_lose_all_faces_are_mapped_along_the_edges() -> None:
    sheet = shapes.rectangle(5, 5)
    n = sheet.n_vertices
    far = np.array([[5.0, 5.0, 0.0], [5.001, 5.0, 0.0]])  # a needle, hinged at the middle vertex
    faces = np.concatenate([sheet.faces, [[12, n, n + 1]]])
    simple, mapping = decimated(Mesh(np.concatenate([sheet.vertices, far]), faces), 0.5)
    assert simple.n_faces < len(faces)
    assert (mapping[n:] == mapping[12]).all()
    np.testing.assert_array_equal(np.unique(mapping), np.arange(simple.n_vertices))


def test_small_components_and_vertices_without_faces_are_in_no_domain() -> None:
    ball, other = shapes.icosphere(3), shapes.icosphere(1)
    n = ball.n_vertices
    mesh = shapes.together(ball, np.zeros((1, 3)), shapes.moved(other, 5.0))
    mesh = shapes.moved(mesh, 0.0, scale=1000.0)
    found = condensed(mesh, n_jobs=1, max_eigenvalue=1e-4)
    assert (found.labels[n:] == -1).all()
    assert (found.mapping[n:] == -1).all()
    assert (found.labels[:n] >= 0).all()
    np.testing.assert_array_equal(found.labels[:n], found.simple_labels[found.mapping[:n]])


# The pipeline ---------------------------------------------------------------------------------


def test_the_result_has_the_fields_of_meshmash_and_two_more(found: CondensedHKS) -> None:
    assert found._fields == (
        "simple_mesh", "mapping", "stitcher", "simple_labels", "labels", "condensed_features",
        "condensed_nodes", "condensed_edges", "timing_info", "truncation", "seams",
    )  # fmt: skip
    simple_mesh, mapping, stitcher, simple_labels, labels, *_ = found
    assert len(stitcher) > 2
    np.testing.assert_array_equal(labels, simple_labels[mapping])
    assert set(np.unique(labels)) == set(range(found.n_domains))
    # Domains are numbered by their lowest vertex.
    first = np.unique(simple_labels, return_index=True)[1]
    assert (np.diff(first) > 0).all()
    for domain in range(found.n_domains):
        faces = simple_mesh.faces[(simple_labels[simple_mesh.faces] == domain).sum(axis=1) > 1]
        assert len(faces) or (simple_labels == domain).sum() == 1
    assert list(found.condensed_features)[:7] == [*(f"hks_{at}" for at in range(6)), "area"]
    assert sum(found.timing_info.values()) == pytest.approx(2 * found.timing_info["total"], rel=0.1)


def test_bit_identical_for_any_number_of_processes(sample: Mesh, found: CondensedHKS) -> None:
    assert as_bytes(condensed(sample, n_jobs=2)) == as_bytes(found)


def test_cuts_leave_the_domains_as_they_are_elsewhere(found: CondensedHKS) -> None:
    from sklearn.metrics import adjusted_rand_score

    mesh, pieces = found.simple_mesh, found.stitcher.submesh_mapping
    values = np.log(np.asarray(expand_features(
        np.exp(found.condensed_features[["hks_0", "hks_5"]]), found.simple_labels
    ))) + mesh.vertices[:, :2] / 30_000.0  # fmt: skip
    graph = edge_graph(mesh)
    whole = ward_domains(values, graph, np.zeros(len(pieces), dtype=np.int64), 1.5)
    cut = ward_domains(values, graph, pieces, 1.5)
    assert cut.max() == pytest.approx(whole.max(), rel=0.05)
    assert adjusted_rand_score(whole, cut) > 0.9


@pytest.mark.slow
def test_the_columns_say_what_is_missing(sample: Mesh) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = mv.condensed_hks_pipeline(sample, **{**QUICK, "n_jobs": 1})
    assert "5 of 6 columns miss more than 1 %" in str(caught[0].message)
    times = np.geomspace(QUICK["t_min"], QUICK["t_max"], QUICK["n_components"])
    weyl = np.exp(-QUICK["max_eigenvalue"] * times)
    assert found.truncation.columns == tuple(f"hks_{at}" for at in range(6))
    assert found.truncation.flagged.tolist() == np.flatnonzero(weyl > 0.02).tolist()
    assert found.remarks[0].startswith(f"{found.truncation.sentence()}: give a larger max_eig")
    # Cuts change only columns that are flagged.
    assert set(np.flatnonzero(found.seams > 0.01)) <= set(found.truncation.flagged.tolist())
    # shares at the default options, stated in the documentation
    shares = np.exp(-1e-5 * np.geomspace(5e4, 2e7, 32))
    assert (int((shares > 0.01).sum()), round(shares[0], 2)) == (12, 0.61)


@pytest.mark.parametrize(
    ("arguments", "code", "fault"),
    [
        ({"simplify_target_reduction": 1.0}, "out-of-range", "share of faces to remove is 1"),
        ({"min_vertex_threshold": 10**6}, "no-faces", "fewer than 1,000,000 vertices"),
        ({"distance_threshold": 0.0}, "out-of-range", "distance_threshold is 0.0"),
        ({"t_max": None}, "missing-argument", "give both"),
        ({"max_eigenvalue": -1.0}, "out-of-range", "max_eigenvalue is -1.0"),
        ({"compute_hks_kwargs": {"speed": 2}}, "unknown-name", "has speed"),
        ({"nuc_point": [0.0, 1.0]}, "out-of-range", "give x, y and z"),
    ],
)
def test_bad_arguments_are_one_sentence(arguments: dict[str, Any], code: str, fault: str) -> None:
    ball = Mesh(shapes.icosphere(2).vertices * 1000.0, shapes.icosphere(2).faces)
    given = {"min_vertex_threshold": 10, "max_eigenvalue": 1e-5, **arguments}
    with raises(code, fault) as caught:
        condensed(ball, n_jobs=1, **given)
    assert "\n" not in str(caught.value)
