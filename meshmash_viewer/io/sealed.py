"""Small files with a checksum and the key of their owner.

The first line holds a digest of all bytes after it, which are a NumPy archive: the arrays, and as
JSON the content with the key of the owner. Such a file is never changed, only replaced.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.io.atomic import written_whole

_MAGIC = b"meshmash-viewer sha256 "
_FIRST_LINE = len(_MAGIC) + 64 + 1
#: Name of the JSON among the arrays.
_ABOUT = "about.json"


class Damaged(ValueError):
    """A file differs from what was written."""


@dataclass(frozen=True, eq=False)
class Sealed:
    """Content of a sealed file; `seal` is its digest."""

    content: dict[str, Any]
    arrays: dict[str, npt.NDArray[Any]]
    seal: str


def write_sealed(
    path: Path, key: str, content: dict[str, Any], arrays: dict[str, npt.NDArray[Any]] | None = None
) -> str:
    """Write a sealed file atomically; return its seal.

    Parameters
    ----------
    path : Path
    key : str
        Key of the owner.
    content : dict
        JSON-able, without NaN.
    arrays : dict of ndarray, optional
    """
    about = json.dumps({"key": key, "content": content}, allow_nan=False).encode()
    members: dict[str, Any] = {_ABOUT: np.array(about), **(arrays or {})}
    with written_whole(path) as part, part.open("w+b") as file:
        file.write(bytes(_FIRST_LINE))
        np.savez(file, **members)
        file.seek(_FIRST_LINE)
        seal = hashlib.file_digest(file, "sha256").hexdigest()
        file.seek(0)
        file.write(_first_line(seal))
    return seal


def read_sealed(path: Path, key: str) -> Sealed:
    """Read a sealed file.

    Parameters
    ----------
    path : Path
    key : str
        Key of the expected owner.

    Raises
    ------
    Damaged
        If its bytes do not agree with the digest, or it has another owner.
    OSError
        If it cannot be read.
    """
    with path.open("rb") as file:
        first = file.read(_FIRST_LINE)
        seal = hashlib.file_digest(file, "sha256").hexdigest()
        if first != _first_line(seal):
            raise Damaged(f"{path.name} does not agree with its checksum")
        file.seek(_FIRST_LINE)
        with np.load(file) as archive:
            arrays = dict(archive)
    about = json.loads(arrays.pop(_ABOUT).item())
    if about["key"] != key:
        raise Damaged(f"{path.name} belongs to another mesh")
    return Sealed(about["content"], arrays, seal)


def _first_line(seal: str) -> bytes:
    return _MAGIC + seal.encode() + b"\n"
