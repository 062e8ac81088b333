"""Points such as synapses: nearest vertices by brute force, exact sums, and bad input."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pytest
import shapes
from commands import refused
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.errors import InputError
from meshmash_viewer.features.points import Points
from meshmash_viewer.io.write import write_mesh

BALL = shapes.icosphere(3, radius=4000.0).in_unit("nm")
#: Far from the origin, as neurons in their volume are.
FAR = mv.Mesh(BALL.vertices + np.array([4e5, 8e5, 4e6]), BALL.faces, "nm", "far")
UP = BALL.vertices[:, 2] > 0.0


def synapses(n: int = 300, seed: int = 0) -> pandas.DataFrame:
    """Return points around a sphere, some far from it, with identifiers of more than 53 bits."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(n, 3))
    places *= rng.uniform(3000.0, 5500.0, n)[:, None] / np.linalg.norm(places, axis=1)[:, None]
    columns = dict(zip(("ctr_pt_x", "ctr_pt_y", "ctr_pt_z"), places.T, strict=True))
    return pandas.DataFrame(
        {
            "id": 720575940612345678 + np.arange(n),
            **columns,
            "size": rng.integers(1, 2000, n),
            "score": rng.uniform(-1.0, 1.0, n),
            "type": rng.choice(["excitatory", "inhibitory"], n),
            "pre_pt_root_id": 720575940600000000 + np.arange(n),
        }
    )


def test_nearest_vertices_are_those_of_brute_force() -> None:
    table = mv.read_points(synapses())
    found = mv.project_points(BALL, table, 700.0)
    all_of_them = np.linalg.norm(BALL.vertices[None] - table.positions[:, None], axis=2)
    nearest = all_of_them.min(axis=1)
    np.testing.assert_array_equal(found.near, nearest <= 700.0)
    assert 0 < found.n_near < len(found)
    np.testing.assert_allclose(found.distances[found.near], nearest[found.near], rtol=1e-12)
    np.testing.assert_array_equal(found.vertices, np.where(found.near, all_of_them.argmin(1), -1))
    assert np.isnan(found.distances[~found.near]).all()


def test_a_point_at_the_distance_is_near_and_a_stray_vertex_takes_none() -> None:
    corners = np.array([[-3.0, -4.0, 0.0], [0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]])
    faces = np.array([[1, 3, 2], [1, 2, 4], [2, 3, 4], [1, 4, 3]])
    found = mv.project_points(mv.Mesh(corners, faces), corners[:1], 5.0)
    assert (found.vertices.tolist(), found.distances.tolist()) == ([1], [5.0])


def test_sums_and_counts_of_regions_and_labels_are_exact() -> None:
    table = mv.read_points(synapses(2000))
    found = mv.project_points(BALL, table, 1000.0)
    assert table.summed == ("size", "score"), "identifiers and text have no sums"
    down = BALL.vertices[:, 2] < -2000.0
    names = (mv.Label(1, "up", "#4477aa"), mv.Label(2, "down", "#ee6677"))
    labels = mv.VertexMap("part", np.where(UP, 1, np.where(down, 2, 0)), names)
    measured = mv.regions(BALL, labels, neck=False)
    regions = measured.with_points(found)
    by_label = found.per_label(labels)
    assert by_label["label"].tolist() == ["up", "down"]
    for row in range(len(regions)):
        inside = found.near & (measured.rows[found.vertices] == row)
        assert regions["points"][row] == np.count_nonzero(inside)
        assert regions["sum size"][row] == sum(table.columns["size"][inside].tolist())
        assert regions["sum score"][row] == math.fsum(table.columns["score"][inside])
    for row, half in enumerate((UP, down)):
        inside = found.near & half[found.vertices]
        assert by_label["points"][row] == np.count_nonzero(inside)
        assert by_label["sum score"][row] == math.fsum(table.columns["score"][inside])
    left = found.n_near - regions["points"].sum()
    assert left > 0
    assert any(each.startswith(f"{left:,} points in no region") for each in regions.remarks)
    domains = np.arange(BALL.n_vertices) % 7 - 1  # -1 is a domain like others
    columns = found.per_label(domains)
    np.testing.assert_array_equal(
        columns["points"], np.bincount(domains[found.vertices[found.near]] + 1, minlength=7)
    )
    assert columns["label"].tolist() == list(range(-1, 6))
    with raises("other-mesh"):
        mv.regions(shapes.icosphere(2), np.ones(162), neck=False).with_points(found)


