"""Files of domains: round trips, and files written by hand as documented."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import pytest
import shapes
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.io.condensed import labelled_domains
from meshmash_viewer.pieces import (
    condense_mesh_to_graph,
    expand_features,
    read_condensed_features,
    read_condensed_graph,
    read_id_map,
    write_condensed_features,
    write_condensed_graph,
    write_id_map,
)
from meshmash_viewer.surface.edges import region_graph
from meshmash_viewer.vertex_map import MOST_LABELS

BALL = shapes.icosphere(2)
#: Four domains; vertices outside all domains have the label -1.
LABELS = np.digitize(BALL.vertices[:, 2], [-0.5, 0.0, 0.5]).astype(np.int32)
LABELS[BALL.vertices[:, 0] > 0.9] = -1
NAMES = ["hks_0", "hks_1", "area"]

pytestmark = pytest.mark.usefixtures("read_here")


def table(k: int = 4) -> pandas.DataFrame:
    values = np.arange(3.0 * k).reshape(k, 3)
    return pandas.DataFrame(values, columns=NAMES)


def by_hand(path: Path, header: str = "\t".join(NAMES), **arrays: np.ndarray) -> Path:
    """Write a feature file without the package's writer."""
    rows = np.concatenate([np.full((1, 3), np.nan), table()]).astype(np.float32)
    np.savez_compressed(path, **{"X": rows, "labels": LABELS, **arrays})
    (path.parent / "header.txt").write_text(header)
    return path


def test_features_are_written_as_described_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "one.npz"
    write_condensed_features(path, table(), LABELS)
    with np.load(path) as held:
        assert set(held.files) == {"X", "labels"}
        assert (held["X"].dtype, held["X"].shape) == (np.float32, (5, 3))
        assert held["labels"].dtype == np.int32
        assert np.isnan(held["X"][0]).all()
        np.testing.assert_array_equal(held["X"][1:], table())
    assert (tmp_path / "header.txt").read_text() == "hks_0\thks_1\tarea"
    features, labels = read_condensed_features(path)
    np.testing.assert_array_equal(labels, LABELS)
    assert features.index.tolist() == [-1, 0, 1, 2, 3]
    assert list(features) == NAMES
    again = tmp_path / "two.npz"
    write_condensed_features(again, features, labels)
    assert again.read_bytes() == path.read_bytes()
    assert {each.name for each in tmp_path.iterdir()} == {"one.npz", "two.npz", "header.txt"}


def test_features_by_hand_are_read(tmp_path: Path) -> None:
    features, labels = read_condensed_features(
        by_hand(tmp_path / "hand.npz", "\t".join(NAMES) + "\n")
    )
    assert list(features) == NAMES
    assert features.loc[2, "hks_1"] == 7.0
    expanded = expand_features(features, labels)
    assert expanded["area"][0] == 3 * LABELS[0] + 2


def test_the_graph_is_written_and_read_again(tmp_path: Path) -> None:
    nodes, edges = condense_mesh_to_graph(BALL, LABELS, nuc_point=[0, 0, 3])
    path = tmp_path / "graph.npz"
    write_condensed_graph(path, nodes, edges)
    header = (tmp_path / "nodes_header.txt").read_text().split("\t")
    assert header == [
        "x", "y", "z", "area", "n_vertices", "component_area", "component_n_vertices",
        "distance_to_nucleus",
    ]  # fmt: skip
    assert (tmp_path / "edges_header.txt").read_text() == (
        "source\ttarget\tboundary_length\tcount\tedge_length"
    )
    with np.load(path) as held:
        assert {name: held[name].dtype for name in held.files} == {
            "nodes": np.float32, "edges": np.float32,
        }  # fmt: skip
    found_nodes, found_edges = read_condensed_graph(path)
    np.testing.assert_array_equal(found_nodes, nodes.astype(np.float32))
    np.testing.assert_allclose(found_edges, edges, rtol=1e-6)
    assert found_edges["source"].tolist() == edges["source"].tolist()
    # without header files, the columns get their default names
    for name in ("nodes_header.txt", "edges_header.txt"):
        (tmp_path / name).unlink()
    assert list(read_condensed_graph(path)[0]) == header


def test_objects_at_vertices_are_written_and_read_again(tmp_path: Path) -> None:
    path = tmp_path / "ids.npz"
    ids = np.array([720575940612345678, 5], dtype=np.uint64)
    write_id_map(path, ids, [3, -1])
    with np.load(path) as held:
        assert held["id_to_mesh_map"].tolist() == [[720575940612345678, 3], [5, -1]]
    found, vertices = read_id_map(path)
    assert (found.tolist(), vertices.tolist()) == (ids.tolist(), [3, -1])


