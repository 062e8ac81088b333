"""PLY files: additional properties and elements, irregular bodies, and the package's own files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from faults import raises

from meshmash_viewer.errors import InputError, MeshWarning
from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import write_features
from meshmash_viewer.mesh import Mesh


def properties(path: Path) -> list[str]:
    """Return the names of the vertex properties in a header."""
    header = path.read_bytes().split(b"element face")[0].decode("ascii")
    return [line.split()[-1] for line in header.splitlines() if line.startswith("property")]


def test_columns_named_like_coordinates_or_like_each_other_all_come_through(
    sphere: Mesh, tmp_path: Path, rng: np.random.Generator
) -> None:
    import trimesh

    columns = ("x", "a", "a", "a_2", "y", "a", "z", "x", "a b", "a_b")
    values = rng.random((sphere.n_vertices, len(columns)))
    path = tmp_path / "features.ply"
    write_features(path, Features(values, columns), sphere)
    names = properties(path)
    assert names[:3] == ["x", "y", "z"]
    assert len(set(names)) == len(names) == 3 + len(columns)
    np.testing.assert_array_equal(read_mesh(path).vertices, sphere.vertices)
    raw = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
    for name, column in zip(names[3:], values.T, strict=True):
        np.testing.assert_array_equal(raw[name].ravel(), column.astype(np.float32))


def test_another_element_may_have_coordinates_too(tmp_path: Path) -> None:
    path = tmp_path / "cameras.ply"
    path.write_text(
        "ply\nformat ascii 1.0\n"
        "element camera 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property float s\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "9 9 9\n0 0 0 7\n1 0 0 7\n0 1 0 7\n3 0 1 2\n"
    )
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


def write_text(path: Path, header: str, body: str) -> Path:
    path.write_text(f"ply\nformat ascii 1.0\n{header}end_header\n{body}")
    return path


VERTEX = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


@pytest.mark.filterwarnings("ignore:.* values of its faces 'first', 'last', which are left out")
def test_binary_lists_of_differing_length_beside_other_properties(tmp_path: Path) -> None:
    header = (
        "ply\nformat binary_big_endian 1.0\n" + VERTEX + "element face 2\n"
        "property short first\nproperty list ushort int vertex_indices\nproperty double last\n"
        "end_header\n"
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=">f4")
    body = points.tobytes()
    for corners in ([0, 1, 2], [0, 1, 2, 3]):
        body += np.array([9], dtype=">i2").tobytes() + np.array([len(corners)], ">u2").tobytes()
        body += np.array(corners, dtype=">i4").tobytes() + np.array([1.5], dtype=">f8").tobytes()
    path = tmp_path / "mesh.ply"
    path.write_bytes(header.encode() + body)
    np.testing.assert_array_equal(read_mesh(path).faces, [[0, 1, 2], [0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("header", "body", "code"),
    [
        (VERTEX + "element face 1\nproperty int vertex_indices\n", SQUARE + "3\n", "missing-data"),
        (
            VERTEX + "element face 1\nproperty list uchar int corners\n",
            SQUARE + "3 0 1 2\n",
            "missing-data",
        ),
        (
            VERTEX + "element face 2\nproperty list uchar int vertex_indices\n",
            SQUARE + "3 0\n",
            "file-cut-short",
        ),
        (
            VERTEX + "element face 2\nproperty list uchar int vertex_indices\n",
            SQUARE + "3 0 1 2\n4 0 1\n",
            "file-cut-short",
        ),
        ("element vertex 1\nproperty float x\nproperty float y\n", "0 0\n", "no-vertices"),
        (
            "element vertex 1\nproperty float x\nproperty float y\nproperty list uchar float z\n",
            "0 0 1 0\n",
            "no-vertices",
        ),
        (
            VERTEX + "element face 1\nproperty list char int vertex_indices\n",
            SQUARE + "-3 0 1 2\n",
            "out-of-range",
        ),
    ],
)
def test_what_a_ply_file_lacks_is_named(header: str, body: str, code: str, tmp_path: Path) -> None:
    with raises(code):
        read_mesh(write_text(tmp_path / "mesh.ply", header, body))


@pytest.mark.parametrize(
    ("said", "unit"),
    [
        ('{"mesh": {"unit": "nm"}}', "nm"),
        ('{"mesh": {"unit": ""}}', ""),
        ('{"mesh": {"unit": "furlong"}}', ""),
        ('{"mesh": {"unit": 8}}', ""),
        ('{"mesh": "nm"}', ""),
        ("by hand", ""),
    ],
)
def test_a_unit_is_taken_from_our_own_comment_if_it_is_one(
    said: str, unit: str, tmp_path: Path
) -> None:
    header = f"comment meshmash-viewer {said}\n" + VERTEX
    header += "element face 1\nproperty list uchar int vertex_indices\n"
    assert read_mesh(write_text(tmp_path / "mesh.ply", header, SQUARE + "3 0 1 2\n")).unit == unit


# Bodies that differ from their header -------------------------------------------------------------

FACE = "element face 2\nproperty list uchar int vertex_indices\n"
FACES = "3 0 1 2\n3 0 2 3\n"
EDGE = "element edge 2\nproperty int vertex1\nproperty int vertex2\n"
MATERIAL = "element material 1\nproperty list uchar float shares\nproperty int number\n"
MANY = "property list uchar float texcoord\n"


def longer(rows: str, more: str) -> str:
    return rows.replace("\n", f" {more}\n")


SQUARES = {
    "plain": (VERTEX + FACE, SQUARE + FACES),
    "longer rows of faces": (VERTEX + FACE, SQUARE + longer(FACES, "255 0")),
    "longer rows of vertices": (VERTEX + FACE, longer(SQUARE, "0 0 1") + FACES),
    "longer rows of both": (VERTEX + FACE, longer(SQUARE, "9 9") + longer(FACES, "3 0 1 2")),
    "longer rows after a list": (
        VERTEX + FACE + MANY,
        SQUARE + longer(FACES, "6 0 0 0 0 0 0 1 2 3"),
    ),
    "empty lines": (VERTEX + FACE, (SQUARE + FACES).replace("\n", "\n\n")),
    "two line ends": (VERTEX + FACE, (SQUARE + FACES).replace("\n", "\r\n")),
    "old line ends": (VERTEX + FACE, (SQUARE + FACES).replace("\n", "\r")),
    "no last line end": (VERTEX + FACE, (SQUARE + FACES).rstrip()),
    "rows over lines": (VERTEX + FACE, (SQUARE + FACES).replace(" 0 ", " 0\n")),
    "all in one line": (VERTEX + FACE, (SQUARE + FACES).replace("\n", " ")),
    "faces first": (FACE + VERTEX, FACES + SQUARE),
    "faces first, longer rows": (FACE + VERTEX, longer(FACES, "1") + longer(SQUARE, "0")),
    "faces first, in one line": (FACE + VERTEX, (FACES + SQUARE).replace("\n", " ")),
    "edges last": (VERTEX + FACE + EDGE, SQUARE + FACES + "0 1\n2 3\n"),
    "edges between": (VERTEX + EDGE + FACE, SQUARE + "0 1\n2 3\n" + FACES),
    "edges first, longer rows": (EDGE + VERTEX + FACE, "0 1 7\n2 3 7\n" + SQUARE + FACES),
    "lists of other elements": (MATERIAL + VERTEX + FACE, "3 .1 .2 .3 7\n" + SQUARE + FACES),
    "an empty list": (MATERIAL + VERTEX + FACE, "0 7\n" + SQUARE + FACES),
    "an element without properties": (VERTEX + "element thing 5\n" + FACE, SQUARE + FACES),
    "an element without rows": (VERTEX + EDGE.replace("2", "0", 1) + FACE, SQUARE + FACES),
    "two elements of faces": (
        VERTEX + 2 * FACE.replace("2", "1", 1),
        SQUARE + FACES,
    ),
    "polygon and triangle": (VERTEX + FACE, SQUARE + "3 0 1 2\n4 0 1 2 3\n"),
}


@pytest.mark.parametrize("name", SQUARES)
def test_a_text_body_is_read_as_its_lines_say(name: str, tmp_path: Path) -> None:
    header, body = SQUARES[name]
    path = write_text(tmp_path / "mesh.ply", header, body)
    mesh = read_mesh(path)
    area = 1.5 if name == "polygon and triangle" else 1.0
    assert (mesh.n_vertices, mesh.area) == (4, pytest.approx(area))
    assert mesh.faces[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("header", "body", "code"),
    [
        (VERTEX + FACE, SQUARE + FACES + "3 0 1 3\n", "counts-differ"),
        (VERTEX + FACE, SQUARE + FACES + "7", "counts-differ"),
        (VERTEX + FACE, SQUARE + "0 0 1\n" + FACES, "counts-differ"),
        (VERTEX + FACE, SQUARE[:-6] + FACES + "3 0 1 3\n", "counts-differ"),
        (VERTEX + FACE, SQUARE + "3 0 1 2 9\n3 0 2 3\n", "counts-differ"),
        (VERTEX + FACE, longer(SQUARE, "1") + "3 0 1 2 9 9\n3 0 2 3 9", "counts-differ"),
        (VERTEX + FACE, SQUARE + "3 0 1 2\n3 0 2 2.5\n", "not-whole-numbers"),
        (VERTEX + FACE, SQUARE + "3 0 1 2\n2.5 0 2 3\n", "out-of-range"),
        (VERTEX + FACE, SQUARE + "3 0 1 2\nnan 0 2 3\n", "out-of-range"),
        (VERTEX + FACE + VERTEX, SQUARE + FACES + SQUARE, "no-vertices"),
        (VERTEX + FACE, SQUARE + "3 0 1 2 # red\n3 0 2 3\n", "not-a-number"),
    ],
)
def test_a_text_body_of_more_or_less_is_refused(
    header: str, body: str, code: str, tmp_path: Path
) -> None:
    with raises(code):
        read_mesh(write_text(tmp_path / "mesh.ply", header, body))


def binary_square(order: str, after_row: bytes = b"", end: str = "\n") -> bytes:
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    header = f"ply\nformat {kind} 1.0\ncomment end_header\n{VERTEX}{FACE}end_header\n"
    points = np.array([row.split() for row in SQUARE.splitlines()], f"{order}f4")
    body = points.tobytes()
    for corners in ([0, 1, 2], [0, 2, 3]):
        body += b"\3" + np.array(corners, f"{order}i4").tobytes() + after_row
    return header.replace("\n", end).encode() + body


@pytest.mark.parametrize("order", "<>")
def test_binary_bodies_that_end_with_their_last_row(order: str, tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    for end, after in (
        ("\n", b""),
        ("\r\n", b"\r\n"),
        ("\r", b""),
        ("\n", b"\n"),
        ("\n", bytes(9)),
    ):
        path.write_bytes(binary_square(order, end=end) + after)
        mesh = read_mesh(path)
        assert (mesh.n_vertices, mesh.faces.tolist()) == (4, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("more", [b"\0", b"\1", b"\xff\0\0", b"\3\0\0\0\0"])
def test_longer_rows_of_a_binary_body_are_refused(order: str, more: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    path.write_bytes(binary_square(order, more))
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.code in ("counts-differ", "file-cut-short", "vertex-out-of-range")


def test_bytes_after_a_binary_body_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    path.write_bytes(binary_square("<") + b"made by hand")
    with raises("counts-differ", "holds 12 bytes more than its header describes"):
        read_mesh(path)


def test_lists_of_vertices_become_maps_or_are_said(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    lists = VERTEX + "property list uchar float w\nproperty float h\n" + FACE
    write_text(path, lists, "0 0 0 2 5 6 1\n1 0 0 2 7 8 2\n1 1 0 2 9 1 3\n0 1 0 2 2 3 4\n" + FACES)
    found = {each.name: each.values.tolist() for each in read_mesh(path).maps}
    assert found == {"w 0": [5, 7, 9, 2], "w 1": [6, 8, 1, 3], "h": [1, 2, 3, 4]}
    write_text(path, lists, "0 0 0 2 5 6 1\n1 0 0 1 7 2\n1 1 0 0 3\n0 1 0 1 2 4\n" + FACES)
    with pytest.warns(MeshWarning, match="has lists of different lengths 'w', which are left out"):
        mesh = read_mesh(path)
    assert [each.name for each in mesh.maps] == ["h"]


def test_values_of_faces_are_named_but_no_colours(tmp_path: Path) -> None:
    more = "property uchar red\nproperty list uchar float texcoord\nproperty float quality\n"
    rows = "".join(f"{face} 9 2 0 1 0.5\n" for face in FACES.splitlines())
    path = tmp_path / "mesh.ply"
    path.write_text(f"ply\nformat ascii 1.0\n{VERTEX}{FACE}{more}end_header\n{SQUARE}{rows}")
    with pytest.warns(MeshWarning, match="has values of its faces 'quality', which are left out"):
        assert read_mesh(path).n_faces == 2