@pytest.mark.parametrize("ending", ["csv", "parquet", "feather"])
@pytest.mark.parametrize("how", ["three columns", "one column"])
def test_tables_keep_their_columns_and_types(tmp_path: Path, ending: str, how: str) -> None:
    table, path = synapses(20), tmp_path / f"synapses.{ending}"
    axes = ["ctr_pt_x", "ctr_pt_y", "ctr_pt_z"]
    places = table[axes].to_numpy().copy()
    table["size"] = table["size"].astype(pandas.Int64Dtype())
    table.loc[4, "size"] = pandas.NA
    table.loc[7, "ctr_pt_y"] = np.nan
    table["valid"] = np.arange(20) % 2 == 0
    if how == "one column":
        each = [None if at == 7 else place for at, place in enumerate(places)]
        table = table.drop(columns=axes).assign(ctr_pt_position=each)
    write = {"csv": table.to_csv, "parquet": table.to_parquet, "feather": table.to_feather}
    write[ending](path)
    found = mv.read_points(path, "nm")
    kept = np.arange(20) != 7
    digits = 0.01 if how == "one column" and ending == "csv" else 0.0
    np.testing.assert_allclose(found.positions, places[kept], rtol=1e-14, atol=digits)
    assert found.remarks == ("1 row without a position left out.",)
    assert found.id == "id"
    assert found.columns["id"].tolist() == table["id"][kept].tolist(), "all digits"
    assert found.columns["size"][4] is None
    assert found.columns["size"][5] == table["size"][5]
    assert found.columns["valid"].dtype == bool
    assert found.columns["type"].tolist() == table["type"][kept].tolist()
    assert (found.name, found.path, found.unit) == (path.name, str(path), "nm")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_identifiers_of_64_bits_keep_all_digits(tmp_path: Path, ending: str) -> None:
    table = synapses(5).assign(root=np.uint64(2**64 - 9), id=lambda each: each["id"].astype("u8"))
    path = tmp_path / f"synapses.{ending}"
    table.to_csv(path) if ending == "csv" else table.to_parquet(path)
    found = mv.project_points(BALL, mv.read_points(path), 2000.0)
    assert found.points.columns["root"].tolist() == [2**64 - 9] * 5
    assert found.id_to_mesh_map()[:, 0].tolist() == table["id"].tolist()
    for part in (1, None):
        ids = mv.read_points(table.assign(id=np.uint64(2**63))[:part])
        with raises("not-exact", "The id 9223372036854775808 is not below 2**63"):
            mv.project_points(BALL, ids, 2000.0).id_to_mesh_map()


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_without_pyarrow_it_is_named(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / f"synapses.{ending}").write_bytes(b"PAR1")
    for name in [each for each in sys.modules if each.partition(".")[0] == "pyarrow"] + ["pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError) as fault:
        mv.read_points(tmp_path / f"synapses.{ending}")
    assert str(fault.value) == (
        f"synapses.{ending} is read by pyarrow, which is not installed: pip install pyarrow."
    )


@pytest.mark.parametrize(
    ("text", "code", "word"),
    [
        ("", "wrong-format", "is no table (Empty CSV file)"),
        ("x,y,z\n", "no-points", "has no rows"),
        ("a,b\n1,2\n", "no-column", "rename its columns, which are a, b."),
        ("a_x,a_y,a_z,b_x,b_y,b_z\n1,2,3,4,5,6\n", "several-positions", "name one of a, b."),
        ("x,y,z\nnan,1,2\n,,\n", "no-points", "no position in any of its rows"),
        ("x,y,z\n1,2,3\n1,two,3\n", "not-a-number", "'two' as y in row 2"),
        ("x,y,z\n1,2,3\n1,2\n", "wrong-format", "Row #3: Expected 3 columns, got 2: 1,2"),
        ("x,y,z,x\n1,2,3,4\n", "given-twice", "two columns called 'x'"),
        ("id,pos\n1,[1 2 3]\n2,[1 2]\n", "not-a-number", "'[1 2]' as pos in row 2"),
    ],
)
def test_bad_tables(tmp_path: Path, text: str, code: str, word: str) -> None:
    path = tmp_path / "s.csv"
    path.write_text(text)
    with raises(code, "s.csv ", word):
        mv.read_points(path)


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ("x_pre,y_pre,z_pre", ""),
        ("Center X (vx),Center Y (vx),Center Z (vx)", ""),
        ("X [um],Y [um],Z [um]", "µm"),
        ("pt_x_nm,pt_y_nm,pt_z_nm", "nm"),
        ("x(8nm),y(8nm),z(8nm)", "8 nm"),
    ],
)
def test_names_of_coordinates_may_end_in_a_word_or_a_unit(
    tmp_path: Path, names: str, unit: str
) -> None:
    path = tmp_path / "s.csv"
    path.write_text(f"Synapse ID,{names},x_nm,y_nm\n70,1,2,3,8,9\n")
    found = mv.read_points(path)
    assert (found.positions.tolist(), found.unit) == ([[1, 2, 3]], unit)
    assert (found.id, [*found.columns]) == ("Synapse ID", ["Synapse ID", "x_nm", "y_nm"])
    assert mv.read_points(path, unit="4 nm").unit == "4 nm"
    both = {name: [1.0] for name in ("x", "y", "z", "x_err", "y_err", "z_err")}
    assert [*mv.read_points(both).columns] == ["x_err", "y_err", "z_err"]
    with raises("no-column", "rename its columns, which are x_nm, y_nm, z_um"):
        mv.read_points({"x_nm": [1.0], "y_nm": [2.0], "z_um": [3.0]})


