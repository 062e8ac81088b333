"""Files that are either whole or not there, and temporary folders: what a kill leaves goes.

On Windows another program, such as a scanner for viruses or an indexer of files, may refuse for a
moment that a file is replaced or deleted, and one that has it mapped refuses it as long.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import shutil
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from meshmash_viewer.errors import InputError

__all__ = [
    "LEFT_OVER",
    "discard",
    "made_folder",
    "persistently",
    "remove_abandoned",
    "remove_left_overs",
    "scratch_prefix",
    "writing_errors",
    "written_together",
    "written_whole",
]

#: What the names of parts begin with.
LEFT_OVER = ".meshmash-"
#: ".meshmash-<machine>-<process>-<random>-<name>": whose part of which file it is.
_PART = re.compile(r"\.meshmash-([0-9a-f]{8})-(\d+)-[0-9a-f]{8}-.", re.DOTALL)
#: What the names of temporary folders begin with, before machine and process as well.
_SCRATCH = "meshmash-viewer-"
_OWNED = re.compile(_SCRATCH + r"([0-9a-f]{8})-(\d+)-")
#: Seconds after which nobody uses any more what is of a process that cannot be asked for.
_FORGOTTEN = 86_400.0
#: Seconds for which what another program refuses is tried again, and between two trials.
_PATIENCE, _PAUSE = 1.0, 0.05

_T = TypeVar("_T")


def persistently(act: Callable[[], _T]) -> _T:
    """Do what another program may refuse for a moment, trying again for a second.

    Parameters
    ----------
    act : callable
        What is done with a file; its result is returned.

    Raises
    ------
    PermissionError
        If it is refused to the end. Other errors are raised at once.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return act()
        except PermissionError:
            if time.monotonic() >= deadline:
                raise
        time.sleep(_PAUSE)


def discard(*paths: Path) -> None:
    """Delete files that are of no more use, as far as that is possible within a second.

    No error is raised: what needs no file any more must not fail because it stays.
    """
    deadline = time.monotonic() + _PATIENCE
    left = list(paths)
    while left:
        refused = []
        for path in left:
            try:
                path.unlink(missing_ok=True)
            except PermissionError:
                refused.append(path)
            except OSError:
                continue  # the disk has gone
        left = refused if time.monotonic() < deadline else []
        if left:
            time.sleep(_PAUSE)


@contextlib.contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to, and rename it to `path` at the end.

    If the body raises, the part is removed and an older file at `path` is left as it was. What a
    killed process has left in the same folder is removed.

    Parameters
    ----------
    path : Path
        The file to make or replace.

    Yields
    ------
    Path
        In the same folder and with the same endings, which some writers go by.
    """
    with written_together(path) as (part,):
        yield part


@contextlib.contextmanager
def written_together(*paths: Path) -> Iterator[list[Path]]:
    """As `written_whole`, for files that belong together and take their places as one.

    Parameters
    ----------
    *paths : Path
        Files to make or replace; the first one goes first, the others right after it.

    Yields
    ------
    list of Path
        One for each of them.
    """
    for folder in {path.parent for path in paths}:
        remove_left_overs(folder)
    parts = [
        path.with_name(f"{LEFT_OVER}{_machine()}-{os.getpid()}-{uuid.uuid4().hex[:8]}-{path.name}")
        for path in paths
    ]
    try:
        yield parts
        # The rename must not reach the disk before the content does.
        for part in parts:
            persistently(functools.partial(_flush, part))
        for part, path in zip(parts, paths, strict=True):
            persistently(functools.partial(os.replace, part, path))
    finally:
        discard(*parts)


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def remove_left_overs(folder: Path) -> None:
    """Delete the parts of files whose process was killed before it could."""
    with contextlib.suppress(OSError):  # no such folder, which whoever writes there will say
        names = [entry.name for entry in os.scandir(folder) if entry.name.startswith(LEFT_OVER)]
        for name in names:
            found = _PART.match(name)
            if found is not None and _is_left(folder / name, found):
                with contextlib.suppress(PermissionError):  # another's, or held: the next time
                    (folder / name).unlink(missing_ok=True)


def scratch_prefix() -> str:
    """What `tempfile` is to begin the name of a folder with that `remove_abandoned` knows."""
    return f"{_SCRATCH}{_machine()}-{os.getpid()}-"


def remove_abandoned() -> None:
    """Delete the temporary folders of processes that were killed before they could."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*"):
        with contextlib.suppress(OSError):  # another user's, or just gone
            if folder.is_dir() and _is_left(folder, _OWNED.match(folder.name)):
                shutil.rmtree(folder, ignore_errors=True)


def _is_left(path: Path, owner: re.Match[str] | None) -> bool:
    """Whether the process is gone that a name tells of, or nobody has touched it for long."""
    if owner is None or owner[1] != _machine():
        return time.time() - path.stat().st_mtime > _FORGOTTEN
    import psutil

    return not psutil.pid_exists(int(owner[2]))


@functools.cache
def _machine() -> str:
    """What tells processes of the same number apart: the machine, its start, the container."""
    marks = [platform.node(), sys.platform]
    for name in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with contextlib.suppress(OSError):
            marks.append(os.readlink(name) if os.path.islink(name) else Path(name).read_text())
    return hashlib.sha256("\n".join(marks).encode()).hexdigest()[:8]


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, with those above it, and remove those that are still empty at the end.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        with writing_errors(folder, is_folder=True):
            folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        with contextlib.suppress(OSError):  # it holds something by now
            for place in made:
                place.rmdir()


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
            " the disk, give yourself permission or close the program that has the file open."
        ) from fault
