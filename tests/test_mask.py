"""Solves on a mask of vertices, equal to solves on the mesh of the faces within the mask."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import shapes
import trimesh
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.errors import UnprovenWarning
from meshmash_viewer.spectral.certificate import Certificate

pytestmark = pytest.mark.usefixtures("read_here")

COUNT = 12


def masks() -> list[tuple[str, mv.Mesh, np.ndarray]]:
    """Return meshes with masks: a half, a band, several parts, loose or random vertices."""
    blob = shapes.blob(2)
    x, _, z = blob.vertices.T
    torus = trimesh.creation.torus(2.0, 0.7, major_sections=24, minor_sections=12)
    ring = mv.Mesh(torus.vertices, torus.faces)
    parted = np.abs(ring.vertices[:, 0]) > 1.0
    loose = np.zeros(blob.n_vertices, dtype=bool)
    loose[blob.vertices[:, 0] > 0.2] = True
    loose[[150, 155]] = True  # in no face of the mask
    random = np.random.default_rng(2).random(blob.n_vertices) < 0.9
    return [
        ("half", blob, z > 0.0),
        ("band", blob, np.abs(x) < 0.5),
        ("two parts", ring, parted),
        ("loose", blob, loose),
        ("random", blob, random),
    ]


@pytest.mark.parametrize(("mesh", "mask"), [pytest.param(*each, id=n) for n, *each in masks()])
def test_a_mask_is_the_mesh_of_its_faces_alone(mesh: mv.Mesh, mask: np.ndarray) -> None:
    faces = mesh.faces[mask[mesh.faces].all(axis=1)]
    kept, inverse = np.unique(faces, return_inverse=True)
    alone = mesh.vertices[kept], inverse.reshape(faces.shape)
    stiffness, mass = mv.cotangent_laplacian(alone, robust=True)
    expected, vectors = scipy.linalg.eigh(stiffness.toarray(), mass.toarray())
    values, found = mv.decompose_mesh(mesh, COUNT, mask=mask)
    assert found.shape == (mesh.n_vertices, COUNT)
    outside = np.setdiff1d(np.arange(mesh.n_vertices), kept)
    assert np.isnan(found[outside]).all()
    np.testing.assert_allclose(values, expected[:COUNT], rtol=1e-9, atol=1e-9 * expected[COUNT])
    gap = COUNT + int(np.argmax(np.diff(expected[COUNT - 1 : COUNT + 8])))
    top = float(expected[gap - 1] + expected[gap]) / 2.0

    def vanishing(values: np.ndarray) -> np.ndarray:
        return np.stack([np.maximum(1.0 - values / top, 0.0) ** power for power in (4, 6)])

    expected_features = np.square(vectors[:, :gap]) @ vanishing(expected[:gap]).T
    result = mv.spectral_geometry_filter(mesh, vanishing, top, drop_first=False, mask=mask)
    np.testing.assert_allclose(result[kept], expected_features, rtol=1e-8)
    assert np.isnan(result[outside]).all()


def test_all_vertices_are_the_whole_mesh() -> None:
    mesh = shapes.blob(2)
    whole = np.ones(mesh.n_vertices, dtype=bool)
    assert mesh.masked(whole) is mesh
    expected = mv.compute_geometry_vectors(mesh, count=20, n_components=4)
    found = mv.compute_geometry_vectors(mesh, count=20, n_components=4, mask=whole)
    np.testing.assert_array_equal(found, expected)


def test_the_proof_names_the_mask(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = shapes.blob(2)
    half = mesh.vertices[:, 2] > 0.0
    said = f"on the mask of {len(np.unique(mesh.masked(half).faces)):,} of 162 vertices only"
    mv.compute_hks(mesh, count=9, mask=half, verbose=True)
    assert said in capsys.readouterr().err
    mv.compute_hks(mesh, count=9, verbose=True)
    assert "on the mask" not in capsys.readouterr().err
    monkeypatch.setattr(Certificate, "lacks", ("a reason",))
    with pytest.warns(UnprovenWarning, match=f"not proven complete: a reason.*{said}$"):
        mv.decompose_mesh(mesh, 9, mask=half)


def test_the_store_distinguishes_masks() -> None:
    mesh = shapes.blob(2)
    half = mesh.masked(mesh.vertices[:, 2] > 0.0)
    assert half.content_hash != mesh.content_hash
    assert half.content_hash != mesh.masked(mesh.vertices[:, 2] > 0.1).content_hash


@pytest.mark.parametrize(
    ("mask", "code", "word"),
    [
        (np.ones(5, dtype=bool), "wrong-shape", "bool and shape (5,)"),
        (np.ones(162), "wrong-shape", "type float64"),
        (np.zeros(162, dtype=bool), "no-faces", "0 vertices and no whole face"),
        (np.arange(162) == 3, "no-faces", "1 vertex and no whole face"),
    ],
)
def test_what_is_no_mask_is_one_sentence(mask: np.ndarray, code: str, word: str) -> None:
    with raises(code, word):
        mv.decompose_mesh(shapes.blob(2), 5, mask=mask)


def test_a_mask_goes_with_a_mesh() -> None:
    matrices = mv.cotangent_laplacian(shapes.blob(2))
    with raises("wrong-type", "give the mesh itself"):
        mv.compute_hks(matrices, count=5, mask=np.ones(162, dtype=bool))


LOBES = (mv.Label(1, "front", "#aa0000"), mv.Label(2, "back", "#00aa00"))


@pytest.mark.parametrize(
    ("labels", "named", "expected"),
    [
        (LOBES, "front", [1, 0, 0, 1]),
        (LOBES, "2", [0, 1, 0, 0]),
        (LOBES, "front, back", [1, 1, 0, 1]),
        (LOBES, "-front", [0, 1, 1, 0]),
        (LOBES[:1], "", [1, 0, 0, 1]),
        ((), "", [1, 1, 0, 1]),
    ],
)
def test_labels_and_values_are_masks(
    labels: tuple[mv.Label, ...], named: str, expected: list[int]
) -> None:
    found = mv.VertexMap("lobe", np.array([1.0, 2.0, 0.0, 1.0]), labels=labels).mask(named)
    np.testing.assert_array_equal(found, np.array(expected, dtype=bool))


@pytest.mark.parametrize(
    ("named", "code", "word"),
    [("top", "unknown-name", "front, back"), ("", "missing-argument", "front, back")],
)
def test_a_label_that_is_none_is_one_sentence(named: str, code: str, word: str) -> None:
    with raises(code, word):
        mv.VertexMap("lobe", np.array([1.0, 2.0, 0.0, 1.0]), labels=LOBES).mask(named)


def test_one_of_several_maps_is_named(tmp_path: Path) -> None:
    mesh, file = shapes.blob(2), tmp_path / "maps.npz"
    x, _, z = mesh.vertices.T
    np.savez(file, left=x < 0.0, top=z > 0.0)
    np.testing.assert_array_equal(mv.read_mask(f"{file}:top", mesh), z > 0.0)
    with raises("ambiguous-content", "name one after a colon, of left, top"):
        mv.read_mask(file, mesh)


def test_a_condition_on_values_is_a_mask(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh, file, height = shapes.blob(2), tmp_path / "body.npz", tmp_path / "height.npy"
    x, _, z = mesh.vertices.T
    np.savez(file, vertices=mesh.vertices, faces=mesh.faces)
    np.save(height, np.where(x > 1.0, np.nan, z))
    np.savez(tmp_path / "maps.npz", left=x, top=z)
    inside = x <= 1.0
    for how, expected in ((">0", z > 0.0), ("<= -1e-1", z <= -0.1), (">=.25", z >= 0.25)):
        found = mv.read_mask(f"{height}{how}", mesh)
        np.testing.assert_array_equal(found, expected & inside)
        np.testing.assert_array_equal(mv.read_mask(f"{tmp_path}/maps.npz:top{how}", mesh), expected)
    given, out = f"{height}>0.1", str(tmp_path / "out.npz")
    asked = ["features", str(file), "--kind", "hks", "--count", "9", "-o", out, "--mask"]
    assert main([*asked, given]) == 0
    assert "orthonormality" in (said := capsys.readouterr().out)
    assert f" · on the mask {given} only" in said
    assert main([*asked, f"{height}>"]) == 2


def test_features_on_a_mask_from_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = shapes.blob(2)
    file, out, labels = (tmp_path / name for name in ("body.npz", "out.npz", "labels.csv"))
    np.savez(file, vertices=mesh.vertices, faces=mesh.faces)
    half = mesh.vertices[:, 2] > 0.0
    np.savetxt(labels, half.astype(int), fmt="%d", header="half", comments="")
    asked = ["features", str(file), "--kind", "hks", "--count", "10", "-o", str(out)]
    assert main([*asked, "--mask", str(labels)]) == 0
    assert "in no face of the mask" in capsys.readouterr().err
    with np.load(out) as archive:
        values, about = archive["features"], json.loads(str(archive["meta"]))
    assert about["options"]["mask"] == str(labels)
    assert len(values) == mesh.n_vertices
    assert np.isnan(values[~half]).all()
    assert np.isfinite(values[half]).any()
    assert main([*asked, "--mask", f"{labels}:front"]) == 2
    said = capsys.readouterr().err
    assert (said.count("\n"), "no label 'front'" in said) == (1, True)
    assert main([*asked, "--mask", str(tmp_path / "none.label")]) == 2