def test_other_bad_input(tmp_path: Path) -> None:
    table = synapses(50)
    (tmp_path / "s.parquet").write_bytes(b"PAR1 no table PAR1")
    table.to_csv(tmp_path / "s.csv")
    bad: list[tuple[Any, str]] = [
        (lambda: mv.read_points(tmp_path / "s.parquet"), "s.parquet is no table"),
        (
            lambda: mv.read_points(tmp_path / "s.xlsx"),
            "s.xlsx is no table of points: give a file that ends in one of",
        ),
        (lambda: mv.read_points(tmp_path / "none.csv"), "cannot be read"),
        (lambda: mv.read_points(tmp_path / "s.csv", position="q"), "s.csv has no position 'q'"),
        (lambda: Points([[1.0, 2.0]]), "give x, y and z of each, shape (k, 3)"),
        (lambda: Points([[np.nan, 0, 0]]), "1 point of 1 not finite."),
        (lambda: mv.project_points(BALL, [[0, 0, 4e3]], -1.0), "give a number from 0"),
        (lambda: mv.project_points(BALL, [[0, 0, 0]], 5.0), "No point is within 5 nm of the mesh:"),
        (
            lambda: mv.project_points(shapes.icosphere(1), Points([[0, 0, 1]], unit="nm")),
            "are in nm and no unit: state both units",
        ),
    ]
    for act, said in bad:
        with pytest.raises(InputError) as fault:
            act()
        assert said in str(fault.value).replace("\N{NO-BREAK SPACE}", " ")
    found = mv.project_points(BALL, mv.read_points(table.drop(columns="id")))
    with raises("no-column", "no column id"):
        found.id_to_mesh_map()
    with raises("wrong-type"):
        mv.project_points(BALL, mv.read_points(table.assign(id="a"))).id_to_mesh_map()


