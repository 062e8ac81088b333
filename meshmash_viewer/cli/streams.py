"""Standard output and error in any encoding, also if they are missing or closed.

Windows redirects output in the code page of the country, a terminal over ssh may be ASCII, and a
program without a console has no streams. Characters that the encoding lacks are written as their
escape sequences, λ as ``\\u03bb``.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import TextIO

from meshmash_viewer.units import plain_text
from meshmash_viewer.work import closed_pipe_errors

PROGRAM = "meshmash-viewer"


def prepare_streams() -> None:
    """Make standard streams accept every character, and replace missing streams."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # no console, or closed streams
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def answer(text: str) -> None:
    """Print a result with plain spaces and minus signs, which other programs can read.

    `BrokenPipeError` is raised if the reader of standard output has closed it.
    """
    with closed_pipe_errors():
        print(plain_text(text), flush=True)


def say(sentence: str) -> None:
    """Print a message on standard error."""
    try:
        print(f"{PROGRAM}: {' '.join(sentence.split())}", file=sys.stderr, flush=True)
    except OSError:
        drop(sys.stderr)  # a closed stderr does not stop the computation


def drop(stream: TextIO) -> None:
    """Discard pending and further output of a stream, which would raise at exit."""
    with contextlib.suppress(OSError, ValueError):  # streams of notebooks have no descriptor
        nothing = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nothing, stream.fileno())
        finally:
            os.close(nothing)
