"""Moving pictures to files, one frame at a time: GIF, WebP, APNG, and MP4 where there is ffmpeg.

Each frame is coded by itself, GIF, WebP and APNG by Pillow, and written before the next one comes:
Pillow's own writers of moving pictures hold all frames, and make one of those that are equal.
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
from meshmash_viewer.io.pipes import closed_pipe_errors

__all__ = [
    "MOVIE_ENDINGS",
    "TURN_RATE",
    "TURN_SECONDS",
    "check_movie",
    "estimated_bytes",
    "missing_encoder",
    "movie_file",
]

Frame: TypeAlias = npt.NDArray[np.uint8]
Add: TypeAlias = Callable[[Frame], None]

#: Frames a second and length of a turn, where nothing else is said.
TURN_RATE, TURN_SECONDS = 25.0, 6.0
#: Frames a second at most: what files and eyes can tell. The delays of a GIF are hundredths of a
#: second, and programs take one of a single hundredth for a mistake.
_FASTEST, _FASTEST_GIF = 120.0, 50.0
_LARGEST_WEBP = 16_383


@contextmanager
def movie_file(
    path: str | Path, size: tuple[int, int], rate: float, n_frames: int
) -> Iterator[Callable[[Frame], None]]:
    """Write a movie; it is there when the body has ended, and not at all if that raises.

    Parameters
    ----------
    path : str or Path
        With one of `MOVIE_ENDINGS`.
    size : (int, int)
        Width and height in pixels.
    rate : float
        Frames a second.
    n_frames : int

    Yields
    ------
    callable
        Takes the next frame, uint8 of shape (height, width, 3), first row on top.

    Raises
    ------
    InputError
        See `check_movie`; and if the system refuses.
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
    """See, before anything is drawn, that a format can hold what is asked for.

    Raises
    ------
    InputError
        If the ending is unknown, its encoder is missing, or size or rate are not possible.
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
            f"A rate of {rate:g} frames a second is none that {ending} can have: choose one above 0"
            f" and up to {fastest:g}."
        )
    if ending == ".mp4" and (width % 2 or height % 2):
        even = f"{max(width // 2 * 2, 2)}x{max(height // 2 * 2, 2)}"
        raise InputError(
            f"An MP4 has an even width and height, and {width}x{height} are not: take {even}."
        )
    if ending == ".webp" and max(size) > _LARGEST_WEBP:
        raise InputError(f"A WebP has at most {_LARGEST_WEBP} pixels a side: make it smaller.")


def missing_encoder(ending: str) -> str:
    """Why no movie with this ending can be written here, and the way out; empty if it can."""
    if ending != ".mp4" or _ffmpeg() is not None:
        return ""
    return (
        'An MP4 needs ffmpeg, which is not installed: pip install "meshmash-viewer[movie]", or'
        " write .gif, .webp or .apng."
    )


def estimated_bytes(ending: str, frames: Sequence[Frame], rate: float, n_frames: int) -> int:
    """About how large a movie will be, from its first frames.

    Parameters
    ----------
    ending : str
        One of `MOVIE_ENDINGS`.
    frames : sequence of ndarray of uint8, shape (height, width, 3)
        Two or more, or all.
    rate : float
    n_frames : int
        Of the whole movie.
    """
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
    """How long each frame is shown in a unit (s), rounded so that the whole is as long as it is."""
    frame = before = 0
    while True:
        frame += 1
        end = round(frame / rate / unit)
        yield end - before
        before = end


def _coded(frame: Frame, form: str, **options: int) -> bytes:
    """One frame as a picture of its own."""
    from PIL import Image

    image: Image.Image = Image.fromarray(np.ascontiguousarray(frame))
    if form == "GIF":
        image = image.quantize(256)
    coded = io.BytesIO()
    image.save(coded, form, **options)
    return coded.getvalue()


# GIF ------------------------------------------------------------------------------------------


@contextmanager
def _gif(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """GIF89a: every frame with the colours that suit it."""
    delays = _delays(rate, 0.01)
    with part.open("wb") as file:
        file.write(b"GIF89a" + struct.pack("<HHBBB", *size, 0x70, 0, 0))
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")  # again and again

        def add(frame: Frame) -> None:
            colors, shape, data = _gif_parts(_coded(frame, "GIF", interlace=0))
            # the number of colours is a power of two: 2 << bits
            bits = (len(colors) // 3).bit_length() - 2
            file.write(struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0x04, next(delays), 0, 0))
            file.write(shape + bytes([0x80 | bits]) + colors + data)

        yield add
        file.write(b";")


def _gif_parts(picture: bytes) -> tuple[bytes, bytes, bytes]:
    """Colours, description and data of the picture in a GIF of one."""
    end = 13 + 3 * (2 << (picture[10] & 7))
    colors, at = picture[13:end], end
    while picture[at] == 0x21:  # extensions, each of blocks that begin with their length
        at += 2
        while picture[at]:
            at += 1 + picture[at]
        at += 1
    return colors, picture[at : at + 9], picture[at + 10 : -1]


# WebP -----------------------------------------------------------------------------------------


@contextmanager
def _webp(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """RIFF with a chunk a frame, which holds a still picture's."""
    delays = _delays(rate, 0.001)
    sides = b"".join((side - 1).to_bytes(3, "little") for side in size)
    with part.open("wb") as file:
        file.write(b"RIFF\x00\x00\x00\x00WEBP")
        file.write(_riff(b"VP8X", b"\x02\x00\x00\x00" + sides))
        file.write(_riff(b"ANIM", b"\xff\xff\xff\xff\x00\x00"))  # again and again

        def add(frame: Frame) -> None:
            still = _coded(frame, "WEBP", quality=88, method=4)
            data, at = b"", 12
            while at < len(still):
                length = 8 + struct.unpack_from("<I", still, at + 4)[0]
                length += length % 2
                if still[at : at + 4] in (b"ALPH", b"VP8 ", b"VP8L"):
                    data += still[at : at + length]
                at += length
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
    """PNG with a control chunk before the data of each frame."""
    from PIL import Image
    from PIL.PngImagePlugin import getchunks, putchunk

    delay = (1 / Fraction(rate)).limit_denominator(65_535)
    number = 0
    with part.open("wb") as file:

        def control() -> None:
            nonlocal number
            numbers = (number, *size, 0, 0, delay.numerator, delay.denominator, 0, 0)
            putchunk(file, b"fcTL", struct.pack(">IIIIIHHBB", *numbers))
            number += 1

        def add(frame: Frame) -> None:
            nonlocal number
            first = number == 0
            for name, data, _ in getchunks(Image.fromarray(np.ascontiguousarray(frame))):
                if name == b"IHDR":
                    if first:
                        file.write(b"\x89PNG\r\n\x1a\n")
                        putchunk(file, name, data)
                        putchunk(file, b"acTL", struct.pack(">II", n_frames, 0))
                    control()
                elif name == b"IDAT" and first:
                    putchunk(file, name, data)
                elif name == b"IDAT":
                    putchunk(file, b"fdAT", struct.pack(">I", number), data)
                    number += 1

        yield add
        putchunk(file, b"IEND")


