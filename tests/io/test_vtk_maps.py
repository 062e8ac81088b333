"""Point data of VTK files: every array is read, or left out with a reason."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.errors import MeshWarning
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.vertex_map import VertexMap

pytestmark = pytest.mark.usefixtures("read_here")

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]], dtype=np.float32)
CELLS = np.array([3, 0, 1, 2, 3, 1, 3, 2], dtype=np.int32)
TYPES = {
    "unsigned_char": "u1", "char": "i1", "short": "i2", "unsigned_short": "u2", "int": "i4",
    "unsigned_int": "u4", "vtktypeint64": "i8", "float": "f4", "double": "f8", "vtkIdType": "i4",
}  # fmt: skip
COLORS = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1]])


class Legacy:
    """Builder of a legacy VTK file with four points, as text or binary."""

    def __init__(self, binary: bool = False, dataset: str = "POLYDATA") -> None:
        self.binary = binary
        kind = "BINARY" if binary else "ASCII"
        self.content = f"# vtk DataFile Version 3.0\ntest\n{kind}\nDATASET {dataset}\n".encode()
        self.add("POINTS 4 float", POINTS, "f4")
        if dataset == "POLYDATA":
            self.add("POLYGONS 2 8", CELLS, "i4")
        else:
            self.add("CELLS 2 8", CELLS, "i4").add("CELL_TYPES 2", np.array([5, 5]), "i4")

    def add(self, head: str, values: object = (), dtype: str = "f8") -> Legacy:
        """Append keyword lines and their values."""
        array = np.asarray(values, dtype=dtype)
        if self.binary:
            data = array.astype(f">{dtype}").tobytes() + b"\n" if array.size else b""
        else:
            data = " ".join(map(str, array.ravel().tolist())).encode() + b"\n"
        self.content += head.encode() + b"\n" + data
        return self

    def scalars(self, name: str, values: object, kind: str = "float", table: str = "") -> Legacy:
        head = f"SCALARS {name} {kind}\nLOOKUP_TABLE {table or 'default'}"
        return self.add(head, values, TYPES[kind])

    def table(self, name: str, colors: np.ndarray) -> Legacy:
        head = f"LOOKUP_TABLE {name} {len(colors)}"
        return self.add(head, colors * 255, "u1") if self.binary else self.add(head, colors)

    def read(self, folder: Path) -> dict[str, VertexMap]:
        path = folder / "mesh.vtk"
        path.write_bytes(self.content)
        maps = read_mesh(path).maps
        names = [each.name for each in maps]
        assert len(set(names)) == len(names)
        return dict(zip(names, maps, strict=True))


def values(found: dict[str, VertexMap]) -> dict[str, list[float]]:
    return {name: each.values.tolist() for name, each in found.items()}


@pytest.fixture(params=[False, True], ids=["text", "binary"])
def legacy(request: pytest.FixtureRequest) -> Legacy:
    return Legacy(request.param).add("POINT_DATA 4")


def test_every_block_of_scalars_is_a_map(legacy: Legacy, tmp_path: Path) -> None:
    wanted = {}
    for at, kind in enumerate(TYPES):
        wanted[f"map_{at}"] = [float(at), 1.0, 2.0, 3.0]
        legacy.scalars(f"map_{at}", wanted[f"map_{at}"], kind)
    assert values(legacy.read(tmp_path)) == wanted


def test_tables_of_colors_are_those_of_labels(legacy: Legacy, tmp_path: Path) -> None:
    legacy.scalars("a", [0, 1, 2, 1], "int", "three").table("three", COLORS)
    legacy.scalars("b", [0.5, 1, 2, 3], "float", "three")
    legacy.scalars("c", [1, 1, 0, 1], "unsigned_char", "two").table("two", COLORS[::-1][:2])
    legacy.scalars("d", [0, 1, 2, 3], "int", "three")  # the table has no fourth colour
    legacy.scalars("e", [0, 1, 2, 3], "int", "none_of_the_file")
    ramp = np.linspace(0, 1, 256)[:, np.newaxis].repeat(4, axis=1)
    legacy.scalars("f", [0, 1, 2, 3], "int", "ramp").table("ramp", ramp)
    found = legacy.read(tmp_path)
    assert [label.color for label in found["a"].labels] == ["#ff0000", "#00ff00", "#0000ff"]
    assert [label.color for label in found["c"].labels] == ["#0000ff", "#00ff00"]
    assert [name for name, each in found.items() if each.labels] == ["a", "c"]
    assert values(found)["a"] == [0, 1, 2, 1]
    assert values(found)["f"] == [0, 1, 2, 3]


def test_names_that_come_twice_are_two_maps(legacy: Legacy, tmp_path: Path) -> None:
    legacy.scalars("a", [1, 2, 3, 4]).scalars("a", [5, 6, 7, 8], "int")
    legacy.add("VECTORS v float", np.arange(12), "f4").add("FIELD FieldData 2")
    legacy.add("a 1 4 double", [0, 0, 0, 9]).add("v 1 4 short", [4, 3, 2, 1], "i2")
    assert values(legacy.read(tmp_path)) == {
        "a": [1, 2, 3, 4], "a 2": [5, 6, 7, 8], "v x": [0, 3, 6, 9], "v y": [1, 4, 7, 10],
        "v z": [2, 5, 8, 11], "a 3": [0, 0, 0, 9], "v 2": [4, 3, 2, 1],
    }  # fmt: skip


def test_vectors_and_fields_are_a_map_each_component(legacy: Legacy, tmp_path: Path) -> None:
    legacy.add("VECTORS flow double", np.arange(12)).add("TENSORS t float", np.arange(36), "f4")
    legacy.add("SCALARS pair float 2\nLOOKUP_TABLE default", np.arange(8), "f4")
    legacy.add("FIELD FieldData 2").add("one 1 4 int", [4, 5, 6, 7], "i4")
    legacy.add("my%20field 2 4 double", np.arange(8))
    legacy.scalars("last", [3, 2, 1, 0])
    found = values(legacy.read(tmp_path))
    assert list(found)[:3] == ["flow x", "flow y", "flow z"]
    assert found["t 8"] == [8, 17, 26, 35]
    assert (found["pair 1"], found["my field 0"]) == ([1, 3, 5, 7], [0, 2, 4, 6])
    assert (found["one"], found["last"]) == ([4, 5, 6, 7], [3, 2, 1, 0])


def test_what_is_no_map_is_named(legacy: Legacy, tmp_path: Path) -> None:
    share = (255, "u1") if legacy.binary else (1, "f8")
    legacy.add("NORMALS n float", POINTS, "f4").scalars("a", [1, 2, 3, 4])
    legacy.add("COLOR_SCALARS c 4", np.tile(COLORS[0] * share[0], (4, 1)), share[1])
    legacy.add("TEXTURE_COORDINATES uv 2 float", np.arange(8), "f4")
    legacy.scalars("b", [np.nan, 2, np.inf, 4])
    legacy.add("CELL_DATA 2").scalars("of_faces", [1, 2])
    with pytest.warns(MeshWarning) as caught:
        found = legacy.read(tmp_path)
    assert list(found) == ["a"]
    said = " ".join(str(each.message) for each in caught)
    for named in ("normals 'n'", "colours 'c'", "places in a texture 'uv'", "faces 'of_faces'"):
        assert named in said
    assert re.search(r"mesh\.vtk has a map that is left out: Map 'b' has 1 infinite value", said)


@pytest.mark.parametrize(
    "head",
    ["POINT_DATA 3\nSCALARS a float\nLOOKUP_TABLE default", "POINT_DATA 4\nSCALARS a float"],
)
def test_blocks_that_vtk_cannot_read_are_one_sentence(head: str, tmp_path: Path) -> None:
    with raises("not-readable"):
        Legacy().add(head, [1, 2, 3]).read(tmp_path)


def test_a_vtp_of_pyvista_keeps_its_vectors_and_names_its_colors(tmp_path: Path) -> None:
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(POINTS, CELLS.reshape(-1, 4)[:, 1:])
    surface["depth"] = np.arange(4.0)
    surface["flow"] = np.arange(12.0).reshape(4, 3)
    surface["rgb"] = np.zeros((4, 3), dtype=np.uint8)
    surface["words"] = np.array(list("abcd"))
    surface.point_data.active_normals = POINTS
    surface.save(tmp_path / "mesh.vtp")
    with pytest.warns(MeshWarning, match=r"colours 'rgb', texts 'words', normals 'Normals'"):
        maps = read_mesh(tmp_path / "mesh.vtp").maps
    assert [each.name for each in maps] == ["depth", "flow x", "flow y", "flow z"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        surface.clear_data()
        surface.save(tmp_path / "plain.vtp")
        assert not read_mesh(tmp_path / "plain.vtp").maps
