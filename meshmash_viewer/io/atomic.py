"""Files that are either whole or not there: written beside, then renamed."""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Iterator
from pathlib import Path

from meshmash_viewer.errors import InputError

__all__ = ["writing_errors", "written_whole"]


@contextlib.contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it to `path` at the end.

    If the body raises, the part is removed and an older file at `path` is left as it was.

    Parameters
    ----------
    path : Path
        The file to make or replace.

    Yields
    ------
    Path
        In the same folder and with the same endings, which some writers go by.
    """
    part = path.with_name(f".{uuid.uuid4().hex[:12]}-{path.name}")
    try:
        yield part
        # The rename must not reach the disk before the content does.
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def writing_errors(path: Path, *, is_folder: bool = False) -> Iterator[None]:
    """Turn what the system says against writing `path`, a file or a folder, into one sentence.

    Raises
    ------
    InputError
        Instead of `OSError`.
    """
    if path.is_dir() and not is_folder:
        raise InputError(f"{path} is a folder; name a file in it.")
    if not path.parent.is_dir() and not is_folder:
        raise InputError(
            f"{path} cannot be written because there is no folder {path.parent}; make it first."
        )
    try:
        yield
    except OSError as fault:
        raise InputError(
            f"{path} cannot be written ({fault.strerror or fault}); choose another folder, free"
            " the disk or give yourself permission."
        ) from fault
