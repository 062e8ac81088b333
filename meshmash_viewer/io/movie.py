"""Movie files, written frame by frame: GIF, WebP, APNG, and MP4 where ffmpeg is installed.

Pillow encodes each frame as a still picture; this module writes the picture data to the container.
Pillow's writers of animations are not used, as they keep all frames in memory and merge equal ones.
"""

from __future__ import annotations

import io
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.atomic import writing_errors, written_whole
from meshmash_viewer.work import closed_pipe_errors

Frame: TypeAlias = npt.NDArray[np.uint8]
Add: TypeAlias = Callable[[Frame], None]

#: Default frame rate (1/s), and default duration (s) of a turntable movie.
TURN_RATE, TURN_SECONDS = 25.0, 6.0
#: Highest frame rates (1/s). GIF frames have durations in hundredths of a second, and many
#: programs play a duration of one hundredth more slowly.
_FASTEST, _FASTEST_GIF = 120.0, 50.0
_LARGEST_WEBP = 16_383


@contextmanager
def movie_file(
    path: str | Path, size: tuple[int, int], rate: float, n_frames: int
) -> Iterator[Add]:
    """Yield a function that appends a frame to a movie.

    The file appears at the end of the body, unless an exception was raised. The path has one of
    `MOVIE_ENDINGS`, the size is width and height in pixels, and the rate in frames per second. A
    frame is uint8 of shape (height, width, 3), top row first. `InputError` is raised as by
    `check_movie`, and if the file cannot be written.
    """
    path = Path(path)
    check_movie(path, size, rate)
    added = 0
    with writing_errors(path), written_whole(path) as part:
        with _WRITERS[path.suffix.lower()](part, size, rate, n_frames) as write:

            def add(frame: Frame) -> None:
                nonlocal added
                if frame.shape != (size[1], size[0], 3):
                    raise ValueError(f"A frame of shape {frame.shape} in a movie of {size}.")
                write(frame)
                added += 1

            yield add
        if added != n_frames:
            raise ValueError(f"{added} frames in a movie of {n_frames}.")


def check_movie(path: str | Path, size: tuple[int, int], rate: float) -> None:
    """Check, before drawing, that a movie format supports a size and a frame rate.

    `InputError` is raised if the ending is unknown, the encoder is not installed, or the size or
    rate is not supported.
    """
    path, (width, height) = Path(path), size
    ending = path.suffix.lower()
    if ending not in _WRITERS or not path.stem:
        raise InputError(
            f"{path} has no ending in which movies can be written; give it one of"
            f" {' '.join(MOVIE_ENDINGS)}."
        )
    missing = missing_encoder(ending)
    if missing:
        raise InputError(missing)
    fastest = _FASTEST_GIF if ending == ".gif" else _FASTEST
    if not 0.0 < rate <= fastest:
        raise InputError(
            f"{ending} does not support {rate:g} frames per second: choose a rate above 0"
            f" and up to {fastest:g}."
        )
    if ending == ".mp4" and (width % 2 or height % 2):
        even = f"{max(width // 2 * 2, 2)}x{max(height // 2 * 2, 2)}"
        raise InputError(
            f"An MP4 has an even width and height, and {width}x{height} are not: take {even}."
        )
    if ending == ".webp" and max(size) > _LARGEST_WEBP:
        raise InputError(f"A WebP has at most {_LARGEST_WEBP} pixels per side: make it smaller.")


def missing_encoder(ending: str) -> str:
    """Return a sentence on the missing encoder of a movie format; "" if it is installed."""
    if ending != ".mp4" or _ffmpeg() is not None:
        return ""
    return (
        'An MP4 needs ffmpeg, which is not installed: pip install "meshmash-viewer[movie]", or'
        " write .gif, .webp or .apng."
    )


def estimated_bytes(ending: str, frames: Sequence[Frame], rate: float, n_frames: int) -> int:
    """Estimate the size of a movie of `n_frames` from its first frames (two or more, or all)."""
    height, width, _ = frames[0].shape
    sizes = []
    with tempfile.TemporaryDirectory() as folder:
        for count in sorted({1, len(frames)}):
            path = Path(folder) / f"{count}{ending}"
            with movie_file(path, (width, height), rate, count) as add:
                for frame in frames[:count]:
                    add(frame)
            sizes.append(path.stat().st_size)
    each = (sizes[-1] - sizes[0]) / max(len(frames) - 1, 1)
    return round(sizes[0] + each * (n_frames - 1))


def _delays(rate: float, unit: float) -> Iterator[int]:
    """Yield frame durations in units of `unit` seconds; rounding errors do not accumulate."""
    frame = before = 0
    while True:
        frame += 1
        end = round(frame / rate / unit)
        yield end - before
        before = end


def _encoded(frame: Frame, form: str, **options: int) -> bytes:
    """Encode a frame as a still picture."""
    from PIL import Image

    image: Image.Image = Image.fromarray(np.ascontiguousarray(frame))
    if form == "GIF":
        image = image.quantize(256)
    encoded = io.BytesIO()
    image.save(encoded, form, **options)
    return encoded.getvalue()


# GIF ------------------------------------------------------------------------------------------


