"""Atomic writing of files, temporary folders, and the user's folders.

On Windows another program, such as a virus scanner or a file indexer, may block the replacement or
deletion of a file for a moment; a program that has mapped the file blocks both until it unmaps it.
Temporary folders of killed processes are removed later.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import os
import platform
import re
import shutil
import sys
import sysconfig
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, TypeVar

from meshmash_viewer.errors import InputError

#: Prefix of the names of partial files.
LEFT_OVER = ".meshmash-"
#: Prefix of the names of temporary folders. In both kinds of names, the hash of the machine and
#: the process number follow: ".meshmash-<machine>-<process>-<random>-<name>".
_SCRATCH = "meshmash-viewer-"
_OWNER = re.compile(rf"(?:{re.escape(LEFT_OVER)}|{_SCRATCH})([0-9a-f]{{8}})-(\d+)-")
#: Seconds after which files of processes on another machine are considered abandoned.
_FORGOTTEN = 86_400.0
#: Seconds for which an operation blocked by another program is retried, and between retries.
_PATIENCE, _PAUSE = 1.0, 0.05
#: Number of zero bytes written at a time.
_CHUNK = 1 << 20
#: Error codes of file systems that cannot allocate blocks in advance.
_NOT_SUPPORTED = (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS)

_T = TypeVar("_T")


def persistently(act: Callable[..., _T], *arguments: Any) -> _T:
    """Call a file operation, retry it for a second on `PermissionError`, and return its result.

    `PermissionError` is raised if the last retry fails. Other errors are raised at once.
    """
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return act(*arguments)
        except PermissionError:
            if time.monotonic() >= deadline:
                raise
        time.sleep(_PAUSE)


def discard(*paths: Path) -> None:
    """Delete files that may be deleted later as well; errors are ignored, without a retry."""
    for path in paths:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, and rename it to `path` at the end.

    The temporary path has the ending of `path`, by which some writers choose the format. If the
    body raises, the temporary file is removed and an older file at `path` is unchanged. Temporary
    files of killed processes in the same folder are removed.
    """
    with written_together(path) as (part,):
        yield part


@contextlib.contextmanager
def written_together(*paths: Path) -> Iterator[list[Path]]:
    """Do as `written_whole` for several files, which are renamed in the given order."""
    for folder in {path.parent for path in paths}:
        remove_left_overs(folder)
    parts = [
        path.with_name(f"{LEFT_OVER}{_machine()}-{os.getpid()}-{uuid.uuid4().hex[:8]}-{path.name}")
        for path in paths
    ]
    try:
        yield parts
        # the content must be on the disk before the rename
        for part in parts:
            persistently(_flush, part)
        for part, path in zip(parts, paths, strict=True):
            persistently(os.replace, part, path)
    except BaseException:
        for part in parts:
            with contextlib.suppress(OSError):  # the error of the body is raised
                persistently(part.unlink, True)
        raise


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def remove_left_overs(folder: Path) -> None:
    """Delete the partial files of killed processes."""
    with contextlib.suppress(OSError):  # the write reports a missing folder
        for path in folder.glob(f"{LEFT_OVER}*"):
            if _OWNER.match(path.name) and _is_left(path):
                discard(path)


def scratch_prefix() -> str:
    """Return a prefix for names of temporary folders, recognized by `remove_abandoned`."""
    return f"{_SCRATCH}{_machine()}-{os.getpid()}-"


def remove_abandoned() -> None:
    """Delete the temporary folders of killed processes."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*"):
        with contextlib.suppress(OSError):  # another user's folder, or just deleted
            if folder.is_dir() and _is_left(folder):
                shutil.rmtree(folder, ignore_errors=True)


def _is_left(path: Path) -> bool:
    """Whether a file's process has ended; on another machine, whether the file is a day old."""
    owner = _OWNER.match(path.name)
    if owner is None or owner[1] != _machine():
        return time.time() - path.stat().st_mtime > _FORGOTTEN
    import psutil

    return not psutil.pid_exists(int(owner[2]))


