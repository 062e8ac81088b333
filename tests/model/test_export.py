"""Files of features or eigenpairs, from stored eigenpairs."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapes
from faults import raises
from listeners import Listener

from meshmash_viewer.features.distances import distance_features
from meshmash_viewer.features.filter_responses import hks_times
from meshmash_viewer.features.filters import bspline_bank, heat_kernel_bank, wave_kernel_bank
from meshmash_viewer.features.sums import accumulate_features
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.io.pins import read_pins
from meshmash_viewer.io.writers import WRITERS
from meshmash_viewer.laplacian import OperatorOptions, cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.export import Export, PinExport
from meshmash_viewer.model.pieces import Pieces
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.progress import Cancelled
from meshmash_viewer.spectral.eigensolver import solve
from meshmash_viewer.spectral.weyl import Target
from meshmash_viewer.units import format_quantity
from meshmash_viewer.vertex_map import Label, VertexMap

OPERATOR = OperatorOptions()


@pytest.fixture
def listener(tmp_path: Path) -> Listener:
    return Listener(tmp_path)


def exported(
    mesh: Mesh,
    kind: str,
    n_pairs: int,
    listener: Listener,
    asked: Target | None = None,
    **parameters: Any,
) -> dict[str, np.ndarray]:
    path, family = listener.folder / "out.npz", EXPORTS[kind].exported(**parameters)
    Export(mesh, OPERATOR, path, family, n_pairs, asked)(listener)
    with np.load(path) as content:
        return dict(content)


def test_as_many_pairs_as_asked_for_and_never_fewer(sphere: Mesh, listener: Listener) -> None:
    asked = Target("count", 20)
    grew = decompose(sphere, OPERATOR, asked, listener).content
    for n_pairs in (20, 9):
        content = exported(sphere, "eigenpairs", n_pairs, listener, asked)
        about = json.loads(str(content["meta"]))["options"]
        assert about["target"] == {"kind": "count", "value": n_pairs}
        assert about["proof"].startswith(f"{n_pairs} pairs · complete")
        np.testing.assert_array_equal(content["eigenvalues"], grew.eigenvalues[:n_pairs])
        assert content["eigenvectors"].shape == (sphere.n_vertices, n_pairs)
    with raises("no-eigenpairs", "no longer in the cache"):
        exported(sphere, "eigenpairs", 21, listener, asked)
    with raises("no-eigenpairs", "no longer in the cache"):
        exported(Mesh(2.0 * sphere.vertices, sphere.faces), "eigenpairs", 5, listener, asked)


def test_pairs_of_a_cancelled_solve_make_features_too(tmp_path: Path) -> None:
    mesh = shapes.icosphere(4)
    with pytest.raises(Cancelled):
        decompose(mesh, OPERATOR, Target("count", 300), Listener(tmp_path, stop_at=50))
    asked = Target("count", 300)
    content = exported(mesh, "hks", 50, Listener(tmp_path), asked, n_columns=4)
    assert np.isfinite(content["features"]).all()


def test_features_are_the_sum_over_the_pairs_asked_for(sphere: Mesh, listener: Listener) -> None:
    asked = Target("count", 30)
    grew = decompose(sphere, OPERATOR, asked, listener).content
    values, rows = grew.eigenvalues[:25], np.asarray(grew.rows)[:25]
    cases: list[tuple[str, dict[str, Any], Any]] = [
        ("hks", {"n_columns": 5}, heat_kernel_bank(hks_times(values, n_scales=5))),
        (
            "hks",
            {"n_columns": 5, "t_min": 0.1, "t_max": 2.0},
            heat_kernel_bank(np.geomspace(0.1, 2.0, 5)),
        ),
        ("wks", {"n_columns": 7}, wave_kernel_bank(values, 7)),
        ("geometry-vectors", {"n_columns": 6}, bspline_bank(0.0, float(values[-1]), 6)),
        (
            "geometry-vectors",
            {"n_columns": 6, "low": 1.0, "high": 9.0, "automatic": False},
            bspline_bank(1.0, 9.0, 6),
        ),
    ]
    for kind, parameters, bank in cases:
        content = exported(sphere, kind, 25, listener, asked, **parameters)
        wanted = accumulate_features(rows, bank(values))
        np.testing.assert_allclose(
            content["features"], wanted, rtol=1e-5, atol=1e-7 * np.abs(wanted).max()
        )
        np.testing.assert_array_equal(content["eigenvalues"], values)
        assert tuple(content["columns"]) == bank.columns


def test_pins_have_the_values_of_the_features(sphere: Mesh, listener: Listener) -> None:
    asked = Target("count", 30)
    decompose(sphere, OPERATOR, asked, listener)
    mesh = sphere.with_maps(VertexMap("height", sphere.vertices[:, 2]))
    pins = Pin(7, 1, "soma"), Pin(300, 2, own_color="#123456")
    hks = EXPORTS["hks"].exported(n_columns=3)
    distances = EXPORTS["distance"].exported(vertices=(7, 300))
    path = listener.folder / "pins.csv"
    job = PinExport(mesh, OPERATOR, path, pins, (hks, distances), 25, target=asked)
    written = job(listener)
    assert written.remark.startswith("2 pins, 13 columns, written to")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["color"]) for row in rows] == [
        ("soma", "#E69F00"), ("", "#123456"),
    ]  # fmt: skip
    features = exported(sphere, "hks", 25, listener, asked, n_columns=3)
    far = distance_features(sphere, [7, 300])
    wanted = {
        **dict(zip(features["columns"].tolist(), features["features"].T, strict=True)),
        **dict(zip(far.columns, far.values.T, strict=True)),
        "height": sphere.vertices[:, 2], "x": sphere.vertices[:, 0],
    }  # fmt: skip
    for name, values in wanted.items():
        found = [float(row[name]) for row in rows]
        np.testing.assert_allclose(found, values[[7, 300]], rtol=1e-6, err_msg=name)
    assert read_pins(path).indices.tolist() == [7, 300]


def test_pairs_up_to_a_threshold_are_known_to_be_all_below_it(
    sphere: Mesh, listener: Listener
) -> None:
    asked = Target("max_eigenvalue", 19.0)
    grew = decompose(sphere, OPERATOR, asked, listener).content
    assert grew.eigenvalues[-1] < 13.0
    for n_pairs, known_to in ((16, 19.0), (9, float(grew.eigenvalues[8]))):
        times = {"n_columns": 2, "t_min": 0.1, "t_max": 0.2}
        content = exported(sphere, "hks", n_pairs, listener, asked, **times)
        said = json.loads(str(content["meta"]))["options"]["truncation"]["known_to"]
        assert said == pytest.approx(known_to, rel=1e-6)


@pytest.mark.usefixtures("read_here")
def test_maps_are_columns_beside_the_features(sphere: Mesh, tmp_path: Path) -> None:
    """Files of all formats contain the maps; the metadata contains units and labels."""
    height = np.where(np.arange(sphere.n_vertices) == 3, np.nan, sphere.vertices[:, 2])
    parts = np.where(sphere.vertices[:, 0] > 0.0, 7, 2)
    labels = (Label(2, "back", "#ff0000"), Label(7, "front", "#0000ff"))
    mesh = sphere.with_maps(VertexMap("height", height, unit="mm"), VertexMap("x", parts, labels))
    listener = Listener(tmp_path)
    decompose(mesh, OPERATOR, Target("count", 9), listener)
    for ending in WRITERS:
        path = tmp_path / f"out{ending}"
        family = EXPORTS["hks"].exported(n_columns=3)
        written = Export(mesh, OPERATOR, path, family, 9, maps=True)(listener)
        assert "5 columns" in written.remark
        found = read_maps(path, sphere)
        assert len(found) == 5, ending
        assert found[4].labels == labels, ending
        np.testing.assert_allclose(found[3].values, height, rtol=1e-6)
        np.testing.assert_array_equal(found[4].values, parts)
        if ending != ".npy":
            assert found[3].name == "height", ending
    with np.load(tmp_path / "out.npz") as content:
        about = json.loads(str(content["meta"]))["options"]["maps"]
    assert about["height"]["unit"] == "mm"
    assert about["x"]["labels"] == [[2, "back", "#ff0000"], [7, "front", "#0000ff"]]
    content = exported(mesh, "hks", 9, listener, n_columns=3)
    assert content["features"].shape[1] == 3


@pytest.mark.parametrize("measure", ["geodesic", "commute"])
def test_distances_are_written_by_their_pairs_or_without(
    sphere: Mesh, listener: Listener, measure: str
) -> None:
    """Geodesic distances need no stored eigenpairs."""
    chosen = {"vertices": [3, 8], "measure": measure}
    if measure == "geodesic":
        content = exported(sphere, "distance", 20, listener, **chosen)
        wanted = distance_features(sphere, [3, 8])
    else:
        with raises("no-eigenpairs", "no longer in the cache"):
            exported(sphere, "distance", 20, listener, **chosen)
        decompose(sphere, OPERATOR, Target("count", 20), listener)
        content = exported(sphere, "distance", 20, listener, **chosen)
        pairs = solve(*cotangent_laplacian(sphere), 20)
        wanted = distance_features(sphere, [3, 8], measure, pairs)
    assert content["columns"].tolist() == list(wanted.columns)
    np.testing.assert_allclose(content["features"], wanted.values, atol=1e-6)


@pytest.mark.slow
def test_the_map_of_features_in_pieces_is_the_chosen_column(tmp_path: Path) -> None:
    mesh = shapes.icosphere(4)
    sent: list[Any] = []
    channel = SimpleNamespace(
        folder=tmp_path, report=lambda _: None, cancelled=lambda: False, send=sent.append
    )
    family = EXPORTS["geometry-vectors"].exported(5, index=2)
    path = tmp_path / "out.npz"
    Pieces(mesh, path, family, 3, Target("count", 30), OPERATOR, accept_seams=True)(channel)
    with np.load(path) as written:
        middle = written["features"][:, 2]
    shown = np.full(mesh.n_vertices, np.nan)
    for grown in sent:
        shown[grown.vertices] = grown.values
    assert len(sent) > 1
    assert {each.name for each in sent} == {sent[0].name}
    np.testing.assert_allclose(shown, middle, rtol=1e-6)


@pytest.mark.slow
def test_pieces_show_the_chosen_time_and_warn_of_large_differences(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    times = np.geomspace(1e3, 1e7, 9)
    report = {
        "pieces": 2, "largest_piece": 90, "seam_vertices": 7, "remarks": [],
        "seam_median": [0.002] * 9, "seam_largest": [0.004] * 9,
    }  # fmt: skip

    def write(*_: Any, done: Any, **__: Any) -> dict[str, Any]:
        done(np.arange(2), np.broadcast_to(times, (2, 9)))
        return report

    monkeypatch.setattr(Pieces, "write", write)
    sent: list[Any] = []
    channel = SimpleNamespace(report=lambda _: None, cancelled=lambda: False, send=sent.append)
    mesh = shapes.icosphere(3, radius=500.0).in_unit("nm")
    family = HeatKernelSignature(automatic=False, t_min=1e3, t_max=1e7, scales=9, time=3.5e6)
    job = Pieces(mesh, tmp_path / "out.npz", family, 2, Target("count", 30), OPERATOR)
    assert not job(channel).warns
    assert sent[0].values == pytest.approx(times[7])
    assert sent[0].name == f"HKS, t = {format_quantity(times[7], 'nm', 2)}, in pieces"
    report["seam_largest"] = [0.004] * 8 + [0.48]
    assert job(channel).warns
