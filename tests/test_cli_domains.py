"""The command `condense`, and classes of domains."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapes
from commands import refused
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.pieces import (
    aggregate_features,
    read_condensed_features,
    read_condensed_graph,
    write_condensed_features,
)

pytestmark = pytest.mark.usefixtures("read_here")

pytest.importorskip("fast_simplification")
QUICK = (
    *(
        "--t-min",
        "0.1 µm²",
        "--t-max",
        "1 µm²",
        "--max-eigenvalue",
        "30 µm⁻²",
        "--n-components",
        "5",
    ),
    *("--reduction", "40%", "--distance-threshold", "1.5", "--jobs", "1"),
)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a mesh in two units, and a mesh of small components alone."""
    monkeypatch.setattr("meshmash_viewer.io.cache.default_cache_folder", lambda: tmp_path / "cache")
    monkeypatch.chdir(tmp_path)
    mesh = shapes.blob(3)
    write_mesh("A.ply", mv.Mesh(1000.0 * mesh.vertices, mesh.faces, "nm", "A"))
    write_mesh("B.ply", mv.Mesh(mesh.vertices, mesh.faces, "µm", "B"))
    small = shapes.icosphere(1)
    write_mesh("C.ply", mv.Mesh(small.vertices, small.faces, "µm", "C"))
    return tmp_path


def test_several_meshes_are_condensed_and_one_fault_ends_nothing(
    capsys: pytest.CaptureFixture[str], here: Path
) -> None:
    status = main(["condense", "*.ply", "-o", "features/", "--graphs", "graphs/", *QUICK])
    said = capsys.readouterr()
    assert status == 2
    assert "C.ply: All components have fewer than 200 vertices" in said.err
    assert "give a smaller threshold (--min-vertices, " in said.err
    assert {each.name for each in (here / "features").iterdir()} == {
        "A.npz", "B.npz", "header.txt",
    }  # fmt: skip
    assert {each.name for each in (here / "graphs").iterdir()} == {
        "A.npz", "B.npz", "nodes_header.txt", "edges_header.txt",
    }  # fmt: skip
    mesh = mv.read_mesh("A.ply")
    features, labels = read_condensed_features("features/A.npz")
    nodes, _ = read_condensed_graph("graphs/A.npz")
    assert len(labels) == mesh.n_vertices
    assert len(features) - 1 == len(nodes) == labels.max() + 1 > 3
    assert nodes["area"].sum() == pytest.approx(mesh.area, rel=0.05)  # after decimation, in nm²
    assert read_condensed_graph("graphs/B.npz")[0]["area"].sum() == pytest.approx(
        nodes["area"].sum(), rel=0.01
    )
    assert f"features/A.npz: {len(nodes)} domains of " in said.out


def test_it_is_the_same_again_and_says_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    few = ("--max-eigenvalue", "3 µm⁻²", "--json", "--nucleus", "0", "0", "0")
    for name in ("one.npz", "two.npz"):
        assert main(["condense", "A.ply", "-o", name, *QUICK, *few]) == 0
    said = capsys.readouterr()
    report = json.loads(said.out.splitlines()[0])
    assert report["truncation"]["flagged"] == ["hks_0", "hks_1", "hks_2", "hks_3", "hks_4"]
    assert "5 of 5 columns miss more than 1 %" in said.err.replace("\xa0", " ")
    assert "give a larger max_eigenvalue (--max-eigenvalue)." in said.err
    assert Path("one.npz").read_bytes() == Path("two.npz").read_bytes()
    assert Path("header.txt").read_text().endswith("\tdistance_to_nucleus")


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (
            ("A.ply", "-o", "a.csv"),
            "a.csv has no ending in which it can be written: end it in .npz.",
        ),
        (("A.ply", "-o", "a.npz", "--graphs", "a.npz"), "would be both features and graph"),
        (("A.ply", "-o", "a.npz", "--reduction", "1"), "give one from 0 to below 1"),
        (("A.ply", "-o", "a.npz", "--distance-threshold", "0"), "give a positive one"),
    ],
)
def test_what_does_not_do_is_one_line(
    arguments: tuple[str, ...], fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, fault, "condense", *arguments)


@pytest.mark.slow
def test_classes_of_domains_are_those_of_their_means(here: Path) -> None:
    mesh = mv.read_mesh("A.ply")
    parts = np.where(mesh.vertices[:, 0] > 500.0, 1, 2)
    known = mv.VertexMap(
        "part", parts, labels=(mv.Label(1, "bump", "#4477aa"), mv.Label(2, "rest", "#ee6677"))
    )
    columns = mv.ClassColumns(3e4, 1e6, 2e-5, "nm", n_times=8)
    model = mv.train_classes(mesh, known, columns, scored=False)
    features = columns.compute(mesh)
    domains = np.digitize(mesh.vertices[:, 0], np.linspace(-800, 800, 9))
    domains[mesh.vertices[:, 0] < -900] = -1
    found = mv.predict_classes(mesh, model, features=features, domains=domains)
    chance = found.probabilities[0].values
    for domain in np.unique(domains[domains >= 0]):
        own = domains == domain
        mean = np.average(features.values[own], axis=0, weights=mesh.vertex_areas[own])
        expected = model.classifier.predict_proba(mean[None].astype(np.float32))[0, 0]
        np.testing.assert_allclose(chance[own], expected)
    assert np.isnan(chance[domains < 0]).all()
    assert (found.labels.values[domains < 0] == 0).all()
    # Columns are found by name, in any order.
    order = [*range(7, -1, -1)]
    other = Features(features.values[:, order], tuple(columns.names[at] for at in order))
    again = mv.predict_classes(mesh, model, features=other, domains=domains)
    np.testing.assert_array_equal(again.labels.values, found.labels.values)
    with raises("no-column", "'log_hks"):
        mv.predict_classes(mesh, model, features=Features(features.values, tuple("abcdefgh")))
    # the same on the command line
    mv.write_classes("model.skops", model)
    Path("domains").mkdir()
    table = aggregate_features(features, domains)
    write_condensed_features("domains/A.npz", table, domains)
    assert main(["predict", "A.ply", "--model", "model.skops", "--domains", "domains/", "-o",
                 "out.npz"]) == 0  # fmt: skip
    written = mv.read_maps("out.npz", mesh)[0]
    same = domains >= 0
    np.testing.assert_array_equal(written.values[same], found.labels.values[same])
