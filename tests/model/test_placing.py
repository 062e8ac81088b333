"""Tables of pins: accepted formats, and the vertices of their rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes
from faults import raises

from meshmash_viewer.errors import InputError
from meshmash_viewer.health import repair_mesh
from meshmash_viewer.io.pins import MOST_PINS, is_pin_table, pin_table, read_pins, write_pins
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.pins import Pin
from meshmash_viewer.model.placing import PlacedPins, merged_pins, place_pins
from meshmash_viewer.units import plain_text


@pytest.fixture(scope="module")
def ball() -> Mesh:
    mesh = shapes.icosphere(3, radius=1000.0)
    return Mesh(mesh.vertices, mesh.faces, unit="nm")


def placed(mesh: Mesh, path: Path, text: str) -> PlacedPins:
    path = path / "pins.csv"
    path.write_text(text, encoding="utf-8")
    found = place_pins(mesh, read_pins(path))
    return PlacedPins(found.pins, found.faults, tuple(map(plain_text, found.remarks)))


def row(mesh: Mesh, vertex: int, scale: float = 1.0) -> str:
    return ",".join(f"{value!r}" for value in (mesh.vertices[vertex] * scale).tolist())


def test_what_is_written_is_read(ball: Mesh, tmp_path: Path) -> None:
    x, y, z = ball.vertices[[7, 300]].T.tolist()
    columns = {
        "index": [7, 300], "x": x, "y": y, "z": z, "unit": ["nm"] * 2,
        "name": ["soma, the large one", ""], "color": ["#123456", "#E69F00"], "hks": [0.1, 0.2],
    }  # fmt: skip
    write_pins(tmp_path / "pins.csv", columns)
    found = place_pins(ball, read_pins(tmp_path / "pins.csv"))
    assert found == PlacedPins(
        ((7, "soma, the large one", "#123456"), (300, "", "#E69F00")), (), ()
    )


@pytest.mark.parametrize(
    "text",
    [
        "vertex;Name;Colour\n7;soma;#123456\n300;;\n",
        "# made elsewhere\nname\tindex\tcolour\nsoma\t7.0\t#123456\n\t300\t\n",
    ],
)
def test_columns_are_known_by_other_names(ball: Mesh, tmp_path: Path, text: str) -> None:
    assert placed(ball, tmp_path, text).pins == ((7, "soma", "#123456"), (300, "", ""))


def test_positions_are_read_in_units_and_voxels(ball: Mesh, tmp_path: Path) -> None:
    for text in (
        f"x,y,z\n{row(ball, 7)}\n",
        f"pt_x,pt_y,pt_z\n{row(ball, 7)}\n",
        f"x,y,z,unit\n{row(ball, 7, 1e-3)},µm\n",
    ):
        assert placed(ball, tmp_path, text).pins == ((7, "", ""),), text
    voxels = Mesh(ball.vertices, ball.faces).in_voxels((4.0, 4.0, 40.0), "nm")
    for mesh in (ball, voxels):
        text = f"x,y,z\n{row(mesh, 7)}\n{row(mesh, 300)}\n"
        found = placed(voxels, tmp_path, text)
        assert [pin[0] for pin in found.pins] == [7, 300]
        read = "voxels" if mesh is ball else "nm"
        assert found.remarks == (f"Positions are read in {read}.",)


def test_indices_are_those_of_the_file(tmp_path: Path) -> None:
    corners = [[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 1, 0]]
    mesh = repair_mesh((corners, [[1, 2, 3]]), "drop_unreferenced_vertices")
    found = placed(mesh, tmp_path, "index\n3\n0\n9\n")
    assert (found.pins, found.remarks) == (((2, "", ""),), ())
    assert "row 2: Vertex 0 was removed by a repair" in str(found.faults[0])
    assert str(found.faults[1]) == "row 3: There is no vertex 9: give a whole number from 0 to 3."


def test_where_index_and_position_disagree_the_position_counts(ball: Mesh, tmp_path: Path) -> None:
    text = f"index,x,y,z\n7,{row(ball, 300)}\n5,{row(ball, 5)}\n99999,{row(ball, 8, 1.1)}\n"
    found = placed(ball, tmp_path, text)
    assert [pin[0] for pin in found.pins] == [300, 5, 8]
    assert found.remarks == (
        "2 positions not at the index: the position counts.",
        "The farthest vertex is 100 nm from its position.",
    )


def test_what_cannot_be_placed_is_said_and_nothing_else_lost(ball: Mesh, tmp_path: Path) -> None:
    text = f"x,y,z,color\n1e9,0,0,\n{row(ball, 7)},red\n{row(ball, 8)},\n,,,\n{row(ball, 8)},\n"
    found = placed(ball, tmp_path, text)
    assert found.pins == ((8, "", ""),)
    assert [plain_text(str(fault)) for fault in found.faults] == [
        "row 1: The position is 1000 mm from the mesh: check its unit.",
        "row 2: 'red' is not a colour: write it as #E69F00.",
    ]
    assert found.remarks == ("1 row at the vertex of an earlier row left out.",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n", "needs a column index, or x, y and z, in its first line, and its columns"),
        ("", "its columns are none"),
        ("index\n1.5\n", "'1.5' as index in row 1"),
        ("x,y,z\n1,2,here\n", "'here' as z in row 1"),
        ("index\n" + "1\n" * (MOST_PINS + 1), "501 rows, and at most 500"),
    ],
)
def test_other_tables_are_refused(ball: Mesh, tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        placed(ball, tmp_path, text)
    with raises("not-readable", "absent.csv"):
        read_pins(tmp_path / "absent.csv")


def test_tables_of_pins_differ_from_those_of_maps(tmp_path: Path) -> None:
    texts = {
        "index,name\n1,a\n": True, "x;y;z;colour\n": True, "vertex,hks\n1,2\n": False,
        "name,x\na,1\n": False, "1,2\n3,4\n": False, "": False,
    }  # fmt: skip
    for text, expected in texts.items():
        (tmp_path / "table.csv").write_text(text, encoding="utf-8")
        assert is_pin_table(tmp_path / "table.csv") is expected, text
    assert not is_pin_table(tmp_path / "absent.csv")


def test_pins_are_added_to_those_there_are() -> None:
    pins = (Pin(3, 2, "soma", "#111111"), Pin(4, 1))
    more = ((3, "", ""), (4, "axon", "#222222"), (5, "soma", ""), (6, "soma", ""), (7, "", ""))
    merged, remark = merged_pins(pins, more)
    assert merged == (
        Pin(3, 2, "soma", "#111111"), Pin(4, 1, "axon", "#222222"), Pin(5, 3, "soma 2"),
        Pin(6, 4, "soma 3"), Pin(7, 5),
    )  # fmt: skip
    assert remark == "Names that are taken have a number: soma is soma 2 and 1 more."
    assert merged_pins(merged, [(3, "soma", "")]) == (merged, "")
    assert merged_pins(merged, [(3, "cell body", "")])[1] == "Pins are renamed: soma is cell body."


def test_scripts_give_indices_or_positions() -> None:
    table = pin_table([3, 4], names=["a", "b"])
    assert (table.indices.tolist(), table.names) == ([3, 4], ("a", "b"))
    assert pin_table(np.zeros((2, 3))).indices.tolist() == [-1, -1]
    for wrong in ([0.5, 1.0], [], np.zeros((2, 2))):
        with raises("wrong-shape", "give indices of shape"):
            pin_table(wrong)
    with raises("counts-differ", "2 pins and 1 names"):
        pin_table([3, 4], names=["a"])
