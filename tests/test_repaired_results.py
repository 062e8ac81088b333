"""Results of a repaired mesh, numbered as its file: exports, the command line, scripts."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pytest
import shapes
from listeners import Listener
from solved import spectrum_of
from tiers import slow

import meshmash_viewer as mv
from meshmash_viewer.cli import main as cli
from meshmash_viewer.fields import EXPORTS
from meshmash_viewer.fields.distances import Distances
from meshmash_viewer.fields.similarity import Similarity
from meshmash_viewer.laplacian import OperatorOptions
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.model.decomposition import decompose
from meshmash_viewer.model.document import Document
from meshmash_viewer.model.export import Export
from meshmash_viewer.model.field import request_of
from meshmash_viewer.model.jobs import prepare
from meshmash_viewer.model.script import reproduction_script
from meshmash_viewer.spectral.weyl import Target

LARGEST, DROP, MERGE = (
    "keep_largest_component",
    "drop_unreferenced_vertices",
    "merge_coincident_vertices",
)

pytestmark = pytest.mark.usefixtures("read_here")


def save(mesh: Mesh, path: Path) -> Path:
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Write a small ball of 42 vertices, two loose vertices, and a larger ball of 162."""
    small, large = shapes.icosphere(1), shapes.icosphere(2)
    balls = shapes.together(shapes.moved(small, 9.0), np.full((2, 3), 4.0), large)
    return save(balls, tmp_path / "balls.npz")


def run(*arguments: object) -> int:
    return cli.main([str(each) for each in arguments])


def table(path: Path) -> dict[str, np.ndarray]:
    read = pyarrow.csv.read_csv(path).to_pydict()
    return {name: np.array(column, dtype=float) for name, column in read.items()}


