"""The commands `train` and `predict`."""

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


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write two labelled meshes, the second in another unit and order of vertices."""
    monkeypatch.setattr("meshmash_viewer.io.cache.default_cache_folder", lambda: tmp_path / "cache")
    monkeypatch.chdir(tmp_path)
    mesh = shapes.blob(2)
    first = mv.Mesh(mesh.vertices, mesh.faces, "nm", "A")
    copy, there = shapes.moved_copy(first, 1e-3)
    parts = np.where(first.vertices[:, 0] > 0.5, 1, 2)
    moved = np.zeros_like(parts)
    moved[there] = parts
    write_mesh("A.ply", first)
    write_mesh("B.ply", mv.Mesh(copy.vertices, copy.faces, "µm", "B"))
    labels = (mv.Label(1, "bump", "#4477aa"), mv.Label(2, "rest", "#ee6677"))
    mv.write_labels("A.label.gii", mv.VertexMap("part", parts, labels=labels), first)
    np.savetxt("B.csv", moved, fmt="%d", header="part", comments="")
    np.savetxt("halves.csv", moved * 0.5, fmt="%.1f", header="part", comments="")
    return tmp_path


TRAIN = ("train", "A.ply", "--labels", "A.label.gii", "--t-min", "0.03", "--t-max", "1",
         "--max-eigenvalue", "20", "--n-components", "8", "-o", "model.skops")  # fmt: skip


@pytest.mark.slow
def test_train_on_two_meshes_and_predict_both(capsys: pytest.CaptureFixture[str]) -> None:
    more = ("B.ply", "--labels", "B.csv", "--kind", "hks", "--kind", "curvature")
    assert main([*TRAIN, *more]) == 0
    said = capsys.readouterr().out
    assert "2 classes from 324 vertices with labels of 2 meshes" in said
    assert "with whole meshes left out" in said
    model = mv.read_classes("model.skops")
    assert model.names == ("bump", "rest")
    assert [each["unit"] for each in model.meshes] == ["nm", "µm"]
    assert main(["predict", "*.ply", "--model", "model.skops", "-o", "out/"]) == 0
    assert "out/A.npz: bump" in capsys.readouterr().out
    found = np.load("out/A.npz")
    assert found["columns"].tolist()[0] == "class"
    truth = np.where(mv.read_mesh("A.ply").vertices[:, 0] > 0.5, 1, 2)
    assert np.mean(found["features"][:, 0] == truth) > 0.95
    np.testing.assert_allclose(found["features"][:, 1:3].sum(axis=1), 1.0, rtol=1e-6)
    assert Path("out/B.npz").exists()


def test_labels_alone_keep_names_and_colours(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*TRAIN, "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert card["columns"]["max_eigenvalue"] == 20.0
    assert "There are no scores yet" in card["unscored"]
    assert main(["predict", "B.ply", "--model", "model.skops", "-o", "B.label.gii"]) == 0
    (labels,) = mv.read_maps("B.label.gii", mv.read_mesh("B.ply"))
    assert [each.color for each in labels.labels] == ["#4477aa", "#ee6677"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((*TRAIN, "B.ply"), "There are 2 meshes and 1 --labels"),
        ((*TRAIN, "B.ply", "--labels", "halves.csv"), "halves.csv: 'part' has values that are no"),
        (
            (*TRAIN, "B.ply", "--labels", "B.csv", "--mask", "B.csv"),
            "--mask applies to a single mesh",
        ),
        ((*TRAIN[:-1], "model.pkl"), "end it in .skops"),
        ((*TRAIN[:-1], "none/model.skops"), "no folder none"),
        (("predict", "A.ply", "--model", "none.skops", "-o", "a.csv"), "none.skops does not exist"),
    ],
)
def test_what_does_not_do_is_one_line(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, said, *arguments)
