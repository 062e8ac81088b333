"""Label sets in every format: names, colours and unlabelled vertices survive a round trip."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import nibabel
import nibabel.freesurfer
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import shapes
import trimesh
from faults import raises

import meshmash_viewer as mv
from meshmash_viewer.errors import InputError
from meshmash_viewer.io.pins import is_pin_table
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.writers import LABEL_WRITERS

MESH = replace(shapes.icosphere(3), unit="mm", structure="CortexLeft")
N = MESH.n_vertices
LABELS = (
    mv.Label(7, "Größe, π", "#4477aa"),
    mv.Label(3, "none", "#ee6677"),
    mv.Label(12, "007", "#228833"),
    mv.Label(5, "without a vertex", "#ccbb44"),
)
VALUES = np.array([7, 3, 12, 0])[np.arange(N) % 4]
SET = mv.VertexMap("compartments", VALUES, LABELS)
#: Formats that store labels used by no vertex.
HOLD_ALL = (".label.gii", ".npz", ".ply")

pytestmark = pytest.mark.usefixtures("read_here")


def names(found: mv.VertexMap) -> list[str]:
    """Return the label name of each vertex, "" for unlabelled vertices."""
    texts = {label.key: label.name for label in found.labels}
    return [texts.get(value, "") for value in found.values.tolist()]


@pytest.mark.parametrize("ending", [each for each in LABEL_WRITERS if each != ".label"])
def test_what_is_written_is_read(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"lh.set{ending}"
    mv.write_labels(path, SET, MESH)
    found = mv.read_labels(path, MESH)
    assert names(found) == names(SET)
    expected = LABELS if ending in HOLD_ALL else LABELS[:3]
    described = {(label.name, label.color) for label in found.labels}
    assert described == {(label.name, label.color) for label in expected}
    if ending != ".annot":  # an annotation renumbers its labels
        assert {label.key for label in found.labels} == {label.key for label in expected}
        np.testing.assert_array_equal(found.values, VALUES)
    if ending in (".npz", ".ply"):
        again = read_mesh(path)
        assert again == MESH
        assert names(again.maps[0]) == names(SET)
    assert not is_pin_table(path)


def test_other_libraries_read_them(tmp_path: Path) -> None:
    paths = {ending: tmp_path / f"lh.set{ending}" for ending in LABEL_WRITERS}
    for ending, path in paths.items():
        if ending != ".label":
            mv.write_labels(path, SET, MESH.with_maps(SET))
    image = nibabel.load(paths[".label.gii"])
    # Connectome Workbench shows key 0, "???", at unlabelled vertices
    expected = {each.key: each.name for each in LABELS} | {0: "???"}
    assert image.labeltable.get_labels_as_dict() == expected
    assert image.labeltable.labels[-1].alpha == 0.0
    assert image.darrays[0].meta["Name"] == SET.name
    np.testing.assert_array_equal(image.darrays[0].data, VALUES)
    assert image.darrays[0].intent == nibabel.nifti1.intent_codes["NIFTI_INTENT_LABEL"]
    assert image.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    red, green, blue, alpha = image.labeltable.labels[0].rgba
    assert [round(255 * share) for share in (red, green, blue, alpha)] == [0x44, 0x77, 0xAA, 255]

    places, table, texts = nibabel.freesurfer.read_annot(paths[".annot"])
    assert [text.decode() for text in texts] == [label.name for label in LABELS]
    expected = [["Größe, π", "none", "007", ""][at] for at in np.arange(N) % 4]
    assert [texts[at].decode() if at >= 0 else "" for at in places] == expected
    assert table[0, :3].tolist() == [0x44, 0x77, 0xAA]

    with paths[".csv"].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[1] == {"vertex": "1", "label": "3", "name": "none", "color": "#ee6677"}
    assert rows[3] == {"vertex": "3", "label": "0", "name": "", "color": ""}
    assert len(rows) == N
    stored = np.load(paths[".npz"])
    assert dict(zip(stored["label_numbers"].tolist(), stored["label_names"].tolist(), strict=True))[
        7
    ] == ("Größe, π")
    loaded = trimesh.load(paths[".ply"], process=False)
    np.testing.assert_array_equal(loaded.vertices, MESH.vertices)


def test_one_label_of_freesurfer(tmp_path: Path) -> None:
    path = tmp_path / "lh.none.label"
    with raises("several-labels", "can hold one label, and 'compartments' has 3 with"):
        mv.write_labels(path, SET, MESH)
    assert not path.exists()
    mv.write_labels(path, replace(SET, labels=LABELS[1:2]), MESH)
    inside, zeros = nibabel.freesurfer.read_label(path, read_scalars=True)
    np.testing.assert_array_equal(inside, np.flatnonzero(VALUES == 3))
    assert not zeros.any()
    np.testing.assert_allclose(
        np.loadtxt(path, skiprows=2)[:, 1:4], MESH.vertices[inside], rtol=1e-8
    )
    found = mv.read_labels(path, MESH)
    assert found.mask().sum() == len(inside)


@pytest.mark.parametrize("ending", [".label.gii", ".annot", ".csv", ".npz", ".ply"])
def test_after_a_repair_labels_are_those_of_the_file(ending: str, tmp_path: Path) -> None:
    loose = mv.Mesh(np.vstack([[9.0, 9.0, 9.0], MESH.vertices]), MESH.faces + 1)
    mesh = mv.repair_mesh(loose, "drop_unreferenced_vertices")
    mv.write_labels(tmp_path / f"lh.set{ending}", SET, mesh)
    if ending != ".ply":  # a PLY file stores the repaired mesh
        on_file = mv.read_labels(tmp_path / f"lh.set{ending}", loose)
        assert names(on_file) == ["", *names(SET)]
    assert names(mv.read_labels(tmp_path / f"lh.set{ending}", mesh)) == names(SET)


def test_tables_of_other_programs(tmp_path: Path) -> None:
    texts = np.array(["spine", "shaft", ""])[np.arange(N) % 3]
    rows = [f"{vertex},{text}" for vertex, text in enumerate(texts)][::-1]
    (tmp_path / "text.csv").write_text("\n".join(["vertex,label", *rows]), encoding="utf-8")
    found = mv.read_labels(tmp_path / "text.csv", MESH)
    assert names(found) == texts.tolist()
    assert len({label.color for label in found.labels}) == 2
    columns = {"label": VALUES, "colour": np.where(VALUES == 0, None, "#aa0000")}
    pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "colour.parquet")
    found = mv.read_labels(tmp_path / "colour.parquet", MESH)
    assert {(each.name, each.color) for each in found.labels} == {
        (str(key), "#aa0000") for key in (3, 7, 12)
    }
    (tmp_path / "pins.csv").write_text("index,label,color\n3,soma,#aa0000\n", encoding="utf-8")
    assert is_pin_table(tmp_path / "pins.csv")
    # a column of numbers without names is read as values, not as labels
    np.savetxt(tmp_path / "plain.csv", VALUES, header="label", comments="", fmt="%d")
    assert mv.read_labels(tmp_path / "plain.csv", MESH).labels == ()


def test_faults_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "set.csv"
    rows = {
        "1,a,#aa0000\n1,b,#aa0000": r"set\.csv: Map 'label' has two texts in the column name for"
        r" the label 1: give each label one\.",
        "1,a,red\n2,b,#aa0000": "Map 'label' has the colour 'red': write it as #rrggbb",
        "1,a,#aa0000\n2,b,#bb0000": "has 2 values and the mesh 642 vertices",
        "1.5,a,#aa0000\n2,b,#bb0000": "labels that are no whole numbers",
    }
    for content, message in rows.items():
        path.write_text(f"label,name,color\n{content}\n", encoding="utf-8")
        with pytest.raises(InputError, match=message):
            mv.read_labels(path, MESH)
    cases = [
        (mv.VertexMap("height", MESH.vertices[:, 2].copy()), "Map 'height' has no labels"),
        (mv.VertexMap("few", [1, 1], LABELS), "has 2 values and the mesh 642 vertices"),
        (replace(SET, labels=(mv.Label(2**40, "big", "#aa0000"),)), "number 1099511627776"),
        (replace(SET, labels=(mv.Label(3, "red", "red"),)), "the colour 'red': write it"),
    ]
    for labels, message in cases:
        with pytest.raises(InputError, match=message):
            mv.write_labels(path, labels, MESH)
    with raises("unknown-ending"):
        mv.write_labels(tmp_path / "set.vtp", SET, MESH)
