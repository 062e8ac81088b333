"""Galleries and movies from the command line."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from commands import refused, run
from PIL import Image

from meshmash_viewer.fields.table import SWEPT
from meshmash_viewer.mesh import Mesh

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.fixture
def ball(sphere: Mesh, tmp_path: Path) -> Path:
    path = tmp_path / "ball.npz"
    np.savez(path, vertices=sphere.vertices, faces=sphere.faces)
    return path


@pytest.mark.pixels
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
    # six separate balls: two rows of three
    opaque = sheet[..., 3] > 250
    long = lambda along: "".join("x" if many else " " for many in along).split()  # noqa: E731
    assert len([each for each in long(opaque.sum(axis=1) > 150) if len(each) > 80]) == 2
    middle = opaque[: opaque.shape[0] // 2]
    assert len([each for each in long(middle.sum(axis=0) > 60) if len(each) > 60]) == 3
    covered = np.flatnonzero(middle.sum(axis=0) > 60)
    assert covered[0] + covered[-1] == pytest.approx(599, abs=4), "in the middle of the sheet"
    assert run(capsys, "gallery", ball, *options, "--dark", "-o", out)[0] == 0
    with Image.open(out) as image:
        assert np.asarray(image.convert("RGB"))[2, 590].max() < 128


@pytest.mark.slow
@pytest.mark.pixels
def test_a_gallery_of_every_kind_is_drawn(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    for kind in SWEPT:
        columns = ("--n-components", 5) if SWEPT[kind].counted else ()
        columns = ("--vertex", 4, "--vertex", 40) if kind == "distance" else columns
        options = ("--kind", kind, "--count", 20, *columns, "--size", "300x200")
        status, _, err = run(capsys, "gallery", ball, *options, "-o", tmp_path / f"{kind}.png")
        assert (status, err) == (0, ""), kind
    sheets = [np.asarray(Image.open(tmp_path / f"{kind}.png").convert("RGB")) for kind in SWEPT]
    assert all(sheet.std() > 5.0 for sheet in sheets)


def gallery(
    capsys: pytest.CaptureFixture[str], ball: Path, out: Path, *options: object
) -> tuple[np.ndarray, dict[str, object]]:
    """Return the pixels of a gallery and its report."""
    common = ("--count", 30, "--size", "300x200", "-o", out, "--json")
    status, text, err = run(capsys, "gallery", ball, *common, *options)
    assert (status, err) == (0, "")
    with Image.open(out) as image:
        return np.asarray(image.convert("RGB")).astype(int), json.loads(text)


@pytest.mark.slow
def test_what_no_eigenpairs_make_asks_for_none(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out = tmp_path / "sheet.png"
    _, report = gallery(capsys, ball, out, "--kind", "distance", "--vertex", 3, "--vertex", 8)
    assert report["columns"] == [0, 1]
    assert "proof" not in report
    options = ("--count", 30, "--kind", "distance", "--distance", "diffusion", "--vertex", 3)
    film = (*options, "--sweep", ":", "--rate", 5, "--seconds", 2, "--size", "160x120")
    assert run(capsys, "movie", ball, *film, "-o", tmp_path / "times.gif")[0] == 0
    shown, length = moving(tmp_path / "times.gif")
    assert (len(shown), length) == (10, 2000.0)
    assert np.abs(shown[0] - shown[-1]).mean() > 1.0, "the time goes on"


def moving(path: Path) -> tuple[list[np.ndarray], float]:
    """Return the frames and the duration in ms of a movie."""
    with Image.open(path) as image:
        shown, length = [], 0.0
        for at in range(image.n_frames):
            image.seek(at)
            image.load()
            shown.append(np.asarray(image.convert("RGB")).astype(int))
            length += image.info["duration"]
        return shown, length


@pytest.mark.slow
@pytest.mark.pixels
def test_a_sweep_shows_the_picture_of_each_column(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    out, alone = tmp_path / "sweep.gif", tmp_path / "alone.png"
    options = ("--count", 12, "--size", "320x240")
    done = run(capsys, "movie", ball, *options, "--sweep", "2:10:2", "-o", out, "--json")
    assert (done[0], done[2]) == (0, "")
    report = json.loads(done[1])
    assert (report["frames"], report["rate"], report["seconds"]) == (4, 4.0, 1.0)
    assert report["bytes"] == out.stat().st_size
    shown, length = moving(out)
    assert (len(shown), length) == (4, 1000.0)
    for at, column in enumerate(range(2, 10, 2)):
        field = ("--field", "eigenfunction", "--index", column)
        assert run(capsys, "render", ball, *options, *field, "-o", alone)[0] == 0
        wanted = np.asarray(Image.open(alone).convert("RGB")).astype(int)
        low = (slice(60, None), slice(None))  # below the title, which `render` words differently
        assert np.abs(shown[at][low] - wanted[low]).mean() < 1.5
    # `--seconds` and `--rate` set the number of frames and the duration.
    film = ("--kind", "hks", "--sweep", ":", "--seconds", 2, "--rate", 10)
    assert run(capsys, "movie", ball, *options, *film, "-o", tmp_path / "film.gif")[0] == 0
    shown, length = moving(tmp_path / "film.gif")
    assert (len(shown), length) == (20, 2000.0)


@pytest.mark.slow
@pytest.mark.pixels
def test_a_turn_shows_the_mesh_from_all_around(
    capsys: pytest.CaptureFixture[str], ball: Path, tmp_path: Path
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    from imageio_ffmpeg import count_frames_and_secs

    out = tmp_path / "turn.gif"
    options = ("--count", 9, "--size", "160x120", "--turntable", "--column", 2)
    options += ("--rate", 8, "--seconds", 1)
    status, text, err = run(capsys, "movie", ball, *options, "-o", out)
    assert (status, err) == (0, "")
    assert "8 frames, 1 s" in text
    shown, length = moving(out)
    assert (len(shown), length) == (8, 1000.0)
    assert min(np.abs(a - b).mean() for a, b in pairwise(shown)) > 0.5
    assert run(capsys, "movie", ball, *options, "-o", tmp_path / "turn.mp4")[0] == 0
    assert count_frames_and_secs(str(tmp_path / "turn.mp4")) == (8, pytest.approx(1.0))


@pytest.mark.parametrize(
    ("arguments", "clause"),
    [
        ("gallery {ball} -o out.jpg", ".png"),
        ("gallery {ball} -o out.png --kind similarity", "invalid choice"),
        ("gallery {ball} -o out.png --count 9 --columns 0:12", "9 columns"),
        ("gallery {ball} -o out.png --kind distance --vertex 9999", "no vertex 9999"),
        ("gallery {ball} -o out.png --kind map --map-name depth", "no map 'depth'"),
        ("movie {ball} -o film.gif --turntable --kind hks --vertex 3", "for --kind distance"),
        ("gallery {ball} -o out.png --count 9 --columns x", "START:STOP"),
        ("gallery {ball} -o out.png --count 9 --size 40x40", "too few for 9 pictures"),
        ("gallery {ball} -o out.png --count 9 --colormap x", "colour map"),
        ("movie {ball} -o film.gif", "--sweep --turntable"),
        ("movie {ball} -o film.avi --turntable", ".mp4, .gif"),
        ("movie {ball} -o film.mp4 --turntable --size 65x64", "64x64"),
        ("movie {ball} -o film.gif --turntable --rate 80", "up to 50"),
        ("movie {ball} -o film.gif --turntable --seconds -1", "give positive ones"),
        (
            "movie {ball} -o film.gif --count 9 --sweep 0:9 --rate 20 --seconds 3",
            "60 frames are more than the 9 columns",
        ),
        ("movie {ball} -o film.gif --count 9 --sweep 0:9 --column 3", "--turntable"),
    ],
)
def test_what_can_be_mended_is_one_line_and_no_file(
    capsys: pytest.CaptureFixture[str],
    ball: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: str,
    clause: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(capsys, clause, *arguments.format(ball=ball).split())
    assert list(tmp_path.iterdir()) == [ball]