def test_points_in_voxels_are_refused_with_their_likely_size() -> None:
    places = (FAR.vertices[:100] + 5.0) / [4.0, 4.0, 40.0]
    with raises("far-from-mesh") as fault:
        mv.project_points(FAR, places)
    assert "100 of 100 points lie outside the box of the mesh" in str(fault.value)
    assert "in 4 × 4 × 40 nm 100" in str(fault.value)
    assert "give this unit (--points-unit, unit=)" in str(fault.value)
    found = mv.project_points(FAR, Points(places, unit="4 x 4 x 40 nm"))
    np.testing.assert_array_equal(found.vertices, np.arange(100))
    in_microns = mv.project_points(FAR, Points(FAR.vertices[:9] / 1000.0, unit="µm"))
    np.testing.assert_array_equal(in_microns.vertices, np.arange(9))
    mixed = np.vstack([places, FAR.vertices[:30]])  # most are far: a remark, no error
    (remark,) = mv.project_points(FAR, mixed).remarks
    assert remark.startswith("100 of 130 points lie outside the box of the mesh, and in 4 × 4 × 40")


def test_a_table_has_features_and_labels_at_each_point() -> None:
    table = mv.read_points(synapses().assign(vertex=1.5))
    found = mv.project_points(BALL, table, 500.0)
    height = mv.VertexMap("height", BALL.vertices[:, 2])
    half = mv.VertexMap("half", np.where(UP, 1, 0), (mv.Label(1, "up", "#4477aa"),))
    features = mv.Features(BALL.vertices[:, :2], ("a", "b"))
    columns = found.to_frame(features, height, half)
    near = found.near
    np.testing.assert_array_equal(columns["height"][near], BALL.vertices[found.vertices[near], 2])
    np.testing.assert_array_equal(columns["b"][near], BALL.vertices[found.vertices[near], 1])
    assert columns["height"][~near].isna().all()
    assert set(columns["half"][near].fillna("none")) == {"up", "none"}
    assert columns["vertex"].tolist() == [1.5] * 300, "that of the table"
    assert columns["vertex 2"][~near].isna().all()
    assert columns["vertex 2"][near].tolist() == found.vertices[near].tolist()


# -- the command line --------------------------------------------------------------------------


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_mesh("far.ply", FAR)
    table = synapses(200)
    table[["ctr_pt_x", "ctr_pt_y", "ctr_pt_z"]] += [400_000.0, 800_000.0, 4_000_000.0]
    table[["ctr_pt_x", "ctr_pt_y", "ctr_pt_z"]] /= [4.0, 4.0, 40.0]
    table.to_csv("synapses.csv", index=False)
    np.savez("half.npz", half=np.where(UP, 1, 2))
    return tmp_path


POINTS = ("--points", "synapses.csv", "--voxel", "4", "4", "40", "--max-distance", "0.6 µm")


def test_points_from_the_command_line(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ["--kind", "hks", "--kind", "wks", "--n-components", "3", "--count", "12", "--json"]
    out = ("--labels", "half.npz", "-o", "out.parquet", "--id-map", "map.npz")
    assert main(["points", "far.ply", "--unit", "nm", *POINTS, *more, *out]) == 0
    said = json.loads(capsys.readouterr().out)
    found = mv.project_points(FAR, mv.read_points("synapses.csv", "4 × 4 × 40 nm"), 600.0)
    assert (said["n_points"], said["n_near"]) == (200, found.n_near)
    written = pandas.read_parquet("out.parquet")
    assert written["id"].tolist() == found.points.columns["id"].tolist()
    np.testing.assert_array_equal(written["vertex"].fillna(-1), found.vertices)
    assert sum(each.startswith(("hks_", "wks_")) for each in written) == 6
    assert written.filter(like="hks").notna().all(axis=1).sum() == found.n_near
    assert said["labels"]["points"] == found.per_label(np.where(UP, 1, 2))["points"].tolist()
    ids = np.load("map.npz")["id_to_mesh_map"]
    np.testing.assert_array_equal(ids, found.id_to_mesh_map())
    assert ids.shape == (found.n_near, 2)
    meta = json.loads(str(np.load("map.npz")["meta"]))
    assert meta["options"]["points_unit"] == "4 × 4 × 40 nm"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--unit", "nm", "--points", "synapses.csv"), "in 4 × 4 × 40 nm"),
        (("--unit", "none", *POINTS[:6]), "give --unit"),
        (("--points", "synapses.csv", "-o", "o.npz"), "end it in .csv, .parquet, or give --id-map"),
        (("--points", "synapses.csv", "--id-map", "o.csv"), "end it in .npz."),
        (("--points", "none.csv"), "cannot be read"),
        (("--points", "synapses.csv", "--t-min", "3"), "--t-min is for --kind hks"),
    ],
)
def test_refusals_of_the_command(
    here: Path, arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, said, "points", "far.ply", "-o", "o.csv", *arguments)
    assert not Path("o.csv").exists()


