from __future__ import annotations

import errno
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from PIL import Image
from tiers import slow, slow_unless

from meshmash_viewer.errors import InputError
from meshmash_viewer.io import movie
from meshmash_viewer.io.movie import MOVIE_ENDINGS, check_movie, estimated_bytes, movie_file

WIDTH, HEIGHT = 96, 64


def frames(count: int) -> Iterator[np.ndarray]:
    """Yield frames of a disc that moves right over a gradient; the first two are equal."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for at in range(count):
        frame = np.stack([x * 2, y * 3, np.full_like(x, 90)], axis=2).astype(np.uint8)
        inside = (x - 12 - 8 * max(at - 1, 0)) ** 2 + (y - 30) ** 2 < 100
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


def written(path: Path, count: int, rate: float, said: int | None = None) -> Path:
    with movie_file(path, (WIDTH, HEIGHT), rate, said or count) as add:
        for frame in frames(count):
            add(frame)
    return path


def given_up(path: Path, count: int) -> None:
    with movie_file(path, (WIDTH, HEIGHT), 10.0, 9) as add:
        for frame in frames(count):
            add(frame)
        raise KeyError


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
@pytest.mark.parametrize("rate", [slow(4.0), 30.0])
def test_what_is_written_is_read_back(tmp_path: Path, ending: str, rate: float) -> None:
    shown, length = read(written(tmp_path / f"film{ending}", 9, rate))
    assert len(shown) == 9, "equal frames are frames, too"
    assert length == pytest.approx(9 / rate, abs=0.006)
    for wanted, got in zip(frames(9), shown, strict=True):
        assert got.shape == wanted.shape
        # only APNG is lossless; a GIF has 256 colours
        assert np.abs(wanted.astype(int) - got).mean() < (0.01 if ending == ".apng" else 6.0)
    assert not [each for each in tmp_path.iterdir() if each.name != f"film{ending}"]


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
def test_one_frame_is_a_movie(tmp_path: Path, ending: str) -> None:
    shown, _ = read(written(tmp_path / f"film{ending}", 1, 10.0))
    assert len(shown) == 1


@pytest.mark.parametrize("ending", slow_unless(lambda ending: ending != ".gif", MOVIE_ENDINGS))
def test_what_is_held_does_not_grow_with_the_frames(tmp_path: Path, ending: str) -> None:
    def most(count: int) -> int:
        tracemalloc.start()
        written(tmp_path / f"film{ending}", count, 10.0)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    most(2)
    assert most(60) < most(6) + 2 * WIDTH * HEIGHT * 3


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
def test_a_movie_that_is_given_up_leaves_the_old_one(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"film{ending}"
    path.write_bytes(b"old")
    with pytest.raises(KeyError):
        given_up(path, 4)
    with pytest.raises(ValueError, match="8 frames in a movie of 9"):
        written(path, 8, 10.0, said=9)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize("ending", MOVIE_ENDINGS)
def test_the_size_is_told_from_the_first_frames(tmp_path: Path, ending: str) -> None:
    told = estimated_bytes(ending, list(frames(6)), 10.0, 12)
    size = written(tmp_path / f"film{ending}", 12, 10.0).stat().st_size
    assert told == pytest.approx(size, rel=0.3)


@pytest.mark.parametrize(
    ("name", "size", "rate", "clause"),
    [
        ("film.avi", (64, 64), 10.0, ".mp4 .gif"),
        ("film", (64, 64), 10.0, "no ending"),
        (".gif", (64, 64), 10.0, "no ending"),
        ("film.mp4", (65, 64), 10.0, "take 64x64"),
        ("film.gif", (64, 64), 60.0, "up to 50"),
        ("film.webp", (64, 64), 0.0, "above 0"),
        ("film.webp", (16384, 64), 10.0, "smaller"),
        ("film.apng", (64, 64), float("nan"), "above 0"),
    ],
)
def test_what_a_format_cannot_hold_is_said(
    name: str, size: tuple[int, int], rate: float, clause: str
) -> None:
    with pytest.raises(InputError, match=clause):
        check_movie(name, size, rate)


def test_without_ffmpeg_there_is_no_mp4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"pip install \"meshmash-viewer\[movie\]\""):
        check_movie("film.mp4", (64, 64), 10.0)
    check_movie("film.gif", (64, 64), 10.0)


def test_an_ffmpeg_that_fails_is_said_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if sys.platform.startswith("win"):
        pytest.skip("scripts are the system's own affair")
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(movie, "_ffmpeg", lambda: str(program))
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="Unknown encoder libx264"):
        written(tmp_path / "out" / "film.mp4", 60, 10.0)
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("at", ["write", "close"])
@pytest.mark.parametrize("number", [errno.EPIPE, errno.EINVAL])
def test_an_ffmpeg_that_has_gone_is_a_sentence_on_every_system(
    at: str, number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Writing to a closed pipe fails with EINVAL on Windows and EPIPE on POSIX."""
    start = subprocess.Popen

    class Gone:
        def __init__(self, pipe: IO[bytes]) -> None:
            self._pipe = pipe

        def write(self, data: bytes) -> None:
            if at == "write":
                self._fail()

        def close(self) -> None:
            self._pipe.close()
            self._fail()

        def _fail(self) -> None:
            raise OSError(number, os.strerror(number))

    def ending(*_: object, **options: Any) -> subprocess.Popen[bytes]:
        code = "import sys; sys.exit('Unknown encoder libx264')"
        process = start([sys.executable, "-c", code], **options)
        process.stdin = Gone(process.stdin)  # type: ignore[assignment, arg-type]
        return process

    monkeypatch.setattr(movie, "_ffmpeg", lambda: "ffmpeg")
    monkeypatch.setattr(subprocess, "Popen", ending)
    with pytest.raises(InputError, match="Unknown encoder libx264"):
        written(tmp_path / "film.mp4", 60, 10.0)
    assert not list(tmp_path.iterdir())


def test_no_process_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def noted(*arguments: object, **options: object) -> subprocess.Popen[bytes]:
        begun.append(start(*arguments, **options))  # type: ignore[call-overload]
        return begun[-1]

    if movie.missing_encoder(".mp4"):
        pytest.skip("no ffmpeg")
    monkeypatch.setattr(movie.subprocess, "Popen", noted)
    with pytest.raises(KeyError):
        given_up(tmp_path / "film.mp4", 1)
    assert begun
    assert all(each.poll() is not None for each in begun)
