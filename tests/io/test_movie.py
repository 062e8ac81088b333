from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from faults import raises
from PIL import Image
from tiers import slow

from meshmash_viewer.io.movie import MOVIE_ENDINGS, check_movie, movie_file

WIDTH, HEIGHT = 96, 64


def frames(count: int) -> Iterator[np.ndarray]:
    """Yield frames of a disc that moves right over a gradient."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for at in range(count):
        frame = np.stack([x * 2, y * 3, np.full_like(x, 90)], axis=2).astype(np.uint8)
        inside = (x - 12 - 6 * at) ** 2 + (y - 30) ** 2 < 100
        frame[inside] = (250, 240, 20)
        yield frame


def read(path: Path) -> tuple[list[np.ndarray], float]:
    """Return the frames and the duration (s) of a movie, decoded by FFmpeg or Pillow."""
    if path.suffix == ".mp4":
        imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
        program = imageio_ffmpeg.get_ffmpeg_exe()
        asked = [program, "-loglevel", "error", "-i", path, "-f", "rawvideo"]
        done = subprocess.run([*asked, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
        pixels = np.frombuffer(done.stdout, np.uint8).reshape(-1, HEIGHT, WIDTH, 3)
        return list(pixels), imageio_ffmpeg.count_frames_and_secs(str(path))[1]
    shown, length = [], 0.0
    with Image.open(path) as image:
        assert image.info.get("loop") == 0
        for at in range(image.n_frames):
            image.seek(at)
            image.load()
            shown.append(np.asarray(image.convert("RGB")))
            length += image.info["duration"] / 1000.0
    return shown, length


def written(path: Path, count: int, rate: float) -> Path:
    with movie_file(path, (WIDTH, HEIGHT), rate) as add:
        for frame in frames(count):
            add(frame)
    return path


def given_up(path: Path, count: int) -> None:
    with movie_file(path, (WIDTH, HEIGHT), 10.0) as add:
        for frame in frames(count):
            add(frame)
        raise KeyError


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
@pytest.mark.parametrize("rate", [slow(4.0), 30.0])
def test_what_is_written_is_read_back(tmp_path: Path, ending: str, rate: float) -> None:
    shown, length = read(written(tmp_path / f"film{ending}", 9, rate))
    assert len(shown) == 9
    assert length == pytest.approx(9 / rate, abs=0.006)
    for wanted, got in zip(frames(9), shown, strict=True):
        assert got.shape == wanted.shape
        assert np.abs(wanted.astype(int) - got).mean() < 6.0  # a GIF has 256 colours
    assert not [each for each in tmp_path.iterdir() if each.name != f"film{ending}"]


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
def test_a_movie_that_is_given_up_leaves_the_old_one(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"film{ending}"
    path.write_bytes(b"old")
    with pytest.raises(KeyError):
        given_up(path, 4)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize(
    ("name", "size", "rate", "code"),
    [
        ("film.avi", (64, 64), 10.0, "unknown-ending"),
        ("film.apng", (64, 64), 10.0, "unknown-ending"),
        ("film.webp", (64, 64), 10.0, "unknown-ending"),
        ("film", (64, 64), 10.0, "unknown-ending"),
        (".gif", (64, 64), 10.0, "unknown-ending"),
        ("film.mp4", (65, 64), 10.0, "odd-size"),
        ("film.gif", (64, 64), 60.0, "out-of-range"),
        ("film.gif", (64, 64), 0.0, "out-of-range"),
        ("film.gif", (64, 64), float("nan"), "out-of-range"),
    ],
)
def test_what_a_format_cannot_hold_is_said(
    name: str, size: tuple[int, int], rate: float, code: str
) -> None:
    with raises(code):
        check_movie(name, size, rate)


def test_without_ffmpeg_there_is_no_mp4(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with raises("package-missing"):
        check_movie("film.mp4", (64, 64), 10.0)
    check_movie("film.gif", (64, 64), 10.0)


@pytest.mark.parametrize("reads", ["exit", "cat > /dev/null; exit"])
def test_an_ffmpeg_that_fails_is_a_sentence_and_no_file(
    reads: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ends while frames are written, or after the last one."""
    if sys.platform.startswith("win"):
        pytest.skip("ffmpeg is replaced by a shell script")
    pytest.importorskip("imageio_ffmpeg")
    program = tmp_path / "ffmpeg"
    program.write_text(f"#!/bin/sh\n{reads} 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(program))
    folder = tmp_path / "out"
    folder.mkdir()
    with raises("not-writable"):
        written(folder / "film.mp4", 60, 10.0)
    assert not list(folder.iterdir())
