"""The command line: results of the commands, and one-line error messages."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import shapes
from commands import refused, run
from faults import raises
from segment_layers import SEGMENT, box, fragment, source, write_fragments
from tiers import slow_but

from meshmash_viewer.app.view import picture
from meshmash_viewer.cli.outputs import output_paths
from meshmash_viewer.cli.parser import COMMANDS
from meshmash_viewer.decompose import (
    compute_hks,
    decompose_laplacian,
    decompose_mesh,
)
from meshmash_viewer.features.distances import distance_features
from meshmash_viewer.io.read import read_mesh
from meshmash_viewer.laplacian import cotangent_laplacian
from meshmash_viewer.mesh import Mesh
from meshmash_viewer.spectral.eigensolver import Run, solve


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setattr("meshmash_viewer.io.cache.default_cache_folder", lambda: folder)
    return folder


def save(mesh: Mesh, path: Path) -> Path:
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    return path


@pytest.fixture
def ball(sphere: Mesh, tmp_path: Path) -> Path:
    return save(sphere, tmp_path / "ball.npz")


@pytest.fixture
def sheet(rectangle: Mesh, tmp_path: Path) -> Path:
    return save(rectangle, tmp_path / "sheet.npz")


def test_help_and_errors_lead_to_each_command(capsys: pytest.CaptureFixture[str]) -> None:
    columns = re.findall(
        r"^  ([a-z]+)\b.*?  +\w", run(capsys, "--help")[1].split("COMMAND")[1], re.M
    )
    assert columns == list(COMMANDS)
    status, _, err = run(capsys, "predict", "x.ply", "--model", "m", "-o", "y/", "--count", 9)
    assert (status, "(see meshmash-viewer predict --help)" in err) == (2, True)


def test_info_tells_the_voxel_where_there_is_one(
    capsys: pytest.CaptureFixture[str], ball: Path
) -> None:
    assert "voxel" not in run(capsys, "info", ball, "--unit", "nm")[1]
    unit = "4 x 4 x 40 nm"
    assert "4 × 4 × 40 nm" in run(capsys, "info", ball, "--unit", unit)[1]
    about = json.loads(run(capsys, "info", ball, "--json", "--unit", unit)[1])
    assert about["voxel"] == [4.0, 4.0, 40.0]
    sides = [high - low for low, high in zip(*about["bounds"], strict=True)]
    assert sides == pytest.approx([8.0, 8.0, 80.0], rel=0.05)


def test_info_for_machines(capsys: pytest.CaptureFixture[str], ball: Path, sheet: Path) -> None:
    status, out, err = run(capsys, "info", ball, sheet, "--json", "--wavelength", 1.0)
    assert (status, err) == (0, "")
    first, second = (json.loads(line) for line in out.splitlines())
    assert first["area"] == pytest.approx(4 * np.pi, rel=0.02)
    assert second["area"] == pytest.approx(3.0)
    assert (second["boundary_edges"] > 0, first["boundary_edges"]) == (True, 0)
    # λ = (2π / 1)², and A λ / 4π eigenpairs
    assert second["weyl"]["max_eigenvalue"] == pytest.approx(4 * np.pi**2)
    assert second["weyl"]["n_eigenpairs"] == round(3 * np.pi)
    assert second["weyl"]["exact"] == ["max_eigenvalue", "wavelength"]
    assert first["median_edge"] == pytest.approx(0.15, rel=0.1)


def test_info_never_counts_more_pairs_than_vertices_and_knows_what_is_stored(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out = run(capsys, "info", ball, "--wavelength", 0.01)[1]
    assert re.search(r"eigenpairs +≈ 642\n", out)
    assert re.search(r"eigenpairs +642\n", run(capsys, "info", ball, "--count", 10**6)[1])
    # λ = l (l + 1) ≤ 30, 2 l + 1 times each: 36 pairs, some slightly lower on the mesh
    threshold = ("--max-eigenvalue", 30.5)
    assert "≈ 30" in run(capsys, "info", ball, *threshold)[1]
    run(capsys, "features", ball, *threshold, "-o", tmp_path / "out.npz")
    assert re.search(r"eigenpairs +36\n", run(capsys, "info", ball, *threshold)[1])


def test_what_truncation_costs_is_said_everywhere(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.npz"
    arguments = ("--count", 60, "--t-min", 0.01, "--t-max", 1, "--n-components", 4, "-o", out)
    status, text, err = run(capsys, "features", ball, *arguments, "--json")
    assert status == 0
    assert re.search(r"ball.npz: 2 of 4 columns miss more than 1 %.*about \d\d %", err)
    report = json.loads(text)
    truncation = report["truncation"]
    assert truncation["flagged"] == truncation["columns"][:2]
    assert 0.3 < truncation["estimate"][0] < truncation["bound"][0]
    assert report["max_eigenvalue"] == pytest.approx(56, rel=0.1)
    assert report["wavelength"] == pytest.approx(2 * np.pi / report["max_eigenvalue"] ** 0.5)
    with np.load(out) as archive:
        plain = archive["features"]
        assert json.loads(str(archive["meta"]))["options"]["truncation"] == truncation
    _, _, err = run(capsys, "features", ball, *arguments, "--tail", "weyl")
    assert "are by more than 1 % an estimate" in err
    with np.load(out) as archive:
        added = archive["features"]
    assert (added[:, 0] > 1.3 * plain[:, 0]).all()
    status, text, err = run(capsys, "features", ball, "--count", 60, "-o", out)
    assert (status, err) == (0, "")
    assert "· up to λ = " in text
    assert ", waves of " in text


def test_count_auto(capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.npz"
    arguments = ("--count", "auto", "--t-max", 1, "-o", out, "--json")
    status, text, err = run(capsys, "features", ball, "--t-min", 0.2, *arguments)
    assert (status, err) == (0, "")
    report = json.loads(text)
    assert 20 < report["n_eigenpairs"] < 37
    assert report["truncation"]["flagged"] == []
    status, text, err = run(capsys, "features", ball, "--t-min", 1e-4, *arguments)
    assert status == 0
    report = json.loads(text)
    assert 20 < report["n_resolved"] <= report["n_eigenpairs"] < 40
    assert f"The mesh resolves about {report['n_eigenpairs']} pairs to 5" in err
    assert err.count("The mesh resolves") == 1
    assert "take more" not in err
    for wrong in ((), ("--kind", "wks")):
        status, _, err = run(capsys, "features", ball, "--count", "auto", *wrong, "-o", out)
        assert (status, err.count("\n")) == (2, 1)
        assert "give --t-min" in err
    status, _, err = run(capsys, "features", ball, "--count", 1000, "-o", out)
    assert "1,000 eigenpairs were asked for; the mesh has 642" in err


def test_repairs_components_and_what_they_do_to_features(
    capsys: pytest.CaptureFixture[str], sphere: Mesh, tmp_path: Path
) -> None:
    n, speck = sphere.n_vertices, shapes.moved(shapes.icosphere(0, 1e-3), 5.0)
    path = save(shapes.together(sphere, speck, np.full((1, 3), 9.0)), tmp_path / "a.npz")
    out = tmp_path / "out.npz"
    basic = ("features", path, "--count", 20, "--n-components", 3, "-o", out)
    status, _, err = run(capsys, *basic, "--component-column")
    assert status == 0
    assert "rows of NaN stand for 1 vertex that no face uses" in err
    assert "on 1 tiny component (12 vertices)" in err
    with np.load(out) as archive:
        assert archive["columns"][-1] == "component"
        labels = archive["features"][:, -1]
    np.testing.assert_array_equal(labels, np.repeat([0.0, 1.0, -1.0], [n, 12, 1]))
    status, _, err = run(capsys, *basic, "--largest-component")
    assert (status, err.count("\n")) == (0, 1)
    assert "a: keep_largest_component drops 1 of 2 components, 13 vertices (1.98" in err
    with np.load(out) as archive:
        assert archive["features"].shape == (n, 3)
        repairs = json.loads(str(archive["meta"]))["options"]["repairs"]
    assert repairs == ["keep_largest_component"]
    text = run(capsys, "info", path, "--repair", "drop_unreferenced_vertices")[1]
    assert re.search(r"vertices +654\n", text)
    status, _, err = run(capsys, "info", path, "--repair", "polish")
    assert (status, err.count("\n")) == (2, 1)
    assert "no repair polish: the repairs are merge_seams, merge_coincident_vertices" in err


def test_features_are_those_of_the_library(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.npz"
    arguments = ("--max-eigenvalue", 30.5, "--n-components", 7, "-o", out)
    assert run(capsys, "features", ball, "--kind", "hks", *arguments)[0] == 0
    with np.load(out) as archive:
        hks = compute_hks(read_mesh(ball), max_eigenvalue=30.5, n_components=7, truncate_extra=True)
        np.testing.assert_allclose(archive["features"], hks, rtol=1e-7)
        assert archive["eigenvalues"][-1] <= 30.5
        assert len(archive["columns"]) == 7
        np.testing.assert_array_equal(archive["faces"], read_mesh(ball).faces)
        meta = json.loads(str(archive["meta"]))
    assert meta["options"]["target"] == {"kind": "max_eigenvalue", "value": 30.5}
    assert meta["options"]["operator"]["robust"] is True
    assert meta["mesh"]["hash"] == read_mesh(ball).content_hash
    asked = "features", ball, "--kind", "eigenpairs", "--count", 9
    assert run(capsys, *asked, "-o", out)[0] == 0
    with np.load(out) as archive:
        # λ = l (l + 1), 2 l + 1 times
        exact = [0] + 3 * [2] + 5 * [6]
        np.testing.assert_allclose(archive["eigenvalues"], exact, rtol=0.03, atol=1e-9)
        assert archive["eigenvectors"].shape == (642, 9)
    for kind in ("geometry-vectors", "wks"):
        assert run(capsys, "features", ball, "--kind", kind, "--count", 9, "-o", out)[0] == 0
        with np.load(out) as archive:
            assert json.loads(str(archive["meta"]))["options"]["kind"] == kind


@pytest.mark.parametrize(
    "wrong", [("--n-components", "0"), ("--t-min", "-1"), ("--t-min", "2", "--t-max", "1")]
)
def test_what_cannot_be_is_said_before_the_work(
    capsys: pytest.CaptureFixture[str], ball: Path, monkeypatch: pytest.MonkeyPatch, wrong: tuple
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("eigenpairs were computed first")

    monkeypatch.setattr("meshmash_viewer.cli.features.solved", never)
    status, out, err = run(capsys, "features", ball, ball.with_suffix(".ply"), *wrong, "-o", "f/")
    assert (status, out, len(err.splitlines())) == (2, "", 1)


def test_files_of_one_name_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    meshes = [tmp_path / each / "surf" / "lh.white" for each in ("sub-01", "sub-02")]
    other = tmp_path / "ball.ply"
    found = output_paths([*meshes, other], f"{tmp_path}/out/", "hks", ".npz")
    assert [path.name for path in found] == [
        "sub-01_lh.white.npz", "sub-02_lh.white.npz", "ball.npz",
    ]  # fmt: skip
    twice = [*meshes, meshes[0]]
    with raises("same-file"):
        output_paths(twice, f"{tmp_path}/out/", "hks", ".npz")


def test_many_meshes_to_a_folder_and_a_template(
    capsys: pytest.CaptureFixture[str], ball: Path, sheet: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "results"
    arguments = ("features", ball, sheet, "--count", 12, "--json")
    status, out, _ = run(capsys, *arguments, "-o", f"{folder}/", "--format", "parquet")
    assert status == 0
    assert {path.name for path in folder.iterdir()} == {"ball.parquet", "sheet.parquet"}
    reports = [json.loads(line) for line in out.splitlines()]
    assert [report["mesh"] for report in reports] == ["ball", "sheet"]
    assert all(report["complete"] and report["worst_residual"] < 1e-8 for report in reports)
    for report, path in zip(reports, (ball, sheet), strict=True):
        highest = decompose_mesh(read_mesh(path), 12)[0][-1]
        assert report["max_eigenvalue"] == pytest.approx(highest, rel=1e-9)
    assert run(capsys, *arguments, "-o", tmp_path / "{name}-{kind}.npy")[0] == 0
    assert (tmp_path / "sheet-hks.npy").exists()

    status, _, err = run(capsys, *arguments, "-o", tmp_path / "one.npz")
    assert status == 2
    assert "give a folder" in err
    status, _, err = run(capsys, *arguments, "-o", tmp_path / "{kind}.npz")
    assert status == 2
    assert "would overwrite" in err
    assert run(capsys, *arguments, "-o", tmp_path / "{nam}.npz")[0] == 2
    status, _, err = run(capsys, "features", ball, "-o", f"{tmp_path}/")
    assert status == 2
    assert "the mesh itself" in err


@pytest.mark.parametrize(
    ("fault", "status", "clause"),
    [
        (
            ArithmeticError("5 of 9 eigenpairs found"),
            1,
            "defect of the program (ArithmeticError: 5",
        ),
        (MemoryError(), 2, "Memory ran out"),
        (OSError(28, "No space left on device", "file"), 2, "No space left on device"),
    ],
)
def test_no_fault_ends_a_batch(
    capsys: pytest.CaptureFixture[str],
    ball: Path,
    sheet: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fault: Exception,
    status: int,
    clause: str,
) -> None:
    monkeypatch.setenv("MESHMASH_CACHE", str(tmp_path))

    def failing(*arguments: object, **options: object) -> object:
        if arguments[0].shape == (642, 642):  # type: ignore[attr-defined]
            raise fault
        return Run(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("meshmash_viewer.spectral.eigensolver.Run", failing)
    arguments = ("features", ball, tmp_path / "absent.ply", sheet, "--count", 9)
    said = run(capsys, *arguments, "-o", f"{tmp_path / 'out'}/")
    assert said[0] == status
    assert "sheet.npz" in said[1]
    lines = said[2].splitlines()
    assert len(lines) == 2
    assert str(ball) in lines[0]
    assert clause in lines[0]
    assert "Traceback" not in said[2]
    if status == 1:
        details = Path(lines[0].rpartition(" in ")[2]).read_text()
        assert "Traceback" in details
        assert "5 of 9 eigenpairs found" in details
        assert "numpy" in details


def test_a_defect_is_said_where_its_details_cannot_be_kept(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "log").touch()
    monkeypatch.setenv("MESHMASH_CACHE", str(tmp_path))

    def failing(*_: object) -> None:
        raise KeyError("lost")

    monkeypatch.setattr("meshmash_viewer.cli.features.output_paths", failing)
    status, out, err = run(capsys, "features", ball, "-o", tmp_path / "out.npz")
    assert (status, out, len(err.splitlines())) == (1, "", 1)
    assert "KeyError: 'lost' at failing" in err


def test_a_refused_batch_leaves_no_folder(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    arguments = ("features", tmp_path / "absent.ply", "-o", f"{tmp_path / 'one' / 'two'}/")
    assert run(capsys, *arguments)[0] == 2
    assert run(capsys, "features", ball, ball, "-o", f"{tmp_path / 'one'}/")[0] == 2
    assert list(tmp_path.iterdir()) == [ball]


def test_stored_eigenpairs_are_not_computed_again(
    capsys: pytest.CaptureFixture[str],
    ball: Path,
    tmp_path: Path,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = []

    def counted(*arguments: object, **options: object) -> object:
        runs.append(1)
        return Run(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("meshmash_viewer.spectral.eigensolver.Run", counted)
    out = tmp_path / "out.npz"
    for options in ((), ("--kind", "geometry-vectors"), ("--no-robust",)):
        assert run(capsys, "features", ball, "--count", 9, *options, "-o", out)[0] == 0
    assert run(capsys, "features", ball, "--count", 5, "-o", out)[0] == 0
    assert len(runs) == 3  # another count is another request
    kept = sorted(path.name for path in cache.iterdir())
    for _ in range(2):
        arguments = ("features", ball, "--count", 10, "--no-cache", "-o", out)
        assert run(capsys, *arguments)[0] == 0
    assert len(runs) == 5
    assert sorted(path.name for path in cache.iterdir()) == kept


def test_unwritable_cache_is_no_reason_to_stop(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, cache: Path
) -> None:
    cache.rmdir()
    cache.touch()
    status, _, err = run(capsys, "features", ball, "--count", 9, "-o", tmp_path / "out.npz")
    assert status == 0
    assert "only in memory" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "clause"),
    [
        (["info", "absent.ply"], "does not exist"),
        (["info", "{ball}", "--unit", "furlong"], "furlong"),
        (["info", "{ball}", "--count", "0"], "a whole number from 1"),
        (["info"], "required"),
        (["features", "{ball}"], "required: -o"),
        (["features", "{ball}", "-o", "out.xlsx"], "no ending"),
        (["features", "{ball}", "-o", "absent/out.npz"], "no folder"),
        (["features", "{ball}", "-o", "{ball}"], "the mesh itself"),
        (["features", "{ball}", "-o", "o.npz", "--kind", "shape"], "invalid choice"),
        (["features", "{ball}", "-o", "o.npz", "--count", "5", "--max-eigenvalue", "1"], "not all"),
        (["features", "{ball}", "-o", "o.npz", "--count", "9", "--n-components", "0"], "0"),
        (["features", "{ball}", "-o", "o.npz", "--max-eigenvalue", "-1"], "positive"),
        (["features", "{ball}", "-o", "{ball}/features/"], "cannot be written (Not a directory)"),
        (["features", "{ball}", "-o", "o.npz", "--jobs", "0"], "whole number from 1"),
        (["features", "{ball}", "-o", "o.npz", "--mollify-factor", "-1"], "--mollify-factor"),
        (["features", "{ball}", "-o", "o.npz", "--kind", "wks", "--t-min", "1"], "--kind hks"),
        (["features", "{ball}", "absent.ply", "-o", "f_{name}.npz", "--unit", "ell"], "'ell'"),
        (["frobnicate", "{ball}"], "neither a command nor a file frobnicate"),
        (["render", "{ball}", "-o", "out.jpg"], ".png"),
        (["render", "{ball}", "-o", "out.png", "--size", "big"], "1600x1200"),
        (["render", "{ball}", "-o", "out.png", "--limits", "2", "1"], "swap"),
        (["render", "{ball}", "-o", "o.png", "--field", "eigenfunction", "--index", "999"], "999"),
    ],
)
def test_what_the_user_can_mend_is_one_line(
    capsys: pytest.CaptureFixture[str],
    ball: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    clause: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(capsys, clause, *(text.replace("{ball}", str(ball)) for text in arguments))
    assert list(tmp_path.iterdir()) == [ball]


def test_no_display_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    status, _, err = run(capsys)
    assert status == 2
    assert "No display is available" in err


def test_window_gets_its_arguments(
    capsys: pytest.CaptureFixture[str], ball: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[object, ...]] = []

    def run_app(*given: object, fresh: bool) -> int:
        seen.append((*given, fresh))
        return 0

    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")
    monkeypatch.setattr("meshmash_viewer.app.run.run_app", run_app)
    assert run(capsys, ball, "--unit", "nm", "--fresh", "--map", "a", "--map", "b")[0] == 0
    assert run(capsys)[0] == 0
    assert seen == [(ball, "nm", [Path("a"), Path("b")], True), (None, "", [], False)]
    assert run(capsys, "--map", "a")[0] == 2
    assert run(capsys, ball, "--unit", "ell")[0] == 2


@pytest.mark.parametrize(
    "asked",
    slow_but(
        ["hks"],
        ["hks", "hks --time 0.1", "hks --index 3", "eigenfunction", "band --index 31",
         "wks --index 4", "sihks", "filter --formula exp(-x)", "distance --vertex 3",
         "distance --vertex 3 --distance diffusion", "none"],
    ),
)  # fmt: skip
@pytest.mark.pixels
def test_render_draws(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, asked: str
) -> None:
    pytest.importorskip("vtkmodules.vtkRenderingOpenGL2")
    from PIL import Image

    field, *more = asked.split()
    bare = asked in ("none", "distance --vertex 3")  # without eigenpairs
    out = tmp_path / "out.png"
    options = ("--field", field, *more, "--count", 30, "--size", "320x240", "--transparent")
    status, text, err = run(capsys, "render", ball, *options, "-o", out)
    assert status == 0
    assert not err or "for want of eigenpairs" in err
    assert text.startswith(f"{out}: up to λ = " if not bare else f"{out}\n")
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGBA"))
    assert pixels.shape == (240, 320, 4)
    assert pixels[120, 160, 3] == 255  # the ball
    assert pixels[235, 160, 3] == 0  # below the ball
    assert (
        json.loads(run(capsys, "render", ball, *options, "-o", out, "--json")[1])["field"] == field
    )


@pytest.mark.slow
def test_maps_are_columns_and_pictures(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    """Maps of a mesh file become columns with `--maps`, else a message names them."""
    mesh = read_mesh(ball)
    held, more = tmp_path / "held.npz", tmp_path / "lh.more.npy"
    np.savez(held, vertices=mesh.vertices, faces=mesh.faces, height=mesh.vertices[:, 2])
    np.save(more, np.arange(mesh.n_vertices))
    out = tmp_path / "out.npz"
    common = ("--count", 9, "--n-components", 3, "-o", out)
    status, _, err = run(capsys, "features", held, *common)
    assert status == 0
    assert "left out: height; --maps adds" in err
    with np.load(out) as archive:
        assert len(archive["columns"]) == 3
    status, _, err = run(capsys, "features", held, *common, "--maps", "--map", more)
    assert (status, err) == (0, "")
    with np.load(out) as archive:
        assert archive["columns"].tolist()[3:] == ["height", "lh.more.npy"]
        np.testing.assert_array_equal(archive["features"][:, 3], mesh.vertices[:, 2])
        np.testing.assert_array_equal(archive["features"][:, 4], np.arange(mesh.n_vertices))
    alone = ("features", held, "--kind", "maps", "-o", out)
    status, text, err = run(capsys, *alone, "--map", more)
    assert (status, text, err) == (0, f"{out}: 2 columns\n", "")
    with np.load(out) as archive:
        assert archive["columns"].tolist() == ["height", "lh.more.npy"]
        np.testing.assert_array_equal(archive["features"][:, 0], mesh.vertices[:, 2])
    for arguments, pattern in (
        ((*alone, "--t-min", 1), "--t-min is for --kind hks, not for maps"),
        ((*alone, "--pieces", 2), "--kind maps needs the whole mesh"),
        (("features", ball, *alone[2:]), "has no maps: name files"),
        (
            ("features", held, ball, "--map", more, "-o", f"{tmp_path}/new/"),
            "--map is for one mesh",
        ),
        (("features", held, "--kind", "eigenpairs", "--maps", "-o", out), "columns to features"),
        (("features", held, "--map", tmp_path / "no.npy", "-o", out), "does not exist"),
        (("render", held, "--map", more, "--field", "hks", "-o", "out.png"), "for --field map"),
        (("render", held, "--map-name", "wide", "-o", "out.png"), "no map 'wide'"),
    ):
        status, _, err = run(capsys, *arguments)
        assert status == 2
        assert pattern in err
    pytest.importorskip("vtkmodules.vtkRenderingOpenGL2")
    picture = tmp_path / "out.png"
    for given, shown in (
        (("--map", more), "lh.more.npy"),
        (("--field", "map"), "height"),
        (("--map-name", "Mean curvature"), "Mean curvature"),
    ):
        arguments = ("render", held, *given, "--size", "320x240", "-o", picture, "--json")
        assert json.loads(run(capsys, *arguments)[1])["map"] == shown


# A separate process ---------------------------------------------------------------------------


def environment(folder: Path) -> dict[str, str]:
    return os.environ | {"MESHMASH_CACHE": str(folder), "HOME": str(folder)}


def test_a_filter_is_written_as_a_formula(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out, text = tmp_path / "filter.npz", "exp(-t*x) * (x > 0)"
    chosen = ("--kind", "filter", "--formula", text, "--count", 20, "-o", out)
    assert run(capsys, "features", ball, *chosen, "--set", "t=0.1:1", "--n-components", 3)[0] == 0
    L, M = cotangent_laplacian(read_mesh(ball), robust=True)
    eigenvalues, phi = decompose_laplacian(L, M, 20)
    for column, t in enumerate(np.geomspace(0.1, 1.0, 3)):
        wanted = np.square(phi) @ (np.exp(-t * eigenvalues) * (eigenvalues > 1e-9))
        np.testing.assert_allclose(np.load(out)["features"][:, column], wanted, rtol=1e-6)
    # `l`, meant as λ, is read as a parameter, and a message states its value.
    named = ("--kind", "filter", "--formula", "exp(-t*l)", "--count", 20, "-o", out)
    status, _, err = run(capsys, "features", ball, *named, "--set", "t=1")
    assert (status, "l = 2.15, from the spectrum" in err) == (0, True), err
    assert "from the spectrum" not in run(capsys, "features", ball, *chosen, "--set", "t=1")[2]
    for wrong, said in (
        (("--set", "q=1"), "has no parameter q: give one of t"),
        (("--set", "t=2:1"), "from a positive number to a larger one"),
        (("--set", "t=one"), "is not t=3e6"),
        (("--t-min", 1), "--t-min is for --kind hks, not for filter"),
    ):
        status, _, err = run(capsys, "features", ball, *chosen, *wrong)
        assert (status, said in err) == (2, True), err
    status, _, err = run(capsys, "features", ball, "-o", out, "--kind", "hks", "--formula", "x")
    assert (status, "--formula is for --kind filter" in err) == (2, True)


def test_the_first_pair_left_out_in_pieces_is_that_of_the_whole(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    mesh, path = shapes.three_spheres(), tmp_path / "spheres.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    times = ("--t-min", 0.02, "--t-max", 0.05, "--n-components", 3)
    asked = ("features", path, *times, "--max-eigenvalue", 300, "--drop-first", "--no-cache")
    for name, pieces in (("whole.npz", ()), ("pieces.npz", ("--pieces", 1, "--jobs", 1))):
        assert run(capsys, *asked, "-o", tmp_path / name, *pieces)[0] == 0
    here, there = (np.load(tmp_path / each)["features"] for each in ("pieces.npz", "whole.npz"))
    np.testing.assert_allclose(here, there, rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--kind", "hks"), "give what they are taken from, as --t-min"),
        (("--kind", "wks"), "depend on the spectrum of the whole"),
        (("--kind", "eigenpairs"), "--kind eigenpairs needs the whole mesh"),
        (("--t-min", 1, "--t-max", 2, "--tail", "weyl"), "--tail needs the whole mesh"),
        (("--kind", "geometry-vectors", "--pieces", 5), "would have fewer than 500 each"),
    ],
)
def test_what_cannot_be_had_in_pieces_is_one_sentence(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, given: tuple, said: str
) -> None:
    out = tmp_path / "x.npz"
    refused(capsys, said, "features", ball, "--pieces", 1, *given, "-o", out)
    assert not out.exists()


def test_pieces_that_disagree_are_written_only_if_that_is_accepted(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    mesh, path, out = shapes.icosphere(4), tmp_path / "sphere.npz", tmp_path / "bands.npz"
    np.savez(path, vertices=mesh.vertices, faces=mesh.faces)
    kind = ("--kind", "geometry-vectors", "--n-components", 4, "--max-eigenvalue", 40)
    asked = ("features", path, *kind, "-o", out, "--no-cache")
    status, _, err = run(capsys, *asked, "--pieces", 3, "--jobs", 1)
    assert (status, err.count("\n")) == (2, 1), err
    assert "take fewer pieces, solve the whole, or accept the seams (--accept-seams)." in err
    assert not out.exists()
    status, _, err = run(capsys, *asked, "--pieces", 3, "--jobs", 1, "--accept-seams")
    assert status == 0
    assert "differ by more than 1 % in the median where pieces meet" in err
    assert out.exists()
    status, _, err = run(capsys, *asked, "--accept-seams")
    assert (status, "give --pieces" in err) == (2, True)


def test_two_meshes_are_compared(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    mesh, out = read_mesh(ball), tmp_path / "match.npz"
    squeezed = tmp_path / "other.npz"
    np.savez(squeezed, vertices=3.0 * mesh.vertices * [1.0, 1.5, 0.7], faces=mesh.faces)
    status, said, err = run(capsys, "compare", ball, ball, "--count", 30, "-o", out, "--json")
    assert (status, err) == (0, "")
    report = json.loads(said)
    assert report["spectral_distance"] == 0.0
    assert report["mutual_share"] == 1.0
    matches = np.load(out)["features"]
    np.testing.assert_array_equal(matches[:, 0], np.arange(mesh.n_vertices))
    status, said, _ = run(capsys, "compare", ball, squeezed, "--count", 30)
    assert status == 0
    assert "by index" in said
    turned = tmp_path / "turned.npz"
    np.savez(turned, vertices=mesh.vertices[::-1], faces=mesh.n_vertices - 1 - mesh.faces)
    last = mesh.n_vertices - 1
    pins = [word for at in (0, 30, 77) for word in ("--landmark", at, last - at)]
    refined = ("compare", ball, turned, "--count", 30, "--refine")
    assert run(capsys, *refined, *pins, "-o", out)[0] == 0
    order = np.load(out)["features"][:, 0]
    assert np.mean(order == np.arange(mesh.n_vertices)[::-1]) > 0.9
    assert json.loads(str(np.load(out)["meta"]))["options"]["refined"] == {"landmarks": 3}
    for words, fault in (
        (("--landmark", 0), "0 is not 2 numbers: write them like 12 40"),
        (
            ("--landmark", 0, 10**6),
            f"There is no vertex 1000000: give a whole number from 0 to {last}",
        ),
    ):
        status, said, err = run(capsys, *refined, *words)
        assert (status, said, fault in err) == (2, "", True)
    status, said, err = run(capsys, "compare", ball, turned, "--landmark", "0 1")
    assert (status, "--landmark is used by --refine alone" in err) == (2, True)
    few = tmp_path / "few.npz"
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    np.savez(few, vertices=corners, faces=[[0, 1, 2], [0, 1, 3], [0, 2, 3]])
    status, said, err = run(capsys, "compare", few, ball)
    assert (status, said, err.count("\n")) == (2, "", 1)
    assert "too few for a comparison" in err
    assert run(capsys, "compare", ball, tmp_path / "none.obj")[0] == 2
    assert run(capsys, "compare", ball, ball, "-o", tmp_path / "match.foo")[0] == 2


@pytest.mark.slow
def test_a_report_on_the_machine(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "--info")
    assert (status, err) == (0, "")
    told = dict(line.strip().split(" : ", 1) for line in out.splitlines() if " : " in line)
    assert told["numpy"] == np.__version__
    assert {"RAM", "CPU(s)", "Graphics", "Eigenpairs kept", "vtk"} <= told.keys()


@pytest.mark.skipif(os.name != "posix", reason="needs a program that fails")
def test_a_driver_that_crashes_is_part_of_the_report(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture.sys, "executable", "false")
    assert picture.asked_graphics() == "none (its test ended with status 1)"


@pytest.mark.slow
def test_version_and_help_load_nothing_heavy(tmp_path: Path) -> None:
    heavy = ("PySide6", "pyvista", "vtkmodules", "scipy", "trimesh")
    code = (
        "import sys\nfrom meshmash_viewer.cli.main import main\n"
        "try:\n    main(['features', '--help'])\nexcept SystemExit:\n    pass\n"
        f"sys.exit([name for name in {heavy!r} if name in sys.modules] or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    done = subprocess.run(
        [sys.executable, "-m", "meshmash_viewer", "--version"],
        capture_output=True,
        text=True,
        check=True,
        env=environment(tmp_path),
    )
    assert done.stdout.startswith("meshmash-viewer ")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals and terminals of POSIX")
def test_interrupt_on_a_terminal_is_clean(tmp_path: Path) -> None:
    import fcntl
    import pty
    import struct
    import termios

    mesh = save(shapes.icosphere(6), tmp_path / "large.npz")  # half a minute of work
    command = [sys.executable, "-m", "meshmash_viewer", "features", str(mesh), "--count", "900"]
    terminal, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "out.npz")],
        stdout=end,
        stderr=end,
        env=environment(tmp_path),
        start_new_session=True,
    )
    os.close(end)
    said = b""
    try:
        while b" of 900" not in said:  # The progress bar runs.
            assert select.select([terminal], [], [], 60)[0], said
            said += os.read(terminal, 4096)
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)
        while True:
            assert select.select([terminal], [], [], 60)[0], said
            try:
                chunk = os.read(terminal, 4096)
            except OSError:  # the terminal's other end is closed
                break
            if not chunk:
                break
            said += chunk
        assert process.wait(60) == 130
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        os.close(terminal)
    text = said.decode()
    assert "interrupted" in text
    assert "Traceback" not in text
    assert not (tmp_path / "out.npz").exists()
    assert not list(tmp_path.glob(".*"))
    # No process of its group still runs.
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


@pytest.mark.parametrize("ignored", [False, True])
def test_sigterm_ends_a_command_like_an_interrupt(
    ignored: bool, capsys: pytest.CaptureFixture[str], ball: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(
        "meshmash_viewer.cli.batch.read_mesh", lambda *_, **__: signal.raise_signal(signal.SIGTERM)
    )
    try:
        if ignored:  # as in the background of a shell
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        assert run(capsys, "info", ball) == (130, "", "meshmash-viewer: interrupted\n")
    finally:
        signal.signal(signal.SIGINT, before[1])
    assert signal.getsignal(signal.SIGTERM) == before[0]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals of POSIX")
def test_sigterm_leaves_no_worker_processes(tmp_path: Path) -> None:
    import psutil

    mesh = save(shapes.icosphere(6), tmp_path / "large.npz")
    command = [sys.executable, "-m", "meshmash_viewer", "condense", str(mesh), "--unit", "µm"]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "out.npz"), "--jobs", "2"], env=environment(tmp_path)
    )
    started: list[psutil.Process] = []
    try:
        while len(started) < 4:  # two workers, and two trackers of resources
            assert process.poll() is None
            time.sleep(0.1)
            started = psutil.Process(process.pid).children(recursive=True)
        process.terminate()
        assert process.wait(240) == 130
        assert psutil.wait_procs(started, timeout=60)[1] == []
    finally:
        for each in (process, *started):
            with contextlib.suppress(psutil.NoSuchProcess):
                each.kill()


@pytest.mark.parametrize("measure", ["geodesic", "diffusion"])
def test_distances_are_written(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, measure: str
) -> None:
    """Columns equal those of the library, in the order of the options `--vertex`."""
    out, mesh = tmp_path / "out.npz", read_mesh(ball, "um")
    time = ("--time", 0.25) if measure == "diffusion" else ()
    chosen = ("--kind", "distance", "--distance", measure, *time, "--vertex", 17, "--vertex", 5)
    common = ("--count", 30, "--unit", "um", "-o", out, "--json")
    status, text, err = run(capsys, "features", ball, *chosen, *common)
    assert (status, err) == (0, "")
    # Along the surface no pairs are needed.
    assert ("proof" in json.loads(text)) == (measure != "geodesic")
    given = (solve(*cotangent_laplacian(mesh), 30), 0.25) if time else ()
    wanted = distance_features(mesh, [17, 5], measure, *given)
    with np.load(out) as archive:
        assert archive["columns"].tolist() == list(wanted.columns)
        largest = wanted.values.max()
        np.testing.assert_allclose(archive["features"], wanted.values, atol=1e-6 * largest)
        about = json.loads(str(archive["meta"]))["options"]
    assert (about["measure"], about["vertices"]) == (measure, [17, 5])
    assert (about["values_unit"], about.get("time")) == (wanted.unit, 0.25 if time else None)


@pytest.mark.parametrize(
    ("options", "clause"),
    [
        ("", "give --vertex"),
        ("--vertex 4 --vertex 4", "each once"),
        ("--vertex 4 --distance diffusion --time -3", "give a positive number"),
        ("--vertex 4 --n-components 3", "one column for each"),
        ("--vertex 4 --pieces 4", "whole mesh"),
    ],
)
def test_distances_that_cannot_be_had_are_one_line(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path, options: str, clause: str
) -> None:
    out = tmp_path / "out.npz"
    chosen = ("--kind", "distance", *options.split(), "--count", 9)
    refused(capsys, clause, "features", ball, *chosen, "-o", out)
    assert not out.exists()


@pytest.mark.usefixtures("read_here")
def test_links_are_meshes_of_every_command(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pytest.importorskip("cloudvolume")
    layer = write_fragments(tmp_path / "layer", [fragment(box(2))])
    chosen = ("--segment", SEGMENT, "--segment", 12)
    status, out, err = run(capsys, "info", source(layer), *chosen, "--json")
    assert json.loads(out)["n_vertices"] == box(2).n_vertices
    assert json.loads(out)["unit"] == "nm"
    assert (status, err.count("\n")) == (2, 1)
    assert "#segment=12 has no mesh: check the id" in err
    output = tmp_path / "out"
    link = f"{source(layer)}#segment={SEGMENT}"
    status, out, err = run(capsys, "features", link, "--count", 4, "-o", f"{output}/")
    assert status == 0
    assert [each.name for each in output.iterdir()] == [f"{SEGMENT}.npz"]
    assert "names no segment" in run(capsys, "info", source(layer))[2]
    assert "'axon' is no id" in run(capsys, "info", source(layer), "--segment", "axon")[2]
    assert (
        "--segment and --lod need a link in place of"
        in run(capsys, "info", "x.ply", "--segment", 12)[2]
    )
    assert "needs a single link" in run(capsys, "info", link, link, "--segment", 12)[2]