#: Identifiers that float64 rounds, one of them missing.
WIDE = [720575940612345679, None, 720575940612345681]


@pytest.mark.parametrize(
    "ids",
    [
        pandas.Series(WIDE, dtype="Int64"),
        pandas.Series(WIDE, dtype="int64[pyarrow]"),
        pandas.Series(pandas.Categorical(WIDE)),
        pyarrow.chunked_array([WIDE[:1], WIDE[1:]]),
        np.array(WIDE, dtype=object),
        WIDE,
    ],
    ids=lambda ids: f"{type(ids).__name__} {getattr(ids, 'dtype', '')}",
)
def test_identifiers_in_memory_are_exact_next_to_missing_ones(tmp_path: Path, ids: Any) -> None:
    xyz = dict(zip("xyz", BALL.vertices[:3].T, strict=True))
    found = mv.project_points(BALL, mv.read_points({"id": ids, "size": ids, **xyz}))
    assert found.to_frame()["id"].tolist() == WIDE
    assert found.sums(np.zeros(BALL.n_vertices, int), 1)["sum size"][0] == WIDE[0] + WIDE[2]
    mv.write_points(tmp_path / "out.csv", found)
    rows = (tmp_path / "out.csv").read_text().splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == [str(each or "") for each in WIDE]


TABLE = synapses(20)


@pytest.mark.parametrize(
    "table",
    [
        TABLE.set_index("id"),
        TABLE.set_index(["id", "type"]),
        TABLE.convert_dtypes(dtype_backend="pyarrow").set_index("id"),
        TABLE.set_axis(
            pandas.MultiIndex.from_tuples(
                [("ctr_pt", name[-1]) if "ctr" in name else (name, "") for name in TABLE]
            ),
            axis=1,
        ),
        pyarrow.Table.from_pandas(TABLE),
        {name: pyarrow.array(TABLE[name]) for name in TABLE},
        TABLE.iloc[::-1],
    ],
)
def test_a_table_in_memory_is_read_whole_with_its_named_index(table: Any) -> None:
    found = mv.read_points(table)
    assert found.id == "id"
    assert set(found.columns) == {"id", "size", "score", "type", "pre_pt_root_id"}
    order = np.argsort(found.columns["id"])
    assert found.columns["id"][order].tolist() == TABLE["id"].tolist()
    np.testing.assert_array_equal(
        found.positions[order], TABLE[["ctr_pt_x", "ctr_pt_y", "ctr_pt_z"]]
    )


@pytest.mark.parametrize("given", [None, 3, BALL.vertices, BALL.vertices.tolist(), TABLE["id"]])
def test_what_is_no_table_is_refused(given: Any) -> None:
    with raises("wrong-type", "positions alone to project_points"):
        mv.read_points(given)


def test_tables_given_as_positions_and_repeated_names_are_refused() -> None:
    with raises("wrong-type", "read a table or a file with read_points"):
        mv.project_points(BALL, TABLE)
    with raises("wrong-type", "read a table or a file with read_points"):
        mv.project_points(BALL, "synapses.csv")
    with raises("given-twice", "two columns called 'size'"):
        mv.read_points(pandas.concat([TABLE, TABLE[["size"]]], axis=1))
