"""NumPy archives with arrays ``vertices`` and ``faces``, our own exports among them."""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy_format

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.faults import printable
from meshmash_viewer.io.guarded import read_guarded
from meshmash_viewer.io.limits import ReadLimits
from meshmash_viewer.io.polygons import RawMesh, fan_triangles
from meshmash_viewer.io.provenance import stated_unit

__all__ = ["npz_mesh", "read_npz"]

_HEADERS: dict[tuple[int, int], Any] = {
    (1, 0): npy_format.read_array_header_1_0,
    (2, 0): npy_format.read_array_header_2_0,
}


def read_npz(path: Path) -> RawMesh:
    """Read ``vertices`` (n, 3) and ``faces`` (m, 3 or more corners) from an NPZ file.

    The unit is taken from the JSON text ``meta``, where our own exports state it.

    Raises
    ------
    InputError
        If the file is no NPZ archive, or the arrays are absent or misshapen.
    """
    if not zipfile.is_zipfile(path):
        raise InputError("is not an NPZ archive")
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in _checked_members(archive).values())
    except (zipfile.BadZipFile, OSError) as fault:
        raise InputError("is an archive whose table of contents is damaged") from fault
    size = path.stat().st_size
    if ReadLimits.are_needed(size, unpacked):
        return read_guarded(npz_mesh, path, ReadLimits.of(size, unpacked))
    return npz_mesh(path)


def npz_mesh(path: Path) -> RawMesh:
    """Read the arrays of an archive; how large they are has been checked."""
    with zipfile.ZipFile(path) as archive:
        arrays: dict[str, npt.NDArray[Any]] = {}
        for name, member in _checked_members(archive).items():
            try:
                with archive.open(member) as file:
                    arrays[name] = npy_format.read_array(file, allow_pickle=False)
            except (zipfile.BadZipFile, zlib.error, EOFError, ValueError) as fault:
                raise InputError(f"has an array {name} that is damaged or cut short") from fault
    vertices, faces = arrays["vertices"], arrays["faces"]
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise InputError(f"has vertices of shape {vertices.shape}, not (n, 3) numbers")
    if faces.ndim != 2 or faces.shape[1] < 3 or faces.dtype.kind not in "iu":
        raise InputError(f"has faces of shape {faces.shape}, not (m, 3) whole numbers")
    counts = np.full(len(faces), faces.shape[1], dtype=np.int64)
    triangles = fan_triangles(faces.astype(np.int64).reshape(-1), counts)
    unit = stated_unit(str(arrays["meta"])) if "meta" in arrays else None
    return RawMesh(vertices.astype(np.float64), triangles, unit)


def _checked_members(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The arrays to be read, none of which promises more than its member holds."""
    held = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
    if not {"vertices", "faces"} <= held.keys():
        names = printable(", ".join(held) or "nothing")
        raise InputError(f"holds {names}, not arrays called vertices and faces")
    for name in ("vertices", "faces", "meta"):
        if name not in held:
            continue
        try:
            with archive.open(held[name]) as file:
                version = npy_format.read_magic(file)
                shape, _, dtype = _HEADERS[version](file)
                room = held[name].file_size - file.tell()
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as e:
            raise InputError(f"has an array {name} that is damaged ({printable(e)})") from e
        except OSError as fault:
            raise InputError(f"has an array {name} that lies nowhere in the archive") from fault
        except Exception as fault:  # whatever the parser of Python's literals stumbles on
            raise InputError(f"has an array {name} without a header that NumPy knows") from fault
        if name == "meta" and dtype.kind != "U":
            del held[name]  # another program's
        elif dtype.hasobject or not dtype.itemsize:
            raise InputError(f"has an array {name} of {printable(dtype, 20)}, not of numbers")
        elif min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize > room:
            raise InputError(
                f"has an array {name} of shape {printable(shape, 60)}, too large for the"
                f" {room} bytes it holds, so it was cut short"
            )
    return {name: held[name] for name in ("vertices", "faces", "meta") if name in held}
