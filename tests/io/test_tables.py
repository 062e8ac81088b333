"""Tables of values per vertex: every column is read, or left out with a reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas
import pytest
from faults import raises

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.io.maps import is_map_file, read_labels, read_maps
from meshmash_viewer.mesh import Mesh

#: A mesh of four vertices, for tables of four rows.
MESH = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 2, 3]])
NAN = np.nan


pytestmark = pytest.mark.usefixtures("read_here")


def read(path: Path, content: str | bytes) -> dict[str, list[float]]:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return {each.name: each.values.tolist() for each in read_maps(path, MESH)}


#: Content of a table, and the maps read from it.
TABLES: dict[str, tuple[str | bytes, dict[str, list[float]]]] = {
    "one name twice": ("a,a\n1,5\n2,6\n3,7\n4,8\n", {"a": [1, 2, 3, 4], "a 2": [5, 6, 7, 8]}),
    "three of one name and the number taken": (
        "a,a 2,a,a\n1,2,3,4\n1,2,3,4\n1,2,3,4\n1,2,3,4\n",
        {"a": [1] * 4, "a 2": [2] * 4, "a 3": [3] * 4, "a 4": [4] * 4},
    ),
    "None": ("a,b\n1,None\n2,6\nNone,7\n4,8\n", {"a": [1, 2, NAN, 4], "b": [NAN, 6, 7, 8]}),
    "quoted": ('a\n"1.5"\n"None"\n""\n3\n', {"a": [1.5, NAN, NAN, 3]}),
    "spaces": ("a, b\n1, None\n2, 6.5\n3, 7\n4, 8\n", {"a": [1, 2, 3, 4], "b": [NAN, 6.5, 7, 8]}),
    "empty": ("a,b\n,5\n2,6\n3,\n4,8\n", {"a": [NAN, 2, 3, 4], "b": [5, 6, NAN, 8]}),
    "many words": ("a\nNA\n-\nnull\n4\n", {"a": [NAN, NAN, NAN, 4]}),
    "other words": ("a\n#N/A\n<NA>\n?\n4\n", {"a": [NAN, NAN, NAN, 4]}),
    "no names, missing first": (
        "None,5\n2,6\n3,7\n4,8\n",
        {"f0": [NAN, 2, 3, 4], "f1": [5, 6, 7, 8]},
    ),
    "no name": ("None\n2\n3\n4\n", {"table.csv": [NAN, 2, 3, 4]}),
    "truth": ("a\ntrue\nfalse\nNone\ntrue\n", {"a": [1, 0, NAN, 1]}),
    "byte order mark": (b"\xef\xbb\xbfa\n1\n2\n3\n4\n", {"a": [1, 2, 3, 4]}),
    "mark without names": (b"\xef\xbb\xbf1\n2\n3\n4\n", {"table.csv": [1, 2, 3, 4]}),
    "UTF-16": (
        "a,µ\n1,5\n2,6\n3,7\n4,8\n".encode("utf-16"),
        {"a": [1, 2, 3, 4], "µ": [5, 6, 7, 8]},
    ),
    "cp1252": ("µm\n1\n2\n3\n4\n".encode("cp1252"), {"µm": [1, 2, 3, 4]}),
    "Windows": ("a,b\r\n1,5\r\n2,6\r\n3,7\r\n4,8\r\n", {"a": [1, 2, 3, 4], "b": [5, 6, 7, 8]}),
    "semicolons": (
        "a;b\n1,5;2\n2;None\n3;4\n1000,25;5\n",
        {"a": [1.5, 2, 3, 1000.25], "b": [2, NAN, 4, 5]},
    ),
    "semicolons, stated": (
        b"\xef\xbb\xbfsep=;\r\na;b\r\n1,5;2\r\n2;None\r\n3;4\r\n4;5\r\n",
        {"a": [1.5, 2, 3, 4], "b": [2, NAN, 4, 5]},
    ),
    "decimal commas in quotes": (
        'a,b\n"1,5","2"\n"2","0,25"\n"3","1"\n"4","0"\n',
        {"a": [1.5, 2, 3, 4], "b": [2, 0.25, 1, 0]},
    ),
    "decimal commas in one column": ("a\n1,5\n-2,25\n3\n4\n", {"a": [1.5, -2.25, 3, 4]}),
    "decimal commas alone": ("1,05\n-2,25\n3,00\n4,10\n", {"table.csv": [1.05, -2.25, 3, 4.1]}),
    "two whole numbers": ("1,5\n2,25\n3,0\n4,10\n", {"f0": [1, 2, 3, 4], "f1": [5, 25, 0, 10]}),
    "decimal commas and tabs": (
        "a\tb\n1,5\t5\n2\t0,25\n3\t7\n4\t8\n",
        {"a": [1.5, 2, 3, 4], "b": [5, 0.25, 7, 8]},
    ),
    "names and columns in spaces": (
        "   a   b\n  1.0  5.0 \n -2.0  nan\n  3.0  7.0\n  4.0 12.0",
        {"a": [1, -2, 3, 4], "b": [5, NAN, 7, 12]},
    ),
    "spaces and Windows": (
        "  1.0  5.0 \r\n -2.0  6.0\r\n  3.0  7.0\r\n  4.0 12.0\r\n",
        {"f0": [1, -2, 3, 4], "f1": [5, 6, 7, 12]},
    ),
    "faults of Excel": (
        "a,b\n1,#DIV/0!\n2,6\n#NUM!,7\n4,8\n",
        {"a": [1, 2, NAN, 4], "b": [NAN, 6, 7, 8]},
    ),
    "tabs": ("a\tb\n1\t5\n2\t\n3\t7\n4\t8\n", {"a": [1, 2, 3, 4], "b": [5, NAN, 7, 8]}),
    "comments": ("# made\n# a,b\n1,5\n2,6\n3,7\n4,8\n", {"a": [1, 2, 3, 4], "b": [5, 6, 7, 8]}),
    "comments over names": (
        "# made by me\na,b\n1,5\n2,6\n3,7\n4,8\n",
        {"a": [1, 2, 3, 4], "b": [5, 6, 7, 8]},
    ),
    "of NumPy": (
        "1.0 5.0\n2.0 nan\n3.0 7.0\n4.0 8.0\n",
        {"f0": [1, 2, 3, 4], "f1": [5, NAN, 7, 8]},
    ),
    "of pandas": (",a\n0,5\n1,6\n2,7\n3,8\n", {"a": [5, 6, 7, 8]}),
    "of pandas, another order": (
        ",a\n3,5\n1,6\n2,7\n0,8\n",
        {"table.csv": [3, 1, 2, 0], "a": [5, 6, 7, 8]},
    ),
    "vertex": (
        "a,vertex,a\n1,3,5\n2,2,6\n3,1,7\nNone,0,8\n",
        {"a": [NAN, 3, 2, 1], "a 2": [8, 7, 6, 5]},
    ),
    "some vertices": ("vertex,a\n3,1\n1,2\n", {"a": [NAN, 2, NAN, 1]}),
    "a year": ("depth,2020\n1,5\n2,6\n3,7\n4,8\n", {"depth": [1, 2, 3, 4], "2020": [5, 6, 7, 8]}),
    "indices and numbers": (
        "0,501\n1,733\n2,250\n3,104\n",
        {"f0": [0, 1, 2, 3], "f1": [501, 733, 250, 104]},
    ),
    "no last line end": ("a\n1\n2\n3\n4", {"a": [1, 2, 3, 4]}),
}


@pytest.mark.parametrize("name", TABLES)
def test_columns_are_kept(name: str, tmp_path: Path) -> None:
    content, wanted = TABLES[name]
    found = read(tmp_path / ("table.tsv" if "tabs" in name else "table.csv"), content)
    assert list(found) == list(wanted)
    for column, values in wanted.items():
        np.testing.assert_array_equal(found[column], values)


#: Columns that are not maps, and the reasons given.
LEFT_OUT = {
    "text": (("b", "x", "y", "x", "y"), r"'b' \(not numbers, such as 'x'\)"),
    "one word among numbers": (
        ("b", "1", "2", "three", "4"),
        r"'b' \(not numbers, such as 'three'\)",
    ),
    "nothing": (("b", "", "", "", ""), r"'b' \(it is empty\)"),
    "only None": (("b", "None", "None", "NA", ""), r"'b' \(it is empty\)"),
    "dates": (("b", *["2024-01-01"] * 4), r"'b' \(not numbers, such as "),
    "infinite": (("b", "inf", "1", "2", "3"), r"a map that is left out: Map 'b' has 1 infinite"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_columns_that_are_no_map_are_said(name: str, tmp_path: Path) -> None:
    column, pattern = LEFT_OUT[name]
    rows = [f"{each},{at}" for each, at in zip(column, ["a", 1, 2, 3, 4], strict=True)]
    with pytest.warns(MeshWarning, match=pattern):
        found = read(tmp_path / "table.csv", "\n".join(rows) + "\n")
    assert found == {"a": [1, 2, 3, 4]}


BROKEN = {
    "two columns vertex": ("vertex,vertex,a\n0,1,2\n", "2 columns called vertex"),
    "a vertex twice": ("vertex,a\n0,1\n0,2\n1,3\n2,4\n", "not an index from 0 in each row, once"),
    "no vertex": ("vertex,a\n0,1\nNone,2\n1,3\n2,4\n", "not an index from 0 in each row, once"),
    "rows of other lengths": ("a,b\n1,2\n3\n4,5\n6,7\n", "is no table"),
    "words alone": (
        "a,b\nx,y\nx,y\nx,y\nx,y\n",
        r"no column of numbers: 'a' \(not numbers, such as 'x'\), 'b'",
    ),
    "thousands": ('a\n"1,000"\n"2,000"\n"3,000"\n"4,000"\n', "no column of numbers: .*'1,000'"),
    "decimal commas or two columns": (
        "0,501\n0,733\n1,250\n1,104\n",
        "decimal comma, or of two whole numbers: write decimals with a point",
    ),
    "one row": (",".join(["0.5"] * 65) + "\n", "1 row of 65 numbers and needs a row for each vert"),
    "one": ("a\n1\n", "has 1 value and the mesh 4 vertices"),
    "too few": ("a\n1\n2\n3\n", "3 values and the mesh 4 vertices"),
}


@pytest.mark.parametrize("ending", [".csv", ".tsv", ".txt"])
@pytest.mark.parametrize(
    "rows",
    [("0.25", "1.5", "2", "-3e-2"), ("3", "1", "2", "0"), ("nan", "1", "2", "3"), tuple("0123")],
)
def test_a_column_without_a_name(ending: str, rows: tuple[str, ...], tmp_path: Path) -> None:
    path, values = tmp_path / f"depth{ending}", list(map(float, rows))
    for content in ("\n".join(rows), "\r\n".join([*rows, ""])):
        assert is_map_file(path)
        found = read(path, content)
        assert list(found) == [path.name]
        np.testing.assert_array_equal(found[path.name], values)
    for many, said in ((rows[:-1], "3 values"), ((*rows, "9"), "5 values"), (("4", *rows), "5")):
        with raises("other-mesh", said):
            read(path, "\n".join(many) + "\n")
    with raises("no-values"):
        read(path, "\n".join((rows[0], "word", *rows[2:])) + "\n")


@pytest.mark.parametrize("name", BROKEN)
def test_broken_tables_are_one_sentence(name: str, tmp_path: Path) -> None:
    content, pattern = BROKEN[name]
    with pytest.raises(InputError, match=rf"table\.csv:? .*{pattern}.*\.$"):
        read(tmp_path / "table.csv", content)


def test_a_column_may_change_its_kind_after_thousands_of_rows(tmp_path: Path) -> None:
    """In the first 2 MB, one column has whole numbers only and the other no values."""
    n = 300_000
    late = np.where(np.arange(n) < n - 5, 0.0, 0.25)
    place = np.arange(n) - n // 2
    strip = np.column_stack([np.arange(n - 2), np.arange(1, n - 1), np.arange(2, n)])
    mesh = Mesh(np.column_stack([place, place % 2, np.zeros(n)]), strip)
    text = "".join(f"{value:g},{'' if value == 0 else value}\n" for value in late.tolist())
    (tmp_path / "late.csv").write_text("a,b\n" + text)
    first, second = read_maps(tmp_path / "late.csv", mesh)
    np.testing.assert_array_equal(first.values, late)
    np.testing.assert_array_equal(second.values, np.where(late == 0.0, np.nan, late))


def test_a_parquet_table_follows_the_same_rules(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    columns = [
        [1.5, None, 3, 4],
        [1, 2, None, 4],
        [True, None, False, True],
        list("abcd"),
        [None] * 4,
    ]
    names = ["a", "n", "t", "words", "empty"]
    table = pyarrow.table([pyarrow.array(each) for each in columns], names=names)
    pyarrow.parquet.write_table(table, tmp_path / "table.parquet")
    with pytest.warns(MeshWarning, match=r"'words' \(.*'a'\), 'empty' \(it is empty\)"):
        found = read_maps(tmp_path / "table.parquet", MESH)
    wanted = {"a": [1.5, NAN, 3, 4], "n": [1, 2, NAN, 4], "t": [1, NAN, 0, 1]}
    assert [each.name for each in found] == list(wanted)
    for each in found:
        np.testing.assert_array_equal(each.values, wanted[each.name])


@pytest.mark.parametrize(
    "index",
    [
        pandas.RangeIndex(3, -1, -1, name="vertex"),
        pandas.Index([3, 2, 1, 0], name="vertex", dtype="int32"),
        pandas.CategoricalIndex([3, 2, 1, 0], name="vertex"),
        pandas.MultiIndex.from_arrays([[3, 2, 1, 0], [7, 7, 8, 8]], names=["vertex", "part"]),
    ],
)
def test_the_named_index_of_pandas_is_a_column_of_a_parquet_table(
    tmp_path: Path, index: pandas.Index
) -> None:
    pandas.DataFrame({"a": [1.0, 2.0, 3.0, 4.0]}, index).to_parquet(tmp_path / "a.parquet")
    assert read_maps(tmp_path / "a.parquet", MESH)[0].values.tolist() == [4, 3, 2, 1]


@pytest.mark.parametrize("kind", ["category", "string", "string[pyarrow]", object])
def test_text_labels_of_pandas_are_read_from_parquet(tmp_path: Path, kind: str | type) -> None:
    label = pandas.Series(["soma", "axon", None, "soma"]).astype(kind)
    pandas.DataFrame({"label": label}).to_parquet(tmp_path / "a.parquet")
    found = read_labels(tmp_path / "a.parquet", MESH)
    assert [sorted(np.flatnonzero(found.mask(name))) for name in ("soma", "axon")] == [[0, 3], [1]]


def test_identifiers_of_vertices_are_left_out_instead_of_rounded(tmp_path: Path) -> None:
    wide = [720575940612345679, 720575940612345681, 0, 1]
    columns = {"a": [1, 2, 3, 4], "whole": wide, "some": pandas.array([*wide[:3], None])}
    pandas.DataFrame(columns).to_parquet(tmp_path / "a.parquet")
    with pytest.warns(MeshWarning, match="would be rounded") as said:
        found = read_maps(tmp_path / "a.parquet", MESH)
    assert [each.name for each in found] == ["a"]
    text = " ".join(str(each.message) for each in said)
    assert "whole" in text
    assert "some" in text
