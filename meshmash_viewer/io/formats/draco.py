"""Reader of Draco files, and of mesh fragments of Neuroglancer in the same format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshmash_viewer.errors import cut_short, package_missing, wrong_format
from meshmash_viewer.io.raw import RawMesh

_FIRST = b"DRACO"


def is_draco(path: Path) -> bool:
    """Whether a file begins with "DRACO"."""
    try:
        with path.open("rb") as file:
            return file.read(len(_FIRST)) == _FIRST
    except OSError:
        return False


def read_draco(path: Path) -> RawMesh:
    """Read the vertices and triangles of a Draco file."""
    return decode_draco(path.read_bytes())


def decode_draco(data: bytes) -> RawMesh:
    """Decode a mesh compressed by Draco; `InputError` is raised as by `draco_content`."""
    content = draco_content(data)
    vertices = np.asarray(content.points, dtype=np.float64).reshape(-1, 3)
    # decoded point clouds have no attribute `faces`
    faces = np.asarray(getattr(content, "faces", ()), dtype=np.int64).reshape(-1, 3)
    return RawMesh(vertices, faces)


def draco_content(data: bytes) -> Any:
    """Decompress a mesh; `InputError` is raised if it is damaged or DracoPy is not installed."""
    try:
        import DracoPy
    except ImportError:
        raise package_missing("is read by", "DracoPy", "draco") from None
    if not data.startswith(_FIRST):
        raise wrong_format(f'does not begin with "{_FIRST.decode()}"')
    try:
        return DracoPy.decode(data)
    except (ValueError, DracoPy.FileTypeException) as fault:
        raise cut_short("is a Draco file that cannot be unpacked") from fault
