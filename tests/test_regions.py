"""Regions: areas and volumes in closed form, known radii of necks, submesh eigenvalues."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
import pytest
import shapes
import trimesh
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.io.pins import read_pins

pytestmark = pytest.mark.usefixtures("read_here")


def revolved(z: np.ndarray, radius: np.ndarray, around: int = 48) -> trimesh.Trimesh:
    """Return a closed surface of revolution about the x axis."""
    path = np.stack([z, np.zeros_like(z), np.zeros_like(z)], axis=1)
    vertices, faces = shapes.tube(path, np.repeat(radius[:, None], around, axis=1), around)
    return trimesh.Trimesh(vertices, faces, process=False)


def turned(mesh: trimesh.Trimesh, seed: int = 1) -> trimesh.Trimesh:
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    rotation[:, 0] *= np.sign(np.linalg.det(rotation))
    return trimesh.Trimesh(mesh.vertices @ rotation.T + 50.0, mesh.faces, process=False)


def dumbbell(rings: int = 161, around: int = 48) -> trimesh.Trimesh:
    """Return two bulbs, joined at x = 0 by a neck of radius 0.2."""
    x = np.linspace(-2.0, 2.0, rings)
    radius = (0.2 + 0.8 * np.sin(np.pi * x / 4.0) ** 2) * np.sqrt(1.0 - (np.abs(x) / 2.05) ** 6)
    return revolved(x, radius, around)


SPHERE = trimesh.creation.icosphere(5)
TORUS = trimesh.creation.torus(2.0, 0.7, major_sections=96, minor_sections=48)
#: A cylinder of length 3 and radius 0.5 between hemispheres.
END = 0.5 * np.sin(np.linspace(0.02, np.pi / 2, 24))
CAPSULE = revolved(
    np.concatenate([-1.5 - np.sqrt(0.25 - END**2), np.linspace(-1.45, 1.45, 59),
                    1.5 + np.sqrt(0.25 - END[::-1] ** 2)]),
    np.concatenate([END, np.full(59, 0.5), END[::-1]]),
)  # fmt: skip


@pytest.mark.parametrize("height", [-0.6, 0.0, 0.3])
def test_areas_on_both_sides_of_a_plane(height: float) -> None:
    expected = {
        "sphere": (SPHERE, 2.0 * np.pi * np.array([1.0 - height, 1.0 + height])),
        "capsule": (CAPSULE, np.pi * np.array([2.0 - height, 2.0 + height])),
        # The plane x = 0 halves the torus.
        "torus": (TORUS, 2.0 * np.pi**2 * 0.7 * 2.0 * np.ones(2)),
    }
    for name, (mesh, areas) in expected.items():
        level = 0.0 if name == "torus" else height
        table = mv.regions(mesh, np.where(mesh.vertices[:, 0] > level, 1, 2), neck=False)
        np.testing.assert_allclose(table["area"], areas, rtol=0.02, err_msg=name)
        assert table["area"].sum() == pytest.approx(mesh.area, rel=1e-12)
        # Regions closed by fans fill the solid except near the faces between both regions.
        bound = areas.max() * 2.0 * np.linalg.norm(np.ptp(mesh.triangles, axis=1), axis=1).max()
        assert mesh.volume - bound < table["volume"].sum() <= mesh.volume


def test_volumes_of_closed_parts() -> None:
    moved = [turned(mesh, seed) for seed, mesh in enumerate((TORUS, CAPSULE, SPHERE, dumbbell()))]
    for at, mesh in enumerate(moved):
        mesh.apply_translation([1e4 * at, 0.0, 0.0])
    whole = trimesh.util.concatenate(moved)
    labels = np.repeat([1, 2, 1, 3], [len(mesh.vertices) for mesh in moved])
    table = mv.regions(whole, labels)
    assert table["label"].tolist() == ["1", "1", "2", "3"]
    assert table["part"].tolist() == [1, 2, 1, 1]  # largest part first
    order = [0, 2, 1, 3]
    expected = [
        turned(each, seed) for seed, each in enumerate((TORUS, CAPSULE, SPHERE, dumbbell()))
    ]
    np.testing.assert_allclose(table["volume"], [expected[i].volume for i in order], rtol=1e-9)
    np.testing.assert_allclose(table["area"], [expected[i].area for i in order], rtol=1e-9)
    assert table["loops"].tolist() == [0] * 4
    assert np.isnan(table["neck_width"]).all()  # no neck to other vertices
    assert table["extent"][2] == pytest.approx(4.0, rel=1e-3)  # of the rotated capsule
    inward = mv.regions((SPHERE.vertices, SPHERE.faces[:, ::-1]), np.ones(len(SPHERE.vertices)))
    assert inward["volume"][0] == pytest.approx(-SPHERE.volume, rel=1e-9)


def test_fans_close_a_cut_exactly_where_it_is_flat() -> None:
    """The part of a cylinder between two rings is a prism."""
    capsule = turned(CAPSULE)
    table = mv.regions(capsule, np.abs(CAPSULE.vertices[:, 0]) < 1.01)
    polygon = 0.5 * 48 * 0.25 * np.sin(2.0 * np.pi / 48)
    assert table["loops"].tolist() == [2]
    assert table["volume"][0] == pytest.approx(polygon * 2.0, rel=1e-9)
    centre = capsule.vertices.mean(axis=0)
    np.testing.assert_allclose([table[axis][0] for axis in "xyz"], centre, atol=1e-9)


@pytest.mark.parametrize("cut", [-0.4, -0.1, 0.0])
@pytest.mark.parametrize(("rings", "around"), [(81, 24), (161, 48)])
def test_the_neck_of_a_dumbbell(cut: float, rings: int, around: int) -> None:
    shape = dumbbell(rings, around)
    for side in (1.0, -1.0):  # vertices are numbered along x
        table = mv.regions(turned(shape), side * shape.vertices[:, 0] > cut - 1e-9)
        assert table["neck_width"][0] == pytest.approx(2.0 * np.pi * 0.2, rel=0.03)


def test_several_necks_and_both_sides() -> None:
    """Two bulbs with a separate label for the neck between them, in nm and without a unit."""
    shape = dumbbell()
    x = shape.vertices[:, 0]
    labels = np.select([x > 0.3, x < -0.3], [1, 1], 2)
    table = mv.regions(mv.Mesh(shape.vertices * 8192.0, shape.faces, "nm"), labels)
    assert table["part"].tolist() == [1, 2, 1]
    assert table["loops"].tolist() == [1, 1, 2]
    radius = 0.2 + 0.8 * np.sin(np.pi * 0.3 / 4.0) ** 2
    # A bulb ends at the border of its label; the neck joins a bulb at each end.
    np.testing.assert_allclose(table["neck_width"][:2], 16384.0 * np.pi * radius, rtol=0.05)
    assert 1.9 < table["neck_width"][2] / (16384.0 * np.pi * 0.2) < 2.4
    plain = mv.regions(shape, labels)
    for name in ("area", "volume", "extent", "neck_width"):
        power = {"area": 2, "volume": 3}.get(name, 1)
        np.testing.assert_allclose(table[name], plain[name] * 8192.0**power, rtol=1e-9)
    assert [table.unit_of(name) for name in ("area", "volume")] == ["nm²", "nm³"]


def test_vertices_in_no_region_are_counted() -> None:
    """Faces that share a vertex are one region; vertices in no whole face belong to no region."""
    ball = shapes.icosphere(2)
    around = ball.faces[(ball.faces == 0).any(axis=1)]
    labels = np.zeros(ball.n_vertices, dtype=int)
    labels[around[:2].ravel()] = 1  # two faces with common vertex 0
    far = np.argsort(np.linalg.norm(ball.vertices + ball.vertices[0], axis=1))
    labels[far[0]] = 1
    named = mv.VertexMap("spots", labels, (mv.Label(1, "spot", "#4477aa"),))
    table = mv.regions(ball, named, neck=False)
    assert table["label"].tolist() == ["spot"]
    assert table.rows[far[0]] == -1
    assert table.rows[0] == 0
    without, alone = table.remarks
    assert without == f"{(labels == 0).sum()} vertices without a label."
    assert alone.startswith("1 vertex of spot in no region: no face around has three corners")


def test_whole_labels_have_one_row_each() -> None:
    """`whole` gives one row for two caps of a ball, and one for the ring between them."""
    ball = shapes.icosphere(3)
    z = ball.vertices[:, 2]
    values = np.where(np.abs(z) > 0.5, 4, 7)
    values[np.argmin(np.abs(z))] = 0
    height = mv.VertexMap("height", z)
    table = mv.regions(ball, values, [height], whole=True)
    assert table["label"].tolist() == ["4", "7"]
    areas = ball.vertex_areas
    for row, number in enumerate((4, 7)):
        mask = values == number
        np.testing.assert_array_equal(table.mask(row), mask)
        assert table["vertices"][row] == mask.sum()
        assert table["area"][row] == pytest.approx(areas[mask].sum(), rel=1e-12)
        assert table["mean height"][row] == pytest.approx(
            np.average(z[mask], weights=areas[mask]), abs=1e-12
        )
    parts = mv.regions(ball, values, neck=False)
    assert parts["label"].tolist() == ["4", "4", "7"]
    assert table["volume"][0] == pytest.approx(parts["volume"][:2].sum(), rel=1e-9)
    assert "neck_width" not in table.columns
    assert table.remarks == ("1 vertex without a label.",)


def test_maps_are_averaged_over_the_area() -> None:
    ball = shapes.icosphere(4)
    height = mv.VertexMap("height", ball.vertices[:, 2].copy(), unit="mV")
    gaps = height.values.copy()
    gaps[ball.vertices[:, 2] > 0.9] = np.nan
    north = ball.vertices[:, 2] > 0.0
    table = mv.regions(ball, north, [height, mv.VertexMap("gaps", gaps)], neck=False)
    assert table["mean height"][0] == pytest.approx(0.5, abs=0.02)
    assert table["max height"][0] == ball.vertices[:, 2].max()
    assert table["min height"][0] == ball.vertices[north, 2].min()
    assert table.unit_of("mean height") == "mV"
    assert table["max gaps"][0] == np.nanmax(gaps)
    assert table["mean gaps"][0] == pytest.approx(0.45, abs=0.02)


def test_faces_that_disagree_have_no_volume() -> None:
    box = trimesh.creation.box()
    faces = box.faces.copy()
    faces[0] = faces[0][::-1]
    table = mv.regions((box.vertices, faces), np.ones(8))
    assert np.isnan(table["volume"]).all()
    assert table["area"][0] == pytest.approx(6.0)
    assert "orient_faces" in table.remarks[0]


def test_bad_labels_get_one_sentence() -> None:
    ball = shapes.icosphere(2)
    cases = [
        (np.ones(5), "other-mesh", "'labels' has 5 values and the mesh 162 vertices"),
        (np.full(162, 0.5), "not-labels", "'labels' has values that are no whole numbers"),
        (np.zeros(162), "no-labels", "'labels' has no vertex with a label"),
        (np.array([b"a"] * 162), "not-labels", "give one whole number or name per vertex"),
        (np.arange(162), "no-labels", "no face whose three corners have the same label"),
    ]
    for labels, code, word in cases:
        with raises(code, word):
            mv.regions(ball, labels)
    with raises("unknown-name", "There is no column 'size'"):
        mv.regions(ball, np.ones(162))["size"]


def test_the_command_writes_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shape = dumbbell(41, 16)
    shape.export("dumbbell.ply")
    np.save("side.npy", np.where(shape.vertices[:, 0] > 0.01, 2, 1))
    np.save("height.npy", shape.vertices[:, 1])
    np.savez("several.npz", one=np.ones(len(shape.vertices)), two=np.ones(len(shape.vertices)))
    given = ["regions", "dumbbell.ply", "--unit", "µm", "--labels"]
    assert main([*given, "side.npy", "--map", "height.npy", "-o", "out.csv"]) == 0
    assert capsys.readouterr().out == "out.csv: 2 regions of 2 labels, means weighted by area\n"
    with open("out.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    table = mv.regions(shape, np.load("side.npy"))
    assert [row["label"] for row in rows] == ["1", "2"]
    assert rows[0]["unit"] == "µm"
    for name in ("area", "volume", "neck_width", "x"):
        np.testing.assert_allclose([float(row[name]) for row in rows], table[name], rtol=1e-4)
    assert {"mean height.npy", "min height.npy"} <= rows[0].keys()
    about = json.loads(Path("out.csv.json").read_text(encoding="utf-8"))
    assert about["options"]["units"]["volume"] == "µm³"
    assert read_pins("out.csv").names == ["1", "2"]  # positions that the window can pin

    assert main([*given, "several.npz:two", "-o", "out.parquet", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["n_regions"] == 1
    read = pyarrow.parquet.read_table("out.parquet")
    assert read["label"].to_pylist() == ["1"]
    assert b"meshmash-viewer" in read.schema.metadata
    for labels, message in (
        ("several.npz", "several.npz has 2 maps: name one after a colon, of one, two."),
        ("several.npz:three", "several.npz has 2 maps: name one"),
        ("height.npy", "no whole numbers"),
    ):
        assert main([*given, labels, "-o", "out.csv"]) == 2
        assert message in capsys.readouterr().err
    assert main([*given, "side.npy", "-o", "out.xyz"]) == 2
    assert ".csv, .parquet, .npz" in capsys.readouterr().err


def test_an_option_that_is_gone_names_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["regions", "ball.ply", "--labels", "a.npy", "--lambda2", "-o", "out.csv"])
    said = capsys.readouterr().err
    assert "--lambda2 is no longer an option: leave it out, and solve a label by" in said
    assert said.count("\n") == 1


#: A sphere whose first vertex is repeated but not used, and has no label.
BALL = mv.Mesh(*(lambda v, f: (np.vstack([v[:1], v]), f + 1))(*shapes.icosphere(2)))
NORTH = BALL.vertices[:, 2] > 0
#: Names, and identifiers that float64 does not distinguish.
NAMES = pandas.Series(np.where(NORTH, "north", "south")).mask(np.arange(len(NORTH)) == 0)
IDS = pandas.Series(np.where(NORTH, 720575940612345678, 720575940612345679))


@pytest.mark.parametrize(
    "labels",
    [
        NAMES.fillna("").to_numpy().astype(str),
        NAMES.tolist(),
        NAMES.astype(object).mask(NAMES.isna(), None),
        pandas.Categorical(NAMES),
        pyarrow.array(NAMES).dictionary_encode(),
        IDS.astype("Int64").mask(NAMES.isna()),
        pandas.Categorical(IDS.astype(object).mask(NAMES.isna(), None)),
        pyarrow.array([None, *IDS[1:]]),
        [None, *IDS[1:]],
    ],
)
def test_labels_are_names_or_exact_numbers_in_any_array(labels: Any) -> None:
    table = mv.regions(BALL, labels, whole=True)
    assert table["label"].tolist() in (["north", "south"], sorted(set(IDS.astype(str))))
    assert table["vertices"].tolist() == [NORTH[1:].sum(), (~NORTH[1:]).sum()]
    points = mv.project_points(BALL, BALL.vertices[1:])
    found = points.per_label(labels)
    assert [str(each) for each in found["label"]] == table["label"].tolist()
    assert found["points"].tolist() == [NORTH[1:].sum(), (~NORTH[1:]).sum()]


@pytest.mark.parametrize("labels", [None, {0: 1}, "north", [[1]], [1.5] * len(NORTH), [b"a"], [()]])
def test_what_is_neither_a_number_nor_a_name_is_refused(labels: Any) -> None:
    with raises("not-labels", "whole number"):
        mv.regions(BALL, labels)


@pytest.mark.parametrize(
    "values",
    [
        IDS,
        -IDS,
        IDS.astype("uint64") + 2**63,
        IDS.astype("Int64").mask(NAMES.isna()),
        [None, *IDS[1:]],
        pyarrow.array(IDS),
    ],
)
def test_a_map_does_not_round_identifiers(values: Any) -> None:
    with raises("not-exact"):
        mv.VertexMap("root_id", values)
