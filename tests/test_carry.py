"""The command `carry`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapes
from commands import refused

import meshmash_viewer as mv
from meshmash_viewer.cli.main import main
from meshmash_viewer.io.write import write_mesh

pytestmark = pytest.mark.usefixtures("read_here")

LABELS = (mv.Label(1, "bump", "#4477aa"), mv.Label(2, "rest", "#ee6677"))


@pytest.fixture(autouse=True)
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """Write a labelled mesh and a rotated, permuted copy; return the new index of each vertex."""
    monkeypatch.setattr("meshmash_viewer.io.cache.default_cache_folder", lambda: tmp_path / "cache")
    monkeypatch.chdir(tmp_path)
    mesh = shapes.blob(2)
    first = mv.Mesh(mesh.vertices, mesh.faces, "mm", "A")
    copy, there = shapes.moved_copy(first)
    write_mesh("A.ply", first)
    write_mesh("B.ply", mv.Mesh(copy.vertices, copy.faces, "mm", "B"))
    mv.write_labels("A.label.gii", mv.VertexMap("part", parts(first), labels=LABELS), first)
    np.savetxt("x.csv", first.vertices[:, 0], header="x", comments="")
    return there


def parts(mesh: mv.Mesh) -> np.ndarray:
    return np.where(mesh.vertices[:, 0] > 0.5, 1, 2)


def test_labels_and_maps_of_one_mesh_are_carried_to_others(
    there: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["carry", "A.ply", "B.ply", "--labels", "A.label.gii", "--count", "60"]
    assert main([*arguments, "--map", "x.csv", "-o", "out/", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["maps"] == ["part", "x"]
    assert report["mutual_share"] > 0.95
    first, found = mv.read_mesh("A.ply"), np.load("out/B.npz")
    assert found["columns"].tolist() == ["part", "x", "match score"]
    assert np.mean(found["features"][there, 0] == parts(first)) > 0.95
    near = np.abs(found["features"][there, 1] - first.vertices[:, 0]) < 1e-6
    assert near.mean() > 0.95
    assert (found["features"][:, 2] >= 0.0).all()
    # Workbench needs a structure: the message names the option.
    told = "states no brain structure, which Connectome Workbench needs: give --structure."
    for more, expected in (((), True), (("--structure", "left"), False)):
        assert main([*arguments, *more, "-o", "B.func.gii"]) == 0
        assert (f"B.func.gii {told}" in capsys.readouterr().err) == expected
    # A file of labels keeps names and colours.
    assert main([*arguments, "-o", "B.annot"]) == 0
    carried = mv.read_labels("B.annot", mv.read_mesh("B.ply"))
    named = {each.name: (each.key, each.color) for each in carried.labels}
    assert named["bump"][1] == "#4477aa"
    assert np.mean((carried.values == named["bump"][0])[there] == (parts(first) == 1)) > 0.95


def test_the_remedy_of_an_ambiguous_match_is_one_of_the_command_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    sphere = shapes.icosphere(2)
    write_mesh("S.ply", mv.Mesh(sphere.vertices * [1.0, 1.3, 1.7], sphere.faces))
    write_mesh("T.ply", shapes.icosphere(1))
    arguments = ["carry", "S.ply", "T.ply", "--map", "S.npy", "-o", "s.csv", "--count", "30"]
    np.save("S.npy", np.arange(162.0))
    assert main(arguments) == 2
    assert "give at least three pairs of corresponding vertices (--landmark)" in (
        capsys.readouterr().err
    )


def test_landmarks_decide_between_symmetric_matches(capsys: pytest.CaptureFixture[str]) -> None:
    sphere = shapes.icosphere(2)
    first = mv.Mesh(sphere.vertices * [1.0, 1.3, 1.7], sphere.faces)
    copy, there = shapes.moved_copy(first)
    write_mesh("S.ply", first)
    write_mesh("T.ply", copy)
    np.save("S.npy", np.arange(162.0))
    arguments = ["carry", "S.ply", "T.ply", "--map", "S.npy", "-o", "s.npy", "--count", "30"]
    # corners of the first octant, which no symmetry keeps
    for vertex in np.argmax(first.vertices @ [[1, 3, 1], [1, 1, 3], [3, 1, 1]], axis=0):
        arguments += ["--landmark", str(vertex), str(there[vertex])]
    assert main(arguments) == 0, capsys.readouterr().err
    assert np.mean(np.load("s.npy")[there, 0] == np.arange(162.0)) > 0.95
    assert main([*arguments, "--landmark", "162", "0"]) == 2
    assert "162" in capsys.readouterr().err
    write_mesh("U.ply", copy)
    assert main([*arguments[:3], "U.ply", *arguments[3:5], "-o", "out/", *arguments[7:]]) == 2
    assert "--landmark is for two meshes, not 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ("A.ply", "-o", "a.csv", "--labels", "A.label.gii"),
            "followed by the meshes that receive them",
        ),
        (("A.ply", "B.ply", "-o", "a.csv"), "A has no maps: name a file"),
        (("A.ply", "B.ply", "-o", "a.xyz", "--labels", "A.label.gii"), "a.xyz"),
        (("A.ply", "B.ply", "-o", "b.annot", "--map", "x.csv"), "no map has labels"),
    ],
)
def test_what_cannot_be_carried_is_one_sentence(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, said, "carry", *arguments, "--count", 20)
    assert not list(Path().glob("[ab].*"))
