"""NumPy archives with arrays ``vertices`` and ``faces``, our own exports among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from meshmash_viewer.errors import InputError
from meshmash_viewer.io.polygons import RawMesh, fan_triangles
from meshmash_viewer.io.provenance import stated_unit

__all__ = ["read_npz"]


def read_npz(path: Path) -> RawMesh:
    """Read ``vertices`` (n, 3) and ``faces`` (m, 3 or more corners) from an NPZ file.

    The unit is taken from the JSON text ``meta``, where our own exports state it.

    Raises
    ------
    InputError
        If the file is no NPZ archive, or the arrays are absent or misshapen.
    """
    import zipfile

    if not zipfile.is_zipfile(path):
        raise InputError("is not an NPZ archive")
    with np.load(path, allow_pickle=False) as archive:
        missing = {"vertices", "faces"} - set(archive.files)
        if missing:
            held = ", ".join(archive.files) or "nothing"
            raise InputError(f"holds {held}, not arrays called vertices and faces")
        vertices, faces = archive["vertices"], archive["faces"]
        unit = stated_unit(str(archive["meta"])) if "meta" in archive.files else None
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise InputError(f"has vertices of shape {vertices.shape}, not (n, 3) numbers")
    if faces.ndim != 2 or faces.shape[1] < 3 or faces.dtype.kind not in "iu":
        raise InputError(f"has faces of shape {faces.shape}, not (m, 3) whole numbers")
    counts = np.full(len(faces), faces.shape[1], dtype=np.int64)
    triangles = fan_triangles(faces.astype(np.int64).reshape(-1), counts)
    return RawMesh(vertices.astype(np.float64), triangles, unit)