@contextmanager
def _gif(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """Write GIF89a with a colour table per frame."""
    delays = _delays(rate, 0.01)
    with part.open("wb") as file:
        file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0x70, 0, 0))
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")  # loop without end

        def add(frame: Frame) -> None:
            still = _encoded(frame, "GIF", interlace=0)
            start = 13 + 3 * (2 << (still[10] & 7))
            colors = still[13:start]
            while still[start] == 0x21:  # skip extensions: blocks, each after its length
                start += 2
                while still[start]:
                    start += 1 + still[start]
                start += 1
            description, data = still[start : start + 9], still[start + 10 : -1]
            # the number of colours is a power of two: 2 << bits
            bits = (len(colors) // 3).bit_length() - 2
            file.write(struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0x04, next(delays), 0, 0))
            file.write(description + bytes([0x80 | bits]) + colors + data)

        yield add
        file.write(b";")


# WebP -----------------------------------------------------------------------------------------


@contextmanager
def _webp(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """Write WebP: RIFF with a chunk per frame, which contains the data of a still WebP."""
    delays = _delays(rate, 0.001)
    sides = b"".join((side - 1).to_bytes(3, "little") for side in size)
    with part.open("wb") as file:
        file.write(b"RIFF\x00\x00\x00\x00WEBP")
        file.write(_riff(b"VP8X", b"\x02\x00\x00\x00" + sides))
        file.write(_riff(b"ANIM", b"\xff\xff\xff\xff\x00\x00"))  # loop without end

        def add(frame: Frame) -> None:
            still, data, start = _encoded(frame, "WEBP", quality=88, method=4), b"", 12
            while start < len(still):
                length = 8 + struct.unpack_from("<I", still, start + 4)[0]
                length += length % 2
                if still[start : start + 4] in (b"ALPH", b"VP8 ", b"VP8L"):
                    data += still[start : start + length]
                start += length
            place = bytes(6) + sides + next(delays).to_bytes(3, "little") + b"\x02"
            file.write(_riff(b"ANMF", place + data))

        yield add
        length = file.tell() - 8
        file.seek(4)
        file.write(struct.pack("<I", length))


def _riff(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)


# APNG -----------------------------------------------------------------------------------------


@contextmanager
def _apng(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """Write APNG: PNG with a control chunk before the data of each frame."""
    from PIL import Image
    from PIL.PngImagePlugin import getchunks, putchunk

    delay = (1 / Fraction(rate)).limit_denominator(65_535)
    number = 0
    with part.open("wb") as file:

        def add(frame: Frame) -> None:
            nonlocal number
            first = number == 0
            for name, data, _ in getchunks(Image.fromarray(np.ascontiguousarray(frame))):
                if name == b"IHDR":
                    if first:
                        file.write(b"\x89PNG\r\n\x1a\n")
                        putchunk(file, name, data)
                        putchunk(file, b"acTL", struct.pack(">II", n_frames, 0))
                    control = (number, *size, 0, 0, delay.numerator, delay.denominator, 0, 0)
                    putchunk(file, b"fcTL", struct.pack(">IIIIIHHBB", *control))
                    number += 1
                elif name == b"IDAT" and first:
                    putchunk(file, name, data)
                elif name == b"IDAT":
                    putchunk(file, b"fdAT", struct.pack(">I", number), data)
                    number += 1

        yield add
        putchunk(file, b"IEND")


# MP4 ------------------------------------------------------------------------------------------


def _ffmpeg() -> str | None:
    """Return the path of ffmpeg from imageio-ffmpeg or on the PATH; None if not installed."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


@contextmanager
def _mp4(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """Write H.264, which every browser plays, through a pipe to ffmpeg."""
    program = _ffmpeg()
    assert program is not None, "see check_movie"
    command = [
        *(program, "-y", "-loglevel", "error"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"),
        *("-r", str(Fraction(rate).limit_denominator(1001)), "-i", "-"),
        *("-an", "-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p"),
        *("-movflags", "+faststart", "-f", "mp4", str(part)),
    ]
    with tempfile.TemporaryFile() as messages:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=messages,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        pipe = process.stdin
        assert pipe is not None

        def add(frame: Frame) -> None:
            with closed_pipe_errors():
                pipe.write(frame.tobytes())

        failed = True
        try:
            with suppress(BrokenPipeError):  # ffmpeg has ended; its message is reported later
                yield add
                with closed_pipe_errors():
                    pipe.close()
                failed = process.wait() != 0
            if failed:
                process.wait()
                messages.seek(0)
                message = messages.read().decode(errors="replace").split("\n")[0].strip()
                raise InputError(
                    f"ffmpeg cannot write this movie ({message or process.returncode}): write"
                    ' .gif, .webp or .apng, or pip install "meshmash-viewer[movie]" for another'
                    " ffmpeg."
                )
        finally:
            process.kill()
            process.wait()
            with suppress(OSError):  # frames that were not sent are not needed
                pipe.close()


_WRITERS: dict[str, Callable[[Path, tuple[int, int], float, int], AbstractContextManager[Add]]] = {
    ".mp4": _mp4,
    ".gif": _gif,
    ".webp": _webp,
    ".apng": _apng,
}

#: Endings of movies; MP4 needs ffmpeg (see `missing_encoder`).
MOVIE_ENDINGS = tuple(_WRITERS)
