"""Small files that say themselves whether they are whole, and whose they are.

The first line holds a digest of all bytes after it, the second line the content as JSON with the
key of the owner, and the arrays follow. Such a file is never changed, only replaced.
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

__all__ = ["Damaged", "Sealed", "read_sealed", "write_sealed"]

_MAGIC = b"meshmash-viewer sha256 "
_FIRST_LINE = len(_MAGIC) + 64 + 1
#: Arrays begin at multiples of this.
_ALIGNMENT = 64
#: Bytes of JSON that are read at most.
_LONGEST_LINE = 1 << 24


class Damaged(ValueError):
    """A file is not what was written there."""


@dataclass(frozen=True, eq=False)
class Sealed:
    """What a sealed file holds.

    Parameters
    ----------
    content : dict
        As it was given, from JSON.
    arrays : dict of ndarray
    seal : str
        The digest of the file.
    """

    content: dict[str, Any]
    arrays: dict[str, npt.NDArray[Any]]
    seal: str


def write_sealed(
    path: Path, key: str, content: dict[str, Any], arrays: dict[str, npt.NDArray[Any]] | None = None
) -> str:
    """Write a sealed file whole or not at all; returns its seal.

    Parameters
    ----------
    path : Path
    key : str
        Of the owner.
    content : dict
        JSON-able, without NaN.
    arrays : dict of ndarray, optional
    """
    blocks, layout = [], []
    for name, array in (arrays or {}).items():
        block = np.ascontiguousarray(array)
        layout.append([name, block.dtype.str, list(block.shape)])
        blocks.append(block)
    head = json.dumps({"key": key, "content": content, "arrays": layout}, allow_nan=False).encode()
    head += b" " * (-(_FIRST_LINE + len(head) + 1) % _ALIGNMENT) + b"\n"
    parts: list[Any] = [head]
    for block in blocks:
        parts += [block.reshape(-1).view(np.uint8), bytes(-block.nbytes % _ALIGNMENT)]
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    with written_whole(path) as beside, beside.open("wb") as file:
        file.write(_MAGIC + digest.hexdigest().encode() + b"\n")
        for part in parts:
            file.write(part)
    return digest.hexdigest()


def read_sealed(path: Path, key: str) -> Sealed:
    """Read a sealed file.

    Parameters
    ----------
    path : Path
    key : str
        Of whom it should be.

    Raises
    ------
    Damaged
        If a byte of it is another one than was written, or it belongs to somebody else.
    OSError
        If it cannot be read.
    """
    whole = np.fromfile(path, dtype=np.uint8)
    if len(whole) <= _FIRST_LINE or bytes(whole[: len(_MAGIC)]) != _MAGIC:
        raise Damaged(f"{path.name} does not begin as it should")
    seal = hashlib.sha256(whole[_FIRST_LINE:].data).hexdigest()
    if bytes(whole[len(_MAGIC) : _FIRST_LINE]) != seal.encode() + b"\n":
        raise Damaged(f"{path.name} does not agree with its checksum")
    try:
        line = bytes(whole[_FIRST_LINE : _FIRST_LINE + _LONGEST_LINE]).split(b"\n", 1)[0]
        head = json.loads(line)
        if head["key"] != key:
            raise Damaged(f"{path.name} belongs to another mesh")
        arrays = {}
        place = _FIRST_LINE + len(line) + 1
        for name, kind, shape in head["arrays"]:
            dtype = np.dtype(kind)
            size = dtype.itemsize * int(np.prod(shape))
            arrays[name] = whole[place : place + size].view(dtype).reshape(shape)
            place += size + -size % _ALIGNMENT
        return Sealed(dict(head["content"]), arrays, seal)
    except (ValueError, KeyError, TypeError, RecursionError) as fault:
        # Whole, but not written by this program.
        raise fault if isinstance(fault, Damaged) else Damaged(f"{path.name}: {fault}") from fault
