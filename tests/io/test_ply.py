"""What PLY files may hold beside the mesh, and what our own hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshmash_viewer.features import Features
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
