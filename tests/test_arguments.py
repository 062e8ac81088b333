"""Arguments as notebooks hold them: an unusual type is accepted exactly, or refused in words."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
import shapes
import trimesh
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.errors import InputError
from meshmash_viewer.pieces import aggregate_features

MESH = shapes.icosphere(1)
VERTICES, FACES = MESH
N = MESH.n_vertices
FEATURES = mv.Features(np.ones((N, 1)), ("one",))
NO_NUMBERS = (None, "5", [5, 6], np.array([5]), {}, pandas.NA)


@pytest.mark.parametrize("given", [*NO_NUMBERS, 3.0, 3.5, np.nan, True], ids=repr)
def test_a_vertex_is_a_whole_number(given: Any) -> None:
    with raises("vertex-out-of-range", "whole number from 0 to 41"):
        mv.GeodesicSolver(MESH).from_vertex(given)


@pytest.mark.parametrize("given", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize(
    "call",
    [
        lambda given: mv.decompose_mesh(MESH, n_components=given),
        lambda given: mv.decompose_laplacian(*mv.cotangent_laplacian(MESH), n_components=given),
        lambda given: mv.compute_hks(MESH, 10.0, band_size=given),
        lambda given: mv.compute_hks(MESH, max_eigenvalue=given),
        lambda given: mv.compute_geometry_vectors(MESH, n_components=given, max_eigenvalue=5.0),
    ],
)
def test_counts_and_limits_are_numbers(call: Callable[[Any], Any], given: Any) -> None:
    with raises("out-of-range"):
        call(given)


@pytest.mark.parametrize(
    "given", [np.int32(5), 5.0, np.float32(5), np.array(5), np.uint64(5)], ids=repr
)
def test_numbers_of_other_types_are_numbers(given: Any) -> None:
    assert len(mv.decompose_mesh(MESH, n_components=given)[0]) == 5


@pytest.mark.parametrize(
    "faces",
    [
        FACES.astype(object),
        pandas.DataFrame(FACES).astype("Int64"),
        np.array([list(face) for face in FACES], dtype=object),
        np.ma.masked_array(FACES, False),
        FACES.astype(">u2"),
    ],
)
def test_faces_of_other_types_are_the_same_mesh(faces: Any) -> None:
    assert mv.Mesh(VERTICES, faces) == MESH


@pytest.mark.parametrize(
    "faces",
    [
        [[0, 1, 2], [1, 2]],
        np.ma.masked_array(FACES, FACES == 3),
        pandas.DataFrame(FACES).astype("Int64").mask(FACES == 3),
        np.where(FACES == 3, None, FACES),
        FACES.astype(object) + 0.5,
        FACES.astype(str),
        FACES.astype("m8[s]"),
        FACES == 3,
        {},
    ],
)
def test_invalid_faces_are_refused(faces: Any) -> None:
    with pytest.raises(InputError):
        mv.Mesh(VERTICES, faces)


@pytest.mark.parametrize(
    "vertices",
    [
        np.ma.masked_array(VERTICES, VERTICES[3] == VERTICES),
        np.ma.masked_array(np.rint(VERTICES).astype(int), VERTICES[3] == VERTICES),
        VERTICES.astype(int).astype("M8[s]"),
        VERTICES.astype(int).astype("m8[s]"),
        pandas.DataFrame(VERTICES).astype("Float64").mask(VERTICES[3] == VERTICES),
    ],
)
def test_masked_coordinates_and_times_are_refused(vertices: Any) -> None:
    with pytest.raises(InputError):
        mv.Mesh(vertices, FACES)


@pytest.mark.parametrize("kind", [float, np.float32, int])
def test_masked_values_of_a_map_are_missing(kind: type) -> None:
    values = np.ma.masked_array(np.arange(N).astype(kind), np.arange(N) == 3)
    found = mv.VertexMap("a", values).values
    np.testing.assert_array_equal(found, np.where(np.arange(N) == 3, np.nan, np.arange(N)))


@pytest.mark.parametrize("labels", [{1: "soma"}, ["soma"], [(1, "soma", "#ffffff")]])
def test_labels_of_a_map_are_label_objects(labels: Any) -> None:
    with raises("wrong-type"):
        mv.VertexMap("a", np.ones(N), labels)


@pytest.mark.parametrize("path", [None, b"a.ply", io.BytesIO(b"ply"), MESH, trimesh.Trimesh(), 3])
def test_a_file_is_named_by_its_path(path: Any) -> None:
    with raises("wrong-type", "read_mesh reads a file, not an object of type"):
        mv.read_mesh(path)


@pytest.mark.parametrize("features", [None, FEATURES.values, FEATURES.to_frame(), "a.npz"])
def test_written_features_have_columns(tmp_path: Path, features: Any) -> None:
    with raises("wrong-type", "mv.Features(values, columns)"):
        mv.write_features(tmp_path / "a.npz", features, MESH)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("model", [None, "a.skops", FEATURES])
def test_a_model_is_no_path(model: Any) -> None:
    with raises("wrong-type", "or read_classes"):
        mv.predict_classes(MESH, model)


@pytest.mark.parametrize("values", [["a"] * N, [None, "a"] * (N // 2), [[1, 2], [3]] * (N // 2)])
def test_features_of_domains_are_numbers(values: Any) -> None:
    with raises("wrong-type"):
        aggregate_features(values, np.zeros(N, int))


@pytest.mark.parametrize("limit", [*NO_NUMBERS[1:], "0.5 µm", np.nan, -1])
def test_a_distance_is_a_number(limit: Any) -> None:
    with raises("out-of-range", "give a number from 0"):
        mv.project_points(MESH, VERTICES, limit)


def test_options_may_be_numpy_numbers_and_other_objects(tmp_path: Path) -> None:
    meta = {"count": np.int64(3), "times": np.arange(2.0), "kinds": {"b", "a"}, "at": Path("x.ply")}
    for ending in ("npz", "npy", "csv", "parquet", "vtp"):
        mv.write_features(tmp_path / f"a.{ending}", FEATURES, MESH, meta=meta)
    written = json.loads((tmp_path / "a.csv.json").read_bytes())["options"]
    wanted = {"count": 3, "times": [0.0, 1.0], "kinds": ["a", "b"], "at": "x.ply"}
    assert {name: written[name] for name in meta} == wanted
