"""NumPy archives with arrays ``vertices`` and ``faces``, our own exports among them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from meshmash_viewer.errors import InputError, printable
from meshmash_viewer.io.guarded import ReadLimits, read_guarded
from meshmash_viewer.io.polygons import RawMesh, fan_triangles
from meshmash_viewer.io.provenance import stated_unit

__all__ = ["npz_mesh", "read_npz"]


def read_npz(path: Path) -> RawMesh:
    """Read ``vertices`` (n, 3) and ``faces`` (m, 3 or more corners) from an NPZ file.

    The unit is taken from the JSON text ``meta``, where our own exports state it.

    Raises
    ------
    InputError
        If the file is no NPZ archive, or the arrays are absent or misshapen.
    """
    with _archive(path) as archive:
        held = archive.zip.infolist()
    sizes = {member.filename.removesuffix(".npy"): member.file_size for member in held}
    unpacked = sum(sizes.get(name, 0) for name in ("vertices", "faces", "meta"))
    size = path.stat().st_size
    if ReadLimits.are_needed(size, unpacked):
        return read_guarded(npz_mesh, path, ReadLimits.of(size, unpacked=unpacked))
    return npz_mesh(path)


def npz_mesh(path: Path) -> RawMesh:
    """Read the arrays of an archive; how large they are has been checked."""
    with _archive(path) as archive:
        vertices, faces = (_array(archive, name) for name in ("vertices", "faces"))
        try:
            unit = stated_unit(str(_array(archive, "meta")))
        except InputError:  # without one, or another program's
            unit = None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise InputError(f"has vertices of shape {vertices.shape}, not (n, 3) numbers")
    if faces.ndim != 2 or faces.shape[1] < 3 or faces.dtype.kind not in "iu":
        raise InputError(f"has faces of shape {faces.shape}, not (m, 3) whole numbers")
    counts = np.full(len(faces), faces.shape[1], dtype=np.int64)
    triangles = fan_triangles(faces.astype(np.int64).reshape(-1), counts)
    return RawMesh(vertices.astype(np.float64), triangles, unit)


def _archive(path: Path) -> Any:
    if not zipfile.is_zipfile(path):
        raise InputError("is not an NPZ archive")
    try:
        archive = np.load(path)
    except (zipfile.BadZipFile, OSError, ValueError) as fault:
        raise InputError("is an archive whose table of contents is damaged") from fault
    if not {"vertices", "faces"} <= set(archive.files):
        archive.close()
        names = printable(", ".join(archive.files) or "nothing")
        raise InputError(f"holds {names}, not arrays called vertices and faces")
    return archive


def _array(archive: Any, name: str) -> npt.NDArray[Any]:
    try:
        return np.asarray(archive[name])
    except Exception as fault:  # whatever zip or the parser of a header stumbles on
        raise InputError(f"has an array {name} that is damaged or cut short") from fault
