"""Movie files: GIF, written by Pillow, and MP4, written by imageio-ffmpeg."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, package_missing, unknown_ending
from meshmash_viewer.io.atomic import writing_errors, written_whole

Frame: TypeAlias = npt.NDArray[np.uint8]
Add: TypeAlias = Callable[[Frame], None]

#: Default frame rate (1/s), and default duration (s) of a turntable movie.
TURN_RATE, TURN_SECONDS = 25.0, 6.0
#: Highest frame rates (1/s). GIF frames have durations in hundredths of a second, and many
#: programs play a duration of one hundredth more slowly.
_FASTEST, _FASTEST_GIF = 120.0, 50.0


@contextmanager
def movie_file(path: str | Path, size: tuple[int, int], rate: float) -> Iterator[Add]:
    """Yield a function that appends a frame to a movie.

    The file appears at the end of the body, unless an exception was raised. The path has one of
    `MOVIE_ENDINGS`, the size is width and height in pixels, and the rate in frames per second. A
    frame is uint8 of shape (height, width, 3), top row first. `InputError` is raised as by
    `check_movie`, and if the file cannot be written.
    """
    path = Path(path)
    check_movie(path, size, rate)
    writer = _WRITERS[path.suffix.lower()]
    with writing_errors(path), written_whole(path) as part, writer(part, size, rate) as write:

        def add(frame: Frame) -> None:
            if frame.shape != (size[1], size[0], 3):
                raise ValueError(f"A frame of shape {frame.shape} in a movie of {size}.")
            write(np.ascontiguousarray(frame))

        yield add


def check_movie(path: str | Path, size: tuple[int, int], rate: float) -> None:
    """Check, before drawing, that a movie format supports a size and a frame rate.

    `InputError` is raised if the ending is unknown, the encoder is not installed, or the size or
    rate is not supported.
    """
    path, (width, height) = Path(path), size
    ending = path.suffix.lower()
    if ending not in _WRITERS or not path.stem:
        raise unknown_ending(path, MOVIE_ENDINGS)
    if missing := missing_encoder(ending):
        raise missing
    fastest = _FASTEST_GIF if ending == ".gif" else _FASTEST
    if not 0.0 < rate <= fastest:
        fault = f"{ending} does not support {rate:g} frames per second"
        raise InputError("out-of-range", fault, f"choose a rate above 0 and up to {fastest:g}")
    if ending == ".mp4" and (width % 2 or height % 2):
        even = f"{max(width // 2 * 2, 2)}x{max(height // 2 * 2, 2)}"
        fault = f"An MP4 has an even width and height, and {width}x{height} are not"
        raise InputError("odd-size", fault, f"take {even}")


def missing_encoder(ending: str) -> InputError | None:
    """Return the fault of a movie format whose encoder is not installed, or None."""
    if ending != ".mp4":
        return None
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):  # the package, or ffmpeg itself
        return package_missing("An MP4 needs", "imageio-ffmpeg", "movie")
    return None


@contextmanager
def _gif(part: Path, _size: tuple[int, int], rate: float) -> Iterator[Add]:
    """Write a GIF with a colour table per frame; its frames are in memory, a byte per pixel."""
    from PIL import Image

    frames: list[Image.Image] = []
    yield lambda frame: frames.append(Image.fromarray(frame).quantize(256))
    # in hundredths of a second; rounding errors do not accumulate
    ends = np.rint(100.0 / rate * np.arange(len(frames) + 1))
    durations = [10 * int(each) for each in np.diff(ends)]
    first, *others = frames
    first.save(part, "GIF", save_all=True, append_images=others, duration=durations, loop=0)


@contextmanager
def _mp4(part: Path, size: tuple[int, int], rate: float) -> Iterator[Add]:
    """Write H.264, which every browser plays."""
    import imageio_ffmpeg

    width, height = size
    frames = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {rate} -i - -an"
    movie = "-c:v libx264 -crf 17 -pix_fmt yuv420p -movflags +faststart -f mp4 -y"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *frames.split(), *movie.split()]
    # Ctrl-C does not reach ffmpeg, which would end the movie
    with subprocess.Popen(
        [*command, str(part)],
        stdin=subprocess.PIPE,
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        start_new_session=True,
    ) as process:
        pipe = process.stdin
        assert pipe is not None

        def add(frame: Frame) -> None:
            pipe.write(frame.data)

        try:
            yield add
            pipe.close()
        except BaseException as fault:
            process.kill()  # it would write the rest of its file first
            with suppress(OSError):  # the pipe is broken
                pipe.close()
            if not isinstance(fault, OSError):
                raise
    if process.returncode:  # it has printed why
        remedy = "write .gif, or make space on the disk"
        raise InputError("not-writable", "ffmpeg cannot write this movie", remedy)


_WRITERS: dict[str, Callable[[Path, tuple[int, int], float], AbstractContextManager[Add]]] = {
    ".mp4": _mp4,
    ".gif": _gif,
}

#: Endings of movies; MP4 needs imageio-ffmpeg (see `missing_encoder`).
MOVIE_ENDINGS = tuple(_WRITERS)