@functools.cache
def _machine() -> str:
    """Return a hash of machine, boot and container, within which process numbers are unique."""
    marks = [platform.node(), sys.platform]
    for name in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with contextlib.suppress(OSError):
            marks.append(os.readlink(name) if os.path.islink(name) else Path(name).read_text())
    return hashlib.sha256("\n".join(marks).encode()).hexdigest()[:8]


def make_room(path: Path, size: int) -> None:
    """Extend a file, new or old, with zeros to `size` bytes, and allocate its disk blocks.

    `OSError` is raised if the disk is full. Without allocated blocks, a write to a memory map of
    the file would crash the process on a full disk.
    """
    with path.open("ab", buffering=0) as file:
        before = file.tell()
        try:
            _fill(file, before, size - before)
            os.fsync(file.fileno())
        except BaseException:
            file.truncate(before)
            raise


def _fill(file: IO[bytes], start: int, size: int) -> None:
    if size > 0 and hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), start, size)
        except OSError as fault:
            if fault.errno not in _NOT_SUPPORTED:
                raise
        else:
            return
    zeros = bytes(min(max(size, 0), _CHUNK))
    while size > 0:
        size -= file.write(zeros[:size])


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder with its parents, and at the end remove new folders that are still empty.

    `InputError` is raised if the folder cannot be made.
    """
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        with writing_errors(folder, is_folder=True):
            folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        with contextlib.suppress(OSError):  # not empty
            for place in made:
                place.rmdir()


@contextlib.contextmanager
def writing_errors(path: Path, *, is_folder: bool = False) -> Iterator[None]:
    """Convert an `OSError` while writing `path`, a file or a folder, to an `InputError`."""
    if path.is_dir() and not is_folder:
        raise InputError("not-a-file", f"{path} is a folder", "name a file in it")
    if not path.parent.is_dir() and not is_folder:
        what = f"{path} cannot be written because there is no folder {path.parent}"
        raise InputError("folder-not-found", what, "make it first")
    try:
        yield
    except OSError as fault:
        raise InputError(
            "not-writable",
            f"{path} cannot be written ({fault.strerror or fault})",
            "choose another folder, free the disk, give yourself permission or close the program"
            " that has the file open",
        ) from fault


# -- folders of the user -------------------------------------------------------------------------

#: Environment variable with a folder that replaces all of the user's folders below.
CACHE_VARIABLE = "MESHMASH_CACHE"


def cache_folder() -> Path:
    """Return the folder for caches: `CACHE_VARIABLE`, or else that of the operating system."""
    return _folder("", "cache")


def session_folder() -> Path:
    """Return the folder for sessions: in `CACHE_VARIABLE`, or else in the user's data folder."""
    return _folder("sessions", "data", "sessions")


def link_folder() -> Path:
    """Return the folder of links to meshes, next to the folder of sessions."""
    return session_folder().parent / "links"


def log_folder() -> Path:
    """Return the folder for logs: in `CACHE_VARIABLE`, or else the user's log folder."""
    return _folder("log", "log")


def _folder(named: str, kind: str, below: str = "") -> Path:
    text = os.environ.get(CACHE_VARIABLE, "").strip()
    if text:
        return Path(text).expanduser().absolute() / named
    import platformdirs

    found = getattr(platformdirs, f"user_{kind}_dir")("meshmash-viewer", appauthor=False)
    return Path(found, below)


def page_file(name: str) -> Path | None:
    """Return the file of a page on an algorithm, in the checkout or installed; None without one."""
    checkout = Path(__file__).parents[2] / "docs" / "algorithms"
    installed = Path(sysconfig.get_path("data"), "share", "doc", "meshmash-viewer")
    files = (folder / f"{name}.md" for folder in (checkout, installed))
    return next((file for file in files if file.is_file()), None)
