"""What libraries and files have to say about a fault, before it reaches the user."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator

from meshmash_viewer.errors import InputError

__all__ = ["printable", "reading_in_silence", "unreadable"]


def printable(text: object, length: int = 120) -> str:
    """Text out of a file as one line that a terminal and a message bar can show.

    Parameters
    ----------
    text : object
        Anything with a text.
    length : int
        Characters at most.
    """
    line = " ".join(str(text).split())
    line = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in line
    )
    return line if len(line) <= length else line[: length - 1] + "…"


def unreadable(fault: BaseException) -> InputError:
    """What is left to say where a library says it best."""
    return InputError(f"is not readable ({printable(fault) or type(fault).__name__})")


@contextlib.contextmanager
def reading_in_silence() -> Iterator[None]:
    """Let nothing through that a library has to say about a file.

    What it finds wrong reaches the user in the one sentence of `InputError`; a file that reads
    well is checked by `meshmash_viewer.io.read` whatever a library thought of it.
    """
    import logging  # which a process that reads one file and ends can do without

    loggers = [logging.getLogger(name) for name in ("trimesh", "nibabel", "nibabel.global")]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            with contextlib.redirect_stderr(io.StringIO()):
                yield
    finally:
        for logger, disabled in zip(loggers, before, strict=True):
            logger.disabled = disabled
