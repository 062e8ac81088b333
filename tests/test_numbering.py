"""Indices refer to vertices of the file after any repair, and results fit the whole file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import pyvista
import shapes
import trimesh
from faults import raises
from tiers import slow_but

import meshmash_viewer as mv
from meshmash_viewer.features.sums import Features
from meshmash_viewer.health import REPAIRS
from meshmash_viewer.io.maps import read_maps
from meshmash_viewer.io.write import write_eigenpairs, write_features, write_mesh
from meshmash_viewer.mesh import Mesh

LARGEST, MERGE, DROP = (
    "keep_largest_component",
    "merge_coincident_vertices",
    "drop_unreferenced_vertices",
)


def seamed() -> Mesh:
    """Return a small ball, loose vertices, and a larger ball of halves without common vertices."""
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    upper = large.vertices[large.faces].mean(axis=1)[:, 2] > 0.0
    faces = large.faces.copy()
    faces[upper] += large.n_vertices
    halves = Mesh(np.concatenate([large.vertices, large.vertices]), faces)
    mesh = shapes.together(shapes.moved(small, 9.0), np.full((3, 3), 4.0), halves)
    return replace(mesh, name="halves")


@pytest.fixture(scope="module")
def raw() -> Mesh:
    return seamed()


SERIES: list[list[str]] = [
    [],
    [LARGEST],
    [MERGE, LARGEST],
    [DROP, LARGEST, MERGE],
    list(REPAIRS),
    list(reversed(REPAIRS)),
]


#: Of the largest component before components that touch are merged.
TOUCHES = pytest.mark.filterwarnings("ignore:.*keep_largest_component leaves")


@TOUCHES
@pytest.mark.parametrize("repairs", SERIES, ids=lambda names: "-".join(names) or "none")
def test_a_vertex_is_where_the_file_has_the_one_of_its_index(raw: Mesh, repairs: list[str]) -> None:
    mesh = mv.repair_mesh(raw, *repairs)
    assert mesh.n_file_vertices == raw.n_vertices
    np.testing.assert_array_equal(raw.vertices[mesh.file_indices], mesh.vertices)
    assert (np.diff(mesh.file_indices) > 0).all()
    for vertex in range(0, mesh.n_vertices, 7):
        index = mesh.file_index(vertex)
        assert mesh.vertex_of(index) == vertex
        assert mesh.named_vertex(vertex) == f"vertex {index:,}"
    whole = mesh.on_file(mesh.vertices)
    there = ~np.isnan(whole[:, 0])
    np.testing.assert_array_equal(whole[there], raw.vertices[there])
    for index in np.flatnonzero(~there):
        with raises("vertex-unused", f"Vertex {index} was removed by a repair"):
            mesh.vertex_of(int(index))
    for index in (-1, raw.n_vertices):
        with raises("vertex-out-of-range"):
            mesh.vertex_of(index)
    if repairs[:1] == [MERGE]:
        places = {tuple(place) for place in mesh.vertices.tolist()}
        assert there.tolist() == [tuple(place) in places for place in raw.vertices.tolist()]


def test_merged_vertices_have_one_value_on_the_whole_file(raw: Mesh) -> None:
    mesh = mv.repair_mesh(raw, MERGE, LARGEST)
    values = np.arange(mesh.n_vertices, dtype=np.float32)
    whole = mesh.on_file(values)
    assert whole.dtype == np.float32
    n = shapes.icosphere(2).n_vertices
    first, again = whole[45 : 45 + n], whole[45 + n :]
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, values)
    assert np.isnan(whole[:45]).all()
    assert np.isnan(mesh.on_file(np.arange(mesh.n_vertices))[:45]).all()  # also of integers
    assert raw.on_file(values) is values


@TOUCHES
def test_the_numbers_stay_in_another_unit_or_voxel_and_on_another_shape(raw: Mesh) -> None:
    mesh = mv.repair_mesh(raw, DROP, LARGEST)
    for other in (mesh.in_unit("nm"), mesh.in_voxels((4.0, 4.0, 40.0), "nm")):
        np.testing.assert_array_equal(other.file_indices, mesh.file_indices)


def test_a_map_of_the_file_goes_with_the_vertices_that_are_left(raw: Mesh) -> None:
    mesh = mv.repair_mesh(raw, DROP, MERGE, LARGEST)
    height = mv.VertexMap("height", raw.vertices[:, 2])
    added = mesh.with_maps(height).maps[0]
    np.testing.assert_array_equal(added.values, mesh.vertices[:, 2])
    carried = mv.repair_mesh(raw.with_maps(height), DROP, MERGE, LARGEST).maps[0]
    np.testing.assert_array_equal(carried.values, added.values)


@pytest.fixture
def repaired(raw: Mesh) -> Mesh:
    return mv.repair_mesh(raw, MERGE, LARGEST)


def exported(mesh: Mesh) -> Features:
    return Features(mesh.vertices.copy(), ("x", "y", "z"), kind="hks")


def rows_of(path: Path) -> Any:
    """Return indices and values of the rows of a file, read by the libraries of its format."""
    match path.suffix:
        case ".csv" | ".parquet":
            read = pyarrow.csv.read_csv if path.suffix == ".csv" else pyarrow.parquet.read_table
            table = read(path).to_pydict()
            return table["vertex"], [table[name] for name in "xyz"]
        case ".npz":
            with np.load(path) as archive:
                indices = archive.get("vertex")
                return indices, archive["features"].T
        case ".npy":
            return listed(json.loads(path.with_name(f"{path.name}.json").read_text())), np.load(
                path
            ).T
        case ".gii":
            image = nibabel.load(path)
            return listed(json.loads(image.meta["meshmash-viewer"])), [
                each.data for each in image.darrays
            ]
        case ".ply":
            read = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
            return read["vertex"] if "vertex" in read.dtype.names else None, [
                read[name] for name in "xyz"
            ]
        case ".vtp":
            poly = pyvista.read(path)
            indices = poly.point_data.get("vertex")
            return indices, poly.points.T
    raise AssertionError(path)


def listed(made: dict[str, Any]) -> list[int] | None:
    ranges = made.get("rows")
    return None if ranges is None else [at for start, stop in ranges for at in range(start, stop)]


FORMATS = [".csv", ".parquet", ".npz", ".npy", ".func.gii", ".vtp", ".ply"]


@pytest.mark.parametrize("ending", FORMATS)
def test_rows_of_every_format_have_the_indices_of_the_file(
    raw: Mesh, repaired: Mesh, tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"features{ending}"
    write_features(path, exported(repaired), repaired)
    indices, columns = rows_of(path)
    np.testing.assert_allclose(raw.vertices[indices].T, columns, rtol=1e-6, atol=1e-6)

    # On the whole file, each row is a vertex of the file.
    write_features(path, exported(repaired).on_file(repaired), raw)
    indices, columns = rows_of(path)
    assert indices is None or list(indices) == list(range(raw.n_vertices))
    if ending not in (".vtp", ".ply"):
        values = np.array(columns, dtype=float)
        there = ~np.isnan(values[0])
        np.testing.assert_allclose(raw.vertices[there].T, values[:, there], rtol=1e-6)
        assert there.sum() > repaired.n_vertices  # merged vertices are two rows


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("ending", slow_but([".npz"], [".csv", ".parquet", ".npz"]))
def test_a_table_after_a_repair_is_read_onto_the_file_again(
    raw: Mesh, repaired: Mesh, tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"features{ending}"
    write_features(path, exported(repaired), repaired)
    for mesh in (raw, repaired, mv.repair_mesh(raw, MERGE)):
        found = mesh.with_maps(*read_maps(path, mesh)).maps[0]
        there = ~np.isnan(found.values)
        assert there.sum() == len(np.intersect1d(mesh.file_indices, repaired.file_indices))
        np.testing.assert_allclose(found.values[there], mesh.vertices[there, 0])
    with raises("vertex-out-of-range"):
        read_maps(path, shapes.icosphere(2))


def test_eigenpairs_and_meshes_say_which_vertices_they_have(
    raw: Mesh, repaired: Mesh, tmp_path: Path
) -> None:
    L, M = mv.cotangent_laplacian(repaired)
    pairs = mv.solve(L, M, 5)
    path = tmp_path / "pairs.npz"
    write_eigenpairs(path, pairs, repaired)
    with np.load(path) as archive:
        np.testing.assert_array_equal(archive["vertex"], repaired.file_indices)
    whole = pairs.on_file(repaired)
    there = whole.mass > 0.0
    np.testing.assert_array_equal(np.flatnonzero(there), repaired.file_indices)
    gram = whole.eigenvectors[there].T @ (whole.mass[there, None] * whole.eigenvectors[there])
    np.testing.assert_allclose(gram, np.eye(5), atol=1e-9)
    write_eigenpairs(path, whole, raw)
    with np.load(path) as archive:
        assert "vertex" not in archive
        assert archive["eigenvectors"].shape == (raw.n_vertices, 5)
    write_mesh(tmp_path / "mesh.npz", repaired)
    with np.load(tmp_path / "mesh.npz") as archive:
        np.testing.assert_array_equal(archive["vertex"], repaired.file_indices)
    again = mv.read_mesh(tmp_path / "mesh.npz")
    assert (again.content_hash, again.maps, again.numbering) == (repaired.content_hash, (), None)


def test_distances_are_named_by_the_file(repaired: Mesh) -> None:
    L, M = mv.cotangent_laplacian(repaired)
    pairs = mv.solve(L, M, 5)
    found = mv.distance_features(repaired, repaired.vertex_of(60), "biharmonic", pairs)
    assert found.columns == ("biharmonic_from_60",)
    assert found.meta["vertices"] == [60]


def test_the_truncation_error_comes_to_the_whole_file(repaired: Mesh) -> None:
    L, M = mv.cotangent_laplacian(repaired)
    hks = mv.compute_features(mv.solve(L, M, 9), mv.heat_kernel_bank([0.1, 1.0]), warn=False)
    whole = hks.on_file(repaired)
    for one, other in zip(
        hks.truncation_at_vertices(), whole.truncation_at_vertices(), strict=True
    ):
        np.testing.assert_array_equal(repaired.on_file(one), other)