@pytest.mark.parametrize(
    "repairs", [slow([LARGEST]), slow([DROP]), [DROP, LARGEST], [LARGEST, MERGE, DROP]]
)
def test_the_command_line_counts_as_the_file(
    path: Path, tmp_path: Path, repairs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [each for name in repairs for each in ("--repair", name)]
    common = ["features", path, *asked, "--kind", "distance", "--vertex", 50, "--count", 20]
    out, whole = tmp_path / "out.csv", tmp_path / "whole.csv"
    assert run(*common, "--distance", "biharmonic", "-o", out) == 0
    assert run(*common, "--distance", "biharmonic", "--whole-mesh", "-o", whole) == 0
    kept, all_of_them = table(out), table(whole)
    assert list(kept) == list(all_of_them) == ["vertex", "biharmonic_from_50"]
    np.testing.assert_array_equal(all_of_them["vertex"], np.arange(206))
    distances = all_of_them["biharmonic_from_50"]
    assert distances[50] == np.nanmin(distances) == 0.0
    rows = kept["vertex"].astype(int)
    np.testing.assert_array_equal(distances[rows], kept["biharmonic_from_50"])
    assert np.isnan(np.delete(distances, rows)).all()
    assert rows[-162:].tolist() == list(range(44, 206))
    made = json.loads(whole.with_name("whole.csv.json").read_text())
    assert (made["options"]["repairs"], made["options"]["whole_mesh"]) == (repairs, True)
    assert made["mesh"]["n_vertices"] == 206
    made = json.loads(out.with_name("out.csv.json").read_text())
    assert (made["mesh"]["n_file_vertices"], made["options"]["whole_mesh"]) == (206, False)

    capsys.readouterr()
    assert run(*common[:-4], "--vertex", 43, "-o", out) == 2
    assert "Vertex 43 was removed by a repair" in capsys.readouterr().err
    assert run(*common[:-4], "--vertex", 206, "-o", out) == 2
    assert "There is no vertex 206: give a whole number from 0 to 205" in capsys.readouterr().err


@pytest.fixture
def document(path: Path, tmp_path: Path) -> Document:
    document, listener = Document(), Listener(tmp_path)
    document.accept_mesh(prepare(path, listener).content)
    document.accept_mesh(prepare(document.mesh, listener, path=path, repairs=(LARGEST,)).content)
    spectrum = spectrum_of(document.mesh, 20)
    document.accept_spectrum(replace(spectrum, operator=OperatorOptions()))
    return document


@pytest.mark.parametrize(("kind", "family"), [("similarity", Similarity), ("distance", Distances)])
def test_what_is_shown_and_the_script_name_the_vertex_of_the_file(
    document: Document, tmp_path: Path, kind: str, family: Any
) -> None:
    assert document.mesh is not None
    document.display.change(family, vertex=document.mesh.vertex_of(50))
    document.display.kind = kind
    if kind == "distance":
        document.display.change(family, measure="biharmonic")
    request = request_of(document)
    assert request is not None
    assert request.description.quantity.startswith("from vertex 50")
    code = reproduction_script(document)
    assert "mv.repair_mesh(mesh, 'keep_largest_component')" in code
    assert "mesh.vertex_of(50)" in code
    made: dict[str, Any] = {}
    with contextlib.chdir(tmp_path):
        exec(code, made)
    assert int(np.argmin(made["values"])) == 50 - 44
    if kind == "similarity":
        saved = np.load(tmp_path / "balls_similarity.npy")
        assert (len(saved), int(np.nanargmin(saved))) == (206, 50)


def test_an_export_says_what_was_repaired_and_can_be_of_the_whole_mesh(
    path: Path, tmp_path: Path
) -> None:
    listener, operator = Listener(tmp_path), OperatorOptions()
    raw = mv.read_mesh(path, "8 nm")
    mesh = mv.repair_mesh(raw, LARGEST)
    decompose(mesh, operator, Target("count", 12), listener)
    # the mesh as read, without a voxel size
    numbers = mv.read_mesh(path)
    for family, n in ((EXPORTS["hks"].exported(3), 3), (EXPORTS["eigenpairs"].exported(), 12)):
        out = tmp_path / "out.npz"
        job = Export(mesh, operator, out, family, 12, repairs=(LARGEST,), file_mesh=numbers)
        remark = job(listener).remark
        assert "at all 206 vertices of the mesh file, written to" in remark
        assert remark.endswith("Repaired before: Keep the largest component.")
        with np.load(out) as archive:
            values = archive["features" if n == 3 else "eigenvectors"]
            np.testing.assert_array_equal(archive["vertices"], raw.vertices)
            meta = json.loads(str(archive["meta"]))
        assert values.shape == (206, n)
        assert (meta["mesh"]["hash"], meta["mesh"]["voxel"]) == (raw.content_hash, [8, 8, 8])
        np.testing.assert_array_equal(np.isfinite(values[:, 0]), np.arange(206) >= 44)
        plain = replace(job, file_mesh=None)(listener).remark
        assert "vertices" not in plain
        assert plain.endswith("Repaired before: Keep the largest component.")
        assert "Repaired" not in replace(job, repairs=())(listener).remark


def test_repairs_are_made_again_on_the_numbers_that_they_were_made_on(
    path: Path, tmp_path: Path
) -> None:
    listener = Listener(tmp_path)
    first = prepare(path, listener, unit="8 nm").content
    for unit in ("", "mm", "8 nm", "4 x 4 x 40 nm"):
        result = prepare(path, listener, unit=unit, repairs=(DROP, LARGEST), hashed=first.source)
        again = result.content
        assert (again.repairs, again.unasked, result.remark) == ((DROP, LARGEST), True, "")
        assert [mesh.n_vertices for mesh in (*again.before, again.mesh)] == [206, 204, 162]
        assert again.mesh.voxel == again.before[0].voxel
        assert again.mesh.file_index(0) == 44
    save(mv.Mesh(first.mesh.vertices * 1.01, first.mesh.faces), path)
    result = prepare(path, listener, unit="8 nm", repairs=(DROP, LARGEST), hashed=first.source)
    changed = result.content
    assert (changed.repairs, changed.before, changed.unasked) == ((), (), False)
    assert result.remark.startswith("balls.npz has changed since it was repaired")
    assert "Drop unreferenced vertices, Keep the largest component" in result.remark
    assert changed.mesh.n_vertices == 206
    result = prepare(path, listener, repairs=(LARGEST, "polish", DROP))  # from a session
    asked = result.content
    assert (asked.repairs, asked.unasked, asked.mesh.n_vertices) == ((LARGEST,), False, 162)
    assert result.remark.startswith("polish was not made again. There is no repair 'polish'")
