"""Files of class models: round trips, and refusal of other or damaged content."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from faults import raises
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.learn.classes import ClassModel

LABELS = (mv.Label(1, "bump", "#4477aa"), mv.Label(2, "rest", "#ee6677"))
CARD = "meshmash-viewer.json"


class Other:
    """A type that class models may not contain."""


@pytest.fixture(scope="module")
def blob() -> mv.Mesh:
    mesh = shapes.blob(2)
    return mv.Mesh(mesh.vertices, mesh.faces, "nm", "blob")


@pytest.fixture(scope="module")
def labels(blob: mv.Mesh) -> mv.VertexMap:
    return mv.VertexMap("part", np.where(blob.vertices[:, 0] > 0.5, 1, 2), labels=LABELS)


@pytest.fixture(scope="module", params=["ensemble", slow("forest"), "logistic"])
def model(request: pytest.FixtureRequest, blob: mv.Mesh, labels: mv.VertexMap) -> ClassModel:
    columns = mv.ClassColumns(0.03, 1.0, 20.0, "nm", kinds=("hks", "curvature"), n_times=6)
    return mv.train_classes(blob, labels, columns, request.param, smoothing=0.1, scored=False)


@pytest.fixture
def path(tmp_path: Path, model: ClassModel) -> Path:
    path = tmp_path / "model.skops"
    mv.write_classes(path, model)
    return path


def with_card(path: Path, change: Any) -> Path:
    """Return a copy of a model file in which `change` has edited the JSON card."""
    copy = path.with_name("changed.skops")
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(copy, "w") as other:
        for name in archive.namelist():
            content = archive.read(name)
            if name == CARD:
                card = json.loads(content)
                change(card)
                content = json.dumps(card).encode()
            other.writestr(name, content)
    return copy


def test_a_model_is_read_as_it_was_written(blob: mv.Mesh, model: ClassModel, path: Path) -> None:
    found = mv.read_classes(path)
    assert (found.columns, found.classes, found.kind) == (model.columns, LABELS, model.kind)
    assert (found.meshes, found.smoothing) == (model.meshes, 0.1)
    np.testing.assert_array_equal(found.importance, model.importance)
    before, after = mv.predict_classes(blob, model), mv.predict_classes(blob, found)
    for each, other in zip(before.maps, after.maps, strict=True):
        np.testing.assert_array_equal(each.values, other.values)


@pytest.mark.parametrize("model", ["logistic"], indirect=True)
def test_the_card_is_json_in_the_archive(blob: mv.Mesh, path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        assert not [name for name in archive.namelist() if "pickle" in name or "pkl" in name]
        card = json.loads(archive.read(CARD))
    assert card["columns"]["unit"] == "nm"
    assert card["columns"]["operator"] == {"robust": True, "mollify_factor": 1e-5}
    assert card["meshes"][0]["hash"] == blob.content_hash
    assert card["classes"][0] == {"key": 1, "name": "bump", "color": "#4477aa"}
    assert "scikit-learn" in card["versions"]
    assert card["transformation"]["hks"].startswith("logarithm")


@pytest.mark.parametrize("model", ["logistic"], indirect=True)
@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda card: card.update(format=2), "wrong-version"),
        (lambda card: card["versions"].update({"scikit-learn": "0.9.1"}), "wrong-version"),
        (lambda card: card.pop("columns"), "file-damaged"),
        (lambda card: card["columns"].update(kinds=["heat"]), "file-damaged"),
        (lambda card: card["classes"].pop(), "file-damaged"),
        (lambda card: card["columns"].update(n_times=3), "file-damaged"),
        (lambda card: card["meshes"][0].update(median_edge=0.0), "file-damaged"),
        (lambda card: card["meshes"][0].update(median_edge="wide"), "file-damaged"),
    ],
)
def test_other_cards_are_refused(path: Path, change: Any, code: str) -> None:
    with raises(code):
        mv.read_classes(with_card(path, change))


@pytest.mark.parametrize("model", ["logistic"], indirect=True)
def test_a_card_of_an_earlier_version_has_no_edges(blob: mv.Mesh, path: Path) -> None:
    old = mv.read_classes(with_card(path, lambda card: card["meshes"][0].pop("median_edge")))
    assert mv.predict_classes(blob, old).remarks == ()


@pytest.mark.parametrize("model", ["logistic"], indirect=True)
def test_another_type_is_refused_by_its_name(path: Path, model: ClassModel) -> None:
    other = Other()
    other.value = 1  # type: ignore[attr-defined]
    model.classifier.other = other
    try:
        mv.write_classes(path, model)
    finally:
        del model.classifier.other
    with raises("untrusted-content"):
        mv.read_classes(path)


def test_a_tree_that_leads_out_of_itself_is_refused(
    tmp_path: Path, blob: mv.Mesh, labels: mv.VertexMap
) -> None:
    """A decision tree with a child index out of range would read memory outside the tree."""
    columns = mv.ClassColumns(0.03, 1.0, 20.0, "nm", n_times=6)
    model = mv.train_classes(blob, labels, columns, scored=False)
    tree = model.classifier.estimators_[0].estimators_[7].tree_
    state = tree.__getstate__()
    state["nodes"]["right_child"][0] = 10**9
    tree.__setstate__(state)
    mv.write_classes(tmp_path / "bad.skops", model)
    with raises("file-damaged"):
        mv.read_classes(tmp_path / "bad.skops")


@pytest.mark.parametrize("content", [b"hello", b"", b"PK\x05\x06" + 18 * b"\0"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.skops"
    path.write_bytes(content)
    with raises("wrong-format" if content else "file-empty"):
        mv.read_classes(path)


@pytest.mark.parametrize("model", ["logistic"], indirect=True)
def test_models_have_one_ending(tmp_path: Path, model: ClassModel) -> None:
    with raises("unknown-ending"):
        mv.write_classes(tmp_path / "model.pkl", model)
    with raises("file-not-found"):
        mv.read_classes(tmp_path / "none.skops")
