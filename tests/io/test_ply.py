"""What PLY files may hold beside the mesh, and what our own hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.features.sums import Features
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import write_features
from meshmash_viewer.mesh import Mesh


def properties(path: Path) -> list[str]:
    """Names of the vertex properties that a header promises."""
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


def test_lists_of_differing_length_beside_other_properties(tmp_path: Path) -> None:
    header = (
        VERTEX + "element face 2\nproperty float quality\n"
        "property list uchar int flags\nproperty list uchar int vertex_indices\n"
    )
    body = SQUARE + "0.5 1 7 3 0 1 2\n0.25 2 7 8 4 0 1 2 3\n"
    mesh = read_mesh(write_text(tmp_path / "mesh.ply", header, body))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def test_the_largest_polygon_may_come_first(tmp_path: Path) -> None:
    header = VERTEX + "element face 3\nproperty list uchar int vertex_indices\n"
    body = SQUARE + "4 0 1 2 3\n3 0 1 2\n3 0 2 3\n"
    mesh = read_mesh(write_text(tmp_path / "mesh.ply", header, body))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]


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
    ("header", "body", "words"),
    [
        (
            VERTEX + "element face 1\nproperty int vertex_indices\n",
            SQUARE + "3\n",
            "faces without a list of vertex indices",
        ),
        (
            VERTEX + "element face 1\nproperty list uchar int corners\n",
            SQUARE + "3 0 1 2\n",
            "faces without a list of vertex indices",
        ),
        (
            VERTEX + "element face 2\nproperty list uchar int vertex_indices\n",
            SQUARE + "3 0\n",
            "promises 2 of its element 'face' but ends after 0",
        ),
        (
            VERTEX + "element face 2\nproperty list uchar int vertex_indices\n",
            SQUARE + "3 0 1 2\n4 0 1\n",
            "promises 2 of its element 'face' but ends after 1",
        ),
        (
            "element vertex 1\nproperty float x\nproperty float y\n",
            "0 0\n",
            "vertices without x, y and z",
        ),
        (
            "element vertex 1\nproperty float x\nproperty float y\nproperty list uchar float z\n",
            "0 0 1 0\n",
            "vertices without x, y and z",
        ),
        (
            VERTEX + "element face 1\nproperty list char int vertex_indices\n",
            SQUARE + "-3 0 1 2\n",
            "a list of -3 entries",
        ),
    ],
)
def test_what_a_ply_file_lacks_is_named(header: str, body: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
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
