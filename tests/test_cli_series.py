"""Galleries and movies from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from meshmash_viewer.cli import main as cli
from meshmash_viewer.mesh import Mesh


@pytest.fixture
def ball(sphere: Mesh, tmp_path: Path) -> Path:
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=sphere.vertices, faces=sphere.faces)
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    try:
        status = cli.main([str(argument) for argument in arguments])
    except SystemExit as leaving:
        status = int(leaving.code or 0)
    out, err = capsys.readouterr()
    return status, out, err


def test_a_gallery_has_a_picture_a_column(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out = tmp_path / "sheet.png"
    options = ("--kind", "eigenfunction", "--count", 30, "--columns", "1:25:4", "--size", "600x400")
    done = run(capsys, "gallery", ball, *options, "--transparent", "-o", out, "--json")
    assert (done[0], done[2]) == (0, "")
    report = json.loads(done[1])
    assert report["columns"] == [1, 5, 9, 13, 17, 21]
    with Image.open(out) as image:
        sheet = np.asarray(image.convert("RGBA"))
    assert sheet.shape == (400, 600, 4)
    assert sheet[2, 590, 3] == 0
    # six balls, apart from each other: two rows of three
    opaque = sheet[..., 3] > 250
    long = lambda along: "".join("x" if many else " " for many in along).split()  # noqa: E731
    assert len([each for each in long(opaque.sum(axis=1) > 150) if len(each) > 80]) == 2
    middle = opaque[: opaque.shape[0] // 2]
    assert len([each for each in long(middle.sum(axis=0) > 60) if len(each) > 60]) == 3
    assert run(capsys, "gallery", ball, *options, "--dark", "-o", out)[0] == 0
    with Image.open(out) as image:
        assert np.asarray(image.convert("RGB"))[2, 590].max() < 80


def test_a_gallery_of_every_kind_is_drawn(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    from meshmash_viewer.fields import FAMILIES

    kinds = [name for name, family in FAMILIES.items() if family.position]
    for kind in kinds:
        options = ("--kind", kind, "--count", 20, "--n-components", 5, "--size", "300x200")
        status, _, err = run(capsys, "gallery", ball, *options, "-o", tmp_path / f"{kind}.png")
        assert (status, err) == (0, ""), kind
    sheets = [np.asarray(Image.open(tmp_path / f"{kind}.png").convert("RGB")) for kind in kinds]
    assert all(sheet.std() > 5.0 for sheet in sheets)


@pytest.mark.parametrize(
    ("arguments", "clause"),
    [
        (["gallery", "{ball}", "-o", "out.jpg"], ".png"),
        (["gallery", "{ball}", "-o", "out.png", "--kind", "similarity"], "invalid choice"),
        (["gallery", "{ball}", "-o", "out.png", "--count", "9", "--columns", "0:12"], "9 columns"),
        (["gallery", "{ball}", "-o", "out.png", "--count", "9", "--columns", "x"], "START:STOP"),
        (["gallery", "{ball}", "-o", "out.png", "--count", "9", "--size", "40x40"], "too small"),
        (["gallery", "{ball}", "-o", "out.png", "--count", "9", "--colormap", "x"], "colour map"),
        (["gallery", "{ball}", "-o", "out.png", "--count", "9", "--limits", "2", "1"], "swap"),
    ],
)
def test_what_can_be_mended_is_one_line_and_no_file(
    capsys: pytest.CaptureFixture[str],
    ball: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    clause: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, *[each.format(ball=ball) for each in arguments])
    assert (status, out) == (2, "")
    assert clause in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [ball]
