"""Meshes rebuilt from their lowest eigenfunctions on the command line, and written meshes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapes
from tiers import slow_unless

from meshmash_viewer.cli.main import main
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.io.write import write_mesh
from meshmash_viewer.io.writers import MESH_WRITERS
from meshmash_viewer.mesh import Mesh


def rebuilt(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert main(["reconstruct", *arguments, "--json"]) == 0
    report: dict[str, object] = json.loads(capsys.readouterr().out)
    return report


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.ply"
    write_mesh(path, shapes.icosphere(3))
    return path


def test_a_sphere_is_its_first_four_eigenfunctions(
    ball: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "smooth.obj"
    report = rebuilt(capsys, str(ball), "--count", "4", "-o", str(out))
    # 642 vertices, whose areas differ by a tenth
    radii = np.linalg.norm(read_mesh(out).vertices, axis=1)
    np.testing.assert_allclose(radii, 1.0, atol=0.01)
    assert report["n_eigenpairs"] == 4
    assert report["rms_distance"] < 0.01
    assert report["rms_distance"] <= report["largest_distance"] < 0.02


def test_all_pairs_give_the_mesh_back_and_few_take_it_farther_away(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = shapes.icosphere(2)
    rough = replace(mesh, vertices=mesh.vertices * [[1.0, 2.0, 0.5]] + 7.0, unit="mm")
    path, out = tmp_path / "rough.npz", tmp_path / "out.npz"
    write_mesh(path, rough)
    distances = []
    for count in (8, 30, 100, rough.n_vertices):
        report = rebuilt(capsys, str(path), "--count", str(count), "-o", str(out))
        vertices = read_mesh(out).vertices
        moved = np.linalg.norm(vertices - rough.vertices, axis=1)
        assert report["largest_distance"] == pytest.approx(moved.max(), abs=1e-12)
        distances.append(report["rms_distance"])
    assert distances == sorted(distances, reverse=True)
    np.testing.assert_allclose(vertices, rough.vertices, atol=1e-8)
    with np.load(out) as archive:
        about = json.loads(str(archive["meta"]))
    assert about["options"]["kind"] == "reconstruction"
    assert about["options"]["target"] == {"kind": "count", "value": rough.n_vertices}
    assert about["mesh"]["unit"] == "mm"
    assert about["mesh"]["hash"] == rough.content_hash


def test_one_pair_is_refused_and_leaves_what_was_there(
    ball: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "smooth.stl"
    out.write_text("before")
    assert main(["reconstruct", str(ball), "--count", "1", "-o", str(out)]) == 2
    assert "each component would become a point: take more pairs" in capsys.readouterr().err
    assert out.read_text() == "before"
    assert main(["reconstruct", str(ball), "-o", str(tmp_path / "smooth.csv")]) == 2
    assert "no ending in which it can be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    "ending", slow_unless(lambda ending: ending not in (".vtp", ".surf.gii"), MESH_WRITERS)
)
def test_a_mesh_comes_back_from_its_file(ending: str, tmp_path: Path) -> None:
    base = shapes.icosphere(1)
    mesh = Mesh(base.vertices * 1e5 + [3e5, 0.1, 1e-3], base.faces, unit="nm", name="small")
    path = tmp_path / f"small{ending}"
    write_mesh(path, mesh)
    back = read_mesh(path)
    nanometres = 1e6 if back.unit == "mm" else 1.0
    corners = mesh.vertices[mesh.faces], back.vertices[back.faces] * nanometres
    single = ending in (".stl", ".glb", ".surf.gii")
    np.testing.assert_allclose(corners[1], corners[0], rtol=0.0, atol=0.05 if single else 0.0)
    note = path.with_name(path.name + ".json")
    made = (note if note.exists() else path).read_bytes()
    made = made.replace(b"\0", b"")  # text in NPZ is UTF-32
    assert b"meshmash-viewer" in made
    assert mesh.content_hash.encode() in made