# MP4 ------------------------------------------------------------------------------------------


def _ffmpeg() -> str | None:
    """The program, as imageio-ffmpeg brings it or as it is installed."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


@contextmanager
def _mp4(part: Path, size: tuple[int, int], rate: float, n_frames: int) -> Iterator[Add]:
    """H.264, as every browser and slide shows it; frames go through a pipe."""
    program = _ffmpeg()
    assert program is not None, "check_movie has seen to that"
    asked = [
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}"),
        *("-r", str(Fraction(rate).limit_denominator(1001)), "-i", "-"),
        *("-an", "-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p"),
        *("-movflags", "+faststart", "-f", "mp4", str(part)),
    ]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [program, "-y", "-loglevel", "error", *asked],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=said,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        pipe = process.stdin
        assert pipe is not None

        def fault() -> InputError:
            process.wait()
            said.seek(0)
            words = said.read().decode(errors="replace").split("\n")[0].strip()
            return InputError(
                f"ffmpeg cannot write this movie ({words or process.returncode}): write .gif,"
                ' .webp or .apng, or pip install "meshmash-viewer[movie]" for another ffmpeg.'
            )

        def add(frame: Frame) -> None:
            try:
                with closed_pipe_errors():
                    pipe.write(frame.tobytes())
            except BrokenPipeError:
                raise fault() from None

        try:
            yield add
            try:
                with closed_pipe_errors():
                    pipe.close()
            except BrokenPipeError:
                raise fault() from None
            if process.wait():
                raise fault()
        finally:
            process.kill()
            process.wait()
            with suppress(OSError):  # what was left in it is not wanted
                pipe.close()


_WRITERS: dict[str, Callable[[Path, tuple[int, int], float, int], AbstractContextManager[Add]]] = {
    ".mp4": _mp4,
    ".gif": _gif,
    ".webp": _webp,
    ".apng": _apng,
}

#: Of movies that can be written; MP4 where there is ffmpeg.
MOVIE_ENDINGS = tuple(_WRITERS)
