"""What is wrong with a file, in a sentence: which fault, how often, where, and the remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.read import read_mesh

VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3]])


def saved(folder: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    path = folder / "mesh.npz"
    np.savez(path, vertices=vertices, faces=faces)
    return path


def test_coordinates_that_are_not_finite_are_counted_by_vertex(tmp_path: Path) -> None:
    vertices = VERTICES.copy()
    vertices[2] = [np.nan, np.inf, 0.0]
    with pytest.raises(InputError, match=r"1 vertex with .* first being vertex 2, .*repair"):
        read_mesh(saved(tmp_path, vertices, FACES))
    vertices[3, 1] = -np.inf
    with pytest.raises(InputError, match=r"2 vertices with .* first being vertex 2, "):
        read_mesh(saved(tmp_path, vertices, FACES))


def test_indices_out_of_range_are_counted_by_face(tmp_path: Path) -> None:
    faces = FACES.copy()
    faces[1] = [0, 4, 9]
    with pytest.raises(InputError, match=r"1 face with .* face 1 with index 4 of 4 vertices"):
        read_mesh(saved(tmp_path, VERTICES, faces))
    faces[2] = [-1, 2, 3]
    with pytest.raises(InputError, match=r"2 faces with .* face 1 with index 4 of 4 vertices"):
        read_mesh(saved(tmp_path, VERTICES, faces))


def test_some_faces_without_three_corners_are_read_but_not_only_such(tmp_path: Path) -> None:
    faces = FACES.copy()
    faces[1] = [1, 1, 3]
    np.testing.assert_array_equal(read_mesh(saved(tmp_path, VERTICES, faces)).faces, faces)
    with pytest.raises(InputError, match=r"no triangle with three different corners; repair"):
        read_mesh(saved(tmp_path, VERTICES, np.array([[0, 0, 1], [2, 1, 2], [3, 1, 1]])))


def test_a_cloud_of_points_is_to_be_exported_as_a_surface(tmp_path: Path) -> None:
    path = tmp_path / "cloud.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(InputError, match=r"point cloud .*export it as a surface with triangles"):
        read_mesh(path)


def test_a_binary_stl_that_ends_early_says_how_much_is_there(tmp_path: Path) -> None:
    record = np.zeros(1, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("a", "<u2")])
    record["corners"] = VERTICES[[0, 1, 2]]
    path = tmp_path / "mesh.stl"
    for there in (1, 2):
        content = bytes(80) + np.array([3], "<u4").tobytes() + there * record.tobytes() + b"rest"
        path.write_bytes(content)
        with pytest.raises(InputError, match=f"promises 3 triangles but ends after {there}, .*cut"):
            read_mesh(path)


def test_a_gifti_surface_of_other_dimensions(tmp_path: Path) -> None:
    from nibabel.gifti import GiftiDataArray, GiftiImage

    points, triangles = VERTICES.astype(np.float32), FACES.astype(np.int32)
    path = tmp_path / "mesh.surf.gii"
    for kept, corners in (
        (points[:, :2], triangles),
        (points, triangles[:, :2]),
        (points[:, 0], triangles),
        (points, triangles[:, 0]),
    ):
        arrays = [
            GiftiDataArray(np.ascontiguousarray(kept), intent="NIFTI_INTENT_POINTSET"),
            GiftiDataArray(np.ascontiguousarray(corners), intent="NIFTI_INTENT_TRIANGLE"),
        ]
        path.write_bytes(GiftiImage(darrays=arrays).to_bytes())
        with pytest.raises(InputError, match="has arrays of shapes"):
            read_mesh(path)


@pytest.mark.parametrize("ending", ["vtp", "vtk"])
def test_a_vtk_file_with_nothing_in_it(ending: str, tmp_path: Path) -> None:
    import pyvista

    path = tmp_path / f"nothing.{ending}"
    pyvista.PolyData().save(path)
    with pytest.raises(InputError, match="no vertices"):
        read_mesh(path)


@pytest.mark.parametrize("value", ["nan", "inf", "1e400"])
def test_a_coordinate_of_a_text_stl_that_is_not_finite(value: str, tmp_path: Path) -> None:
    path = tmp_path / "mesh.stl"
    facet = "facet normal 0 0 1\nouter loop\n{}endloop\nendfacet\n"
    good = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    bad = f"vertex 0 0 0\nvertex 1 0 {value}\nvertex 0 1 1\n"
    path.write_text(f"solid a\n{facet.format(good)}{facet.format(bad)}endsolid a\n")
    with pytest.raises(InputError, match="not finite"):
        read_mesh(path)