def graph(path: Path, nodes: np.ndarray, edges: np.ndarray) -> Path:
    np.savez(path, nodes=nodes, edges=edges)
    return path


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "absent": (read_condensed_features, "file-not-found"),
    "text": (lambda path: (path.write_text("X"), read_condensed_features(path)), "wrong-format"),
    "other arrays": (
        lambda path: (np.savez(path, a=1), read_condensed_features(path)),
        "missing-data",
    ),
    "no header": (
        lambda path: (
            by_hand(path), path.with_name("header.txt").unlink(), read_condensed_features(path)
        ),
        "file-not-found",
    ),
    "short header": (
        lambda path: read_condensed_features(by_hand(path, "a\tb")),
        "counts-differ",
    ),
    "labels": (
        lambda path: read_condensed_features(by_hand(path, labels=LABELS + 1)),
        "counts-differ",
    ),
    "flat": (lambda path: read_condensed_features(by_hand(path, X=np.ones(3))), "wrong-shape"),
    "other header": (
        lambda path: (
            path.with_name("header.txt").write_text("a\tb\tc"),
            write_condensed_features(path, table(), LABELS),
        ),
        "other-columns",
    ),
    "few rows": (
        lambda path: write_condensed_features(path, table(3), LABELS),
        "counts-differ",
    ),
    "index": (
        lambda path: write_condensed_features(path, table()[::-1], LABELS),
        "not-sorted",
    ),
    "ending": (
        lambda path: write_condensed_features(path.with_suffix(".csv"), table(), LABELS),
        "unknown-ending",
    ),
    "folder": (
        lambda path: write_id_map(path.parent / "none" / "a.npz", [1], [2]),
        "folder-not-found",
    ),
    "edges": (
        lambda path: read_condensed_graph(graph(path, np.ones((2, 3)), np.array([[0, 2, 1]]))),
        "vertex-out-of-range",
    ),
    "dropped graph": (
        lambda path: mv.read_maps(graph(path, np.ones((2, 7)), np.ones((1, 5))), BALL),
        "no-values",
    ),
    "graph": (
        lambda path: read_condensed_graph(graph(path, np.ones(3), np.ones(2))), "wrong-shape"
    ),
    "ids": (lambda path: write_id_map(path, [1, 2], [3]), "wrong-shape"),
    "map of ids": (
        lambda path: (np.savez(path, id_to_mesh_map=np.ones(3)), read_id_map(path)),
        "wrong-shape",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_one_sentence(case: str, tmp_path: Path) -> None:
    act, code = BAD[case]
    with raises(code) as caught:
        act(tmp_path / "bad.npz")
    assert "\n" not in str(caught.value)
    assert not [each for each in tmp_path.iterdir() if each.name.startswith(".")]


def test_a_file_of_features_is_one_of_maps_and_of_a_label_set(tmp_path: Path) -> None:
    path = by_hand(tmp_path / "hand.npz")
    with warnings.catch_warnings(action="error"):
        *columns, domains = mv.read_maps(path, BALL)
    assert [each.name for each in columns] == NAMES
    inside = LABELS >= 0
    np.testing.assert_array_equal(columns[0].values[inside], 3.0 * LABELS[inside])
    assert np.isnan(columns[0].values[~inside]).all()
    np.testing.assert_array_equal(domains.values, LABELS + 1)
    assert [each.name for each in domains.labels] == [f"domain {i}" for i in range(4)]
    colors = {each.key: each.color for each in domains.labels}
    for first, second in BALL.faces[:, [0, 1]]:
        a, b = domains.values[first], domains.values[second]
        assert a == b or not a or not b or colors[a] != colors[b]


def test_regions_that_touch_are_connected_from_their_middles() -> None:
    strip = shapes.rectangle(31, 7)
    x = strip.vertices[:, 0] - strip.vertices[:, 0].min()
    values = np.array([5, 2, -1, 2])[np.minimum((4 * x / x.max()).astype(int), 3)]
    values[strip.vertices[:, 1] == strip.vertices[:, 1].min()] = 7
    found = region_graph(strip.vertices, strip.faces, values)
    regions = values[found]
    # both regions of value 2 touch the region of value 7; one of them touches the region of value 5
    assert sorted(map(tuple, np.sort(regions, axis=1).tolist())) == [(2, 5), (2, 7), (2, 7), (5, 7)]
    for vertex in np.unique(found[regions == 5]):
        own = strip.vertices[values == 5]
        apart = np.linalg.norm(own - own.mean(axis=0), axis=1)
        here = np.linalg.norm(strip.vertices[vertex] - own.mean(axis=0))
        assert here == apart.min()


def test_more_domains_than_labels_are_groups_that_do_not_touch() -> None:
    mesh = shapes.icosphere(4)
    numbers = np.arange(mesh.n_vertices) // 4
    assert numbers.max() >= MOST_LABELS
    domains = mv.VertexMap("domains", numbers.astype(float))
    (kept, groups), said = labelled_domains([domains], mesh)
    assert kept is domains
    assert len(groups.labels) <= 40
    assert "641 domains, and 512 labels" in said[0]
    a, b = mesh.faces[:, :2].T
    other = numbers[a] != numbers[b]
    assert (groups.values[a[other]] != groups.values[b[other]]).all()
